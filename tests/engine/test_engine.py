"""From a trial to a result: what a broken check does, what an undecided one does, and what a score obeys."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Event,
    EventNumber,
    Measured,
    Result,
    RuleSet,
    ScoreError,
    Signal,
    Trial,
    Verdict,
    as_json,
    load_result,
    load_rule_set,
    measure_trial,
    price_trial,
    score_trial,
)
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.engine.measure import decidable
from ariac_score.engine.prepared import prepare
from ariac_score.errors import DataFileError, LogError, LogMapError, PluginError, RuleSetError
from ariac_score.installed.points import installed_points
from ariac_score.results.result import Pinned, Provenance
from ariac_score.review.verify import verify_result
from ariac_score.testing import NEAR_MISS, SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.work import Order

DATA = Path(__file__).parents[1] / "data"

LAWS = settings(max_examples=50, derandomize=True, deadline=None)
REGISTRY = Registry()
PAPER = load_rule_set("paper2020.published")
PREPARED = prepare(PAPER, registry=REGISTRY)
TRIAL = kitting_trial()

# order_0: 3 types, 2 colours, 2 poses, no bonus for one of the wrong colour = 7.
# order_1: 2 types, 2 colours, 1 pose, bonus 2 = 7, times 3.
TASK = 7 + 3 * 7
# The near miss is a triangle, 2.4 s wide: mean depth is half of the deepest one.
NEAR_MISS_DEMERITS = 0.4 * (1 + 2.4 * (0.8 * 1.2) / 2 / NEAR_MISS.required_m / 5)
WINDOW_S = 38.0 - 0.5  # of the competition in the example


def provenance(rule_set: RuleSet) -> Provenance:
    return Provenance((), (), Pinned(rule_set.id, rule_set.sha256), Pinned("ariac2020", "0" * 64), ())


def measured(trial: Trial, rule_set: RuleSet = PAPER, registry: Registry = REGISTRY) -> Measured:
    return measure_trial(trial, PREPARED if rule_set is PAPER else prepare(rule_set, registry=registry))


def priced(trial: Trial, rule_set: RuleSet = PAPER, registry: Registry = REGISTRY) -> Result:
    return price_trial(measured(trial, rule_set, registry), rule_set, provenance(rule_set))


def score(trial: Trial, rule_set: RuleSet = PAPER) -> float:
    result = priced(trial, rule_set)
    assert result.score is not None
    return float(result.score)


def without(trial: Trial, *names: str) -> Trial:
    return replace(trial, signals={n: s for n, s in trial.signals.items() if n not in names})


def keeping_apart(trial: Trial, distance_m: Any) -> Trial:
    """The trial with another chart of the distance, and both at the robot's pace all the time."""
    t = trial.signals["speed/human"].t
    pace = np.full(len(t), NEAR_MISS.robot_speed_m_s)
    columns = {"centre_distance/robot/human": ("m", distance_m), "speed/human": ("m/s", pace)}
    changed = {n: Signal(n, unit, t, np.broadcast_to(v, len(t))) for n, (unit, v) in columns.items()}
    return replace(trial, signals={**trial.signals, **changed})


SCORE = score(TRIAL)


# The paper's score ---------------------------------------------------------------------


def test_the_example_scores_what_hand_arithmetic_says() -> None:
    result = priced(TRIAL)

    assert result.status == "scored"
    assert float(result.score or 0) == pytest.approx(TASK / (1 + NEAR_MISS_DEMERITS), abs=1e-3)
    assert result.possible == Decimal(3 * 4 + 3 * 2 * 4)  # n products are worth 4 n, the second order 3 times


def test_without_a_near_miss_the_score_is_the_task() -> None:
    assert score(keeping_apart(TRIAL, 9.0)) == TASK


def test_an_arm_collision_zeroes_the_score() -> None:
    result = priced(replace(TRIAL, events=(*TRIAL.events, Event(30.0, "arm_collision"))))

    assert (result.status, result.score) == ("scored", 0)


@pytest.mark.parametrize(("closest_m", "gated"), [(0.5, True), (float(np.nextafter(0.5, 1.0)), False)])
def test_touching_the_human_gates_the_score_to_zero(closest_m: float, gated: bool) -> None:
    distance = np.full(len(TRIAL.signals["speed/human"].t), 9.0)
    distance[2000] = closest_m

    result = priced(keeping_apart(TRIAL, distance))

    assert result.status == "scored"
    assert (result.score == 0) is gated


@pytest.mark.parametrize("event", ["order_announced", "part_dropped", "anything"])
def test_events_that_no_check_asks_for_cost_nothing(event: str) -> None:
    assert score(replace(TRIAL, events=(*TRIAL.events, Event(30.0, event)))) == score(TRIAL)


# The same answer again -----------------------------------------------------------------


def test_the_same_trial_measured_twice_gives_the_same_bytes() -> None:
    assert as_json(priced(kitting_trial())) == as_json(priced(kitting_trial()))


def test_the_order_of_signals_bodies_and_events_changes_no_byte() -> None:
    shuffled = replace(
        TRIAL,
        signals=dict(sorted(TRIAL.signals.items(), reverse=True)),
        bodies=TRIAL.bodies[::-1],
        events=TRIAL.events[::-1],
    )
    # Coverage repeats the signals as the trial holds them, which readers sort.
    first, second = (replace(priced(t).measured, coverage=()) for t in (TRIAL, shuffled))

    assert second == first


def test_the_order_in_which_findings_are_stored_changes_no_line_of_the_ledger() -> None:
    found = measured(kitting_trial())
    turned = replace(found, findings=dict(reversed([*found.findings.items()])))

    assert [*turned.findings] != [*found.findings]
    assert price_trial(turned, PAPER, provenance(PAPER)).ledger == priced(kitting_trial()).ledger


def test_a_stored_result_comes_back_whole(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(as_json(priced(TRIAL)), encoding="utf-8")

    assert as_json(load_result(file)) == file.read_text(encoding="utf-8")


def test_a_result_of_a_version_that_declared_no_units_is_read_with_points_as_it_took_them() -> None:
    file = DATA / "result_1_without_units.json"
    result = load_result(file)  # which prices it again and compares every line of the ledger
    (order, *_) = result.measured.of("order_score").values()

    assert result.score == Decimal("39.000000")
    assert order.units["score"] == "points"
    assert "duration_s" not in order.units
    assert all(step.outcome != "failed" for step in verify_result(file).steps)


def test_declared_units_come_back_with_a_stored_result(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(as_json(score_trial(DATA / "performance_2020.log", "ariac2020.official")))
    (order, *_) = load_result(file).measured.of("order_score").values()

    assert order.units == {name: OFFICIAL_UNITS[name] for name in order.quantities}


OFFICIAL_UNITS = {
    "score": "points",
    "total": "points",
    "max_score": "points",
    "priority_factor": "1",
    "submitted": "count",
    "duration_s": "s",
}
"""ARIAC notes on log formats, section 3."""


def test_old_findings_are_priced_again_without_their_log(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(as_json(priced(TRIAL)), encoding="utf-8")
    stored = load_result(file)

    assert price_trial(stored.measured, PAPER, stored.provenance).score == priced(TRIAL).score


# Undecided -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", SNAPSHOT_SIGNALS)
def test_a_deleted_signal_of_the_human_leaves_the_score_open(name: str) -> None:
    result = priced(without(TRIAL, name))

    assert result.interval is not None
    assert result.score == result.interval.least <= SCORE
    assert float(result.interval.most) >= SCORE
    assert "separation" in {assumption.check for assumption in result.assumptions}
    assert any(name in assumption.message for assumption in result.assumptions)


def test_a_trial_recorded_without_the_human_lies_between_a_contact_and_no_violation() -> None:
    # 28 points of the task; had the human been touched, nothing of them is left.
    interval = priced(kitting_trial(human=False)).interval

    assert interval is not None
    assert (interval.least, interval.most, interval.tight) == (0, 28, False)


def test_a_withheld_result_has_no_score_in_its_json_either(tmp_path: Path) -> None:
    rules = paper_with(tmp_path, separation="withhold")
    data = json.loads(as_json(priced(kitting_trial(human=False), rules)))

    assert (data["status"], data["score"], data["ledger"]) == ("incomplete", None, None)
    assert (data["interval"]["counts"], data["interval"]["most"]) == ("withhold", 28)
    assert data["assumptions"]


@pytest.mark.parametrize("witness", ["submissions", "arm_collision"])
def test_a_log_that_promises_less_leaves_the_score_open(witness: str) -> None:
    seen = () if witness == "submissions" else TRIAL.submissions
    trial = replace(TRIAL, submissions=seen, witnessed=TRIAL.witnessed - {witness})

    result = priced(trial)
    assert result.is_open
    assert result.score is not None
    assert result.score <= priced(TRIAL).score


@pytest.mark.slow
@given(st.sets(st.sampled_from([*SNAPSHOT_SIGNALS, "position/human", "position/robot"]), min_size=1))
@LAWS
def test_deleting_signals_never_raises_the_score(names: set[str]) -> None:
    result = priced(without(TRIAL, *names))

    assert result.score is None or float(result.score) <= SCORE


@pytest.mark.slow
@given(start=st.integers(0, 3900), length=st.integers(1, 400))
@LAWS
def test_cutting_a_hole_never_raises_the_score(start: int, length: int) -> None:
    kept = np.ones(len(TRIAL.signals["speed/human"].t), dtype=bool)
    kept[start : start + length] = False
    holed = {n: Signal(n, s.unit, s.t[kept], s.values[kept]) for n, s in TRIAL.signals.items()}

    result = priced(replace(TRIAL, signals=holed))

    # Holes of up to 0.05 s are allowed. Four samples at the deepest moment are 0.04 s of 0.96/5.46
    # relative depth, and a second of that is worth 28 * 0.4 / 5 / 1.42**2 = 1.1 points: below 0.01.
    assert result.score is None or float(result.score) <= SCORE + 0.01


def paper_with(folder: Path, **policies: str) -> RuleSet:
    """The paper's rule set with other policies for some checks."""
    data = yaml.safe_load(Path(PAPER.file).read_text(encoding="utf-8"))
    for check, policy in policies.items():
        group = "rules" if check in data["rules"] else "monitors"
        data[group][check]["on_inconclusive"] = policy
    file = folder / "paper.yaml"
    file.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return load_rule_set(str(file))


BLIND = without(TRIAL, *SNAPSHOT_SIGNALS)


@pytest.mark.parametrize(
    ("separation", "expected"),
    [
        ("zero", 0.0),
        # one violation at full depth for all of the competition: 0.4 (1 + 37.5 / 5) = 3.4
        ("worst_case", TASK / (1 + 0.4 * (1 + WINDOW_S / 5))),
        ("exclude", float(TASK)),
    ],
)
def test_a_rule_set_may_say_what_an_undecided_check_counts_as(
    separation: str, expected: float, tmp_path: Path
) -> None:
    rules = paper_with(tmp_path, separation=separation, human_contact="exclude")

    result = priced(BLIND, rules)

    assert result.status == "scored"
    assert float(result.score or 0) == pytest.approx(expected, abs=1e-6)
    assert {(a.check, a.policy) for a in result.assumptions} == {
        ("separation", separation),
        ("human_contact", "exclude"),
    }


def test_one_withheld_check_withholds_the_score_whatever_the_others_say(tmp_path: Path) -> None:
    rules = paper_with(tmp_path, separation="zero", human_contact="withhold")

    result = priced(BLIND, rules)

    assert {a.check: a.policy for a in result.assumptions} == {
        "separation": "zero",
        "human_contact": "withhold",
    }
    assert (result.status, result.score) == ("incomplete", None)


@pytest.mark.parametrize("policy", ["withhold", "zero", "worst_case", "exclude"])
def test_a_policy_changes_nothing_where_everything_is_decided(policy: str, tmp_path: Path) -> None:
    rules = paper_with(tmp_path, **dict.fromkeys(PAPER.checks, policy))

    result = priced(TRIAL, rules)

    assert result.score == priced(TRIAL).score
    assert result.assumptions == ()


def test_a_check_that_is_not_priced_withholds_nothing() -> None:
    orders = tuple(replace(order, announced_s=None) for order in TRIAL.work)

    result = priced(replace(TRIAL, work=orders))  # leaves `order_time` undecided

    assert {f.verdict for f in result.measured.of("order_time").values()} == {Verdict.INCONCLUSIVE}
    assert result.score == priced(TRIAL).score


def test_the_worst_case_of_an_unseen_contact_is_a_contact(tmp_path: Path) -> None:
    rules = paper_with(tmp_path, separation="worst_case", human_contact="worst_case")

    assert score(BLIND, rules) == 0


@pytest.mark.parametrize(
    ("trial", "answer"),
    [
        (TRIAL, "has what it needs"),
        (BLIND, "undecided: signal"),
        (kitting_trial(human=False), "undecided: the log"),
    ],
    ids=["whole", "blind", "no human"],
)
def test_a_trial_tells_which_checks_it_can_decide(trial: Trial, answer: str) -> None:
    # Distances would be derived from the positions.
    trial = without(trial, "position/human", "position/robot")
    answers = dict(decidable(trial, prepare(PAPER, log_map="ariac2020", registry=REGISTRY)))

    assert answers["separation"].startswith(answer)
    assert answers["part_pose"] == "has what it needs"
    assert list(answers) == list(PAPER.checks)


# More violations -----------------------------------------------------------------------

THIN = replace(
    TRIAL, signals={n: Signal(n, s.unit, s.t[::4], s.values[::4]) for n, s in TRIAL.signals.items()}
)
"""The example at 25 Hz: 0.04 s between samples are allowed, and laws need many trials."""


def chart(*dips: tuple[float, float, float]) -> Any:
    """9 m apart, but for dips (when, half their width, closest); 4.35 m are required at this pace."""
    t = THIN.signals["speed/human"].t
    distance = np.full(len(t), 9.0)
    for when_s, half_s, closest_m in dips:
        distance = np.minimum(distance, closest_m + (9.0 - closest_m) * np.abs(t - when_s) / half_s)
    return distance


dips = st.tuples(st.floats(2.0, 16.0), st.floats(0.1, 3.0), st.floats(0.0, 4.3))


@given(dips, st.floats(0.0, 1.0))
@LAWS
def test_coming_closer_never_raises_the_score(dip: tuple[float, float, float], share: float) -> None:
    when_s, half_s, closest_m = dip
    closer = (when_s, half_s, closest_m * share)

    assert score(keeping_apart(THIN, chart(closer))) <= score(keeping_apart(THIN, chart(dip)))


@pytest.mark.slow
@given(dips, st.floats(1.0, 3.0))
@LAWS
def test_staying_close_for_longer_never_raises_the_score(
    dip: tuple[float, float, float], factor: float
) -> None:
    when_s, half_s, closest_m = dip
    longer = (when_s, half_s * factor, closest_m)

    assert score(keeping_apart(THIN, chart(longer))) <= score(keeping_apart(THIN, chart(dip)))


@pytest.mark.slow
@given(dips, st.floats(22.0, 36.0))
@LAWS
def test_one_more_near_miss_never_raises_the_score(dip: tuple[float, float, float], when_s: float) -> None:
    # The second is at least a second after the first: closer ones would be one episode.
    again = (when_s, 1.0, 4.0)

    assert score(keeping_apart(THIN, chart(dip, again))) <= score(keeping_apart(THIN, chart(dip)))


# Broken checks -------------------------------------------------------------------------

Played = Callable[..., Result]


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Played]:
    """Score the example with one check whose methods are the source given."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before, number = set(sys.modules), count()

    def with_check(body: str, *, group: str = "monitors", trial: Trial = TRIAL, holds: str = "") -> Result:
        head = f"from ariac_score import *\n\nclass Check:\n    {holds}\n"
        head += "    def needs(self):\n        return ()\n"
        method = "watch(self, trial)" if group == "monitors" else "judge(self, trial, order)"
        lines = "".join(f"        {line}\n" for line in body.splitlines())
        module = f"stranger_check_{next(number)}"  # a module of its own, for Python remembers them
        (tmp_path / f"{module}.py").write_text(f"{head}    def {method}:\n{lines}", encoding="utf-8")
        stranger = Plugin("odd.check", f"ariac_score.{group}", f"{module}:Check", "odd-rules", "6.6")
        monkeypatch.setattr(
            "ariac_score.checks.registry.installed_points", lambda: [*installed_points(), stranger]
        )
        file = tmp_path / "odd.yaml"
        file.write_text(
            f"{{id: odd, title: odd, source: test, log_map: ariac2020, "
            f"{group}: {{oddity: {{use: odd.check}}}}, score: holds(oddity)}}",
            encoding="utf-8",
        )
        result = priced(trial, load_rule_set(str(file)), Registry())
        as_json(result)
        return result

    yield with_check
    for name in set(sys.modules) - before:
        if name.startswith("stranger_"):
            del sys.modules[name]


def test_a_sound_check_of_a_stranger_is_priced(play: Played) -> None:
    assert play("yield Finding.satisfied('trial', 'fine')").score == 1
    assert play("yield Finding.violated('trial', 'not fine')").score == 0


BROKEN = {
    "raises": ("raise RuntimeError('out of cheese')", "raised RuntimeError: out of cheese"),
    "raises after speaking": (
        "yield Finding.satisfied('trial', 'x')\n{}['order']",
        "raised KeyError: 'order'",
    ),
    "divides by zero": ("yield 1 / 0", "raised ZeroDivisionError"),
    "exhausts the stack": (
        "return self.watch(trial) if hasattr(self, 'watch') else self.judge(trial, order)",
        "RecursionError",
    ),
    "returns no iterable": ("return Finding.satisfied('trial', 'x')", "raised TypeError"),
    "returns nothing": ("pass", "raised TypeError: None was returned; yield each, or return a list of them"),
    "ends its generator": ("raise GeneratorExit\nyield", "raised GeneratorExit"),
    "yields a word": ("yield 'satisfied'", "yields a str instead of a Finding"),
    "yields nothing at all": ("yield None", "yields a NoneType instead of a Finding"),
    "yields a verdict": ("yield Verdict.SATISFIED", "yields a Verdict instead of a Finding"),
    "yields NaN": (
        "yield Finding('trial', Verdict.VIOLATED, 'x', quantities={'depth_m': float('nan')})",
        "its quantities.depth_m is nan, which is no finite number",
    ),
    "yields infinity": (
        "yield Finding('trial', Verdict.VIOLATED, 'x', robustness=float('-inf'), unit='m')",
        "its robustness is -inf, which is no finite number",
    ),
    "contradicts its margin": (
        "yield Finding('trial', Verdict.VIOLATED, 'x', robustness=0.5, unit='m')",
        "gives finding 1, violated 'trial' (x), which cannot be: "
        "its robustness is +0.5, but a violation has none above 0",
    ),
    "gives a quantity it does not declare": (
        "yield Finding('robot', Verdict.SATISFIED, 'x', quantities={'won': 1.0}, units={'won': 'points'})",
        "its quantities.won is not declared; the check declares no 'measures'",
    ),
    "sets a field": ("trial.id = 'mine'\nyield", "raised FrozenInstanceError"),
    "adds a signal": ("trial.signals['mine'] = None\nyield", "raised TypeError"),
    "moves the human away": (
        "trial.signals['centre_distance/robot/human'].values[:] = 99.0\nyield",
        "raised ValueError: assignment destination is read-only",
    ),
    "unlocks an array": (
        "trial.signals['speed/human'].values.setflags(write=True)\nyield",
        "raised ValueError: cannot set WRITEABLE flag",
    ),
    "writes below the array": (
        "trial.signals['speed/human'].values.base.setflags(write=True)\nyield",
        "raised ValueError: cannot set WRITEABLE flag",
    ),
    "goes behind the lock": (
        "object.__setattr__(trial, 'events', ())\nyield Finding.satisfied('trial', 'x')",
        "changed the trial it was given",
    ),
    "stretches time": ("trial.signals['speed/human'].t[0] = -1.0\nyield", "raised ValueError"),
}


@pytest.mark.parametrize("group", ["rules", "monitors"])
@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_check_stops_the_score_and_is_named_in_full(play: Played, name: str, group: str) -> None:
    body, words = BROKEN[name]

    with pytest.raises(PluginError) as error:
        play(body, group=group)

    said = str(error.value)
    assert "check 'oddity'" in said
    assert "plugin odd.check (odd-rules 6.6)" in said
    assert words in said
    assert "odd-rules" in error.value.hint


def test_a_number_in_another_unit_is_a_fault_of_the_log_and_not_of_the_check(play: Played) -> None:
    drop = Event(5.0, "dropped", "robot", numbers=(EventNumber("height", 45.0, "cm"),))
    body = "trial.events_of('dropped')[0].number('height', unit='m')\nyield Finding.satisfied('trial', 'x')"

    with pytest.raises(LogError, match="check 'oddity': the number 'height' of event") as error:
        play(body, trial=replace(TRIAL, events=(*TRIAL.events, drop)))

    assert (error.value.file, error.value.place) == (TRIAL.id, "5 s")
    assert "record it in 'm'" in error.value.hint
    assert error.value.exit_code == 6


@pytest.mark.parametrize(
    ("level", "hint"), [("shipment", "declared levels: trial"), ("trial_", "did you mean 'trial'?")]
)
def test_a_rule_about_a_level_that_is_not_declared_is_refused(play: Played, level: str, hint: str) -> None:
    with pytest.raises(RuleSetError, match=f"of level '{level}', which is not declared") as error:
        play("yield Finding.violated('trial', 'x')", group="rules", holds=f"level = {level!r}")

    assert "$.rules.oddity.use" in error.value.place
    assert hint in error.value.hint


def test_a_rule_about_a_level_that_is_declared_is_asked(play: Played) -> None:
    # The trial has no items of that level: nothing is violated, so it holds.
    assert play("yield Finding.violated('trial', 'x')", group="rules", holds="level = 'trial'").score == 1


def test_a_log_map_that_is_not_installed_is_said_of_the_rule_set_that_names_it(tmp_path: Path) -> None:
    file = tmp_path / "mapless.yaml"
    file.write_text("{id: mapless, title: t, source: s, log_map: nowhere, score: 1}", encoding="utf-8")

    with pytest.raises(LogMapError, match="there is no log map 'nowhere'") as error:
        prepare(str(file))

    assert (error.value.file, error.value.place) == (str(file), "$.log_map")


def test_what_a_plugin_prints_is_kept_out_of_the_result_and_its_name_said(
    play: Played, capsys: pytest.CaptureFixture[str]
) -> None:
    play("print('here')\nprint('and there')\nyield Finding.satisfied('trial', 'x')")

    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("notice: plugin odd.check (odd-rules 6.6) printed 'here' and ")
    assert err.endswith("plugins speak through findings alone\n")


@pytest.mark.parametrize(
    "line",
    [
        "import sys; sys.__stdout__.write('here\\n')",
        "import os; os.write(1, b'here\\n')",
        "import subprocess; subprocess.run(['echo', 'here'])",
    ],
)
def test_what_goes_past_print_is_kept_out_too(
    play: Played, line: str, capfd: pytest.CaptureFixture[str]
) -> None:
    sys.stdout.write("before\n")
    play(f"{line}\nyield Finding.satisfied('trial', 'x')")
    sys.stdout.write("after\n")

    out, err = capfd.readouterr()
    assert out == "before\nafter\n"
    assert err.startswith("notice: plugin odd.check (odd-rules 6.6) printed 'here'; ")


def test_a_check_that_takes_longer_than_its_budget_is_named_and_its_findings_stand(
    play: Played, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = count(0.0, 2.0)  # s; each look at it is 2 s later
    monkeypatch.setattr("ariac_score.engine.ask.time.process_time", lambda: next(clock))
    monkeypatch.setattr("ariac_score.engine.ask.budget_of", lambda _trial: 1.0)

    assert play("yield Finding.satisfied('trial', 'x')").score == 1
    assert capsys.readouterr().err == (
        "notice: plugin odd.check (odd-rules 6.6) took 2.0 s of processor time for check 'oddity', "
        "longer than its budget of 1 s\n"
    )


def test_a_log_in_another_unit_than_a_check_reads_is_refused_and_no_fault_of_the_plugin(
    tmp_path: Path,
) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "{id: r, title: R, source: test, log_map: ariac2020, score: holds(slow), monitors: {slow: "
        "{use: formula.always, with: {holds: p < 2, signals: {p: 'pressure/{robot} [bar]'}}}}}"
    )
    speed = TRIAL.signals["speed/robot"]
    grip = Signal("pressure/robot", "Pa", speed.t, speed.values)

    with pytest.raises(LogError) as refused:
        priced(replace(TRIAL, signals={grip.name: grip}), load_rule_set(str(rules)), Registry())
    assert "'pressure/robot' is in 'Pa', but check 'slow' reads it in 'bar'" in str(refused.value)
    assert "name the unit of the log in the rule set" in refused.value.hint


def test_a_monitor_that_says_nothing_stops_the_score(play: Played) -> None:
    with pytest.raises(PluginError, match=r"odd\.check \(odd-rules 6\.6\) says nothing"):
        play("return ()")


def test_a_rule_that_says_nothing_about_an_order_stops_the_score(play: Played) -> None:
    with pytest.raises(PluginError, match=r"odd\.check \(odd-rules 6\.6\) says nothing about order_1"):
        play("if order.id == 'order_0':\n    yield Finding.satisfied('order_0', 'x')", group="rules")


@pytest.mark.parametrize(
    ("verdict", "margin"), [("VIOLATED", 0.0), ("VIOLATED", -1.0), ("SATISFIED", 0.0), ("SATISFIED", -1.0)]
)
def test_a_violation_may_have_no_margin_left_and_a_brief_one_may_be_satisfied(
    play: Played, verdict: str, margin: float
) -> None:
    body = f"yield Finding('trial', Verdict.{verdict}, 'x', robustness={margin}, unit='m')"

    result = play(body, holds="t_on_s = 0.5")

    (finding,) = result.measured.findings.values()
    assert (finding.verdict.name, finding.robustness) == (verdict, margin)


def test_a_missing_signal_is_undecided_and_no_fault_of_the_plugin(play: Played) -> None:
    result = play("trial.signal('force/robot', unit='N')\nyield")

    (finding,) = result.measured.findings.values()
    assert (finding.subject, finding.verdict) == ("force/robot", Verdict.INCONCLUSIVE)
    assert result.is_open


def test_what_was_said_before_a_signal_was_missed_stands(play: Played) -> None:
    body = "yield Finding.violated('trial', 'seen')\ntrial.signal('force/robot', unit='N')"

    found = {f.verdict for f in play(body).measured.findings.values()}

    assert found == {Verdict.VIOLATED, Verdict.INCONCLUSIVE}


def test_an_attempt_to_change_the_trial_leaves_it_as_it_was(play: Played) -> None:
    before = as_json(priced(TRIAL))

    with pytest.raises(PluginError):
        play("for s in trial.signals.values():\n    s.values[:] = 0.0\nyield")

    assert as_json(priced(TRIAL)) == before


def test_a_check_knows_its_findings_by_its_name_in_the_rule_set(play: Played) -> None:
    result = play("yield Finding('trial', Verdict.SATISFIED, 'x', check='somebody_else')")

    assert {key: f.check for key, f in result.measured.findings.items()} == {"oddity#1": "oddity"}


def test_findings_are_numbered_by_subject_and_time_and_not_as_they_come(play: Played) -> None:
    body = "\n".join(
        f"yield Finding({subject!r}, Verdict.SATISFIED, 'x', span=Span({start_s}, 9.0))"
        for subject, start_s in (("robot", 1.0), ("human", 5.0), ("human", 2.0))
    )

    found = [(f.subject, f.span and f.span.start_s) for f in play(body).measured.findings.values()]

    assert found == [("human", 2.0), ("human", 5.0), ("robot", 1.0)]


FAULTS = {
    "a number that is a word": (
        "yield Finding('trial', Verdict.VIOLATED, 'x', quantities={'depth_m': 'deep'})"
    ),
    "evidence that is no number": (
        "yield Finding('trial', Verdict.VIOLATED, 'x', evidence=(Sample('s', 0.0, float('nan'), 'm'),))"
    ),
    "a span without end": "yield Finding('trial', Verdict.VIOLATED, 'x', span=Span(0.0, float('inf')))",
    "a verdict that is a word": "yield Finding('trial', 'violated', 'x')",
    "a subject that is a number": (
        "yield Finding(1, Verdict.VIOLATED, 'x')\nyield Finding('trial', Verdict.VIOLATED, 'x')"
    ),
    "an error of ours": "raise ScoreError('odd')",
    "an exit": "raise SystemExit(0)",
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_in_what_a_check_says_is_named_in_full(play: Played, name: str) -> None:
    try:
        play(FAULTS[name])
    except BaseException as error:  # noqa: BLE001  # SystemExit is one of the faults
        caught: BaseException | None = error
    else:
        caught = None

    assert isinstance(caught, PluginError)
    assert "odd-rules 6.6" in str(caught)


def test_a_trial_before_its_first_order_scores_nothing_and_blames_no_plugin() -> None:
    assert score(replace(TRIAL, work=(), submissions=())) == 0


# Coverage and scopes -------------------------------------------------------------------


def test_the_result_repeats_how_much_of_the_competition_each_signal_covers() -> None:
    t = np.array([0.5, 1.0, 3.0, 3.5])
    signal = Signal("speed/robot", "m/s", t, np.zeros(4))

    (coverage,) = measured(
        replace(TRIAL, signals={signal.name: signal}, bodies=(Body("robot", "robot"),))
    ).coverage

    assert (coverage.signal, coverage.samples) == ("speed/robot", 4)
    assert coverage.rate_hz == pytest.approx(1.0)  # three steps in 3 s
    assert coverage.largest_gap_s == pytest.approx(38.0 - 3.5)  # to the end of the competition


def test_every_wanted_product_is_a_scope_handed_in_or_not() -> None:
    scopes = measured(replace(TRIAL, submissions=())).scopes

    assert [scope.path for scope in scopes.each("part")] == [
        *(f"order_0/order_0_shipment_0/part_{i}" for i in range(3)),
        *(f"order_1/order_1_shipment_0/part_{i}" for i in range(2)),
    ]
    assert dict(scopes.facts) == {"duration_s": WINDOW_S, "orders": 2}


def test_the_first_order_announced_is_the_first_whatever_its_name() -> None:
    second, first = Order("a_late_one", announced_s=9.0), Order("z_early_one", announced_s=1.0)

    scopes = measured(replace(TRIAL, work=(first, second))).scopes

    assert {scope.path: scope.facts["index"] for scope in scopes.each("order")} == {
        "z_early_one": 0,
        "a_late_one": 1,
    }


def test_a_plugin_error_is_an_error_of_ours() -> None:
    assert issubclass(PluginError, ScoreError)
    assert PluginError("x").exit_code == 3


# Configurations of other years ---------------------------------------------------------

OF_2024 = """
orders:
- {id: AAAA0001, type: kitting, announcement: {time_condition: 0}, priority: false, kitting_task: {
    agv_number: 1, tray_id: 3, destination: warehouse, products: [{type: pump, color: red, quadrant: 1}]}}
"""


@pytest.mark.parametrize(
    ("text", "likeness"),
    [
        (OF_2024, "a trial configuration of 2023 or 2024"),
        ("static_sensors: {front: {type: lidar}}\n", "a team configuration of 2024"),
        (
            "sensors: {front: {type: lidar, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}}\n",
            "a team configuration of 2023",
        ),
    ],
)
def test_a_configuration_of_another_year_is_refused_by_what_it_looks_like(
    tmp_path: Path, text: str, likeness: str
) -> None:
    write_trial_log(tmp_path / "trial.jsonl", kitting_trial())
    (tmp_path / "config.yaml").write_text(text, encoding="utf-8")

    with pytest.raises(DataFileError) as caught:
        score_trial(tmp_path, "ariac2020.as_coded")
    assert caught.value.cause == f"it looks like {likeness}, and ariac2020.as_coded is for 2020"
    assert str(caught.value.file).endswith("config.yaml")


def test_sensors_that_several_years_have_are_of_none_of_them(tmp_path: Path) -> None:
    write_trial_log(tmp_path / "trial.jsonl", kitting_trial())
    sensors = "sensors: {front: {type: rgbd_camera, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}}\n"
    (tmp_path / "config.yaml").write_text(sensors, encoding="utf-8")

    assert score_trial(tmp_path, "ariac2020.as_coded").status == "scored"


def test_a_product_that_no_edition_has_is_named_with_the_one_that_was_meant(tmp_path: Path) -> None:
    text = write_trial_log(tmp_path / "trial.jsonl", kitting_trial()).read_text(encoding="utf-8")
    assert '"gear_part_blue"' in text
    (tmp_path / "trial.jsonl").write_text(text.replace("gear_part_blue", "gear_prt_blue"), encoding="utf-8")

    defects = score_trial(tmp_path / "trial.jsonl", "ariac2020.as_coded").measured.log_defects

    (named,) = [defect for defect in defects if defect.kind == "unknown_product_type"]
    assert (
        "'gear_prt_blue' is no product type of 2017 to 2022; did you mean 'gear_part_blue'?" in named.message
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rules", "kind", "said"),
    [
        (
            "ariac2024.release_5",
            "pmp_red",
            ["'pmp_red' is no product type of 2023 and 2024; did you mean 'pump_red'?"],
        ),
        ("ariac2024.release_5", "pump_red", []),
        ("ariac2023.as_coded", "gear_part_red", ["'gear_part_red' is no product type of 2023 and 2024; "]),
        ("ariac2020.as_coded", "pump_red", ["'pump_red' is no product type of 2017 to 2022; "]),
        ("ariac2025.as_coded", "pmp_red", []),
    ],
)
def test_a_log_asks_only_for_products_of_the_edition(
    tmp_path: Path, rules: str, kind: str, said: list[str]
) -> None:
    text = write_trial_log(tmp_path / "trial.jsonl", kitting_trial()).read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    for line in lines:
        if line["record"] == "order":
            for task in line["tasks"]:
                task["products"] = [{**task["products"][0], "type": kind}]
    (tmp_path / "trial.jsonl").write_text(
        "".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8"
    )
    defects = score_trial(tmp_path / "trial.jsonl", rules).measured.log_defects

    named = [defect.message for defect in defects if defect.kind == "unknown_product_type"]
    assert len(named) == 2 * len(said)
    assert all(message.startswith(said[0]) for message in named)


def test_a_record_before_the_trial_and_a_pose_that_is_none_are_named(tmp_path: Path) -> None:
    text = write_trial_log(tmp_path / "trial.jsonl", kitting_trial()).read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    handed_in = next(line for line in lines if line["record"] == "submission")
    handed_in["contents"][0]["pose"]["orientation_wxyz"] = [0, 0, 0, 0]
    (tmp_path / "trial.jsonl").write_text(
        "".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8"
    )
    defects = score_trial(tmp_path / "trial.jsonl", "ariac2020.as_coded").measured.log_defects

    (named,) = [defect for defect in defects if defect.kind == "unusable_pose"]
    assert named.where.startswith("trial.jsonl, record ")
    assert "a quaternion of norm 0" in named.message
    handed_in["t_s"] = -14.0
    (tmp_path / "trial.jsonl").write_text(
        "".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8"
    )
    with pytest.raises(ScoreError, match=r"t_s is -14\.0, before the trial"):
        score_trial(tmp_path / "trial.jsonl", "ariac2020.as_coded")


def test_orders_are_numbered_as_they_were_announced_and_those_never_announced_come_last() -> None:
    orders = (
        Order("never"),
        Order("second", announced_s=9.0),
        Order("first", announced_s=20.0),
        Order("nor"),
    )
    events = (Event(3.0, "order_announced", "first"), Event(20.0, "order_announced", "first_update_0"))
    trial = Trial("t", orders, events=events)
    measured = measure_trial(trial, prepare("paper2020.published").only([]))

    assert {scope.path: scope.facts["index"] for scope in measured.scopes.inner} == {
        "first": 0,
        "second": 1,
        "never": 2,
        "nor": 3,
    }


def test_where_no_announcement_is_known_orders_are_numbered_as_listed() -> None:
    trial = Trial("t", (Order("b"), Order("a")))
    measured = measure_trial(trial, prepare("paper2020.published").only([]))

    assert [scope.facts["index"] for scope in measured.scopes.inner] == [0, 1]


# Recordings without orders ---------------------------------------------------------------

MONITORS_ALONE = (
    "{id: alone, title: monitors alone, source: a test, log_map: ariac2020, competition: {use: ariac}, "
    "monitors: {separation: {use: iso_ts_15066.ssm_separation}}, %s}"
)


def no_orders(folder: Path) -> Path:
    return write_trial_log(folder / "trial.jsonl", replace(kitting_trial(), work=(), submissions=()))


@pytest.mark.slow
@pytest.mark.parametrize(
    "priced",
    [
        "score: 1 / (1 + count(separation))",
        "terms: {trial: {near: count(separation)}}, score: 1 / (1 + near)",
    ],
)
def test_monitors_alone_need_no_order_in_the_log(priced: str, tmp_path: Path) -> None:
    (tmp_path / "rules.yaml").write_text(MONITORS_ALONE % priced)

    result = score_trial(no_orders(tmp_path), str(tmp_path / "rules.yaml"))

    assert result.status == "scored"
    assert result.score == Decimal("0.5")  # the near miss of the example is one violation


@pytest.mark.parametrize(
    "priced",
    [
        "score: count(order)",
        "terms: {order: {one: 1}}, score: sum(order.one)",
        "terms: {submission: {one: 1}}, score: '1'",
        "rules: {seen: {use: kitting.presence}}, score: 1 / (1 + count(separation))",
        "rules: {seen: {use: kitting.presence}}, score: sum(order.index)",
    ],
)
def test_whoever_speaks_of_orders_is_refused_a_log_without_any(priced: str, tmp_path: Path) -> None:
    (tmp_path / "rules.yaml").write_text(MONITORS_ALONE % priced)

    with pytest.raises(LogError, match="no order was found"):
        score_trial(no_orders(tmp_path), str(tmp_path / "rules.yaml"))
