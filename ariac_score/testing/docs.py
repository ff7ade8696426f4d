"""`python -m ariac_score.testing.docs FOLDER`: write the page of every plugin of a distribution."""

from __future__ import annotations

import argparse
from pathlib import Path

from ariac_score.testing.pages import write_pages


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(prog="python -m ariac_score.testing.docs", description=__doc__)
    parser.add_argument("folder", type=Path, help="where to write")
    parser.add_argument("--distribution", default="ariac-score", help="whose plugins")
    arguments = parser.parse_args()
    write_pages(arguments.folder, arguments.distribution)


if __name__ == "__main__":
    main()
