"""The files messages lie in, front to back, every length and checksum checked."""
