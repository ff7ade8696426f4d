"""Reading the score texts of 2023 and 2024: `trial_log.txt`, and `<trial>.txt` of the year before.

They are read by label, not by line number, so that a label more or less does no harm.
Times are simulated seconds since the start of the competition, which is neither the
simulator's own clock nor wall time. What a kit or an assembly held is never printed:
submissions come without contents, so that whatever depends on them stays undecided.

Source: ARIAC notes on log formats, sections 5.1 to 5.3.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    ORDER_ANNOUNCED,
    Clock,
    Event,
    LogDescription,
    LogError,
    NothingToScoreError,
    OfficialOrder,
    OfficialResult,
    ReaderFacts,
    Trial,
    TrialBuilder,
    Wanted,
)
from ariac_score_ariac.work import KitSubmission

__all__ = ["CLOCK", "TrialLogReader", "final_text"]

CLOCK = Clock("competition time", detail="simulated seconds since the start")
FORMAT = "ARIAC trial log (2023, 2024)"
MAX_BYTES = 4_000_000

OUTCOMES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "gazebo crashed score not recorded": ("crashed", "the simulator crashed; no score was recorded"),
        "process cancelled by user": (
            "cancelled",
            "the run was cancelled by its user; no score was recorded",
        ),
    }
)
"""What the evaluation script writes instead of a score: the outcome, and words for it."""

_NAME = "trial_log.txt"
_SNIFFED_BYTES = 65_536
_SIGNS = ("Trial Summary", "END OF TRIAL", "Orders Summary")
"""Headings of 2024, of 2023 at release and of December 2023, in this order."""
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_RULE = re.compile(r"[=\-_*]{3,}")
_PAIR = re.compile(r"^(?P<label>[^:]{1,80}?)\s*:\s*(?P<value>.*)$")
_NUMBER = re.compile(r"-?\d{1,15}(?:\.\d{1,20})?(?:e[+-]?\d{1,3})?")
_THREE = re.compile(rf"{_NUMBER.pattern}(?:, {_NUMBER.pattern}){{2}}")
_DECIMALS = 6
"""Digits that times are printed with, so that a difference of two has no more."""

_SUMMARY = (
    "order_type",
    "order_submitted",
    "priority",
    "max_task_score",
    "actual_task_score",
    "submission_time",
    "submission_duration",
)
_OF_QUADRANT = ("score", "correct_part_type", "correct_part_color", "faulty_part", "flipped_part")
_OF_PART = ("part_score", "correct_type", "correct_color", "correct_pose", "position", "orientation")
_OF_TASK = ("type", "priority", "max_score", "actual_score", "bonus")
_CUT = "copy the log again; a score must not rest on part of it"


class TrialLogReader:
    """Reads the official score text of one run of 2023 or 2024, or how the run ended without a score.

    Reads:
        The score and the times of each order as printed, the total, the course of the run.
    Refuses:
        An empty text, one of another kind, one that was cut off, an order that is given
        twice, and times that contradict each other.
    Source:
        ARIAC notes on log formats, sections 5.1 to 5.3.
    """

    facts = ReaderFacts(role="official", a_file="an official result", formats="trial_log.txt of ARIAC")

    def can_read(self, path: Path) -> bool:
        """Whether it has the headings of such a text, or is what the evaluation script wrote instead."""
        try:
            if path.suffix not in (".txt", ".log", "") or not path.is_file():
                return False
            with path.open("rb") as file:
                head = file.read(_SNIFFED_BYTES)
        except OSError:
            return False
        if b"\0" in head:
            return False
        text = _ANSI.sub("", head.decode("utf-8", "replace"))
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        return (
            path.name == _NAME
            or (len(lines) == 1 and lines[0].lower() in OUTCOMES)
            or any(line in _SIGNS for line in lines)
            # The layout of 2023 begins with the block of an order, and its only heading may be far below.
            or bool(re.match(r"\s*Order: *\S+\s+Type: *(?:Kitting|Assembly|Combined)\b", text))
        )

    def describe(self, path: Path) -> LogDescription:
        """The official numbers, and in which layout they are printed."""
        try:
            log = _parse(path)
        except LogError as error:
            return LogDescription(format=FORMAT, clock=str(CLOCK), damage=str(error))
        official = log.official(path.name)
        facts: dict[str, int | float | str] = {"layout": log.layout}
        if official.outcome:
            facts["outcome"] = official.outcome
        if official.total is not None:
            facts["total"] = official.total
        if not official.outcome:
            facts["orders"] = len(log.orders)
            facts["submitted"] = sum(1 for order in log.orders if order.submitted)
        return LogDescription(
            format=FORMAT, clock=str(CLOCK), facts=facts, duration_s=official.process_time_s or 0.0
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The official result, when orders were announced and handed in, start and end.

        Only the layout of 2024 lists every order, handed in or not, and so shows what
        was not.

        Raises:
            NothingToScoreError: The file is missing or empty.
            LogError: It is cut off, or a value is not what its label says.
        """
        log = _parse(path)
        wanted.progress(1.0)
        builder = TrialBuilder(log.trial_id or path.stem, file=path, clock=CLOCK)
        builder.official = log.official(path.name)
        if log.outcome:
            builder.defect(log.outcome, path.name, 1, OUTCOMES[log.outcome_text][1])
            return builder.build()
        builder.add(Event(0.0, COMPETITION_STARTED))
        if log.completed_s is not None:
            builder.add(Event(log.completed_s, COMPETITION_ENDED))
        # 2023 prints blocks of submitted kits alone: an order without one may have been an assembly.
        if log.lists_every_order:
            builder.witnessed.add("submissions")
        _add_orders(builder, log, path.name)
        return builder.build()


def _add_orders(builder: TrialBuilder, log: _ParsedLog, where: str) -> None:
    undated = 0
    for order in log.orders:
        if order.announced_s is not None:
            builder.add(Event(order.announced_s, ORDER_ANNOUNCED, order.id))
        if order.submitted:
            undated += order.submitted_s is None
            at_s = log.completed_s if order.submitted_s is None else order.submitted_s
            agv, station = order.items.get("agv", ""), order.items.get("station", "")
            builder.add(
                KitSubmission(
                    order.id,
                    at_s or 0.0,
                    agv=f"agv{agv}" if agv.isdigit() else "",
                    station=f"as{station}" if station.isdigit() else "",
                )
            )
    builder.defect(
        "unknown_submission_time", where, undated, "submissions are not dated; the end of the trial was taken"
    )


@dataclass
class _ParsedLog:
    """One file, parsed."""

    layout: str
    items: dict[str, str] = field(default_factory=dict)
    orders: list[OfficialOrder] = field(default_factory=list)
    printed_total: float | None = None
    completed_s: float | None = None
    lists_every_order: bool = False
    outcome_text: str = ""

    @property
    def outcome(self) -> str:
        return OUTCOMES[self.outcome_text][0] if self.outcome_text else ""

    @property
    def trial_id(self) -> str:
        return PurePosixPath(self.items.get("trial_file", "")).stem

    def official(self, source: str) -> OfficialResult:
        """The result; its total is the printed one, else the sum of the orders' scores."""
        scores = {order.id: order.score for order in self.orders if order.score is not None}
        total = self.printed_total
        # 2024 prints no total. Its scores carry no priority factor (log formats, section 5.1).
        if total is None and scores:
            total = 0.0
            for score in scores.values():
                total += score
        return OfficialResult(
            source=source,
            total=total,
            process_time_s=self.completed_s,
            orders=MappingProxyType(scores),
            outcome=self.outcome,
            summaries=tuple(self.orders),
            items=MappingProxyType(self.items),
        )


@dataclass(frozen=True)
class _Line:
    """One line: a title, or a label with its value."""

    number: int
    depth: int
    text: str
    label: str = ""
    value: str = ""

    @classmethod
    def of(cls, number: int, raw: str) -> _Line:
        text = raw.strip()
        depth = len(raw) - len(raw.lstrip("\t"))
        pair = _PAIR.match(text.lstrip("- "))
        if pair is None:
            return cls(number, depth, text)
        label = "_".join(re.sub(r"[^a-z0-9]+", " ", pair["label"].lower()).split())
        return cls(number, depth, text, label, pair["value"].strip())


class _Values:
    """Values by label with their lines, taken as what their label says they are."""

    def __init__(self, path: Path, about: str) -> None:
        self.path, self.about = path, about
        self._lines: dict[str, _Line] = {}

    def __contains__(self, label: str) -> bool:
        return label in self._lines

    def take(self, line: _Line, label: str = "") -> None:
        """Keep the first value of each label."""
        self._lines.setdefault(label or line.label, line)

    def printed(self) -> dict[str, str]:
        """Everything as printed, in the order of the file."""
        return {label: line.value for label, line in self._lines.items()}

    def text(self, label: str) -> str:
        """The value; empty when there is none."""
        return self._lines[label].value if label in self._lines else ""

    def number(self, *labels: str) -> float | None:
        """The number of the first label that is there; `None` for none and for `N/A`."""
        for label in labels:
            line = self._lines.get(label)
            if line is not None and line.value.upper() != "N/A":
                number = float(line.value) if _NUMBER.fullmatch(line.value) else math.nan
                if not math.isfinite(number):
                    raise self.fault(line, "is not a number")
                return number
        return None

    def time(self, *labels: str) -> float | None:
        """A number that is not negative."""
        number = self.number(*labels)
        if number is not None and number < 0:
            raise self.fault(next(self._lines[x] for x in labels if x in self._lines), "is before the start")
        return number

    def truth(self, label: str) -> bool | None:
        """Yes or no; `None` when there is none."""
        line = self._lines.get(label)
        if line is None:
            return None
        if line.value.lower() not in ("yes", "no"):
            raise self.fault(line, "is neither yes nor no")
        return line.value.lower() == "yes"

    def fault(self, line: _Line, cause: str) -> LogError:
        """What is wrong with a value."""
        words = f"{line.text.partition(':')[0].strip('- ')!r} of {self.about}: {line.value!r} {cause}"
        return LogError(words, file=self.path, place=f"line {line.number}", hint=_CUT)


def final_text(text: str, where: Path) -> OfficialResult:
    """The text of 2024 as the task manager prints it at the end, where no file of it is kept.

    Args:
        text: From its heading on.
        where: The topic, for error messages.

    Raises:
        LogError: It is cut off or contradicts itself.
    """
    lines = [_Line.of(number, raw) for number, raw in enumerate(text.splitlines(), start=1)]
    printed = [line for line in lines if line.text and not _RULE.fullmatch(line.text)]
    return _of_2024(where, printed).official(where.as_posix())


def _parse(path: Path) -> _ParsedLog:
    """The text of a file, parsed, whichever layout it has.

    Raises:
        NothingToScoreError: The file is missing or empty.
        LogError: It is none of the layouts, cut off, or contradicts itself.
    """
    text = _text(path)
    lines = [_Line.of(number, raw) for number, raw in enumerate(text.splitlines(), start=1)]
    printed = [line for line in lines if line.text and not _RULE.fullmatch(line.text)]
    if not printed:
        raise NothingToScoreError("the log is empty", file=path, hint="was the trial started?")
    if len(printed) == 1 and printed[0].text.lower() in OUTCOMES:
        return _ParsedLog("no score", outcome_text=printed[0].text.lower())
    titles = {line.text for line in printed if not line.label}
    if "Trial Summary" in titles:
        return _of_2024(path, printed)
    if "Orders Summary" in titles:
        return _interim(path, printed, whole=text.endswith("\n"))
    if "END OF TRIAL" in titles or printed[0].label == "order":
        return _of_2023(path, printed)
    raise LogError(
        "this is no score text of 2023 or 2024: it has neither a trial summary nor an end of trial",
        file=path,
        hint="expected are 'Trial Summary' (2024), 'END OF TRIAL' (2023) or a crash text",
    )


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise LogError(
                f"the file has more than {MAX_BYTES:,} bytes", file=path, hint="is this the right file?"
            )
        # Labels and numbers are ASCII: an odd byte elsewhere, as in a file name, need not hide a score.
        return _ANSI.sub("", path.read_text(encoding="utf-8-sig", errors="replace"))
    except FileNotFoundError:
        raise NothingToScoreError("no such file", file=path, hint="check the path") from None
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions"
        ) from cause


def _cut_off(path: Path, missing: str) -> LogError:
    return LogError(f"the log is cut off: {missing}", file=path, hint=_CUT)


# 2024 -----------------------------------------------------------------------------------


def _of_2024(path: Path, lines: Sequence[_Line]) -> _ParsedLog:
    trial = _Values(path, "the trial")
    summaries: dict[str, _Values] = {}
    details: dict[str, _Details] = {}
    section, order_id = "", ""
    for line in lines:
        if not line.label:
            section = line.text if line.text.endswith(("Summary", "Details")) else section
            # A box inside the details of an assembly, after which further orders may follow.
            section = "Order Details" if section == "Parts Summary" else section
        elif section == "Trial Summary":
            trial.take(line)
        elif line.label == "order_id":
            order_id = line.value
            if order_id in (details if section == "Order Details" else summaries):
                raise LogError(
                    f"order {order_id!r} is given twice", file=path, place=f"line {line.number}", hint=_CUT
                )
            if section == "Order Details":
                details[order_id] = _Details(path, order_id)
            else:
                summaries[order_id] = _Values(path, f"order {order_id}")
        elif section == "Order Summary" and order_id in summaries:
            summaries[order_id].take(line)
        elif section == "Order Details" and order_id in details:
            details[order_id].take(line)
    return _checked_2024(path, trial, summaries, details, has_details=section == "Order Details")


@dataclass
class _Details:
    """What is printed in detail about one order; quadrants and parts have their own paths."""

    path: Path
    id: str

    def __post_init__(self) -> None:
        self.values = _Values(self.path, f"order {self.id}")
        self.blocks: list[tuple[str, Sequence[str]]] = []
        self._inside, self._depth = "", 0

    def take(self, line: _Line) -> None:
        """Take one labelled line."""
        if line.label in ("quadrant", "part"):
            self._inside = f"{line.label}_{'_'.join(line.value.split())}"
            self._depth = line.depth
            self.blocks.append((self._inside, _OF_QUADRANT if line.label == "quadrant" else _OF_PART))
            return
        # Only fewer tabs show where a quadrant or part ends; a text that lost all its tabs shows nothing.
        if 0 < line.depth <= self._depth:
            self._inside = ""
        self.values.take(line, f"{self._inside}/{line.label}" if self._inside else line.label)

    @property
    def missing(self) -> str:
        """The first label that a submitted order must have and this one has not; empty when whole."""
        wanted = [*_OF_TASK, *(f"{block}/{label}" for block, labels in self.blocks for label in labels)]
        return next((label for label in wanted if label not in self.values), "") or self._half_a_value()

    def _half_a_value(self) -> str:
        """The last label, when its value is visibly not whole.

        A text that is cut in its last value still has every label.
        """
        for label, value in self.values.printed().items():
            last = label.rpartition("/")[2]
            if last in ("position", "orientation") and not _THREE.fullmatch(value):
                return label
            if (last.startswith("correct_") or last in _OF_QUADRANT[3:]) and value not in ("yes", "no"):
                return label
        return ""


def _checked_2024(
    path: Path,
    trial: _Values,
    summaries: Mapping[str, _Values],
    details: Mapping[str, _Details],
    *,
    has_details: bool,
) -> _ParsedLog:
    """The whole text, or what is missing of it."""
    for label in ("completion_time", "total_number_of_orders", "number_of_submitted_orders"):
        if label not in trial:
            raise _cut_off(path, f"the trial summary has no {label.replace('_', ' ')!r}")
    announced = trial.number("total_number_of_orders")
    for order_id, values in summaries.items():
        for label in _SUMMARY:
            if label not in values:
                raise _cut_off(path, f"the summary of order {order_id!r} has no {label.replace('_', ' ')!r}")
    if announced is not None and len(summaries) < announced:
        raise _cut_off(path, f"{announced:g} orders are announced, {len(summaries)} are listed")
    # More than announced is no cut: two texts in one file, or one that was edited.
    if announced is not None and len(summaries) > announced:
        raise LogError(
            f"{announced:g} orders are announced, {len(summaries)} are listed", file=path, hint=_CUT
        )
    # Below each order of the summary stand details, at least the words 'Not Submitted'.
    if summaries and not has_details:
        raise _cut_off(path, "there are no order details")
    orders = [_order_2024(path, order_id, values, details) for order_id, values in summaries.items()]
    log = _ParsedLog("2024", trial.printed(), orders, lists_every_order=True)
    log.completed_s = trial.time("completion_time")
    return log


def _order_2024(path: Path, order_id: str, values: _Values, details: Mapping[str, _Details]) -> OfficialOrder:
    submitted = values.truth("order_submitted")
    detail = details.get(order_id)
    if detail is None:
        raise _cut_off(path, f"there are no details of order {order_id!r}")
    if submitted and detail.missing:
        raise _cut_off(path, f"the details of order {order_id!r} have no {detail.missing!r}")
    submitted_s, duration_s = values.time("submission_time"), values.time("submission_duration")
    return OfficialOrder(
        id=order_id,
        kind=values.text("order_type"),
        submitted=submitted,
        priority=values.truth("priority"),
        score=values.number("actual_task_score"),
        max_score=values.number("max_task_score"),
        announced_s=_announced_s(path, order_id, submitted_s, duration_s),
        submitted_s=submitted_s,
        items=MappingProxyType(detail.values.printed() | _printed_times(values)),
    )


def _printed_times(values: _Values) -> dict[str, str]:
    """When an order was handed in and how long it took, as printed, with six decimals."""
    printed = {label: values.text(label) for label in ("submission_time", "submission_duration")}
    return {label: text for label, text in printed.items() if text.upper() != "N/A"}


def _announced_s(
    path: Path, order_id: str, submitted_s: float | None, duration_s: float | None
) -> float | None:
    """When an order was announced: its submission less the time it took, which is what is printed.

    Both are printed with six decimals, so an order announced at the start may come out a little before it.
    """
    if submitted_s is None or duration_s is None:
        return None
    announced_s = round(submitted_s - duration_s, _DECIMALS)
    if announced_s < -(10.0**-_DECIMALS):
        raise LogError(
            f"order {order_id!r} took {duration_s:g} s, more than from the start to its submission",
            file=path,
            hint="time cannot be negative; compare with the original log",
        )
    return max(announced_s, 0.0)


# 2023 -----------------------------------------------------------------------------------


def _of_2023(path: Path, lines: Sequence[_Line]) -> _ParsedLog:
    """The layout at release: a block for each kit handed in, then the end of the trial."""
    end = next((i for i, line in enumerate(lines) if line.text == "END OF TRIAL"), None)
    if end is None:
        raise _cut_off(path, "there is no end of the trial")
    blocks = _blocks(path, lines[:end], "order")
    trial = _Values(path, "the trial")
    listed = next((i for i, line in enumerate(lines) if i > end and line.text.rstrip(":") == "ORDERS"), None)
    for line in lines[end:listed]:
        if line.label:
            trial.take(line)
    for label in ("trial_completion_time", "trial_score"):
        if label not in trial:
            raise _cut_off(path, f"the end of the trial has no {label.replace('_', ' ')!r}")
    # As coded only the last order of each kind is listed here: no score or time is taken from it.
    heading = "orders"
    for line in lines[listed:] if listed is not None else ():
        if line.label:
            trial.take(line, f"{heading}/{line.label}")
        elif line.text.rstrip(":") != "ORDERS":
            heading = f"orders/{'_'.join(line.text.lower().split())}"
    log = _ParsedLog("2023", trial.printed(), [_kit_2023(order_id, v) for order_id, v in blocks.items()])
    log.printed_total = trial.number("trial_score")
    log.completed_s = trial.time("trial_completion_time")
    return log


def _kit_2023(order_id: str, values: _Values) -> OfficialOrder:
    """A kit handed in; when, the layout at release does not say."""
    return OfficialOrder(
        id=order_id,
        kind=values.text("type").lower(),
        submitted=True,
        score=values.number("score"),
        items=MappingProxyType(values.printed()),
    )


def _blocks(path: Path, lines: Iterable[_Line], first: str) -> dict[str, _Values]:
    """The labelled lines of each order, which a line with the label `first` begins."""
    blocks: dict[str, _Values] = {}
    order_id = inside = ""
    for line in lines:
        if line.label == first:
            order_id, inside = line.value, ""
            if order_id in blocks:
                raise LogError(
                    f"order {order_id!r} is given twice", file=path, place=f"line {line.number}", hint=_CUT
                )
            blocks[order_id] = _Values(path, f"order {order_id}")
        elif line.label == "quadrant":
            inside = f"quadrant_{line.value}/"
        elif line.label and order_id:
            # Quadrant 1 says 'Faulty part' and 'Flipped part', the others 'Faulty' and 'Flipped'.
            label = {"faulty": "faulty_part", "flipped": "flipped_part", "quadrant_score": "score"}.get(
                line.label, line.label
            )
            blocks[order_id].take(line, inside + (label if inside else line.label))
    return blocks


def _interim(path: Path, lines: Sequence[_Line], *, whole: bool) -> _ParsedLog:
    """The layout of December 2023: every label begins with a dash, every order has its times."""
    # This layout has no end mark, and a time looks whole wherever it is cut.
    if not whole:
        raise _cut_off(path, "its last line has no end")
    begin = next(i for i, line in enumerate(lines) if line.text == "Orders Summary")
    trial = _Values(path, "the trial")
    for line in lines[:begin]:
        if line.label:
            trial.take(line)
    blocks = _blocks(path, lines[begin:], "order_id")
    if not blocks:
        raise _cut_off(path, "no order is listed")
    log = _ParsedLog("2023, interim", trial.printed(), [_order_interim(k, v) for k, v in blocks.items()])
    log.printed_total = trial.number("trial_score", "total_score")
    # Not the completion times of the orders: each counts from the announcement of its order.
    log.completed_s = trial.time("trial_completion_time", "completion_time")
    return log


def _order_interim(order_id: str, values: _Values) -> OfficialOrder:
    submitted_s = values.time("submission_time")
    return OfficialOrder(
        id=order_id,
        kind=values.text("type").lower(),
        submitted=True if submitted_s is not None else None,
        score=values.number("actual_score", "score", "order_score", "total_score"),
        max_score=values.number("max_score"),
        announced_s=values.time("announcement_time", "announced_time"),
        submitted_s=submitted_s,
        items=MappingProxyType(values.printed()),
    )
