"""`python -m ariac_score.schemas`: write the schemas of stored documents anew, from their classes.

The schemas of files that people write, such as rule sets, are written by hand.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ariac_score.ranking.publication import PUBLICATION
from ariac_score.results.codec import Format
from ariac_score.results.cohort_file import COHORT
from ariac_score.results.result_file import RESULT
from ariac_score.review.audit import AUDIT

FORMATS: tuple[Format[Any], ...] = (RESULT, PUBLICATION, COHORT, AUDIT)


def schema_text(stored: Format[Any]) -> str:
    """The schema of a format, as its file has it."""
    return json.dumps(stored.schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for each in FORMATS:
        (Path(__file__).parent / f"{each.name}.schema.json").write_text(schema_text(each), encoding="utf-8")
