"""Doing something else: violations joined, deepened, made longer and added; stopping; waiting; again.

What is done is made of states that were recorded, so that it could have been done. That it is worse, and not
merely other, is not taken on faith: the checks measure it (`harm_of`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from random import Random

from ariac_score.logs.containers.items import Message
from ariac_score.redteam.attempt import Attempt
from ariac_score.redteam.honest import Honest
from ariac_score.redteam.motion import Motion, bump, later
from ariac_score.testing.copies import Copy
from ariac_score.trial.spans import Span

__all__ = [
    "added",
    "calm_run_beside",
    "deepened",
    "joined",
    "lengthened",
    "rearranged",
    "run_again",
    "stopped",
    "waited",
]


def joined(honest: Honest, _: int) -> Iterator[Attempt]:
    """What lies between two violations is a violation as well."""
    spans = sorted({span for span, _ in honest.violations}, key=lambda span: span.start_s)
    for before, after in pairwise(spans):
        if after.start_s > before.end_s:
            yield _joined(honest, before.end_s, after.start_s)
    for before, _mid, after in zip(spans, spans[1:], spans[2:], strict=False):
        yield _joined(honest, before.end_s, after.start_s)


def _joined(honest: Honest, first_s: float, last_s: float) -> Attempt:
    edge_s = 0.2  # inside both, so that what lies between is no shallower than their ends
    says = f"stay as near from {first_s:.3f} s to {last_s:.3f} s as before and after"
    return Attempt.of(says, lambda: honest.moving.straight(first_s - edge_s, last_s + edge_s))


def deepened(honest: Honest, seed: int) -> Iterator[Attempt]:
    """A violation is as bad as at its worst, or as at the worst of all, while it lasts and no longer."""
    rng = Random(f"deepened:{seed}")  # noqa: S311  # no secrets are made of it
    for span, worst_s in honest.violations:
        yield _held_within(honest, span, worst_s, 0.2)
    while honest.violations:
        span, worst_s = rng.choice(honest.violations)[0], rng.choice(honest.violations)[1]
        yield _held_within(honest, span, worst_s, rng.uniform(0.05, 0.45))


def _held_within(honest: Honest, span: Span, worst_s: float, share: float) -> Attempt:
    ramp_s = share * span.duration_s
    return _held(honest, Span(span.start_s + ramp_s, span.end_s - ramp_s), worst_s, max(ramp_s, 1e-9))


def lengthened(honest: Honest, seed: int) -> Iterator[Attempt]:
    """A violation lasts longer."""
    rng = Random(f"lengthened:{seed}")  # noqa: S311  # no secrets are made of it
    while honest.violations:
        span, worst_s = rng.choice(honest.violations)
        more_s = 10 ** rng.uniform(-0.5, 1.0)
        yield _held(honest, Span(span.start_s, min(span.end_s + more_s, honest.window.end_s)), worst_s, 1.0)


def added(honest: Honest, seed: int) -> Iterator[Attempt]:
    """It is as bad again at another time, for a moment or longer."""
    rng = Random(f"added:{seed}")  # noqa: S311  # no secrets are made of it
    window = honest.window
    while honest.violations and window.duration_s > 2.0:
        _, worst_s = rng.choice(honest.violations)
        first_s = rng.uniform(window.start_s, window.end_s)
        last_s = min(first_s + 10 ** rng.uniform(-1, 0.8), window.end_s)
        yield _held(honest, Span(first_s, last_s), worst_s, rng.choice((1.0, 2.0, 4.0)))


def _held(honest: Honest, span: Span, worst_s: float, ramp_s: float) -> Attempt:
    says = f"come as near from {span.start_s:.3f} s to {span.end_s:.3f} s as at {worst_s:.3f} s"
    return Attempt.of(says, lambda: honest.moving.towards(worst_s, bump(span.start_s, span.end_s, ramp_s)))


def rearranged(honest: Honest, seed: int) -> Iterator[Attempt]:
    """A violation is broken in two by a pause, and goes on as much longer."""
    rng = Random(f"rearranged:{seed}")  # noqa: S311  # no secrets are made of it
    found = [(span, worst_s) for span, worst_s in honest.violations if span.duration_s > 0.5]
    while found:
        span, worst_s = rng.choice(found)
        clear = [t_s for t_s in (span.start_s - 1.0, span.end_s + 1.0) if honest.is_clear(t_s)]
        if not clear:
            return
        middle_s, pause_s = (span.start_s + span.end_s) / 2, 10 ** rng.uniform(-0.5, 0.5)
        longer = Span(span.start_s, min(span.end_s + 2 * pause_s + 2.0, honest.window.end_s))
        yield _broken_in_two(honest, longer, worst_s, clear[0], Span(middle_s, middle_s + pause_s))


def _broken_in_two(honest: Honest, span: Span, worst_s: float, clear_s: float, pause: Span) -> Attempt:
    inside, outside = bump(span.start_s, span.end_s, 0.2), bump(pause.start_s, pause.end_s, 0.3)

    def change() -> Copy:
        near = honest.moving.towards(worst_s, inside)
        return Motion(near, honest.motion, honest.t_s, honest.follows).towards(clear_s, outside)

    says = f"break off from {pause.start_s:.3f} s to {pause.end_s:.3f} s, and go on to {span.end_s:.3f} s"
    return Attempt.of(says, change)


# Less, or again -------------------------------------------------------------------------


def stopped(honest: Honest, seed: int) -> Iterator[Attempt]:
    """The trial ends: before each violation, behind each submission, at tenths of the time; by chance."""
    rng = Random(f"stopped:{seed}")  # noqa: S311  # no secrets are made of it
    window = honest.window
    told = sorted({honest.t_s(m) for topic in honest.telling for m in honest.copy.of_topic(topic)})
    times = [span.start_s - 0.5 for span, _ in honest.violations]
    times += [t_s + 0.1 for t_s in reversed(told)]
    times += [window.start_s + window.duration_s * tenth / 10 for tenth in range(9, 0, -1)]
    for t_s in dict.fromkeys(times):
        if window.start_s + 0.1 < t_s < window.end_s - 0.1:
            yield _stop(honest, t_s)
    while window.duration_s > 1.0:
        yield _stop(honest, rng.uniform(window.start_s + 0.1, window.end_s - 0.1))


def _stop(honest: Honest, t_s: float) -> Attempt:
    return Attempt.of(f"stop at {t_s:.3f} s", lambda: ended_at(honest, t_s))


def ended_at(honest: Honest, t_s: float) -> Copy:
    """The recording of a trial that ended at a time: what said so comes then, and nothing after it."""
    ends = _endings(honest)
    by_ns = round((t_s - honest.window.end_s) * 1e9)

    def one(message: Message) -> Message:
        return later(message, by_ns) if id(message) in ends else message

    cut = honest.copy.keeping(lambda m: id(m) in ends or honest.t_s(m) <= t_s + 0.5)
    return cut.with_changed(one)


def _endings(honest: Honest) -> frozenset[int]:
    """The messages, by `id`, that say that the competition is over."""
    end_s = honest.window.end_s
    topics = frozenset(honest.telling)
    return frozenset(
        id(m)
        for m in honest.copy.messages
        if m.connection.topic in topics and abs(honest.t_s(m) - end_s) < 1e-6
    )


def waited(honest: Honest, _: int) -> Iterator[Attempt]:
    """The trial ends later, and until then nothing moves."""
    for more_s in (10.0, 30.0, 100.0):
        yield Attempt.of(f"do nothing for {more_s:g} s before the end", _waiting(honest, more_s))


def _waiting(honest: Honest, more_s: float) -> Callable[[], Copy]:
    def change() -> Copy:
        end_s, more_ns = honest.window.end_s, round(more_s * 1e9)
        more: list[Message] = []
        for series in honest.moving.series.values() if honest.motion else ():
            before = [m for m in series.messages if honest.t_s(m) < end_s]
            steps = [b.stamp_ns - a.stamp_ns for a, b in pairwise(before)]
            step_ns = sorted(steps)[len(steps) // 2] if steps else 0
            for number in range(1, int(more_ns / step_ns) + 1) if step_ns > 0 else ():
                more.append(later(before[-1], number * step_ns))

        def one(message: Message) -> Message:
            return later(message, more_ns) if honest.t_s(message) >= end_s - 1e-6 else message

        return honest.copy.with_changed(one).with_more(more)

    return change


def run_again(honest: Honest, _: int) -> Iterator[Attempt]:
    """The same once more, and twice."""
    for times in (2, 3):
        yield Attempt(f"hand in the same run {times} times", lambda times=times: (honest.copy,) * times)  # type: ignore[misc]


def calm_run_beside(honest: Honest, _: int) -> Iterator[Attempt]:
    """A second run, in which nothing is done."""
    start_s = honest.window.start_s
    for after_s in (0.5, 5.0):
        says = f"hand in a second run, stopped {after_s:g} s after its start"
        yield Attempt(says, lambda after_s=after_s: (honest.copy, ended_at(honest, start_s + after_s)))  # type: ignore[misc]
