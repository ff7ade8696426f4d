"""What an oracle thinks of a trace: the standing of every check after each event.

The verdict of an event is that of the trace up to and including it. What a monitor has
said counts for as long as it accepts a gap; after that nothing is known, and nothing is
claimed. A check whose monitor cannot watch online, or whose signals the log map does
not give as they are, has its say when the trace is over.
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
from ariac_score.engine.prepared import prepare
from ariac_score.errors import PluginNotFoundError, RuleSetError, UsageError
from ariac_score.logs.containers.items import normalised_type
from ariac_score.logs.rosmonitoring import channel_of, clock_of, fields_of, stamp_s
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.channels import FieldMap, LogMap
from ariac_score.trial.events import Event as Happened
from ariac_score.trial.model import Body
from ariac_score.trial.signals import LARGEST_VALUE, Sample
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

__all__ = ["CURRENTLY_FALSE", "CURRENTLY_TRUE", "UNKNOWN", "Judge", "Opinion", "RulesBench", "SpecBench"]

TRUE, FALSE = "true", "false"
CURRENTLY_TRUE, CURRENTLY_FALSE, UNKNOWN = "currently_true", "currently_false", "unknown"

Event = Mapping[str, Any]


@dataclass(frozen=True)
class Opinion:
    """What to answer.

    Attributes:
        verdict: One of the words of the protocol, in lower case.
        spec: What is violated and by how much; empty unless the verdict is negative.
    """

    verdict: str
    spec: str = ""


class Judge(Protocol):
    """The state of one trace."""

    def take(self, event: Event) -> Opinion:
        """Judge the trace up to and including an event.

        Raises:
            ValueError: The event cannot be judged; the trace stands as before.
        """
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
        """A judge who knows nothing yet."""
        ...


# Rule sets -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Live:
    """A check that is judged event by event.

    Attributes:
        name: The check.
        plugin: What it uses.
        monitor: Built.
        signals: Those of the log map that it needs.
        max_gap_s: How long what it says counts, s; without end where it speaks of events alone.
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
        self._lives: list[_Live] = []
        later: dict[str, str] = {}
        for name, each in prepared.checks.items():
            check = each.check
            why_not = _why_later(check, self._map)
            if not why_not:
                gap_s = min((need.max_gap_s for need in each.needs if not need.optional), default=math.inf)
                live = _Live(name, each.plugin, check, _signals_for(check, self._map), gap_s)
                why_not = str(getattr(_begun(live, self._map.bodies), "undecided", ""))
            if why_not:
                later[name] = why_not
            else:
                self._lives.append(live)
        self.live = tuple(live.name for live in self._lives)
        self.later: Mapping[str, str] = later
        wanted = frozenset(signal for live in self._lives for signal in live.signals)
        self._topics = _topics(self._map, wanted, registry)

    def judge(self) -> Judge:
        """A judge who knows nothing yet."""
        return _RulesJudge(self._lives, self._topics, self._map.bodies)


def _why_later(check: object, log_map: LogMap) -> str:
    """Why a check cannot be judged event by event; empty where it can."""
    if not isinstance(check, Monitor):
        return "rules judge whole orders"
    if not isinstance(check, OnlineMonitor):
        return "its monitor watches whole trials only"
    needs = {need.quantity for need in check.needs() if not need.optional}
    lacking = sorted(needs - {quantity_of(f.signal) for c in log_map.channels for f in c.signals})
    return f"no topic gives its {' and '.join(lacking)} as they are" if lacking else ""


def _signals_for(check: OnlineMonitor, log_map: LogMap) -> frozenset[str]:
    needs = {need.quantity for need in check.needs() if not need.optional}
    return frozenset(
        f.signal for channel in log_map.channels for f in channel.signals if quantity_of(f.signal) in needs
    )


@dataclass(frozen=True)
class _Source:
    """Where the value of one signal stands in the events of one topic."""

    signal: str
    unit: str
    paths: tuple[tuple[str, ...], ...]
    at_least: float

    def sample(self, event: Event, t_s: float) -> Sample:
        """The sample an event holds.

        Raises:
            ValueError: It holds none that can be one.
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
    """What the events of one topic hold.

    Attributes:
        sources: Its signals.
        decoders: Who understands its messages, each with the type that the log map gives them.
    """

    sources: tuple[_Source, ...] = ()
    decoders: tuple[tuple[str, GuardedDecoder], ...] = ()

    def events(self, event: Event, t_s: float) -> list[Happened]:
        """What an event tells that happened; what cannot be understood is left to the end."""
        found = []
        for type_, decoder in self.decoders:
            try:
                item = decoder.decode(type_, fields_of(event), t_s)
            except (ValueError, AttributeError):
                continue
            if isinstance(item, Happened):
                found.append(item)
        return found


_NOTHING = _Topic()


def _topics(log_map: LogMap, wanted: frozenset[str], registry: Registry) -> dict[str, _Topic]:
    found: dict[str, _Topic] = {}
    for channel in log_map.channels:
        own = tuple(_source(f) for f in channel.signals if f.signal in wanted)
        decoders: tuple[tuple[str, GuardedDecoder], ...] = ()
        if channel.decoder:
            plugin = registry.find("ariac_score.decoders", channel.decoder)
            decoders = ((normalised_type(channel.type), GuardedDecoder(plugin, plugin.build({}))),)
        if own or decoders:
            topic = "/" + channel.topic.strip("/")
            known = found.get(topic, _NOTHING)
            found[topic] = _Topic((*known.sources, *own), (*known.decoders, *decoders))
    return found


def _source(field_map: FieldMap) -> _Source:
    known = QUANTITIES.get(quantity_of(field_map.signal))
    paths = tuple(tuple(path.split(".")) for path in field_map.fields)
    return _Source(field_map.signal, field_map.unit, paths, known.at_least if known else -math.inf)


class _Said:
    """What one check says by now, by subject, each with the time at which it said so."""

    def __init__(self, live: _Live, bodies: Sequence[Body]) -> None:
        self.live, self.watch = live, _begun(live, bodies)
        self.standings: dict[str, tuple[InstantVerdict, float | None]] = {}
        self.longest_s = live.max_gap_s + 1e-9

    def step(self, samples: Sequence[Sample], events: Sequence[Happened], t_s: float | None) -> None:
        """Have it take what has come."""
        signals = self.live.signals
        own = [sample for sample in samples if sample.signal in signals]
        if not own and not events:
            return
        try:
            for standing in self.watch.step(own, events):
                self.standings[standing.subject] = standing, t_s
        except Exception as cause:
            live = self.live
            raise broken(live.plugin, f"raised {type(cause).__name__}: {cause}", of=live.name) from cause

    def known(self, t_s: float | None) -> Iterator[InstantVerdict]:
        """What still counts at the time of an event, as far as that has one."""
        for standing, said_s in self.standings.values():
            if (
                standing.final
                or t_s is None
                or said_s is None
                or t_s - said_s <= self.longest_s
                or clock_of(t_s) != clock_of(said_s)
            ):
                yield standing


class _RulesJudge:
    """The state of one trace under the monitors of a rule set."""

    def __init__(self, lives: Sequence[_Live], topics: Mapping[str, _Topic], bodies: Sequence[Body]) -> None:
        self._topics = topics
        self._said = [_Said(live, bodies) for live in lives]
        self._latest: dict[str, float] = {}

    def take(self, event: Event) -> Opinion:
        """Judge the trace up to and including an event."""
        topic = self._topics.get(channel_of(event), _NOTHING)
        t_s = stamp_s(event)
        samples: list[Sample] = []
        if topic.sources:
            if t_s is None:
                raise ValueError("the event has no time")
            samples = [source.sample(event, t_s) for source in topic.sources]
            self._check_times(samples, t_s)
        events = topic.events(event, 0.0 if t_s is None else t_s) if topic.decoders else []
        if samples or events:
            for said in self._said:
                said.step(samples, events, t_s)
        return self._opinion(t_s)

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
        for said in self._said:
            speaks = not said.live.signals  # of an event that did not come nothing has to be said
            for standing in said.known(t_s):
                speaks = True
                everything_final = everything_final and standing.final
                if standing.verdict is Verdict.VIOLATED:
                    violated.append((said.live.name, standing))
                elif standing.verdict is Verdict.INCONCLUSIVE:
                    undecided = True
            everything_final = everything_final and bool(said.live.signals)
            nothing = nothing or not speaks
        if violated:
            words = "; ".join(f"{name}: {s.subject}: {s.message}" for name, s in violated)
            return Opinion(FALSE if any(s.final for _, s in violated) else CURRENTLY_FALSE, words)
        if undecided or nothing or not any(said.standings for said in self._said):
            return Opinion(UNKNOWN)
        return Opinion(TRUE if everything_final else CURRENTLY_TRUE)


def _begun(live: _Live, bodies: Sequence[Body]) -> OnlineWatch:
    try:
        return live.monitor.begin(bodies)
    except Exception as cause:
        raise broken(live.plugin, f"raised {type(cause).__name__}: {cause}", of=live.name) from cause


# Specifications --------------------------------------------------------------------------

SPEC_MONITOR = "rml.spec"
"""The monitor that judges events by a specification file; its parameter `spec` names the file."""


class SpecBench:
    """Judges by a specification, which speaks of events as they are.

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
            text = file.read_text(encoding="utf-8")
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
            raise RuleSetError(f"nothing can be judged by it: {cause}", file=file) from cause

    def _built(self, parameters: Mapping[str, object], file: Path) -> object:
        try:
            return self._plugin.build(parameters)
        except RuleSetError as error:
            raise RuleSetError(error.cause, file=file, hint=error.hint) from error

    def judge(self) -> Judge:
        """A judge who knows nothing yet."""
        return _SpecJudge(self._guarded(self._monitor.begin_events), self._guarded)

    def _guarded(self, call: Callable[..., Any], *arguments: object) -> Any:
        try:
            return call(*arguments)
        except ValueError:
            raise
        except Exception as cause:
            raise broken(self._plugin, f"raised {type(cause).__name__}: {cause}") from cause


class _SpecJudge:
    """The state of one trace under a specification."""

    def __init__(self, watch: EventWatch, guarded: Callable[..., Any]) -> None:
        self._watch, self._guarded = watch, guarded

    def take(self, event: Event) -> Opinion:
        """Judge the trace up to and including an event."""
        standing: InstantVerdict = self._guarded(self._watch.take, _bare(event))
        return Opinion(_word(standing), standing.message if standing.verdict is Verdict.VIOLATED else "")


def _bare(event: Event) -> dict[str, Any]:
    """The event without what an earlier oracle added to it."""
    return dict(_members(event))


def _members(event: Event) -> Iterator[tuple[str, Any]]:
    return ((name, value) for name, value in event.items() if name not in ("verdict", "spec"))


def _word(standing: InstantVerdict) -> str:
    if standing.verdict is Verdict.VIOLATED:
        return FALSE if standing.final else CURRENTLY_FALSE
    if standing.verdict is Verdict.INCONCLUSIVE:
        return UNKNOWN
    return TRUE if standing.final else CURRENTLY_TRUE
