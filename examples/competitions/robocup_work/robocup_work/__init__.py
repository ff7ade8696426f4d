"""RoboCup@Work as a guest: the readers of a task and of its referee's sheet, its checks, its rule set."""
