"""Every number of docs/ledger.md is computed here."""

from __future__ import annotations

import re
from decimal import Decimal
from pathlib import Path

import pytest

from .attributed import Case, times

PAGE = Path(__file__).parents[2] / "docs/ledger.md"
_LINE = re.compile(r"^(.+?) {2,}(-?[\d.]+)(?: +by the rule (-?[\d.]+))?$")


def blocks() -> list[str]:
    return re.findall(r"```ledger\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_every_example_of_the_page_is_what_the_ledger_says(subtests: pytest.Subtests) -> None:
    assert len(blocks()) >= 7
    for block in blocks():
        score, violations, *lines = block.strip().splitlines()
        formula = score.removeprefix("score: ")
        with subtests.test(formula):
            found = []
            for one in violations.removeprefix("violations: ").split(", "):
                check, count = one.split()
                found += times(check, int(count))
            ledger = Case(formula, found).ledger
            told = {(line.findings or (line.label,))[0]: line for line in ledger.walk()}
            for line in lines:
                match = _LINE.match(line)
                assert match is not None, line
                name, amount, nominal = match.groups()
                assert told[name].amount == Decimal(amount), line
                assert told[name].nominal == (None if nominal is None else Decimal(nominal)), line
