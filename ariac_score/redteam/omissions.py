"""Leaving out: single messages, whole topics, stretches of samples, every so many of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import count
from random import Random

from ariac_score.logs.containers.items import Message
from ariac_score.redteam.attempt import Attempt
from ariac_score.redteam.honest import Honest
from ariac_score.testing.copies import Copy
from ariac_score.trial.spans import Span

__all__ = ["messages_left_out", "recording_cut", "samples_left_out", "thinned", "topics_left_out"]

_FACTORS = (2, 4, 10, 3, 20, 5)
_AROUND_S = (0.0, 0.05, 0.5)


def _without(honest: Honest, left_out: Iterable[Message]) -> Callable[[], Copy]:
    gone = {id(message) for message in left_out}
    return lambda: honest.copy.keeping(lambda message: id(message) not in gone)


def messages_left_out(honest: Honest, seed: int) -> Iterator[Attempt]:
    """Each message that says what happened or was ordered; first what is between start and end, and rare."""
    rng = Random(f"messages:{seed}")  # noqa: S311  # no secrets are made of it
    told = [m for topic in honest.telling for m in honest.copy.of_topic(topic)]
    often = Counter(m.connection.topic for m in told)
    start_s, end_s = honest.window.start_s + 1e-3, honest.window.end_s - 1e-3

    def unpromising(message: Message) -> tuple[bool, int, str, int]:
        topic, t_s = message.connection.topic, honest.t_s(message)
        return not start_s < t_s < end_s, often[topic], topic, -message.stamp_ns

    told.sort(key=unpromising)
    for message in told:
        yield _one_left_out(honest, message)
    while len(told) > 2:
        chosen = rng.sample(told, rng.randint(2, min(4, len(told) - 1)))
        parts = tuple(sorted(chosen, key=lambda m: m.stamp_ns))
        where = ", ".join(f"{m.connection.topic} at {honest.t_s(m):.3f} s" for m in parts)
        yield Attempt.of(
            f"leave out the messages {where}",
            _without(honest, parts),
            lambda parts=parts: (_one_left_out(honest, m) for m in parts),  # type: ignore[misc]
        )


def _one_left_out(honest: Honest, message: Message) -> Attempt:
    where = f"{message.connection.topic} at {honest.t_s(message):.3f} s"
    return Attempt.of(f"leave out the message on {where}", _without(honest, [message]))


def topics_left_out(honest: Honest, _: int) -> Iterator[Attempt]:
    """Each topic, then all that say something, then all about motion."""
    for topic in (*honest.telling, *honest.motion):
        yield Attempt.of(f"leave out {topic}", _without(honest, honest.copy.of_topic(topic)))
    for topics in (honest.telling, honest.motion):
        if len(topics) > 1:
            left_out = [m for topic in topics for m in honest.copy.of_topic(topic)]
            yield Attempt.of(f"leave out {', '.join(topics)}", _without(honest, left_out))


def samples_left_out(honest: Honest, seed: int) -> Iterator[Attempt]:
    """The samples of each violation, all of them or a few about the worst; then stretches by chance."""
    rng = Random(f"samples:{seed}")  # noqa: S311  # no secrets are made of it
    for around_s in _AROUND_S:
        for span, worst_s in honest.violations:
            yield _stretch(honest, Span(span.start_s - around_s, span.end_s + around_s))
            near = 0.02 + around_s / 5
            yield _stretch(honest, Span(worst_s - near, worst_s + near))
    window = honest.window
    while honest.motion and window.duration_s > 0:
        middle_s = rng.uniform(window.start_s, window.end_s)
        if honest.violations and rng.random() < 0.7:  # near the edges of a violation, most is to be had
            span, _ = rng.choice(honest.violations)
            middle_s = rng.choice((span.start_s, span.end_s))
        half_s = 0.5 * 10 ** rng.uniform(-2, 0.5)
        yield _stretch(honest, Span(max(middle_s - half_s, 0.0), middle_s + half_s))


def _stretch(honest: Honest, span: Span) -> Attempt:
    """All samples of a stretch are left out; less of it are its halves."""
    left_out = [
        m
        for topic in honest.motion
        for m in honest.copy.of_topic(topic)
        if span.start_s <= honest.t_s(m) <= span.end_s
    ]

    def smaller() -> Iterator[Attempt]:
        middle_s = (span.start_s + span.end_s) / 2
        if len(left_out) > 1 and span.duration_s > 1e-3:
            yield _stretch(honest, Span(span.start_s, middle_s))
            yield _stretch(honest, Span(middle_s, span.end_s))

    says = f"leave out the {len(left_out)} samples from {span.start_s:.3f} s to {span.end_s:.3f} s"
    return Attempt.of(says, _without(honest, left_out), smaller)


def recording_cut(honest: Honest, seed: int) -> Iterator[Attempt]:
    """The recording begins later or ends earlier: without a violation, without a half; by chance."""
    rng = Random(f"cut:{seed}")  # noqa: S311  # no secrets are made of it
    window = honest.window
    for span, _ in honest.violations:
        yield _cut(honest, Span(window.start_s - 1.0, span.end_s + 0.5))
        yield _cut(honest, Span(span.start_s - 0.5, window.end_s + 1.0))
    while window.duration_s > 0:
        t_s = rng.uniform(window.start_s, window.end_s)
        yield _cut(honest, rng.choice((Span(window.start_s - 1.0, t_s), Span(t_s, window.end_s + 1.0))))


def _cut(honest: Honest, span: Span) -> Attempt:
    left_out = [m for m in honest.copy.messages if span.start_s <= honest.t_s(m) <= span.end_s]
    if span.start_s < honest.window.start_s:
        return Attempt.of(f"begin to record at {span.end_s:.3f} s", _without(honest, left_out))
    return Attempt.of(f"record no longer than {span.start_s:.3f} s", _without(honest, left_out))


def thinned(honest: Honest, seed: int) -> Iterator[Attempt]:
    """Every so many samples of each series are kept, of one series or all, in every phase."""
    rng = Random(f"thinned:{seed}")  # noqa: S311  # no secrets are made of it
    series = honest.moving.series if honest.motion else {}
    chosen = {" ".join((key[0], *dict.fromkeys(key[2:]))): [one.messages] for key, one in series.items()}
    if len(chosen) > 1:
        chosen["all series"] = [one.messages for one in series.values()]
    for factor in _FACTORS:
        for name, groups in chosen.items():
            yield _every(honest, name, groups, factor, 0)
    while chosen:
        name, factor = rng.choice(list(chosen)), rng.randint(2, 30)
        yield _every(honest, name, chosen[name], factor, rng.randrange(factor))


def _every(
    honest: Honest, name: str, groups: Sequence[Collection[Message]], factor: int, phase: int
) -> Attempt:
    left_out = [m for group in groups for number, m in zip(count(), group) if number % factor != phase]
    says = f"keep one of {factor} samples of {name}, from the {phase + 1}. on"
    return Attempt.of(says, _without(honest, left_out))
