"""Fuzzing of everything that reads what strangers send; see `fuzz/README.md`."""
