"""Laws a fair penalty keeps, tried on random findings."""
