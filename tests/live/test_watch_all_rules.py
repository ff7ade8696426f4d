"""Watching comes to what scoring the recording comes to, under every shipped rule set."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import pytest

from ariac_score import as_json, score_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import ScoreError
from ariac_score.live.source import source_at
from ariac_score.live.watch import Settings, Watch
from ariac_score.scoring.extending import rule_set_names
from ariac_score.testing import write_bag
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

FEW = ("paper2020.published", "safety", "ariac2020.as_documented")
CABLE = "bag_trial_1_20260520_101112_345"
AIC = Path(__file__).parents[2] / "examples" / "aic" / "run" / CABLE / f"{CABLE}.mcap"
"""A recording that its competition reads in its own way, and knows by what is in it."""


def _watched(log: Path, rules: str, record: Path) -> str:
    settings = Settings(period_s=1e9, tail_period_s=1e9, apart=False)
    try:
        return as_json(
            Watch(source_at(f"replay:{log}?speed=0"), prepare(rules), record, settings=settings).run()
        )
    except ScoreError as error:
        return str(error.cause)


def _scored(log: Path, rules: str) -> str:
    try:
        return as_json(score_trial(log, rules))
    except ScoreError as error:
        return str(error.cause)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    return write_bag(folder / "trial.mcap", recorded_messages(kitting_trial()), storage="mcap")


def test_a_competition_may_know_its_recording_by_what_came(tmp_path: Path) -> None:
    watched = _watched(AIC, "aic2026.qualification", tmp_path / "seen.mcap")

    assert watched.startswith("{")
    assert watched == _scored(tmp_path / "seen.mcap", "aic2026.qualification")


def test_while_it_goes_on_it_is_said_that_its_score_comes_in_the_end(tmp_path: Path) -> None:
    said: list[str] = []
    settings = Settings(period_s=500, share=1.0, tail_period_s=1e9, apart=False)
    calls = count()
    Watch(
        source_at(f"replay:{AIC}?speed=0"),
        prepare("aic2026.qualification"),
        tmp_path / "seen.mcap",
        settings=settings,
        told=lambda state: said.append(state.open),
        now_s=lambda: float(next(calls)),  # judged every few hundred messages
    ).run()

    assert "its competition reads recordings in its own way: the score comes in the end" in said
    assert said[-1] == ""


@pytest.mark.parametrize("rules", FEW)
def test_a_watched_trial_is_worth_what_its_recording_is(rules: str, log: Path, tmp_path: Path) -> None:
    watched = _watched(log, rules, tmp_path / "seen.mcap")

    assert watched.startswith("{")
    assert watched == _scored(tmp_path / "seen.mcap", rules)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_so_it_is_under_every_shipped_rule_set(log: Path, tmp_path: Path, subtests: pytest.Subtests) -> None:
    """There is a result wherever the log that was watched has one; other rules say of both what they need."""
    results = 0
    people = write_bag(
        tmp_path / "people.mcap", recorded_messages(kitting_trial(), motion="human_state"), storage="mcap"
    )
    logs = {"aic2026": AIC, "ariac2023": people, "paper2020.human_state": people}
    for number, name in enumerate(rule_set_names()):
        with subtests.test(name):
            record = tmp_path / f"{number}.mcap"
            suits = next((one for prefix, one in logs.items() if name.startswith(prefix)), log)
            watched = _watched(suits, name, record)
            results += watched.startswith("{")
            assert watched == _scored(record, name)
            if not watched.startswith("{"):
                assert not _scored(suits, name).startswith("{")
    assert results
