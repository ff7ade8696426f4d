"""One gap of a log on its way to the score: what monitors leave open, priced, and what would narrow it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ariac_score import Body, Event, Signal, Span, Trial
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LogMapError, RuleSetError
from ariac_score.results.doubt import left_open
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.pricing import Priced, price
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.window import with_window

RULES = """
id: gaps
title: Near and nearer
source: by hand
log_map: ariac2020
between_samples: {between}
bounds:
  human: {{max_speed_m_s: 0.6, source: walks}}
  robot: {{max_speed_m_s: 0.4, source: its rail}}
monitors:
  near:
    use: formula.always
    with: {{holds: d >= 1, signals: {{d: "separation/{{robot}}/{{human}}"}}, unit: m, t_off_s: 5.0}}
  contact:
    use: ariac.human_contact
    with: {{distance: separation, contact_distance_m: {contact_m}}}
score: {score}
"""


def interval(
    score: str,
    *,
    gap_s: float = 3.0,
    contact_m: float = 0.05,
    topics: tuple[str, ...] = ("/scanner",),
    ended: bool = True,
    between: str = "held",
) -> ScoreInterval:
    """Of a robot and a human 2 m apart before and after a gap (G6); one human for each topic."""
    found = scored(score, gap_s, contact_m, topics, ended=ended, between=between)
    assert found.interval is not None
    return found.interval


def scored(
    score: str,
    gap_s: float,
    contact_m: float,
    topics: tuple[str, ...],
    *,
    ended: bool,
    between: str = "held",
) -> Priced:
    """The same, as it is priced."""
    t = np.concatenate([np.arange(101) * 0.01, 1.0 + gap_s + np.arange(101) * 0.01])
    humans = [f"human_{number}" for number in range(len(topics))]
    signals = {
        f"separation/arm/{human}": Signal(f"separation/arm/{human}", "m", t, np.full(len(t), 2.0), topic)
        for human, topic in zip(humans, topics, strict=True)
    }
    end_s = float(t[-1])
    trial = Trial(
        "t",
        bodies=(Body("arm", "robot"), *(Body(human, "human") for human in humans)),
        signals=signals,
        events=(Event(0.0, COMPETITION_STARTED), Event(end_s, COMPETITION_ENDED))[: 1 + ended],
        witnessed=frozenset({"bodies"}),
        recorded=Span(0.0, end_s),
    )
    text = RULES.format(score=score, contact_m=contact_m, between=between)
    rules = prepare(rule_set_from_text(text, file="gaps"))
    measured = measure_trial(with_window(trial, ""), rules)
    sheet, policies = rules.rule_set.sheet, rules.rule_set.policies
    return price(
        measured.findings,
        measured.scopes,
        sheet,
        policies,
        digits=6,
        measures=measured.measures,
        left_open=left_open(measured, rules.rule_set),
    )


STANDS_S = 0.015
"""A sample at 100 Hz stands for no longer: one that is missing, and was too near, would have."""


@pytest.mark.parametrize(("between", "longer_s"), [("bounded", 0.0), ("held", STANDS_S)])
def test_g19_the_charge_of_one_rise_and_fall_is_its_peak_and_its_integral(
    between: str, longer_s: float
) -> None:
    """0.5 of the limit deep, 0.25 s of it: a charge of 0.5 + 0.25 / 5 = 0.55, so 12 / 1.55 to 12."""
    found = interval(
        "12 / (1 + measure(near, relative_depth_max) + measure(near, relative_depth_integral_s) / 5)",
        between=between,
    )

    assert found.most == 12
    # Cells make the worst world a little worse, and never better. The peak stands so long at most.
    assert 12 / (1.55 + 0.5 * longer_s / 5) - 0.003 < float(found.least) <= 7.741935
    assert found.tight


@pytest.mark.parametrize(("between", "longer_s"), [("bounded", 0.0), ("held", STANDS_S)])
def test_g6_a_second_at_most_is_spent_too_near(between: str, longer_s: float) -> None:
    found = interval("10 - seconds(near)", between=between)

    assert found.most == 10
    assert 9.0 - longer_s - 0.003 < float(found.least) <= 9.0 - longer_s


def test_what_the_recorder_lost_is_said_apart_from_what_the_team_did() -> None:
    """By the samples alone nobody was too near; the score is lower for the gap by what it is lower at all."""
    found = interval("10 - seconds(near)")

    assert found.unseen == found.most - found.least


def test_one_gap_that_two_monitors_see_is_one_cause_and_not_paid_twice() -> None:
    """It hides a breach and, 0.4 m deeper, what counts as a contact; one event is charged once."""
    (narrowing,) = interval(
        "10 - charged(near=1, contact=4, again_after_s=5, severity=0)", contact_m=0.6
    ).narrowing

    assert narrowing.cause == "a gap of 3000 ms on /scanner"
    assert narrowing.checks == ("contact", "near")
    # The deepest point of both extreme paths is 0.5 m, for no time; nearer than 0.6 m they are for 0.2 s,
    # nearer than 1 m for 1 s. The contact weighs 5.2 s at 4, the breach alone 0.4 s before it.
    both = (4 * 5.2 + 1 * 0.4) / 5
    assert float(narrowing.at_most or 0) == pytest.approx(both + 0.4 / 5, abs=0.1)


def test_each_of_two_people_whom_a_gap_hides_is_charged_in_the_worst_world() -> None:
    score = "20 - charged(near=1, again_after_s=5)"
    one, two = interval(score), interval(score, topics=("/scanner", "/lidar"))

    assert 0 < 20 - one.least < 20
    assert float(20 - two.least) == pytest.approx(2 * float(20 - one.least), abs=2e-6)  # each rounded
    assert one.most == two.most == 20


def test_what_would_narrow_it_stands_by_source_most_first() -> None:
    """Two humans, each with a scanner of its own: twice the same gap, and half of the width by each."""
    found = interval("10 - seconds(near)", topics=("/front", "/rear"))

    assert [one.cause for one in found.narrowing] == [
        "a gap of 3000 ms on /front",
        "a gap of 3000 ms on /rear",
    ]
    assert [float(one.at_most or 0) for one in found.narrowing] == pytest.approx([1.0, 1.0], abs=0.02)
    assert float(found.most - found.least) == pytest.approx(2.0, abs=0.04)


def test_a_gap_that_two_checks_price_either_way_is_an_outer_bound() -> None:
    """Seconds too near cost, contacts pay: no world has the one without the other, and the ends say so."""
    found = interval("10 - seconds(near) + 2 * count(contact)", contact_m=0.6)

    assert (float(found.least), float(found.most)) == (pytest.approx(9.0, abs=0.02), 12.0)
    assert not found.tight


@pytest.mark.parametrize("gap_s", [0.01, 3.0])
@pytest.mark.parametrize("cost", ["seconds(near)", "count(near)", "demerits(near)", "charged(near=1)"])
def test_who_stops_the_recording_early_gains_nothing(gap_s: float, cost: str) -> None:
    """What came after it may have lasted for any time, so a score has the least that its formula allows."""
    found = interval(f"12 / (1 + {cost})", gap_s=gap_s, ended=False)

    assert (found.least, found.most, found.tight) == (0, 12, False)
    assert "the log does not show the end of the competition" in found.narrowing[0].cause


def test_a_price_without_a_least_has_no_score_where_the_end_is_not_shown() -> None:
    found = scored("10 - seconds(near)", 3.0, 0.05, ("/scanner",), ended=False)

    assert found.interval is None
    assert "nothing bounds seconds(near) of arm/human_0" in found.missing


@pytest.mark.parametrize(
    ("kind", "meant"),
    [("humn", "human"), ("robots", "robot"), ("vehicle", ""), ("hand", "")],
)
def test_bounds_of_a_misspelt_kind_are_refused_and_those_of_one_that_this_log_lacks_are_not(
    kind: str, meant: str
) -> None:
    """What a rule set states of a vehicle may serve another log map."""
    text = RULES.format(score="count(near)", contact_m=0.05, between="held").replace(
        "  human: {", f"  {kind}: {{"
    )
    rules = rule_set_from_text(text, file="gaps.yaml")
    if not meant:
        assert prepare(rules).between.bounds[kind].max_speed_m_s == 0.6
        return

    with pytest.raises(RuleSetError, match=f"{kind!r} can be, and no body is of that kind") as refused:
        prepare(rules)
    assert (refused.value.place, refused.value.hint) == (f"$.bounds.{kind}", f"did you mean {meant!r}?")


def test_misspelt_bounds_of_a_log_map_are_refused_as_its_own(tmp_path: Path) -> None:
    ours = tmp_path / "ours.yaml"
    ours.write_text(
        "id: ours\ntitle: ours\nsource: by hand\nextends: ariac2020\n"
        "bounds: {humn: {max_speed_m_s: 0.6, source: walks}}\n",
        "utf-8",
    )
    rules = rule_set_from_text(
        RULES.format(score="count(near)", contact_m=0.05, between="held"), file="gaps.yaml"
    )

    with pytest.raises(LogMapError, match="'humn' can be") as refused:
        prepare(rules, log_map=str(ours))
    assert refused.value.file == str(ours)
