"""What a log leaves open about a check and a subject: what it would find in the best and in the worst world.

Between two samples the world goes on. What could have happened there lies between two extremes, and each
of them is stated as the findings of a world of its own: a price is known as soon as both give the same.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ariac_score.checks.findings import Finding, canonical_span, settled
from ariac_score.trial.frozen import FrozenMap
from ariac_score.trial.spans import Span

__all__ = [
    "MOST_SPANS",
    "Cause",
    "OpenFindings",
    "Worlds",
    "by_source",
    "gaps_in_words",
    "in_words",
    "settled_open",
    "standing_for",
    "stood_for",
]

MOST_SPANS = 1000
"""Of a cause, stretches that are kept; its text counts them all."""


_STANDS_FOR = "in place of {}"


def standing_for(topics: Sequence[str]) -> str:
    """How a cause ends, of a source that stands for topics which are not there.

    >>> standing_for(["/snapshot"])
    'in place of /snapshot'
    """
    return _STANDS_FOR.format(" and ".join(topics))


def stood_for(text: str) -> str:
    """The topics that a cause says others stand for; empty where none do.

    >>> stood_for("2 gaps of 10 ms on tf frames " + standing_for(["/snapshot"])), stood_for("2 gaps")
    ('/snapshot', '')
    """
    found = re.search(_STANDS_FOR.format("(.+)$"), text)
    return found[1] if found else ""


@dataclass(frozen=True)
class Cause:
    """Why something is open.

    Attributes:
        text: For people, such as `12 gaps of 51 to 97 ms on /snapshot`.
        source: Where what is missing would have been recorded, such as the topic; empty when unknown.
        spans: When, s of trial time.
    """

    text: str
    source: str = ""
    spans: tuple[Span, ...] = ()


def gaps_in_words(spans: Sequence[Span]) -> str:
    """How many gaps there are, and how long.

    >>> gaps_in_words([Span(1.0, 1.051), Span(2.0, 2.097)])
    '2 gaps of 51 to 97 ms'
    >>> gaps_in_words([Span(1.0, 1.02), Span(2.0, 2.0201)])
    '2 gaps of 20 ms'
    """
    lengths_ms = [f"{1000.0 * lasts_s:.0f}" for lasts_s in sorted(span.duration_s for span in spans)]
    lengths = " to ".join(dict.fromkeys((lengths_ms[0], lengths_ms[-1])))
    return f"{'a gap' if len(spans) == 1 else f'{len(spans)} gaps'} of {lengths} ms"


def _count(text: str) -> int:
    """How many gaps a text begins with; 0 where it says no number."""
    number = text.partition(" ")[0]
    return int(number) if number.isdecimal() else 0


def in_words(causes: Sequence[Cause]) -> str:
    """What several causes of one source say together: one gap may leave several checks open.

    Args:
        causes: All of one source, or only one.

    >>> one, other = Cause("a gap of 9 ms on /a", "/a", (Span(0, 0.009),)), Cause("a gap of 5 ms on /a", "/a")
    >>> in_words([one, replace(other, spans=(Span(2, 2.005),))]), in_words([one, one])
    ('2 gaps of 5 to 9 ms on /a', 'a gap of 9 ms on /a')
    >>> in_words([one, Cause("1200 gaps of 5 to 9 ms on /a", "/a", (Span(0, 9),))])  # more than are kept
    '1200 gaps of 5 to 9 ms on /a'
    """
    # Of one with more gaps than are kept, the stretches are no gaps; its text counts them all.
    counted = [one for one in causes if 0 < len(one.spans) < _count(one.text)]
    first = max(counted or causes, key=lambda cause: (_count(cause.text), len(cause.spans)))
    here = gaps_in_words(first.spans) if first.spans else ""
    if not here or not first.text.startswith(here) or len(first.spans) >= MOST_SPANS:
        return first.text
    spans = sorted({span for cause in causes for span in cause.spans}, key=lambda span: span.start_s)
    return gaps_in_words(spans) + first.text.removeprefix(here)


def by_source(several: Sequence[Sequence[Cause]]) -> dict[str, list[int]]:
    """Why several things are open, in words, each cause with the numbers of those that are open for it.

    What the samples of one source leave open is one cause however many checks it opens; so is what several
    sources leave open in the same stretches.
    """
    found: dict[str, tuple[list[Cause], list[int]]] = {}
    for number, own in enumerate(several):
        for cause in own:
            # What follows for one check or another is no cause of its own.
            causes, numbers = found.setdefault(cause.source or cause.text.partition(", so ")[0], ([], []))
            causes.append(cause)
            if number not in numbers:
                numbers.append(number)
    said: dict[tuple[object, ...], tuple[list[str], list[int]]] = {}
    for name, (causes, numbers) in found.items():
        words = in_words(causes) if causes[0].source or len({*causes}) == 1 else name
        spans = frozenset(span for cause in causes for span in cause.spans)
        alike = (spans, *numbers) if spans else (words,)
        said.setdefault(alike, ([], numbers))[0].append(words)
    return {_joined(words): numbers for words, numbers in said.values()}


def _joined(texts: Sequence[str]) -> str:
    """Several texts that are the same but for the source, in one.

    >>> _joined(["a gap of 9 ms on /a, the first", "a gap of 9 ms on /b, the first"])
    'a gap of 9 ms on /a and on /b, the first'
    """
    parted = [re.fullmatch(r"(.+? )(on [^,]+)(.*)", one, re.DOTALL) for one in texts]
    alike = {(one[1], one[3]) if one else None for one in parted}
    if len(alike) > 1 or None in alike:
        return "; ".join(texts)
    ((begin, rest),) = (one for one in alike if one)
    return begin + " and ".join(one[2] for one in parted if one) + rest


@dataclass(frozen=True)
class Worlds:
    """What a monitor finds about a subject in the two extreme worlds, before the engine names its check.

    Attributes:
        subject: Whom it is about.
        best: Its findings in the best world.
        worst: Those in the worst world.
        causes: Why it is open.
        tight: Whether each end is that of one world that may have been; otherwise both are outer bounds.
    """

    subject: str
    best: tuple[Finding, ...]
    worst: tuple[Finding, ...]
    causes: tuple[Cause, ...] = ()
    tight: bool = False


@dataclass(frozen=True)
class OpenFindings:
    """What a check finds about a subject in the two extreme worlds that the log allows.

    In either world they replace everything that the check found about the subject. The best world has the
    fewest violations that may have been, and the least time and depth; the worst has the most of each.

    Attributes:
        check: Its name.
        subject: Whom it is about.
        best: Its findings in the best world, by id such as `separation#best1`.
        worst: Those in the worst world, by id such as `separation#worst1`.
        causes: Why it is open.
        tight: Whether each end is that of one world that may have been; otherwise both are outer bounds.
    """

    check: str
    subject: str
    best: Mapping[str, Finding] = field(default_factory=dict)
    worst: Mapping[str, Finding] = field(default_factory=dict)
    causes: tuple[Cause, ...] = ()
    tight: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "best", FrozenMap(dict(self.best)))
        object.__setattr__(self, "worst", FrozenMap(dict(self.worst)))
        object.__setattr__(self, "causes", tuple(self.causes))
        for finding in (*self.best.values(), *self.worst.values()):
            if (finding.check, finding.subject) != (self.check, self.subject):
                raise ValueError(
                    f"a finding of {finding.check!r} about {finding.subject!r} stands among the open ones "
                    f"of {self.check!r} about {self.subject!r}"
                )

    def renamed(self, check: str) -> OpenFindings:
        """The same of a check of another name, as whose plugin and parameters it was."""

        def under(findings: Mapping[str, Finding]) -> dict[str, Finding]:
            mark = f"{self.check}#"
            return {
                f"{check}#{key.removeprefix(mark)}": replace(one, check=check)
                for key, one in findings.items()
            }

        return replace(self, check=check, best=under(self.best), worst=under(self.worst))


def settled_open(one: OpenFindings) -> OpenFindings:
    """The same with its numbers as they are stored."""
    return replace(
        one,
        best={key: settled(finding) for key, finding in one.best.items()},
        worst={key: settled(finding) for key, finding in one.worst.items()},
        causes=tuple(replace(c, spans=tuple(map(canonical_span, c.spans))) for c in one.causes),
    )
