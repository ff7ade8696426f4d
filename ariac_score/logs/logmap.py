"""Log maps: loading and checking the YAML that says which topic and field is which signal."""

from __future__ import annotations

import hashlib
from collections import ChainMap
from collections.abc import Iterator, Mapping, Set
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from ariac_score.checks.origins import KEY as RESTS_ON
from ariac_score.checks.origins import both_origins, note_origin
from ariac_score.checks.registry import Registry
from ariac_score.documents.given import name_or_path
from ariac_score.documents.schema import validate
from ariac_score.documents.yaml import YamlDocument, load_yaml
from ariac_score.errors import LogMapError, PluginNotFoundError, did_you_mean
from ariac_score.trial.channels import (
    BodyMatch,
    Channel,
    FieldMap,
    LogMap,
    NamedEvent,
    NumberField,
    PluginUse,
)
from ariac_score.trial.model import Body
from ariac_score.trial.vocabulary import (
    ENVIRONMENT,
    QUANTITIES,
    Quantity,
    contradiction,
    quantity_of,
    subject_of,
)

__all__ = ["bases_of", "is_log_map_file", "load_log_map", "log_map_names", "stand_alone"]

GROUP = "ariac_score.log_maps"

MAX_EXTENDS = 8
"""Log maps that may extend each other in a row."""


def log_map_names(registry: Registry | None = None) -> list[str]:
    """The names of the installed log maps."""
    return sorted({file.name for file in (registry or Registry()).files(GROUP)})


def is_log_map_file(name: str) -> bool:
    """Whether a log map is named by the path of a file; no installed one has such a name."""
    return name.endswith((".yaml", ".yml")) or "/" in name


def load_log_map(
    name: str | PathLike[str], *, beside: Path | None = None, registry: Registry | None = None
) -> LogMap:
    """Load an installed log map by name, or one from a file by its path, with what it extends.

    Args:
        name: Such as `ariac2020`, or a path: text ending in `.yaml`, or any `Path`.
        beside: Folder that a relative path starts from; by default the current one.
        registry: What is installed, where the caller has it already.

    Raises:
        LogMapError: Unknown name, malformed file, or a signal that does not fit
            the vocabulary.
        PluginError: Two distributions bring it, or its entry point leads nowhere.
    """
    registry = registry or Registry()
    name = name_or_path(name, "the name or path of a log map")
    return _parsed(_expanded(_path_of(name, beside or Path(), registry), (), registry))


def bases_of(name: str, registry: Registry | None = None) -> tuple[str, ...]:
    """The installed log maps that an installed one extends, nearest first.

    Raises:
        LogMapError: There is no such log map, or it is malformed.

    >>> bases_of("ariac2020")
    ()
    """
    registry, found = registry or Registry(), [name]
    while len(found) <= MAX_EXTENDS:
        document = load_yaml(_path_of(found[-1], Path(), registry), error=LogMapError)
        base = document.data.get("extends")
        if not isinstance(base, str) or is_log_map_file(base):
            break
        found.append(base)
    return tuple(found[1:])


def _path_of(name: str, folder: Path, registry: Registry) -> Path:
    if is_log_map_file(name):
        return folder / name
    try:
        return registry.file(GROUP, name).path
    except PluginNotFoundError:
        raise LogMapError(
            f"there is no log map {name!r}",
            hint=did_you_mean(name, log_map_names(registry), what="installed log maps"),
        ) from None


def _expanded(path: Path, below: tuple[Path, ...], registry: Registry) -> YamlDocument:
    """The document of a log map with what it extends merged in."""
    document = load_yaml(path, error=LogMapError)
    validate(document, "log_map", error=LogMapError)
    base_name = document.data.pop("extends", None)
    if base_name is None:
        return document
    place = document.place(["extends"])
    if path.resolve() in below or len(below) >= MAX_EXTENDS:
        raise LogMapError(
            "log maps extend each other in a circle", file=path, place=place, hint="one must stand alone"
        )
    try:
        found = _path_of(base_name, path.parent, registry)
    except LogMapError as error:
        error.file, error.place = str(path), place
        raise
    base = _expanded(found, (*below, path.resolve()), registry)
    note_origin(base.data, GROUP, base_name, registry)
    _parsed(base)  # what is wrong with it is said of its own file
    # The hash covers the base, or an edit there would change what is read under an unchanged hash.
    both = hashlib.sha256(f"{document.sha256} extends {base.sha256}".encode()).hexdigest()
    merged = _merged(base.data, document.data)
    _leave_out(merged, document, base.data)
    if RESTS_ON in merged:
        merged[RESTS_ON] = both_origins(base.data.get(RESTS_ON, {}), document.data.get(RESTS_ON, {}))
    return YamlDocument(merged, document.file, both, document.lines)


def _leave_out(merged: dict[str, Any], own: YamlDocument, base: Mapping[str, Any]) -> None:
    """Leave out the bodies that a log map gives as null, with all that speaks of them.

    Raises:
        LogMapError: The extended log map has no such body.
    """
    gone = {name for name, body in own.data.get("bodies", {}).items() if body is None}
    matches = [one for section in ("frames", "models") for one in base.get(section, [])]
    known = {*base.get("bodies", {}), *(one.get("body", one["match"]) for one in matches)}
    for name in sorted(gone - known):
        raise LogMapError(
            f"{name!r} is null, and the extended log map has no body of that name",
            file=own.file,
            place=own.place(["bodies", name]),
            hint=did_you_mean(name, sorted(known), what="bodies of the extended log map"),
        )
    own_matches = [one for section in ("frames", "models") for one in own.data.get(section, [])]
    for name in sorted(gone & {one.get("body", one["match"]) for one in own_matches}):
        raise LogMapError(
            f"{name!r} is null, and a frame or model of this log map is that body",
            file=own.file,
            place=own.place(["bodies", name]),
            hint="leave the line out, or give the body another name",
        )
    if not gone:
        return
    merged["bodies"] = {name: body for name, body in merged["bodies"].items() if name not in gone}
    for section in ("frames", "models"):
        if section in merged:
            kept = [one for one in merged[section] if one.get("body", one["match"]) not in gone]
            merged[section] = kept
    read = (_spoken_of(channel, gone) for channel in merged.get("channels", []))
    merged["channels"] = [channel for channel in read if channel is not None]


def _spoken_of(channel: dict[str, Any], gone: Set[str]) -> dict[str, Any] | None:
    """A channel without the signals of some bodies; `None` where nothing is left of it."""
    signals = channel.get("signals", {})
    left = {name: fields for name, fields in signals.items() if not _names(name, gone)}
    if len(left) == len(signals):
        return channel
    others = {key: value for key, value in channel.items() if key != "signals"}
    if left:
        return {**others, "signals": left}
    return others if others.keys() & _READ else None


_READ = {"decoder", "event", "facts", "poses"}
"""What a channel is read for, but for its signals."""


def _names(signal: str, bodies: Set[str]) -> bool:
    """Whether the name of a signal speaks of one of some bodies."""
    return any(part.partition("::")[0] in bodies for part in signal.split("/")[1:])


def stand_alone(path: Path) -> bytes:
    """The text of a log map file that needs no other: its own where it extends nothing.

    Raises:
        LogMapError: As for `load_log_map`.
    """
    document = _expanded(path, (), Registry())
    _parsed(document)
    if "extends" not in load_yaml(path, error=LogMapError).data:
        return path.read_bytes()
    return yaml.safe_dump(document.data, sort_keys=False, allow_unicode=True).encode()


def _merged(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """The base with what is new or changed, key by key; in lists of channels and patterns entry by entry."""
    merged = {**base, **own}
    for key in base.keys() & own.keys():
        if isinstance(base[key], dict) and isinstance(own[key], dict):
            merged[key] = _merged(base[key], own[key])
        elif isinstance(base[key], list) and any(map(_keyed, (*base[key], *own[key]))):
            merged[key] = _merged_entries(base[key], own[key])
    return merged


def _keyed(entry: Any) -> bool:
    return isinstance(entry, dict) and ("topic" in entry or "match" in entry)


def _merged_entries(base: list[Any], own: list[Any]) -> list[Any]:
    """Own entries first: of two patterns that fit a name the first counts, and lines stay as in the file."""
    first, others, rest = list(own), [], []
    extended: set[int] = set()
    for entry in base:
        fitting = next((k for k, one in enumerate(own) if _same(one, entry)), None)
        if fitting is None:
            rest.append(entry)
        elif fitting in extended:  # an entry without a type extends the channels of all types of a topic
            others.append(_merged(entry, own[fitting]))
        else:
            extended.add(fitting)
            first[fitting] = _merged(entry, own[fitting])
    return [*first, *others, *rest]


def _same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two entries are about one topic (of one message type) or one pattern."""
    for key in ("topic", "match"):
        if str(one.get(key, "")).lstrip("/") != str(other.get(key, "")).lstrip("/"):
            return False
    return one.get("type", other.get("type")) == other.get("type", one.get("type"))


def _parsed(document: YamlDocument) -> LogMap:
    data = document.data
    # `float` everywhere: YAML gives an integer where the author writes 1 for 1.0.
    bodies = {
        key: Body(key, b["kind"], _number_or_none(b.get("radius_m")))
        for key, b in data.get("bodies", {}).items()
        if b is not None
    }
    for name in data.get("bodies", {}).keys() - bodies.keys():
        raise LogMapError(
            f"{name!r} is null, and there is no extended log map that it could be left out of",
            file=document.file,
            place=document.place(["bodies", name]),
            hint="give its kind, or leave the line out",
        )
    log_map = LogMap(
        id=data["id"],
        channels=tuple(_channel(document, i, c, bodies) for i, c in enumerate(data.get("channels", []))),
        bodies=tuple(bodies.values()),
        models=tuple(_match(m) for m in data.get("models", [])),
        frames=tuple(_match(m) for m in data.get("frames", [])),
        root_frame=data.get("root_frame", "world"),
        quantities=_quantities(document),
        speed_window_s=float(data.get("speed_window_s", 0.0)),
        tracks=_plugin_use(document, "tracks"),
        competition=_plugin_use(document, "competition"),
        sha256=document.sha256,
        file=str(document.file),
        facts=data.get("facts", {}),
        rests_on=data.get(RESTS_ON, {}),
        bounds=data.get("bounds", {}),
    )
    log_map.refuse_stray_braces()
    return log_map


def _quantities(document: YamlDocument) -> dict[str, Quantity]:
    """The quantities the map brings of its own; those of the vocabulary cannot be changed."""
    declared = {
        name: Quantity(q["unit"], q.get("components", 1), q["of"], q.get("meaning", ""))
        for name, q in document.data.get("quantities", {}).items()
    }
    for name, quantity in declared.items():
        if words := contradiction(name, quantity):
            place = document.place(["quantities", name])
            raise LogMapError(words, file=document.file, place=place, hint="choose another name")
    return declared


def _plugin_use(document: YamlDocument, section: str) -> PluginUse | None:
    data = document.data.get(section)
    if data is None:
        return None
    parameters = data.get("with", {})
    place = {name: document.place([section, "with", name]) for name in parameters}
    return PluginUse(data["use"], parameters, str(document.file), {**place, "": document.place([section])})


def _number_or_none(value: float | None) -> float | None:
    return None if value is None else float(value)


def _match(data: dict[str, Any]) -> BodyMatch:
    return BodyMatch(
        match=data["match"],
        kind=data["kind"],
        body=data.get("body", ""),
        radius_m=_number_or_none(data.get("radius_m")),
        links=tuple(data.get("links", [])),
        rate_hz=float(data.get("rate_hz", 0.0)),
    )


def _channel(document: YamlDocument, index: int, data: dict[str, Any], bodies: dict[str, Body]) -> Channel:
    signals = tuple(
        _field_map(document, index, name, [fields] if isinstance(fields, str) else fields, bodies)
        for name, fields in data.get("signals", {}).items()
    )
    if not (signals or any(data.get(key) for key in ("poses", "decoder", "event", "facts", "witnesses"))):
        raise LogMapError(
            "a channel must map signals, poses, an event, facts or a decoder, or witness something",
            file=document.file,
            place=document.place(["channels", index]),
            hint="add 'signals:', 'poses:', 'event:', 'facts:', 'decoder:' or 'witnesses:'; a rate alone is "
            "for a topic of the log map that this one extends, named as it is there",
        )
    for key, cause, hint in _contradictions(data):
        place = document.place(["channels", index, key])
        raise LogMapError(cause, file=document.file, place=place, hint=hint)
    topic = data["topic"]  # ROS 1 tools write it without the leading slash as well
    return Channel(
        topic=topic if topic.startswith("/") else f"/{topic}",
        type=data.get("type", ""),
        stamp=data.get("stamp", ""),
        signals=signals,
        poses=data.get("poses", ""),
        decoder=data.get("decoder", ""),
        witnesses=tuple(data.get("witnesses", [])),
        optional=data.get("optional", False),
        absent_with=data.get("absent_with", ""),
        rate_hz=float(data.get("rate_hz", 0.0)),
        as_consumed=data.get("as_consumed", False),
        event=NamedEvent(**data["event"]) if "event" in data else None,
        numbers=tuple(NumberField(n, f["field"], f["unit"]) for n, f in data.get("numbers", {}).items()),
        facts=tuple(data.get("facts", {}).items()),
    )


def _contradictions(data: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """What a channel says that cannot be together: the key, the cause, the remedy."""
    if "event" in data and "decoder" in data:
        yield "event", "both 'event' and 'decoder' say what its messages are", "name one of them"
    if "numbers" in data and not {"event", "decoder"} & data.keys():
        yield "numbers", "no event has its 'numbers'", "add 'event:', or the 'decoder:' that makes the events"
    if data.get("as_consumed") and not data.get("signals"):
        yield "as_consumed", "a channel without signals has nothing as consumed", "map its 'signals:'"
    if "rate_hz" in data and not (data.get("signals") or data.get("decoder")):
        hint = "map its 'signals:'; of poses each entry of 'frames:' and 'models:' has a rate of its own"
        yield "rate_hz", "a channel without signals or a decoder has no rate", hint
    for key in sorted({"event", "facts"} & data.keys()) if "poses" in data else ():
        yield key, f"a channel of poses has no {key!r}", "give the topic a second channel"


_NAMED = {"pair": "two bodies", "body": "one body", ENVIRONMENT: "the environment"}


def _field_map(
    document: YamlDocument, index: int, name: str, fields: list[str], bodies: dict[str, Body]
) -> FieldMap:
    place = document.place(["channels", index, "signals", name])
    quantities = ChainMap(_quantities(document), QUANTITIES)  # type: ignore[arg-type]  # it only reads
    quantity = quantities.get(quantity_of(name))
    if quantity is None:
        raise LogMapError(
            f"unknown quantity {quantity_of(name)!r}",
            file=document.file,
            place=place,
            hint=did_you_mean(quantity_of(name), quantities, what="quantities"),
        )
    subjects = subject_of(name).split("/")
    # A signal of an undeclared body would be read, and no monitor would ever look at it.
    known = [ENVIRONMENT] if quantity.of == ENVIRONMENT else bodies
    unknown = [s for s in subjects if s not in known]
    distinct = set(subjects)  # no body is at a distance from itself
    if unknown or not len(subjects) == len(distinct) == (2 if quantity.of == "pair" else 1):
        raise LogMapError(
            f"signal {name!r} does not name {_NAMED[quantity.of]}",
            file=document.file,
            place=place,
            hint=did_you_mean(unknown[0] if unknown else name, known, what="bodies of this log map"),
        )
    if len(fields) != quantity.components:
        raise LogMapError(
            f"{quantity_of(name)} has {quantity.components} component(s), {len(fields)} field(s) are given",
            file=document.file,
            place=place,
            hint="give one field for each component, such as [p.x, p.y, p.z]",
        )
    return FieldMap(name, quantity.unit, tuple(fields))
