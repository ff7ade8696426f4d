"""What publishers and their numbering of messages show to be missing from a topic, or contested on it.

A ROS 1 publisher numbers its stamped messages (`header.seq`), DDS all of them, which newer recorders keep in
MCAP. A number that is left out is a message that the recording lacks, however short the time between its
neighbours. Two publishers of one topic tell two stories, and nothing says which is true.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ariac_score.logs.containers.items import Connection, IntArray
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.spans import FloatArray, Span

__all__ = [
    "Contested",
    "Missing",
    "Numbering",
    "TopicNumbering",
    "Unknown",
    "contested",
    "note_contested",
    "spans_of",
]

_NEVER = 2**63 - 1
_WRAP = 1 << 32


@dataclass(frozen=True)
class Missing:
    """Messages of one publisher that a recording lacks.

    Attributes:
        publisher: Who sent the others; empty when the container does not say.
        count: How many are missing.
        holes_ns: The stamps before and after each place, ns.
    """

    publisher: str
    count: int
    holes_ns: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Contested:
    """A stretch in which two publishers tell two stories.

    Attributes:
        first_ns: Its beginning, ns.
        last_ns: Its end, ns.
        publishers: Each with how many messages it sent in all.
    """

    first_ns: int
    last_ns: int
    publishers: tuple[tuple[str, int], ...]

    @property
    def words(self) -> str:
        """Such as `/robot (300 messages) and /other (20)`."""
        first, *others = (f"{name or 'unnamed'} ({count})" for name, count in self.publishers)
        return " and ".join((first, *others))


@dataclass
class Unknown:
    """Stretches of a topic of which nothing is known.

    Attributes:
        holes: Between messages that are there, where others are missing.
        contested: In which no message can be believed.
        lost: How many messages are missing.
    """

    holes: list[Span] = field(default_factory=list)
    contested: list[Span] = field(default_factory=list)
    lost: int = 0


@dataclass
class _Sent:
    """What one connection sent to one channel of the log map."""

    count: int = 0
    first_ns: int = _NEVER
    last_ns: int = -_NEVER
    numbers: array[int] = field(default_factory=lambda: array("q"))
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    sequences: array[int] = field(default_factory=lambda: array("q"))

    def take(self, numbers: IntArray, stamps_ns: IntArray, sequences: IntArray | None) -> None:
        if not len(stamps_ns):
            return
        self.count += len(stamps_ns)
        self.first_ns = min(self.first_ns, int(stamps_ns.min()))
        self.last_ns = max(self.last_ns, int(stamps_ns.max()))
        if sequences is not None:
            self.numbers.frombytes(numbers.tobytes())
            self.stamps_ns.frombytes(stamps_ns.tobytes())
            self.sequences.frombytes(sequences.tobytes())


class Numbering:
    """The numbers that a container gives its messages, until the messages are decoded."""

    def __init__(self) -> None:
        self._waiting: dict[Connection, tuple[array[int], array[int]]] = {}
        self._last = 0
        self._steps = self._steps_of_one = 0

    def take(self, connection: Connection, numbers: IntArray, sequences: IntArray) -> None:
        """Take the numbers of messages of one connection: in the recording, and as published."""
        if connection not in self._waiting:
            self._waiting[connection] = array("q"), array("q")
        for kept, new in zip(self._waiting[connection], (numbers, sequences), strict=True):
            kept.frombytes(np.ascontiguousarray(new, dtype=np.int64).tobytes())

    def count_across(self, sources: IntArray, sequences: IntArray) -> None:
        """Look at the numbers of all messages in turn: a recorder may count them itself."""
        across = sources[1:] != sources[:-1]
        self._steps += int(across.sum())
        self._steps_of_one += int((np.diff(sequences)[across] == 1).sum())

    @property
    def of_recorder(self) -> bool:
        """Whether the numbers are a count of all messages of the recording, which says nothing of a topic."""
        return self._steps > 0 and 2 * self._steps_of_one > self._steps

    def of(self, connection: Connection, numbers: IntArray) -> IntArray | None:
        """The published numbers of some messages, given by their numbers in the recording."""
        if connection not in self._waiting:
            return None
        known, sequences = (np.frombuffer(part, dtype=np.int64) for part in self._waiting[connection])
        places = np.minimum(np.searchsorted(known, numbers), len(known) - 1)
        found: IntArray = sequences[places]
        return found if np.array_equal(known[places], numbers) else None


class TopicNumbering:
    """Who sent the messages of one channel of a log map, and what their numbers show."""

    def __init__(self) -> None:
        self._sent: dict[Connection, _Sent] = {}

    def take(
        self, connection: Connection, numbers: IntArray, stamps_ns: IntArray, sequences: IntArray | None
    ) -> None:
        """Take messages of a connection.

        Args:
            connection: Of all of them.
            numbers: Their numbers in the recording, shape (n,).
            stamps_ns: The stamps that count, ns, shape (n,).
            sequences: What their publisher numbered them, shape (n,); `None` where nobody did.
        """
        self._sent.setdefault(connection, _Sent()).take(numbers, stamps_ns, sequences)

    def unknown(
        self,
        builder: TrialBuilder,
        topic: str,
        to_trial_s: Callable[[IntArray], FloatArray],
        *,
        numbered: bool,
        shared: bool = False,
    ) -> Unknown:
        """Note what is missing or contested as defects; returns the stretches of which nothing is known.

        Args:
            builder: Takes the defects.
            topic: Whose messages they are.
            to_trial_s: Stamps, ns, as trial time, s.
            numbered: Whether the numbers are those of publishers.
            shared: Whether it is a topic that many publishers share, each with its own part.
        """
        found = Unknown()
        for one in self.missing() if numbered else ():
            found.holes.extend(spans_of(one.holes_ns, to_trial_s))
            found.lost += one.count
            message = (
                f"the numbers of {one.publisher or 'their publisher'} leave out messages in "
                f"{len(one.holes_ns)} place(s), the first behind {found.holes[0].start_s:.3f} s; "
                "nothing is known there"
            )
            builder.defect("missing_messages", topic, one.count, message)
        both = [] if shared else self.contested()
        if numbered and not both and not shared and (one_connection := self.interleaved):
            both = [one_connection]
        for stretch in both:
            (span,) = spans_of([(stretch.first_ns, stretch.last_ns)], to_trial_s)
            found.contested.append(span)
            note_contested(builder, topic, stretch, span)
        return found

    def missing(self) -> list[Missing]:
        """What the numbers of each publisher show to be missing."""
        found = (_missing(connection.publisher, sent) for connection, sent in self._sent.items())
        return [one for one in found if one is not None]

    def contested(self) -> list[Contested]:
        """The stretches in which two publishers sent messages; one that follows another is its restart."""
        return list(contested((c.publisher, s.count, s.first_ns, s.last_ns) for c, s in self._sent.items()))

    @property
    def interleaved(self) -> Contested | None:
        """The stretch in which the numbers of one connection run to and fro: it carries two publishers."""
        for connection, sent in self._sent.items():
            sequences = np.frombuffer(sent.sequences, dtype=np.int64)
            back = np.flatnonzero(np.diff(sequences) < 0)
            # A few are a restart, or messages that overtook each other.
            if len(back) > max(3, len(sequences) // 100):
                stamps_ns = np.frombuffer(sent.stamps_ns, dtype=np.int64)
                ends = int(stamps_ns[back[0]]), int(stamps_ns[back[-1] + 1])
                who = (f"{connection.publisher}, numbered in two ways", sent.count)
                return Contested(min(ends), max(ends), (who,))
        return None


def note_contested(builder: TrialBuilder, where: str, stretch: Contested, span: Span) -> None:
    """Note a stretch that two publishers contest as a defect."""
    message = (
        f"two publishers at a time, {stretch.words}, from {span.start_s:.3f} to {span.end_s:.3f} s; nothing "
        "says which of them is right, so nothing is known there"
    )
    builder.defect("two_publishers", where, min(count for _, count in stretch.publishers), message)


def spans_of(
    stretches_ns: Sequence[tuple[int, int]], to_trial_s: Callable[[IntArray], FloatArray]
) -> list[Span]:
    """Stretches given by their stamps, ns, in trial time."""
    ends_s = to_trial_s(np.array(stretches_ns, dtype=np.int64).reshape(-1)).reshape(-1, 2)
    return [Span(start_s, end_s) for start_s, end_s in ends_s.tolist()]


def contested(sent: Iterable[tuple[str, int, int, int]]) -> Iterator[Contested]:
    """Where the time of one publisher and that of another overlap.

    Args:
        sent: Of each connection its publisher, its number of messages, its first and its last stamp, ns.

    >>> [one.words for one in contested([("/a", 9, 0, 10), ("/b", 2, 4, 6), ("/c", 1, 11, 11)])]
    ['/a (9) and /b (2)']
    """
    some = sorted(one for one in sent if one[1])  # not by who came first, which decoding may change
    for place, (name, count, first_ns, last_ns) in enumerate(some):
        for other, other_count, other_first_ns, other_last_ns in some[place + 1 :]:
            start_ns, end_ns = max(first_ns, other_first_ns), min(last_ns, other_last_ns)
            if (name != other or not name) and start_ns <= end_ns:
                yield Contested(start_ns, end_ns, ((name, count), (other, other_count)))


def _missing(publisher: str, sent: _Sent) -> Missing | None:
    """What is missing between numbers that mostly follow each other; `None` where nothing is."""
    stamps_ns, sequences = (np.frombuffer(part, dtype=np.int64) for part in (sent.stamps_ns, sent.sequences))
    if len(sequences) < 3:
        return None
    steps = np.diff(sequences)
    steps = np.where(steps < -_WRAP // 2, steps + _WRAP, steps)  # after 2^32 messages they begin anew
    # Somebody who sets the field to something else than a count is not numbering. Of two in the middle the
    # smaller counts: a topic of three events of which one is gone has as many steps of one as of two.
    if np.sort(steps)[(len(steps) - 1) // 2] != 1:
        return None
    places = np.flatnonzero(steps > 1)  # a step back is a restart of the publisher: nothing is known of it
    if not len(places):
        return None
    ends = np.sort(np.stack((stamps_ns[places], stamps_ns[places + 1])), axis=0).T
    holes: Sequence[tuple[int, int]] = [(int(start), int(end)) for start, end in ends.tolist()]
    return Missing(publisher, int((steps[places] - 1).sum()), tuple(holes))
