"""Plugins of others, broken or rival: each stops only what uses it, and what took part is recorded."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ariac_score import ScoreError, as_json, load_rule_set, score_trial
from ariac_score.batch.address import basis_of
from ariac_score.checks.registry import package_sha256
from ariac_score.engine.prepared import prepare
from ariac_score.engine.provenance import code_of
from ariac_score.errors import PluginConflictError
from ariac_score.testing import write_trial_log
from ariac_score_ariac.testing import kitting_trial

Install = Callable[..., str]
RULES = "ariac2020.as_coded"
COMPETITIONS = "ariac_score.competitions"

NAMING = """
from ariac_score import LogDefect

class Cup:
    def defects(self, trial):
        return [LogDefect("unknown_product_type", "orders", 1, "no cup has it")]
"""
SILENT = """
class Cup:
    def defects(self, trial):
        return ()
"""


@pytest.fixture(autouse=True)
def _own_hashes() -> Iterator[None]:
    """Hashes of packages are remembered, and those of one test are not those of the next."""
    yield
    package_sha256.cache_clear()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_trial_log(tmp_path / "trial.jsonl", kitting_trial())


@pytest.mark.slow
@pytest.mark.parametrize(
    "source",
    ["raise RuntimeError('no licence')", SILENT.replace("return ()", "return 1 / 0"), "class Cup: ..."],
    ids=["import", "call", "contract"],
)
def test_a_broken_competition_of_others_costs_no_trial_its_score(
    install: Install, log: Path, source: str
) -> None:
    expected = as_json(score_trial(log, RULES))

    install("odd-cup", {"odd_cup": "Cup"}, source=source, group=COMPETITIONS)

    assert as_json(score_trial(log, RULES)) == expected


def test_a_broken_competition_stops_the_rules_it_comes_with(
    install: Install, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ariac_score_ariac.competition.unknown_products", lambda *_: 1 / 0)

    with pytest.raises(ScoreError, match=r"plugin ariac \(ariac-score .*\) raised ZeroDivisionError"):
        score_trial(log, RULES)


def test_a_competition_that_two_distributions_provide_is_refused_and_both_are_named(
    install: Install, log: Path
) -> None:
    install("foul-cup", {"ariac": "Cup"}, source=SILENT, group=COMPETITIONS)

    with pytest.raises(PluginConflictError, match=r"ariac-score .* and foul-cup 1\.0"):
        score_trial(log, RULES)


def test_a_competition_that_nobody_names_takes_no_part(install: Install, log: Path) -> None:
    install("fair-cup", {"fair_cup": "Cup"}, source=NAMING, group=COMPETITIONS)

    result = score_trial(log, RULES)

    assert "no cup has it" not in [defect.message for defect in result.measured.log_defects]
    assert {code.distribution for code in result.provenance.code} == {"ariac-score"}


def test_the_finder_of_kits_is_in_the_provenance(install: Install, log: Path, tmp_path: Path) -> None:
    source = "from ariac_score_ariac.kit_from_poses import KitsOfModels\nclass Finder(KitsOfModels): ..."
    install("fair-kits", {"fair.kits": "Finder"}, source=source, group="ariac_score.tracks")
    shipped = Path(load_rule_set(RULES).file).parents[1] / "ariac2020" / "log_map.yaml"
    text = shipped.read_text(encoding="utf-8").replace("use: ariac.models", "use: fair.kits")
    (tmp_path / "map.yaml").write_text(text, encoding="utf-8")

    found = {code.distribution for code in score_trial(log, RULES).provenance.code}
    own = {
        code.distribution
        for code in score_trial(log, RULES, log_map=str(tmp_path / "map.yaml")).provenance.code
    }

    assert (found, own) == ({"ariac-score"}, {"ariac-score", "fair-kits"})


SPILLS = """
from ariac_score import Event

class Spill:
    schema = {"type": "object"}

    def read(self, record, note):
        return Event(record["at_s"], "spill")
"""


def test_who_reads_a_kind_of_record_stands_in_the_result_of_a_log_that_has_one(
    install: Install, log: Path, tmp_path: Path
) -> None:
    install("tea-cup", {"spill": "Spill"}, source=SPILLS, group="ariac_score.record_kinds")
    other = tmp_path / "spilled.jsonl"
    *lines, _ = log.read_text(encoding="utf-8").splitlines()
    spill, end = '{"record": "spill", "at_s": 3.0}', f'{{"record": "end", "records": {len(lines) + 2}}}'
    other.write_text("\n".join([*lines, spill, end]), encoding="utf-8")

    without, spilled = (
        {code.distribution for code in score_trial(one, RULES).provenance.code} for one in (log, other)
    )

    assert (without, spilled) == ({"ariac-score"}, {"ariac-score", "tea-cup"})


@pytest.mark.parametrize("group", [COMPETITIONS, "ariac_score.tracks", "ariac_score.readers"])
def test_the_address_of_a_measurement_changes_with_the_code_of_what_may_take_part(
    install: Install, tmp_path: Path, group: str
) -> None:
    before = basis_of(prepare(RULES))
    module = install("fair-cup", {"fair_cup": "Cup"}, source=SILENT, group=group)
    installed = basis_of(prepare(RULES))
    (file,) = tmp_path.rglob(f"{module}.py")
    file.write_text(f"{SILENT}# changed\n", encoding="utf-8")
    package_sha256.cache_clear()

    assert len({before, installed, basis_of(prepare(RULES))}) == 3


@pytest.mark.parametrize("group", ["readers", "decoders", "tracks", "record_kinds", "competitions"])
def test_a_package_that_is_nowhere_stops_no_measurement(install: Install, tmp_path: Path, group: str) -> None:
    module = install("odd-rules", {"odd.one": "Odd"}, group=f"ariac_score.{group}")
    (file,) = tmp_path.rglob(f"{module}.py")
    file.unlink()
    importlib.invalidate_caches()

    assert {distribution for distribution, *_ in code_of(prepare(RULES))} == {"ariac-score"}


@pytest.mark.parametrize("year", range(2019, 2025))
def test_another_finder_of_kits_changes_nothing_for_shipped_rules(
    install: Install, tmp_path: Path, year: int
) -> None:
    source = "raise RuntimeError('nobody may load this')"
    install("odd-kits", {"odd.kits": "Finder"}, source=source, group="ariac_score.tracks")
    log = write_trial_log(tmp_path / "trial.jsonl", kitting_trial())

    result = score_trial(log, "ariac2020.as_coded", log_map=f"ariac{year}")

    assert json.loads(as_json(result))["score"] is not None
