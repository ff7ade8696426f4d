"""The rule sets of the CARLA Leaderboard."""
