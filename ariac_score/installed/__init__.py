"""What the installed distributions bring by entry point, and what their code prints, held back."""
