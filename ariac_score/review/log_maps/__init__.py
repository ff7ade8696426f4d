"""Log maps drafted from recordings: what could be whom, and why."""
