"""Parameters that name a file: its text is part of the rule set, wherever that is used."""

from __future__ import annotations

import hashlib
from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import Verdict, as_json, load_result, load_rule_set, score_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.price import reprice
from ariac_score.errors import RuleSetError
from ariac_score.scoring.extending import MAX_TEXT_BYTES
from ariac_score.scoring.ruleset import expanded_yaml

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"
FOUR = ROOT / "examples/rml/four_formalisms.yaml"
SPEC = (ROOT / "examples/rml/separation.rml").read_text(encoding="utf-8")
RULES = """\
id: mine
title: Mine
source: a test
extends: paper2020.published
monitors:
  separation:
    use: rml.spec
    with:
      spec: {spec}
      events:
        snapshot:
          human_operator_speed: speed/{{human}}
          robot_speed: speed/{{robot}}
          distance_robot_human_operator: centre_distance/{{robot}}/{{human}}
"""


def rules(folder: Path, spec: str = "separation.rml", text: str | bytes = SPEC) -> Path:
    folder.mkdir(exist_ok=True)
    raw = text if isinstance(text, bytes) else text.encode()
    (folder / "separation.rml").write_bytes(raw)
    path = folder / "mine.yaml"
    path.write_text(RULES.format(spec=spec), encoding="utf-8")
    return path


def test_four_formalisms_price_one_approach() -> None:
    """The human comes as near as 4.5 m, at 0.8 m/s; the robot keeps 0.5 m/s all the time.

    So it is nearer than 5 m for 1.26 s, nearer than 4.7 m for 0.5 s, and nearer than
    4.77 m to 5.4 m, which RML asks for, as long as the built-in monitor says: 18.81 s to 21.21 s.
    """
    result = score_trial(EXAMPLE, load_rule_set(str(FOUR)))

    uses = {name: check["use"] for name, check in result.checks.items()}
    assert [uses[n] for n in ("separation", "slows_down_in_time", "gentle_nearby", "human_contact")] == [
        "rml.spec",
        "stl.formula",
        "formula.never",
        "ariac.human_contact",
    ]
    durations_s = {
        name: [round(f.span.duration_s, 6) for f in result.measured.of(name).values() if f.span]
        for name in ("separation", "slows_down_in_time", "gentle_nearby")
    }
    assert durations_s == {"separation": [2.4], "slows_down_in_time": [1.26], "gentle_nearby": [0.5]}
    (contact,) = result.measured.of("human_contact").values()
    assert contact.verdict is Verdict.SATISFIED
    assert result.score is not None
    # paper2020.published gives 19.761677 = 28 / (1 + demerits). A violation without a depth counts 1; one
    # of a formula of truth is broken wholly, for 0.5 s out of tau_s = 5 s.
    assert float(result.score) == pytest.approx(28 / (28 / 19.761677 + 0.1 * (1 + 1.1)), abs=1e-5)


def test_a_file_is_looked_for_beside_the_rule_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = rules(tmp_path / "rules")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")

    for given in (path, Path("../rules/mine.yaml")):
        assert load_rule_set(str(given)).checks["separation"].parameters["spec"] == SPEC
    assert score_trial(EXAMPLE, load_rule_set(str(path))).score == Decimal("19.761677")


def test_a_rule_set_elsewhere_may_extend_it(tmp_path: Path) -> None:
    rules(tmp_path / "rules")
    child = tmp_path / "child.yaml"
    child.write_text("id: child\ntitle: C\nsource: a test\nextends: rules/mine.yaml\n", encoding="utf-8")

    assert load_rule_set(str(child)).checks["separation"].parameters["spec"] == SPEC


def test_the_text_is_part_of_the_hash_and_its_path_is_not(tmp_path: Path) -> None:
    first = load_rule_set(str(rules(tmp_path / "a")))
    again = load_rule_set(str(rules(tmp_path / "b")))
    other = load_rule_set(str(rules(tmp_path / "c", text=SPEC + "// changed\n")))

    assert first.sha256 == again.sha256 != other.sha256
    assert first.expanded == again.expanded


def test_a_result_holds_the_text_and_is_priced_again_without_the_file(tmp_path: Path) -> None:
    path = rules(tmp_path / "rules")
    text = as_json(score_trial(EXAMPLE, load_rule_set(str(path))))
    assert as_json(score_trial(EXAMPLE, load_rule_set(str(path)))) == text
    stored = tmp_path / "result.json"
    stored.write_text(text, encoding="utf-8")
    rule_set = load_rule_set(str(path))
    (tmp_path / "rules/separation.rml").unlink()

    result = load_result(stored)

    assert "Main = snapshot >> safe*" in result.rules
    assert reprice(result, rule_set).score == result.score
    (finding,) = result.measured.of("separation").values()
    assert finding.labels["spec_sha256"] == hashlib.sha256(SPEC.encode()).hexdigest()
    assert str(tmp_path) not in text


def test_a_text_given_as_text_is_not_a_file(tmp_path: Path) -> None:
    path = rules(tmp_path, spec='"Main = any*; // as in separation.rml"')

    assert load_rule_set(str(path)).checks["separation"].parameters["spec"].startswith("Main")


@pytest.mark.parametrize(
    ("spec", "text", "cause"),
    [
        ("nowhere.rml", SPEC, "no such file"),
        ("separation.rml", b"// \xff", "not UTF-8"),
        ("separation.rml", "/" * (MAX_TEXT_BYTES + 1), "more than the 1,000,000 allowed"),
        ("'a\\0.rml'", SPEC, "no such file"),
    ],
    ids=range(4),
)
def test_a_file_that_cannot_be_read_is_refused_with_its_place(
    tmp_path: Path, spec: str, text: str | bytes, cause: str
) -> None:
    path = rules(tmp_path, spec=spec, text=text)

    with pytest.raises(RuleSetError, match=cause) as refused:
        load_rule_set(str(path))

    assert refused.value.file == str(path)
    assert refused.value.place == "line 9, $.monitors.separation.with.spec"
    assert "relative to the folder of the rule set" in refused.value.hint


def test_a_specification_of_a_file_that_is_refused_says_where(tmp_path: Path) -> None:
    rule_set = load_rule_set(str(rules(tmp_path, text="Main = a\n")))

    with pytest.raises(RuleSetError, match="line 2, column 1: ';' was expected") as refused:
        rule_set.build(Registry())

    assert "$.monitors.separation" in refused.value.place


def test_the_expanded_rule_set_stands_alone(tmp_path: Path) -> None:
    rule_set = load_rule_set(str(rules(tmp_path)))
    alone = tmp_path / "alone.yaml"
    alone.write_text(expanded_yaml(rule_set), encoding="utf-8")
    (tmp_path / "separation.rml").unlink()

    assert load_rule_set(str(alone)).checks["separation"].parameters["spec"] == SPEC
