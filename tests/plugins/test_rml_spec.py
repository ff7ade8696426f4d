"""The monitor `rml.spec`: findings of a specification over the signals of a trial.

The paper's property has a second implementation, `iso_ts_15066.ssm_separation`, to be
held against; everything else is worked by hand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict, Worlds, load_rule_set, score_trial
from ariac_score.checks.registry import Registry
from ariac_score.errors import RuleSetError
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score_ariac.testing import kitting_trial
from ariac_score_rml import RmlSpec, compile_rml
from ariac_score_standards import SsmSeparation

ROOT = Path(__file__).parents[2]
SPEC = (ROOT / "examples/rml/separation.rml").read_text(encoding="utf-8")
SNAPSHOT = {
    "snapshot": {
        "human_operator_speed": "speed/{human}",
        "robot_speed": "speed/{robot}",
        "distance_robot_human_operator": "centre_distance/{robot}/{human}",
    }
}
SEPARATION = RmlSpec(SPEC, SNAPSHOT)
GAP = {"gap": {"d": "centre_distance/{robot}/{human}"}}
AT_LEAST_2 = "ok matches {topic: 'gap', d: d} with d >= 2; Main = ok*;"

Times = Sequence[float]


def at_100_hz(duration_s: float) -> list[float]:
    return [k / 100 for k in range(round(duration_s * 100) + 1)]


def watched(
    t: Times,
    distance_m: Times | float,
    *,
    human: Times | float = 0.0,
    robot: Times | float = 0.0,
    ended: bool = True,
) -> Trial:
    """One robot and one human, with the signals of the paper's snapshot."""
    columns: Mapping[str, tuple[str, Any]] = {
        "centre_distance/robot/human": ("m", distance_m),
        "speed/human": ("m/s", human),
        "speed/robot": ("m/s", robot),
    }
    signals = {
        name: Signal(name, unit, np.asarray(t, float), np.broadcast_to(np.asarray(values, float), len(t)))
        for name, (unit, values) in columns.items()
    }
    span = Span(float(t[0]), float(t[-1]))
    events = (Event(span.start_s, COMPETITION_STARTED), Event(span.end_s, COMPETITION_ENDED))
    bodies = (Body("human", "human"), Body("robot", "robot"))
    return Trial("t", bodies=bodies, signals=signals, recorded=span, events=events if ended else events[:1])


def near_misses(count: int) -> Trial:
    """So many approaches of 0.5 s to 1 m, every 5 s."""
    t = at_100_hz(5.0 * count)
    return watched(t, [1.0 if 2.0 <= time % 5.0 < 2.5 else 4.0 for time in t])


def only(monitor: RmlSpec, trial: Trial) -> Finding:
    (finding,) = monitor.watch(trial)
    return finding


def facts_of(finding: Finding) -> tuple[Any, ...]:
    """All of a finding but its words."""
    return (
        finding.subject,
        finding.verdict,
        finding.span,
        finding.robustness,
        finding.unit,
        dict(finding.quantities),
        [sample for sample in finding.evidence if not sample.signal.startswith(("bound", "required"))],
    )


# The paper's property, twice -------------------------------------------------------------


def test_the_example_gets_the_findings_and_the_score_of_the_separation_monitor() -> None:
    trial = kitting_trial()

    in_rml, built_in = list(SEPARATION.watch(trial)), list(SsmSeparation(profile="seed").watch(trial))

    key = lambda finding: sorted(map(str, facts_of(finding)[6]))  # noqa: E731  # evidence in any order
    assert [facts_of(f)[:6] for f in in_rml] == [facts_of(f)[:6] for f in built_in]
    assert list(map(key, in_rml)) == list(map(key, built_in))
    result = score_trial(
        ROOT / "examples/kitting_near_miss.mcap", load_rule_set(str(ROOT / "examples/rml/separation.yaml"))
    )
    assert str(result.score) == "19.761677"


def test_the_specification_of_the_rule_set_is_the_example() -> None:
    rules = yaml.safe_load((ROOT / "examples/rml/separation.yaml").read_text(encoding="utf-8"))
    given_ = rules["monitors"]["separation"]["with"]

    assert compile_rml(given_["spec"]).spec == compile_rml(SPEC).spec
    assert given_["events"] == SNAPSHOT


def test_the_specification_of_the_page_is_the_example() -> None:
    page = (ROOT / "docs/rml.md").read_text(encoding="utf-8")

    assert compile_rml(page.split("```rml\n")[1].split("```")[0]).spec == compile_rml(SPEC).spec


distances = st.lists(st.sampled_from([2.0, 2.59, 2.6, 2.61, 4.0, 7.5]), min_size=2, max_size=40)
speeds = st.sampled_from([0.0, 0.3, 1.0, 1.7])


@given(distances, speeds, speeds, st.sampled_from([0.0, 0.03, 1.0]))
@settings(max_examples=60)
def test_any_trial_gets_the_findings_of_the_separation_monitor(
    distance_m: list[float], human: float, robot: float, t_off_s: float
) -> None:
    trial = watched([k / 100 for k in range(len(distance_m))], distance_m, human=human, robot=robot)

    in_rml = RmlSpec(SPEC, SNAPSHOT, exact=True, t_off_s=t_off_s).watch(trial)
    built_in = SsmSeparation(profile="seed", t_off_s=t_off_s).watch(trial)

    assert [facts_of(f)[:6] for f in in_rml] == [facts_of(f)[:6] for f in built_in]


def test_equal_distance_satisfies(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, bool, Verdict]] = [
        (2.6, True, Verdict.SATISFIED),
        (np.nextafter(2.6, 0), True, Verdict.VIOLATED),
        (np.nextafter(2.6, 0), False, Verdict.SATISFIED),  # the reference tolerates 1e-10
        (2.6 - 2e-10, False, Verdict.VIOLATED),
    ]
    for distance_m, exact, verdict in cases:
        with subtests.test(distance_m=distance_m, exact=exact):
            finding = only(RmlSpec(SPEC, SNAPSHOT, exact=exact), watched(at_100_hz(1.0), distance_m))

            assert finding.verdict is verdict
            assert finding.robustness is not None
            assert (finding.robustness < 0) is (verdict is Verdict.VIOLATED)


# After a violation -----------------------------------------------------------------------


@pytest.mark.parametrize(("after", "count"), [("resume", 5), ("restart", 5), ("once", 1)])
def test_five_near_misses_are_five_violations_unless_one_is_enough(after: Any, count: int) -> None:
    findings = list(RmlSpec(AT_LEAST_2, GAP, after_violation=after).watch(near_misses(5)))

    assert [f.verdict for f in findings] == [Verdict.VIOLATED] * count
    assert findings[0].span is not None
    assert findings[0].span.start_s == 2.0
    assert all(f.robustness == -1.0 for f in findings)


def test_pauses_shorter_than_t_off_s_are_bridged_and_short_violations_left_out() -> None:
    assert len(list(RmlSpec(AT_LEAST_2, GAP, t_off_s=4.51).watch(near_misses(3)))) == 1
    assert len(list(RmlSpec(AT_LEAST_2, GAP, t_off_s=4.5).watch(near_misses(3)))) == 3
    assert only(RmlSpec(AT_LEAST_2, GAP, t_on_s=0.51), near_misses(3)).verdict is Verdict.SATISFIED


def test_restart_asks_for_the_beginning_again_and_resume_goes_on() -> None:
    # Opening once (beyond 3 m) and then anything but touching (0 m).
    spec = (
        "open matches {topic:'gap', d:d} with d > 3; touch matches {topic:'gap', d:0.0};"
        "free not matches touch; Main = open free*;"
    )
    t = at_100_hz(0.05)
    trial = watched(t, [4.0, 2.0, 0.0, 2.0, 4.0, 2.0])

    def spans(after: Any) -> list[Span | None]:
        monitor = RmlSpec(spec, GAP, after_violation=after, t_off_s=0.0)
        return [f.span for f in monitor.watch(trial) if f.verdict is Verdict.VIOLATED]

    assert spans("resume") == [Span(t[2], t[3])]
    assert spans("restart") == [Span(t[2], t[4])]  # 2 m at t[3] is no opening


# What cannot be judged -------------------------------------------------------------------


def test_a_missing_signal_is_inconclusive() -> None:
    trial = kitting_trial(human=False)
    without = RmlSpec(
        "ok matches {topic:'arm', v:v} with v < 9; Main = ok*;", {"arm": {"v": "speed/{human}"}}
    )
    missing = RmlSpec(AT_LEAST_2, {"gap": {"d": "centre_distance_2d/{robot}/{human}"}})

    assert only(without, trial).verdict is Verdict.INCONCLUSIVE
    assert "centre_distance_2d/robot/human" in only(missing, watched([0.0, 0.01], 3.0)).message


def test_a_gap_is_inconclusive_and_so_is_a_log_without_its_end() -> None:
    t = [0.0, 0.05, 0.101, 0.15]

    gap = only(RmlSpec(AT_LEAST_2, GAP), watched(t, 3.0))
    end = list(RmlSpec(AT_LEAST_2, GAP).watch(watched([0.0, 0.05], 3.0, ended=False)))

    assert (gap.verdict, gap.span) == (Verdict.INCONCLUSIVE, Span(0.05, 0.101))
    assert [f.verdict for f in end] == [Verdict.INCONCLUSIVE]
    assert only(RmlSpec(AT_LEAST_2, GAP), watched([0.0, 0.05, 0.1], 3.0)).verdict is Verdict.SATISFIED


@pytest.mark.parametrize("monitor", [RmlSpec(), RmlSpec(AT_LEAST_2), RmlSpec("", GAP)])
def test_without_a_specification_or_events_nothing_passes(monitor: RmlSpec) -> None:
    assert only(monitor, near_misses(1)).verdict is Verdict.INCONCLUSIVE


def test_an_event_that_cannot_be_judged_leaves_the_rest_undecided(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, str]] = [
        (
            "a matches {topic:'gap', d:d} with d ^ 0.5 > 1.5; Main = a*;",
            "event 1, at 0.000 s: '^' has no value",
        ),
        ("a matches {topic:t, d:_} with t > 1; Main = a*;", "event 1, at 0.000 s: 't' is the string 'gap'"),
        ("a(x) matches {topic:'gap', d:x}; Main = {let x; if (x > 1) a(x)* else empty};", "the beginning"),
        ("a(x) matches {topic:'gap', d:x}; Main = ({let x; a(x) Main} | never)?;", "grown beyond"),
    ]
    for spec, cause in cases:
        with subtests.test(spec=spec, cause=cause):
            finding = only(RmlSpec(spec, GAP, max_state=50), watched(at_100_hz(1.0), -2.0))

            assert finding.verdict is Verdict.INCONCLUSIVE
            assert cause in finding.message
            assert finding.span == Span(finding.span.start_s if finding.span else 0.0, 1.0)


# Other specifications --------------------------------------------------------------------


@pytest.mark.parametrize(("closest_m", "verdicts"), [(0.5, []), (1.5, [Verdict.VIOLATED])])
def test_a_trial_that_ends_before_the_specification_may_is_a_violation(
    closest_m: float, verdicts: list[Verdict]
) -> None:
    spec = "near matches {topic:'gap', d:d} with d < 1; far not matches near; Main = far* near any*;"
    t = at_100_hz(1.0)
    findings = RmlSpec(spec, GAP).watch(watched(t, [closest_m if time == 0.5 else 3.0 for time in t]))

    violations = [f for f in findings if f.verdict is Verdict.VIOLATED]
    assert [f.verdict for f in violations] == verdicts
    assert all(f.span == Span(1.0, 1.0) for f in violations)


def test_a_log_without_the_end_of_the_competition_leaves_open_what_the_specification_still_needs() -> None:
    spec = "near matches {topic:'gap', d:d} with d < 1; far not matches near; Main = far* near any*;"
    never, once = (watched(at_100_hz(1.0), [3.0] * 50 + [d] + [3.0] * 50) for d in (3.0, 0.5))

    open_ = only(RmlSpec(spec, GAP), replace(never, events=()))
    kept = only(RmlSpec(spec, GAP), replace(once, events=()))

    assert (open_.verdict, open_.span) == (Verdict.INCONCLUSIVE, Span(1.0, 1.0))
    assert "does not show the end of the competition" in open_.message
    assert kept.verdict is Verdict.SATISFIED


def test_data_can_be_bound_over_the_events_of_a_trial() -> None:
    # The distance never changes: the first value holds for the whole block.
    spec = "at(d) matches {topic:'gap', d:d}; Main = {let d; at(d)*};"
    t = at_100_hz(0.1)

    assert only(RmlSpec(spec, GAP), watched(t, 3.0)).verdict is Verdict.SATISFIED
    moved = only(RmlSpec(spec, GAP), watched(t, [3.0] * 10 + [3.1]))
    assert (moved.verdict, moved.span, moved.robustness) == (Verdict.VIOLATED, Span(0.1, 0.1), None)


def test_each_robot_is_judged_on_its_own_and_topics_are_distinguished() -> None:
    t = np.array(at_100_hz(1.0))
    signals = [
        Signal(f"speed/{name}", "m/s", t, np.full(len(t), v)) for name, v in (("r1", 0.2), ("r2", 0.9))
    ]
    trial = Trial(
        "t",
        bodies=(Body("r1", "robot"), Body("r2", "robot")),
        signals={s.name: s for s in signals},
        recorded=Span(0.0, 1.0),
    )
    events = {"arm": {"v": "speed/{robot}"}, "again": {"v": "speed/{robot}"}}
    monitor = RmlSpec(
        "slow matches {topic:'arm', v:v} with v <= 0.5; arm matches {topic:'arm'}; Main = arm >> slow*;",
        events,
    )

    slow, fast = monitor.watch(trial)

    assert (slow.subject, slow.verdict, slow.robustness, slow.unit) == ("r1", Verdict.SATISFIED, 0.3, "m/s")
    assert (fast.subject, fast.verdict, fast.robustness) == ("r2", Verdict.VIOLATED, pytest.approx(-0.4))
    assert fast.quantities["time_in_violation_s"] == pytest.approx(1.0)
    assert fast.span == Span(0.0, 1.0)


def test_a_quantity_that_is_not_well_known_is_given_with_its_unit() -> None:
    monitor = RmlSpec(
        "ok matches {topic:'g', f:f} with f < 9; Main = ok*;", {"g": {"f": "force/{robot} [N]"}}
    )

    assert [(n.quantity, n.unit) for n in monitor.needs()] == [("force", "N")]
    assert [n.quantity for n in SEPARATION.needs()] == ["centre_distance", "speed"]


def test_a_finding_names_the_text_it_rests_on() -> None:
    first, second = (only(RmlSpec(text, GAP), near_misses(1)) for text in (AT_LEAST_2, AT_LEAST_2 + " "))

    assert len(first.labels["spec_sha256"]) == 64
    assert first.labels != second.labels


# Parameters ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "cause"),
    [
        ({"spec": "Main = a"}, "line 1, column 9: ';' was expected"),
        ({"spec": "Main = X;"}, "'X' is not defined"),
        ({"spec": "nowhere.rml"}, "cannot be read"),
        ({"spec": AT_LEAST_2, "events": {"gab": GAP["gap"]}}, "topic 'gap'.*did you mean 'gab'"),
        ({"spec": AT_LEAST_2, "events": {"gap": {"dd": GAP["gap"]["d"]}}}, "'d'.*did you mean 'dd'"),
        ({"spec": AT_LEAST_2, "events": {"gap": {}}}, "'d'"),
        ({"spec": "Main = all;", "events": {"gap": {}}}, "has no field"),
        ({"spec": AT_LEAST_2, "events": {"gap": {"d": "speed"}}}, "is no signal"),
        ({"spec": AT_LEAST_2, "events": {"gap": {"d": "speed/{arm}"}}}, "only {robot} and {human}"),
        ({"spec": AT_LEAST_2, "events": {"gap": {"d": "position/{robot}"}}}, "3 components"),
        ({"spec": AT_LEAST_2, "events": {"gap": {"d": "force/{robot}"}}}, "write its unit"),
        ({"spec": AT_LEAST_2, "events": {"gap": {"d": 3}}}, "events"),
        ({"after_violation": "stop"}, "resume"),
        ({"dialect": "2023"}, "rosmonitoring"),
        ({"t_off_s": -1}, "cannot be negative"),
        ({"max_gap_s": 0}, "must be positive"),
        ({"max_state": 0}, "must be positive"),
    ],
    ids=range(17),
)
def test_a_parameter_that_cannot_be_used_is_the_rule_sets_fault(
    parameters: dict[str, Any], cause: str
) -> None:
    with pytest.raises(RuleSetError, match=cause):
        Registry().find("ariac_score.monitors", "rml.spec").build(parameters)


def test_a_specification_can_lie_in_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gap.rml").write_text(AT_LEAST_2, encoding="utf-8")

    monitor = Registry().find("ariac_score.monitors", "rml.spec").build({"spec": "gap.rml", "events": GAP})

    assert len(list(monitor.watch(near_misses(5)))) == 5


# Gaps ----------------------------------------------------------------------------------


def test_any_events_may_have_been_in_a_gap_and_what_remembers_is_open_after_it() -> None:
    """A second without events: of a rule for each event alone that second is open, else all from there on."""
    t = np.array([0.01 * k for k in range(301) if not 100 < k < 200])
    apart = Signal("centre_distance/arm/ann", "m", t, np.full(len(t), 6.0))
    trial = Trial(
        "t",
        bodies=(Body("arm", "robot"), Body("ann", "human")),
        signals={apart.name: apart},
        events=(Event(0.0, "competition_started"), Event(3.0, "competition_ended")),
        recorded=Span(0.0, 3.0),
        between=between_samples({}, {}),
    )
    far = "far matches {topic: 'scan', d: x} with x >= 5.0; near matches {topic: 'scan', d: x} with x < 5.0;"
    for main, least_s in (("Main = far*;", 1.0), ("Main = far* near* far*;", 2.0)):
        monitor = RmlSpec(
            spec=f"{far} {main}", events={"scan": {"d": apart.name.replace("arm/ann", "{robot}/{human}")}}
        )
        *_, worlds = monitor.watch_worlds(trial)

        assert isinstance(worlds, Worlds)
        assert [one.verdict for one in worlds.best] == [Verdict.SATISFIED]
        broken = [one.quantities["time_in_violation_s"] for one in worlds.worst]
        assert sum(broken) == pytest.approx(least_s, abs=0.02)
