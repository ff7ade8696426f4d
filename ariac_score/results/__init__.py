"""Stored documents: results, cohorts, decisions, signatures."""
