"""Watching a cell while it runs: sources of messages, the running state, the recording of what was seen."""
