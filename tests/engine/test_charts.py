"""What a monitor shows of what it judged: asked like its findings, and refused when it is broken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from ariac_score import Chart, Charting, Finding, SignalNeed, Trial, load_rule_set
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.engine.ask import charts_of, margins_of
from ariac_score.errors import PluginError
from ariac_score.testing import NEAR_MISS
from ariac_score_ariac.testing import kitting_trial

TRIAL = kitting_trial()
RULES = load_rule_set("paper2020.published")
REGISTRY = Registry()
PLUGIN: Plugin = REGISTRY.find("ariac_score.monitors", "iso_ts_15066.ssm_separation")


@dataclass
class Showing:
    """A monitor that shows whatever it was made with."""

    show: Callable[[Trial], Iterable[Any]]

    def needs(self) -> Iterator[SignalNeed]:
        return iter(())

    def watch(self, _trial: Trial) -> Iterator[Finding]:
        yield Finding.satisfied("trial", "fine")

    def charts(self, trial: Trial) -> Iterable[Any]:
        return self.show(trial)

    def margins(self, trial: Trial) -> Iterable[Any]:
        return self.show(trial)


def _raise(_trial: Trial) -> Iterator[Chart]:
    raise RuntimeError("out of ink")


def _break_in(trial: Trial) -> Iterator[Chart]:
    object.__setattr__(trial, "events", ())
    return iter(())


@pytest.mark.parametrize(
    ("show", "words"),
    [
        (_raise, "raised RuntimeError when it gave its charts: out of ink"),
        (lambda _trial: None, "raised TypeError when it gave its charts"),
        (lambda _trial: ["a line"], "shows a str instead of a Chart"),
        (_break_in, "changed the trial it was given"),
    ],
)
@pytest.mark.parametrize("asked", [charts_of, margins_of])
def test_a_monitor_that_cannot_show_what_it_saw_is_named(asked: Any, show: Any, words: str) -> None:
    with pytest.raises(PluginError, match=words):
        asked(PLUGIN, "separation", Showing(show), TRIAL)


def test_a_signal_that_is_missing_leaves_nothing_to_draw() -> None:
    showing = Showing(lambda trial: [trial.signal("nothing/robot", unit="m")])

    assert charts_of(PLUGIN, "separation", showing, TRIAL) == []
    assert margins_of(PLUGIN, "separation", showing, TRIAL) == []


def test_a_check_that_shows_nothing_is_not_asked() -> None:
    assert charts_of(PLUGIN, "part_type", RULES.build(REGISTRY)["part_type"], TRIAL) == []


def test_the_separation_monitor_shows_the_distance_it_judges_and_the_one_it_asks_for() -> None:
    check = RULES.build(REGISTRY)["separation"]
    assert isinstance(check, Charting)

    (chart,) = charts_of(PLUGIN, "separation", check, TRIAL)

    window = TRIAL.window
    assert window is not None
    assert (chart.t[0], chart.t[-1]) == (window.start_s, window.end_s)
    assert chart.actual.min() == pytest.approx(NEAR_MISS.closest_m, abs=0.005)
    # By hand: 0.943 m/s (1.0 s + 1.5 s) + 0.5 m/s 1.0 s + 2.6 m while nearing.
    assert chart.limit.max() == pytest.approx(NEAR_MISS.required_m)
    assert int((chart.actual < chart.limit).sum()) == 240  # 2.4 s at 100 Hz


def test_a_monitor_without_pairs_shows_nothing() -> None:
    check = RULES.build(REGISTRY)["separation"]

    assert charts_of(PLUGIN, "separation", check, Trial("empty")) == []


def test_where_the_robot_may_come_near_because_it_stands_no_distance_is_required() -> None:
    from ariac_score_standards import SsmSeparation  # noqa: PLC0415  # a plugin, as strangers see it

    check = SsmSeparation(profile="standard", distance="centre_distance", speeds="scalar")
    still = {**TRIAL.signals}
    speed = still["speed/robot"]
    still["speed/robot"] = replace(speed, values=np.zeros(len(speed)))

    (chart,) = check.charts(replace(TRIAL, signals=still))

    assert np.isnan(chart.limit).all()
