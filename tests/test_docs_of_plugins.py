"""The distribution that the page on plugins makes is installed, and each of its examples is used."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace

import pytest

from ariac_score import as_json, load_rule_set, score_trial
from ariac_score.checks.registry import Registry, package_sha256
from ariac_score.cli import main
from ariac_score.engine.facts import fact_schemas_of, refuse_other_facts
from ariac_score.errors import LogError
from ariac_score.ranking.evaluation import evaluation_program
from ariac_score.ranking.totals import total_named
from ariac_score.testing.doctor import ailments
from ariac_score.testing.inventory import ALL_GROUPS, brought
from ariac_score.trial.work import Item
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/what-a-plugin-may-bring.md").read_text(encoding="utf-8")
FILES = ("rules/ruleset.yaml", "rules/half.yaml", "maps/course.yaml", "maps/recording.yaml", "half.yaml")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(autouse=True)
def course(install: Callable[..., str]) -> Iterator[str]:
    """The distribution of the page, as an installer would put it there."""
    (toml,) = blocks("toml")
    points: dict[str, dict[str, str]] = {}
    for group, body in re.findall(r'\[project\.entry-points\."(.+)"\]\n((?:[^\[].*\n)+)', toml):
        points[group] = dict(re.findall(r'^"?([\w.]+)"? = "course_score:(.+)"$', body, re.MULTILINE))
    first, *others = points.items()
    yield install(
        "course-score",
        first[1],
        group=first[0],
        also=dict(others),
        source="\n\n".join(blocks("python")),
        files=dict(zip(FILES, blocks("yaml"), strict=True)),
    )
    package_sha256.cache_clear()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The car is thrown up by 0.25 m, then by 0.75 m."""
    path = tmp_path / "lap.course.csv"
    path.write_text("t_s,x,y,z\n0,0,0,0\n1,1,0,0.25\n2,2,0,0\n3,3,0,0.75\n4,4,0,0\nend\n", encoding="utf-8")
    return path


def test_the_page_has_an_example_of_every_group_or_names_it() -> None:
    (toml,) = blocks("toml")
    for group in ALL_GROUPS:
        assert f'"{group}"' in toml or f"`{group}`" in PAGE
    for name in FILES:
        assert f"`course_score/{name}`" in PAGE


@pytest.mark.slow
def test_everything_it_brings_is_sound(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [one for one in brought(Registry()) if one.plugin.distribution == "course-score"]

    assert ailments() == []
    assert len(rows) == 16
    assert main(["rules", "validate", "course", "course.half"]) == 0


@pytest.mark.parametrize(("rules", "score"), [("course", 10 - 2), ("course.half", 10 / 2)])
def test_a_table_of_the_course_is_scored_by_name(log: Path, rules: str, score: float) -> None:
    result = score_trial(log, rules)

    assert result.score == Decimal(str(score))
    (finding,) = result.measured.of("low").values()
    assert finding.robustness == pytest.approx(0.5 - 0.75)
    code = {(one.distribution, one.version) for one in result.provenance.code}
    assert ("course-score", "1.0") in code


def test_its_result_has_the_panel_and_the_format(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = tmp_path / "r.json"
    result = score_trial(log, "course")
    stored.write_text(as_json(result), encoding="utf-8")
    (finding,) = result.measured.of("low").values()

    assert main(["report", str(stored), "-o", "-"]) == 0
    assert f"<ul><li><bdi>{finding.message}</bdi></li></ul>" in capsys.readouterr().out
    assert main(["export", str(stored), "--output-format", "course_tex"]) == 0
    assert capsys.readouterr().out == "\\newcommand{\\score}{8.000000}\n"
    assert main(["verify", str(stored), "--log", str(log)]) == 0


@pytest.mark.slow
def test_its_reader_keeps_the_contract(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "check", "course_csv", "--trial", str(log)]) == 0
    assert "BROKEN" not in capsys.readouterr().out


def test_its_decoder_policy_evaluation_and_command_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    decoder = Registry().find("ariac_score.decoders", "course.flags").build({})
    assert decoder.decode("std_msgs/msg/String", SimpleNamespace(data="yellow"), 1.0).kind == "yellow_flag"
    assert total_named("best_two").execution([Decimal(1), Decimal(5), Decimal(2)]) == 7
    for team in ("beta", "alpha"):
        (tmp_path / "logs" / team).mkdir(parents=True)
    jury = evaluation_program("course.jury")
    assert jury.results_csv(jury.evaluate(tmp_path / "logs", {})) == "alpha,2\nbeta,1\n"
    assert main(["bumps"]) == 0
    assert capsys.readouterr().out == "one bump\n"


def test_its_schemas_refuse_other_facts() -> None:
    found = fact_schemas_of("course", Registry())
    assert found is not None
    lap = Item("lap_1", "lap", {"length_m": 400.0})
    trial = replace(kitting_trial(), work=(lap,), facts={"weather": "dry"})

    refuse_other_facts(trial, found[1], by=found[0], file="lap")
    with pytest.raises(LogError, match="'snow' is not allowed here"):
        refuse_other_facts(replace(trial, facts={"weather": "snow"}), found[1], by=found[0], file="lap")


@pytest.mark.slow
def test_its_rule_set_says_where_it_lies_and_json_lists_it(
    course: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert course in load_rule_set("course").file
    assert main(["plugins", "list", "--output-format", "json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {"course", "course.half"} <= {row["name"] for row in rows if row["kind"] == "rule_sets"}


@pytest.mark.slow
def test_its_monitor_keeps_the_contract_on_a_log_that_lacks_what_it_needs(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The height is derived by the distribution itself, as when a trial is scored."""
    code = main(["plugins", "check", "course.low", "--trial", str(log), "--log-map", "course"])

    out = capsys.readouterr().out
    assert "bump_height" not in out
    assert code == 0, out
    assert main(["plugins", "show", "course.low"]) == 0
    assert "`bump_height`" in capsys.readouterr().out
