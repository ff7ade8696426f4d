"""ARIAC as a guest: its files, messages, rules, checks and evaluation programs."""
