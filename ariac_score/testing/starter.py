"""What `ariac-score new` writes: a check in one file, the distribution it grows into, or a reader's."""

from __future__ import annotations

import keyword
import re
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from string import Template

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import Registry
from ariac_score.errors import UsageError
from ariac_score.scoring.ruleset import load_rule_set

__all__ = ["KINDS", "check_name", "new_files", "our_version", "written"]

KINDS = {"monitor": "ariac_score.monitors", "rule": "ariac_score.rules", "reader": "ariac_score.readers"}
"""What can be made, and the entry-point group of each."""

_TEMPLATES = Path(__file__).parent / "templates"
_WORD = r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*"
_NAME = re.compile(rf"{_WORD}(?:\.{_WORD})*")


def new_files(kind: str, name: str, into: Path) -> list[Path]:
    """Write a new plugin: a monitor or rule as one file, with its rule set and its test beside it.

    A reader comes as a whole distribution, in a folder of its own: no rule set can name the file of one.

    Args:
        kind: `monitor`, `rule` or `reader`.
        name: Name of the plugin, such as `calm_robot` or `workshop.calm_robot`.
        into: Folder in which the files, or the folder, are made.

    Returns:
        The files, as they stand in `into`.

    Raises:
        UsageError: The name cannot be one, is taken, or a file exists.
    """
    check_name(name)
    root = _TEMPLATES / kind
    templates = {t.relative_to(root): t.read_text(encoding="utf-8") for t in sorted(root.rglob("*.tmpl"))}
    facts = _facts(kind, name, "".join(templates.values()))
    folder = into / facts["distribution"] if kind == "reader" else into
    # All texts before the first file: a template that fails leaves no half of a folder.
    return written(
        folder, {_place(place, facts): Template(text).substitute(facts) for place, text in templates.items()}
    )


def written(folder: Path, texts: dict[Path, str]) -> list[Path]:
    """Write new files into a folder.

    Args:
        folder: Made where it is not there.
        texts: By place within it.

    Raises:
        UsageError: One of them exists already, or the folder cannot be written.
    """
    for place in texts:
        if (folder / place).exists():
            raise UsageError(
                "exists already",
                file=folder / place,
                hint="nothing is overwritten; choose another name or place",
            )
    try:
        for place, text in texts.items():
            file = folder / place
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8", newline="\n")
    except OSError as cause:
        raise UsageError(
            f"cannot be written: {cause.strerror}", file=folder, hint="choose another place"
        ) from cause
    return [folder / place for place in sorted(texts)]


def our_version() -> str:
    """The first two numbers of the version of this package."""
    return ".".join(version("ariac-score").split(".")[:2])


def _facts(kind: str, name: str, written: str) -> dict[str, str]:
    """The values of the placeholders.

    Args:
        kind: As for `new_files`.
        name: Likewise.
        written: The text of all templates, so that the class gets a name that none of them uses.
    """
    module, last = name.replace(".", "_"), name.rpartition(".")[2]
    cls = "".join(word.capitalize() for word in last.split("_"))
    if keyword.iskeyword(cls) or re.search(rf"\b{cls}\b", written):  # `fair.none`, `fair.finding`
        cls += kind.capitalize()
    return {
        "kind": kind,
        "name": name,
        "group": KINDS[kind].rpartition(".")[2],
        "module": module,
        "distribution": module.replace("_", "-"),
        "check": f"{module}_{kind}" if module in _taken() else module,
        "cls": cls,
        "version": our_version(),
    }


def _taken() -> set[str]:
    """The names in the rule set that the new one extends; a check of such a name would replace that one."""
    extended = load_rule_set("paper2020.published")
    terms = {name for level in extended.sheet.terms.values() for name in level}
    return {*extended.checks, *extended.sheet.parameters, *terms}


def _place(template: Path, facts: dict[str, str]) -> Path:
    return Path(template.as_posix().removesuffix(".tmpl").replace("MODULE", facts["module"]))


def check_name(name: str) -> None:
    """Refuse what cannot be a plugin's name, or is one already.

    Raises:
        UsageError: Saying what would do.
    """
    if not _NAME.fullmatch(name):
        plain = re.sub("[^a-z0-9]+", "_", name.lower()).strip("_0123456789") or "calm_robot"
        raise UsageError(
            f"{name!r} cannot be the name of a plugin",
            hint=f"name it family.check, in small letters, digits and single underscores: workshop.{plain}",
        )
    reserved = [word for word in name.split(".") if keyword.iskeyword(word)]
    if reserved:
        raise UsageError(f"{reserved[0]!r} is a word of Python", hint="choose another name")
    registry = Registry()
    for group in GROUPS:
        for plugin in registry.providers(group, name):
            raise UsageError(
                f"{name!r} is provided by {plugin.distribution} {plugin.version}",
                hint="two distributions with one name are both refused; choose another",
            )
    # Found by import, whichever distribution it is of: its module would hide the new one, or be hidden.
    module = name.replace(".", "_")
    if module in sys.stdlib_module_names or find_spec(module) is not None:
        raise UsageError(f"there is a module {module!r} already", hint="choose another name")
