"""A local plugin grown into a distribution: the author's files unchanged, and what installs them around."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

from ariac_score.checks.local import LocalFiles
from ariac_score.checks.registry import Registry, is_local
from ariac_score.documents.yaml import YamlDocument, load_yaml, parse_yaml
from ariac_score.errors import UsageError
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.testing.starter import check_name, our_version, written

__all__ = ["grow"]

_TEMPLATES = Path(__file__).parent / "templates/grown"
_SECTIONS = {"rules": "rule", "monitors": "monitor"}


@dataclass(frozen=True)
class _Class:
    """A class that becomes a plugin: its section in rule sets, how they named it, its name from now on."""

    section: str
    use: str
    name: str

    @property
    def module(self) -> str:
        return Path(self.use.partition(":")[0]).stem

    @property
    def cls(self) -> str:
        return self.use.partition(":")[2]


def grow(source: Path, name: str, into: Path) -> list[Path]:
    """Write the distribution that a rule set and the files of code beside it grow into.

    The files of code and the tests are copied byte for byte; rule sets change in nothing but the names
    under `use:`. The originals stay where they are.

    Args:
        source: The rule set, or the folder of the only one that names a class in a file.
        name: Of the one class, such as `workshop.calm_robot`; or the family of all classes, `workshop`.
        into: Folder in which that of the distribution is made.

    Returns:
        Its files, as they stand in `into`.

    Raises:
        UsageError: There is no such rule set, a name cannot be used, or the folder exists.
        ScoreError: A check of the rule set cannot be built.
    """
    file = _rule_set_at(source)
    load_rule_set(file).build(Registry(LocalFiles()))  # nothing broken is grown
    documents = _documents(file)
    classes = _named(documents, name)
    modules = sorted({one.module for one in classes})
    for module in modules:
        _refuse_other_module(module, file.parent)
    home = classes[0].module
    texts = {Path(home) / one.name: _renamed(document, classes) for one, document in documents.items()}
    for module in modules:
        texts[Path(module) / "__init__.py"] = _text(file.with_name(f"{module}.py"))
        texts[Path(module) / "py.typed"] = ""
    for test in sorted([*file.parent.glob("test_*.py"), *file.parent.glob("conftest.py")]):
        texts[Path("tests") / test.name] = _text(test)
    facts = _facts(name, classes, documents, home)
    for template in sorted(_TEMPLATES.glob("*.tmpl")):
        text = template.read_text(encoding="utf-8")
        texts[Path(template.stem)] = Template(text).substitute(facts)
    folder = into / facts["distribution"]
    if folder.exists():
        raise UsageError("exists already", file=folder, hint="nothing is overwritten; choose another place")
    return written(folder, texts)


def _rule_set_at(source: Path) -> Path:
    """The rule set at a path: itself, or the only one of the folder that names a class in a file."""
    if source.is_file():
        return source
    if not source.is_dir():
        raise UsageError("no such file or folder", file=source, hint="name the rule set to grow")
    found = [file for file in sorted(source.glob("*.yaml")) if any(_uses(load_yaml(file).data))]
    if len(found) == 1:
        return found[0]
    words = ", ".join(file.name for file in found) or "none"
    raise UsageError(
        f"one rule set that names a class in a file is wanted, and there is {words}",
        file=source,
        hint="name the rule set itself: --from FOLDER/ours.yaml",
    )


def _uses(data: Any) -> Iterator[tuple[str, str, str]]:
    """Section, check and class of every check in a file that a document names."""
    for section in _SECTIONS if isinstance(data, dict) else ():
        checks = data.get(section)
        for check, body in checks.items() if isinstance(checks, dict) else ():
            use = body.get("use", "") if isinstance(body, dict) else ""
            if isinstance(use, str) and is_local(use):
                yield section, check, use


def _documents(file: Path) -> dict[Path, YamlDocument]:
    """The rule set, and the files of its folder that it names, by path."""
    found: dict[Path, YamlDocument] = {}
    waiting = [file]
    while waiting:
        one = waiting.pop(0)
        if one in found:
            continue
        found[one] = (
            load_yaml(one) if one.suffix in (".yaml", ".yml") else YamlDocument(None, str(one), "", {})
        )
        waiting += [_beside(one, name) for name in _files_named(found[one].data)]
    return found


def _files_named(data: Any) -> Iterator[str]:
    """The names of files in a rule set."""
    if not isinstance(data, dict):
        return
    named = [data.get("extends"), data.get("log_map"), *(data.get("include") or [])]
    for section in _SECTIONS:
        for body in (data.get(section) or {}).values():
            named += (body.get("with") or {}).values() if isinstance(body, dict) else []
    for name in named:
        if isinstance(name, str) and name.strip().endswith((".yaml", ".yml", ".rml")) and "\n" not in name:
            yield name.strip()


def _rule_sets(documents: Mapping[Path, YamlDocument]) -> Iterator[Path]:
    """The rule set and those that it extends; what else it names, such as a log map, is found by path."""
    file: Path | None = next(iter(documents))
    while file is not None:
        yield file
        base = documents[file].data.get("extends", "")
        file = _beside(file, base) if base.endswith((".yaml", ".yml")) else None


def _beside(file: Path, name: str) -> Path:
    path = file.parent / name
    if path.resolve().parent != file.parent.resolve() or not path.is_file():
        raise UsageError(
            f"it names {name!r}, which is no file beside it",
            file=file,
            hint="put the file into the folder of the rule set: a distribution holds what it needs",
        )
    return file.parent / path.name


def _named(documents: Mapping[Path, YamlDocument], name: str) -> list[_Class]:
    """The classes with the names of their plugins; the first is that of the first rule set."""
    found = {use: section for document in documents.values() for section, _, use in _uses(document.data)}
    if not found:
        (file, *_) = documents
        raise UsageError(
            "it names no class in a file",
            file=file,
            hint="'use: ./ours.py:NearMiss' names one; 'ariac-score new monitor NAME' begins one",
        )
    alone = "." in name and len(found) == 1
    classes = [
        _Class(section, use, name if alone else f"{name}.{_snake(use)}") for use, section in found.items()
    ]
    for one in classes:
        check_name(one.name)
    if len({one.name for one in classes}) < len(classes):
        raise UsageError("two of its classes would have one name", hint="give the classes different names")
    return classes


def _snake(use: str) -> str:
    """`NearMiss` as `near_miss`."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", use.partition(":")[2])
    return re.sub(r"_+", "_", words.lower()).strip("_")


def _refuse_other_module(module: str, folder: Path) -> None:
    """Refuse a file whose name an installed module has."""
    spec = find_spec(module)
    if spec is not None and Path(spec.origin or "").resolve() != (folder / f"{module}.py").resolve():
        raise UsageError(
            f"there is a module {module!r} already",
            file=folder / f"{module}.py",
            hint="rename the file, and its name in the rule set: installed, it would hide that one",
        )


def _text(file: Path) -> str:
    try:
        return file.read_bytes().decode("utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        raise UsageError(f"cannot be read: {cause}", file=file, hint="it should be text in UTF-8") from cause


def _renamed(document: YamlDocument, classes: list[_Class]) -> str:
    """The text of a file with the names of plugins in the place of classes in files."""
    text = _text(Path(document.file))
    for one in classes:
        text = re.sub(rf"""(["']?){re.escape(one.use)}\1(?![A-Za-z0-9_])""", one.name, text)
    if document.data is not None:
        data = parse_yaml(text.encode("utf-8"), file=document.file).data
        if list(_uses(data)):
            raise UsageError(
                "a class is named in a way that cannot be replaced",
                file=document.file,
                hint="write it plainly: use: ./ours.py:NearMiss",
            )
    return text


def _facts(
    name: str, classes: list[_Class], documents: Mapping[Path, YamlDocument], home: str
) -> dict[str, str]:
    """The values of the placeholders."""
    points: dict[str, list[str]] = {}
    for one in classes:
        points.setdefault(one.section, []).append(f'"{one.name}" = "{one.module}:{one.cls}"')
    for file in _rule_sets(documents):
        rules_id = documents[file].data["id"]
        if not re.fullmatch(r"\w+", file.stem):
            raise UsageError(
                "cannot be installed by that name", file=file, hint="name it with letters, digits and '_'"
            )
        _refuse_taken_rules(rules_id, file)
        points.setdefault("rule_sets", []).append(f'"{rules_id}" = "{home}:{file.stem}"')
    modules = sorted({one.module for one in classes})
    kinds = " and ".join(f"the {_SECTIONS[one.section]} {one.name}" for one in classes)
    return {
        "distribution": re.sub(r"[._]", "-", name),
        "title": kinds[:1].upper() + kinds[1:],
        "version": our_version(),
        "points": "\n".join(
            f'[project.entry-points."ariac_score.{group}"]\n' + "\n".join(lines) + "\n"
            for group, lines in points.items()
        ),
        "packages": ", ".join(f'"{module}"' for module in modules),
        "data": "\n".join(
            f'{module} = ["py.typed"' + (', "*.yaml", "*.yml", "*.rml"]' if module == home else "]")
            for module in modules
        ),
        "first": classes[0].name,
        "rules": documents[next(iter(documents))].data["id"],
        "rules_file": f"{home}/{next(iter(documents)).name}",
        "modules": ", ".join(f"`{module}/__init__.py`" for module in modules),
    }


def _refuse_taken_rules(rules_id: str, file: Path) -> None:
    for installed in Registry().files("ariac_score.rule_sets"):
        if installed.name == rules_id:
            raise UsageError(
                f"the rule set {rules_id!r} is provided by {installed.plugin.distribution}",
                file=file,
                hint="give it another id: two distributions with one name are both refused",
            )
