"""`python -m ariac_score.cli`: the command line without its script."""

from ariac_score.cli import program

program()
