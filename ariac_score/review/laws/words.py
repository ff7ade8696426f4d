"""Counter-examples in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ariac_score.review.laws.cases import Case
from ariac_score.scoring.expression import Number
from ariac_score.scoring.levels import TRIAL

__all__ = ["numbers_apart", "trial_in_words"]


def numbers_apart(first: Number, second: Number) -> tuple[str, str]:
    """Both with as many digits as it takes to see that they differ."""
    if abs(first - second) <= 1e-9 * max(1.0, abs(first)):  # one number, but for its last bits
        return f"{first:>12.6g}", f"{second:>12.6g}"
    digits = next((d for d in (6, 9, 12) if f"{first:.{d}g}" != f"{second:.{d}g}"), 15)
    return f"{first:>12.{digits}g}", f"{second:>12.{digits}g}"


def trial_in_words(case: Case, levels: Sequence[str]) -> str:
    """A made trial in a sentence."""
    work = [" and ".join(_count(parts, levels[0]) for parts in tasks) for tasks in case.orders]
    whole = "" if levels[0] == TRIAL else f"{'; '.join(work)}; "
    failed = ", ".join(f"{check} of {subject}" for check, subject in sorted(case.failed))
    task = f"not satisfied: {failed}" if failed else "all of the task satisfied"
    safety = "; ".join(_repeated(case)) or "no violations"
    numbers = ", ".join(f"{name} = {value:g}" for name, value in case.numbers.items())
    return f"{whole}{task}; {safety}{f'; {numbers}' if numbers else ''}"


def _repeated(case: Case) -> Iterator[str]:
    """The violations, equal ones in one entry with their number."""
    for violation in dict.fromkeys(case.violations):
        times = case.violations.count(violation)
        yield str(violation) if times == 1 else f"{times} times {violation}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
