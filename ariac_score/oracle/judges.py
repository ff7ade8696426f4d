"""The opinion of an oracle about a trace: the verdict of every check after each event.

The verdict of an event is that of the trace up to and including it. The verdict of a monitor
counts for as long as the monitor accepts a gap; after that it is unknown. A check is judged
only when the trace is over if its monitor cannot watch online, or if it needs signals that
the log map does not map directly from a topic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from ariac_score.checks.contracts import (
    EventMonitor,
    EventWatch,
    InstantVerdict,
    Monitor,
    OnlineMonitor,
    OnlineWatch,
)
from ariac_score.checks.findings import Verdict
from ariac_score.checks.guarded import GuardedDecoder, broken
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.documents.plain_file import read_plain
from ariac_score.engine.prepared import prepare
from ariac_score.errors import PluginNotFoundError, RuleSetError, UsageError
from ariac_score.installed.captured_output import fault_of
from ariac_score.logs.containers.items import normalised_type
from ariac_score.logs.gather.stated import ChannelDecoder
from ariac_score.logs.rosmonitoring import channel_of, clock_of, fields_of, stamp_s
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.channels import FieldMap, LogMap
from ariac_score.trial.events import Event as Happened
from ariac_score.trial.model import Body
from ariac_score.trial.signals import LARGEST_VALUE, Sample
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

__all__ = ["CURRENTLY_FALSE", "CURRENTLY_TRUE", "UNKNOWN", "Judge", "Opinion", "RulesBench", "SpecBench"]

_LARGEST_SPEC_BYTES = 1_000_000

TRUE, FALSE = "true", "false"
CURRENTLY_TRUE, CURRENTLY_FALSE, UNKNOWN = "currently_true", "currently_false", "unknown"

Event = Mapping[str, Any]


@dataclass(frozen=True)
class Opinion:
    """The answer to an event.

    Attributes:
        verdict: One of the words of the protocol, in lower case.
        spec: What is violated and by how much; empty unless the verdict is negative.
        gap: Whether something before the event was not seen for longer than its monitor accepts.
    """

    verdict: str
    spec: str = ""
    gap: bool = False


class Judge(Protocol):
    """The state of one trace."""

    def take(self, event: Event) -> Opinion:
        """Judge the trace up to and including an event.

        Raises:
            ValueError: The event cannot be judged; the state does not change.
        """
        ...

    def unseen(self) -> None:
        """Note that events are missing here: what was known is known no more, but for what is final."""
        ...


class Bench(Protocol):
    """Makes a judge for every trace.

    Attributes:
        live: The checks that are judged event by event.
        later: Why the others are not, by check.
    """

    live: tuple[str, ...]
    later: Mapping[str, str]

    def judge(self) -> Judge:
        """A judge at the beginning of a trace."""
        ...


# Rule sets -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Live:
    """A check that is judged event by event.

    Attributes:
        name: The check.
        plugin: Of its monitor.
        monitor: With its parameters.
        signals: Those of the log map that it needs.
        max_gap_s: How long its verdict counts, s; infinite where it needs only events.
    """

    name: str
    plugin: Plugin
    monitor: OnlineMonitor
    signals: frozenset[str]
    max_gap_s: float


class RulesBench:
    """Judges by the monitors of a rule set.

    Args:
        rule_set: Whose monitors.
        registry: The installed plugins.
        log_map: Log map to use instead of the rule set's own.

    Raises:
        ScoreError: The rule set or the log map cannot be used.
    """

    def __init__(self, rule_set: RuleSet, registry: Registry, *, log_map: str = "") -> None:
        self.rule_set = rule_set
        prepared = prepare(rule_set, log_map=log_map, registry=registry)
        prepared.refuse_unknown_quantities()
        self._map = prepared.log_map
        self._map.refuse_unfilled()  # no file beside a trace states facts
        self._lives: list[_Live] = []
        later: dict[str, str] = {}
        for name, each in prepared.checks.items():
            check = each.check
            why_not = _why_later(check, self._map)
            if not why_not:
                gap_s = min((need.max_gap_s for need in each.needs if not need.optional), default=math.inf)
                live = _Live(name, each.plugin, check, _signals_for(check, self._map), gap_s)
                why_not = str(getattr(_watch(live, self._map.bodies), "undecided", ""))
            if why_not:
                later[name] = why_not
            else:
                self._lives.append(live)
        self.live = tuple(live.name for live in self._lives)
        self.later: Mapping[str, str] = later
        wanted = frozenset(signal for live in self._lives for signal in live.signals)
        self._topics = _topics(self._map, wanted, registry)

    def judge(self) -> Judge:
        """A judge at the beginning of a trace."""
        return _RulesJudge(self._lives, self._topics, self._map.bodies)


def _why_later(check: object, log_map: LogMap) -> str:
    """Why a check cannot be judged event by event; empty where it can."""
    if not isinstance(check, Monitor):
        return "rules judge whole items of work"
    if not isinstance(check, OnlineMonitor):
        return "its monitor watches whole trials only"
    needs = {need.quantity for need in check.needs() if not need.optional}
    lacking = sorted(needs - {quantity_of(f.signal) for f in _fields(log_map)})
    return f"no topic gives its {' and '.join(lacking)} as they are" if lacking else ""


def _signals_for(check: OnlineMonitor, log_map: LogMap) -> frozenset[str]:
    needs = {need.quantity for need in check.needs() if not need.optional}
    return frozenset(f.signal for f in _fields(log_map) if quantity_of(f.signal) in needs)


def _fields(log_map: LogMap) -> Iterator[FieldMap]:
    """What is watched over time: not what is as consumed, which has no time to watch it over."""
    return (f for channel in log_map.channels if not channel.as_consumed for f in channel.signals)


@dataclass(frozen=True)
class _Source:
    """The fields of the events of one topic that hold the value of one signal."""

    signal: str
    unit: str
    paths: tuple[tuple[str, ...], ...]
    at_least: float

    def sample(self, event: Event, t_s: float) -> Sample:
        """The sample that an event holds.

        Raises:
            ValueError: A field is missing, no number, or impossible for the signal.
        """
        if len(self.paths) == 1:
            return Sample(self.signal, t_s, self._number(event, self.paths[0]), self.unit)
        numbers = tuple(self._number(event, path) for path in self.paths)
        return Sample(self.signal, t_s, numbers, self.unit)

    def _number(self, event: Event, path: tuple[str, ...]) -> float:
        value: Any = event
        for name in path:
            if not isinstance(value, dict) or name not in value:
                raise ValueError(f"field {'.'.join(path)!r} is missing")
            value = value[name]
        if not isinstance(value, int | float):
            raise ValueError(f"field {'.'.join(path)!r} is no number")
        # NaN keeps neither limit.
        if not (-LARGEST_VALUE <= value <= LARGEST_VALUE and value >= self.at_least):
            raise ValueError(f"field {'.'.join(path)!r} is {value!r}, which {self.signal} cannot be")
        return float(value)


@dataclass(frozen=True)
class _Topic:
    """How the events of one topic are read.

    Attributes:
        sources: Its signals.
        decoders: Of its messages, each with the type that the log map gives them.
    """

    sources: tuple[_Source, ...] = ()
    decoders: tuple[tuple[str, ChannelDecoder], ...] = ()

    def events(self, event: Event, t_s: float) -> list[Happened]:
        """The events of the trial in a message; one that cannot be decoded is left to the end."""
        found = []
        for type_, decoder in self.decoders:
            try:
                item = decoder.decode(type_, fields_of(event), t_s)
            except (ValueError, AttributeError):  # fields of another type, as for a damaged log
                continue
            if isinstance(item, Happened):
                found.append(item)
        return found


_NOTHING = _Topic()


def _topics(log_map: LogMap, wanted: frozenset[str], registry: Registry) -> dict[str, _Topic]:
    found: dict[str, _Topic] = {}
    for channel in log_map.channels:
        over_time = () if channel.as_consumed else channel.signals
        own = tuple(_source(f) for f in over_time if f.signal in wanted)
        decoders: tuple[tuple[str, ChannelDecoder], ...] = ()
        if channel.decoder:
            plugin = registry.find("ariac_score.decoders", channel.decoder)
            guarded = GuardedDecoder(plugin, plugin.build({}))
            decoders = ((normalised_type(channel.type), ChannelDecoder(channel, guarded)),)
        elif channel.event:
            decoders = ((normalised_type(channel.type), ChannelDecoder(channel)),)
        if own or decoders:
            topic = "/" + channel.topic.strip("/")
            known = found.get(topic, _NOTHING)
            found[topic] = _Topic((*known.sources, *own), (*known.decoders, *decoders))
    return found


def _source(field_map: FieldMap) -> _Source:
    known = QUANTITIES.get(quantity_of(field_map.signal))
    paths = tuple(tuple(path.split(".")) for path in field_map.fields)
    return _Source(field_map.signal, field_map.unit, paths, known.at_least if known else -math.inf)


class _CheckState:
    """The latest verdict of one check for each subject, with the time of the event that led to it.

    Attributes:
        gap: Whether the last event was the first after a stretch in which one of the signals was not seen.
        blind: Whether events are missing of which only events could tell: unknown for ever, unless violated.
    """

    def __init__(self, live: _Live, bodies: Sequence[Body]) -> None:
        self.live, self.watch = live, _watch(live, bodies)
        self.verdicts: dict[str, tuple[InstantVerdict, float | None]] = {}
        self.gap = self.blind = self._unseen = False
        self._last_s: dict[str, float] = {}
        # Times are floats: a gap of exactly the longest may come out a little larger.
        self.longest_s = live.max_gap_s + 1e-9

    def step(self, samples: Sequence[Sample], events: Sequence[Happened], t_s: float | None) -> None:
        """Have the monitor take samples and events."""
        signals = self.live.signals
        own = [sample for sample in samples if sample.signal in signals]
        for sample in own:
            before_s = self._last_s.get(sample.signal)
            if self._unseen or (before_s is not None and sample.t_s - before_s > self.longest_s):
                self.gap = True
            self._last_s[sample.signal] = sample.t_s
        self._unseen = self._unseen and not own
        if not own and not events:
            return
        try:
            for verdict in self.watch.step(own, events):
                self.verdicts[verdict.subject] = verdict, t_s
        except Exception as cause:
            live = self.live
            raise broken(live.plugin, f"raised {fault_of(cause)}", of=live.name) from cause

    def unseen(self) -> None:
        """Note that events are missing here."""
        self.verdicts = {name: one for name, one in self.verdicts.items() if one[0].final}
        self._unseen = bool(self.live.signals)
        self.blind = not self.live.signals

    def known(self, t_s: float | None) -> Iterator[InstantVerdict]:
        """The verdicts that still count at the time of an event; all of them where it has none."""
        for verdict, since_s in self.verdicts.values():
            if (
                verdict.final
                or t_s is None
                or since_s is None
                or t_s - since_s <= self.longest_s
                or clock_of(t_s) != clock_of(since_s)  # nothing follows from times of two clocks
            ):
                yield verdict


class _RulesJudge:
    """The state of one trace under the monitors of a rule set."""

    def __init__(self, lives: Sequence[_Live], topics: Mapping[str, _Topic], bodies: Sequence[Body]) -> None:
        self._topics = topics
        self._states = [_CheckState(live, bodies) for live in lives]
        self._latest: dict[str, float] = {}

    def take(self, event: Event) -> Opinion:
        """Judge the trace up to and including an event."""
        topic = self._topics.get(channel_of(event), _NOTHING)
        t_s = stamp_s(event)
        for state in self._states:
            state.gap = False
        samples: list[Sample] = []
        if topic.sources:
            if t_s is None:
                raise ValueError("the event has no time")
            samples = [source.sample(event, t_s) for source in topic.sources]
            self._check_times(samples, t_s)
        events = topic.events(event, 0.0 if t_s is None else t_s) if topic.decoders else []
        if samples or events:
            for state in self._states:
                state.step(samples, events, t_s)
        return self._opinion(t_s)

    def unseen(self) -> None:
        """Note that events are missing here."""
        for state in self._states:
            state.unseen()

    def _check_times(self, samples: Sequence[Sample], t_s: float) -> None:
        latest = self._latest
        for sample in samples:
            before_s = latest.get(sample.signal)
            if before_s is not None and not t_s > before_s:
                raise ValueError(f"{sample.signal} was at {before_s} s and is at {t_s} s")
        for sample in samples:
            latest[sample.signal] = t_s

    def _opinion(self, t_s: float | None) -> Opinion:
        violated: list[tuple[str, InstantVerdict]] = []
        undecided = nothing = False
        everything_final = True
        for state in self._states:
            known = not state.live.signals  # a check of events alone has no verdict before the first of them
            for verdict in state.known(t_s):
                known = True
                everything_final = everything_final and verdict.final
                if verdict.verdict is Verdict.VIOLATED:
                    violated.append((state.live.name, verdict))
                elif verdict.verdict is Verdict.INCONCLUSIVE:
                    undecided = True
            # A later event may still violate a check of events alone.
            everything_final = everything_final and bool(state.live.signals)
            nothing = nothing or not known or state.gap or state.blind
        gap = any(state.gap for state in self._states)
        if violated:
            spec = "; ".join(f"{name}: {v.subject}: {v.message}" for name, v in violated)
            return Opinion(FALSE if any(v.final for _, v in violated) else CURRENTLY_FALSE, spec, gap)
        if undecided or nothing or not any(state.verdicts for state in self._states):
            return Opinion(UNKNOWN, gap=gap)
        return Opinion(TRUE if everything_final else CURRENTLY_TRUE)


def _watch(live: _Live, bodies: Sequence[Body]) -> OnlineWatch:
    try:
        return live.monitor.begin(bodies)
    except Exception as cause:
        raise broken(live.plugin, f"raised {fault_of(cause)}", of=live.name) from cause


# Specifications --------------------------------------------------------------------------

SPEC_MONITOR = "rml.spec"
"""The monitor that judges events by a specification; its parameter `spec` is the text."""


class SpecBench:
    """Judges by a specification of events, without a log map.

    Args:
        file: The specification.
        registry: The installed plugins.
        parameters: Of the monitor, besides the file. A rejected event is final unless
            `after_violation` says otherwise, as it is for the oracles of ROSMonitoring.

    Raises:
        ScoreError: No installed plugin reads specifications, or this one cannot be used.
    """

    def __init__(
        self, file: Path, registry: Registry, parameters: Mapping[str, object] = MappingProxyType({})
    ) -> None:
        self.live: tuple[str, ...] = (file.name,)
        self.later: Mapping[str, str] = {}
        if not file.is_file():
            raise UsageError("no such specification", file=file, hint="check the path")
        try:
            self._plugin = registry.find("ariac_score.monitors", SPEC_MONITOR)
        except PluginNotFoundError as error:
            raise PluginNotFoundError(
                f"no installed plugin judges specifications: {error.cause}",
                file=file,
                hint=f"install the distribution that brings {SPEC_MONITOR!r}, or judge by --rules",
            ) from error
        try:
            text = read_plain(file, _LARGEST_SPEC_BYTES).decode("utf-8")
        except (OSError, UnicodeDecodeError) as cause:
            raise UsageError(f"cannot be read: {cause}", file=file, hint="is it a specification?") from cause
        monitor = self._built({"after_violation": "once", **parameters, "spec": text}, file)
        if not isinstance(monitor, EventMonitor):
            raise RuleSetError(
                f"{self._plugin.origin} cannot judge event by event",
                file=file,
                hint="update it, or judge the event log afterwards",
            )
        self._monitor: EventMonitor = monitor
        try:
            self._guarded(monitor.begin_events)
        except ValueError as cause:
            raise RuleSetError(
                f"no event can be judged by it: {cause}", file=file, hint="correct the specification"
            ) from cause

    def _built(self, parameters: Mapping[str, object], file: Path) -> object:
        try:
            return self._plugin.build(parameters)
        except RuleSetError as error:
            raise RuleSetError(error.cause, file=file, hint=error.hint) from error

    def judge(self) -> Judge:
        """A judge at the beginning of a trace."""
        return _SpecJudge(self._guarded(self._monitor.begin_events), self._guarded)

    def _guarded(self, call: Callable[..., Any], *arguments: object) -> Any:
        try:
            return call(*arguments)
        except ValueError:
            raise
        except Exception as cause:
            raise broken(self._plugin, f"raised {fault_of(cause)}") from cause


class _SpecJudge:
    """The state of one trace under a specification."""

    def __init__(self, watch: EventWatch, guarded: Callable[..., Any]) -> None:
        self._watch, self._guarded = watch, guarded
        self._blind = False

    def take(self, event: Event) -> Opinion:
        """Judge the trace up to and including an event."""
        verdict: InstantVerdict = self._guarded(self._watch.take, _without_verdict(event))
        if verdict.verdict is Verdict.VIOLATED:
            return Opinion(_word(verdict), verdict.message)
        # What is missing might have been rejected.
        return Opinion(UNKNOWN if self._blind else _word(verdict))

    def unseen(self) -> None:
        """Note that events are missing here."""
        self._blind = True


def _without_verdict(event: Event) -> dict[str, Any]:
    """The event without the verdict that an earlier oracle added."""
    return {name: value for name, value in event.items() if name not in ("verdict", "spec")}


def _word(verdict: InstantVerdict) -> str:
    if verdict.verdict is Verdict.VIOLATED:
        return FALSE if verdict.final else CURRENTLY_FALSE
    if verdict.verdict is Verdict.INCONCLUSIVE:
        return UNKNOWN
    return TRUE if verdict.final else CURRENTLY_TRUE
