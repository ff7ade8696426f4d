"""Reading `performance.log`, the text the ARIAC simulator of 2017 to 2022 printed.

Its records carry wall-clock time only. `Sim time: <n>` is printed once per simulated
second, and between two of these the simulator is taken to run at an even pace. On the
real log of 2022 that places the start of the competition 10 ms from where the wall
times of `state.log` put it, and 14.869 s from start to end where the official
process time is 14.852 s. So times from this file are good to about 0.02 s while the
simulator keeps a steady pace, and never worse than the simulated second they fall
in. The official process time is passed on as printed and corrects nothing: it says
how long the trial was, not when it began.

Source: ARIAC notes on log formats, section 3; task manager plug-ins of 2017 to 2022.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ariac_score import (
    ARM_COLLISION,
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    LARGEST_STEP_BACK_S,
    ORDER_ANNOUNCED,
    PART_DROPPED,
    Clock,
    Event,
    LogDefect,
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

__all__ = ["PerformanceLogReader", "printed_score"]

CLOCK = Clock("simulated time", detail="wall time between whole simulated seconds")
MAX_LINE_CHARS = 65_536
MAX_DROPS = 10_000
"""No trial has as many products; each drop becomes an event."""

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
"""2022 prints some labels and values in colour."""
_GAZEBO_RECORD = re.compile(
    r"^\((?P<s>\d{1,9}|[0-8]\d{9}) (?P<ns>\d{1,9})\) "  # as ns they fit 64 bits
    r"(?:\[(?:Msg|Wrn|Err|Dbg)\] )?(?:\[[^\]\s]+:\d+\] ?)?(?P<text>.*)$"
)
_ROS_RECORD = re.compile(r"^\[ ?[A-Z]+\] \[\d+\.\d+(?:, (?P<sim>\d{1,9}\.\d+))?\]: (?P<text>.*)$")
_NUMBER = r"-?\d{1,30}(?:\.\d{1,30})?(?:e[+-]?\d{1,2})?"  # finite, whatever stands there
_SIM_TIME = re.compile(rf"^Sim time: ({_NUMBER})$")
_STARTED = re.compile(r"^(?:\[Service Call\] Start Competition|Handle start service called)")
_ENDED = re.compile(r"^(?:\[Service Call\] End Competition|Handle end service called)")
_ANNOUNCED = re.compile(r"^(?:-Order ID|New order to announce|Order to update): *(\S+)")
_DROPPED = re.compile(r"^(?:Dropped Parts|Penalty Applied): *(\d{1,6})$")
"""Words of 2021 and of 2022; each prints the running count, not one more."""
_SUBMITTED = re.compile(r"submi(?:t|ssion)", re.IGNORECASE)
_CONFIGURATION = re.compile(r"^-?(?:Configuration )?File: *(\S+)$")
_FINAL_SCORE = re.compile(rf"^(?:End of trial\. )?Final score: *({_NUMBER})$", re.IGNORECASE)
_BREAKDOWN = re.compile(r"^(?:Score breakdown:|<game_score>|\[(?:game|trial)_score\])$", re.IGNORECASE)
# `<order_score order_0>` until 2020, `[order score]` in 2021, `Order Score` in 2022.
_HEADING = re.compile(
    r"^[<\[]?(?P<what>game|trial|order|kitting|assembly|shipment|tray)(?:[ _]shipment)?[ _]score"
    r"(?: (?P<id>[^\s>\]]*))?[>\]]?$",
    re.IGNORECASE,
)
_VALUE = re.compile(r"^(?P<label>[^\[]*[^\[\s:=])\s*(?:[:=]\s*)?\[(?P<value>[^\]]*)\]$")
_UPDATE = re.compile(r"_update_\d+$")
"""What follows the name of the order in the name of its update."""


class PerformanceLogReader:
    """Reads what the simulator printed: events, the official result, what was certainly not submitted.

    Reads:
        Start and end, announcements, collisions and dropped parts with their simulated
        time, and the scores as printed.
    Refuses:
        An empty text, and one whose simulated time runs backwards: it holds two runs.
    Source:
        ARIAC notes on log formats, section 3; task manager plug-ins of 2017 to 2022.
    """

    facts = ReaderFacts(role="official", a_file="an official result", formats="performance.log of ARIAC")

    def can_read(self, path: Path) -> bool:
        """Whether it is a Gazebo log or a printed score; ROS logs that repeat one are not."""
        try:
            if path.suffix not in (".log", ".txt", "") or not path.is_file():
                return False
            with path.open("rb") as file:
                head = file.read(65_536)
        except OSError:
            return False
        # An empty one is known by its name, so that the message is about it, and not about an unknown file.
        if not head:
            return path.name == "performance.log"
        return b"\0" not in head and _looks_printed(head.decode("utf-8", "replace"))

    def describe(self, path: Path) -> LogDescription:
        """The official numbers, and in which year's layout they are printed."""
        try:
            log = _read_text(path)
            times = _Times(log, path)
            damage = ""
        except LogError as error:
            return LogDescription(format="ARIAC performance log", clock=str(CLOCK), damage=str(error))
        score = log.score
        facts: dict[str, int | float | str] = {"layout": score.layout if score else "no final score"}
        if score is not None and score.total is not None:
            facts["final_score"] = score.total
        if score is not None and score.process_time_s is not None:
            facts["process_time_s"] = score.process_time_s
        if score is not None:
            facts["orders"] = len(score.orders)
        for name, t_s in (("started_s", times.started_s), ("ended_s", times.ended_s)):
            if t_s is not None:
                facts[name] = t_s
        start_s, end_s = times.started_s, times.ended_s
        return LogDescription(
            format="ARIAC performance log",
            clock=str(CLOCK),
            facts=facts,
            defects=tuple(times.defects),
            damage=damage,
            duration_s=end_s - start_s if start_s is not None and end_s is not None else 0.0,
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """Events, the official result, and the submissions that the final score lists.

        The text never shows what a shipment held: submissions come without contents,
        so that whatever depends on them stays undecided.

        Raises:
            NothingToScoreError: The file is missing or empty.
            LogError: Simulated time runs backwards: two runs in one file.
        """
        log = _read_text(path)
        wanted.progress(1.0)
        times = _Times(log, path)
        builder = TrialBuilder(log.trial_id or path.stem, file=path, clock=CLOCK)
        for defect in times.defects:
            builder.defect(defect.kind, defect.where, defect.count, defect.message)
        builder.events.extend(times.events())
        if log.score is not None:
            _add_score(builder, log, log.score, times, path)
        return builder.build()


def _looks_printed(head: str) -> bool:
    lines = [_COLOUR.sub("", line).strip() for line in head.splitlines() if line.strip()]
    if not lines:
        return False
    if re.match(r"^\d+\.\d+ +(?:Node Startup|[A-Z]+ /)", lines[0]):
        return False  # rosout.log, which repeats the simulator's text
    if lines[0].startswith("Gazebo multi-robot simulator"):
        return True
    return any(
        _GAZEBO_RECORD.match(line) or _BREAKDOWN.match(line) or _FINAL_SCORE.match(_Line.of(line).text)
        for line in lines
    )


@dataclass(frozen=True)
class _Line:
    """One line: what it says, and the time of the record it begins, if it begins one."""

    text: str
    begins: bool = False
    wall_ns: int | None = None
    sim_s: float | None = None

    @classmethod
    def of(cls, raw: str) -> _Line:
        gazebo = _GAZEBO_RECORD.match(raw)
        if gazebo:
            # The nanoseconds are a plain number, not a padded fraction.
            wall_ns = int(gazebo["s"]) * 10**9 + int(gazebo["ns"])
            return cls(gazebo["text"].strip(), True, wall_ns)
        ros = _ROS_RECORD.match(raw)
        if ros:
            return cls(ros["text"].strip(), True, None, float(ros["sim"]) if ros["sim"] else None)
        return cls(raw.strip())


@dataclass(frozen=True)
class _Moment:
    """When something was printed: by wall clock, or by simulated time where a ROS record gives it."""

    wall_ns: int | None = None
    sim_s: float | None = None


@dataclass
class _Shipment:
    """One shipment as scored."""

    id: str
    values: dict[str, str] = field(default_factory=dict)

    @property
    def submitted(self) -> bool:
        return "true" in (self.values.get("submitted"), self.values.get("shipped"))


@dataclass
class _OrderScore:
    """One order as scored."""

    id: str
    values: dict[str, str] = field(default_factory=dict)
    shipments: list[_Shipment] = field(default_factory=list)

    @property
    def total(self) -> float | None:
        return _number(self.values, "total order score", "total score")

    @property
    def all_submitted(self) -> bool:
        return bool(self.shipments) and all(s.submitted for s in self.shipments)

    def task_id(self, position: int) -> str:
        """The shipment type; where 2019 and 2020 print none, by its alphabetical place."""
        printed = self.shipments[position].id
        if printed:
            return printed
        return sorted(f"{self.id}_shipment_{k}" for k in range(len(self.shipments)))[position]


@dataclass
class _Score:
    """A final score as printed."""

    at: _Moment
    printed: float | None = None
    values: dict[str, str] = field(default_factory=dict)
    orders: list[_OrderScore] = field(default_factory=list)
    headings: set[str] = field(default_factory=set)
    ended: bool = False

    @property
    def total(self) -> float | None:
        if self.printed is not None:
            return self.printed
        # Until March 2021; from then on; 2017, which has also the first.
        return _number(self.values, "total game score", "total trial score", "total score")

    @property
    def process_time_s(self) -> float | None:
        return _number(self.values, "total process time")

    @property
    def collision(self) -> float | None:
        # From 2020 on; 2019. Earlier editions print no such line, and so witness none.
        return _number(self.values, "arms collision", "was arm/arm collision")

    @property
    def dropped(self) -> float | None:
        return _number(self.values, "dropped part penalty")

    @property
    def complete(self) -> bool:
        """Whether nothing of it can be missing: all parts are there and something follows it."""
        parts = self.total is not None and self.process_time_s is not None and bool(self.orders)
        return parts and self.ended and all(order.total is not None for order in self.orders)

    @property
    def layout(self) -> str:
        """The year whose layout this is; 2018 has no priorities to print, 2019 and 2020 look alike."""
        if "tray" in self.headings:
            return "2017"
        if "game_tag" in self.headings:
            return "2019-2020" if any("priority" in o.values for o in self.orders) else "2018"
        return "2021" if "bracket" in self.headings else "2022"

    def take(self, text: str) -> None:
        """Take one line of the breakdown; unknown ones are passed over."""
        heading = _HEADING.match(text)
        if heading:
            self._take_heading(text, heading)
            return
        if text == "</game_score>":
            self.ended = True
            return
        value = _VALUE.match(text.lstrip(". "))
        if value:
            self._take_value(_label(value["label"]), value["value"].strip())

    def _take_heading(self, text: str, heading: re.Match[str]) -> None:
        what, name = heading["what"].lower(), heading["id"] or ""
        if what in ("game", "trial"):
            self.headings.add("game_tag" if text.startswith("<") else "bracket")
        elif what == "order":
            self.orders.append(_OrderScore(name))
        elif self.orders:
            self.headings.add(what)
            self.orders[-1].shipments.append(_Shipment(name))

    def _take_value(self, label: str, value: str) -> None:
        # From 2021 on the heading has no name: a line below it has, and may also stand without a heading.
        if label == "order id":
            if not self.orders or self.orders[-1].id:
                self.orders.append(_OrderScore(""))
            self.orders[-1].id = value
        elif label == "shipment type" and self.orders:
            shipments = self.orders[-1].shipments
            if not shipments or shipments[-1].id:
                shipments.append(_Shipment(""))
            shipments[-1].id = value
        else:
            self._open_values().setdefault(label, value)

    def _open_values(self) -> dict[str, str]:
        if not self.orders:
            return self.values
        order = self.orders[-1]
        return order.shipments[-1].values if order.shipments else order.values


def _label(words: str) -> str:
    """A label up to its colon, in one spelling.

    >>> _label("arms collision?"), _label("total order score = completion score x priority")
    ('arms collision', 'total order score')
    """
    return re.split(r"[:=?]", words, maxsplit=1)[0].strip().lower()


def _number(values: dict[str, str], *labels: str) -> float | None:
    for label in labels:
        if re.fullmatch(_NUMBER, values.get(label, "")):
            return float(values[label])
    return None


@dataclass
class _ParsedLog:
    """One file, parsed, with the moments as printed."""

    pace: list[tuple[int, float]] = field(default_factory=list)
    started: _Moment | None = None
    ended: _Moment | None = None
    announced: dict[str, _Moment] = field(default_factory=dict)
    dropped: list[tuple[int, _Moment]] = field(default_factory=list)
    submits: int = 0
    trial_id: str = ""
    score: _Score | None = None


def _read_text(path: Path) -> _ParsedLog:
    try:
        if not path.stat().st_size:
            raise NothingToScoreError("the log is empty", file=path, hint="was the simulator started?")
        return _parsed(map(_Line.of, _lines(path)))
    except FileNotFoundError:
        raise NothingToScoreError("no such file", file=path, hint="check the path") from None
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions"
        ) from cause


def _parsed(lines: Iterable[_Line]) -> _ParsedLog:
    log, now, score = _ParsedLog(), _Moment(), None
    for line in lines:
        if line.begins:
            now = _Moment(line.wall_ns, line.sim_s)
            if score is not None:
                score.ended = True
            score = None
        score = _begin_score(log, score, line, now)
        if score is not None:
            score.take(line.text)
            _take_configuration(log, line.text)
        else:
            _take_line(log, line.text, now)
    return log


def printed_score(said: Iterable[tuple[float, str]], where: Path) -> Trial | None:
    """What the simulator printed of a run that it scored, out of the lines of its console.

    Args:
        said: When each message was printed, s of trial time, and its text, which may have several lines.
        where: The topic, for error messages.

    Returns:
        The official result and what follows from it; `None` where no final score is printed.
    """
    log = _parsed(
        _Line(_COLOUR.sub("", text).strip(), not i, None, None if i else t_s)
        for t_s, message in said
        for i, text in enumerate(message.splitlines())
    )
    if log.score is None:
        return None
    builder = TrialBuilder(log.trial_id or where.name, file=where, clock=None)
    times = _Times(log, where)
    builder.events.extend(times.events())
    _add_score(builder, log, log.score, times, where)
    return builder.build()


def _lines(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", errors="replace") as file:
        while line := file.readline(MAX_LINE_CHARS):
            words = _COLOUR.sub("", line).rstrip("\r\n")
            # A number at a cut, `Sim time: 1` of 15, would be another number.
            if line.endswith("\n") or len(line) == MAX_LINE_CHARS or words.endswith(("]", ">")):
                yield words


def _begin_score(log: _ParsedLog, score: _Score | None, line: _Line, now: _Moment) -> _Score | None:
    """The score a line belongs to: the open one, a new one it begins, or none.

    The last one in the file is the final one; earlier ones are running scores.
    """
    final = _FINAL_SCORE.match(line.text)
    if final or (score is None and _BREAKDOWN.match(line.text)):
        score = log.score = _Score(now, float(final[1]) if final else None)
    return score


def _take_configuration(log: _ParsedLog, text: str) -> None:
    found = _CONFIGURATION.match(text)
    if found:
        log.trial_id = Path(found[1]).stem


def _take_line(log: _ParsedLog, text: str, now: _Moment) -> None:
    sim_time = _SIM_TIME.match(text)
    if sim_time:
        if now.wall_ns is not None:
            log.pace.append((now.wall_ns, float(sim_time[1])))
        return
    announced, dropped = _ANNOUNCED.match(text), _DROPPED.match(text)
    if announced:
        log.announced.setdefault(announced[1], now)
    elif dropped:
        log.dropped.append((int(dropped[1]), now))
    elif _STARTED.match(text):
        log.started = log.started or now
    elif _ENDED.match(text):
        log.ended = log.ended or now
    elif _SUBMITTED.search(text):
        log.submits += 1
    else:
        _take_configuration(log, text)


class _Times:
    """Puts the moments of a log on the clock of the simulation."""

    def __init__(self, log: _ParsedLog, path: Path) -> None:
        self.log, self.where = log, path.name
        self.defects: list[LogDefect] = []
        self._wall_ns, self._sim_s = self._pace(path)
        # The final score is printed when the trial ends, also by its time limit, which calls no service.
        ended = log.ended or (log.score.at if log.score is not None else None)
        self.started_s = self.of(log.started)
        self.ended_s = self.of(ended)
        self._count_untimed()

    def of(self, moment: _Moment | None) -> float | None:
        """A moment in s of simulated time; `None` when the log does not allow to say.

        Beyond the first and last whole second the pace of the neighbouring second goes on.
        """
        if moment is None or moment.sim_s is not None:
            return None if moment is None else moment.sim_s
        if moment.wall_ns is None or len(self._wall_ns) < 2:
            return None
        after = int(np.searchsorted(self._wall_ns, moment.wall_ns).clip(1, len(self._wall_ns) - 1))
        wall_ns, past_wall_ns = int(self._wall_ns[after - 1]), int(self._wall_ns[after])
        sim_s, past_sim_s = float(self._sim_s[after - 1]), float(self._sim_s[after])
        share = (moment.wall_ns - wall_ns) / (past_wall_ns - wall_ns)
        return sim_s + share * (past_sim_s - sim_s)

    def announced_s(self, order_id: str) -> float | None:
        """When an order, or the last update of it, was announced."""
        times = [
            self.of(moment)
            for name, moment in self.log.announced.items()
            if _UPDATE.sub("", name) == order_id
        ]
        known = [t_s for t_s in times if t_s is not None]
        return max(known) if known else None

    def events(self) -> Iterator[Event]:
        """The events whose time the log gives."""
        if self.started_s is not None:
            yield Event(self.started_s, COMPETITION_STARTED)
        if self.ended_s is not None:
            yield Event(self.ended_s, COMPETITION_ENDED)
        for order_id, moment in self.log.announced.items():
            t_s = self.of(moment)
            if t_s is not None:
                yield Event(t_s, ORDER_ANNOUNCED, order_id)

    def _pace(self, path: Path) -> tuple[NDArray[np.int64], list[float]]:
        """Wall and simulated time where both are known, both strictly increasing."""
        kept: list[tuple[int, float]] = []
        for wall_ns, sim_s in self.log.pace:
            if kept and kept[-1][1] - sim_s > LARGEST_STEP_BACK_S:
                raise LogError(
                    f"simulated time runs backwards, from {kept[-1][1]:g} s to {sim_s:g} s",
                    file=path,
                    hint="the file holds two runs (or a reset simulation): score them one by one",
                )
            if not kept or (wall_ns > kept[-1][0] and sim_s > kept[-1][1]):
                kept.append((wall_ns, sim_s))
        self._count("disordered_stamps", len(self.log.pace) - len(kept), "simulated seconds out of order")
        return np.array([wall for wall, _ in kept], dtype=np.int64), [sim for _, sim in kept]

    def _count_untimed(self) -> None:
        moments = [self.log.started, self.log.ended, *self.log.announced.values()]
        lost = sum(1 for moment in moments if moment is not None and self.of(moment) is None)
        self._count("untimed_events", lost, "events were left out: too few simulated seconds are printed")

    def _count(self, kind: str, count: int, message: str) -> None:
        if count:
            self.defects.append(LogDefect(kind, self.where, count, message))


def _add_score(builder: TrialBuilder, log: _ParsedLog, score: _Score, times: _Times, path: Path) -> None:
    where = path.name
    totals = {order.id: order.total for order in score.orders if order.id and order.total is not None}
    builder.official = OfficialResult(
        source=where,
        total=score.total,
        process_time_s=score.process_time_s,
        orders=MappingProxyType({k: v for k, v in totals.items() if v is not None}),
        summaries=tuple(_summary(order, times) for order in score.orders if order.id),
        items=_printed(score.values),
    )
    if not score.complete:
        builder.defect("cut_off", where, 1, "the final score is not followed by anything: it may be cut off")
    end_s, end_words = _end_of(score, times)
    if score.collision is not None:
        builder.witnessed.add(ARM_COLLISION)
        if score.collision:
            # The breakdown says that arms collided, and no record says when.
            builder.events.append(
                Event(end_s, ARM_COLLISION, "", f"at an unknown time; {end_words} is given")
            )
    if score.dropped is not None:
        builder.witnessed.add(PART_DROPPED)
        if score.dropped > MAX_DROPS:
            raise LogError(
                f"it prints {score.dropped:g} dropped products, more than {MAX_DROPS:,}",
                file=path,
                hint="the text looks damaged; compare it with the log of the simulator",
            )
        builder.events.extend(_drops(int(score.dropped), log, times, end_s))
    _add_submissions(builder, score, times, where)
    # From 2021 on shipments of a kind are scored only once one of them was handed in. So a score without any
    # shows that none was, unless some record mentions a submission.
    if score.complete and not log.submits and not any(order.shipments for order in score.orders):
        builder.witnessed.add("submissions")


def _summary(order: _OrderScore, times: _Times) -> OfficialOrder:
    """What is printed of an order; shipments by number, for some layouts leave them nameless."""
    announced_s = times.announced_s(order.id)
    taken_s = _number(order.values, "time taken")
    items = dict(_printed(order.values))
    for position, shipment in enumerate(order.shipments):
        items[f"shipment_{position}/id"] = order.task_id(position)
        for label, value in _printed(shipment.values).items():
            items[f"shipment_{position}/{label}"] = value
    # A time of 0 is printed for an order that is not complete.
    dated = announced_s is not None and taken_s and order.all_submitted
    return OfficialOrder(
        order.id,
        submitted=order.all_submitted,
        score=_number(order.values, "completion score", "total order score", "total score"),
        announced_s=announced_s,
        submitted_s=announced_s + taken_s if dated and announced_s is not None and taken_s else None,
        items=MappingProxyType(items),
    )


def _printed(values: Mapping[str, str]) -> Mapping[str, str]:
    """Values as printed, by label in one word: `total_order_score`, `2pts_x_nb_of_products_with_ct_cp`."""
    return MappingProxyType(
        {"_".join(re.sub(r"[^a-z0-9]+", " ", label).split()): value for label, value in values.items()}
    )


def _end_of(score: _Score, times: _Times) -> tuple[float, str]:
    """A time for what the text does not date, and what it is in words."""
    if times.ended_s is not None:
        return times.ended_s, "the end of the trial"
    if score.process_time_s is not None:
        return score.process_time_s, "the printed process time"
    return 0.0, "0"


def _drops(count: int, log: _ParsedLog, times: _Times, end_s: float) -> Iterator[Event]:
    """As many drops as the official score counts, dated where a record dates them."""
    dated: list[float] = []
    # Counts are running ones: each record dates as many drops as it counts beyond the one before.
    for running, moment in log.dropped:
        t_s = times.of(moment)
        dated += [end_s if t_s is None else t_s] * max(0, min(running, count) - len(dated))
    for i in range(count):
        yield Event(dated[i] if i < len(dated) else end_s, PART_DROPPED, "", f"product {i + 1} of {count}")


def _add_submissions(builder: TrialBuilder, score: _Score, times: _Times, where: str) -> None:
    guessed = 0
    end_s, end_words = _end_of(score, times)
    for order in score.orders:
        at_s, exact = _submitted_s(order, times)
        for position, shipment in enumerate(order.shipments):
            if shipment.submitted:
                builder.add(KitSubmission(order.task_id(position), end_s if at_s is None else at_s))
                guessed += not exact
    builder.defect(
        "unknown_submission_time",
        where,
        guessed,
        f"submissions are not dated; the order's last submission or {end_words} was taken",
    )


def _submitted_s(order: _OrderScore, times: _Times) -> tuple[float | None, bool]:
    """When an order's last shipment came, and whether that dates all of them.

    Source: scorers 2019 to 2022: time taken is the latest counted submission less the
    start of the order, and 0 while a shipment is missing.
    """
    announced_s, taken_s = times.announced_s(order.id), _number(order.values, "time taken")
    if announced_s is None or not taken_s or not order.all_submitted:
        return None, False
    return announced_s + taken_s, len(order.shipments) == 1
