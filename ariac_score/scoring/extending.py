"""Files of rule sets, and what they extend: merged into one document before anything in it is used."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from ariac_score.checks.origins import KEY as RESTS_ON
from ariac_score.checks.origins import both_origins, note_origin
from ariac_score.checks.registry import Plugin, Registry, is_local, parameters_of
from ariac_score.documents.schema import schema, validate
from ariac_score.documents.yaml import YamlDocument, load_yaml, parse_yaml, read_text
from ariac_score.errors import PluginError, PluginNotFoundError, RuleSetError, UsageError, did_you_mean
from ariac_score.scoring.forms import merged_terms
from ariac_score.scoring.named import as_stated, merged_parameters

__all__ = [
    "COMPETITIONS",
    "GROUP",
    "LAYOUTS",
    "competitions_with",
    "expanded_document",
    "own_document",
    "path_of_rule_set",
    "rule_set_names",
    "unknown_keys",
    "written_document",
]

TEXT_FILES = (".rml",)
"""A parameter that names a file ending so stands for its text."""

MAX_TEXT_BYTES = 1_000_000
MAX_EXTENDS = 32
"""Rule sets that may extend each other in a row."""

GROUP = "ariac_score.rule_sets"
COMPETITIONS = "ariac_score.competitions"
LAYOUTS = "layouts"


def rule_set_names(registry: Registry | None = None) -> list[str]:
    """The installed rule sets."""
    return sorted({file.name for file in (registry or Registry()).files(GROUP)})


def path_of_rule_set(name: str, folder: Path, registry: Registry) -> Path:
    """The file of a rule set, by name or by path relative to a folder."""
    if name.endswith((".yaml", ".yml")) or "/" in name:
        return folder / name
    try:
        return registry.file(GROUP, name).path
    except PluginNotFoundError:
        known = did_you_mean(name, rule_set_names(registry), what="installed rule sets")
        beside = ""
        with suppress(OSError, ValueError):  # some names can be that of no file
            files = (f"{name}{end}" for end in (".yaml", ".yml"))
            beside = next((file for file in files if (folder / file).is_file()), "")
        known += f"{' A' if known.endswith('?') else '; a'} path to a .yaml file works too"
        raise UsageError(
            f"there is no rule set {name!r}", hint=f"did you mean the file {beside!r}?" if beside else known
        ) from None


def own_document(path: Path) -> YamlDocument:
    """What a rule set file and its file for auditors say themselves, checked against the schema.

    Raises:
        RuleSetError: One of them cannot be read, or breaks the schema.
    """
    return _with_audit(_written(load_yaml(path, error=RuleSetError)))


def expanded_document(path: Path, below: tuple[Path, ...], registry: Registry) -> YamlDocument:
    """A rule set file with what it extends merged in, checked against the schema."""
    # Texts come before merging: names of files are relative to this file's folder.
    document = _with_texts(own_document(path))
    base_name = document.data.pop("extends", None)
    if base_name is None:
        return document
    place = document.place(["extends"])
    if path.resolve() in below or len(below) >= MAX_EXTENDS:
        raise RuleSetError(
            "rule sets extend each other in a circle",
            file=path,
            place=place,
            hint="one must stand alone",
        )
    try:
        base = expanded_document(
            path_of_rule_set(base_name, path.parent, registry), (*below, path.resolve()), registry
        )
    except UsageError as error:
        raise RuleSetError(error.cause, file=path, place=place, hint=error.hint) from error
    _refuse_local_of_elsewhere(base, document)
    note_origin(base.data, GROUP, base_name, registry)
    base.data["log_map"] = _named_from(path, base.file, base.data["log_map"])
    base.data["include"] = [_named_from(path, base.file, name) for name in base.data.get("include", [])]
    return replace(document, data=_merged(base.data, document.data))


def _with_audit(document: YamlDocument) -> YamlDocument:
    """The document with what the file for auditors says that it names."""
    data = dict(document.data)
    name = data.pop("audit", None)
    if name is None:
        return document
    place = document.place(["audit"])
    try:
        audit = load_yaml(Path(document.file).parent / name, error=RuleSetError)
        validate(audit, "ruleset", definition="for_auditors", error=RuleSetError)
    except RuleSetError as error:
        if not error.place:  # of the whole file: it is missing, or empty
            error.cause, error.file, error.place = f"{name}: {error.cause}", document.file, place
        raise
    for key in audit.data:
        if key in data:
            raise RuleSetError(
                f"{key!r} stands here and in {name!r}",
                file=document.file,
                place=document.place([key]),
                hint="keep it in one of the two",
            )
    return replace(
        document,
        data={**data, **audit.data},
        lines={**document.lines, **{path: line for path, line in audit.lines.items() if path}},
        files=dict.fromkeys(audit.data, audit.file),
    )


def _refuse_local_of_elsewhere(base: YamlDocument, document: YamlDocument) -> None:
    """Refuse to inherit a check in a file from another folder, for its name is relative to that folder."""
    if Path(base.file).parent.resolve() == Path(document.file).parent.resolve():
        return
    for key in ("rules", "monitors"):
        for name, body in base.data.get(key, {}).items():
            replaced = any("use" in document.data.get(own, {}).get(name, {}) for own in ("rules", "monitors"))
            if is_local(body.get("use", "")) and not replaced:
                raise RuleSetError(
                    f"the check {name!r} that it inherits is in the file {body['use']!r} of another folder",
                    file=document.file,
                    place=document.place(["extends"]),
                    hint="keep both rule sets in one folder, or grow the file: ariac-score new distribution",
                )


def _with_texts(document: YamlDocument) -> YamlDocument:
    """The document with the text of every file that a parameter names in its place.

    So the file counts as part of the rule set: a result holds it, and changes with it.
    """
    for key in ("rules", "monitors"):
        for name, body in document.data.get(key, {}).items():
            for parameter, value in body.get("with", {}).items():
                if isinstance(value, str) and _is_text_file(value):
                    body["with"][parameter] = _text_of(
                        document, (key, name, "with", parameter), value.strip()
                    )
    return document


def _is_text_file(value: str) -> bool:
    # The parameter may also hold the specification itself, which has a `;` or several lines.
    return value.strip().endswith(TEXT_FILES) and "\n" not in value.strip() and ";" not in value


def _text_of(document: YamlDocument, place: Sequence[str], name: str) -> str:
    """The text of a file named relative to the folder of the rule set.

    Raises:
        RuleSetError: It cannot be read, is too large, or is no UTF-8 text.
    """
    path = Path(document.file).parent / name
    try:
        return read_text(path, error=RuleSetError, max_bytes=MAX_TEXT_BYTES).decode("utf-8-sig")
    except (RuleSetError, UnicodeDecodeError) as error:
        cause = error.cause if isinstance(error, RuleSetError) else "not UTF-8 text"
        raise RuleSetError(
            f"the file {name!r}, which a parameter names: {cause}",
            file=document.file,
            place=document.place(list(place)),
            hint=f"paths are relative to the folder of the rule set; {str(path)!r} was looked for",
        ) from error


def _named_from(file: Path, base: str, name: str) -> str:
    """A name in the file of a base, usable from a rule set that extends it: a path starts from its folder."""
    if not name.endswith((".yaml", ".yml")) or Path(name).is_absolute():
        return name
    return os.path.relpath(Path(base).parent / name, file.parent)


def _merged(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """The base with what is new or changed; a check moved between rules and monitors moves."""
    # `differs` and `breaks` are statements about the base alone; the new rules may not fit them.
    merged = {**{key: value for key, value in base.items() if key not in ("differs", "breaks")}, **own}
    if RESTS_ON in merged:
        merged[RESTS_ON] = both_origins(base.get(RESTS_ON, {}), own.get(RESTS_ON, {}))
    merged["notes"] = [*base.get("notes", []), *own.get("notes", [])]
    merged["cohort"] = {**base.get("cohort", {}), **own.get("cohort", {})}
    merged["parameters"] = merged_parameters(base.get("parameters", {}), own.get("parameters", {}))
    for key in ("rules", "monitors"):
        merged[key] = _merged_checks(base.get(key, {}), own.get(key, {}))
    for key in ("safety", "ranges", "bounds"):
        if key in base or key in own:
            both = {**base.get(key, {}), **own.get(key, {})}
            merged[key] = {name: body for name, body in both.items() if key != "ranges" or body is not None}
    if not merged.get("include"):
        merged.pop("include", None)
    for key, other in (("rules", "monitors"), ("monitors", "rules")):
        for name in own.get(key, {}):
            if name not in own.get(other, {}):
                merged[other].pop(name, None)
    merged["terms"] = _merged_levels(base, own, "terms")
    for key in ("printed", "adds_up", "facts"):
        if key in merged:
            merged[key] = _merged_levels(base, own, key)
    if "layouts" in own.get("printed", {}):  # replaced whole: other rules have other texts
        merged["printed"]["layouts"] = own["printed"]["layouts"]
    return merged


def _merged_checks(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Checks by name: one that names its plugin stands as written, any other changes that of the base."""
    # So a parameter can be left to the plugin again: the check is written whole, without it.
    merged = dict(base)
    for name, body in own.items():
        before = {} if "use" in body else base.get(name, {})
        given = {**before.get("with", {}), **body.get("with", {})}
        merged[name] = {**before, **body, **({"with": given} if given else {})}
    return merged


def _merged_levels(base: Mapping[str, Any], own: Mapping[str, Any], key: str) -> dict[str, Any]:
    """What is named for each level, the base's with what is new or changed."""
    first, second = base.get(key, {}), own.get(key, {})
    levels = dict.fromkeys(level for level in (*first, *second) if level != LAYOUTS)
    return {level: merged_terms(first.get(level, {}), second.get(level, {})) for level in levels}


def written_document(text: str, *, file: str) -> YamlDocument:
    """The text of a rule set, checked against the schema.

    Raises:
        RuleSetError: It is not the text of a rule set.
    """
    return _written(parse_yaml(text.encode("utf-8"), file=file, error=RuleSetError))


def _refuse_local_competition(document: YamlDocument) -> None:
    """Say of a competition in a file what its pattern in the schema cannot."""
    body = document.data.get("competition") if isinstance(document.data, dict) else None
    use = body.get("use") if isinstance(body, dict) else None
    if isinstance(use, str) and is_local(use):
        raise RuleSetError(
            f"{use!r} is a class in a file, and a competition comes by an installed distribution alone",
            file=document.file,
            place=document.place(["competition", "use"]),
            hint="write 'levels:' and 'facts:' here instead, or install what brings it, "
            "under the entry point 'ariac_score.competitions'",
        )


def _written(document: YamlDocument) -> YamlDocument:
    _refuse_its_parameters(document)
    _refuse_local_competition(document)
    validate(document, "ruleset", error=RuleSetError)
    data = document.data
    if "parameters" in data:
        data = {**data, "parameters": as_stated(data["parameters"])}
    return replace(document, data=data)


def _refuse_its_parameters(document: YamlDocument, registry: Registry | None = None) -> None:
    """Refuse a parameter of the competition at the top of a rule set, and say where it belongs.

    Raises:
        RuleSetError: Naming the key and the line to write.
    """
    for key, value in unknown_keys(document).items():
        for name in competitions_with(key, registry or Registry()):
            raise RuleSetError(
                f"{key!r} is a parameter of the competition",
                file=document.file,
                place=document.place([key]),
                hint=f"write 'competition: {{use: {name}, with: {{{key}: {value}}}}}'",
            )


def unknown_keys(document: YamlDocument) -> dict[str, Any]:
    """What stands at the top of a rule set under a key that no rule set has."""
    data = document.data if isinstance(document.data, Mapping) else {}
    return {str(key): value for key, value in data.items() if key not in schema("ruleset")["properties"]}


def competitions_with(parameter: str, registry: Registry) -> list[str]:
    """The installed competitions that have a parameter of that name."""
    return [plugin.name for plugin in registry.all(COMPETITIONS) if parameter in _parameters_if_any(plugin)]


def _parameters_if_any(plugin: Plugin) -> Mapping[str, Any]:
    try:
        return parameters_of(plugin.load())
    except (PluginError, NameError, TypeError, AttributeError):  # broken: whoever uses it is told so
        return {}
