"""Rule sets that change others, results priced again, and how two rule sets differ."""

from __future__ import annotations

import json
from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import as_json, load_result, load_rule_set, score_trial
from ariac_score.cli import main
from ariac_score.engine.price import reprice
from ariac_score.errors import RuleSetError
from ariac_score.scoring.ruleset import differences, expanded_yaml

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"
HEAD = "id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\n"


def _file(folder: Path, text: str, name: str = "mine.yaml") -> str:
    (folder / name).write_text(text)
    return str(folder / name)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "example.json"
    path.write_text(as_json(score_trial(EXAMPLE, "paper2020.published")), encoding="utf-8")
    return path


def test_a_rule_set_that_changes_nothing_scores_the_same(tmp_path: Path) -> None:
    assert score_trial(EXAMPLE, _file(tmp_path, HEAD)).score == Decimal("19.761677")


def test_a_changed_parameter_term_and_score_replace_those_of_the_base(tmp_path: Path) -> None:
    text = (
        HEAD
        + "parameters: {separation_weight: 1}\nterms: {order: {weight: 2}}\n"
        + "score: task - demerits\nround: 3\n"
    )

    # order totals 2 * 7 + 2 * 7; demerits 1 * (1 + 0.211047... / 5) = 1.042209...
    assert score_trial(EXAMPLE, _file(tmp_path, text)).score == Decimal("26.958")


def test_a_check_is_replaced_whole_and_notes_are_added(tmp_path: Path) -> None:
    text = (
        HEAD + "notes: [also this]\nrules:\n  part_pose: {use: kitting.pose, with: {max_distance_m: 0.04}}\n"
    )

    mine, base = load_rule_set(_file(tmp_path, text)), load_rule_set("paper2020.published")

    assert mine.checks["part_pose"].parameters == {"max_distance_m": 0.04}
    assert mine.notes == (*base.notes, "also this")
    # The part 31 mm away passes now: one pose point more, three times.
    assert score_trial(EXAMPLE, mine).measured.of("part_pose")["part_pose#5"].verdict.value == "satisfied"


def test_a_check_may_move_from_rules_to_monitors(tmp_path: Path) -> None:
    text = HEAD + "monitors:\n  order_time: {use: ariac.no_event, with: {kind: part_dropped}}\n"

    checks = load_rule_set(_file(tmp_path, text)).checks

    assert checks["order_time"].group == "ariac_score.monitors"


def test_the_hash_of_a_rule_set_covers_what_it_extends(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(Path(load_rule_set("paper2020.published").file).read_text())
    mine = _file(tmp_path, HEAD.replace("extends: paper2020.published", "extends: ./base.yaml"))
    before = load_rule_set(mine).sha256
    text = (tmp_path / "base.yaml").read_text()
    (tmp_path / "base.yaml").write_text(text + "# a comment changes nothing\n")
    assert load_rule_set(mine).sha256 == before
    (tmp_path / "base.yaml").write_text(text.replace("delta_m: 2.6", "delta_m: 2.7"))

    assert load_rule_set(mine).sha256 != before


def test_the_expanded_text_is_the_same_rule_set_without_extends(tmp_path: Path) -> None:
    mine = load_rule_set(_file(tmp_path, HEAD + "parameters: {separation_weight: 0.8}\n"))

    alone = load_rule_set(_file(tmp_path, expanded_yaml(mine), "alone.yaml"))

    assert "extends" not in alone.expanded
    assert list(differences(mine.expanded, alone.expanded)) == []
    assert score_trial(EXAMPLE, alone).score == score_trial(EXAMPLE, mine).score


@pytest.mark.parametrize(
    ("text", "cause", "hint"),
    [
        (
            HEAD.replace("paper2020.published", "paper2021"),
            "there is no rule set 'paper2021'",
            "did you mean 'paper2020'?",
        ),
        (
            HEAD.replace("paper2020.published", "./mine.yaml"),
            "extend each other in a circle",
            "one must stand alone",
        ),
        (HEAD.replace("extends", "extend"), "unknown key 'extend'", "did you mean 'extends'?"),
        ("id: mine\ntitle: Mine\nsource: a test\n", "is missing", "add"),
    ],
)
def test_what_cannot_be_extended_is_refused(tmp_path: Path, text: str, cause: str, hint: str) -> None:
    with pytest.raises(RuleSetError) as refused:
        load_rule_set(_file(tmp_path, text))

    assert cause in str(refused.value)
    assert "mine.yaml" in str(refused.value)
    assert hint in refused.value.hint


def test_a_misspelt_term_in_an_extension_is_found_at_once(tmp_path: Path) -> None:
    code = main(["rules", "validate", _file(tmp_path, HEAD + "score: task / (1 + demirits)\n")])

    assert code == 4


def test_pricing_again_gives_what_scoring_gives(stored: Path, tmp_path: Path) -> None:
    mine = load_rule_set(_file(tmp_path, HEAD + "parameters: {separation_weight: 0.8}\nround: 4\n"))

    again, fresh = reprice(load_result(stored), mine), score_trial(EXAMPLE, mine)

    assert as_json(again) == as_json(fresh)


def test_pricing_under_the_same_rules_gives_the_same_bytes(stored: Path) -> None:
    assert as_json(reprice(load_result(stored), load_rule_set("paper2020.published"))) == stored.read_text(
        encoding="utf-8"
    )


def test_a_check_that_was_measured_otherwise_cannot_be_priced(stored: Path, tmp_path: Path) -> None:
    text = HEAD + "monitors:\n  separation: {use: iso_ts_15066.ssm_separation, with: {delta_m: 1.0}}\n"

    with pytest.raises(RuleSetError, match=r"check 'separation' .* was not measured"):
        reprice(load_result(stored), load_rule_set(_file(tmp_path, text)))


def test_price_prints_the_old_score_beside_the_new_one(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = _file(tmp_path, HEAD + "score: task\n")

    assert main(["price", str(stored), "--rules", mine]) == 0

    out, err = capsys.readouterr()
    assert out.startswith("28 of 36 possible")
    assert err == "before, under paper2020.published: 19.761677\n"


def test_diff_says_what_differs_and_whose_score_would_change(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = _file(tmp_path, HEAD + "score: task\n")
    (stored.parent / "broken.json").write_text("{}")

    assert main(["rules", "diff", "paper2020.published", mine, "--results", str(stored.parent)]) == 0

    out = capsys.readouterr().out
    assert "$.score\n  - gate(human_contact) * task / (1 + demerits)\n  + task\n" in out
    assert "example.json: 19.761677 -> 28" in out
    assert "broken.json: cannot be priced" in out
    (stored.parent / "broken.json").unlink()


def test_diff_of_a_rule_set_with_itself_is_empty(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "diff", "paper2020.published", "paper2020.published"]) == 0
    assert capsys.readouterr().out == ""


def test_of_a_list_only_what_one_of_the_two_has_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "id: ours\ntitle: Ours\nsource: us\nextends: paper2020.published\nnotes: [{0}]\n"
    for name, notes in (("a", "both, first alone"), ("b", "both, second alone"), ("c", "first alone, both")):
        (tmp_path / f"{name}.yaml").write_text(text.format(notes), encoding="utf-8")
    a, b, c = (str(tmp_path / f"{name}.yaml") for name in "abc")

    assert main(["rules", "diff", a, b]) == 0
    assert capsys.readouterr().out == "$.notes\n  - first alone\n  + second alone\n"
    assert main(["rules", "diff", a, c]) == 0
    assert 'first alone", "both' in capsys.readouterr().out  # the order alone differs: told whole


def test_what_only_one_of_the_two_has_stands_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "diff", "ariac2017.as_coded", "ariac2018.as_coded"]) == 0
    assert "None" not in capsys.readouterr().out


def test_diff_over_a_folder_without_results_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["rules", "diff", "paper2020.published", "paper2020.published", "--results", str(tmp_path)]) == 4
    )
    assert "no stored result" in capsys.readouterr().err


def test_a_result_that_was_open_can_be_priced_under_a_rule_set_with_a_policy(tmp_path: Path) -> None:
    from ariac_score.testing import write_trial_log  # noqa: PLC0415  # only this test makes a log
    from ariac_score_ariac.testing import kitting_trial  # noqa: PLC0415

    log = write_trial_log(tmp_path / "t.jsonl", kitting_trial(human=False), signals=["speed/robot"])
    unseen = score_trial(log, "paper2020.published")
    text = HEAD + (
        "monitors:\n"
        "  separation: {use: iso_ts_15066.ssm_separation, on_inconclusive: exclude,"
        " with: {profile: seed, t1_s: 1.0, t2_s: 1.5, stopping_distance_m: 0.0, delta_m: 2.6}}\n"
        "  human_contact: {use: ariac.human_contact, on_inconclusive: exclude,"
        " with: {distance: centre_distance, contact_distance_m: 0.5}}\n"
    )

    again = reprice(unseen, load_rule_set(_file(tmp_path, text)))

    # Without a human nobody knows whether he was touched, which would take everything.
    assert unseen.interval is not None
    assert (unseen.score, unseen.interval.least, unseen.interval.most) == (0, 0, 28)
    assert (again.score, again.interval) == (Decimal(28), None)
    assert {a.policy for a in again.assumptions} == {"exclude"}
    assert json.loads(as_json(again))["status"] == "scored"


def test_diff_names_what_needs_the_logs_and_scores_them(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Five metres less to keep: the robot was never too near, and 28 points are left.
    near = (
        "monitors: {separation: {use: iso_ts_15066.ssm_separation,"
        " with: {profile: seed, t1_s: 0.1, t2_s: 0.1, stopping_distance_m: 0.0, delta_m: 0.1}}}\n"
    )
    mine = _file(tmp_path, HEAD + near)

    assert main(["rules", "diff", "paper2020.published", mine, "--results", str(stored)]) == 0
    *_, needs, remedy = capsys.readouterr().out.splitlines()
    assert needs == "example.json: needs its log: separation of mine (other parameters)"
    assert remedy == "score them under both: --logs PATH instead of --results"

    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/run.mcap").symlink_to(EXAMPLE)
    (tmp_path / "logs/notes.txt").write_text("no log")
    for logs in (EXAMPLE, tmp_path / "logs/run.mcap", tmp_path / "logs"):
        assert main(["rules", "diff", "paper2020.published", mine, "--logs", str(logs)]) == 0
        assert capsys.readouterr().out.splitlines()[-1].endswith(".mcap: 19.761677 -> 28")


def test_diff_over_logs_that_are_none_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            ["rules", "diff", "paper2020.published", "paper2020.published", "--logs", str(tmp_path / "none")]
        )
        == 5
    )
    assert "no such file" in capsys.readouterr().err
    with pytest.raises(SystemExit):  # which of both would count?
        main(
            [
                "rules",
                "diff",
                "paper2020.published",
                "paper2020.published",
                "--logs",
                str(EXAMPLE),
                "--results",
                str(tmp_path),
            ]
        )
