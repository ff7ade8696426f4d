"""A competition as a static site: leaderboard, trial pages, tables; no server, no script."""
