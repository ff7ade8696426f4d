"""The verdicts of 2023 and 2024, which the task manager prints when an order is handed in, and at the end.

The blocks are read by label. 2023 prints `Order: <id>` and the lines below it, 2024 the same with a dash
before each label and a question mark instead of some colons, and at the end the text of `trial_log.txt`.
A combined order of 2024 stands in that alone.

Source: task manager of 2023 and 2024; ARIAC notes on recording, sections 1.7 and 1.8.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ariac_score import LogError, OfficialOrder, OfficialResult
from ariac_score_ariac.official.trial_log import final_text
from ariac_score_ariac.stock.console import Said, lines_said

__all__ = ["Verdicts", "verdicts_of"]

_PAIR = re.compile(r"^(?P<label>[A-Za-z][^:?]{0,79}?)\s*[:?]\s*(?P<value>.*)$")
_NUMBER = re.compile(r"-?\d{1,15}(?:\.\d{1,20})?")
_PART = {"quadrant_score": "score", "faulty": "faulty_part", "flipped": "flipped_part"}
"""Labels of 2023 as 2024 prints them; those of quadrants 2 to 4 are shorter there."""
_TITLES = ("END OF TRIAL", "Trial Summary")
_SAYS_ALL = "Trial Summary"
"""Only this text of the end lists every order, of 2024."""
SOURCE = "/rosout"
_ONE_BLOCK_S = 0.5
"""What belongs together is printed by one call, in whatever number of messages."""


@dataclass(frozen=True)
class Verdicts:
    """What the task manager printed of a run.

    Attributes:
        orders: The orders handed in, and at the end of 2024 all others, as printed.
        said_s: When the verdict of an order was printed, s of trial time; that is when it was handed in.
        dashed: Whether the blocks are those of 2024, which print nothing of a combined order.
        ended_s: When the end of the trial was printed, s of trial time; `None` where it was not.
        lists_every_order: Whether the text of the end lists every order, handed in or not.
        result: The official result as far as it is printed.
    """

    orders: Mapping[str, OfficialOrder]
    said_s: Mapping[str, float]
    dashed: bool
    ended_s: float | None
    lists_every_order: bool
    result: OfficialResult


def verdicts_of(said: Sequence[Said]) -> Verdicts | None:
    """What the task manager printed of orders and the trial; `None` where it printed neither.

    Raises:
        LogError: The text of the end contradicts the verdict at a submission, or one verdict another.
    """
    lines = lines_said(said)
    end = next((i for i, (_, line) in enumerate(lines) if line.strip() in _TITLES), None)
    blocks = _blocks(lines[:end])
    if not blocks and end is None:
        return None
    printed = {block.id: block.order() for block in blocks.values()}
    final = None
    if end is not None and lines[end][1].strip() == _SAYS_ALL:
        final = _final(lines[end:])
    trial = _trial_values(lines[end:]) if end is not None else {}
    orders = {order_id: printed[order_id] for order_id in printed}
    for order in final.summaries if final else ():
        _refuse_other(printed.get(order.id), order)
        orders[order.id] = order
    scores = {o.id: o.score for o in orders.values() if o.score is not None}
    return Verdicts(
        orders,
        {block.id: block.said_s for block in blocks.values()},
        any(block.dashed for block in blocks.values()) or final is not None,
        None if end is None else lines[end][0],
        final is not None,
        OfficialResult(
            SOURCE,
            final.total if final else _number(trial.get("trial_score", "")),
            final.process_time_s if final else _number(trial.get("trial_completion_time", "")),
            scores,
            summaries=tuple(orders.values()),
            items=final.items if final else trial,
        ),
    )


def _final(lines: Sequence[tuple[float, str]]) -> OfficialResult | None:
    """The text of the end of 2024; `None` where it is not whole."""
    # One message, so what is printed later does not belong to it.
    t_s = lines[0][0]
    try:
        return final_text(
            "\n".join(line for said_s, line in lines if said_s <= t_s + _ONE_BLOCK_S), Path(SOURCE)
        )
    except LogError:
        return None


@dataclass
class _Block:
    """The lines below the name of an order."""

    id: str
    said_s: float
    dashed: bool
    values: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._inside = ""

    def take(self, label: str, value: str) -> None:
        """Take one labelled line; below `Quadrant` or `Part` it is about that one."""
        if label in ("quadrant", "part"):
            # 2024 prints `[battery,red]` at the submission and `red battery` at the end.
            words = re.findall(r"[a-z0-9]+", value.lower())
            self._inside = "_".join([label, *(reversed(words) if value.startswith("[") else words)])
        elif self._inside:
            self.values.setdefault(f"{self._inside}/{_PART.get(label, label)}", value)
        else:
            self.values.setdefault(label, value)

    @property
    def is_verdict(self) -> bool:
        """Whether it is one: announcements name an order too, and give it no score."""
        return self.score is not None

    @property
    def score(self) -> float | None:
        return _number(self.values.get("actual_score", self.values.get("score", "")))

    def order(self) -> OfficialOrder:
        """The verdict as the readers of official texts give one."""
        priority = self.values.get("priority", "").lower()
        return OfficialOrder(
            self.id,
            kind=self.values.get("type", "").lower(),
            submitted=True,
            priority={"high": True, "yes": True, "regular": False, "no": False}.get(priority),
            score=self.score,
            max_score=_number(self.values.get("max_score", "")),
            announced_s=_number(self.values.get("announcement_time", "")),
            submitted_s=_number(self.values.get("submission_time", "")),
            items=self.values,
        )


def _blocks(lines: Iterable[tuple[float, str]]) -> dict[str, _Block]:
    """The verdicts, by order; a block ends where another begins or another message does not go on with it."""
    found: list[_Block] = []
    for t_s, raw in lines:
        text = raw.strip()
        pair = _PAIR.match(text.lstrip("-\t "))
        if pair is None:
            continue
        label = "_".join(re.findall(r"[a-z0-9]+", pair["label"].lower()))
        value = pair["value"].strip()
        if label in ("order", "order_id") and re.fullmatch(r"\S+", value):
            found.append(_Block(value, t_s, label == "order_id"))
        elif found and t_s <= found[-1].said_s + _ONE_BLOCK_S:
            found[-1].take(label, value)
    verdicts: dict[str, _Block] = {}
    for block in found:
        if not block.is_verdict:
            continue
        known = verdicts.setdefault(block.id, block)
        if known.values != block.values:
            raise _contradiction(block.id, "two verdicts")
    return verdicts


def _trial_values(lines: Iterable[tuple[float, str]]) -> dict[str, str]:
    """What is printed of the trial at its end, up to the list of orders."""
    values: dict[str, str] = {}
    for _, raw in lines:
        text = raw.strip()
        if text.rstrip(":") == "ORDERS":
            break
        if pair := _PAIR.match(text.lstrip("-\t ")):
            label = "_".join(re.findall(r"[a-z0-9]+", pair["label"].lower()))
            values.setdefault(label, pair["value"].strip())
    return values


def _refuse_other(at_submission: OfficialOrder | None, at_end: OfficialOrder) -> None:
    if at_submission is not None and (at_submission.score != at_end.score or not at_end.submitted):
        raise _contradiction(at_end.id, "the verdict at its submission and the text of the end")


def _contradiction(order_id: str, what: str) -> LogError:
    return LogError(
        f"{what} of order {order_id!r} differ on {SOURCE}",
        hint="the recording holds two runs, or another node prints under the name of the task manager",
    )


def _number(text: str) -> float | None:
    return float(text) if _NUMBER.fullmatch(text) else None
