"""A log map drafted from a recording: what is decided and why, what is open, and its text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os.path import relpath
from pathlib import Path

from ariac_score.checks.contracts import Reader
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, words_of
from ariac_score.engine.read import competition_of, read_trial
from ariac_score.errors import LogError, ScoreError, UsageError
from ariac_score.logs.bundle import Bundle
from ariac_score.logs.gather.message_fields import nearest
from ariac_score.logs.logmap import bases_of, is_log_map_file, load_log_map, log_map_names
from ariac_score.review.log_maps.survey import Survey, survey_recording
from ariac_score.review.log_maps.text import Extended, Writing
from ariac_score.review.log_maps.whom import (
    ROLES,
    Candidate,
    Choice,
    candidates_in,
    choose,
    named,
    same_motion,
    scalars_in,
    suffice,
)
from ariac_score.trial.channels import BodyMatch, LogMap
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import QUANTITIES
from ariac_score.trial.words import HANDED_IN, Words

__all__ = ["NONE", "Ask", "Draft", "Given", "Question", "draft_log_map", "open_words"]

_MOST_NAMED = 12
"""Of what could be an answer; what moves comes first."""

NONE = "none"
"""The answer that there is no such thing."""


@dataclass(frozen=True)
class Question:
    """Something that a recording leaves open, or decides only by likelihood.

    Attributes:
        what: `human`, `robot`, `extends` or `root-frame`: the option that answers it.
        words: The question.
        choices: Possible answers, each with what speaks for it.
        likely: The answer that something speaks for; empty where choices are equal.
        several: Whether it may have several answers.
    """

    what: str
    words: str
    choices: Mapping[str, str]
    likely: tuple[str, ...] = ()
    several: bool = False


Ask = Callable[[Question], "tuple[str, ...] | None"]
"""Answers a question; `None` leaves it as it is."""


@dataclass(frozen=True)
class Given:
    """What whoever asks for a draft says himself, by the options of the command.

    Attributes:
        human: Names of humans.
        robot: Names of robots.
        extends: The log map to extend; `none`: none.
        root_frame: The frame of positions.
        rules: The rules it is for, whose log map it extends by default; `None`: none are named.
    """

    human: tuple[str, ...] = ()
    robot: tuple[str, ...] = ()
    extends: str = ""
    root_frame: str = ""
    rules: Prepared | None = None


@dataclass(frozen=True)
class Draft:
    """A drafted log map.

    Attributes:
        text: Its YAML, as it is to lie in its folder.
        anywhere: The same for any folder.
        open: Questions without an answer.
        decided: What was decided and why, a line each.
    """

    text: str
    anywhere: str
    open: tuple[Question, ...] = ()
    decided: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Base:
    """An installed log map that knows topics of the recording, and what it finds."""

    name: str
    log_map: LogMap
    trial: Trial
    lost: int
    names: Words

    @property
    def bodies(self) -> dict[str, list[str]]:
        """The bodies that it finds signals of, by kind."""
        subjects = (name.partition("/")[2].split("/") for name in self.trial.signals)
        seen = {body.partition("::")[0] for bodies in subjects for body in bodies}
        found: dict[str, list[str]] = {}
        for body in self.trial.bodies:
            if body.id in seen:
                found.setdefault(body.kind, []).append(body.id)
        return found

    @property
    def unseen(self) -> list[str]:
        """The bodies that it expects beside others of their kind, and finds no signal of."""
        seen = {one for ids in self.bodies.values() for one in ids}
        return [body.id for body in self.trial.bodies if body.kind in self.bodies and body.id not in seen]

    @property
    def matches(self) -> tuple[BodyMatch, ...]:
        """The frames and models that it names."""
        return *self.log_map.frames, *self.log_map.models

    def extended(self, folder: Path | None, survey: Survey) -> Extended:
        """As a draft in a folder extends it."""
        seen = {one for ids in self.bodies.values() for one in ids}
        recorded = {*survey.models, *(name for edge in survey.edges for name in (edge.parent, edge.child))}
        sources: dict[str, set[str]] = {}
        for name in recorded:
            for body in [match.body_for(name) for match in self.matches]:
                if body is not None:
                    sources.setdefault(body.id, set()).add(name)
        return Extended(_from(self.name, folder), self.log_map, frozenset(seen), self.unseen, sources)

    def beside(self, role: str, candidates: Iterable[Candidate]) -> Iterator[tuple[Candidate, str]]:
        """Who else could have a role that it gives to somebody, and why they do not have it."""
        provided = [
            Candidate(body, "model", body, signal=self.trial.signals.get(f"position/{body}"))
            for body in self.bodies.get(role, ())
        ]
        topics = {channel.topic for channel in self.log_map.channels}
        for one in candidates:
            if one.kind != role or not one.moves or one.elsewhere or one.topic[0] in topics:
                continue
            if one.source != "topic" and any(match.body_for(one.name) for match in self.matches):
                inner = [link for link in one.links if not self._follows(link)]
                if (inner and len(one.links) > 1) or (one.source == "frame" and inner):
                    yield one, f"the extended log map does not follow what moves below it: {', '.join(inner)}"
            elif not any(same_motion(one, other) for other in provided):
                yield one, "the extended log map does not know it"

    def _follows(self, link: str) -> bool:
        return any(match.follows_link(link) or match.body_for(link) for match in self.matches)

    @property
    def reads(self) -> int:
        """How many messages about the work it understands."""
        return len(self.trial.work) + len(self.trial.submissions) + len(self.trial.events)

    @property
    def fit(self) -> tuple[int, int, int]:
        """How well it fits: what it cannot use counts first, then what it reads, then who moves."""
        return -self.lost, self.reads, sum(map(len, self.bodies.values()))

    @property
    def words(self) -> str:
        """What it finds."""
        trial, names = self.trial, self.names
        parts = [
            f"{names.many(names.outermost)}: {len(trial.work)}",
            f"{names.many(HANDED_IN)}: {len(trial.submissions)}",
            f"events: {len(trial.events)}",
        ]
        parts += [f"{kind}: {', '.join(ids)}" for kind, ids in self.bodies.items()]
        lost = [f"{self.lost} messages that it cannot use"] if self.lost else []
        return "; ".join((*parts, *lost))


@dataclass
class _Drafting:
    """A draft while it is made."""

    bundle: Bundle
    readers: Mapping[str, Reader]
    registry: Registry
    given: Given
    ask: Ask
    survey: Survey = field(default_factory=Survey)
    open: list[Question] = field(default_factory=list)
    decided: list[str] = field(default_factory=list)

    def answer(self, question: Question, said: tuple[str, ...]) -> tuple[str, ...]:
        """The answer that was given, is given now, or is likely; none where nobody knows."""
        found = said or self.ask(question) or question.likely
        if found == (NONE,):
            return ()
        for name in found:
            if not any(name.lstrip("/") == known.lstrip("/") for known in question.choices):
                raise UsageError(
                    f"--{question.what}: the recording has no {name!r}",
                    hint=nearest(name, question.choices, what="it can be"),
                )
        if not found:
            self.open.append(question)
        return found


def draft_log_map(
    bundle: Bundle,
    readers: Mapping[str, Reader],
    registry: Registry,
    given: Given,
    *,
    ask: Ask = lambda _question: None,
    folder: Path = Path(),
) -> Draft:
    """Draft a log map for a recording.

    Args:
        bundle: The log.
        readers: By name.
        registry: The installed plugins.
        given: What is said already.
        ask: Answers questions, as from a terminal.
        folder: Where the draft will lie; by default the current one.

    Raises:
        LogError: The recording is damaged.
        UsageError: Somebody is named who is not in the recording.
    """
    drafting = _Drafting(bundle, readers, registry, given, ask)
    recordings = [part.path for part in bundle.parts if part.reader == "rosbag"]
    surveys = [survey_recording(path) for path in recordings]
    if surveys:
        drafting.survey = Survey(
            tuple(topic for one in surveys for topic in one.topics),
            tuple(edge for one in surveys for edge in one.edges),
            tuple(name for one in surveys for name in one.models),
        )
    base = _base(drafting)
    root = _root(drafting)
    stamp, candidates = _candidates(drafting, root)
    provided = {} if base is None else base.bodies
    scalars = scalars_in(drafting.survey)
    by_scalars = not provided and suffice(scalars) and not any(c.signal for c in candidates)
    choices = {role: Choice(role) for role in ROLES} if by_scalars else _choices(drafting, candidates, base)
    writing = Writing(
        name=bundle.root.name,
        survey=drafting.survey,
        extends=None if base is None else base.extended(folder, drafting.survey),
        root=root,
        stamp=stamp,
        candidates=candidates,
        choices=choices,
        scalars=scalars,
        by_scalars=by_scalars,
        extendable=next((q.choices for q in drafting.open if q.what == "extends"), {}),
    )
    anywhere = writing
    if base is not None:
        anywhere = replace(writing, extends=base.extended(None, drafting.survey))
    drafting.decided += writing.unusable
    left_out = ", ".join(writing.replaced)
    if left_out:
        drafting.decided.append(
            f"without {left_out} of the extended log map: not in this recording, another body here, or none"
        )
    return Draft(writing.text, anywhere.text, tuple(drafting.open), tuple(drafting.decided))


def _from(name: str, folder: Path | None) -> str:
    """A log map as a file in a folder names it; `None`: as one anywhere does."""
    if not is_log_map_file(name):
        return name
    if folder is None:
        return str(Path(name).resolve())
    named = relpath(name, folder)
    return named if "/" in named else f"./{named}"


# What is extended ----------------------------------------------------------------------


def _base(drafting: _Drafting) -> _Base | None:
    """The installed log map to extend: that of the rules, or the one that reads most."""
    given, rules = drafting.given, drafting.given.rules
    if given.extends == NONE:
        return None
    if given.extends:
        log_map = load_log_map(given.extends, registry=drafting.registry)
        return _under(drafting, given.extends, log_map)
    if rules is not None and rules.log_map.channels:
        name = rules.rule_set.log_map
        name = rules.log_map.file if is_log_map_file(name) else name
        drafting.decided.append(f"extends {name}: the log map of {rules.rule_set.id}")
        return _under(drafting, name, rules.log_map)
    fitting = []
    for name in log_map_names(drafting.registry):
        try:
            log_map = load_log_map(name, registry=drafting.registry)
            found = _under(drafting, name, log_map) if _knows(log_map, drafting.survey) else None
        except ScoreError:
            continue  # a log map that cannot read this recording is none to extend
        if found is not None and found.reads:
            fitting.append(found)
    best = [one for one in fitting if one.fit == max(other.fit for other in fitting)]
    # What only adds to another one, and finds no more than that, adds nothing here.
    names = {one.name for one in best}
    best = [one for one in best if names.isdisjoint(bases_of(one.name, drafting.registry))]
    if not best:
        return None
    question = Question(
        "extends",
        "Which competition's log map reads its orders and states?",
        {**{one.name: one.words for one in best}, NONE: "extend none: motion alone"},
        (best[0].name,) if len(best) == 1 else (),
    )
    answer = drafting.answer(question, ())
    if len(best) == 1 and answer == (best[0].name,):
        drafting.decided.append(f"extends {best[0].name}: of those installed it reads most ({best[0].words})")
    return next((one for one in best if (one.name,) == answer), None)


def _knows(log_map: LogMap, survey: Survey) -> bool:
    recorded = {(topic.name, topic.type) for topic in survey.topics if topic.count}
    return any(channel.decoder and (channel.topic, channel.type) in recorded for channel in log_map.channels)


def _under(drafting: _Drafting, name: str, log_map: LogMap) -> _Base:
    """What a log map finds in the recording."""
    quantities = [*QUANTITIES, *log_map.quantities]
    trial = read_trial(
        drafting.bundle, drafting.readers, log_map, drafting.registry, quantities=quantities, work=False
    )
    unusable = ("unusable_messages", "undecodable_messages")
    lost = sum(defect.count for defect in trial.log_defects if defect.kind in unusable)
    return _Base(name, log_map, trial, lost, words_of(competition_of(log_map, drafting.registry)))


# Who is who ----------------------------------------------------------------------------


def _root(drafting: _Drafting) -> str:
    """The frame of positions; empty where there are no frames."""
    roots = drafting.survey.roots
    if drafting.given.root_frame or not roots:
        return drafting.given.root_frame
    if len(roots) == 1:
        return roots[0]
    question = Question(
        "root-frame",
        "In which frame are positions wanted?",
        dict.fromkeys(roots, "the top of a tree of frames"),
        (roots[0],),
    )
    (root,) = drafting.answer(question, ()) or (roots[0],)
    drafting.decided.append(
        f"root_frame {root}: most of what moves hangs below it; others: {', '.join(roots)}"
    )
    return root


def _candidates(drafting: _Drafting, root: str) -> tuple[str, list[Candidate]]:
    """Everything with a position, and `log` where only times of recording can be compared."""

    def found(stamp: str) -> list[Candidate]:
        return candidates_in(
            drafting.bundle, drafting.readers, drafting.survey, root, drafting.registry, stamp=stamp
        )

    try:
        return "", found("")
    except LogError as error:
        try:
            candidates = found("log")
        except LogError:
            raise error from None
        drafting.decided.append(f"stamp: log, the times of recording: {error.cause}")
        return "log", candidates


def _choices(drafting: _Drafting, candidates: Sequence[Candidate], base: _Base | None) -> dict[str, Choice]:
    chosen = choose(candidates)
    provided = {} if base is None else base.bodies
    for role in ROLES:
        said = drafting.given.human if role == "human" else drafting.given.robot
        choice = chosen[role]
        if said == (NONE,):
            chosen[role] = _nobody(drafting, role, provided)
            continue
        if base is not None and role in provided and not said:
            beside = {c.name: (c, why) for c, why in base.beside(role, candidates)}
            reasons = {name: why for name, (_, why) in beside.items()}
            chosen[role] = Choice(
                role, why=f"the extended log map has {', '.join(provided[role])}", others=reasons
            )
            drafting.decided += [
                f"{role}: not {c.words}; {why}. --{role} {c.name} takes it; name all that count"
                for c, why in beside.values()
            ]
            continue
        others = [c for c in candidates if c not in choice.chosen and c not in choice.equal and c.signal]
        others.sort(key=lambda c: not c.moves)
        question = Question(
            role,
            f"Who is the {role}?",
            {c.name: c.words for c in (*choice.chosen, *choice.equal, *others)},
            tuple(c.name for c in choice.chosen),
            several=True,
        )
        _refuse_elsewhere(role, candidates, said)
        was_open = len(drafting.open)
        names = drafting.answer(question, said)
        if not names and len(drafting.open) == was_open:
            chosen[role] = _nobody(drafting, role, provided)
            continue
        picked = tuple(c for name in names if (c := named(candidates, name)) is not None)
        why = choice.why if picked == choice.chosen else "chosen by you"
        rest = (c for c in (*choice.chosen, *choice.equal) if c not in picked)
        left_out = {**choice.others, **({c.name: "another candidate" for c in rest} if picked else {})}
        equal = () if picked else choice.equal
        chosen[role] = replace(choice, chosen=picked, why=why, equal=equal, others=left_out)
        drafting.decided += [f"{role}: {c.words}; {why}" for c in picked]
    return chosen


def _nobody(drafting: _Drafting, role: str, provided: Mapping[str, Sequence[str]]) -> Choice:
    """That somebody said that there is none, and who is left out for it."""
    without = f", without {', '.join(provided[role])} of the extended log map" if provided.get(role) else ""
    drafting.decided.append(f"{role}: none, as you say{without}")
    return Choice(role, why="none, as you say", nobody=True)


def _refuse_elsewhere(role: str, candidates: Sequence[Candidate], said: Iterable[str]) -> None:
    """Refuse whoever was named and has positions that cannot be compared with those of the others."""
    for name in said:
        one = named(candidates, name)
        if one is not None and one.elsewhere:
            raise UsageError(
                f"--{role}: {one.words}",
                hint="record its positions in the frame of the others, or as transforms (/tf)",
            )


def open_words(questions: Iterable[Question]) -> Iterator[str]:
    """What is open, in words, with the option that answers it."""
    for question in questions:
        names = ", ".join([*question.choices][:_MOST_NAMED]) + (
            ", …" if len(question.choices) > _MOST_NAMED else ""
        )
        nobody = f"nothing that moves looks like one; say --{question.what} {NONE} where there is none"
        yield f"{question.words} " + (f"--{question.what} NAME, one of: {names}" if names else nobody)
