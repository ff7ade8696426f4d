"""Text on a terminal: colours, progress, output files."""
