"""The rule sets of the AI for Industry Challenge 2026, state by state."""
