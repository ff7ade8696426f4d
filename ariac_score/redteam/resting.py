"""A robot that stands still: a human comes to it, or it stops when one comes; or it only says that it does.

Which fields and frames are whose is what the log map says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from itertools import product

from ariac_score.logs.containers.items import Message
from ariac_score.redteam.attempt import Attempt
from ariac_score.redteam.honest import Honest
from ariac_score.redteam.motion import Weight, bump, mixed, set_value, value_at
from ariac_score.testing.copies import Copy, changed, fields_of
from ariac_score.trial.channels import Channel
from ariac_score.trial.spans import Span

__all__ = ["said_slower", "stood_still"]

_RAMPS_S = (3.0, 1.5)
"""So long it takes a robot to come to rest, and a human to come near; the shorter where time is short."""

_STAYS_S = 2.0
_APART_S = 0.5
_SPEEDS = ("speed", "velocity")


def stood_still(honest: Honest, _: int) -> Iterator[Attempt]:
    """A human comes as near as at the worst, to a robot that rests; the robot rests during each violation."""
    robot = _Robot(honest)
    if not robot.is_known:
        return
    visits = ((ramp_s, stays) for ramp_s in _RAMPS_S for stays in _clear_stretches(honest, ramp_s))
    for (ramp_s, stays), (_span, worst_s) in product(visits, honest.violations):
        yield _visited(robot, worst_s, stays, ramp_s)
    for span, _worst in honest.violations:
        yield _stopped(honest, robot, span)


def _clear_stretches(honest: Honest, ramp_s: float) -> Iterator[Span]:
    """Stretches, with time before and behind them to come to rest and to go on, in which all was well."""
    window, needs_s = honest.window, 2 * ramp_s + _STAYS_S + _APART_S
    t_s = window.start_s + 2 * ramp_s + _APART_S
    while t_s + needs_s < window.end_s:
        around = Span(t_s - 2 * ramp_s - _APART_S, t_s + needs_s)
        if all(s.end_s < around.start_s or s.start_s > around.end_s for s, _ in honest.violations):
            yield Span(t_s, t_s + _STAYS_S)
            t_s += needs_s
        t_s += 1.0


def _visited(robot: _Robot, worst_s: float, stays: Span, ramp_s: float) -> Attempt:
    rests = bump(stays.start_s - ramp_s - _APART_S, stays.end_s + ramp_s + _APART_S, ramp_s)
    comes = bump(stays.start_s, stays.end_s, ramp_s)
    says = (
        f"let the robot stand still, and a human come to it as near as at {worst_s:.3f} s, from "
        f"{stays.start_s:.3f} s to {stays.end_s:.3f} s"
    )
    return Attempt.of(says, lambda: robot.resting(worst_s, rests, comes))


def _stopped(honest: Honest, robot: _Robot, span: Span) -> Attempt:
    rests = bump(span.start_s - _APART_S, span.end_s + _APART_S, _RAMPS_S[0])
    at_s = max(span.start_s - _APART_S, honest.window.start_s)
    says = f"let the robot stand still from {span.start_s:.3f} s to {span.end_s:.3f} s"
    return Attempt.of(says, lambda: robot.resting(at_s, rests, lambda _t_s: 0.0))


def said_slower(honest: Honest, _: int) -> Iterator[Attempt]:
    """The log says of each body, and of all, that it does not move during each violation, or half as fast."""
    fields = {c.topic: _speeds(c) for c in honest.prepared.log_map.channels if c.topic in honest.motion}
    bodies = sorted({body for found in fields.values() for body, _path in found})
    for span, _worst in honest.violations:
        for share in (0.0, 0.5):
            for chosen in (*([body] for body in bodies), *([bodies] if len(bodies) > 1 else [])):
                yield _slowed(honest, fields, chosen, span, share)


def _speeds(channel: Channel) -> list[tuple[str, str]]:
    """The fields of a topic that say how fast a body is: its name, and the path."""
    found = []
    for one in channel.signals:
        quantity, *bodies = one.signal.split("/")
        if quantity in _SPEEDS and len(bodies) == 1:
            found += [(bodies[0], path) for path in one.fields]
    return found


def _slowed(
    honest: Honest, fields: dict[str, list[tuple[str, str]]], bodies: list[str], span: Span, share: float
) -> Attempt:
    around = Span(span.start_s - _APART_S, span.end_s + _APART_S)

    def one(message: Message) -> Message:
        paths = [path for body, path in fields.get(message.connection.topic, ()) if body in bodies]
        if not paths or not around.start_s <= honest.t_s(message) <= around.end_s:
            return message
        found = fields_of(message)
        for path in paths:
            set_value(found, path, value_at(found, path) * share)
        return changed(message, found)

    much = "that it stands" if share == 0 else "half of its speed"
    says = f"say of {', '.join(bodies)} from {around.start_s:.3f} s to {around.end_s:.3f} s {much}"
    return Attempt.of(says, lambda: honest.copy.with_changed(one))


class _Robot:
    """What in a log is the robot's."""

    def __init__(self, honest: Honest) -> None:
        self._honest, log_map = honest, honest.prepared.log_map
        self._bodies = {body.id for body in log_map.bodies if body.kind == "robot"}
        self._frames = [match.match for match in log_map.frames if match.kind == "robot"]
        self._channels = {c.topic: c for c in log_map.channels if c.topic in honest.motion}

    @property
    def is_known(self) -> bool:
        """Whether the log map says of something that moves that it is the robot's, and can be held."""
        return any(
            (channel.poses == "frames" and self._frames) or any(self._own(channel))
            for channel in self._channels.values()
        )

    def _own(self, channel: Channel) -> Iterator[tuple[str, str]]:
        """The robot's own quantities on a topic, each with the path of a field."""
        for one in channel.signals:
            quantity, *bodies = one.signal.split("/")
            if len(bodies) == 1 and (bodies[0] in self._bodies or bodies[0] == "robot"):
                yield from ((quantity, path) for path in one.fields)

    def resting(self, near_s: float, rests: Weight, comes: Weight) -> Copy:
        """The recording in which the robot rests and a human comes, as far as two weights say.

        Args:
            near_s: Whose states these go towards, s.
            rests: How far the robot's does.
            comes: How far all else does.
        """
        table: dict[int, Message] = {}
        for (topic, *names), series in self._honest.moving.series.items():
            channel, goal = self._channels[topic], series.at(near_s)
            is_frame = channel.poses == "frames" and any(
                fnmatchcase(names[-1], pattern) for pattern in self._frames
            )
            own = list(self._own(channel))
            for at_s, message, fields in zip(series.t_s, series.messages, series.fields, strict=True):
                rest, come = rests(at_s), comes(at_s)
                if not rest and not come:
                    continue
                new = mixed(fields, goal, rest if is_frame else come)
                for quantity, path in own:
                    set_value(new, path, _held(quantity, rest)(value_at(fields, path), value_at(goal, path)))
                table[id(message)] = changed(message, new)
        return self._honest.moving.replaced(table)


def _held(quantity: str, rest: float) -> Callable[[float, float], float]:
    """What a number of a robot is that comes to rest: its speeds are 0 there, all else as it was then."""
    if quantity in _SPEEDS:
        return lambda now, _goal: now * (1.0 - rest)
    return lambda now, goal: goal if rest == 1 else now + (goal - now) * rest
