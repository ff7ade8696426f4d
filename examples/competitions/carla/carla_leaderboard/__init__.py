"""The CARLA Leaderboard as a guest: the reader of its results, its infractions, its rule sets."""
