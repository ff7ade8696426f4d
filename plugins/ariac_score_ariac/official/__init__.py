"""What the official programs write: texts and the database."""
