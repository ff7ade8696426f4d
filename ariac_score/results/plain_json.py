"""Canonical JSON: sorted keys, one value a line, text as it is.

It is what `json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)` gives. The
encoder of `json` that is written in C does not indent, and a season is thousands of documents.
"""

from __future__ import annotations

import json
import math
from json.encoder import encode_basestring as quoted
from typing import Any

__all__ = ["canonical_text"]


def canonical_text(data: Any) -> str:
    """Data as canonical JSON.

    Raises:
        ValueError: A number is not finite.
        TypeError: JSON has no word for something.

    >>> print(canonical_text({"b": [1.5, None], "a": {}}))
    {
     "a": {},
     "b": [
      1.5,
      null
     ]
    }
    """
    try:
        return _text(data, "\n")
    except TypeError:  # a key that is no text, a class of somebody's own, a number that is none
        return json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)


def _text(value: Any, line: str) -> str:
    """A value of which each line begins so.

    Raises:
        TypeError: It is left to `json`.
    """
    kind = type(value)
    if kind is str:
        return quoted(value)
    if kind is dict and value:
        inner = f"{line} "
        told = [
            f"{quoted(key)}: {quoted(each) if type(each) is str else _text(each, inner)}"
            for key, each in sorted(value.items())
        ]
        return f"{{{inner}{f',{inner}'.join(told)}{line}}}"
    if (kind is list or kind is tuple) and value:
        inner = f"{line} "
        told = [_text(each, inner) for each in value]
        return f"[{inner}{f',{inner}'.join(told)}{line}]"
    if kind is int or (kind is float and math.isfinite(value)):
        return repr(value)
    if value is None or kind is bool:
        return "null" if value is None else "true" if value else "false"
    if kind in _EMPTY:
        return _EMPTY[kind]
    raise TypeError


_EMPTY: dict[Any, str] = {dict: "{}", list: "[]", tuple: "[]"}
