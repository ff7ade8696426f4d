"""The monitor of docs/online.md is what the page says it is."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from ariac_score import Verdict
from ariac_score.testing import ContractCheck, contract_checks
from ariac_score_ariac.testing import made_trial

PAGE = (Path(__file__).parents[2] / "docs/online.md").read_text(encoding="utf-8")
TRIAL = made_trial()
SPEED = replace(TRIAL.signals["speed/agv1"], name="speed/gantry")
WITH_GANTRY = replace(TRIAL, signals={**TRIAL.signals, SPEED.name: SPEED})


def written() -> Any:
    """The classes of the page, in a module of their own."""
    (text,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    page = sys.modules["page_online"] = ModuleType("page_online")
    exec(compile(text, "docs/online.md", "exec"), vars(page))  # noqa: S102  # it is what a reader would run
    return page.GantryPace


@pytest.mark.parametrize("check", contract_checks(written()(), WITH_GANTRY))
def test_the_monitor_of_the_page_keeps_the_contract(check: ContractCheck) -> None:
    check()


def test_it_says_at_once_what_it_finds_in_the_end() -> None:
    watch = written()().begin()

    verdicts = [s for i in range(len(SPEED)) for s in watch.step([SPEED.sample(i)])]
    (found,) = watch.end(replace(WITH_GANTRY, signals={}))

    assert [s.verdict is Verdict.VIOLATED for s in verdicts] == [v > 0.5 for v in SPEED.values.tolist()]
    assert found.robustness == min(s.robustness for s in verdicts) == 0.5 - SPEED.values.max()
