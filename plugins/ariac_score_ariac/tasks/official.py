"""Numbers of the official score text, taken as they are printed.

Nothing is scored again here, and a text that contradicts itself is not corrected.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Finding, Measure, OfficialOrder, OfficialResult, SignalNeed, Trial, Verdict
from ariac_score_ariac.work import Order

OfOrder = Literal["score", "total", "priority_factor", "duration_s", "max_score"]
OfTrial = Literal["total", "process_time_s", "collisions", "dropped"]
OnCrash = Literal["zero", "undecided"]

_SUBJECT = "trial"
_NO_TEXT = "there is no official score text"
_ENDINGS: Mapping[str, str] = {
    "crashed": "the simulator crashed and no score was recorded",
    "cancelled": "the run was cancelled by its user and no score was recorded",
}
"""How a run ends without a score, in words."""

_NUMBER = re.compile(r"-?\d{1,15}(?:\.\d{1,20})?(?:e[+-]?\d{1,2})?")
_OF_ORDER: Mapping[str, Measure] = {
    "score": Measure("points", "points", meaning="without any factor for priority"),
    "total": Measure("points", "points", meaning="with the factor for priority"),
    # What the order asks for, not what was done: it is the same in every world a ledger compares.
    "priority_factor": Measure("1", signed=False, meaning="what the score is multiplied by"),
    "duration_s": Measure("s", meaning="from announcement to submission; until 2022 the time taken"),
    "max_score": Measure("points", meaning="the most the order could have had"),
    "submitted": Measure("count", meaning="1 where it was handed in, else 0"),
}
_OF_TRIAL: Mapping[str, Measure] = {
    "total": Measure("points", "points", meaning="the printed final score"),
    "process_time_s": Measure("s", meaning="the printed total process time"),
    "collisions": Measure("count", best=0.0, worst=1.0, meaning="1 where arms collided, else 0"),
    "dropped": Measure("points", "penalty", meaning="what dropped products cost, as printed"),
}
_TOTALS = ("total_order_score", "total_score")
_COLLISIONS = ("arms_collision", "was_arm_arm_collision")


@dataclass(frozen=True)
class OfficialOrderScore:
    """The order was handed in, and what the official text gave it.

    Measures:
        As printed: `score` (without any factor for priority), `submitted` 1 or 0, and
        where the text allows to say `total` (with the factor), `priority_factor`,
        `duration_s` (from announcement to submission; until 2022 the time taken) and
        `max_score`. A text that says yes or no to priority means the factor
        `priority_factor`; where the text says nothing, the configured order does. The
        texts of 2017 and 2018 know no factor, and a time of 0 until 2022 is no time.
        Findings that are not inconclusive always have `score` and `submitted`, and of
        orders handed in also what is in `requires`.
    Violated when:
        The text says that the order, or a shipment of it, was not handed in. So is every
        order of a run that crashed or was cancelled, with score 0, where `on_crash` is
        `zero`.
    Source:
        ARIAC notes on log formats, sections 3 and 5: performance.log, trial_log.txt.
        What a crashed run is worth is our own choice: the official evaluation stops.
    Attributes:
        requires: What the official text must print.
        priority_factor: What an order of high priority is multiplied by.
        on_crash: What a run that crashed is worth.
    """

    when_cut: ClassVar[str] = "official"
    reads_official = True
    measures: ClassVar[Mapping[str, Measure]] = _OF_ORDER

    requires: tuple[OfOrder, ...] = ("score",)
    priority_factor: float = 3.0
    on_crash: OnCrash = "undecided"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for the order."""
        official = trial.official
        if official is None:
            yield Finding.inconclusive(order.id, _NO_TEXT)
        elif official.outcome in _ENDINGS:
            yield _ended(order.id, official, self.on_crash, {"score": 0.0, "submitted": 0.0})
        else:
            printed = next((summary for summary in official.summaries if summary.id == order.id), None)
            yield self._judged(order, printed)

    def _judged(self, order: Order, printed: OfficialOrder | None) -> Finding:
        if printed is None:
            return Finding.inconclusive(order.id, "the official text does not name it")
        if printed.submitted is None:
            return Finding.inconclusive(order.id, "the official text does not say whether it was handed in")
        quantities = self._quantities(order, printed)
        if why := _impossible(quantities, self.measures):
            return Finding.inconclusive(order.id, why)
        if not printed.submitted:
            # A text may print no score for it.
            quantities = {"score": 0.0} | quantities
            words = f"not handed in by the official text; score {quantities['score']:g}"
            return Finding(order.id, Verdict.VIOLATED, words, quantities=quantities)
        missing = [name for name in ("score", *self.requires) if name not in quantities]
        if missing:
            return Finding.inconclusive(order.id, f"the official text does not say its {_words(missing[0])}")
        return Finding(order.id, Verdict.SATISFIED, _shown(quantities), quantities=quantities)

    def _quantities(self, order: Order, printed: OfficialOrder) -> dict[str, float]:
        """What is known of the order, by name."""
        score, factor = printed.score, self._factor(order, printed)
        total = _number(printed.items, *_TOTALS) if _by_simulator(printed) else None
        # Until 2022 the total is printed with the factor; from 2023 on scores are, and without it.
        if total is None and score is not None and factor is not None:
            total = score * factor
        known = {
            "score": score,
            "total": total,
            "priority_factor": factor,
            "duration_s": _duration_s(printed) if printed.submitted else None,
            "max_score": printed.max_score,
            "submitted": float(bool(printed.submitted)),
        }
        return {name: value for name, value in known.items() if value is not None}

    def _factor(self, order: Order, printed: OfficialOrder) -> float | None:
        """The factor for priority; until 2022 it is a number, and in 2017 and 2018 there is none."""
        if printed.priority is not None:
            return self.priority_factor if printed.priority else 1.0
        factor = _number(printed.items, "priority")
        if factor is not None:
            return factor
        if _by_simulator(printed):
            return 1.0
        # Without a configuration the order is made of this very text, which did not print its priority.
        if order.outline:
            return None
        return self.priority_factor if order.priority > 1 else 1.0


@dataclass(frozen=True)
class OfficialPrinted:
    """An official text prints the score of the order: a fact for formulas that fall back on something else.

    Measures:
        Whether the official text of the trial has a score of the order, handed in or not.
    Violated when:
        Never: an order without one is not applicable, and so has no points.
    Source:
        ARIAC notes on log formats, sections 3 and 5; on recording, sections 1.7 and 1.8.
    """

    when_cut: ClassVar[str] = "official"
    reads_official = True
    part_of: ClassVar[str] = "task"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for the order."""
        summaries = trial.official.summaries if trial.official else ()
        printed = next((s for s in summaries if s.id == order.id), None)
        if printed is None or printed.submitted is None or printed.score is None:
            yield Finding.not_applicable(order.id, "no official text prints its score")
        else:
            yield Finding.satisfied(order.id, f"{trial.official.source if trial.official else ''} prints it")


@dataclass(frozen=True)
class OfficialTrialScore:
    """The run came to its official end, and what the text says of it as a whole.

    Measures:
        As printed: `total`, `process_time_s`, `collisions` of arms (0 or 1) and `dropped`
        products. Findings that are not inconclusive have what is in `requires`.
    Violated when:
        A collision of arms is printed; or the run crashed or was cancelled, with total 0,
        where `on_crash` is `zero`.
    Source:
        ARIAC notes on log formats, sections 3 and 5. A text that prints scores of orders
        only (2024) has their sum as total.
    Attributes:
        requires: What the official text must print.
        on_crash: What a run that crashed is worth.
    """

    when_cut: ClassVar[str] = "official"
    part_of: ClassVar[str] = "task"

    in_gaps: ClassVar[str] = "unsampled"
    measures: ClassVar[Mapping[str, Measure]] = _OF_TRIAL

    requires: tuple[OfTrial, ...] = ("total",)
    on_crash: OnCrash = "undecided"

    def needs(self) -> Iterator[SignalNeed]:
        """No signal: it is all in the text."""
        return iter(())

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding about the trial."""
        official = trial.official
        if official is None:
            yield Finding.inconclusive(_SUBJECT, _NO_TEXT)
        elif official.outcome in _ENDINGS:
            yield _ended(_SUBJECT, official, self.on_crash, {"total": 0.0})
        else:
            yield self._judged(official)

    def _judged(self, official: OfficialResult) -> Finding:
        known = {
            "total": official.total,
            "process_time_s": official.process_time_s,
            "collisions": _number(official.items, *_COLLISIONS),
            "dropped": _number(official.items, "dropped_part_penalty"),
        }
        quantities = {name: value for name, value in known.items() if value is not None}
        missing = [name for name in self.requires if name not in quantities]
        if why := _impossible(quantities, self.measures):
            return Finding.inconclusive(_SUBJECT, why)
        if missing:
            return Finding.inconclusive(_SUBJECT, f"the official text does not say the {_words(missing[0])}")
        # The printed total is 0 already; the verdict says why.
        collided = quantities.get("collisions", 0.0) > 0
        words = (
            f"arms collided by the official text; {_shown(quantities)}" if collided else _shown(quantities)
        )
        verdict = Verdict.VIOLATED if collided else Verdict.SATISFIED
        return Finding(_SUBJECT, verdict, words, quantities=quantities, critical=collided)


def _impossible(quantities: Mapping[str, float], measures: Mapping[str, Measure]) -> str:
    """Which printed time or count cannot be, in words; empty where all can."""
    for name, value in quantities.items():
        if value < 0 and measures[name].unit in ("s", "count"):
            return f"the official text gives a {_words(name)} of {value:g}, which cannot be"
    return ""


def _ended(subject: str, official: OfficialResult, on_crash: OnCrash, zero: dict[str, float]) -> Finding:
    """What a run without a score says about an order or the trial."""
    words, labels = _ENDINGS[official.outcome], {"outcome": official.outcome}
    if on_crash == "zero":
        words += "; it counts as 0"
        return Finding(
            subject,
            Verdict.VIOLATED,
            words,
            quantities=zero,
            labels=labels,
            critical=True,
        )
    return Finding(subject, Verdict.INCONCLUSIVE, words, labels=labels)


def _by_simulator(printed: OfficialOrder) -> bool:
    """Whether it is out of performance.log (until 2022), which alone prints the time taken."""
    return "time_taken" in printed.items


def _duration_s(printed: OfficialOrder) -> float | None:
    """How long the order took, as printed where it is."""
    duration_s = _number(printed.items, "submission_duration")
    if duration_s is not None:
        return duration_s
    if _by_simulator(printed):
        # Printed as 0 while incomplete, and of assemblies until June 2021.
        return _number(printed.items, "time_taken") or None
    if printed.announced_s is None or printed.submitted_s is None:
        return None
    return printed.submitted_s - printed.announced_s


def _number(items: Mapping[str, str], *labels: str) -> float | None:
    """The number that is printed under the first of these labels that has one."""
    for label in labels:
        if _NUMBER.fullmatch(items.get(label, "")):
            return float(items[label])
    return None


def _words(quantity: str) -> str:
    """A quantity in words.

    >>> _words("process_time_s"), _words("score")
    ('process time', 'score')
    """
    return quantity.removesuffix("_s").replace("_", " ")


def _shown(quantities: Mapping[str, float]) -> str:
    """The printed numbers in one line; that it was handed in, the verdict says."""
    return ", ".join(
        f"{_words(name)} {value:.9g}{' s' if name.endswith('_s') else ''}"
        for name, value in quantities.items()
        if name != "submitted"
    )
