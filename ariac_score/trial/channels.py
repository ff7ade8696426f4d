"""Which topic, field, model or frame becomes which signal: the parsed form of a log map.

`ariac_score.logs.logmap` loads it from YAML; readers follow it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from ariac_score.trial.model import Body
from ariac_score.trial.vocabulary import Quantity, quantity_of

__all__ = ["BodyMatch", "Channel", "FieldMap", "LogMap", "PluginUse"]


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
        as_consumed: Whether its signals are series, every value in the order of the recording; see `Series`.
    """

    topic: str
    type: str = ""
    stamp: str = ""
    signals: tuple[FieldMap, ...] = ()
    poses: str = ""
    decoder: str = ""
    witnesses: tuple[str, ...] = ()
    optional: bool = False
    as_consumed: bool = False


@dataclass(frozen=True)
class BodyMatch:
    """Which model or frame names are a body, and of what kind.

    Attributes:
        match: Shell pattern over names, such as `person_*`.
        kind: What it is, such as `robot`, `human` or `vehicle`.
        body: Body id; empty takes the matched name.
        radius_m: Radius of the sphere that stands for the body and each link, m.
        links: Shell patterns over the link names that are followed too.
    """

    match: str
    kind: str
    body: str = ""
    radius_m: float = 0.0
    links: tuple[str, ...] = ()

    def body_for(self, name: str) -> Body | None:
        """The body a name stands for, without its links; `None` when it does not match."""
        # Not `fnmatch`, which ignores case on some systems.
        if not fnmatchcase(name, self.match):
            return None
        # A slash would separate two bodies in the name of a signal.
        return Body(self.body or name.replace("/", "_"), self.kind, self.radius_m)

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

    def channels_for(self, quantities: Iterable[str]) -> tuple[Channel, ...]:
        """The channels worth decoding when only these quantities are wanted.

        Work, submissions and events are always wanted.
        """
        wanted = frozenset(quantities)
        return tuple(
            channel
            for channel in self.channels
            if channel.decoder  # needed whatever is measured: work, submissions, events
            or (channel.poses and "position" in wanted)
            or (channel.poses == "models" and self.tracks is not None)
            or any(quantity_of(f.signal) in wanted for f in channel.signals)
        )
