"""The monitor of docs/online.md is what the page says it is."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Sample, Signal, Verdict
from ariac_score.testing import ContractCheck, contract_checks, made_trial

PAGE = (Path(__file__).parents[2] / "docs/online.md").read_text(encoding="utf-8")
TRIAL = made_trial()
SPEED = Signal("speed/gantry", "m/s", np.array([1.0, 1.04, 1.08]), np.array([0.5, 0.75, 0.25]))
WITH_GANTRY = replace(
    TRIAL, bodies=(*TRIAL.bodies, Body("gantry", "robot")), signals={**TRIAL.signals, SPEED.name: SPEED}
)


def written() -> Any:
    """The classes of the page, in a module of their own."""
    (text,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    page = sys.modules["page_online"] = ModuleType("page_online")
    exec(compile(text, "docs/online.md", "exec"), vars(page))  # it is what a reader would run
    return page.GantryPace


@pytest.mark.parametrize("check", contract_checks(written()(), WITH_GANTRY))
def test_the_monitor_of_the_page_keeps_the_contract(check: ContractCheck) -> None:
    check()


def test_it_says_at_once_what_it_finds_in_the_end() -> None:
    monitor = written()()
    watch = monitor.begin()

    said = [s for i in range(3) for s in watch.step([SPEED.sample(i)])]
    assert [(s.t_s, s.verdict) for s in said] == [
        (1.0, Verdict.SATISFIED),
        (1.04, Verdict.VIOLATED),
        (1.08, Verdict.SATISFIED),
    ]
    (found,) = watch.end(replace(WITH_GANTRY, signals={}))
    assert found.evidence == (Sample("speed/gantry", 1.04, 0.75, "m/s"),)
