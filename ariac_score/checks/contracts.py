"""The contracts of plugins, kept by structure, not by inheritance.

A plugin is a class. Rules and monitors are built with the `with:` block of a rule
set as keyword arguments, called, and forgotten; readers and decoders are built
without arguments. Calls are pure: same trial, same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.documents.schema import refuse_no_schema
from ariac_score.trial.channels import LogMap
from ariac_score.trial.chart import Chart
from ariac_score.trial.derive import DerivedSignal
from ariac_score.trial.events import Event
from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.signals import Sample
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.tracks import ModelTrack
from ariac_score.trial.vocabulary import Quantity
from ariac_score.trial.work import Record, Submission, WorkItem

__all__ = [
    "GROUPS",
    "OTHER_GROUPS",
    "VALUE_GROUPS",
    "Charting",
    "Competition",
    "Decoded",
    "Decoder",
    "EventMonitor",
    "EventWatch",
    "FactSchemas",
    "HoldsRuns",
    "InstantVerdict",
    "Likeness",
    "Likening",
    "LogDescription",
    "Margined",
    "Monitor",
    "OnlineMonitor",
    "OnlineWatch",
    "Reader",
    "ReaderFacts",
    "RecordKind",
    "ReportPanel",
    "Resolving",
    "Rule",
    "SignalNeed",
    "TopicDescription",
    "TrackReader",
    "Wanted",
    "reader_facts",
]


@dataclass(frozen=True)
class SignalNeed:
    """A kind of signal a monitor reads, for every body or pair it exists for.

    Attributes:
        quantity: Such as `centre_distance`; see `ariac_score.trial.vocabulary`.
        unit: The unit it is read in.
        max_gap_s: Longest stretch between two samples the monitor accepts, s.
        optional: Whether it only helps: a log without it is judged all the same.
        pair: Of a quantity of pairs whose it is: kinds in braces or ids of bodies, such as
            `{vehicle}/{pedestrian}`. Empty: of every robot and human, some quantities of every two bodies.
    """

    quantity: str
    unit: str
    max_gap_s: float = 0.05
    optional: bool = False
    pair: str = ""


@runtime_checkable
class Rule(Protocol):
    """Judges a work item: entry-point group `ariac_score.rules`.

    It is asked about every outermost item, or about those of the level that a class attribute
    `level` names. It may name the competition's own class of items as the type of `item`.

    A rule that rests on the official result alone says so with a class attribute
    `reads_official = True`; only such rules judge an item of which nothing but its
    official score is known (it has an attribute `outline` that is true).
    """

    def judge(self, trial: Trial, item: Any, /) -> Iterable[Finding]:
        """Findings about one item; at least one, for silence is not a verdict."""
        ...


@runtime_checkable
class Monitor(Protocol):
    """Watches the signals of a trial: entry-point group `ariac_score.monitors`."""

    def needs(self) -> Iterable[SignalNeed]:
        """The signals it reads, so that a reader decodes these and nothing else."""
        ...

    def watch(self, trial: Trial) -> Iterable[Finding]:
        """Findings about the trial; at least one, for silence is not a verdict."""
        ...


@dataclass(frozen=True)
class InstantVerdict:
    """The verdict of a monitor about one instant, given as soon as it is certain.

    Attributes:
        subject: As in its findings.
        t_s: The instant it is about, s of trial time; earlier than the newest sample
            where a monitor has to wait for later ones.
        verdict: What holds there.
        message: One sentence for people, without full stop.
        robustness: Signed margin in `unit`, negative when violated; `None` without one.
        unit: Unit of the robustness.
        final: Whether no later sample can change it.
    """

    subject: str
    t_s: float
    verdict: Verdict
    message: str
    robustness: float | None = None
    unit: str = ""
    final: bool = False


class OnlineWatch(Protocol):
    """One trial, watched while it goes on; made by an `OnlineMonitor`, used once.

    A watch that can give no verdict before the end of this trial says why in an
    attribute `undecided`; where that is absent or empty, it gives verdicts.
    """

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterable[InstantVerdict]:
        """Take new samples and events, and give the verdicts that are certain now.

        The cost of a step does not grow with what came before. Every instant gets one
        verdict, in order of time for each subject. What cannot be decided before the
        trial is over is left to `end`.

        Args:
            samples: Of the signals the monitor needs.
            events: New events, such as submissions.

        Raises:
            ValueError: The times of a signal do not increase.
        """
        ...

    def end(self, trial: Trial) -> Iterable[Finding]:
        """The findings: those `watch` gives for the same samples, to the bit.

        Args:
            trial: Everything but the signals: bodies, events, start and end.
        """
        ...


@runtime_checkable
class OnlineMonitor(Protocol):
    """A monitor that can also watch a trial while it goes on.

    A class that has `begin` is held to it by the contract checks: stepped through a recording,
    one sample at a time or many, it finds what it finds in the whole log.
    """

    def needs(self) -> Iterable[SignalNeed]:
        """Like those of a `Monitor`; the watch gets samples of these signals."""
        ...

    def watch(self, trial: Trial) -> Iterable[Finding]:
        """Like that of a `Monitor`."""
        ...

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch for one trial; the monitor itself stays as it is.

        Args:
            bodies: Those known beforehand; others are known only once their signals come.
        """
        ...


@runtime_checkable
class Charting(Protocol):
    """A monitor that also shows what it judged: the measured number and its limit over time."""

    def charts(self, trial: Trial) -> Iterable[Chart]:
        """A chart for each subject that can be drawn; decides nothing."""
        ...


@runtime_checkable
class Margined(Protocol):
    """A monitor that gives its margin at every sample it judged.

    A class that has `margins` is held to it by the contract checks: they stand at times of
    samples, and the least one within the span of a violation (of a subject without any: the
    least of all) is the robustness of the finding.
    """

    def margins(self, trial: Trial) -> Iterable[Chart]:
        """The measured number and its limit, for each subject and limit; NaN where no limit applies."""
        ...


@runtime_checkable
class Resolving(Protocol):
    """A plugin with parameters whose values follow from others, such as those of a profile."""

    def resolved(self) -> Mapping[str, object]:
        """The value in force, by name of the parameter; decides nothing."""
        ...


class EventWatch(Protocol):
    """One trace, judged event by event; made by an `EventMonitor`, used once."""

    def take(self, event: Mapping[str, object]) -> InstantVerdict:
        """Judge the trace up to and including an event, given as its recorder wrote it.

        Raises:
            ValueError: The event cannot be judged; the trace stands as before.
        """
        ...


@runtime_checkable
class EventMonitor(Protocol):
    """A monitor that judges recorded events as they are, without a log map."""

    def begin_events(self) -> EventWatch:
        """A watch for one trace."""
        ...


@dataclass(frozen=True)
class TopicDescription:
    """What a recording holds on one topic (or about one model).

    Attributes:
        name: Topic.
        type: Message type.
        count: Messages.
        first_s: First stamp, s of trial time; `None` when there is none.
        last_s: Last stamp, s of trial time.
        largest_gap_s: Longest time between two messages, s.
    """

    name: str
    type: str
    count: int
    first_s: float | None = None
    last_s: float | None = None
    largest_gap_s: float | None = None

    @property
    def rate_hz(self) -> float | None:
        """Mean rate, Hz; `None` with fewer than two messages."""
        if self.count < 2 or self.first_s is None or self.last_s is None or self.last_s <= self.first_s:
            return None
        return (self.count - 1) / (self.last_s - self.first_s)


@dataclass(frozen=True)
class LogDescription:
    """What a log holds, found without judging anything.

    Attributes:
        format: In words, such as `ROS 2 bag (MCAP)`.
        topics: Sorted by name.
        clock: Which clock the stamps come from, in words.
        facts: Further numbers and words by name, such as `states`.
        defects: What is wrong with it.
        damage: Why it cannot be scored, in one sentence; empty for a whole log.
        duration_s: From the first to the last stamp, s.
    """

    format: str
    topics: tuple[TopicDescription, ...] = ()
    clock: str = ""
    facts: Mapping[str, int | float | str] = field(default_factory=dict)
    defects: tuple[LogDefect, ...] = ()
    damage: str = ""
    duration_s: float = 0.0


def _silent(_done: float) -> None:
    """Take the place of a progress bar."""


Decoded: TypeAlias = WorkItem | Submission | Event | Record
"""What a message or a line of a log can mean."""


@runtime_checkable
class Decoder(Protocol):
    """Understands the messages of one competition: entry-point group `ariac_score.decoders`.

    One of a topic that repeats a state at each step may set `only_changes = True`: of messages without header
    that say the same it then gets the first, the last, and one in every half second. One of a topic on which
    many nodes publish, such as a console, may name in `heeds` those that mean something to it: a recording
    that lacks messages of others lacks nothing.
    """

    def decode(self, msgtype: str, message: object, t_s: float) -> Decoded | None:
        """What a message means; `None` when it means nothing.

        Args:
            msgtype: `package/msg/Name`.
            message: The message, with its fields as attributes.
            t_s: Its stamp, s of trial time.
        """
        ...


@runtime_checkable
class TrackReader(Protocol):
    """Sees more in the poses of models than motion: entry-point group `ariac_score.tracks`.

    Such as what lay where: which model is of interest, and what its place means, only the competition
    knows. A log map names it, with parameters, in its section `tracks`.
    """

    def follows(self, name: str) -> bool:
        """Whether the poses of a model or link, by its scoped name, are needed."""
        ...

    def record(self, t_s: FloatArray, tracks: Iterable[ModelTrack], pauses: bool, until_s: float) -> Record:
        """What the poses of one log show, for the checks of the competition.

        Args:
            t_s: Time of each frame, shape (n,), s of trial time, as recorded.
            tracks: The models and links for which `follows` is true.
            pauses: Whether the log leaves out what does not change, so that its last frame
                holds until the next one, however late that is.
            until_s: Nothing is known after this time, s; infinite where the log shows everything.
        """
        ...


@runtime_checkable
class RecordKind(Protocol):
    """Reads one kind of record of JSON-lines logs: entry-point group `ariac_score.record_kinds`.

    The name of the entry point is the kind, the word that stands under `record` in a line.
    """

    @property
    def schema(self) -> Mapping[str, Any]:
        """JSON schema of the record; objects closed, so that a misspelt key is an error."""
        ...

    def read(self, record: Mapping[str, Any], note: Callable[[str], None]) -> Decoded:
        """What a record that keeps the schema means.

        Args:
            record: As written.
            note: Takes what was left out of it, in words, such as a pose that is not usable.
        """
        ...


@runtime_checkable
class Competition(Protocol):
    """What a competition knows of itself: entry-point group `ariac_score.competitions`.

    A class, built with the parameters that a rule set (`competition:`) or a log map gives. All of it is
    optional; what a class has is used:

    - `levels`: names of its levels of work, innermost first, the last one `trial`;
    - `facts`: for each level the facts that its items may have: name to `number` or `text`, or to a mapping
      with `type`, `unit`, `meaning` and `least`, which no trial may state less than, as proofs rely on;
    - `words`: for each level, `trial` too, what people call it, singular and plural; of `submission`, also
      where no level has that name, what is handed in: without it pages are silent about handing in;
    - `join(merged, parts, file)`: see `ariac_score.trial.build.Joining`;
    - `complete(trial)`: the trial with what follows from all its logs together;
    - `defects(trial)`: what is wrong with a trial although its logs are whole, as `LogDefect`s;
    - `unlikely(likeness)`: why a file that looks so cannot be its own, in a few words; else empty;
    - `printed_level(name)`, `place(item, level, name)`: for the audit of official texts, the level of what a
      text calls by a name of its own, its path inside an outermost item, and why there is none;
    - `usual_items`: how many innermost items the trial of a rulebook's examples has, by default 3;
    - `example_trial(seed)`, `made_trial()`, `recorded_messages(trial, motion)`: see `ariac_score.testing`.
    """


@dataclass(frozen=True)
class Wanted:
    """What a reader should bring.

    Attributes:
        log_map: Which topic and field is which signal.
        quantities: The quantities worth decoding.
        decoders: The decoders that the log map names, by name.
        progress: Called now and then with the share done, 0 to 1.
        run: Which run, by its number, of a file that holds several; `None`: the only one.
        jobs: Threads a reader may use for what does not depend on their number; 0: as many as
            there are processors.
        tracks: Sees more in poses of models than motion, where the log map names such a plugin.
        partial: Whether a log that is cut off is wanted as far as it goes; the trial then says so
            (`Trial.cut`).
    """

    log_map: LogMap
    quantities: frozenset[str] = frozenset()
    decoders: Mapping[str, Decoder] = field(default_factory=dict)
    progress: Callable[[float], None] = _silent
    run: int | None = None
    jobs: int = 0
    tracks: TrackReader | None = None
    partial: bool = False


@dataclass(frozen=True)
class ReaderFacts:
    """What a reader states about the files it reads.

    Attributes:
        role: What such a file is in a trial: `log`, `trial_config`, `team_config`, `official`, or a
            word of the competition's own. A trial has one part of each role; of `log`, one for each
            reader.
        a_file: Such a file in words, with its article.
        formats: What it reads, for messages that list what is known; empty to be left out.
        holds_runs: Whether a file may hold several runs; the reader then has `runs` (see `HoldsRuns`).
        folders: Whether a whole folder may be one log, as rosbag2 writes it.
        beside: Shell patterns of names of files that lie beside such a log and belong to its trial, where a
            reader recognises them as something else than a log.
    """

    role: str = "log"
    a_file: str = "a log"
    formats: str = ""
    holds_runs: bool = False
    folders: bool = False
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Likeness:
    """What a file looks like to a reader, which may recognise it although it cannot read it.

    Attributes:
        words: Complete `it looks like …`. No value of the file is part of them: files hold access tokens.
        used_by: Who uses this form, in the competition's words, such as years; empty where it does not say.
    """

    words: str
    used_by: frozenset[str] = frozenset()


@runtime_checkable
class Likening(Protocol):
    """A reader of configurations that recognises a file by its form."""

    def likeness(self, path: Path) -> Likeness:
        """What the file looks like; never an error."""
        ...


@runtime_checkable
class HoldsRuns(Protocol):
    """A reader of files that hold several runs."""

    def runs(self, path: Path) -> Iterable[tuple[int, str, str]]:
        """Number, team and trial of every run in a file, in the order in which they began."""
        ...


def reader_facts(reader: object) -> ReaderFacts:
    """What a reader states about its files; one without `facts` reads logs."""
    facts = getattr(reader, "facts", None)
    return facts if isinstance(facts, ReaderFacts) else ReaderFacts()


@runtime_checkable
class Reader(Protocol):
    """Reads one kind of log: entry-point group `ariac_score.readers`.

    A class attribute `facts` (`ReaderFacts`) states what its files are in a trial; without one they are
    logs.
    """

    def can_read(self, path: Path) -> bool:
        """Whether this looks like a log of its kind; cheap, and never an error."""
        ...

    def describe(self, path: Path) -> LogDescription:
        """What the log holds; for a damaged log, what is readable."""
        ...

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The trial (or the part of it) that the log shows.

        Raises:
            CutOffError: It is cut off, and not wanted in part.
            LogError: The log is damaged so that a score would rest on part of it.
        """
        ...


@dataclass(frozen=True)
class ReportPanel:
    """A part of the page of a trial: entry-point group `ariac_score.report_panels`.

    It is asked for results that its distribution took part in: whose rules, log map, reader or checks it
    brings.

    Attributes:
        title: Its heading.
        data: Takes the result; gives numbers, texts, lists and maps of these, or `None` where it has nothing
            to say about that result.
        template: A block of jinja2 that shows the data by the name `data`; everything in it is escaped. The
            filters `amount`, `brief`, `number`, `seconds` and `untrusted` are those of the page. It is
            written with text, lists, tables and drawings of SVG; scripts, styles, pictures, comments, links
            away from the page and headings of the first two levels are refused.
    """

    title: str
    data: Callable[[Any], Any]
    template: str


@dataclass(frozen=True)
class FactSchemas:
    """What facts a competition has: entry-point group `ariac_score.fact_schemas`, under its name.

    A trial that is read for a rule set of that competition is held against them.

    Attributes:
        levels: By level of work, `trial` for the trial itself, a JSON schema (2020-12) of its facts: an
            object of numbers, texts and null for what is known to be absent. Levels without one may have
            any facts.

    Raises:
        ValueError: One of them is no such schema, or refers to another document.

    >>> FactSchemas({"object": {"required": ["difficulty"]}}).levels["object"]["required"]
    ['difficulty']
    """

    levels: Mapping[str, Mapping[str, Any]]

    def __post_init__(self) -> None:
        for level, schema in self.levels.items():
            try:
                refuse_no_schema(schema)
            except ValueError as cause:
                raise ValueError(f"the schema of level {level!r}: {cause}") from None


GROUPS: Mapping[str, type] = {
    "ariac_score.rules": Rule,
    "ariac_score.monitors": Monitor,
    "ariac_score.readers": Reader,
    "ariac_score.decoders": Decoder,
    "ariac_score.tracks": TrackReader,
    "ariac_score.record_kinds": RecordKind,
    "ariac_score.competitions": Competition,
}
"""Entry-point groups of classes, and the contract of each."""

VALUE_GROUPS: Mapping[str, type] = {
    "ariac_score.quantities": Quantity,
    "ariac_score.derived_signals": DerivedSignal,
    "ariac_score.fact_schemas": FactSchemas,
    "ariac_score.report_panels": ReportPanel,
    "ariac_score.ranking_policies": Callable,  # type: ignore[dict-item]  # from scores to one
    "ariac_score.exports": Callable,  # type: ignore[dict-item]  # from a result to its text
}
"""Entry-point groups of values, and what each is."""

OTHER_GROUPS = (
    "ariac_score.commands",
    "ariac_score.evaluations",
    "ariac_score.executors",
    "ariac_score.messages",
    "ariac_score.sources",
)
"""Entry-point groups whose contract stands where they are used: `cli`, `ranking`, `batch`, `logs`, `live`."""
