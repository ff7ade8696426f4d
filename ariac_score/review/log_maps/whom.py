"""Who could be the robot, who the human: by names, types, frames and motion."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np

from ariac_score.checks.contracts import Reader
from ariac_score.checks.registry import Registry
from ariac_score.engine.read import read_trial
from ariac_score.errors import ScoreError
from ariac_score.logs.bundle import Bundle
from ariac_score.logs.logmap import load_log_map, log_map_names
from ariac_score.review.log_maps.survey import FRAMES, MODELS, STILL_M, Survey, TopicFields
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, LogMap
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal

__all__ = [
    "ROLES",
    "Candidate",
    "Choice",
    "Scalar",
    "candidates_in",
    "choose",
    "escaped",
    "named",
    "position_fields",
    "same_motion",
    "scalars_in",
    "suffice",
]

ROLES = ("human", "robot")

_HUMANS = ("actor", "human", "humans", "operator", "pedestrian", "people", "person", "skeleton", "visitor")
_ROBOTS = ("arm", "ee", "gripper", "manipulator", "robot", "tcp", "tool", "torso")
_MAKES = ("abb", "fanuc", "fr", "franka", "iiwa", "irb", "kinova", "kuka", "panda", "sawyer", "ur", "yaskawa")
_WORDS: Mapping[str, frozenset[str]] = {
    "human": frozenset((*_HUMANS, "worker")),
    "robot": frozenset((*_ROBOTS, *_MAKES)),
}
_PLACES = frozenset(["location", "place", "point", "position", "translation"])
_STRUCTURE = frozenset(("base_footprint", "earth", "map", "odom", "world"))
"""Frames that are none of a body: places that bodies are put into."""
_SAME_M = 0.05
"""Two places that stay so near to each other are of one body."""


@dataclass(frozen=True)
class Candidate:
    """Something with a position that may be a body.

    Attributes:
        name: A frame, a model, or a topic, with the field after a colon where it has several.
        source: `frame`, `model` or `topic`.
        key: Its body in the trial that was read to look at it.
        kind: What its name says it is: `human`, `robot`, or empty.
        links: Names of what moves with it.
        topic: Of a topic: its name, and the path of the position.
        elsewhere: The frame that its positions are in, where it is not that of the others.
        moves: Whether it, or one of its links, moves.
        signal: Its positions; `None` where they cannot be had, or are in another frame.
        moved_m: How far apart its outermost places are, m.
        fastest_m_s: Its largest speed, m/s.
    """

    name: str
    source: str
    key: str
    kind: str = ""
    links: tuple[str, ...] = ()
    topic: tuple[str, str] = ("", "")
    elsewhere: str = ""
    moves: bool = False
    signal: Signal | None = None
    moved_m: float = 0.0
    fastest_m_s: float = 0.0

    @property
    def words(self) -> str:
        """What was seen of it."""
        if self.elsewhere:
            return f"{self.source} {self.name}: in frame {self.elsewhere}, and not in that of the others"
        if self.signal is None:
            return "its positions cannot be had"
        span_s = float(self.signal.t[-1] - self.signal.t[0])
        rate = f", {(len(self.signal) - 1) / span_s:.1f} Hz" if span_s > 0 else ""
        if self.moved_m > STILL_M:
            motion = f"moves {self.moved_m:.2f} m, at most {self.fastest_m_s:.2f} m/s"
        else:
            motion = "stays where it is, its links move" if self.moves else "does not move"
        late = ", stamped when it arrived" if self.is_late else ""
        return f"{self.source} {self.name}: {motion}{rate}{late}"

    @property
    def is_late(self) -> bool:
        """Whether its places have the times at which they were recorded, by which it seems to jump."""
        return self.signal is not None and self.signal.stamp_jitter_s > 0.0


@dataclass(frozen=True)
class Scalar:
    """A speed or a distance that a topic states.

    Attributes:
        signal: Such as `speed/human`.
        topic: Its name.
        path: Of the field.
    """

    signal: str
    topic: str
    path: str


@dataclass(frozen=True)
class Choice:
    """Who a role is given to.

    Attributes:
        role: `human` or `robot`.
        chosen: Those that it is given to; none while it is open.
        why: In words.
        equal: Between whom to choose, where nothing speaks for one of them.
        others: Those that are left out, each with the reason.
        nobody: Whether somebody said that there is none.
    """

    role: str
    chosen: tuple[Candidate, ...] = ()
    why: str = ""
    equal: tuple[Candidate, ...] = ()
    others: Mapping[str, str] = field(default_factory=dict)
    nobody: bool = False


# Candidates ----------------------------------------------------------------------------


def candidates_in(
    bundle: Bundle,
    readers: Mapping[str, Reader],
    survey: Survey,
    root: str,
    registry: Registry,
    *,
    stamp: str = "",
) -> list[Candidate]:
    """Everything in a log that has positions, with its motion.

    Args:
        bundle: The log.
        readers: By name.
        survey: What the log holds.
        root: The frame that positions are wanted in.
        registry: The installed plugins.
        stamp: `log` to place all messages at their times of recording.

    Raises:
        LogError: The log cannot be read.
    """
    found = [*_frames(survey, root), *_topics(survey, root)]
    places = {c.name: c for c in found}
    matches = [BodyMatch(escaped(c.name), "thing", c.key) for c in places.values() if c.source == "frame"]
    bodies = tuple(Body(c.key, "thing") for c in found if c.source == "topic")
    channels = [Channel(topic.name, poses="frames") for topic in survey.of_type(FRAMES)]
    channels += [Channel(topic.name, poses="models", optional=True) for topic in survey.of_type(MODELS)]
    channels += [_probe(c) for c in found if c.source == "topic" and not c.elsewhere]
    everything = (BodyMatch("*", "thing", links=("*",)),)
    channels = [replace(channel, stamp=stamp) for channel in channels]
    probe = LogMap("probe", tuple(channels), bodies, everything, tuple(matches), root)
    trial = read_trial(bundle, readers, probe, registry, quantities=["position"], work=False)
    known = {c.key for c in found}
    found += [_model(body, trial) for body in trial.bodies if body.id not in known]
    trial = derive_signals(trial, [Derivation("speed", 1.0)])
    matches = _installed_matches(registry)
    return [_seen(_as_installed(candidate, matches), trial) for candidate in found]


def _installed_matches(registry: Registry) -> list[BodyMatch]:
    """The names of robots and humans in the log maps of installed competitions."""
    found = []
    for name in log_map_names(registry):
        try:
            log_map = load_log_map(name, registry=registry)
        except ScoreError:
            continue  # a broken log map names nobody
        found += [match for match in (*log_map.models, *log_map.frames) if match.kind in ROLES]
    return found


def _as_installed(candidate: Candidate, matches: Iterable[BodyMatch]) -> Candidate:
    """A candidate whose name says nothing by itself, as what an installed log map knows it."""
    if candidate.kind or candidate.source == "topic":
        return candidate
    kinds = {match.kind for match in matches if fnmatchcase(candidate.name, match.match)}
    return replace(candidate, kind=kinds.pop()) if len(kinds) == 1 else candidate


def escaped(name: str) -> str:
    """A name as a pattern that fits it alone; braces, which stand for facts in a log map, as any character.

    >>> escaped("person[1]"), escaped("{arm}")
    ('person[[]1]', '?arm?')
    """
    return re.sub(r"[{}]", "?", re.sub(r"([*?\[])", r"[\1]", name))


def _frames(survey: Survey, root: str) -> Iterator[Candidate]:
    """The frames at the top of what hangs below the root, each with the frames that move with it."""
    below: dict[str, list[str]] = {}
    for child in survey.parents:
        chain = survey.chain(child)
        if chain[-1] != root:
            continue
        inner = [frame for frame in reversed(chain) if frame != root and frame not in _STRUCTURE]
        if inner:
            below.setdefault(inner[0], []).append(child)
    turning = {edge.child for edge in survey.edges if edge.moves}
    for number, (top, members) in enumerate(sorted(below.items())):
        inside = [member for member in members if member != top]
        links = tuple(m for m in inside if turning.intersection(survey.chain(m)[: _depth(survey, m, top)]))
        kind = kind_of(top) or next((k for k in map(kind_of, inside) if k), "")
        moves = bool(links) or bool(turning.intersection(survey.chain(top)))
        yield Candidate(top, "frame", f"frame-{number}", kind, links, moves=moves)


def _depth(survey: Survey, member: str, top: str) -> int:
    return survey.chain(member).index(top)


def _topics(survey: Survey, root: str) -> Iterator[Candidate]:
    number = 0
    for topic in survey.topics:
        paths = list(_positions(topic))
        for path in paths:
            name = topic.name if len(paths) == 1 else f"{topic.name}:{path}"
            elsewhere = topic.frame if root and topic.frame not in ("", root) else ""
            kind = kind_of(path) or kind_of(topic.name)
            yield Candidate(name, "topic", f"topic-{number}", kind, (), (topic.name, path), elsewhere)
            number += 1


def _positions(topic: TopicFields) -> Iterator[str]:
    """The paths that are places: x, y and z below a name that says so."""
    is_point = topic.type.rpartition("/")[2] in ("Point", "PointStamped", "Point32")
    for path in topic.numbers:
        prefix, _, axis = path.rpartition(".")
        if axis != "x" or not {f"{prefix}.y".lstrip("."), f"{prefix}.z".lstrip(".")} <= {*topic.numbers}:
            continue
        if is_point or _PLACES & set(_tokens(prefix.rpartition(".")[2])):
            yield prefix


def _probe(candidate: Candidate) -> Channel:
    topic, path = candidate.topic
    fields = position_fields(path)
    return Channel(topic, signals=(FieldMap(f"position/{candidate.key}", "m", fields),))


def position_fields(path: str) -> tuple[str, ...]:
    """The paths of x, y and z below a path."""
    return tuple(f"{path}.{axis}".lstrip(".") for axis in "xyz")


def _model(body: Body, trial: Trial) -> Candidate:
    moving = [
        link for link in body.links if _moved_m(trial.signals.get(f"position/{body.id}::{link}")) > STILL_M
    ]
    return Candidate(body.id, "model", body.id, kind_of(body.id), tuple(body.links), moves=bool(moving))


def _seen(candidate: Candidate, trial: Trial) -> Candidate:
    signal = trial.signals.get(f"position/{candidate.key}")
    moved_m = _moved_m(signal)
    speed = trial.signals.get(f"speed/{candidate.key}")
    fastest = float(speed.values.max()) if speed is not None and len(speed) else 0.0
    moves = candidate.moves or moved_m > STILL_M
    return replace(candidate, signal=signal, moved_m=moved_m, fastest_m_s=fastest, moves=moves)


def _moved_m(signal: Signal | None) -> float:
    if signal is None or not len(signal):
        return 0.0
    extent = signal.values.max(axis=0) - signal.values.min(axis=0)
    return float(np.hypot.reduce(extent))


def _tokens(name: str) -> list[str]:
    """The words of a name, in small letters and without numbers.

    >>> _tokens("ur5_BaseLink/tool0")
    ['ur', 'base', 'link', 'tool']
    """
    parted = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    return [word for word in re.split(r"[^a-z]+", parted.lower()) if word]


def kind_of(name: str) -> str:
    """What a name says that its bearer is; empty where it says nothing, or two things.

    >>> kind_of("/lab/human_pose"), kind_of("panda_link0"), kind_of("torso_base"), kind_of("box")
    ('human', 'robot', 'robot', '')
    """
    words = set(_tokens(name))
    found = [kind for kind, known in _WORDS.items() if words & known]
    return found[0] if found else ""


def scalars_in(survey: Survey) -> list[Scalar]:
    """Speeds and distances of robot and human that topics state, by their names."""
    found = []
    for topic in survey.topics:
        for path in topic.numbers:
            words = {*_tokens(path), *_tokens(topic.name)}
            own = set(_tokens(path.rpartition(".")[2]))
            kinds = [role for role in ROLES if words & _WORDS[role]]
            if "distance" in own and len(kinds) == len(ROLES):
                found.append(Scalar("centre_distance/robot/human", topic.name, path))
            elif "speed" in own and (one := [k for k in ROLES if own & _WORDS[k]] or kinds)[1:] == [] and one:
                found.append(Scalar(f"speed/{one[0]}", topic.name, path))
    return found


def suffice(scalars: Sequence[Scalar]) -> bool:
    """Whether topics state all that a separation monitor needs, and each of it once."""
    wanted = ["centre_distance/robot/human", "speed/human", "speed/robot"]
    return sorted(scalar.signal for scalar in scalars) == wanted


# Choice --------------------------------------------------------------------------------


def choose(candidates: Sequence[Candidate]) -> dict[str, Choice]:
    """Who is the human and who the robot, as far as something speaks for one and for no other."""
    by_name = {role: _choice(role, [c for c in candidates if _rank(c, role) >= _NAMED]) for role in ROLES}
    choices = {}
    for role, other in zip(ROLES, reversed(ROLES), strict=True):
        choice = by_name[role]
        if not (choice.chosen or choice.equal):
            taken = (*by_name[other].chosen, *by_name[other].equal)
            left = [c for c in candidates if not any(same_motion(c, one) for one in taken)]
            choice = _choice(role, [c for c in left if _rank(c, role)])
            if not by_name[other].chosen:  # what alone moves could be either
                choice = Choice(role, equal=(*choice.chosen, *choice.equal), others=choice.others)
        choices[role] = choice
    return choices


_NAMED = 2


def _rank(candidate: Candidate, role: str) -> int:
    """How much speaks for a candidate: its name and its motion, its name, its motion, nothing."""
    if candidate.signal is None:
        return 0
    if candidate.kind == role:
        return 3 if candidate.moves else 2
    return 1 if candidate.moves and not candidate.kind else 0


_REASONS = {
    3: "its name says so, and it moves",
    2: "its name says so, though it does not move",
    1: "nothing else moves that no name speaks for",
}


def _choice(role: str, candidates: Sequence[Candidate]) -> Choice:
    best = max((_rank(c, role) for c in candidates), default=0)
    leading = [c for c in candidates if best and _rank(c, role) == best]
    firsts: list[Candidate] = []
    others: dict[str, str] = {}
    for one in sorted(leading, key=lambda c: (("frame", "model", "topic").index(c.source), c.is_late)):
        twin = next((first for first in firsts if same_motion(one, first)), None)
        if twin is None:
            firsts.append(one)
        else:
            others[one.name] = f"the same motion as {twin.source} {twin.name}"
    if len(firsts) == 1:
        return Choice(role, (firsts[0],), _REASONS[best], others=others)
    return Choice(role, equal=tuple(firsts), others=others)


def same_motion(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are one body: they are always at the same place."""
    if one is other or one.key == other.key:
        return True
    first, second = one.signal, other.signal
    if first is None or second is None:
        return False
    t = first.t[(first.t >= second.t[0]) & (first.t <= second.t[-1])]
    if len(t) < 2:
        return False
    columns = [np.interp(t, second.t, second.values[:, axis]) for axis in range(3)]
    mine = [np.interp(t, first.t, first.values[:, axis]) for axis in range(3)]
    apart = np.hypot.reduce(np.stack(columns) - np.stack(mine))
    return bool(np.median(apart) < _SAME_M)


def named(candidates: Iterable[Candidate], name: str) -> Candidate | None:
    """The candidate of a name, which may lack the slash of its topic."""
    return next((c for c in candidates if c.name.lstrip("/") == name.lstrip("/")), None)
