"""Which topics a check could be decided from, and which of them a recording lacks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass

from ariac_score.checks.contracts import SignalNeed
from ariac_score.engine.prepared import Prepared
from ariac_score.trial.channels import Channel, LogMap
from ariac_score.trial.derive import source_quantities
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of, subject_of

__all__ = ["MissingTopics", "gives", "grouped", "missing_topics", "work_topics"]

_KIND = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True)
class MissingTopics:
    """Topics that are not in the log, of which all or one would have helped.

    Attributes:
        topics: Their names, in the order of the log map.
        all_of: Whether every one is needed; otherwise one of them is enough.
        checks: The checks that lack them.
    """

    topics: tuple[str, ...]
    all_of: bool
    checks: tuple[str, ...]

    @property
    def words(self) -> str:
        """Such as `one of /tf, /odom`."""
        names = ", ".join(self.topics)
        if len(self.topics) == 1:
            return names
        return f"{'all' if self.all_of else 'one'} of {names}"


def missing_topics(check: str, prepared: Prepared, recorded: Set[str]) -> Iterator[MissingTopics]:
    """The topics without which a check cannot be decided.

    Args:
        check: Its name.
        prepared: The rule set.
        recorded: The topics that are in the logs; none of a log without topics, which lacks none.
    """
    needs = [need for need in prepared.checks[check].needs if not need.optional]
    if not recorded:
        return
    if not needs:
        topics = [topic for topic in work_topics(prepared.log_map) if topic not in recorded]
        printed = [topic for topic in _witnessing("console", prepared.log_map) if topic not in recorded]
        told = [topic for topic in _witnessing("submissions", prepared.log_map) if topic in topics]
        if told and printed:  # simulators print what was handed in
            topics = [topic for topic in topics if topic not in told]
            yield MissingTopics((*printed, *told), False, (check,))
        if topics:
            yield MissingTopics(tuple(topics), True, (check,))
        return
    for need in needs:
        wanted = source_quantities([need.quantity], prepared.brought)
        for kind in _kinds(need):
            offering = tuple(
                dict.fromkeys(
                    channel.topic
                    for channel in prepared.log_map.channels
                    if gives(channel, wanted, prepared.log_map, kind)
                )
            )
            if offering and recorded.isdisjoint(offering):
                yield MissingTopics(offering, False, (check,))


def work_topics(log_map: LogMap) -> tuple[str, ...]:
    """The topics that say what was to be done, what was handed in and what happened."""
    return tuple(
        dict.fromkeys(c.topic for c in log_map.channels if (c.decoder or c.event) and not c.optional)
    )


def _witnessing(what: str, log_map: LogMap) -> list[str]:
    return [channel.topic for channel in log_map.channels if what in channel.witnesses]


def _kinds(need: SignalNeed) -> tuple[str, ...]:
    """The kinds of bodies that a need is about; an empty one stands for any."""
    if named := _KIND.findall(need.pair):
        return tuple(named)
    quantity = QUANTITIES.get(need.quantity)
    return ("robot", "human") if quantity is not None and quantity.of == "pair" else ("",)


def gives(channel: Channel, wanted: Iterable[str], log_map: LogMap, kind: str = "") -> bool:
    """Whether a channel gives one of some quantities, of a body of a kind, over time.

    Args:
        channel: One of the log map.
        wanted: Quantities, such as `position`.
        log_map: Whose bodies these are.
        kind: Such as `human`; empty: any.
    """
    quantities = frozenset(wanted)
    if channel.as_consumed:
        return False
    if channel.poses:
        # What never moves is no alternative to what does.
        if "position" not in quantities or channel.topic.endswith("tf_static"):
            return False
        matches = log_map.frames if channel.poses == "frames" else log_map.models
        return not kind or any(match.kind == kind for match in matches)
    kinds = {body.id: body.kind for body in log_map.bodies}
    return any(
        quantity_of(mapped.signal) in quantities
        and (not kind or kind in {kinds.get(body.partition("::")[0]) for body in _bodies(mapped.signal)})
        for mapped in channel.signals
    )


def _bodies(signal: str) -> list[str]:
    return subject_of(signal).split("/")


def grouped(found: Iterable[MissingTopics]) -> list[MissingTopics]:
    """The same with every topic named once: where less is enough for one check, it helps the others too."""
    every: dict[str, dict[str, None]] = {}
    single: dict[tuple[str, ...], dict[str, None]] = {}
    for one in sorted(found, key=lambda one: len(one.topics)):
        if one.all_of:
            for topic in one.topics:
                every.setdefault(topic, {}).update(dict.fromkeys(one.checks))
            continue
        known = next((topics for topics in single if set(topics) <= set(one.topics)), one.topics)
        single.setdefault(known, {}).update(dict.fromkeys(one.checks))
    groups = [MissingTopics(topics, False, tuple(checks)) for topics, checks in single.items()]
    if every:
        checks = dict.fromkeys(check for named in every.values() for check in named)
        groups.insert(0, MissingTopics(tuple(every), True, tuple(checks)))
    return groups
