"""Same log, same rules, same versions: same bytes; another byte: another hash."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ariac_score import as_json, load_result, score_trial
from ariac_score.cli import main
from ariac_score.testing import NEAR_MISS, SNAPSHOT_SIGNALS, write_bag, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"
EXPECTED = ROOT / "examples/kitting_near_miss.result.json"
PUBLISHED = ROOT / "tests/data/as_published/kitting_near_miss.result.json"
"""The same under the paper's literal price, which tests of what is done with results take."""


def _without_code(text: str) -> dict[str, Any]:
    """A result without the hashes of the code, which change with every edit of it."""
    data: dict[str, Any] = json.loads(text)
    data["provenance"]["code"] = []
    return data


@pytest.mark.parametrize(("rules", "expected"), [("paper2020", EXPECTED), ("paper2020.published", PUBLISHED)])
def test_the_committed_example_scores_as_its_committed_result_says(
    rules: str, expected: Path, update_golden: bool
) -> None:
    result = score_trial(EXAMPLE, rules)
    found = _without_code(as_json(result))

    if update_golden:
        bare = replace(result, provenance=replace(result.provenance, code=()))
        expected.write_text(as_json(bare), encoding="utf-8")
    assert found == json.loads(expected.read_text(encoding="utf-8"))


def test_the_committed_result_can_be_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(EXPECTED), "safety_demerits"]) == 0
    assert "safety_demerits = 0.0869397" in capsys.readouterr().out


def test_the_example_is_worth_what_a_hand_calculation_gives() -> None:
    # Task, ARIAC 2020 as coded. order_0: 3 types, 2 colours, 2 poses, no bonus = 7, once.
    # order_1: 2 types, 2 colours, 1 pose, bonus 2 = 7, three times: 28 in all.
    # One breach of 240 samples of 10 ms: depths 0.8 m/s times 5, 15, ... 1195 ms, each twice,
    # below the turning point at 1.2 s: their integral is 2 * 0.8 * 0.01 * (0.005 + ... + 1.195) = 1.152 m s.
    integral_m_s = 2 * 0.8 * 0.01 * sum(0.005 + 0.01 * k for k in range(120))
    assert integral_m_s == pytest.approx(1.152)
    # One rise and fall costs its peak and its integral over 5 s, as shares of the required distance.
    demerits = 0.4 * (0.8 * 1.195 + integral_m_s / 5) / NEAR_MISS.required_m

    score = score_trial(EXAMPLE, "paper2020").score

    assert score is not None
    assert float(score) == pytest.approx(28 / (1 + demerits), abs=5e-7)


@pytest.mark.slow
def test_every_format_gives_the_same_findings_and_the_same_ledger(tmp_path: Path) -> None:
    trial = kitting_trial()
    messages = recorded_messages(trial)
    logs = [
        write_bag(tmp_path / "a.bag", messages, storage="ros1"),
        write_bag(tmp_path / "b.bag", messages, storage="ros1", compression="lz4"),
        write_bag(tmp_path / "a.db3", messages, storage="sqlite3"),
        write_bag(tmp_path / "sqlite", messages, storage="sqlite3"),
        write_bag(tmp_path / "a.mcap", messages, storage="mcap"),
        write_bag(tmp_path / "b.mcap", messages, storage="mcap", compression="zstd"),
        write_bag(tmp_path / "mcap", messages, storage="mcap"),
        write_trial_log(tmp_path / "a.jsonl", trial, signals=SNAPSHOT_SIGNALS),
    ]

    told = set()
    for log in logs:
        data = json.loads(as_json(score_trial(log, "paper2020")))
        coverage = data["measured"]["coverage"]
        of_topic = {
            (one.pop("source"), *(one.pop(n, 0.0) for n in ("stamp_jitter_s", "stated_rate_hz")))
            for one in coverage
        }
        # JSON Lines have no topics, and times that are no times of arrival.
        assert of_topic == {("", 0.0, 0.0) if log.suffix == ".jsonl" else ("/snapshot", 0.01, 100.0)}
        told.add(json.dumps([data["score"], data["ledger"], data["measured"]["findings"], coverage]))

    assert len(told) == 1


def test_scoring_twice_gives_the_same_bytes() -> None:
    assert as_json(score_trial(EXAMPLE, "paper2020")) == as_json(score_trial(EXAMPLE, "paper2020"))


@pytest.mark.slow
def test_the_order_in_which_files_came_into_a_folder_does_not_matter(tmp_path: Path, shared: Path) -> None:
    official = shared / "ariac/data/nist_team_2022"
    files = sorted(p for p in official.rglob("*") if p.is_file())
    texts = []
    for name, order in (("a", files), ("b", files[::-1])):
        root = tmp_path / name / "trial"
        for file in order:
            copy = root / file.relative_to(official)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
        texts.append(as_json(score_trial(root, "ariac2022.as_coded")))

    assert texts[0] == texts[1]


def test_one_changed_byte_of_the_log_changes_its_hash(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    first = write_trial_log(tmp_path / "a/t.jsonl", kitting_trial())
    second = tmp_path / "b/t.jsonl"
    second.write_bytes(first.read_bytes().replace(b'"agv1"', b'"agv3"', 1))

    one, other = (score_trial(path, "paper2020").provenance.inputs[0] for path in (first, second))

    assert one.bytes == other.bytes
    assert one.sha256 != other.sha256


def test_a_stored_result_comes_back_as_it_was(tmp_path: Path) -> None:
    result = score_trial(EXAMPLE, "paper2020")
    (tmp_path / "r.json").write_text(as_json(result), encoding="utf-8")

    again = load_result(tmp_path / "r.json")

    assert as_json(again) == as_json(result)
    assert again.score == result.score


def test_a_deleted_human_signal_leaves_the_score_open_and_its_worst_counts(tmp_path: Path) -> None:
    whole = score_trial(EXAMPLE, "paper2020")
    log = write_trial_log(tmp_path / "t.jsonl", kitting_trial(human=False), signals=["speed/robot"])

    blind = score_trial(log, "paper2020")

    assert whole.score is not None
    assert blind.score is not None
    assert blind.is_open
    assert blind.score <= whole.score  # nobody gains by hiding the person
    assert {a.check for a in blind.assumptions} == {"separation", "human_contact"}


def test_the_official_trial_of_2022_gets_its_official_result(shared: Path) -> None:
    result = score_trial(shared / "ariac/data/nist_team_2022", "ariac2022.as_coded")

    official = result.measured.official
    assert official is not None
    # performance.log prints final score 0 and process time 14.852 s.
    assert (official.total, official.process_time_s) == (0.0, 14.852)
    assert result.score == 0
    assert {f.verdict.value for f in result.measured.of("separation").values()} == {"not_applicable"}
    assert result.measured.window is not None
    assert result.measured.window.duration_s == pytest.approx(14.852, abs=0.03)


def test_nothing_of_the_machine_is_in_a_result() -> None:
    text = as_json(score_trial(EXAMPLE, "paper2020"))

    assert str(ROOT) not in text
    assert str(Path.home()) not in text


def test_the_number_of_threads_changes_no_byte(capsys: pytest.CaptureFixture[str]) -> None:
    found = []
    for jobs in ("0", "1", "2", "5"):
        command = ["score", str(EXAMPLE), "--rules", "paper2020", "--output-format", "json", "--jobs", jobs]
        assert main(command) == 0
        found.append(capsys.readouterr().out)

    assert len(set(found)) == 1


@pytest.mark.parametrize("jobs", ["-1", "two", "65", "1.5", ""])
def test_a_number_of_threads_that_is_none_is_refused(jobs: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["score", str(EXAMPLE), "--rules", "paper2020", f"--jobs={jobs}"])

    assert caught.value.code == 4
    assert "is no number of threads from 0 to 64" in capsys.readouterr().err
