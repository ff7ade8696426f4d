"""What findings are worth. Nothing in here ever sees a log."""
