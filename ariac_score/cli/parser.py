"""The parser of the command line: errors that say what to do, options that every command has."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ariac_score.errors import did_you_mean

__all__ = ["EXIT_USAGE", "Parser", "add_everywhere", "command_in", "leaves", "subparsers_of"]

EXIT_USAGE = 4
_RULES_HINT = (
    "give --rules NAME ('ariac-score rules list' shows them), or write rules = \"NAME\" into ariac-score.toml"
)


class Parser(argparse.ArgumentParser):
    """A parser whose usage errors have the documented exit code, and name what was nearly right.

    Args:
        groups: The commands under each heading of the help; the others are listed last.
    """

    def __init__(self, *args: Any, groups: Mapping[str, Iterable[str]] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._groups = groups or {}
        self._words: list[str] = []

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and what to do about it, and leave."""
        cause, _, remedy = message.partition("\n")
        if "required" in cause:
            unknown = [word for word in self._words if self._is_unknown(word)]
            if unknown:  # a misspelt option is the likely cause of one that is missing
                self._refuse(unknown)
            remedy = remedy or self._what_is_required(cause)
        for line in (f"error: {cause}", f"hint: {remedy}" if remedy else "", f"help: {self.prog} --help"):
            print(line, file=sys.stderr) if line else None
        self.exit(EXIT_USAGE)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse does, but refuse what is left over here, where the nearest option is known."""
        self._words = list(args or ())
        found, extra = super().parse_known_args(args, namespace)
        if extra:
            self._refuse(extra)
        return found, extra

    def _what_is_required(self, cause: str) -> str:
        below = subparsers_of(self)
        if below is not None:
            names = [row.dest for row in below._get_subactions()]
            return f"one of: {', '.join(names)}" if len(names) < 9 else ""
        return _RULES_HINT if cause.endswith("--rules") else ""

    def _is_unknown(self, word: str) -> bool:
        name = word.partition("=")[0]
        known = self._option_string_actions
        return name.startswith("--") and len(name) > 2 and not any(k.startswith(name) for k in known)

    def _refuse(self, extra: Sequence[str]) -> NoReturn:
        first = next((word for word in extra if word.startswith("-")), extra[0])
        if not first.startswith("-"):
            self.error(f"there is one argument too many: {first!r}")
        name = first.partition("=")[0]
        near = did_you_mean(name, [option for option in self._option_string_actions if option[:2] == "--"])
        self.error(f"there is no option {name!r}" + (f"\n{near}" if near.startswith("did you") else ""))

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        names = list(map(str, action.choices))
        what = action.option_strings[-1] if action.option_strings else str(action.metavar or action.dest)
        is_command = isinstance(action, argparse._SubParsersAction)
        words = f"there is no {what.lower()}" if is_command else f"{what} cannot be"
        self.error(f"{words} {str(value)!r}\n{did_you_mean(str(value), names, what='possible')}")

    def format_help(self) -> str:
        """The help; commands under headings where there are groups."""
        listed = subparsers_of(self)
        if not self._groups or listed is None:
            return super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        rows = {row.dest: row for row in listed._get_subactions()}
        grouped = {name for names in self._groups.values() for name in names}
        others = {"from plugins": [name for name in rows if name not in grouped]}
        options = [action for action in self._actions if action.option_strings]
        for heading, names in {**self._groups, **others}.items():
            formatter.start_section(heading)
            formatter.add_arguments([rows[name] for name in names if name in rows])
            formatter.end_section()
        formatter.start_section("options")
        formatter.add_arguments(options)
        formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()


def subparsers_of(parser: argparse.ArgumentParser) -> argparse._SubParsersAction[Any] | None:
    """The commands or actions of a parser, where it has any."""
    return next((a for a in parser._actions if isinstance(a, argparse._SubParsersAction)), None)


def leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The parsers that run something: those of commands, or of the actions of a command."""
    below = subparsers_of(parser)
    if below is None:
        yield parser
    for each in below.choices.values() if below else ():
        yield from leaves(each)


def add_everywhere(parser: argparse.ArgumentParser) -> None:
    """Add the options that every command has, as far as it has none of that name itself."""
    taken = parser._option_string_actions
    group = parser.add_argument_group("for every command") if subparsers_of(parser) is None else parser
    for names, about, more in _EVERYWHERE:
        free = [name for name in names if name not in taken]
        if free:
            # Without a default: that of the command would replace what was said before its name.
            group.add_argument(*free, help=about, default=argparse.SUPPRESS, **more)


_LOUDNESS = {"action": "store_const", "dest": "verbosity"}
_EVERYWHERE: tuple[tuple[tuple[str, ...], str, dict[str, Any]], ...] = (
    (("-q", "--quiet"), "print results and errors only", {**_LOUDNESS, "const": -1}),
    (("-v", "--verbose"), "also say which settings are in force, and why", {**_LOUDNESS, "const": 1}),
    (("--config",), "take settings from this file, and from no other", {"type": Path, "metavar": "FILE"}),
    (("--no-config",), "take settings from no file", {"action": "store_true"}),
)


def command_in(given: Sequence[str]) -> str:
    """The command of a command line, which options that every command has may precede; or `--version`.

    >>> command_in(["-v", "--config", "ours.toml", "score", "trial.mcap"])
    'score'
    """
    words = iter(given)
    for word in words:
        if word == "--config":
            next(words, None)
        elif not word.startswith("-") or word == "--version":
            return word
    return ""
