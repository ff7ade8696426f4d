"""What is known of laws, in lines for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ariac_score.review.laws.words import numbers_apart
from ariac_score.review.proofs.proving import PROVEN, Judged

__all__ = ["exploit_in_words", "judged_lines"]

_VERDICTS = {"proven": "proven", "refuted": "BROKEN", "open": "open", "not_applicable": "not applicable"}


def judged_lines(judged: Judged, levels: Sequence[str]) -> Iterator[str]:
    """What is known of a law, in a line; its exploit below it.

    Args:
        judged: The law.
        levels: Of the rule set, whose words the exploit uses.
    """
    reason = f": {judged.because[0]}" if judged.verdict in ("open", "not_applicable") else ""
    yield f"{_VERDICTS[judged.verdict]:<15} {judged.law.says}{reason}"
    if judged.declared:
        missing = "it is proven all the same" if judged.verdict == PROVEN else "no counter-example was found"
        found = "" if judged.exploit else f"; {missing}"
        yield f"    the rule set says so itself: {judged.declared}{found}"
    if judged.exploit and judged.exploit.broken:
        broken = judged.exploit.broken
        yield f"    {judged.exploit.trial(levels)}"
        first, second = numbers_apart(broken.first_score, broken.second_score)
        yield f"    {first}  {broken.first}"
        yield f"    {second}  {broken.second}"


def exploit_in_words(judged: Judged, levels: Sequence[str]) -> str:
    """What a team can do where a law is refuted, in a sentence; empty where nothing is known."""
    if not (judged.exploit and judged.exploit.broken):
        return ""
    broken = judged.exploit.broken
    first, second = (number.strip() for number in numbers_apart(broken.first_score, broken.second_score))
    trial = judged.exploit.trial(levels)
    return f"{trial}; {broken.first}: {first}; {broken.second}: {second}"
