"""The situations of the golden tests: each makes its files in a folder and gives a command line.

What the command must print, and its exit code, is in `golden/<name>.txt`.
"""

from __future__ import annotations

import json
import math
import shutil
import sqlite3
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Event, Pose, Trial, load_result
from ariac_score.results.result_file import measured_sha256
from ariac_score.testing import SNAPSHOT_SIGNALS, Recorded, write_bag, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages
from ariac_score_ariac.work import KitSubmission, Product

Case = Callable[[Path], list[str]]
CASES: dict[str, Case] = {}
ROOT = Path(__file__).parents[1]


def case(make: Case) -> Case:
    CASES[make.__name__] = make
    return make


def _score(path: str, rules: str = "paper2020", *more: str) -> list[str]:
    return ["score", path, "--rules", rules, *more]


def _log(folder: Path, trial: Trial, signals: Iterable[str] = SNAPSHOT_SIGNALS) -> list[str]:
    present = [name for name in signals if name in trial.signals]
    write_trial_log(folder / "trial.jsonl", trial, signals=present)
    return _score("trial.jsonl")


def _lines(folder: Path, change: Callable[[list[dict[str, Any]]], None]) -> list[str]:
    """The example log with its records changed, and the line count put right."""
    write_trial_log(folder / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    records = [json.loads(line) for line in (folder / "trial.jsonl").read_text().splitlines()]
    change(records)
    if records and records[-1]["record"] == "end":
        records[-1]["records"] = len(records)
    (folder / "trial.jsonl").write_text("".join(json.dumps(r) + "\n" for r in records))
    return _score("trial.jsonl")


def _rules(folder: Path, old: str, new: str) -> list[str]:
    """The example scored under a changed copy of the paper's rule set."""
    text = (ROOT / "rules/paper2020/published.yaml").read_text()
    assert text.count(old) == 1, f"{old!r} is not there exactly once"
    (folder / "rules.yaml").write_text(text.replace(old, new))
    _mcap(folder)
    return _score("trial.mcap", "./rules.yaml")


def _mcap(folder: Path, messages: list[Recorded] | None = None) -> Path:
    recorded = recorded_messages(kitting_trial()) if messages is None else messages
    return write_bag(folder / "trial.mcap", recorded, storage="mcap")


# Scored ------------------------------------------------------------------------------


@case
def near_miss_jsonl(folder: Path) -> list[str]:
    return _log(folder, kitting_trial())


@case
def near_miss_ros1(folder: Path) -> list[str]:
    write_bag(folder / "trial.bag", recorded_messages(kitting_trial()), storage="ros1")
    return _score("trial.bag")


@case
def near_miss_mcap(folder: Path) -> list[str]:
    _mcap(folder)
    return _score("trial.mcap")


@case
def near_miss_sqlite_folder(folder: Path) -> list[str]:
    write_bag(folder / "trial", recorded_messages(kitting_trial()), storage="sqlite3")
    return _score("trial")


@case
def near_miss_sqlite_bare_file_without_metadata(folder: Path) -> list[str]:
    write_bag(folder / "trial.db3", recorded_messages(kitting_trial()), storage="sqlite3")
    return _score("trial.db3")


@case
def near_miss_human_state(folder: Path) -> list[str]:
    _mcap(folder, recorded_messages(kitting_trial(), motion="human_state"))
    return _score("trial.mcap", "paper2020.human_state")


@case
def near_miss_tf_frames(folder: Path) -> list[str]:
    _mcap(folder, recorded_messages(kitting_trial(), motion="frames"))
    return _score("trial.mcap")


@case
def official_trial_of_2022(folder: Path) -> list[str]:
    shared = ROOT.parent / "shared"
    if not shared.is_dir():
        pytest.skip("the folder of official material (../shared) is not here")
    shutil.copytree(
        shared / "ariac/data/nist_team_2022", folder / "nist_team_2022", copy_function=shutil.copyfile
    )
    return _score("nist_team_2022", "ariac2022.as_coded")


@case
def audit_of_the_official_trial_of_2022(folder: Path) -> list[str]:
    official_trial_of_2022(folder)
    return ["audit", "nist_team_2022"]


def _audit(folder: Path, old: str, new: str, *more: str) -> list[str]:
    """The example log with the score text of 2020, one item of it changed."""
    text = (ROOT / "tests/data/performance_2020.log").read_text(encoding="utf-8")
    (folder / "run").mkdir()
    (folder / "run/performance.log").write_text(text.replace(old, new), encoding="utf-8")
    write_trial_log(folder / "run/trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    return ["audit", "run", *more]


@case
def audit_of_a_bonus_one_too_high(folder: Path) -> list[str]:
    return _audit(folder, "bonus: [2]", "bonus: [3]", "--against", "ariac2019.as_coded")


@case
def audit_without_an_official_text(folder: Path) -> list[str]:
    write_trial_log(folder / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    return ["audit", "trial.jsonl"]


@case
def audit_of_a_text_of_more_than_one_edition(folder: Path) -> list[str]:
    text = "Score breakdown:\n[trial_score]\n...total trial score: [0]\n...total process time: [1.5]\n"
    (folder / "performance.log").write_text(text + "   [order score]\n   ...order ID [order_0]\n")
    return ["audit", "performance.log"]


@case
def audit_of_a_crashed_run(folder: Path) -> list[str]:
    (folder / "trial_log.txt").write_text("Gazebo Crashed score not recorded\n")
    return ["audit", "trial_log.txt"]


@case
def nothing_submitted(folder: Path) -> list[str]:
    return _log(folder, replace(kitting_trial(), submissions=()))


@case
def submissions_not_recorded(folder: Path) -> list[str]:
    trial = kitting_trial()
    return _log(folder, replace(trial, submissions=(), witnessed=trial.witnessed - {"submissions"}))


def _with_first(folder: Path, change: Callable[[KitSubmission], KitSubmission]) -> list[str]:
    trial = kitting_trial()
    first, second = trial.submissions
    return _log(folder, replace(trial, submissions=(change(first), second)))


@case
def wrong_agv(folder: Path) -> list[str]:
    return _with_first(folder, lambda s: replace(s, agv="agv2"))


@case
def contents_not_recorded(folder: Path) -> list[str]:
    return _with_first(folder, lambda s: replace(s, contents=None))


@case
def faulty_and_unwanted_products(folder: Path) -> list[str]:
    extra = (
        Product("disk_part_red", Pose((0.2, 0.2, 0.0)), faulty=True),
        Product("disk_part_red", Pose((0.2, 0.0, 0.0))),
    )
    return _with_first(folder, lambda s: replace(s, contents=(*(s.contents or ()), *extra)))


@case
def upside_down_part(folder: Path) -> list[str]:
    def flip(submission: KitSubmission) -> KitSubmission:
        first, *others = submission.contents or ()
        assert first.pose is not None
        flipped = replace(first, pose=Pose(first.pose.position_m, (0.0, 1.0, 0.0, 0.0)))
        return replace(submission, contents=(flipped, *others))

    return _with_first(folder, flip)


@case
def arms_collided(folder: Path) -> list[str]:
    trial = kitting_trial()
    return _log(
        folder, replace(trial, events=(*trial.events, Event(22.0, "arm_collision", "", "left and right arm")))
    )


@case
def human_was_touched(folder: Path) -> list[str]:
    def touch(records: list[dict[str, Any]]) -> None:
        name = "centre_distance/robot/human"
        for record in records:
            if record["record"] == "sample" and name in record["values"]:
                # At 9 m/s to each other and apart again: a distance that jumped would not be believed.
                away_s = max(25.0 - record["t_s"], record["t_s"] - 25.49, 0.0)
                record["values"][name] = min(record["values"][name], 0.4 + 9.0 * away_s)

    return _lines(folder, touch)


# Undecided -----------------------------------------------------------------------------


@case
def human_signal_deleted(folder: Path) -> list[str]:
    return _log(folder, kitting_trial(human=False))


@case
def snapshot_topic_missing(folder: Path) -> list[str]:
    _mcap(folder, [m for m in recorded_messages(kitting_trial()) if m.topic != "/snapshot"])
    return _score("trial.mcap")


@case
def gap_in_the_snapshots(folder: Path) -> list[str]:
    _mcap(folder, [m for m in recorded_messages(kitting_trial()) if m.topic != "/snapshot" or not _in_gap(m)])
    return _score("trial.mcap")


def _in_gap(message: Recorded) -> bool:
    return 30.0 < (message.t_ns - 1_700_000_000_000_000_000) / 1e9 < 31.0


@case
def nan_and_infinite_samples(folder: Path) -> list[str]:
    def spoil(records: list[dict[str, Any]]) -> None:
        samples = [r for r in records if r["record"] == "sample"]
        for k, bad in ((500, math.nan), (501, math.inf), *((k, math.nan) for k in range(900, 910))):
            samples[k]["values"]["speed/human"] = bad

    return _lines(folder, spoil)


@case
def nan_in_the_pose_of_a_product(folder: Path) -> list[str]:
    return _with_first(
        folder, lambda s: replace(s, contents=tuple(replace(p, pose=None) for p in s.contents or ()))
    )


@case
def unknown_message_type(folder: Path) -> list[str]:
    messages = recorded_messages(kitting_trial())
    other = [
        replace(m, type="geometry_msgs/msg/Point", fields={}) if m.topic == "/snapshot" else m
        for m in messages
    ]
    _mcap(folder, other)
    return _score("trial.mcap")


@case
def undecided_counts_as_the_worst_case(folder: Path) -> list[str]:
    command = _rules(
        folder,
        "    use: iso_ts_15066.ssm_separation",
        "    use: iso_ts_15066.ssm_separation\n    on_inconclusive: worst_case",
    )
    _mcap(folder, [m for m in recorded_messages(kitting_trial()) if m.topic != "/snapshot" or not _in_gap(m)])
    text = (folder / "rules.yaml").read_text()
    (folder / "rules.yaml").write_text(
        text.replace(
            "    use: ariac.human_contact", "    use: ariac.human_contact\n    on_inconclusive: exclude"
        )
    )
    return command


@case
def undecided_gives_zero(folder: Path) -> list[str]:
    command = _rules(
        folder,
        "    use: iso_ts_15066.ssm_separation",
        "    use: iso_ts_15066.ssm_separation\n    on_inconclusive: zero",
    )
    text = (folder / "rules.yaml").read_text()
    (folder / "rules.yaml").write_text(
        text.replace(
            "    use: ariac.human_contact", "    use: ariac.human_contact\n    on_inconclusive: exclude"
        )
    )
    _mcap(folder, [m for m in recorded_messages(kitting_trial()) if m.topic != "/snapshot"])
    return command


# Damaged or absent logs ----------------------------------------------------------------


@case
def missing_file(folder: Path) -> list[str]:
    return _score("nowhere.mcap")


@case
def empty_file(folder: Path) -> list[str]:
    (folder / "trial.mcap").touch()
    return _score("trial.mcap")


@case
def empty_folder(folder: Path) -> list[str]:
    (folder / "trial").mkdir()
    return _score("trial")


@case
def not_a_log(folder: Path) -> list[str]:
    (folder / "trial.txt").write_text("hello\n")
    return _score("trial.txt")


def _cut(path: Path, share: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])


@case
def mcap_cut_in_the_middle(folder: Path) -> list[str]:
    write_bag(folder / "whole", recorded_messages(kitting_trial()), storage="mcap")
    shutil.copyfile(next((folder / "whole").glob("*.mcap")), folder / "trial.mcap")
    _cut(folder / "trial.mcap", 0.5)
    return _score("trial.mcap")


@case
def ros1_bag_cut_in_the_middle(folder: Path) -> list[str]:
    write_bag(folder / "trial.bag", recorded_messages(kitting_trial()), storage="ros1")
    _cut(folder / "trial.bag", 0.5)
    return _score("trial.bag")


@case
def sqlite_bag_cut_in_the_middle(folder: Path) -> list[str]:
    write_bag(folder / "trial.db3", recorded_messages(kitting_trial()), storage="sqlite3")
    _cut(folder / "trial.db3", 0.5)
    return _score("trial.db3")


@case
def jsonl_cut_in_a_line(folder: Path) -> list[str]:
    command = _log(folder, kitting_trial())
    _cut(folder / "trial.jsonl", 0.5002)
    return command


@case
def jsonl_cut_between_lines(folder: Path) -> list[str]:
    command = _log(folder, kitting_trial())
    lines = (folder / "trial.jsonl").read_text().splitlines(keepends=True)
    (folder / "trial.jsonl").write_text("".join(lines[:2000]))
    return command


@case
def info_on_a_cut_mcap(folder: Path) -> list[str]:
    mcap_cut_in_the_middle(folder)
    return ["info", "trial.mcap"]


@case
def mcap_chunk_with_a_wrong_checksum(folder: Path) -> list[str]:
    path = _mcap(folder)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    return _score("trial.mcap")


@case
def sqlite_folder_without_metadata(folder: Path) -> list[str]:
    write_bag(folder / "trial", recorded_messages(kitting_trial()), storage="sqlite3")
    (folder / "trial/metadata.yaml").unlink()
    return _score("trial")


@case
def sqlite_file_that_is_no_bag(folder: Path) -> list[str]:
    connection = sqlite3.connect(folder / "trial.db3")
    connection.execute("CREATE TABLE groceries (name TEXT)")
    connection.commit()
    connection.close()
    return _score("trial.db3")


def _state_log(folder: Path, frames: int, tail: str) -> None:
    """A trial in a Gazebo log and the texts beside it."""
    states = "".join(
        f"<sdf version='1.6'><state world_name='w'><sim_time>{k // 10} {k % 10}00000000</sim_time>"
        f"<model name='gantry'><pose>{k / 100} 0 0 0 0 0 </pose></model>"
        f"<model name='person_1'><pose>{k / 100} 9 0 0 0 0 </pose></model></state></sdf>"
        for k in range(frames)
    )
    head = "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<log_version>1.0</log_version>\n</header>\n"
    world = (
        "<chunk encoding='txt'>\n<![CDATA[<sdf version ='1.6'><world name='w'></world></sdf>]]>\n</chunk>\n"
    )
    chunk = f"<chunk encoding='txt'>\n<![CDATA[{states}]]>\n</chunk>\n"
    (folder / "trial").mkdir()
    (folder / "trial/state.log").write_text(head + world + chunk + tail)
    shutil.copyfile(ROOT / "tests/data/trial_2022.yaml", folder / "trial/trial.yaml")
    shutil.copyfile(ROOT / "tests/data/performance_2022.log", folder / "trial/performance.log")


@case
def state_log_without_its_end(folder: Path) -> list[str]:
    _state_log(folder, 200, "")
    return _score("trial", "ariac2022.as_coded")


@case
def state_log_with_a_human(folder: Path) -> list[str]:
    _state_log(folder, 200, "</gazebo_log>\n")
    return _score("trial", "ariac2022.as_coded")


@case
def bundle_with_two_trials(folder: Path) -> list[str]:
    (folder / "trial").mkdir()
    for name in ("a.mcap", "b.mcap"):
        write_bag(folder / "trial" / name, recorded_messages(kitting_trial()), storage="mcap")
    return _score("trial")


@case
def bundle_yaml_that_names_the_parts(folder: Path) -> list[str]:
    _state_log(folder, 200, "</gazebo_log>\n")
    (folder / "trial/state.log").rename(folder / "trial/motion.log")
    shutil.copyfile(folder / "trial/trial.yaml", folder / "trial/another_trial.yaml")
    (folder / "trial/bundle.yaml").write_text(
        "id: run_3\nlogs: [motion.log]\ntrial_config: trial.yaml\nofficial: performance.log\n"
    )
    return _score("trial", "ariac2022.as_coded")


@case
def bundle_yaml_with_a_misspelt_key(folder: Path) -> list[str]:
    _mcap(folder)
    (folder / "bundle.yaml").write_text("log: [trial.mcap]\n")
    return _score("bundle.yaml")


@case
def bundle_yaml_that_leads_outside(folder: Path) -> list[str]:
    (folder / "bundle.yaml").write_text("logs: [../../etc/passwd]\n")
    return _score("bundle.yaml")


@case
def configuration_without_a_log(folder: Path) -> list[str]:
    (folder / "trial").mkdir()
    shutil.copyfile(ROOT / "tests/data/trial_2022.yaml", folder / "trial/trial.yaml")
    return _score("trial", "ariac2022.as_coded")


@case
def time_runs_backwards_a_little(folder: Path) -> list[str]:
    def swap(records: list[dict[str, Any]]) -> None:
        records[1000], records[1001] = records[1001], records[1000]

    return _lines(folder, swap)


@case
def time_runs_backwards_into_another_run(folder: Path) -> list[str]:
    def again(records: list[dict[str, Any]]) -> None:
        records[-1:-1] = [r for r in records if r["record"] == "sample"][:100]

    return _lines(folder, again)


@case
def no_orders_recorded(folder: Path) -> list[str]:
    _mcap(folder, [m for m in recorded_messages(kitting_trial()) if m.topic != "/ariac/orders"])
    return _score("trial.mcap")


# Rule sets -----------------------------------------------------------------------------


@case
def unknown_rule_set(folder: Path) -> list[str]:
    _mcap(folder)
    return _score("trial.mcap", "paper2021")


@case
def rule_set_with_a_duplicate_key(folder: Path) -> list[str]:
    return _rules(folder, "round: 6", "round: 6\nround: 2")


@case
def rule_set_with_a_misspelt_key(folder: Path) -> list[str]:
    return _rules(folder, "monitors:", "moniters:")


@case
def rule_set_with_a_misspelt_parameter(folder: Path) -> list[str]:
    return _rules(folder, "t1_s: 1.0", "t1: 1.0")


@case
def rule_set_with_an_alias_bomb(folder: Path) -> list[str]:
    rows = ["a0: &a0 [" + ", ".join(["x" * 100_000] * 100) + "]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]
    (folder / "rules.yaml").write_text("\n".join(rows))
    _mcap(folder)
    return _score("trial.mcap", "./rules.yaml")


@case
def rule_set_with_a_small_alias_bomb(folder: Path) -> list[str]:
    rows = ["a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10)]
    (folder / "rules.yaml").write_text("\n".join(rows))
    _mcap(folder)
    return _score("trial.mcap", "./rules.yaml")


@case
def rule_set_naming_a_plugin_that_is_not_installed(folder: Path) -> list[str]:
    return _rules(folder, "{use: kitting.none_faulty}", "{use: kitting.none_fawlty}")


@case
def formula_that_divides_by_zero(folder: Path) -> list[str]:
    return _rules(folder, "/ (1 + demerits)", "/ (demerits - demerits)")


@case
def formula_with_a_misspelt_term(folder: Path) -> list[str]:
    return _rules(folder, "(human_contact) * task", "(human_contact) * tusk")


@case
def formula_that_is_code(folder: Path) -> list[str]:
    return _rules(folder, "gate(human_contact) * task / (1 + demerits)", "__import__('os').system('true')")


@case
def malformed_yaml(folder: Path) -> list[str]:
    return _rules(folder, "monitors:", "monitors: [")


@case
def unknown_log_map(folder: Path) -> list[str]:
    _mcap(folder)
    return _score("trial.mcap", "paper2020", "--log-map", "ariac2002")


@case
def output_into_a_missing_folder(folder: Path) -> list[str]:
    _mcap(folder)
    return _score("trial.mcap", "paper2020", "-o", "nowhere/result.json")


# Stewards, verification, checking, exports -----------------------------------------------


def _stored(folder: Path) -> str:
    shutil.copy(ROOT / "examples/kitting_near_miss.result.json", folder / "result.json")
    return "result.json"


@case
def adjusted_by_stewards(folder: Path) -> list[str]:
    stored = _stored(folder)
    measured = measured_sha256(load_result(folder / stored))
    (folder / "adjustments.yaml").write_text(
        "adjustments:\n"
        "  - id: protest_3\n"
        "    author: A. Steward\n"
        "    reason: a marshal had knocked over the camera\n"
        "    time: 2024-05-12T14:30:00Z\n"
        f"    target: {{trial: kitting_near_miss, measured: '{measured}', finding: separation#1}}\n"
        "    effect: {verdict: satisfied}\n"
    )
    return ["adjust", stored, "adjustments.yaml"]


@case
def adjustment_for_another_result(folder: Path) -> list[str]:
    stored = _stored(folder)
    (folder / "adjustments.yaml").write_text(
        "adjustments:\n"
        "  - id: protest_3\n"
        "    author: A. Steward\n"
        "    reason: late\n"
        "    time: 2024-05-12T14:30:00Z\n"
        f"    target: {{trial: kitting_near_miss, measured: '{'0' * 64}'}}\n"
        "    effect: {points: -1}\n"
    )
    return ["adjust", stored, "adjustments.yaml"]


@case
def verified_without_its_log(folder: Path) -> list[str]:
    return ["verify", _stored(folder)]


@case
def verified_with_an_edited_score(folder: Path) -> list[str]:
    stored = folder / _stored(folder)
    stored.write_text(stored.read_text().replace('"score": 25.760398', '"score": 29.760398'))
    return ["verify", stored.name]


@case
def checked_without_the_human(folder: Path) -> list[str]:
    messages = [m for m in recorded_messages(kitting_trial()) if m.topic != "/snapshot"]
    write_bag(folder / "trial.mcap", messages, storage="mcap")
    return ["check", "trial.mcap", "--rules", "paper2020"]


@case
def exported_for_github_with_criteria_that_fail(folder: Path) -> list[str]:
    return ["export", _stored(folder), "--output-format", "github", "--fail-on", "violation:separation"]
