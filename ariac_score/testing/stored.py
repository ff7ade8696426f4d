"""Writing a stored result that a test has changed."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

from ariac_score.results.codec import as_text

__all__ = ["rewritten"]


def rewritten(data: dict[str, Any]) -> str:
    """The text of a changed result, as the program would write it.

    Amounts get six decimals, as in all rule sets of the examples: a float has lost how many it had.
    """
    parts = {key: _exact(value, key) for key, value in data.items() if key != "schema"}
    return as_text(parts, data["schema"])


def _exact(value: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {key: _exact(inner, key) for key, inner in value.items()}
    if isinstance(value, list):
        return [_exact(inner) for inner in value]
    is_amount = key in ("score", "possible", "amount") and isinstance(value, float)
    return Decimal(repr(value)).quantize(Decimal("0.000001")) if is_amount else value
