"""What monitors of strangers do while their margins are collected: every failure names the plugin."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Finding, SignalNeed, Trial, load_rule_set, score_trial
from ariac_score.checks.registry import Plugin
from ariac_score.engine.prepared import PreparedCheck, prepare
from ariac_score.errors import PluginError
from ariac_score.review.margins import tracks
from ariac_score_ariac.testing import kitting_trial

EXAMPLE = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"


@dataclass(frozen=True)
class Leaving:
    """An online monitor whose watch raises whatever it is given."""

    cause: type[BaseException]

    def needs(self) -> list[SignalNeed]:
        return [SignalNeed("position", "m")]

    def watch(self, trial: Trial) -> Iterator[Finding]:
        yield Finding.satisfied(trial.id, "kept")

    def begin(self, bodies: Sequence[Any] = ()) -> Any:
        raise self.cause(f"with {len(bodies)} bodies")


@pytest.mark.parametrize("cause", [RuntimeError, KeyError, SystemExit])
def test_a_monitor_that_gives_up_while_it_watches_is_named(cause: type[BaseException]) -> None:
    plugin = Plugin("stranger.leaving", "ariac_score.monitors", "x:Leaving", "stranger", "1.0")
    check = PreparedCheck("it", plugin, Leaving(cause), ())
    prepared = replace(prepare(load_rule_set("paper2020.published")), checks={"it": check})
    trial = kitting_trial()

    with pytest.raises(PluginError, match=rf"stranger\.leaving \(stranger 1\.0\) raised {cause.__name__}"):
        tracks(score_trial(EXAMPLE, "paper2020.published"), trial, prepared)
