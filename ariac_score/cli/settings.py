"""Settings that a command line leaves out: from the environment, or from a file above the working folder.

The file is `ariac-score.toml`, or `pyproject.toml` with a table `tool.ariac-score`. It is searched for from
the working folder upwards, never beside a log: nobody who hands in a log can set how it is scored. Nothing
in it is run, and it cannot allow code (`--local-plugins`).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ariac_score.cli.parser import leaves
from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import DataFileError, UsageError, did_you_mean
from ariac_score.terminal.style import plain

__all__ = ["COMMANDS", "SETTINGS", "Setting", "Settings", "Taken", "load_settings", "settle", "tell"]

FILE = "ariac-score.toml"
PROJECT = "pyproject.toml"
MAX_BYTES = 1_000_000


@dataclass(frozen=True)
class Setting:
    """What may be set outside of the command line.

    Attributes:
        name: In a file, and as an option.
        kind: `text`, `number`, `flag`, `list`; `rules` for a name or a .yaml file, `path` for a file or
            folder.
        about: What it says.
        commands: Those it is for; they have an option of its name.
        matters: Whether a result depends on it, so that it is said whence it comes.
    """

    name: str
    kind: str
    about: str
    commands: tuple[str, ...]
    matters: bool = False

    @property
    def dest(self) -> str:
        """The name in Python."""
        return self.name.replace("-", "_")

    @property
    def variable(self) -> str:
        """The environment variable."""
        return f"ARIAC_SCORE_{self.dest.upper()}"


_SHOWN = ("score", "price", "adjust", "export")
SETTINGS = {
    each.name: each
    for each in (
        Setting(
            "rules",
            "rules",
            "rule set: a name or a .yaml file; a competition that names its own keeps them",
            ("score", "check", "info", "map", "price", "rank", "batch", "report", "redteam"),
            matters=True,
        ),
        Setting(
            "log-map",
            "rules",
            "log map instead of the rule set's own: a name or a .yaml file",
            ("score", "check", "info", "redteam"),
            matters=True,
        ),
        Setting("cohort", "path", "cohort.json of the organisers", ("score", "price"), matters=True),
        Setting(
            "public-key",
            "path",
            "who must have signed what is stored: the file of a key",
            ("verify", "rank", "batch", "merge"),
        ),
        Setting("output-format", "text", "where a command knows it", (*_SHOWN, "check", "audit")),
        Setting("output-folder", "path", "where 'report' puts the page of a result", ("report",)),
        Setting("fail-on", "list", "when the exit code is 1, such as violation", _SHOWN),
        Setting("jobs", "number", "threads that read a log; runs of a batch at a time", ("score", "batch")),
        Setting("time-limit-s", "number", "how long a run may take, in s", ("score", "batch")),
        Setting(
            "partial",
            "flag",
            "whether logs that are cut off are scored as far as they go, unofficially",
            ("score", "check", "info", "batch", "rank"),
            matters=True,
        ),
        Setting("memory-mb", "number", "address space of a run, in MiB", ("batch",)),
    )
}
"""All there are. `--local-plugins` is none of them: a file that is merely found may not allow code."""

_COMPETITIONS = ("rank", "batch", "report")
"""Commands whose argument may name its own rules, which no setting replaces."""
COMMANDS = tuple(dict.fromkeys(command for each in SETTINGS.values() for command in each.commands))


@dataclass(frozen=True)
class Taken:
    """A setting with where it comes from, such as `ariac-score.toml, line 2` or `ARIAC_SCORE_RULES`."""

    setting: Setting
    value: Any
    origin: str
    general: bool = True


@dataclass(frozen=True)
class Settings:
    """What the environment and one file say.

    Attributes:
        file: The file; `None` where there is none.
        taken: What they say for each command, by its name and that of the setting.
    """

    file: Path | None
    taken: Mapping[tuple[str, str], Taken]

    def of(self, command: str) -> dict[str, Taken]:
        """The settings for a command, by name."""
        return {name: taken for (one, name), taken in self.taken.items() if one == command}


# Reading -------------------------------------------------------------------------------


def load_settings(
    folder: Path, environment: Mapping[str, str], *, file: Path | None = None, search: bool = True
) -> Settings:
    """The settings in force in a folder: those of the environment come before those of a file.

    Args:
        folder: Where the search begins; it goes up from there.
        environment: Variables by name.
        file: The file to read instead of searching; `ARIAC_SCORE_CONFIG` may name it, too.
        search: Whether a file is searched for.

    Raises:
        DataFileError: The file cannot be read, or says something that is no setting.
        UsageError: A variable has a value of another kind.
    """
    named = environment.get("ARIAC_SCORE_CONFIG", "")
    if file is None and named and search:
        file = Path(named)
    if file is None and search:
        file = _found(folder)
    taken = {} if file is None else _from_file(file, folder)
    for setting in SETTINGS.values():
        text = environment.get(setting.variable, "")
        if text:
            one = Taken(setting, _from_text(setting, text), setting.variable)
            taken |= {(command, setting.name): one for command in setting.commands}
    return Settings(file, taken)


def _found(folder: Path) -> Path | None:
    """The nearest file with settings, from a folder upwards.

    Raises:
        DataFileError: Two files of one folder have some.
    """
    for place in (folder, *folder.parents):
        with suppress(OSError):  # a folder that may not be looked into has none for this user
            here = [file for file in (place / FILE, place / PROJECT) if file.is_file()]
            own = [file for file in here if file.name == FILE or _has_table(file)]
            if len(own) > 1:
                raise DataFileError(
                    f"{PROJECT} beside it has a table [tool.ariac-score] as well",
                    file=_shown(own[0], folder),
                    hint="keep the settings in one of them",
                )
            if own:
                return own[0]
    return None


def _has_table(file: Path) -> bool:
    # Searched as text: a project's file that is malformed for reasons of its own is none of our business.
    with suppress(OSError):
        if file.stat().st_size <= MAX_BYTES:
            return (
                re.search(rb"(?m)^[ \t]*\[tool\.(\"?)ariac-score\1[\].]", read_plain(file, MAX_BYTES))
                is not None
            )
    return False


def _shown(file: Path, folder: Path) -> str:
    """A file as a user in a folder would name it."""
    with suppress(ValueError):
        return os.path.relpath(file, folder)
    return str(file)


def _from_file(file: Path, folder: Path) -> dict[tuple[str, str], Taken]:
    name = _shown(file, folder)
    text = _text(file, name)
    table, prefix = _parsed(text, name), ""
    if file.name == PROJECT:
        table, prefix = table.get("tool", {}).get("ariac-score", {}), "tool.ariac-score"
    if not isinstance(table, dict):
        raise DataFileError("[tool.ariac-score] is no table", file=name, hint="write settings below it")
    reading = _Reading(name, file.resolve().parent, text, prefix)
    general: dict[tuple[str, str], Taken] = {}
    of_commands: dict[tuple[str, str], Taken] = {}
    for key, value in table.items():
        if key in SETTINGS:
            one = reading.taken(SETTINGS[key], value)
            general |= {(command, key): one for command in one.setting.commands}
        elif key in COMMANDS and isinstance(value, dict):
            of_commands |= {(key, one.setting.name): one for one in reading.of_command(key, value)}
        else:
            raise reading.unknown(key, value)
    return general | of_commands


def _text(file: Path, name: str) -> str:
    try:
        if file.stat().st_size > MAX_BYTES:
            words = f"it is larger than {MAX_BYTES:,} bytes"
            raise DataFileError(words, file=name, hint="is it the right file?")
        return read_plain(file, MAX_BYTES).decode("utf-8")
    except OSError as cause:
        reason = cause.strerror or type(cause).__name__
        raise DataFileError(
            f"cannot be read: {reason}", file=name, hint="repair it, or go without: --no-config"
        ) from None
    except UnicodeDecodeError as cause:
        raise DataFileError(
            "it is not UTF-8 text", file=name, place=f"byte {cause.start}", hint="save it as UTF-8"
        ) from None


def _parsed(text: str, name: str) -> dict[str, Any]:
    # Imported here: most calls find no file.
    if sys.version_info >= (3, 11):
        import tomllib as toml  # noqa: PLC0415
    else:
        import tomli as toml  # noqa: PLC0415
    try:
        return toml.loads(text)
    except (toml.TOMLDecodeError, RecursionError) as cause:
        line = re.search(r"line (\d+)", str(cause))
        words = re.sub(r" \(at .*\)$", "", str(cause))
        raise DataFileError(
            f"not TOML: {words[:1].lower()}{words[1:]}",
            file=name,
            place=f"line {line[1]}" if line else "its end",
            hint='settings look like this: rules = "paper2020"',
        ) from None


@dataclass(frozen=True)
class _Reading:
    """A file that is being read: its name, folder, text, and the table that is ours."""

    name: str
    folder: Path
    text: str
    prefix: str

    def line(self, key: str, command: str = "") -> int:
        """The line of a key, as far as it stands in one of its own; else 0."""
        wanted = ".".join(part for part in (self.prefix, command) if part)
        table = ""
        for number, line in enumerate(self.text.splitlines(), start=1):
            header = re.match(r"\s*\[([^\[\]]+)\]", line)
            if header:
                table = re.sub(r"[\s\"']", "", header[1])
            is_key = re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*[=.]", line) is not None
            if (is_key and table == wanted) or (header and table == f"{wanted}.{key}".lstrip(".")):
                return number
        return 0

    def origin(self, key: str, command: str = "") -> str:
        """Where a setting stands."""
        line = self.line(key, command)
        return f"{self.name}, line {line}" if line else self.name

    def taken(self, setting: Setting, value: Any, command: str = "") -> Taken:
        """A setting, checked.

        Raises:
            DataFileError: Its value is of another kind.
        """
        kinds: dict[str, Any] = {"number": (int, float), "list": list, "flag": bool}
        kind = kinds.get(setting.kind, str)
        right = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
        if right and kind is list:
            right = all(isinstance(item, str) for item in value)
        if not right or value == "":
            words = {
                "number": "a number",
                "flag": "true or false",
                "list": 'a list of texts, such as ["violation"]',
            }
            wanted = words.get(setting.kind, "a text in quotes")
            cause = f"{setting.name} cannot be {json.dumps(value, default=str)[:60]}"
            raise self.error(cause, setting.name, command, f"give {wanted}")
        if setting.kind == "path" or (setting.kind == "rules" and _is_file(value)):
            value = os.path.relpath(self.folder / value)  # it is relative to the file that names it
        return Taken(setting, value, self.origin(setting.name, command), general=not command)

    def of_command(self, command: str, table: Mapping[str, Any]) -> Iterable[Taken]:
        """The settings of the table of a command."""
        for key, value in table.items():
            setting = SETTINGS.get(key)
            if setting is None or command not in setting.commands:
                known = [name for name, one in SETTINGS.items() if command in one.commands]
                hint = did_you_mean(key, known, what="it can have")
                raise self.error(f"'{command}' has no setting {key!r}", key, command, hint)
            yield self.taken(setting, value, command)

    def unknown(self, key: str, value: Any) -> DataFileError:
        """The error about a key that is neither a setting nor a command."""
        if key in ("local-plugins", "local_plugins"):
            hint = "code is allowed on the command line alone: --local-plugins"
        elif isinstance(value, dict):
            hint = did_you_mean(key, COMMANDS, what="tables can be")
        else:
            hint = did_you_mean(key, SETTINGS, what="settings are")
        what = "table" if isinstance(value, dict) else "setting"
        return self.error(f"there is no {what} {key!r}", key, "", hint)

    def error(self, cause: str, key: str, command: str, hint: str) -> DataFileError:
        """An error in this file."""
        line = self.line(key, command)
        return DataFileError(cause, file=self.name, place=f"line {line}" if line else "", hint=hint)


def _is_file(name: str) -> bool:
    return "/" in name or name.endswith((".yaml", ".yml"))


_FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def _from_text(setting: Setting, text: str) -> Any:
    """The value of an environment variable."""
    if setting.kind == "list":
        return [item.strip() for item in text.split(",") if item.strip()]
    if setting.kind == "flag":
        if text.lower() not in _FLAGS:
            hint = f"give one of {', '.join(_FLAGS)}"
            raise UsageError(f"{text!r} is neither yes nor no", file=setting.variable, hint=hint)
        return _FLAGS[text.lower()]
    if setting.kind == "number":
        try:
            return float(text) if "." in text else int(text)
        except ValueError:
            raise UsageError(f"{text!r} is no number", file=setting.variable, hint="give a number") from None
    return text


# Use -----------------------------------------------------------------------------------


def settle(
    parser: argparse.ArgumentParser, command: str, given: Sequence[str], settings: Settings
) -> tuple[argparse.Namespace, list[Taken]]:
    """Parse a command line; what it leaves out is taken from the settings.

    Args:
        parser: Of the whole command line.
        command: The one that is called.
        given: The command line.
        settings: What the environment and a file say.

    Returns:
        The arguments, and the settings that are in force because the command line says nothing.
    """
    known = settings.of(command)
    defaults: dict[str, Any] = {}
    for leaf in leaves(parser):
        for action in leaf._actions:
            taken = known.get(action.dest.replace("_", "-"))
            if taken is not None:
                known[taken.setting.name] = _converted(action, taken, command)
                defaults[action.dest] = action.default
                action.default, action.required = None, False
    arguments = parser.parse_args(list(given))
    used = []
    for dest, default in defaults.items():
        if getattr(arguments, dest, None) is None:
            taken = known[dest.replace("_", "-")]
            applies = taken.value is not None and not (dest == "rules" and _names_its_own(arguments, command))
            setattr(arguments, dest, taken.value if applies else default)
            used += [taken] if applies else []
    return arguments, used


def _converted(action: argparse.Action, taken: Taken, command: str) -> Taken:
    """A setting with its value as the option has it; `None` where this command has no such value.

    Raises:
        UsageError: The option does not take the value.
    """
    values = taken.value if isinstance(taken.value, list) else [taken.value]
    name = taken.setting.name
    for value in values:
        if action.choices is not None and value not in action.choices:
            if taken.general and command not in _SHOWN:
                return replace(taken, value=None)  # other commands know more formats
            hint = did_you_mean(value, map(str, action.choices), what="it can be")
            raise UsageError(f"{name} cannot be {value!r}", file=taken.origin, hint=hint)
    convert: Any = action.type
    if convert is None:
        return taken
    try:
        converted = [convert(str(value)) for value in values]
    except (argparse.ArgumentTypeError, ValueError) as cause:
        raise UsageError(f"{name}: {cause}", file=taken.origin, hint=taken.setting.about) from None
    return replace(taken, value=converted if isinstance(taken.value, list) else converted[0])


def _names_its_own(arguments: argparse.Namespace, command: str) -> bool:
    """Whether what a command is called with says by which rules: a competition, a ranking, a result."""
    if command not in _COMPETITIONS:
        return False
    path = Path(arguments.result if command == "report" else arguments.path)
    plain_folder = path.is_dir() and not (path / "competition.yaml").is_file()
    return not plain_folder and not (command == "batch" and path.suffix == ".txt" and path.is_file())


def tell(arguments: argparse.Namespace, taken: Sequence[Taken], settings: Settings) -> None:
    """Say on stderr where the settings come from: those that a result depends on, and all of them with -v."""
    verbosity = getattr(arguments, "verbosity", 0)
    for one in taken:
        if verbosity > 0 or (one.setting.matters and verbosity == 0):
            value = ", ".join(map(str, one.value)) if isinstance(one.value, list) else one.value
            print(plain(f"{one.setting.name}: {value} ({one.origin})"), file=sys.stderr)
    if verbosity > 0:
        where = "none is in force" if settings.file is None else _shown(settings.file, Path.cwd())
        print(plain(f"file of settings: {where}"), file=sys.stderr)
