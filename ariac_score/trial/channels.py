"""Which topic, field, model or frame becomes which signal: the parsed form of a log map.

`ariac_score.logs.logmap` loads it from YAML; readers follow it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Literal

from ariac_score.trial.model import Body
from ariac_score.trial.vocabulary import Quantity, quantity_of

__all__ = ["BodyMatch", "Channel", "FieldMap", "Footprint", "KitMap", "LogMap", "ProductNames", "TrayMatch"]


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
        decoder: Name of the plugin that turns its messages into orders, submissions, events.
        witnesses: What this topic would have shown; see `Trial.witnessed`.
        optional: Whether a recording without it is complete all the same.
    """

    topic: str
    type: str = ""
    stamp: str = ""
    signals: tuple[FieldMap, ...] = ()
    poses: str = ""
    decoder: str = ""
    witnesses: tuple[str, ...] = ()
    optional: bool = False


@dataclass(frozen=True)
class BodyMatch:
    """Which model or frame names are a body, and of what kind.

    Attributes:
        match: Shell pattern over names, such as `person_*`.
        kind: `robot`, `human` or `agv`.
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
class Footprint:
    """The box, in the frame of a tray, in which the origin of a thing on that tray lies; sides included.

    Attributes:
        half_length_m: Along x to either side, m.
        half_width_m: Along y to either side, m.
        height_m: Above the origin of the tray, m.
        depth_m: Below it, m.
    """

    half_length_m: float
    half_width_m: float
    height_m: float
    depth_m: float = 0.02

    def holds(self, position_m: tuple[float, float, float]) -> bool:
        """Whether a point lies in it."""
        x, y, z = position_m
        return (
            abs(x) <= self.half_length_m
            and abs(y) <= self.half_width_m
            and -self.depth_m <= z <= self.height_m
        )


@dataclass(frozen=True)
class TrayMatch:
    """Which model or link is the tray of an AGV or the insert of a station.

    Names are scoped: `model` or `model::link`, with the models it is nested in before it.

    Attributes:
        at: `agv` or `station`.
        match: Shell pattern over scoped names; `{place}` stands for such as `agv1`, `{n}` for its number.
        footprint: Where things lie on it.
        loose: Shell pattern for loose trays that kits are built on; empty where there are none.
        loose_footprint: Where things lie on a loose tray.
    """

    at: str
    match: str
    footprint: Footprint
    loose: str = ""
    loose_footprint: Footprint | None = None

    def pattern_for(self, place: str) -> str:
        """The pattern for one place.

        >>> TrayMatch("agv", "{place}::kit_tray_{n}::*", Footprint(1, 1, 1)).pattern_for("agv2")
        'agv2::kit_tray_2::*'
        """
        # `{n}`: models of trays are numbered like their AGV, but not named after it.
        number = place[len(place.rstrip("0123456789")) :]
        return self.match.replace("{place}", place).replace("{n}", number)


ProductNames = Literal["instance", "part"]


@dataclass(frozen=True)
class KitMap:
    """How the contents of kits are found for submissions that lack them.

    Attributes:
        max_age_s: How old contents may be at the submission, s.
        names: How the name of a model gives its type: `instance` (the type and a number)
            or `part` (a name that contains a type and a colour).
        products: Shell patterns over the types that are products; any where there are none.
        trays: Where kits lie among the models.
        use: Name of the plugin that finds them; empty for the only one installed.
    """

    max_age_s: float = 1.0
    names: ProductNames = "instance"
    products: tuple[str, ...] = ()
    trays: tuple[TrayMatch, ...] = ()
    use: str = ""


@dataclass(frozen=True)
class LogMap:
    """How the logs of one competition, or one edition of it, are read.

    Attributes:
        id: Such as `ariac2020`.
        channels: By topic, in the order of the file.
        bodies: Bodies that mapped fields are about.
        models: Gazebo model names.
        frames: tf frame names.
        root_frame: The tf frame positions are given in.
        quantities: Quantities beyond the vocabulary that signals of this map measure.
        speed_window_s: Half width of the centred difference that gives speeds, s; 0 means two samples.
        kits: How the contents of kits are found.
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
    kits: KitMap = KitMap()
    sha256: str = ""

    def channels_for(self, quantities: Iterable[str]) -> tuple[Channel, ...]:
        """The channels worth decoding when only these quantities are wanted.

        Orders, submissions and events are always wanted.
        """
        wanted = frozenset(quantities)
        return tuple(
            channel
            for channel in self.channels
            if channel.decoder  # needed whatever is measured: orders, submissions, events
            or (channel.poses and "position" in wanted)
            or (channel.poses == "models" and self.kits.trays)
            or any(quantity_of(f.signal) in wanted for f in channel.signals)
        )
