"""Who may say what: nothing that a team leaves out, or writes itself, raises what counts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from ariac_score import ContradictionError, Result, ScoreError, load_rule_set, reprice, score_trial
from ariac_score.cli import main
from ariac_score.errors import RuleSetError
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.runs import score_runs
from ariac_score.scoring.ruleset import expanded_yaml, rule_set_from_text
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

Records = list[dict[str, Any]]
HONEST = Decimal("19.761677")
"""The example: 28 points, over 1 + 0.4 demerits for one near miss; tests/golden/near_miss_jsonl.txt."""


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Records:
    file = tmp_path_factory.mktemp("honest") / "run.jsonl"
    write_trial_log(file, kitting_trial(), signals=SNAPSHOT_SIGNALS)
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def log_of(records: Records, file: Path) -> Path:
    kept = [record for record in records if record["record"] != "end"]
    kept.append({"record": "end", "records": len(kept) + 1})
    file.write_text("".join(json.dumps(record) + "\n" for record in kept), encoding="utf-8")
    return file


def without(records: Records, record: str, **fields: Any) -> Records:
    return [r for r in records if r["record"] != record or any(r.get(k) != v for k, v in fields.items())]


def event(t_s: float, kind: str) -> dict[str, Any]:
    return {"record": "event", "t_s": t_s, "kind": kind, "subject": "", "detail": ""}


def at(records: Records, new: dict[str, Any]) -> Records:
    """The records with another one in its place in time."""
    place = next(i for i, r in enumerate(records) if r.get("t_s", -1.0) > new["t_s"])
    return [*records[:place], new, *records[place:]]


def ended_early(records: Records) -> Records:
    """The competition ends at 25 s, and the second kit, at 31 s, comes too late."""
    return at(without(records, "event", kind="competition_ended"), event(25.0, "competition_ended"))


@dataclass(frozen=True)
class Attack:
    """What a team leaves out of an honest log, and what it had brought before (`was`)."""

    name: str
    honest: Callable[[Records], Records]
    attacked: Callable[[Records], Records]
    score: str
    was: str


ATTACKS = (
    Attack(
        "start and end of the competition",
        ended_early,
        lambda r: without(without(r, "event", kind="competition_started"), "event", kind="competition_ended"),
        score="4.940419",
        was="19.761677",
    ),
    Attack(
        "the end alone",
        ended_early,
        lambda r: without(r, "event", kind="competition_ended"),
        score="4.940419",
        was="withheld",
    ),
    Attack(
        "all after the first kit, with the collision in it",
        lambda r: at(r, event(36.0, "arm_collision")),
        lambda r: [one for one in r if one.get("t_s", 0.0) <= 35.0],
        score="0",
        was="withheld",
    ),
)


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_what_is_left_out_does_not_raise_the_score_that_counts(
    records: Records, tmp_path: Path, attack: Attack
) -> None:
    honest = attack.honest(records)
    assert score_trial(log_of(honest, tmp_path / "honest.jsonl"), "paper2020.published").score == Decimal(
        attack.score
    )

    found = score_trial(log_of(attack.attacked(honest), tmp_path / "attacked.jsonl"), "paper2020.published")

    assert found.is_open
    assert (found.score or 0) <= Decimal(attack.score)
    window = next(s for s in found.measured.statements if s.fact == "window")
    assert (window.by, "of the competition" in window.detail) == ("nobody", True)


def test_what_happens_outside_the_competition_costs_nothing(records: Records, tmp_path: Path) -> None:
    outside = at(at(records, event(0.2, "arm_collision")), event(39.0, "arm_collision"))

    assert score_trial(log_of(outside, tmp_path / "run.jsonl"), "paper2020.published").score == HONEST


def test_rules_may_take_the_recording_for_the_competition(records: Records, tmp_path: Path) -> None:
    bare = [r for r in records if not r.get("kind", "").startswith("competition_")]
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "extends: paper2020.published\nid: ours\ntitle: Ours\nsource: here\nwindow: recording\n", "utf-8"
    )

    found = score_trial(log_of(bare, tmp_path / "run.jsonl"), rules)

    assert (found.score, found.is_open) == (HONEST, False)
    (window,) = (s for s in found.measured.statements if s.fact == "window")
    assert (window.by, window.detail) == ("rules", "the whole recording")


# Orders --------------------------------------------------------------------------------

HEAD = """\
orders:
  order_0:
    shipment_count: 1
    products:
      part_0: {type: gear_part_red, pose: {xyz: [0.1, 0.15, 0.0], rpy: [0, 0, 0]}}
      part_1: {type: %s, pose: {xyz: [-0.1, 0.15, 0.0], rpy: [0, 0, 0.7853981633974483]}}
      part_2: {type: piston_rod_part_green, pose: {xyz: [0.0, -0.15, 0.0], rpy: [0, 0, 0]}}
    destinations: [agv1]
  order_1:
    shipment_count: 1
    priority: 1
    products:
      part_0: {type: pulley_part_red, pose: {xyz: [0.12, 0.1, 0.0], rpy: [0, 0, 0]}}
      part_1: {type: disk_part_blue, pose: {xyz: [-0.12, -0.1, 0.0], rpy: [0, 0, -1.5707963267948966]}}
    destinations: [agv2]
"""
ORGANISERS = HEAD % "gear_part_blue"
EASIER = HEAD % "gear_part_green"
"""Asks for what the team delivered."""


def without_orders(records: Records) -> Records:
    return without(records, "order")


def easier_orders(records: Records) -> Records:
    text = json.dumps(without([r for r in records if r["record"] == "order"], "sample"))
    easier = json.loads(text.replace("gear_part_blue", "gear_part_green"))
    return [easier.pop(0) if r["record"] == "order" else r for r in records]


@dataclass(frozen=True)
class Season:
    """A competition of one run: what the organiser gives, what lies with the run, and the score."""

    organisers: str
    brought: str
    log: Callable[[Records], Records]
    score: str
    authority: str = ""


def season(records: Records, folder: Path, case: Season) -> Result | ScoreError:
    run = folder / "logs/team/trial_1"
    run.mkdir(parents=True)
    log_of(case.log(records), run / "run.jsonl")
    configs = "trial_configs: trials/{trial}.yaml\n" if case.organisers else ""
    if case.organisers:
        (folder / "trials").mkdir()
        (folder / "trials/trial.yaml").write_text(case.organisers, encoding="utf-8")
    if case.brought:
        (run / "trial.yaml").write_text(case.brought, encoding="utf-8")
    head = "id: season\nrules: paper2020.published\nruns: logs/{team}/{trial}_{run}\n"
    (folder / "competition.yaml").write_text(head + configs + case.authority, encoding="utf-8")
    competition = load_competition(folder)
    (result,) = score_runs(competition, load_rule_set(competition.rules)).values()
    return result


def same(records: Records) -> Records:
    return records


SEASONS = {
    "the organiser's orders count": Season(ORGANISERS, "", without_orders, "19.761677"),
    "the run may repeat them": Season(ORGANISERS, ORGANISERS, without_orders, "19.761677"),
    "the log announces them": Season(ORGANISERS, "", same, "19.761677"),
    "nobody but the log says": Season("", "", same, "19.761677"),
    "the run brings others (was 23.290548)": Season(ORGANISERS, EASIER, without_orders, "gear_part_blue"),
    "the log announces others (was 23.290548)": Season(ORGANISERS, "", easier_orders, "gear_part_green"),
    "only the run says": Season("", EASIER, without_orders, "no order was found"),
    "the competition lets the run say": Season(
        "", ORGANISERS, without_orders, "19.761677", "authority: {work: run}\n"
    ),
}


@pytest.mark.parametrize("case", SEASONS.values(), ids=SEASONS)
def test_orders_are_the_organisers(records: Records, tmp_path: Path, case: Season) -> None:
    found = season(records, tmp_path, case)

    said = str(found.score) if isinstance(found, Result) else str(found)
    assert case.score in said
    if isinstance(found, ContradictionError):  # both sources, the fact, and what each says
        for words in (
            "'trials/trial.yaml' (organiser) says",
            "(r",
            "order_0",
            "gear_part_blue",
            "gear_part_green",
        ):
            assert words in said


@pytest.mark.slow
def test_through_every_door_both_files_are_named(
    records: Records, tmp_path: Path, capsys: pytest.CaptureFixture[str], subtests: pytest.Subtests
) -> None:
    """`rank`, `batch` and `score` by command; Codabench and EvalAI have theirs in tests/platforms."""
    found = season(records, tmp_path, SEASONS["the run brings others (was 23.290548)"])
    assert isinstance(found, ContradictionError)
    run, given = tmp_path / "logs/team/trial_1", tmp_path / "trials/trial.yaml"
    doors = {
        "score": ["score", str(run), "--rules", "paper2020.published", "--trial-config", str(given)],
        "rank": ["rank", str(tmp_path)],
        "batch": ["batch", str(tmp_path), "-o", str(tmp_path / "results"), "-j", "1"],
    }
    for name, arguments in doors.items():
        with subtests.test(name):
            main(arguments)
            said = "".join(capsys.readouterr())
            assert "trial.yaml' (organiser) says 'gear_part_blue'" in said
            assert "trial.yaml' (run) says 'gear_part_green'" in said
            assert "23.290548" not in said


def test_whoever_scores_his_own_folder_needs_one_command_and_sees_whose_orders_they_are(
    records: Records, tmp_path: Path
) -> None:
    log_of(without_orders(records), tmp_path / "run.jsonl")
    (tmp_path / "trial.yaml").write_text(ORGANISERS, encoding="utf-8")
    found = score_trial(tmp_path, "paper2020.published")

    assert found.score == HONEST
    (work,) = (s for s in found.measured.statements if s.fact == "work")
    assert (work.by, work.source) == ("run", ("trial.yaml",))

    easier = tmp_path.parent / f"{tmp_path.name}.yaml"
    easier.write_text(EASIER, encoding="utf-8")
    with pytest.raises(ContradictionError, match="gear_part_green"):
        score_trial(tmp_path, "paper2020.published", also=[easier])


def test_a_result_is_not_priced_again_on_a_word_that_the_rules_do_not_take(
    records: Records, tmp_path: Path
) -> None:
    bare = [r for r in records if not r.get("kind", "").startswith("competition_")]
    rules = load_rule_set("paper2020.published")
    recording, attested, believed = (
        rule_set_from_text(f"{expanded_yaml(rules)}\nwindow: recording\n{more}\n", file="ours.yaml")
        for more in ("", "completeness: attested", "completeness: believed")
    )
    found = score_trial(log_of(bare, tmp_path / "run.jsonl"), recording)

    assert reprice(found, recording).score == HONEST
    assert reprice(found, believed).score == HONEST  # rules that believe ask nothing of a log
    with pytest.raises(RuleSetError, match="takes the whole recording for the competition"):
        reprice(found, rules)
    with pytest.raises(RuleSetError, match="ask for an attested log, and that of the result is not"):
        reprice(found, attested)
