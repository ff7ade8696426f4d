"""Columns to signals, orders and events of one trial."""
