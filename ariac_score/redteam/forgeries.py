"""Saying something else: other frames, second publishers, other times, motion that was not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from ariac_score.logs.containers.items import Connection, Message
from ariac_score.redteam.attempt import Attempt
from ariac_score.redteam.honest import Honest
from ariac_score.redteam.motion import bump, later
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.testing.copies import Copy, changed, fields_of
from ariac_score.trial.spans import Span

__all__ = [
    "clocked",
    "jumped",
    "moved",
    "put_in",
    "reparented",
    "replayed",
    "republished",
    "rewritten",
    "shifted",
]

CLOCK = "/clock"
_TICK_NS = 100_000_000

_GHOST_NS = 3_000_000
_FAR = 50.0
"""So many times the way to where all was well."""

_PLAYED = 80
"""So many samples are played again at least: a few may well be what they were before, and of less than 75 not
every stretch is told."""


def _clear_s(honest: Honest, span: Span) -> float | None:
    """A time near a stretch at which nothing is violated, s; `None` where there is none."""
    window, reach_s = honest.window, 0.5
    while reach_s < 2 * window.duration_s:
        for t_s in (span.start_s - reach_s, span.end_s + reach_s):
            if window.start_s <= t_s <= window.end_s and honest.is_clear(t_s, 0.25):
                return t_s
        reach_s *= 1.5
    return None


def _over_violations(honest: Honest) -> Iterator[tuple[Span, float]]:
    """Each violation, with a time at which all was well."""
    for span, _ in honest.violations:
        clear_s = _clear_s(honest, span)
        if clear_s is not None and honest.motion:
            yield span, clear_s


def rewritten(honest: Honest, seed: int) -> Iterator[Attempt]:
    """Motion is written anew over a violation, smoothly, as it was when all was well; first: nothing."""
    yield Attempt.of("write the log anew, without the numbers of publishers", lambda: honest.copy)
    rng = Random(f"rewritten:{seed}")  # noqa: S311  # no secrets are made of it
    found = list(_over_violations(honest))
    for span, clear_s in found:
        yield _smoothed(honest, span, clear_s, 2.0)
    while found:
        span, clear_s = rng.choice(found)
        yield _smoothed(honest, span, clear_s, rng.uniform(0.3, 6.0))


def _smoothed(honest: Honest, span: Span, clear_s: float, ramp_s: float) -> Attempt:
    says = f"write the motion from {span.start_s:.3f} s to {span.end_s:.3f} s anew: as at {clear_s:.3f} s"
    return Attempt.of(says, lambda: honest.moving.towards(clear_s, bump(span.start_s, span.end_s, ramp_s)))


def jumped(honest: Honest, _: int) -> Iterator[Attempt]:
    """Motion is far away for the length of a violation, and of its worst, without any way there and back.

    Where the way is so short that anything could move so, it is motion that is rewritten.
    """
    for span, worst_s in honest.violations:
        clear_s = _clear_s(honest, span)
        for stretch in (span, Span(worst_s - 0.02, worst_s + 0.02)) if clear_s is not None else ():
            yield _jump(honest, stretch, clear_s)  # type: ignore[arg-type]


def _jump(honest: Honest, span: Span, clear_s: float) -> Attempt:
    inside = bump(span.start_s, span.end_s, 1e-9)
    says = f"put all far away from {span.start_s:.3f} s to {span.end_s:.3f} s"
    return Attempt.of(says, lambda: honest.moving.towards(clear_s, lambda t_s: _FAR * inside(t_s)))


def replayed(honest: Honest, _: int) -> Iterator[Attempt]:
    """Over a violation is played what came before or after it, so long that it is told from chance."""
    for span, _worst in honest.violations:
        sampled_s = max((one.step_s for one in honest.moving.series.values()), default=0.0)
        half_s = max(0.5, (_PLAYED * sampled_s - span.duration_s) / 2)
        stretch = Span(span.start_s - half_s, span.end_s + half_s)
        for factor in (1.0, 1.5, 2.0, -1.0, -1.5, -2.0) if honest.motion else ():
            lag_s = factor * (stretch.duration_s + 0.1)
            begin_s, end_s = stretch.start_s - lag_s, stretch.end_s - lag_s
            if begin_s >= honest.window.start_s and end_s <= honest.window.end_s:
                yield _replay(honest, stretch, lag_s)


def _replay(honest: Honest, span: Span, lag_s: float) -> Attempt:
    word = "before" if lag_s > 0 else "after"
    says = f"play over {span.start_s:.3f} s to {span.end_s:.3f} s what was {abs(lag_s):.3f} s {word}"
    return Attempt.of(says, lambda: honest.moving.played(span.start_s, span.end_s, lag_s))


def republished(honest: Honest, _: int) -> Iterator[Attempt]:
    """A second publisher says that all is well, during each violation; where the format keeps publishers."""
    if honest.copy.suffix == ".bag":
        yield from _said_twice(honest, named=True)


def put_in(honest: Honest, _: int) -> Iterator[Attempt]:
    """Samples in between say that all is well, during each violation."""
    yield from _said_twice(honest, named=False)


def _said_twice(honest: Honest, *, named: bool) -> Iterator[Attempt]:
    who = "a second publisher says" if named else "put in samples that say"
    for span, clear_s in _over_violations(honest):
        says = f"{who} from {span.start_s:.3f} s to {span.end_s:.3f} s that all is as at {clear_s:.3f} s"
        yield Attempt.of(says, _ghost(honest, span, clear_s, named=named))


def _ghost(honest: Honest, span: Span, clear_s: float, *, named: bool) -> Callable[[], Copy]:
    def change() -> Copy:
        ghosts: dict[Connection, Connection] = {}
        doctored = honest.moving.towards(clear_s, bump(span.start_s, span.end_s, 1e-9))
        originals = {id(message) for message in honest.copy.messages}
        more = []
        for message in doctored.messages:
            if id(message) in originals:
                continue
            own = message.connection
            other = ghosts.setdefault(own, replace(own, publisher="/ghost") if named else own)
            more.append(later(message, _GHOST_NS)._replace(connection=other))
        return honest.copy.with_more(more)

    return change


def reparented(honest: Honest, _: int) -> Iterator[Attempt]:
    """Each frame that moves hangs under one that is elsewhere, during each violation, or all the time."""
    channels = {c.topic for c in honest.prepared.log_map.channels if c.poses == "frames"}
    topics = [topic for topic in honest.motion if topic in channels]
    frames = sorted({key[-1] for key in (honest.moving.series if topics else {}) if key[0] in topics})
    spans = [span for span, _ in honest.violations]
    for frame in frames:
        for span in (*spans, honest.window):
            says = f"hang {frame!r} under a frame of its own from {span.start_s:.3f} s to {span.end_s:.3f} s"
            yield Attempt.of(says, _hung(honest, topics, frame, span))


def _hung(honest: Honest, topics: list[str], frame: str, span: Span) -> Callable[[], Copy]:
    def one(message: Message) -> Message:
        if message.connection.topic not in topics or not span.start_s <= honest.t_s(message) <= span.end_s:
            return message
        fields = fields_of(message)
        mine = [sent for sent in fields.transforms if sent.child_frame_id == frame]
        for sent in mine:
            sent.header.frame_id = "elsewhere"
        return changed(message, fields) if mine else message

    return lambda: honest.copy.with_changed(one)


def shifted(honest: Honest, seed: int) -> Iterator[Attempt]:
    """All motion is of another time, so that a violation lies outside of what counts; or by chance."""
    rng = Random(f"shifted:{seed}")  # noqa: S311  # no secrets are made of it
    if not honest.motion or len(honest.motion) == len(honest.copy.topics):
        return  # nothing to be later or earlier than
    window = honest.window
    for span, _ in honest.violations:
        yield _shift(honest, window.end_s - span.start_s + 0.5)
        yield _shift(honest, window.start_s - span.end_s - 0.5)
    while True:
        yield _shift(honest, rng.choice((-1, 1)) * 10 ** rng.uniform(-2, 1.5))


def _shift(honest: Honest, by_s: float) -> Attempt:
    """Motion is later; or all else is, for no time may be below 0."""
    topics = frozenset(honest.motion)
    by_ns = round(abs(by_s) * 1e9)

    def one(message: Message) -> Message:
        return later(message, by_ns) if (message.connection.topic in topics) == (by_s > 0) else message

    says = f"stamp {'all motion' if by_s > 0 else 'all but motion'} {abs(by_s):.3f} s later"
    return Attempt.of(says, lambda: honest.copy.with_changed(one))


def clocked(honest: Honest, _: int) -> Iterator[Attempt]:
    """A clock is put in that says that the simulation was slower, or faster, than the log has it."""
    if CLOCK in honest.copy.topics:
        return
    for rate in (0.5, 2.0, 0.1, 0.9, 5.0):
        yield Attempt.of(
            f"put in a {CLOCK} of a simulation that runs {rate:g} times as fast", _ticking(honest, rate)
        )


def _ticking(honest: Honest, rate: float) -> Callable[[], Copy]:
    def change() -> Copy:
        first_ns, last_ns = honest.copy.messages[0].stamp_ns, honest.copy.messages[-1].stamp_ns
        ticks = []
        for t_ns in range(first_ns, last_ns + 1, _TICK_NS):
            sec, nanosec = divmod(round((t_ns - first_ns) * rate), 10**9)
            fields = {"clock": {"sec": sec, "nanosec": nanosec}}
            ticks.append(Recorded(CLOCK, "rosgraph_msgs/msg/Clock", t_ns, fields))
        ros1 = honest.copy.suffix == ".bag"
        with TemporaryDirectory() as folder:
            file = Path(folder, "clock").with_suffix(honest.copy.suffix)
            more = Copy.of(write_bag(file, ticks, storage="ros1" if ros1 else "mcap"))
        return honest.copy.with_more(more.messages)

    return change


def moved(honest: Honest, seed: int) -> Iterator[Attempt]:
    """Each message that says what happened is of another time: start, end, outside; by chance."""
    rng = Random(f"moved:{seed}")  # noqa: S311  # no secrets are made of it
    window = honest.window
    told = [m for topic in honest.telling for m in honest.copy.of_topic(topic)]
    goals = (window.start_s + 0.001, window.end_s - 0.001, window.end_s + 0.5, window.start_s - 0.2)
    for goal_s in goals:
        for message in told:
            yield _move(honest, message, goal_s)
    while told:
        yield _move(honest, rng.choice(told), rng.uniform(window.start_s, window.end_s))


def _move(honest: Honest, message: Message, goal_s: float) -> Attempt:
    at_s = honest.t_s(message)
    by_ns = round((goal_s - at_s) * 1e9)

    def one(other: Message) -> Message:
        return later(other, by_ns) if other is message else other

    says = f"stamp the message on {message.connection.topic} at {at_s:.3f} s with {goal_s:.3f} s"
    return Attempt.of(says, lambda: honest.copy.with_changed(one))
