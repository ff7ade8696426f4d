"""What every server of ours keeps: who may ask it, and how many may be there at once."""
