"""The AI for Industry Challenge 2026 as a guest: its recordings, its scorer's measures, its rule sets."""
