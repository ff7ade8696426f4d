"""The text of a drafted log map: what is decided as YAML, what is open or left out as comments."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field

from ariac_score.review.log_maps.survey import CLOCK, FRAMES, MODELS, Survey
from ariac_score.review.log_maps.whom import ROLES, Candidate, Choice, Scalar, escaped, position_fields
from ariac_score.trial.channels import FieldMap, LogMap
from ariac_score.trial.vocabulary import subject_of

__all__ = ["Extended", "Writing"]


@dataclass(frozen=True)
class Extended:
    """The log map that a draft extends.

    Attributes:
        name: As the draft names it.
        log_map: What it says.
        seen: Its bodies of which the recording has something.
        unseen: Those that it expects in the recording, and of which nothing is there.
        sources: By body, the recorded frames and models that it takes for it.
    """

    name: str
    log_map: LogMap
    seen: Set[str] = frozenset()
    unseen: Sequence[str] = ()
    sources: Mapping[str, Set[str]] = field(default_factory=dict)

    @property
    def unusable(self) -> dict[str, Set[str]]:
        """The bodies of which frames or models are recorded, and no positions can be had."""
        return {body: names for body, names in sorted(self.sources.items()) if body not in self.seen}

    @property
    def topics(self) -> set[str]:
        """The topics that it maps."""
        return {channel.topic for channel in self.log_map.channels}


@dataclass(frozen=True)
class Writing:
    """A draft that is written.

    Attributes:
        name: Of the recording.
        survey: What it holds.
        extends: The log map that is extended; `None`: none.
        root: The frame of positions; empty where there are no frames.
        stamp: `log` where only times of recording can be compared.
        candidates: Everything with a position.
        choices: Who is who, by role.
        scalars: Speeds and distances that topics state.
        by_scalars: Whether these take the place of positions, which nobody has.
        extendable: Log maps between which is to be chosen, with what speaks for each.
    """

    name: str
    survey: Survey
    extends: Extended | None
    root: str
    stamp: str
    candidates: Sequence[Candidate]
    choices: Mapping[str, Choice]
    scalars: Sequence[Scalar]
    by_scalars: bool
    extendable: Mapping[str, str]

    @property
    def text(self) -> str:
        """The YAML."""
        return "\n".join(self.lines()) + "\n"

    def lines(self) -> Iterator[str]:
        """The YAML, line by line."""
        yield f"# Drafted by 'ariac-score map' from {_plain(self.name)}. It is yours: read it, and change it."
        yield f"id: {_identifier(self.name)}"
        yield f"title: {_quoted(f'Drafted from {self.name}')}"
        yield f"source: {_quoted(f'drafted by ariac-score map from {self.name}; checked by nobody yet')}"
        if self.extends is not None:
            yield f"extends: {_scalar(self.extends.name)}"
        for name, words in self.extendable.items():
            yield f"# extends: {_scalar(name)}    # OPEN: {_plain(words)}"
        if self.root and any(self._chosen("frame")):
            yield f"root_frame: {_scalar(self.root)}"
        for role in ROLES:
            yield from self._open(role)
        sections = {
            "bodies": self._bodies(),
            "channels": self._channels(),
            "frames": self._matches("frame"),
            "models": self._matches("model"),
        }
        for section, found in sections.items():
            rows = list(found)
            if any(not row.lstrip().startswith("#") for row in rows):
                yield f"{section}:"
            yield from rows
        yield from self._unused()

    def _open(self, role: str) -> Iterator[str]:
        choice = self.choices[role]
        if choice.why and not choice.chosen:
            yield f"# {role}: {choice.why}"
        elif choice.equal:
            yield f"# {role}: OPEN, for nothing speaks for one of these alone; give one with --{role} NAME:"
        elif not choice.chosen and not self.by_scalars:
            yield f"# {role}: OPEN, for nothing with a position looks like one; give it with --{role} NAME"
        else:
            return
        for candidate in choice.equal or (() if choice.why else self.candidates):
            yield f"#   {_plain(candidate.words)}"

    def _chosen(self, source: str) -> Iterator[tuple[str, Candidate, str]]:
        """The roles, candidates and ids of the bodies that come from frames, models or topics."""
        for role, choice in self.choices.items():
            for one in choice.chosen:
                own = re.sub(r"[^A-Za-z0-9_.-]", "_", one.name.strip("/"))
                if one.source == source:
                    is_free = self.extends is None or role not in self.extends.unusable
                    # Beside its place as the extended log map has it, a topic's would be a second one.
                    is_free &= source != "topic" or self.extends is None or role not in self.extends.seen
                    yield role, one, role if len(choice.chosen) == 1 and is_free else own

    def _left_out(self, source: str) -> Iterator[tuple[str, Candidate, str]]:
        """The roles, candidates and reasons of those that are no bodies, or not yet."""
        chosen = [one for choice in self.choices.values() for one in choice.chosen]
        for role, choice in self.choices.items():
            for one in self.candidates:
                if one in chosen or one.source != source:
                    continue
                if one in choice.equal or one.name in choice.others:
                    yield role, one, choice.others.get(one.name, "open")

    def _bodies(self) -> Iterator[str]:
        bodies = [(body, role) for role, _, body in self._chosen("topic")]
        for body, role in bodies or ([(role, role) for role in ROLES] if self.by_scalars else []):
            yield f"  {_scalar(body)}: {{kind: {role}}}    # radius_m: 0.3 lets distances be between surfaces"
        for body in self.replaced:
            yield f"  {_scalar(body)}: null    # of the extended log map: not recorded, another body, or none"

    @property
    def unusable(self) -> list[str]:
        """What the extended log map would take for a body, and has no positions, a line each."""
        found = {} if self.extends is None else self.extends.unusable
        chosen = {one.name for choice in self.choices.values() for one in choice.chosen}
        return [
            f"{body} of the extended log map: {', '.join(sorted(names))} is recorded, and has no positions "
            "that can be used; what is asked of it stays open"
            for body, names in found.items()
            if not names & chosen
        ]

    @property
    def replaced(self) -> list[str]:
        """The bodies of the extended log map that are not recorded, and in whose place others are."""
        if self.extends is None:
            return []
        log_map = self.extends.log_map
        chosen = [(role, body) for s in ("frame", "model", "topic") for role, _, body in self._chosen(s)]
        roles, names = {role for role, _ in chosen}, {body for _, body in chosen}
        known = {body.id: body.kind for body in log_map.bodies}
        for match in (*log_map.frames, *log_map.models):
            if not set("*?[") & set(match.body or match.match):
                known.setdefault(match.body or match.match, match.kind)
        replaced = [body for body, kind in known.items() if kind in roles]
        taken = {one.name for s in ("frame", "model") for _, one, _ in self._chosen(s)}
        recorded = {topic.name for topic in self.survey.topics if topic.count}
        channels = (channel for channel in log_map.channels if channel.topic in recorded)
        states = {body for channel in channels for one in channel.signals for body in _bodies_of(one)}
        # A frame that the draft takes for another body leaves nothing of the one it was.
        other = {body for body, own in self.extends.sources.items() if own <= taken} - states
        there = names | (self.extends.seen | self.extends.unusable.keys()) - other
        nobody = {role for role, choice in self.choices.items() if choice.nobody}
        nobody |= {role for role, _, _ in self._chosen("topic")}  # who is named takes the place of all others
        without = [body for body, kind in known.items() if kind in nobody and body not in names]
        found = [body for body in [*replaced, *self.extends.unseen] if body not in there]
        return [*dict.fromkeys([*found, *without])]

    def _channels(self) -> Iterator[str]:
        stamp = ", stamp: log" if self.stamp else ""
        for source, poses, types in (("frame", "frames", FRAMES), ("model", "models", MODELS)):
            for topic in self.survey.of_type(types) if any(self._chosen(source)) else ():
                yield f"  - {{topic: {_scalar(topic.name)}, poses: {poses}{stamp}}}"
        for role, one, body in self._chosen("topic"):
            yield f"  # {role}: {_plain(one.words)}; {self.choices[role].why}"
            yield f"  - {_channel(one, body, stamp)}"
        for role, one, why in self._left_out("topic"):
            yield f"  # {role}: {_plain(one.words)}; left out: {why}"
            yield f"  # - {_channel(one, role, stamp)}"
        mapped = self.extends.topics if self.extends else set()
        for name in dict.fromkeys(scalar.topic for scalar in self.scalars if scalar.topic not in mapped):
            own = (scalar for scalar in self.scalars if scalar.topic == name)
            signals = ", ".join(f"{scalar.signal}: {_scalar(scalar.path)}" for scalar in own)
            row = f"- {{topic: {_scalar(name)}{stamp}, signals: {{{signals}}}}}"
            if not self.by_scalars:
                yield "  # left out: known by their names alone, and positions give the same"
            yield f"  {'' if self.by_scalars else '# '}{row}"

    def _matches(self, source: str) -> Iterator[str]:
        for role, one, body in self._chosen(source):
            yield f"  # {role}: {_plain(one.words)}; {self.choices[role].why}"
            yield f"  - {_match(one, role, body)}"
        for role, one, why in self._left_out(source):
            yield f"  # {role}: {_plain(one.words)}; left out: {why}"
            yield f"  # - {_match(one, role, role)}"

    def _unused(self) -> Iterator[str]:
        used = {one.topic[0] for choice in self.choices.values() for one in (*choice.chosen, *choice.equal)}
        used |= self.extends.topics if self.extends else set()
        used |= {scalar.topic for scalar in self.scalars}
        rest = [t for t in self.survey.topics if t.name not in used and t.type not in (*FRAMES, *MODELS)]
        if any(topic.type == CLOCK for topic in rest):
            yield "# /clock is recorded: it relates times of recording to the simulation"
        others = [topic for topic in rest if topic.type != CLOCK]
        if others:
            yield "# recorded, and not used here:"
        for topic in others:
            why = f": {topic.unreadable}" if topic.unreadable else ""
            yield f"#   {_plain(f'{topic.name} {topic.type}{why}')}"
        yield from self._renamed({topic.name: topic.type for topic in others if topic.count})

    def _renamed(self, unused: Mapping[str, str]) -> Iterator[str]:
        """Channels of the extended log map that are not recorded, under names that may be theirs here."""
        recorded = {topic.name for topic in self.survey.topics}
        missing = self.extends.log_map.channels if self.extends else ()
        for channel in missing:
            if not channel.decoder or channel.optional or channel.topic in recorded:
                continue
            for name in [name for name, type_ in unused.items() if type_ == channel.type]:
                yield f"# if {_plain(name)} is what {channel.topic} is elsewhere, under 'channels:':"
                more = f"type: {channel.type}, decoder: {channel.decoder}"
                if channel.witnesses:
                    more += f", witnesses: [{', '.join(sorted(channel.witnesses))}]"
                yield f"#   - {{topic: {_scalar(name)}, {more}}}"


def _bodies_of(field_map: FieldMap) -> list[str]:
    return [part.partition("::")[0] for part in subject_of(field_map.signal).split("/")]


def _channel(candidate: Candidate, body: str, stamp: str) -> str:
    topic, path = candidate.topic
    fields = ", ".join(position_fields(path))
    return f"{{topic: {_scalar(topic)}{stamp}, signals: {{{_scalar(f'position/{body}')}: [{fields}]}}}}"


def _match(candidate: Candidate, role: str, body: str) -> str:
    # The only link of a model is where the model is.
    inner = () if candidate.source == "model" and len(candidate.links) == 1 else candidate.links
    links = ", ".join(_scalar(escaped(link)) for link in inner)
    more = f", links: [{links}]" if links else ""
    return f"{{match: {_scalar(escaped(candidate.name))}, kind: {role}, body: {_scalar(body)}{more}}}"


_BARE = re.compile(r"[A-Za-z_/][A-Za-z0-9_./-]*")
_WORDS_OF_YAML = frozenset(("y", "n", "yes", "no", "on", "off", "true", "false", "null"))


def _scalar(text: str) -> str:
    """A text as YAML, in quotes where it needs them."""
    if _BARE.fullmatch(text) and text.lower() not in _WORDS_OF_YAML:
        return text
    return _quoted(text)


def _quoted(text: str) -> str:
    """A text as YAML in quotes; JSON is YAML."""
    return json.dumps(text, ensure_ascii=True)


def _identifier(name: str) -> str:
    """A name as the id of a log map."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower().partition(".")[0]).strip("_") or "drafted"


def _plain(text: str) -> str:
    """A text within a comment: one line, and nothing that steers a terminal."""
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in text)
