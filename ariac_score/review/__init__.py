"""A stored result doubted: verified, audited, compared, tried."""
