"""What a check says about a trial: verdicts with evidence, in SI units, without points."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from ariac_score.checks.depth import DepthProfile
from ariac_score.trial.frozen import FrozenMap
from ariac_score.trial.signals import Sample
from ariac_score.trial.spans import Span

__all__ = [
    "COUNT",
    "POINTS",
    "SIGNIFICANT_DIGITS",
    "Finding",
    "FrozenMap",
    "Limit",
    "Verdict",
    "canonical",
    "canonical_number",
    "canonical_span",
    "settled",
]

POINTS = "points"
"""Unit of what an official scorer awards or takes."""

COUNT = "count"
"""Unit of numbers of things, which formulas make points of."""

SIGNIFICANT_DIGITS = 12
"""Measured numbers keep so many digits: fewer than float64 has, so that the last bits,
in which two machines may differ, never reach a result; more than any sensor resolves."""


def canonical(value: float) -> float:
    """A measured number with the declared digits; never a negative zero.

    >>> canonical(0.1 + 0.2)
    0.3
    """
    value = float(value)  # fractions and the like have no format of floats before Python 3.12
    if not math.isfinite(value):
        raise ValueError(f"{value!r} cannot stand in a result")
    # + 0.0 turns a negative zero, which JSON would keep, into a positive one.
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}") + 0.0


class Verdict(str, Enum):
    """The four things a check can say."""

    SATISFIED = "satisfied"
    VIOLATED = "violated"
    INCONCLUSIVE = "inconclusive"
    """What was needed to decide is not in the log. Never the same as satisfied."""
    NOT_APPLICABLE = "not_applicable"
    """There was nothing to judge, and the log shows that there was nothing."""

    @classmethod
    def of(cls, robustness: float | None) -> Verdict:
        """Violated below 0; equality satisfies.

        Raises:
            TypeError: There is no margin to judge by.
        """
        if robustness is None:
            raise TypeError(
                "Verdict.of takes a margin, not None; where none is known, yield Finding.inconclusive"
            )
        return cls.VIOLATED if robustness < 0 else cls.SATISFIED


@dataclass(frozen=True)
class Limit:
    """A measured number against its limit.

    Attributes:
        what: Name of the number in words, such as `heading error`.
        value: What was measured.
        unit: Its unit.
        at_most: Upper limit; equality satisfies unless `strict`.
        at_least: Lower limit; equality satisfies unless `strict`.
        strict: Whether equality violates.
    """

    what: str
    value: float
    unit: str
    at_most: float | None = None
    at_least: float | None = None
    strict: bool = False

    @property
    def margin(self) -> float:
        """Signed distance to the nearer limit, negative when violated (or equal and strict)."""
        margins = []
        if self.at_most is not None:
            margins.append(self.at_most - self.value)
        if self.at_least is not None:
            margins.append(self.value - self.at_least)
        return min(margins)

    @property
    def kept(self) -> bool:
        """Whether the value keeps its limits."""
        return self.margin > 0 or (self.margin == 0 and not self.strict)

    def __str__(self) -> str:
        relation, bound = (
            ("at most", self.at_most) if self.at_most is not None else ("at least", self.at_least)
        )
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.what} {_beside(self.value, bound)}{unit} ({relation} {bound:.6g})"


def _beside(value: float, bound: float | None) -> str:
    """A value with three digits, or as many more as show on which side of a bound it lies.

    >>> _beside(0.00314227, 0.03), _beside(0.03000012, 0.03), _beside(0.03, 0.03)
    ('0.00314', '0.0300001', '0.03')
    """
    for digits in range(3, 17):
        text = f"{value:.{digits}g}"
        if bound is None or (float(text) > bound, float(text) < bound) == (value > bound, value < bound):
            return text
    return repr(value)


def _components(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


_NO_NUMBERS: Mapping[str, float] = FrozenMap({})
_NO_WORDS: Mapping[str, str] = FrozenMap({})


@dataclass(frozen=True)
class Finding:
    """One statement of one check about one subject.

    Attributes:
        subject: What it is about: `order/task/slot` for rules, `robot/human` for
            pairs, a signal name where one is missing.
        verdict: What the check says.
        message: One sentence for people, without full stop.
        span: When, s of trial time; `None` for things without a time.
        robustness: Signed margin in `unit`, negative when violated; `None` for
            verdicts about things that have no margin.
        unit: Unit of the robustness.
        quantities: Named numbers with the unit in the name, such as `depth_integral_m_s`.
        labels: Named words, such as `closing_by`.
        evidence: The samples it rests on.
        clause: Where the standard or rulebook asks for it.
        critical: Whether a violation is a critical event, which a rule set may gate on.
        check: Name of the check in the rule set; the engine fills it in.
        units: Units of quantities by their names, where they are declared: `points`, `count`, `1`,
            `s`, `dollars`, … Only what is in `points` or `count` is taken apart as points in a ledger.
        profile: How deep a violation is over time, relative to its limit; `None` for one without a depth,
            which counts as deep as can be.
    """

    subject: str
    verdict: Verdict
    message: str
    span: Span | None = None
    robustness: float | None = None
    unit: str = ""
    quantities: Mapping[str, float] = field(default_factory=lambda: _NO_NUMBERS)
    labels: Mapping[str, str] = field(default_factory=lambda: _NO_WORDS)
    evidence: tuple[Sample, ...] = ()
    clause: str = ""
    critical: bool = False
    check: str = ""
    units: Mapping[str, str] = field(default_factory=lambda: _NO_WORDS)
    profile: DepthProfile | None = None

    def __post_init__(self) -> None:
        # The word "violated" equals the verdict, but verdicts are compared with `is`.
        if not isinstance(self.verdict, Verdict):
            raise TypeError(f"verdict {self.verdict!r} is not one of Verdict")
        if not isinstance(self.subject, str):
            raise TypeError(f"subject {self.subject!r} is not text")
        # Checked here and not when the result is written, so that the plugin can still be named.
        for sample in self.evidence:
            if not all(math.isfinite(v) for v in _components(sample.value)):
                raise ValueError(f"evidence {sample.signal!r} is {sample.value!r}")
        # Copied and frozen: findings are hashed into results, and plugins keep the mappings they passed.
        object.__setattr__(self, "quantities", FrozenMap(dict(self.quantities)))
        object.__setattr__(self, "labels", FrozenMap(dict(self.labels)))
        object.__setattr__(self, "units", FrozenMap(dict(self.units)))
        for name in self.units.keys() - self.quantities.keys():
            raise ValueError(f"there is a unit for {name!r}, which is no quantity of this finding")
        object.__setattr__(self, "evidence", tuple(self.evidence))
        if self.profile is None:  # left out of its JSON: results from before have none
            self.__dict__.pop("profile", None)

    @classmethod
    def violated(cls, subject: str, message: str, *, clause: str = "", critical: bool = False) -> Finding:
        """A violation that has no margin."""
        return cls(subject, Verdict.VIOLATED, message, clause=clause, critical=critical)

    @classmethod
    def satisfied(cls, subject: str, message: str, *, clause: str = "") -> Finding:
        """A kept requirement that has no margin."""
        return cls(subject, Verdict.SATISFIED, message, clause=clause)

    @classmethod
    def inconclusive(
        cls, subject: str, message: str, *, span: Span | None = None, clause: str = ""
    ) -> Finding:
        """What was needed to decide is not in the log."""
        return cls(subject, Verdict.INCONCLUSIVE, message, span=span, clause=clause)

    @classmethod
    def not_applicable(cls, subject: str, message: str, *, clause: str = "") -> Finding:
        """There was nothing to judge, and the log shows that."""
        return cls(subject, Verdict.NOT_APPLICABLE, message, clause=clause)

    @classmethod
    def from_limits(cls, subject: str, *limits: Limit, clause: str = "", message: str = "") -> Finding:
        """Satisfied when every limit is kept; the message names those that are not.

        Margins of different units cannot be compared, so the robustness is that of the
        first broken limit, or of the first limit where all are kept.
        """
        broken = [limit for limit in limits if not limit.kept]
        shown: Iterable[Limit] = broken or limits
        decisive = broken[0] if broken else limits[0]
        names = [f"{limit.what.replace(' ', '_')}_{limit.unit}" for limit in limits]
        return cls(
            subject,
            Verdict.VIOLATED if broken else Verdict.SATISFIED,
            message or "; ".join(str(limit) for limit in shown),
            robustness=decisive.margin,
            unit=decisive.unit,
            quantities={name: limit.value for name, limit in zip(names, limits, strict=True)},
            clause=clause,
            units={name: limit.unit for name, limit in zip(names, limits, strict=True)},
        )


def canonical_number(value: int | float | None) -> int | float | None:
    """A number with the declared digits; integers and `None` stay as they are."""
    return canonical(value) if isinstance(value, float) else value


def settled(finding: Finding) -> Finding:
    """A finding with its numbers as they are stored, so that pricing now and later agree."""
    return replace(
        finding,
        span=None if finding.span is None else canonical_span(finding.span),
        robustness=None if finding.robustness is None else canonical(finding.robustness),
        quantities={name: canonical(value) for name, value in finding.quantities.items()},
        evidence=tuple(_settled_sample(sample) for sample in finding.evidence),
        profile=finding.profile and replace(finding.profile, t_s=tuple(map(canonical, finding.profile.t_s))),
    )


def canonical_span(span: Span) -> Span:
    """A span with the declared digits."""
    return Span(canonical(span.start_s), canonical(span.end_s))


def _settled_sample(sample: Sample) -> Sample:
    value = sample.value
    kept = tuple(canonical(v) for v in value) if isinstance(value, tuple) else canonical(value)
    return replace(sample, t_s=canonical(sample.t_s), value=kept)
