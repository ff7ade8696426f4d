"""Traces: JSON values one after another."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

from ariac_score import LogError
from ariac_score_rml.values import Json

__all__ = ["read_events"]

_SPACE = re.compile(r"[ \t\r\n]*")
_COMMA = re.compile(r",[ \t\r\n]*\}")
_STRING_OR_COMMA = re.compile(r'"(?:[^"\\]|\\.)*(?:"|\\?\Z)|,(?=[ \t\r\n]*\})', re.DOTALL)


def read_events(text: str, *, file: object = None) -> Iterator[Json]:
    """The events of a trace, read one by one.

    White space between them is optional. A comma before `}` is tolerated, as in the
    reference; a key that stands twice in an object, NaN and infinities are not.

    Raises:
        LogError: With the line and the number of the event.

    >>> list(read_events('{"a": 1,} {"b": [1.0, null]}'))
    [{'a': 1}, {'b': [1.0, None]}]
    """
    decoder = json.JSONDecoder(
        object_pairs_hook=_record, parse_constant=_no_constant, parse_float=_float, parse_int=_int
    )
    if _COMMA.search(text):  # the substitution looks at every string, which takes long in a long trace
        text = _STRING_OR_COMMA.sub(lambda m: " " if m.group() == "," else m.group(), text)
    at, count = _SPACE.match(text, 0).end(), 0  # type: ignore[union-attr]  # it matches nothing too
    while at < len(text):
        count += 1
        try:
            event, at = decoder.raw_decode(text, at)
        except json.JSONDecodeError as error:
            cut = error.pos >= len(text.rstrip()) or "Unterminated" in error.msg
            cause = "the trace ends in the middle of an event" if cut else f"no JSON: {error.msg}"
            raise _refused(cause, text, max(at, error.pos), count, file) from None
        except _RefusedError as error:
            raise _refused(str(error), text, at, count, file) from None
        except RecursionError:
            raise _refused("the event is nested too deeply", text, at, count, file) from None
        yield event
        at = _SPACE.match(text, at).end()  # type: ignore[union-attr]


class _RefusedError(ValueError):
    """A value that JSON or the language does not have."""


def _refused(cause: str, text: str, at: int, count: int, file: object) -> LogError:
    line = text.count("\n", 0, at) + 1
    column = at - (text.rfind("\n", 0, at) + 1) + 1
    return LogError(
        cause,
        file=file,
        place=f"event {count}, line {line}, column {column}",
        hint="a trace is one JSON value after another",
    )


def _record(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    record = dict(pairs)
    if len(record) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _RefusedError(f"the key {twice!r} stands twice in an object")
    return record


def _no_constant(word: str) -> Json:
    raise _RefusedError(f"{word} is no JSON")


def _float(word: str) -> float:
    value = float(word)
    if value - value != 0:
        raise _RefusedError(f"the number {word[:40]} is too large")
    return value


def _int(word: str) -> int:
    if len(word) > 4000:
        raise _RefusedError("a number has more than 4000 digits")
    return int(word)
