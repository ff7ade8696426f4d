"""What an adversary found, as text."""

from __future__ import annotations

from collections.abc import Iterator

from ariac_score.redteam.attempt import Aim
from ariac_score.redteam.search import Exploit, Found
from ariac_score.terminal.style import plain

__all__ = ["redteam_text"]

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
    word = "BELIEVED" if exploit.is_believed else "DECLARED" if exploit.declared else "EXPLOIT"
    yield f"{word}: {exploit.says}"
    if exploit.is_free:
        yield f"    {exploit.before} stays: more was violated, and it costs nothing"
    else:
        whose = "what the team has in the trial" if len(exploit.logs) > 1 else "what counts"
        yield f"    {exploit.before} becomes {exploit.after} ({whose})"
    if exploit.touched and exploit.tactic.aim is not Aim.AGAIN:
        yield f"    {_count(exploit.touched, messages)} left out, changed or put in"
    if exploit.is_believed:
        yield "    a recorder's manifest would show it, and the rules ask for none (completeness: attested)"
    elif exploit.declared:
        yield f"    the rules say so: {exploit.declared}"
    elif exploit.law:
        yield f"    against the law {exploit.law!r}, and the rules do not say that they break it"
    else:
        yield "    nothing in the log shows it"


def _count(touched: int, messages: int) -> str:
    return f"{touched} message{'' if touched == 1 else 's'} (the log has {messages})"


def _verdict(found: Found) -> Iterator[str]:
    tried = f"{found.tried} tries (budget {found.budget}, seed {found.seed})"
    if found.undeclared:
        yield f"{_exploits(len(found.undeclared))} that the rules do not declare, in {tried}"
    else:
        yield f"nothing found that the rules do not declare, in {tried}"
    believed = sum(exploit.is_believed for exploit in found.exploits)
    declared = len(found.exploits) - len(found.undeclared) - believed
    if declared:
        yield f"{_exploits(declared)} that they declare"
    if believed:
        yield f"{_exploits(believed)} of what they believe: a log that no recorder attests can say anything"


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
