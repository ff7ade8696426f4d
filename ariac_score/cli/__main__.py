"""`python -m ariac_score.cli`: the command line without its script."""

import sys

from ariac_score.cli import main

sys.exit(main())
