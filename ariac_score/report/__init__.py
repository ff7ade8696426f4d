"""Showing results. Computes nothing."""
