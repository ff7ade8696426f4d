"""Laws of penalties proven, or refuted by an exploit, for a rule set rather than for random findings."""
