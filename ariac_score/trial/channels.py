"""Which topic, field, model or frame becomes which signal: the parsed form of a log map.

`ariac_score.logs.logmap` loads it from YAML; readers follow it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

from ariac_score.errors import LogMapError
from ariac_score.trial.model import Body
from ariac_score.trial.vocabulary import Quantity, quantity_of, subject_of
from ariac_score.trial.work import Fact

__all__ = [
    "OF_FRAMES",
    "OF_MODELS",
    "BodyMatch",
    "Channel",
    "FieldMap",
    "LogMap",
    "NamedEvent",
    "NumberField",
    "PluginUse",
]

OF_FRAMES = "tf frames"
"""The source of a signal that follows from transforms, on whichever topics they came."""
OF_MODELS = "model states"
"""The source of a signal that follows from states of models, likewise."""

_NAMED = re.compile(r"\{([a-z][a-z0-9_]*)\}")
"""A fact of the trial within a name."""
_SPECIAL = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class FieldMap:
    """One signal and the message fields its values come from.

    Attributes:
        signal: Signal name, such as `speed/human`.
        unit: SI unit the fields are in.
        fields: Dotted paths, one for each component.
    """

    signal: str
    unit: str
    fields: tuple[str, ...]


@dataclass(frozen=True)
class NamedEvent:
    """The event that every message of a topic is.

    Attributes:
        kind: What happens.
        subject: To whom or what; empty when it concerns the trial.
    """

    kind: str
    subject: str = ""


@dataclass(frozen=True)
class NumberField:
    """A number that the events of a topic carry.

    Attributes:
        name: Its name in the event.
        field: Dotted path of the field it comes from.
        unit: Of the field.
    """

    name: str
    field: str
    unit: str


@dataclass(frozen=True)
class Channel:
    """What one topic of a recording means.

    Attributes:
        topic: Name with leading slash.
        type: Message type, `package/msg/Name`; empty accepts any.
        stamp: `log` (time of recording) or `header` (the message's own stamp); empty: the message's own where
            it has one, otherwise the time of recording.
        signals: Fields that are signals.
        poses: `frames` for tf messages, `models` for Gazebo model states; empty otherwise.
        decoder: Name of the plugin that turns its messages into work, submissions, events.
        witnesses: What this topic would have shown; see `Trial.witnessed`.
        optional: Whether a recording without it is complete all the same.
        absent_with: Where a log says that there is none of these, such as `human bodies`, nobody sends it.
        rate_hz: How often it is published, as its organiser states; 0: nobody says.
        as_consumed: Whether its signals are series, every value in the order of the recording; see `Series`.
        event: What every message is, where no decoder says it.
        numbers: What the events of the topic carry.
        facts: Names of facts of the trial, each with the dotted path of the field that states it.
    """

    topic: str
    type: str = ""
    stamp: str = ""
    signals: tuple[FieldMap, ...] = ()
    poses: str = ""
    decoder: str = ""
    witnesses: tuple[str, ...] = ()
    optional: bool = False
    absent_with: str = ""
    rate_hz: float = 0.0
    as_consumed: bool = False
    event: NamedEvent | None = None
    numbers: tuple[NumberField, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()

    @property
    def bodies(self) -> frozenset[str]:
        """The bodies that its signals are about, by id."""
        return frozenset(
            segment.partition("::")[0] for f in self.signals for segment in subject_of(f.signal).split("/")
        )

    @property
    def whole(self) -> bool:
        """Whether whole messages are needed, whatever is measured."""
        return bool(self.decoder or self.event or self.facts)


@dataclass(frozen=True)
class BodyMatch:
    """Which model or frame names are a body, and of what kind.

    Attributes:
        match: Shell pattern over names, such as `person_*`.
        kind: What it is, such as `robot`, `human` or `vehicle`.
        body: Body id; empty takes the matched name.
        radius_m: Radius of the sphere that stands for the body and each link, m; `None`: not known.
        links: Shell patterns over the link names that are followed too.
        rate_hz: How often their places are published, as their organiser states; 0: nobody says.
    """

    match: str
    kind: str
    body: str = ""
    radius_m: float | None = None
    links: tuple[str, ...] = ()
    rate_hz: float = 0.0

    def body_for(self, name: str) -> Body | None:
        """The body a name stands for, without its links; `None` when it does not match."""
        # Not `fnmatch`, which ignores case on some systems.
        if not fnmatchcase(name, self.match):
            return None
        # A slash would separate two bodies in the name of a signal.
        return Body(self.body or name.replace("/", "_"), self.kind, self.radius_m)

    def is_body(self, body: Body) -> bool:
        """Whether a body is one that this stands for."""
        name = self.body or self.match.replace("/", "_")
        return body.kind == self.kind and fnmatchcase(body.id, name)

    def follows_link(self, link: str) -> bool:
        """Whether positions of this link are wanted."""
        return any(fnmatchcase(link, pattern) for pattern in self.links)


@dataclass(frozen=True)
class PluginUse:
    """A plugin that a log map names.

    Attributes:
        use: Its name.
        parameters: Its parameters.
        file: The log map, for error messages.
        place: Where each parameter stands in it; under the empty name the section.
    """

    use: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    file: str = field(default="", compare=False)
    place: Mapping[str, str] = field(default_factory=dict, compare=False)


@dataclass(frozen=True)
class LogMap:
    """How the logs of one competition, or one year of it, are read.

    Attributes:
        id: Such as `ariac2020`.
        channels: By topic, in the order of the file.
        bodies: Bodies that mapped fields are about.
        models: Gazebo model names.
        frames: tf frame names.
        root_frame: The tf frame positions are given in.
        quantities: Quantities beyond the vocabulary that signals of this map measure.
        speed_window_s: Half width of the centred difference that gives speeds, s; 0 means two samples.
        tracks: What sees more in poses of models than motion.
        competition: Whose logs they are; it joins what several logs of a trial say.
        sha256: Hash of the file it came from; empty for one made in memory.
        file: The file it came from, for error messages.
        facts: Of every trial that it reads; `None`: known to be absent.
        rests_on: Installed files of other distributions that it extends: names by the last word of the group.
        bounds: How fast bodies can move, as written.
    """

    id: str
    channels: tuple[Channel, ...] = ()
    bodies: tuple[Body, ...] = ()
    models: tuple[BodyMatch, ...] = ()
    frames: tuple[BodyMatch, ...] = ()
    root_frame: str = "world"
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    speed_window_s: float = 0.0
    tracks: PluginUse | None = None
    competition: PluginUse | None = None
    sha256: str = ""
    file: str = field(default="", compare=False)
    facts: Mapping[str, Fact] = field(default_factory=dict)
    rests_on: Mapping[str, Sequence[str]] = field(default_factory=dict)
    bounds: Mapping[str, Any] = field(default_factory=dict)

    @property
    def published_kinds(self) -> frozenset[str]:
        """Kinds of bodies that are published whatever a configuration says of those of a simulator."""
        named = {body for one in self.channels if not one.absent_with for body in one.bodies}
        matched = {one.kind for one in (*self.models, *self.frames)}
        return frozenset(matched | {body.kind for body in self.bodies if body.id in named})

    def filled(self, facts: Mapping[str, Fact]) -> LogMap:
        """The map with `{name}` in names of frames, models, topics and fields filled from facts of a trial.

        What no fact fills stays as it is; see `refuse_unfilled`.

        Args:
            facts: Of the trial, as its configuration states them.

        Raises:
            LogMapError: A fact is there, but is no text.
        """
        if not any(_NAMED.search(text) for _, text in self._names()):
            return self

        def plain(text: str) -> str:
            return _NAMED.sub(lambda named: self._text_of(named, facts), text)

        def pattern(text: str) -> str:  # a fact is a name, whatever characters of patterns it holds
            return _NAMED.sub(lambda named: _SPECIAL.sub(r"[\g<0>]", self._text_of(named, facts)), text)

        def match(one: BodyMatch) -> BodyMatch:
            return replace(one, match=pattern(one.match), links=tuple(map(pattern, one.links)))

        def channel(one: Channel) -> Channel:
            signals = (replace(f, fields=tuple(map(plain, f.fields))) for f in one.signals)
            numbers = tuple(replace(n, field=plain(n.field)) for n in one.numbers)
            facts = tuple((name, plain(path)) for name, path in one.facts)
            return replace(one, topic=plain(one.topic), signals=tuple(signals), numbers=numbers, facts=facts)

        return replace(
            self,
            root_frame=plain(self.root_frame),
            models=tuple(map(match, self.models)),
            frames=tuple(map(match, self.frames)),
            channels=tuple(map(channel, self.channels)),
        )

    def refuse_unfilled(self) -> None:
        """Refuse a map that names a fact which nobody stated.

        Raises:
            LogMapError: With the key and the fact.
        """
        for key, text in self._names():
            if named := _NAMED.search(text):
                raise LogMapError(
                    f"{text!r} names the fact {named[1]!r}, which no file of the trial states",
                    file=self.file or self.id,
                    place=key,
                    hint="lay the trial's configuration beside the recording, or write the name itself",
                )

    def refuse_stray_braces(self) -> None:
        """Refuse a map in which braces hold something else than the name of a fact.

        Raises:
            LogMapError: With the key.
        """
        for key, text in self._names():
            if set("{}") & set(_NAMED.sub("", text)):
                raise LogMapError(
                    f"the braces of {text!r} hold no name of a fact",
                    file=self.file or self.id,
                    place=key,
                    hint="write such as {cable}: small letters, digits and _",
                )

    def _names(self) -> Iterator[tuple[str, str]]:
        """The names of frames, models, topics and fields, with their keys."""
        yield "$.root_frame", self.root_frame
        for section, entries in (("models", self.models), ("frames", self.frames)):
            for i, one in enumerate(entries):
                yield f"$.{section}[{i}].match", one.match
                yield from ((f"$.{section}[{i}].links", link) for link in one.links)
        for i, channel in enumerate(self.channels):
            yield f"$.channels[{i}].topic", channel.topic
            for signal in channel.signals:
                yield from ((f"$.channels[{i}].signals.{signal.signal}", path) for path in signal.fields)
            yield from ((f"$.channels[{i}].numbers.{n.name}", n.field) for n in channel.numbers)
            yield from ((f"$.channels[{i}].facts.{name}", path) for name, path in channel.facts)

    def _text_of(self, named: re.Match[str], facts: Mapping[str, Fact]) -> str:
        if named[1] not in facts:
            return named[0]
        value = facts[named[1]]
        if not isinstance(value, str):
            key = next(key for key, text in self._names() if text == named.string)
            stated = "known to be absent" if value is None else f"{value:g}"
            raise LogMapError(
                f"{named.string!r} names the fact {named[1]!r}, which is {stated} and no text",
                file=self.file or self.id,
                place=key,
                hint="only a fact that is a text can stand in a name",
            )
        return value

    def channels_for(self, quantities: Iterable[str]) -> tuple[Channel, ...]:
        """The channels worth decoding when only these quantities are wanted.

        Work, submissions and events are always wanted.
        """
        wanted = frozenset(quantities)
        return tuple(
            channel
            for channel in self.channels
            if channel.whole  # needed whatever is measured: work, submissions, events
            or (channel.poses and "position" in wanted)
            or (channel.poses == "models" and self.tracks is not None)
            or any(quantity_of(f.signal) in wanted for f in channel.signals)
        )
