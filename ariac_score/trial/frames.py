"""Tables as pandas knows them, for notebooks; pandas is asked for when a table is, and not before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ariac_score.errors import UsageError

__all__ = ["frame"]


def frame(
    columns: Mapping[str, Any], *, index: str = "", units: Mapping[str, str] | None = None
) -> Any:  # a pandas.DataFrame, which is not installed everywhere
    """A `pandas.DataFrame` of columns of one length.

    Args:
        columns: By name.
        index: The column that labels the rows; empty for numbers from 0.
        units: The units of columns, kept in `attrs["units"]`.

    Raises:
        UsageError: pandas is not installed.
    """
    try:
        import pandas as pd  # noqa: PLC0415  # an extra, and slow to load
    except ImportError as cause:
        raise UsageError(
            "to_frame() needs pandas, which is not installed", hint="pip install 'ariac-score[notebook]'"
        ) from cause
    table = pd.DataFrame(dict(columns))
    if index:
        table = table.set_index(index)
    table.attrs["units"] = dict(units or {})
    return table
