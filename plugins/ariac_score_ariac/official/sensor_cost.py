"""Reading `sensor_cost.txt` of 2024: which sensors a team used, and what they cost.

Written when the simulator starts, by the evaluation of each run. Only counts are in it,
no names, so sensors are named after their type and counted through.

Source: ARIAC notes on log formats, section 6.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ariac_score import LogDescription, LogError, NothingToScoreError, ReaderFacts, Trial, Wanted
from ariac_score_ariac.work import SensorBill

__all__ = ["SensorCostReader"]

FORMAT = "ARIAC sensor cost (2024)"
MAX_BYTES = 1_000_000
MAX_SENSORS = 1000

_NAME = "sensor_cost.txt"
_TITLE = "User Sensor Log"
_COUNT = re.compile(r"^Number of (?P<type>[a-z0-9_]{1,60})'s used: *(?P<count>.*)$")
_TOTAL = re.compile(r"^Total sensor cost is: *(?P<total>.*)$")
_DOLLARS = re.compile(r"\$(-?\d{1,12}(?:\.\d{1,6})?)")
_WHOLE = re.compile(r"\d{1,12}")
_CUT = "copy the file again, or start the simulator again: it is written at start-up"


class SensorCostReader:
    """Reads the sensors of a run and their total cost.

    Reads:
        How many sensors of each type there were, and what they cost in all.
    Refuses:
        An empty text, and one that was cut off before its total.
    Source:
        ARIAC notes on log formats, section 6.
    """

    facts = ReaderFacts(
        role="sensor_cost", a_file="an official sensor cost", formats="sensor_cost.txt of ARIAC"
    )

    def can_read(self, path: Path) -> bool:
        """Whether its first lines are the heading of such a file."""
        try:
            if path.suffix not in (".txt", "") or not path.is_file():
                return False
            with path.open("rb") as file:
                head = file.read(4096)
        except OSError:
            return False
        return b"\0" not in head and (path.name == _NAME or _TITLE.encode() in head)

    def describe(self, path: Path) -> LogDescription:
        """The total and the number of sensors by type."""
        try:
            cost = _parse(path)
        except LogError as error:
            return LogDescription(format=FORMAT, damage=str(error))
        facts: dict[str, int | float | str] = {"total": cost.total, "sensors": sum(cost.counts.values())}
        return LogDescription(format=FORMAT, facts=facts | {k: n for k, n in cost.counts.items() if n})

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The team's set-up with the printed cost; the team's name is not in the file.

        Raises:
            NothingToScoreError: The file is missing or empty.
            LogError: It is cut off, or a count or the total is no number.
        """
        cost = _parse(path)
        wanted.progress(1.0)
        sensors = {f"{kind}_{k}": kind for kind, count in cost.counts.items() for k in range(1, count + 1)}
        return Trial(
            id=path.stem,
            records=(SensorBill(cost.total, dict(sorted(sensors.items()))),),
        )


@dataclass(frozen=True)
class _SensorCost:
    """The text, parsed: sensors by type, and the total in dollars."""

    counts: dict[str, int]
    total: float


def _parse(path: Path) -> _SensorCost:
    counts: dict[str, int] = {}
    total: float | None = None
    for number, line in enumerate(_text(path).splitlines(keepends=True), start=1):
        text = line.strip()
        counted, summed = _COUNT.match(text), _TOTAL.match(text)
        if counted:
            counts[counted["type"]] = _count(path, number, counted["type"], counted["count"])
        elif summed and line.endswith("\n"):  # an amount at a cut would be another amount
            dollars = _DOLLARS.fullmatch(summed["total"])
            if dollars is None or float(dollars[1]) < 0:
                raise _fault(path, number, f"the total {summed['total']!r} is not an amount of dollars")
            # The last total counts. It is no sum of the counts: advanced cameras are listed and cost nothing.
            total = float(dollars[1])
    if total is None:
        raise LogError("the file is cut off: it has no total", file=path, hint=_CUT)
    return _SensorCost(counts, total)


def _count(path: Path, number: int, kind: str, text: str) -> int:
    if not _WHOLE.fullmatch(text) or int(text) > MAX_SENSORS:
        raise _fault(path, number, f"{text!r} is not a number of sensors of type {kind!r}")
    return int(text)


def _fault(path: Path, number: int, cause: str) -> LogError:
    return LogError(cause, file=path, place=f"line {number}", hint=_CUT)


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if not size:
            raise NothingToScoreError("the file is empty", file=path, hint="was the simulator started?")
        if size > MAX_BYTES:
            raise LogError(
                f"the file has more than {MAX_BYTES:,} bytes", file=path, hint="is this the right file?"
            )
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except FileNotFoundError:
        raise NothingToScoreError("no such file", file=path, hint="check the path") from None
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions"
        ) from cause
