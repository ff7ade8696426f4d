"""A score is the same whatever `decimal.getcontext()` says: that of a caller, or one that a plugin left."""

from __future__ import annotations

import decimal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from ariac_score import SignalNeed, Trial, load_rule_set, score_trial
from ariac_score.checks.findings import Finding
from ariac_score.report.exports.markdown import markdown_text
from ariac_score.report.html.trial import trial_page
from ariac_score.report.text import score_text
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json, load_result

from .attributed import Case, S, found

LOG = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
EXAMPLE = LOG.with_suffix(".result.json")


@pytest.fixture
def coarse() -> Iterator[None]:
    """A context of three digits that always rounds down, in which nearly all sums are wrong."""
    with decimal.localcontext() as context:
        context.prec, context.rounding = 3, decimal.ROUND_DOWN
        yield


@pytest.mark.usefixtures("coarse")
def test_a_ledger_is_the_same_in_a_context_of_three_digits() -> None:
    # 1000 - 2000 / 3 is 333.333333, half of which each of two takes; in three digits it would be 333.
    case = Case("1000 - measure(x, q)", [found("x", S, i, q=1000 / 3) for i in range(2)])
    ledger = case.ledger

    assert str(ledger.amount) == "333.333333"
    assert str(case.priced().possible) == "333.333333"
    assert [str(line.amount) for line in ledger.leaves][:1] == ["1000.000000"]


def shown(result: Result) -> list[str]:
    text = as_json(result)
    return [text, score_text(result), trial_page(result, text), markdown_text(result)]


@pytest.mark.usefixtures("coarse")
def test_a_stored_result_reads_and_shows_the_same_in_a_context_of_three_digits() -> None:
    here = shown(load_result(EXAMPLE))
    with decimal.localcontext(decimal.Context(prec=28, rounding=decimal.ROUND_HALF_EVEN)):
        assert here == shown(load_result(EXAMPLE))


@dataclass(frozen=True)
class Careless:
    """Sets the context for a sum of its own and leaves it so."""

    def needs(self) -> list[SignalNeed]:
        return []

    def watch(self, trial: Trial) -> list[Finding]:
        decimal.getcontext().prec = 3
        return [Finding.violated("trial", f"it happened in {trial.id}")]


def test_what_a_plugin_sets_ends_with_it() -> None:
    rules = load_rule_set("paper2020.published").with_monitor("careless", Careless)
    digits = decimal.getcontext().prec

    result = score_trial(LOG, rules.with_score("task - 2 / 3 * count(careless)"))

    assert str(result.score) == "27.333333"
    assert decimal.getcontext().prec == digits
