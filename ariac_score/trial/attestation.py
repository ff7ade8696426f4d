"""What a recorder attests about a recording: what it received, and what of that the log lacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ariac_score.trial.spans import Span

__all__ = ["Attestation", "Lacking", "Unheard"]


@dataclass(frozen=True)
class Lacking:
    """Messages of one topic that a recorder received and the log lacks.

    Attributes:
        topic: Its name.
        count: How many.
        span: From the heartbeat before the first of them to the heartbeat after the last, s of trial time.
        all: Whether the log has none of that topic.
        publishers: Of whom they are; empty where that is not known.
        within: How many of them came after the log's first of that topic: its samples are rarer for it.
    """

    topic: str
    count: int
    span: Span
    all: bool = False
    publishers: tuple[str, ...] = ()
    within: int = 0

    def __str__(self) -> str:
        """In words."""
        messages = "1 message" if self.count == 1 else f"{self.count} messages"
        return f"{messages} on {self.topic} from {self.span.start_s:.3f} s to {self.span.end_s:.3f} s"


class Unheard(NamedTuple):
    """A message of the log that came before its recorder had a connection: where, when, what, of whom."""

    topic: str
    t_ns: int
    digest: str
    publisher: str


@dataclass(frozen=True)
class Attestation:
    """What a recorder attests about a log.

    Attributes:
        problem: Why nothing is attested, in words: it was not closed, or does not fit; empty where it fits.
        lacking: What was received and is not in the log, in order of topics.
        late: What was received before the log had heard the topic at all, and repeats itself in it.
        early: What the log had heard before the recorder did; it is not read.
        unlisted: How many messages the log has of each topic that the recorder did not receive.
        put_in: The same, without those that it may have lost: what nobody sent.
        moved: How many messages of each topic the log has at other times than the recorder received them.
        moved_by_s: By more than this; so late may a message come to either, s.
        unattested: Topics of the log that the recorder did not listen to.
        undefined: Topics of the log of which the recorder does not say how messages are defined, so that
            another definition in the log would give the same bytes another meaning.
        uncompared: Topics of the log whose definition cannot be held against what the recorder says of it,
            and why: no matter where nobody reads them.
        body: The manifest, whose bytes are signed.
        signature: The text of the signature; empty where there is none.
        listened: From the first heartbeat to the last, s of trial time: nothing is attested outside.
        notes: What the recorder noticed, such as a clock that stood still, in its words.
        trial, team: Whose trial it recorded, as the organiser named them to it; empty where he did not.
    """

    problem: str = ""
    lacking: tuple[Lacking, ...] = ()
    late: tuple[Lacking, ...] = ()
    early: frozenset[Unheard] = frozenset()
    unlisted: tuple[tuple[str, int], ...] = ()
    put_in: tuple[tuple[str, int], ...] = ()
    moved: tuple[tuple[str, int], ...] = ()
    moved_by_s: float = 1.0
    unattested: tuple[str, ...] = ()
    undefined: tuple[str, ...] = ()
    uncompared: tuple[tuple[str, str], ...] = ()
    body: str = ""
    signature: str = ""
    listened: Span | None = None
    notes: tuple[str, ...] = ()
    trial: str = ""
    team: str = ""
