"""An adversary: searches what raises the score that counts, in the log or in what was done."""
