"""Checksums that `bundle.yaml` states of the files of a trial."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import pytest

from ariac_score import score_trial
from ariac_score.cli import main
from ariac_score.errors import DataFileError, LogError
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

RULES = "ariac2020.as_coded"


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    folder = tmp_path / "kit_1"
    (folder / "logs").mkdir(parents=True)
    write_trial_log(folder / "logs/log.jsonl", kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    return folder


def state(trial: Path, digest: str, name: str = "logs/log.jsonl") -> Path:
    text = f'logs: [logs/log.jsonl]\nsha256:\n  {name}: "{digest}"\n'
    (trial / "bundle.yaml").write_text(text, encoding="utf-8")
    return trial


def digest_of(trial: Path) -> str:
    return sha256((trial / "logs/log.jsonl").read_bytes()).hexdigest()


def test_a_bundle_whose_checksums_are_right_is_scored_as_without_them(trial: Path) -> None:
    alone = score_trial(trial / "logs/log.jsonl", RULES).score

    assert score_trial(state(trial, digest_of(trial)), RULES).score == alone
    assert score_trial(trial / "bundle.yaml", RULES).score == alone


def test_a_file_whose_name_looks_like_that_of_a_run_has_its_checksum_compared(trial: Path) -> None:
    log = (trial / "logs/log.jsonl").rename(trial / "logs/day#run=1.jsonl")
    text = 'logs: ["logs/day#run=1.jsonl"]\nsha256:\n  "logs/day#run=1.jsonl": "{}"\n'
    (trial / "bundle.yaml").write_text(text.format(sha256(log.read_bytes()).hexdigest()), encoding="utf-8")

    assert score_trial(trial, RULES).status == "scored"


def test_a_bundle_with_a_wrong_checksum_is_not_scored(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state(trial, digest_of(trial))
    with (trial / "logs/log.jsonl").open("a") as log:
        log.write("\n")

    with pytest.raises(LogError, match="its SHA-256 is") as caught:
        score_trial(trial, RULES)

    assert caught.value.file == str(trial / "logs/log.jsonl")
    assert main(["score", str(trial), "--rules", RULES]) == 6
    said = capsys.readouterr().err
    assert digest_of(trial) in said
    assert "correct bundle.yaml" in said


@pytest.mark.parametrize("name", ["other.jsonl", "../kit_1/logs/log.jsonl", "/etc/passwd", "logs"])
def test_a_checksum_of_what_is_no_file_of_the_trial_is_refused(trial: Path, name: str) -> None:
    with pytest.raises(LogError, match="is no file of this trial"):
        score_trial(state(trial, digest_of(trial), name), RULES)


@pytest.mark.parametrize("digest", ["", "abc", "A" * 64, "a" * 63, "a" * 65])
def test_what_is_no_checksum_is_refused(trial: Path, digest: str) -> None:
    with pytest.raises(DataFileError, match=r"sha256|match|a-f"):
        score_trial(state(trial, digest), RULES)


@pytest.mark.slow
def test_in_a_batch_it_costs_that_run_alone(
    trial: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    season, out = tmp_path / "season", tmp_path / "out"
    season.mkdir()
    (season / "whole.jsonl").write_bytes((trial / "logs/log.jsonl").read_bytes())
    state(trial, "a" * 64).rename(season / "kit_1")

    assert main(["batch", str(season), "--rules", RULES, "-j", "1", "-o", str(out)]) == 6
    table = (out / "runs.jsonl").read_text(encoding="ascii")
    assert [word in table for word in ('"unreadable"', "logs/log.jsonl: its SHA-256 is", '"scored"')] == [
        True
    ] * 3

    state(season / "kit_1", digest_of(season / "kit_1"))  # the statement alone is another one
    assert main(["batch", str(season), "--rules", RULES, "-j", "1", "-o", str(out)]) == 0
