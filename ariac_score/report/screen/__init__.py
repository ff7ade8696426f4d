"""The screen of running cells: what is shown of a state, the page, and who serves it."""
