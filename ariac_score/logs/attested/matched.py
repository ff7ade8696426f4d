"""Which messages the recorder and the log both have, and which only one of them."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ariac_score.logs.attested.chain import Beats
from ariac_score.logs.attested.recorded import Found, Logged, UnfitError
from ariac_score.logs.attested.times import LATE_NS
from ariac_score.trial.spans import Span

__all__ = [
    "Matched",
    "around",
    "at_most",
    "less_from",
    "matched_with",
    "refuse_joined_publishers",
    "unlisted_in",
]

CONNECTING_NS = 5 * 10**9
"""So much sooner may the one hear a publisher than the other: on a loaded machine it was up to 1.4 s."""


@dataclass
class Matched:
    """Which messages of one topic are in the list of the recorder and in the log; which in one of them alone.

    Attributes:
        both: In the log and listed.
        extra: In the log alone.
        gone: Listed alone, with the heartbeats between which each arrived.
    """

    both: list[Logged] = field(default_factory=list)
    extra: list[Logged] = field(default_factory=list)
    gone: list[tuple[Span, str]] = field(default_factory=list)

    def moved(self) -> Counter[str]:
        """The messages that lie elsewhere in the log than where they were received."""
        return Counter(one.digest for one in self.extra) & Counter(digest for _, digest in self.gone)

    def early(self) -> list[Logged]:
        """What the log heard of a publisher before the recorder did: two subscribers never begin at once."""
        first_ns: dict[str, int] = {}
        for one in self.both:
            first_ns[one.publisher] = min(one.t_ns, first_ns.get(one.publisher, one.t_ns))
        return [
            one
            for one in self.extra
            if one.publisher in first_ns and 0 < first_ns[one.publisher] - one.t_ns <= CONNECTING_NS
        ]

    def late(self, origin_ns: int) -> list[tuple[Span, str]]:
        """What the recorder heard of a topic before the log did, and the log has later, in the same bytes."""
        if not self.both:
            return []
        first_s = (min(one.t_ns for one in self.both) - origin_ns) / 1e9
        known = {one.digest for one in self.both}
        return [
            (span, digest)
            for span, digest in self.gone
            if digest in known and first_s - CONNECTING_NS / 1e9 <= span.start_s <= first_s
        ]


def matched_with(
    found: Found, spans: Mapping[tuple[str, str], list[Span]], origin_ns: int, late_ns: int
) -> dict[str, Matched]:
    """What log and recorder both have of each topic; messages of the same bytes are paired from the end on.

    So of equal ones that only one of them has, those count as missing, or as too many, that came first:
    neither subscriber hears a publisher from its first message on.
    """
    late_s = late_ns / 1e9
    first_s = min((span.start_s for every in spans.values() for span in every), default=0.0)
    listed: dict[str, dict[str, list[Span]]] = defaultdict(dict)
    for (topic, digest), every in spans.items():
        listed[topic][digest] = every
    matched: dict[str, Matched] = {}
    for topic, messages in sorted(found.logged.items()):
        by_digest: dict[str, list[Logged]] = defaultdict(list)
        for one in messages:
            by_digest[one.digest].append(one)
        into = matched[topic] = Matched()
        for digest in sorted(by_digest.keys() | listed[topic].keys()):
            left = sorted(by_digest.get(digest, ()))
            for span in reversed(listed[topic].get(digest, [])):
                while left and (left[-1].t_ns - origin_ns) / 1e9 > span.end_s + late_s:
                    into.extra.append(left.pop())
                # Whatever came before the first heartbeat is in it.
                if left and (
                    span.start_s <= first_s or (left[-1].t_ns - origin_ns) / 1e9 >= span.start_s - late_s
                ):
                    into.both.append(left.pop())
                else:
                    into.gone.append((span, digest))
            into.extra += left
    return matched


def at_most(found: Sequence[tuple[Span, str]], counts: Mapping[str, int]) -> list[tuple[Span, str]]:
    """The first of them, of each digest as many as counted."""
    taken: Counter[str] = Counter()
    kept = []
    for span, digest in sorted(found):
        taken[digest] += 1
        if taken[digest] <= counts[digest]:
            kept.append((span, digest))
    return kept


def around(spans: Sequence[Span]) -> Span:
    """From the first beginning to the last end."""
    return Span(min(span.start_s for span in spans), max(span.end_s for span in spans))


def refuse_joined_publishers(
    topic: str, logged: Sequence[Logged], listed: Counter[str], about: Mapping[str, Any]
) -> None:
    """Refuse a topic on which the messages of several publishers stand as those of one.

    Two that tell two stories contest each other; one that changes his mind does not.
    """
    publishers = about.get("publishers")
    if not isinstance(publishers, dict) or "" in publishers:
        return
    counts = {name: n if isinstance(n := one.get("count"), int) else 0 for name, one in publishers.items()}
    of_log, here = Counter(one.publisher for one in logged), Counter(one.digest for one in logged)
    more, less = (here - listed).total(), (listed - here).total()
    if all(name.startswith("/") for name in of_log):
        for name, n in sorted(of_log.items()):
            if n > counts.get(name, 0) + more:
                raise UnfitError(f"on {topic!r} it has messages of others as those of {name}")
        return
    # Another container names connections by numbers: of as many publishers, unless nothing is left of some.
    fewest = sorted(n for n in counts.values() if n > 0)[: max(0, len(counts) - len(of_log))]
    if sum(fewest) > less:
        raise UnfitError(f"on {topic!r} it has the messages of {len(counts)} publishers as those of fewer")


def less_from(matched: Matched | None, about: Mapping[str, Any]) -> tuple[str, ...]:
    """The publishers of whom the log has less than the recorder received; empty where either names none."""
    publishers = about.get("publishers")
    if matched is None or not isinstance(publishers, dict):
        return ()
    # A line of another node is none of this one, whichever connection the log has it on.
    of_log = Counter(one.publisher for one in matched.both if one.publisher == one.node)
    if "" in publishers or any(not one.publisher for one in matched.both):
        return ()
    return tuple(
        sorted(
            name
            for name, one in publishers.items()
            if isinstance(one, dict) and isinstance(n := one.get("count"), int) and n > of_log[name]
        )
    )


def unlisted_in(
    found: Found,
    listed: Mapping[str, Counter[str]],
    beats: Beats,
    early: Mapping[str, Sequence[Logged]],
    lost: Mapping[str, int] | None = None,
) -> Iterator[tuple[str, int]]:
    """How many messages between the first and the last heartbeat the recorder did not receive, by topic.

    With `lost`, only those that it did not lose either: not what came while it closed its books.
    """
    if not beats:
        return
    first_ns, last_ns = beats[0][0], beats[-1][0] - (LATE_NS if lost else 0)
    for topic, digests in sorted(listed.items()):
        inside = Counter(m.digest for m in found.logged.get(topic, ()) if first_ns <= m.t_ns <= last_ns)
        inside -= Counter(m.digest for m in early.get(topic, ()) if first_ns <= m.t_ns <= last_ns)
        if (more := (inside - digests).total() - (lost or {}).get(topic, 0)) > 0:
            yield topic, more
