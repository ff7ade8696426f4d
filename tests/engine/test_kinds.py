"""Bodies of any kinds: what is derived of them, what a monitor finds, and that their names change nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Finding,
    Signal,
    Span,
    Trial,
    Verdict,
    open_trial,
    parameter,
    score_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.engine.signal_needs import with_derived
from ariac_score.monitors import Bound, MarginMonitor, Signals, SubjectMonitor, pairs

PAGE = (Path(__file__).parents[2] / "docs/recording.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("### Bodies of your own kinds")[2].partition("\n## ")[0]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", SECTION, flags=re.DOTALL)


@pytest.fixture
def crossing(tmp_path: Path) -> Path:
    """The files of the page, in a folder of their own."""
    (log,), (monitor,), (rules, log_map) = blocks("jsonl"), blocks("python"), blocks("yaml")
    files = {"crossing.jsonl": log, "near.py": monitor, "crossing.yaml": rules, "crossing_map.yaml": log_map}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_the_example_of_the_page_prints_what_the_page_shows(
    crossing: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (command,), (shown,) = blocks("sh"), blocks("text")
    monkeypatch.chdir(crossing)

    assert main(command.split()[1:]) == 0

    printed = capsys.readouterr().out
    for line in shown.splitlines():
        assert line == "…" or f"{line}\n" in printed


def test_the_example_is_what_it_is_by_hand(crossing: Path) -> None:
    # Ann stands at 10 m; radii are 1 m and 0.3 m, so at 6 m the surfaces are 10 - 6 - 1.3 = 2.7 m apart.
    # Needed there: 3 m, and nothing for the approach, for (2 - 2)/4 s = 0 (the centred difference).
    # Before, at 4 m: 4.7 m against 3 + (4 - 0)/4 = 4 m. So one violation by 0.3 m, until the next sample.
    result = score_trial(crossing / "crossing.jsonl", crossing / "crossing.yaml", local_plugins=True)

    assert result.score == 10 - 4
    finding = result.measured.findings["too_near#1"]
    assert (finding.subject, finding.verdict) == ("truck/ann", Verdict.VIOLATED)
    assert finding.span == Span(3.0, 4.0)
    assert finding.robustness == pytest.approx(-0.3)


def test_distance_and_approach_of_the_example_are_those_of_its_positions(crossing: Path) -> None:
    trial = open_trial(crossing / "crossing.jsonl", crossing / "crossing.yaml", local_plugins=True)

    x_m = np.array([0.0, 2, 4, 6, 4, 2, 0])
    assert trial.signals["separation/truck/ann"].values == pytest.approx(10 - x_m - 1.3)
    approach = trial.signals["approach_speed_robot/truck/ann"].values
    assert list(approach) == [2, 2, 1, 0, -1, -2, -2]
    assert [name for name in trial.signals if name.count("/") == 2] == [
        "approach_speed_robot/truck/ann",
        "separation/truck/ann",
    ]


@pytest.mark.parametrize("witnessed", ['["bodies"]', "[]"])
def test_a_misspelt_kind_withholds_the_score_and_is_asked_about(crossing: Path, witnessed: str) -> None:
    log = crossing / "crossing.jsonl"
    text = log.read_text(encoding="utf-8").replace('"kind": "pedestrian"', '"kind": "pedestrain"')
    log.write_text(text.replace('["bodies"]', witnessed), encoding="utf-8")

    result = score_trial(log, crossing / "crossing.yaml", local_plugins=True)

    assert result.score is None
    (finding,) = result.measured.findings.values()
    assert finding.message == "the log shows no pedestrian; did you mean 'pedestrain'?"


def test_a_recorded_distance_of_any_kinds_counts_and_none_of_positions(crossing: Path) -> None:
    log = crossing / "crossing.jsonl"
    text = log.read_text(encoding="utf-8")
    log.write_text(text.replace('{"position/truck"', '{"separation/truck/ann": 9, "position/truck"'), "utf-8")

    assert score_trial(log, crossing / "crossing.yaml", local_plugins=True).score == 10


# Names of kinds are names and nothing else ------------------------------------------------------


def near(first: str, second: str) -> SubjectMonitor:
    """A monitor of two kinds, which knows nothing of what they are."""
    other = "other" if first == second else second
    of_both = f"{{{first}}}/{{{other}}}"
    apart, towards = f"separation/{of_both}", f"approach_speed_robot/{of_both}"

    @dataclass(frozen=True)
    class Near(MarginMonitor):
        least_m: float = parameter(1.5, unit="m", at_least=0, at_most=100)
        max_gap_s: float = parameter(0.5, unit="s", above=0, at_most=60)

        subjects = pairs(first, second)
        wanted: ClassVar = {apart: "m", towards: "m/s"}
        optional: ClassVar = {f"relative_speed/{of_both}": "m/s", f"centre_distance_2d/{of_both}": "m"}
        what, unit, clause = "distance", "m", "ours"

        def margin(self, signals: Signals) -> Bound:
            return self.at_least(signals[apart], self.least_m + np.maximum(signals[towards], 0.0))

    return Near()


def found(trial: Trial, monitor: Any) -> list[Finding]:
    return list(monitor.watch(with_derived(trial, list(monitor.needs()), Registry())))


def recorded(kinds: Sequence[str], seed: int, samples: int) -> Trial:
    """Bodies of these kinds on random ways; some have links, one lacks samples."""
    dice, t = np.random.default_rng(seed), np.arange(samples) * 0.2
    bodies, signals = [], {}
    for number, kind in enumerate(kinds):
        links = ("front", "back") if dice.random() < 0.3 else ()
        body = Body(f"body_{number}", kind, float(dice.uniform(0, 0.5)), links)
        bodies.append(body)
        for point in (body.id, *(f"{body.id}::{link}" for link in links)):
            way = dice.uniform(-2, 2, 3) + np.cumsum(dice.normal(scale=0.1, size=(samples, 3)), axis=0)
            kept = slice(None) if dice.random() < 0.8 else slice(0, samples // 2)
            signals[f"position/{point}"] = Signal(f"position/{point}", "m", t[kept], way[kept])
    return Trial("t", bodies=tuple(bodies), signals=signals, recorded=Span(0.0, float(t[-1])))


def renamed(trial: Trial, names: dict[str, str]) -> Trial:
    return replace(trial, bodies=tuple(replace(body, kind=names[body.kind]) for body in trial.bodies))


@pytest.mark.slow
@settings(max_examples=40, derandomize=True, deadline=None)
@given(
    st.lists(st.sampled_from(["robot", "human", "cart"]), min_size=2, max_size=6),
    st.sampled_from([("robot", "human"), ("human", "robot"), ("robot", "robot"), ("cart", "human")]),
    st.integers(0, 2**32 - 1),
    st.integers(4, 30),
)
def test_other_names_of_kinds_in_trial_and_monitor_give_the_same_findings(
    kinds: list[str], asked: tuple[str, str], seed: int, samples: int
) -> None:
    names = {"robot": "vehicle", "human": "pedestrian", "cart": "drone"}
    trial = recorded(kinds, seed, samples)

    before = found(trial, near(*asked))
    after = found(renamed(trial, names), near(names[asked[0]], names[asked[1]]))

    if not list(trial.pairs(*asked)):  # nobody is there: the message alone names the kinds
        assert [one.verdict for one in before] == [one.verdict for one in after]
    else:
        assert before == after


@pytest.mark.slow
@pytest.mark.parametrize("asked", [("robot", "human"), ("human", "robot"), ("cart", "cart")])
def test_the_findings_compared_above_are_of_every_verdict(asked: tuple[str, str]) -> None:
    kinds = ["robot", "human", "human", "cart", "cart"]
    trials = [recorded(kinds, seed, 20) for seed in range(30)]
    verdicts = {one.verdict for trial in trials for one in found(trial, near(*asked))}

    assert verdicts >= {Verdict.VIOLATED, Verdict.SATISFIED, Verdict.INCONCLUSIVE}


def test_what_only_helps_is_derived_of_the_kinds_too() -> None:
    monitor, trial = near("cart", "boat"), recorded(["cart", "boat"], 1, 20)

    signals = with_derived(trial, list(monitor.needs()), Registry()).signals

    assert {"centre_distance_2d/body_0/body_1", "relative_speed/body_0/body_1"} <= signals.keys()


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("stl.formula", {"formula": "always (d >= 2)", "signals": {"d": "separation of body_0/body_1 in m"}}),
        (
            "rml.spec",
            {
                "spec": "ok matches {topic: 'apart', d: d} with d >= 2; Main = ok*;",
                "events": {"apart": {"d": "separation/body_0/body_1"}},
            },
        ),
        ("formula.always", {"holds": "d >= 2", "signals": {"d": "separation/{cart}/{boat}"}}),
    ],
)
@pytest.mark.parametrize(("apart_m", "verdict"), [(2.0, Verdict.SATISFIED), (1.9, Verdict.VIOLATED)])
def test_formulas_may_be_about_any_two_bodies(
    name: str, parameters: dict[str, Any], apart_m: float, verdict: Verdict
) -> None:
    t = np.arange(11) * 0.05
    places = {"body_0": [0.0, 0, 0], "body_1": [apart_m, 0, 0]}
    signals = {
        f"position/{one}": Signal(f"position/{one}", "m", t, np.tile(place, (11, 1)))
        for one, place in places.items()
    }
    both = (Body("body_0", "cart", 0.0), Body("body_1", "boat", 0.0))
    trial = Trial("t", bodies=both, signals=signals, recorded=Span(0.0, 0.5))
    monitor = Registry().find("ariac_score.monitors", name).build({**parameters, "max_gap_s": 0.1})

    (finding,) = found(trial, monitor)

    assert finding.verdict is verdict, finding.message


def test_a_bystander_of_another_kind_changes_nothing() -> None:
    trial = recorded(["robot", "human", "cart"], 7, 20)
    alone = replace(trial, bodies=trial.bodies[:2])

    assert found(trial, near("robot", "human")) == found(alone, near("robot", "human"))
