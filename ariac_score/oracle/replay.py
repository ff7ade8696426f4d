"""The recorded verdicts of an earlier run compared with ours, event by event."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ariac_score.errors import NothingToScoreError, PluginError
from ariac_score.logs.rosmonitoring import Row, channel_of, rows
from ariac_score.oracle.judges import UNKNOWN, Bench, Judge, Opinion

__all__ = ["NEGATIVE", "Disagreement", "Replay", "replay", "replay_text"]

NEGATIVE = frozenset({"false", "currently_false", "violation", "violated"})
"""The verdicts that a monitor takes for a violation; text and truth values, in lower case."""

_SHOWN = 20


@dataclass(frozen=True)
class Disagreement:
    """An event that is a violation by the recorded verdict and none by ours, or the other way round.

    Attributes:
        line: Its line in the log.
        channel: Its topic.
        theirs: The recorded verdict.
        ours: The opinion of our judge.
    """

    line: int
    channel: str
    theirs: str
    ours: Opinion


@dataclass(frozen=True)
class Replay:
    """How the recorded verdicts compare.

    Attributes:
        agreeing: Events on which both agree.
        undecided: Events that at least one of the two cannot decide.
        without: Events without a recorded verdict.
        differences: In order of the log.
    """

    agreeing: int
    undecided: int
    without: int
    differences: tuple[Disagreement, ...]


def replay(log: Path, bench: Bench) -> Replay:
    """Judge the events of a log again and compare with the verdicts it holds.

    Args:
        log: A status log, an older node's event log, or an oracle's own log.
        bench: Makes our judge.

    Raises:
        LogError: The log is damaged.
        NothingToScoreError: It holds no verdict.
    """
    judge = bench.judge()
    agreeing = undecided = without = 0
    differences = []
    for row in rows(log):
        ours = _opinion(judge, row)
        theirs = UNKNOWN if row.verdict is None else str(row.verdict).lower()
        without += row.verdict is None
        if UNKNOWN in (theirs, ours.verdict):
            undecided += row.verdict is not None
        elif (theirs in NEGATIVE) == (ours.verdict in NEGATIVE):
            agreeing += 1
        else:
            differences.append(Disagreement(row.line, channel_of(row.event), theirs, ours))
    if not (agreeing or undecided or differences):
        raise NothingToScoreError(
            "the log holds no verdict to compare with",
            file=log,
            hint="monitors of version 3 write their verdicts into the status log",
        )
    return Replay(agreeing, undecided, without, tuple(differences))


def _opinion(judge: Judge, row: Row) -> Opinion:
    try:
        return judge.take(row.event)
    except (ValueError, PluginError):
        return Opinion(UNKNOWN)


def replay_text(found: Replay) -> str:
    """A comparison for people."""
    lines = [
        f"{found.agreeing} verdicts agree, {len(found.differences)} differ, "
        f"{found.undecided} cannot be compared, {found.without} events have none"
    ]
    for one in found.differences[:_SHOWN]:
        reason = f" ({one.ours.spec})" if one.ours.spec else ""
        lines.append(
            f"  line {one.line}, {one.channel}: recorded {one.theirs}, ours {one.ours.verdict}{reason}"
        )
    if len(found.differences) > _SHOWN:
        lines.append(f"  and {len(found.differences) - _SHOWN} more")
    return "\n".join(lines) + "\n"
