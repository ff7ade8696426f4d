"""Scoring many trials: each in a process of its own, resumable at any moment, the same bytes anywhere.

The state of a batch is its folder. A result lies under a content address: a hash over everything it
follows from, which is the files of the run, the checks with their parameters, the log map, and the
code. So a second call does only what is missing, whatever ended the first one.
"""
