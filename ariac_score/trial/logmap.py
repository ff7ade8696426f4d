"""Log maps: loading and checking the YAML that says which topic and field is which signal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ariac_score.documents.schema import shipped_rules, validate
from ariac_score.documents.yaml import YamlDocument, load_yaml
from ariac_score.errors import LogMapError, did_you_mean
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, LogMap, PluginUse
from ariac_score.trial.model import Body
from ariac_score.trial.vocabulary import QUANTITIES, Quantity, quantity_of, subject_of

__all__ = ["is_log_map_file", "load_log_map", "log_map_names"]

_FILE = "log_map"


def log_map_names() -> list[str]:
    """The names of the shipped log maps."""
    return sorted(name.rpartition(".")[0] for name in shipped_rules() if name.rpartition(".")[2] == _FILE)


def is_log_map_file(name: str) -> bool:
    """Whether a log map is named by the path of a file; no shipped one has such a name."""
    return name.endswith((".yaml", ".yml")) or "/" in name


def load_log_map(name: str, *, beside: Path | None = None) -> LogMap:
    """Load a shipped log map by name, or one from a file by its path.

    Args:
        name: Such as `ariac2020`, or a path ending in `.yaml`.
        beside: Folder that a relative path starts from; by default the current one.

    Raises:
        LogMapError: Unknown name, malformed file, or a signal that does not fit
            the vocabulary.
    """
    if is_log_map_file(name):
        path = (beside or Path()) / name
    else:
        shipped = shipped_rules().get(f"{name}.{_FILE}")
        if shipped is None:
            raise LogMapError(
                f"there is no log map {name!r}",
                hint=did_you_mean(name, log_map_names(), what="shipped log maps"),
            )
        path = shipped
    document = load_yaml(path, error=LogMapError)
    validate(document, "log_map", error=LogMapError)
    return _parsed(document)


def _parsed(document: YamlDocument) -> LogMap:
    data = document.data
    # `float` everywhere: YAML gives an integer where the author writes 1 for 1.0.
    bodies = {
        key: Body(key, b["kind"], float(b.get("radius_m", 0.0))) for key, b in data.get("bodies", {}).items()
    }
    return LogMap(
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
    )


def _quantities(document: YamlDocument) -> dict[str, Quantity]:
    """The quantities the map brings of its own; those of the vocabulary cannot be changed."""
    declared = document.data.get("quantities", {})
    taken = sorted(set(declared) & set(QUANTITIES))
    if taken:
        raise LogMapError(
            f"quantity {taken[0]!r} has its meaning already",
            file=document.file,
            place=document.place(["quantities", taken[0]]),
            hint="choose another name",
        )
    return {
        name: Quantity(q["unit"], q.get("components", 1), q["of"], q.get("meaning", ""))
        for name, q in declared.items()
    }


def _plugin_use(document: YamlDocument, section: str) -> PluginUse | None:
    data = document.data.get(section)
    if data is None:
        return None
    parameters = data.get("with", {})
    place = {name: document.place([section, "with", name]) for name in parameters}
    return PluginUse(data["use"], parameters, str(document.file), {**place, "": document.place([section])})


def _match(data: dict[str, Any]) -> BodyMatch:
    return BodyMatch(
        match=data["match"],
        kind=data["kind"],
        body=data.get("body", ""),
        radius_m=float(data.get("radius_m", 0.0)),
        links=tuple(data.get("links", [])),
    )


def _channel(document: YamlDocument, index: int, data: dict[str, Any], bodies: dict[str, Body]) -> Channel:
    signals = tuple(
        _field_map(document, index, name, [fields] if isinstance(fields, str) else fields, bodies)
        for name, fields in data.get("signals", {}).items()
    )
    if not (signals or data.get("poses") or data.get("decoder") or data.get("witnesses")):
        raise LogMapError(
            "a channel must map signals, poses or a decoder, or witness something",
            file=document.file,
            place=document.place(["channels", index]),
            hint="add 'signals:', 'poses:', 'decoder:' or 'witnesses:'",
        )
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
    )


def _field_map(
    document: YamlDocument, index: int, name: str, fields: list[str], bodies: dict[str, Body]
) -> FieldMap:
    place = document.place(["channels", index, "signals", name])
    quantities = {**QUANTITIES, **_quantities(document)}
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
    unknown = [s for s in subjects if s not in bodies]
    kinds = [bodies[s].kind for s in subjects if s in bodies]
    wrong_pair = quantity.of == "pair" and kinds != ["robot", "human"]
    if unknown or wrong_pair or len(subjects) != (2 if quantity.of == "pair" else 1):
        raise LogMapError(
            f"signal {name!r} does not name {'a robot and a human' if quantity.of == 'pair' else 'one body'}",
            file=document.file,
            place=place,
            hint=did_you_mean(unknown[0] if unknown else name, bodies, what="bodies of this log map"),
        )
    if len(fields) != quantity.components:
        raise LogMapError(
            f"{quantity_of(name)} has {quantity.components} component(s), {len(fields)} field(s) are given",
            file=document.file,
            place=place,
            hint="give one field for each component, such as [p.x, p.y, p.z]",
        )
    return FieldMap(name, quantity.unit, tuple(fields))
