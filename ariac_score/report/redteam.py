"""What an adversary found, as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ariac_score.redteam.attempt import Aim
from ariac_score.redteam.search import Exploit, Found, Standing
from ariac_score.terminal.style import plain

__all__ = ["redteam_text"]

_OTHERS: Mapping[Standing, str] = {
    "declared": "that they declare",
    "inherent": "that no rules can avoid: nobody can make a team go on where that costs more than it brings",
    "believed": "of what they believe: a log that no recorder attests can say anything",
}
_COLUMNS = ("tried", "refused", "worse", "same", "worked")


def redteam_text(found: Found) -> str:
    """The exploits as stories, and what was tried."""
    honest = found.honest
    lines = [f"{honest.path.name} under {honest.rule_set.id}: {honest.counts} counts", ""]
    for exploit in found.exploits:
        lines += [*_story(exploit, len(honest.copy.messages)), ""]
    lines += _verdict(found)
    lines += ["", *_table(found)]
    return "".join(f"{plain(line)}\n" for line in lines)


def _story(exploit: Exploit, messages: int) -> Iterator[str]:
    yield f"{exploit.standing.upper()}: {exploit.says}"
    if exploit.is_free:
        yield f"    {exploit.before} stays: more was violated, and it costs nothing"
    else:
        whose = "what the team has in the trial" if len(exploit.logs) > 1 else "what counts"
        yield f"    {exploit.before} becomes {exploit.after} ({whose})"
    if exploit.touched and exploit.tactic.aim is not Aim.AGAIN:
        yield f"    {_count(exploit.touched, messages)} left out, changed or put in"
    if exploit.because:
        yield f"    {exploit.because}"
    elif exploit.law:
        yield f"    against the law {exploit.law!r}, and the rules do not say that they break it"
    else:
        yield "    nothing in the log shows it"


def _count(touched: int, messages: int) -> str:
    return f"{touched} message{'' if touched == 1 else 's'} (the log has {messages})"


def _verdict(found: Found) -> Iterator[str]:
    tries = f"{found.tried} {'try' if found.tried == 1 else 'tries'}"
    tried = f"{tries} (budget {found.budget}, seed {found.seed})"
    if found.undeclared:
        yield f"{_exploits(len(found.undeclared))} that the rules do not declare, in {tried}"
    else:
        yield f"nothing found that the rules do not declare, in {tried}"
    for standing, words in _OTHERS.items():
        if number := len(found.of(standing)):
            yield f"{_exploits(number)} {words}"


def _exploits(number: int) -> str:
    return f"{number} exploit{'' if number == 1 else 's'}"


def _table(found: Found) -> Iterator[str]:
    width = max(len(tally.tactic) for tally in found.tallies)
    yield f"{'':{width}}  {'  '.join(f'{name:>7}' for name in _COLUMNS)}"
    for tally in found.tallies:
        numbers = "  ".join(f"{getattr(tally, name):>7}" for name in _COLUMNS)
        yield f"{tally.tactic:{width}}  {numbers}"
    if any(not tally.tried for tally in found.tallies):
        yield "(what was not tried needs what the log does not have, such as two violations, or frames)"
