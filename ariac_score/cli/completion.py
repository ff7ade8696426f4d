"""Completion of command lines: what may come next, as the parser knows it; and how each shell asks for it.

The scripts only ask `ariac-score --complete WORD…`, so they need not be printed again when rule sets or
plugins are installed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NoReturn

from ariac_score.cli.parser import command_in
from ariac_score.errors import ScoreError

__all__ = ["ASKED", "SCRIPTS", "PrintCompletion", "candidates", "print_candidates"]

ASKED = "--complete"
"""First word of a command line by which a shell asks."""
Offer = tuple[str, str]
"""A word and a few words about it."""

_BASH = """\
# Completion of ariac-score. Add to ~/.bashrc: eval "$(ariac-score --print-completion bash)"
_ariac_score() {
    local words last cut word line=${COMP_LINE:0:COMP_POINT}
    read -ra words <<< "$line"
    [[ $line == *[[:space:]] ]] && words+=("")
    last=${words[-1]}
    cut=${last%"${last##*[:=]}"} # bash takes what follows : and = for a word of its own
    COMPREPLY=()
    while IFS=$'\\t' read -r word _; do
        COMPREPLY+=("${word#"$cut"}")
    done < <("${words[0]}" --complete "${words[@]:1}" 2> /dev/null)
}
complete -o default -F _ariac_score ariac-score
"""
_ZSH = """\
#compdef ariac-score
# Completion of ariac-score. Add to ~/.zshrc, after compinit: eval "$(ariac-score --print-completion zsh)"
_ariac_score() {
    local -a offers
    local line
    for line in "${(@f)$(${(Q)words[1]} --complete "${(@)words[2,CURRENT]}" 2> /dev/null)}"; do
        [[ -n $line ]] && offers+=("${${line%%$'\\t'*}//:/\\\\:}:${line#*$'\\t'}")
    done
    if (( $#offers )); then _describe ariac-score offers; else _files; fi
}
compdef _ariac_score ariac-score
"""
_FISH = """\
# Completion of ariac-score. Add to ~/.config/fish/config.fish: ariac-score --print-completion fish | source
function __ariac_score
    set -l words (commandline -opc)
    set -l offers ($words[1] --complete $words[2..-1] (commandline -ct) 2> /dev/null)
    if test (count $offers) -gt 0
        printf '%s\\n' $offers
    else
        __fish_complete_path (commandline -ct)
    end
end
complete -c ariac-score -f -a '(__ariac_score)'
"""
SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}


class PrintCompletion(argparse.Action):
    """Prints the script of a shell; to be given `SCRIPTS` as choices."""

    def __call__(self, parser: argparse.ArgumentParser, _: object, shell: Any, __: object = None) -> NoReturn:
        """Print it, and leave."""
        print(SCRIPTS[shell], end="")
        parser.exit()


def print_candidates(words: Sequence[str], parser_of: Callable[[str], argparse.ArgumentParser]) -> int:
    """Print what the last word may become, one a line with a few words about it; never an error."""
    try:
        for word, about in candidates(words, parser_of):
            print(f"{word}\t{' '.join(about.split())}")
    except (ScoreError, SystemExit):  # of a plugin that is broken, or words that are no command line
        return 1
    return 0


def candidates(words: Sequence[str], parser_of: Callable[[str], argparse.ArgumentParser]) -> Iterator[Offer]:
    """What the last word of a command line may become; nothing where it is a file.

    Args:
        words: The command line without the program, up to the cursor.
        parser_of: The parser for the command of a name.
    """
    *before, last = words or [""]
    command = command_in(before)
    place = _place(parser_of(command), before)
    option, equals, _ = last.partition("=")
    if equals and option.startswith("--"):
        action = place.parser._option_string_actions.get(option)
        offers = [(f"{option}={word}", about) for word, about in _values(action, command, before)]
    elif last.startswith("-") and not (place.turn and place.turn.option_strings):
        offers = _options(place.parser)
    else:
        offers = _values(place.turn, command, before)
    yield from (offer for offer in offers if offer[0].startswith(last))


@dataclass(frozen=True)
class _Place:
    """Where a command line has got to: the parser of its command or action, and whose turn it is."""

    parser: argparse.ArgumentParser
    turn: argparse.Action | None


def _place(parser: argparse.ArgumentParser, words: Sequence[str]) -> _Place:
    waiting: argparse.Action | None = None
    count = 0
    for word in words:
        if waiting is not None:
            waiting = None
        elif word.startswith("-"):
            option = parser._option_string_actions.get(word)
            waiting = option if option is not None and option.nargs is None else None
        else:
            turn = _positional(parser, count)
            if isinstance(turn, argparse._SubParsersAction):
                if word not in turn.choices:
                    return _Place(parser, None)
                parser, count = turn.choices[word], 0
            else:
                count += 1
    return _Place(parser, waiting or _positional(parser, count))


def _positional(parser: argparse.ArgumentParser, count: int) -> argparse.Action | None:
    places = [action for action in parser._actions if not action.option_strings]
    if count < len(places):
        return places[count]
    return places[-1] if places and places[-1].nargs in ("*", "+") else None


def _options(parser: argparse.ArgumentParser) -> list[Offer]:
    return [
        (name, action.help or "")
        for name, action in parser._option_string_actions.items()
        if name.startswith("--") and action.help is not argparse.SUPPRESS
    ]


def _values(action: argparse.Action | None, command: str, words: Sequence[str]) -> list[Offer]:
    """The values of an option or argument, as far as they have names."""
    if action is None:
        return []
    if isinstance(action, argparse._SubParsersAction):
        return [(row.dest, row.help or "") for row in action._get_subactions()]
    if action.choices is not None:
        return [(str(choice), "") for choice in action.choices]
    if action.dest in ("rules", "against") or (command == "rules" and not action.option_strings):
        from ariac_score.scoring.ruleset import rule_set_names  # noqa: PLC0415  # slow to load

        return [(name, "rule set") for name in rule_set_names()]
    if action.dest in ("log_map", "extends"):
        from ariac_score.logs.logmap import log_map_names  # noqa: PLC0415  # slow to load

        return [(name, "log map") for name in log_map_names()]
    if command == "plugins" and not action.option_strings:
        from ariac_score.checks.contracts import GROUPS  # noqa: PLC0415  # slow to load
        from ariac_score.checks.registry import Registry  # noqa: PLC0415  # slow to load

        registry = Registry()
        return [(name, group.rpartition(".")[2]) for group in GROUPS for name in registry.names(group)]
    return _criteria(words) if action.dest == "fail_on" else []


def _criteria(words: Sequence[str]) -> list[Offer]:
    """What `--fail-on` takes; with the checks of the rule set that the command line names."""
    from ariac_score.scoring.ruleset import load_rule_set  # noqa: PLC0415  # slow to load

    named = [after for word, after in pairwise(words) if word == "--rules"]
    checks = [*load_rule_set(named[-1]).checks] if named else []
    return [
        (":".join(filter(None, (what, check))), f"{about} of {check}" if check else about)
        for what, about in (("violation", "any violation"), ("unknown", "anything undecided"))
        for check in ("", *checks)
    ]
