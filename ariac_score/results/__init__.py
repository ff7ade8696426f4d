"""What is stored: one class for each document, and one codec for all of them."""
