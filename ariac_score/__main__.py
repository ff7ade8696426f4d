"""`python -m ariac_score`: the command line, where scripts are not on the path."""

from ariac_score.cli import program

if __name__ == "__main__":
    program()
