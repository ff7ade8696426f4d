"""EvalAI, against a stand-in that repeats the checks which its code makes, by the notes on it."""

from __future__ import annotations

import io
import json
import sys
import threading
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import load_rule_set, score_trial
from ariac_score.batch.outcomes import outcome_document
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.batch.worker import Done
from ariac_score.cli import main
from ariac_score.platforms import submission
from ariac_score.platforms.evalai import (
    Api,
    ApiError,
    Challenge,
    Evaluation,
    Worker,
    challenge_config,
    challenge_files,
    check_challenge,
)
from ariac_score.platforms.neutral import Metrics, PlatformScores
from ariac_score.platforms.submission import Phase, load_phase, phase_text
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log

sys.path.insert(0, str(Path(__file__).parent))
from evalai_server import LABELS, Platform
from platform_cases import ORGANISERS, SCORE, trial_config, without_orders

from ariac_score_ariac.testing import kitting_trial

RULES = "ariac2020.as_coded"


@pytest.fixture
def platform() -> Iterator[Platform]:
    server = Platform()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(scope="session")
def log_text(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("made") / "trial.jsonl"
    write_trial_log(file, kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    return file.read_text(encoding="utf-8")


@pytest.fixture
def phase(tmp_path: Path) -> Phase:
    folder = tmp_path / "reference"
    folder.mkdir()
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
    (folder / "phase.json").write_text(
        phase_text("The finals of 2026", setting, {"kit": ""}), encoding="utf-8"
    )
    (folder / "ruleset.yaml").write_text(setting.rules, encoding="utf-8")
    return load_phase(folder)


def worker(
    platform: Platform, phase: Phase, tmp_path: Path, said: str = "secret"
) -> tuple[Worker, list[float]]:
    pauses: list[float] = []
    api = Api(f"http://127.0.0.1:{platform.server_address[1]}", said, "queue", 7)
    return Worker(api, phase, tmp_path / "store", pauses.append, lambda _line: None), pauses


def message(platform: Platform, log: bytes | None, name: str = "kit_1.jsonl", pk: int = 11) -> None:
    platform.queue.append(
        {"body": {"submission_pk": pk, "challenge_pk": 7, "phase_pk": 3}, "receipt_handle": f"r{pk}"}
    )
    if log is not None:
        platform.files = {f"/media/{name}": log}


def test_a_submission_is_fetched_scored_sent_and_only_then_acknowledged(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    one, _ = worker(platform, phase, tmp_path)

    assert one.once()
    assert not one.once()  # the queue is empty

    (body,) = platform.taken
    assert (body["submission"], body["challenge_phase"], body["submission_status"]) == (11, 3, "FINISHED")
    (row,) = json.loads(body["result"])
    assert set(row) == {"split", "show_to_participant", "accuracies"}
    assert set(row["accuracies"]) == set(LABELS)
    (tmp_path / "kit_1.jsonl").write_text(log_text, encoding="utf-8")
    assert row["accuracies"]["final"] == float(score_trial(tmp_path / "kit_1.jsonl", RULES).score or 0)
    assert platform.acknowledged == ["r11"]
    methods = [method for method, path in platform.requests if "media" not in path]
    assert methods == ["GET", "GET", "GET", "PATCH", "PUT", "POST", "GET"]


def test_a_bad_submission_is_a_scored_outcome(platform: Platform, phase: Phase, tmp_path: Path) -> None:
    message(platform, b"no log")
    worker(platform, phase, tmp_path)[0].once()

    (row,) = json.loads(platform.taken[0]["result"])
    assert (row["accuracies"]["final"], row["accuracies"]["status_code"]) == (-1e6, 2)
    assert "kit_1.jsonl" in platform.taken[0]["stdout"]


def test_a_run_that_the_scorer_failed_at_ends_as_failed_and_has_no_score(
    platform: Platform, phase: Phase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(_: object, tasks: Iterable[RunTask], __: object) -> Iterator[Done]:
        document = outcome_document("plugin_failed", "no such table", team="submission", trial="kit")
        return (Done(task, "", "", "", document) for task in tasks)

    monkeypatch.setattr(submission.LocalExecutor, "run", failing)
    message(platform, b"{}")

    assert worker(platform, phase, tmp_path)[0].once()

    (answer,) = platform.taken
    assert answer["submission_status"] == "FAILED"
    assert "no such table" in answer["stderr"]
    assert answer["result"] == "[]"


def test_a_worker_with_a_fault_of_the_organiser_takes_no_submission(
    platform: Platform, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rules = load_rule_set(RULES)
    setting = BatchSetting.of(rules, Limits(60.0, 0))
    place = tmp_path / "reference"
    place.mkdir()
    other = setting.rules.replace("log_map: ariac2020", "log_map: ./ours.yaml")
    setting = replace(setting, rules=other)
    (place / "phase.json").write_text(phase_text("finals", setting, {"kit": ""}), encoding="utf-8")
    (place / "ruleset.yaml").write_text(other, encoding="utf-8")
    server = f"http://127.0.0.1:{platform.server_address[1]}"
    settings = {"AUTH_TOKEN": "secret", "API_SERVER": server, "QUEUE_NAME": "q", "CHALLENGE_PK": "1"}
    for name, value in settings.items():
        monkeypatch.setenv(name, value)

    assert main(["platform", "evalai", "worker", str(place), "--store", str(tmp_path / "s"), "--once"]) == 4

    assert "ours.yaml" in capsys.readouterr().err
    assert platform.requests == []


@pytest.mark.parametrize("status", ["finished", "failed", "cancelled", "FINISHED"])
def test_a_message_for_what_is_done_is_acknowledged_and_nothing_else(
    platform: Platform, phase: Phase, tmp_path: Path, status: str
) -> None:
    message(platform, b"")
    platform.status = status
    worker(platform, phase, tmp_path)[0].once()

    assert platform.taken == []
    assert platform.acknowledged == ["r11"]


def test_a_message_that_comes_twice_is_answered_with_the_same_bytes_without_scoring(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    message(platform, log_text.encode())
    message(platform, None)
    one, _ = worker(platform, phase, tmp_path)
    one.once()
    platform.status = "running"  # the first worker died before it was acknowledged, or so it seems
    monkeypatch.setattr(
        "ariac_score.platforms.evalai.score_submission", lambda *_, **__: pytest.fail("again")
    )
    one.once()

    first, second = platform.taken
    assert first == second


def test_a_fault_of_the_platform_is_waited_out(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    platform.faults = [500, 502]
    one, pauses = worker(platform, phase, tmp_path)
    one.once()

    assert pauses == [2.0, 4.0]
    assert len(platform.taken) == 1


def test_a_platform_that_stays_broken_keeps_the_message(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    platform.faults = [500] * 9
    with pytest.raises(ApiError, match="HTTP 500"):
        worker(platform, phase, tmp_path)[0].once()
    assert platform.acknowledged == []


def test_what_the_platform_will_not_have_ends_as_failed_with_its_own_words(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    platform.faults = [400]
    worker(platform, phase, tmp_path)[0].once()

    (body,) = platform.taken
    assert body["submission_status"] == "FAILED"
    assert "fault" in body["stderr"]
    assert platform.acknowledged == ["r11"]


def test_a_wrong_token_is_told_and_never_shown(platform: Platform, phase: Phase, tmp_path: Path) -> None:
    message(platform, b"")
    one, _ = worker(platform, phase, tmp_path, said="wrong-token")
    with pytest.raises(ApiError, match="HTTP 401") as caught:
        one.once()
    assert "wrong-token" not in f"{caught.value}{one.api!r}"
    assert not caught.value.transient


@pytest.mark.parametrize(
    ("takes", "scheme", "refused"),
    [("Bearer", "", []), ("Token", "", ["Bearer"]), ("Token", "Token", []), ("Bearer", "Bearer", [])],
)
def test_the_word_before_the_token_that_is_taken_is_found_once(
    platform: Platform,
    phase: Phase,
    tmp_path: Path,
    log_text: str,
    takes: str,
    scheme: str,
    refused: list[str],
) -> None:
    platform.schemes = (takes,)
    message(platform, log_text.encode())
    one, _ = worker(platform, phase, tmp_path)
    one.api = replace(one.api, scheme=scheme)

    one.once()

    assert platform.taken[0]["submission_status"] == "FINISHED"
    assert platform.refused == refused


@pytest.mark.parametrize(("scheme", "tried"), [("", ["Bearer", "Token"]), ("Bearer", ["Bearer"])])
def test_a_token_that_is_refused_is_not_tried_for_ever(
    platform: Platform, phase: Phase, tmp_path: Path, scheme: str, tried: list[str]
) -> None:
    platform.schemes = ()
    one, _ = worker(platform, phase, tmp_path)
    one.api = replace(one.api, scheme=scheme)
    with pytest.raises(ApiError, match="HTTP 401"):
        one.once()
    assert platform.refused == tried


def test_once_taken_the_other_word_is_not_tried_when_the_token_ends(
    platform: Platform, phase: Phase, tmp_path: Path
) -> None:
    one, _ = worker(platform, phase, tmp_path)
    one.once()
    platform.schemes = ()
    with pytest.raises(ApiError, match="HTTP 401"):
        one.once()
    assert platform.refused == ["Bearer"]


def test_a_download_that_is_cut_off_is_tried_again_later(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    platform.cut = True
    one, _ = worker(platform, phase, tmp_path)
    with pytest.raises(ApiError):
        one.once()
    platform.cut = False
    one.once()

    assert platform.taken[0]["submission_status"] == "FINISHED"


@pytest.mark.parametrize("url", ["file:///etc/passwd", "ftp://127.0.0.1/x", "data:,x"])
def test_a_submission_may_not_name_a_file_of_this_machine(
    platform: Platform, phase: Phase, tmp_path: Path, url: str
) -> None:
    message(platform, None)
    platform.files = {url: b""}
    worker(platform, phase, tmp_path)[0].once()

    assert platform.taken[0]["submission_status"] == "FAILED"
    assert "is no address on the web" in platform.taken[0]["stderr"]


def test_a_submission_that_cannot_be_had_does_not_block_those_behind_it(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    message(platform, None, pk=11)
    message(platform, log_text.encode(), pk=12)
    one, _ = worker(platform, phase, tmp_path)
    monkeypatch.setattr("ariac_score.platforms.evalai.LARGEST_SUBMISSION", len(log_text) - 1)
    one.once()
    monkeypatch.undo()
    one.once()

    assert [(body["submission"], body["submission_status"]) for body in platform.taken] == [
        (11, "FAILED"),
        (12, "FINISHED"),
    ]
    assert "it has more than" in platform.taken[0]["stderr"]
    assert platform.acknowledged == ["r11", "r12"]


@pytest.mark.parametrize(
    "name", ["6fb5e6a0-1c1a-4b7e-9d7c.jsonl", "..jsonl", "x" * 300 + ".jsonl", "%2e%2e%2fkit.jsonl"]
)
def test_the_platform_may_name_a_submission_as_it_likes(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str, name: str
) -> None:
    message(platform, log_text.encode(), name)
    worker(platform, phase, tmp_path)[0].once()

    (row,) = json.loads(platform.taken[0]["result"])
    assert row["accuracies"]["status_code"] == 0


def zipped(**members: str) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, text in members.items():
            archive.writestr(f"kit_1/{name}", text)
    return content.getvalue()


@pytest.mark.parametrize(
    ("brought", "alone", "found"),
    [
        ({}, True, (SCORE, 0)),
        ({}, False, (SCORE, 0)),
        ({"mine.yaml": ORGANISERS}, False, (SCORE, 0)),
        ({"mine.yaml": trial_config("gear_part_green")}, False, (-1e6, 2)),  # refused: it says something else
    ],
)
def test_the_configuration_of_the_organiser_counts_whatever_a_submission_brings(
    platform: Platform,
    phase: Phase,
    tmp_path: Path,
    log_text: str,
    brought: dict[str, str],
    alone: bool,
    found: tuple[float, int],
) -> None:
    (phase.folder / "trial.yaml").write_text(ORGANISERS, encoding="utf-8")
    text = phase_text("finals", phase.setting, {"kit": "trial.yaml"})
    (phase.folder / "phase.json").write_text(text, encoding="utf-8")
    log = without_orders(log_text)
    if alone:
        message(platform, log.encode())
    else:
        message(platform, zipped(**{"trial.jsonl": log}, **brought), "s.zip")

    worker(platform, load_phase(phase.folder), tmp_path)[0].once()

    (row,) = json.loads(platform.taken[0]["result"])
    assert (row["accuracies"]["final"], row["accuracies"]["status_code"]) == found


def test_the_answer_is_for_the_split_that_the_platform_knows(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    worker(platform, phase, tmp_path)[0].once()

    assert phase.name == "The finals of 2026"  # which is no code name
    assert json.loads(platform.taken[0]["result"])[0]["split"] == "finals"


def test_a_submission_for_another_phase_is_left_to_its_own_worker(
    platform: Platform, phase: Phase, tmp_path: Path, log_text: str
) -> None:
    message(platform, log_text.encode())
    platform.codename = "practice"
    one, _ = worker(platform, phase, tmp_path)
    one.codename = "finals"
    with pytest.raises(ApiError, match="for phase 'practice', and this worker scores 'finals'"):
        one.once()
    assert (platform.taken, platform.acknowledged) == ([], [])


@pytest.mark.parametrize(
    "answer", [{"body": {}, "receipt_handle": "r"}, [], {"body": {"submission_pk": "x"}}, {"body": 5}]
)
def test_an_answer_that_is_no_message_is_an_empty_queue_or_told(
    platform: Platform, phase: Phase, tmp_path: Path, answer: Any
) -> None:
    platform.queue.append(answer)
    one, _ = worker(platform, phase, tmp_path)
    if not answer or not answer["body"]:
        assert not one.once()
    else:
        with pytest.raises(ApiError, match="the queue gave no message of a submission"):
            one.once()


def test_the_shape_is_the_one_the_code_takes() -> None:
    scores = PlatformScores.of("finals", "scored", Metrics(1.0, 1, 1.0, 1.0, 1.0, 1), "all well", "ab")
    body = asdict(Evaluation.finished(scores, split="finals", phase_pk=3, submission_pk=11))

    assert Platform.accepts(Platform.__new__(Platform), body) == (200, "")
    assert isinstance(body["result"], str)
    assert "all well" in body["stdout"]
    assert Evaluation.failed("why", phase_pk=3, submission_pk=11).result == "[]"


# The configuration ---------------------------------------------------------------------


def config(tmp_path: Path, change: Any = lambda _c: None) -> Path:
    document = yaml.safe_load(challenge_config(Challenge("Finals", "finals")))
    change(document)
    for name, content in challenge_files(Challenge("Finals", "finals")).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / "challenge_config.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return tmp_path / "challenge_config.yaml"


def test_our_own_configuration_has_no_problem(tmp_path: Path) -> None:
    assert check_challenge(config(tmp_path)) == []


TRAPS = {
    "hosted": (lambda c: c.update(remote_evaluation=False), "this engine does not run there"),
    "ascending": (
        lambda c: c["leaderboard"][0]["schema"]["metadata"]["final"].pop("sort_ascending"),
        "the worst would lead",
    ),
    "suffixes": (
        lambda c: c["challenge_phases"][0].update(allowed_submission_file_types=".json, .zip"),
        ".mcap",
    ),
    "latest": (
        lambda c: c["challenge_phase_splits"][0].update(show_leaderboard_by_latest_submission=True),
        "newest first",
    ),
    "split": (
        lambda c: c["dataset_splits"][0].update(codename="other"),
        "no dataset split has its code name",
    ),
    "no phase": (lambda c: c.update(challenge_phases={"a": 1}), "no list of mappings"),
    "a board of numbers": (lambda c: c.update(leaderboard=[5]), "no list of mappings"),
    "labels that are a number": (
        lambda c: c["leaderboard"][0]["schema"].update(labels=5),
        "not those of the worker",
    ),
    "a code name of lists": (
        lambda c: (c["dataset_splits"][0].update(codename=[5]), c["challenge_phases"][0].update(codename={})),
        "no dataset split has its code name",
    ),
    "a board without a schema": (lambda c: c["leaderboard"][0].update(schema=7), "not those of the worker"),
    "no script": (lambda c: c.update(evaluation_script="other.zip"), "the importer requires it"),
    "labels": (lambda c: c["leaderboard"][0]["schema"]["labels"].append("more"), "not those of the worker"),
}


@pytest.mark.parametrize("trap", TRAPS)
def test_every_trap_of_the_configuration_is_found(tmp_path: Path, trap: str) -> None:
    change, words = TRAPS[trap]
    assert any(words in problem.what for problem in check_challenge(config(tmp_path, change)))


def test_the_script_that_the_importer_asks_for_refuses_to_score(tmp_path: Path) -> None:
    archive = zipfile.ZipFile(io.BytesIO(challenge_files(Challenge("F", "finals"))["evaluation_script.zip"]))
    assert sorted(archive.namelist()) == ["__init__.py", "main.py"]  # no folder around them
    names: dict[str, Any] = {}
    exec(compile(archive.read("main.py"), "main.py", "exec"), names)  # noqa: S102  # ours, as a worker would
    with pytest.raises(RuntimeError, match="evaluated remotely"):
        names["evaluate"]("annotation", "submission", "finals", submission_metadata={})


@pytest.mark.parametrize("text", ["", "[1]", "a: [", "a: 1\na: 2\n"])
def test_a_configuration_that_is_none_is_a_problem(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    assert check_challenge(tmp_path / "c.yaml")
    assert check_challenge(tmp_path / "gone.yaml")


def test_the_commands(
    tmp_path: Path, platform: Platform, phase: Phase, log_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = ["platform", "evalai"]
    file = str(tmp_path / "c.yaml")
    assert main([*head, "config", "--title", "Finals", "--phase", "finals", "-o", file]) == 0
    assert main([*head, "check", file]) == 0
    folder = str(tmp_path / "challenge")
    assert main([*head, "config", "--title", "Finals", "--phase", "finals", "--folder", folder]) == 0
    assert main([*head, "check", f"{folder}/challenge_config.yaml"]) == 0
    assert main([*head, "config", "--title", "Finals", "--phase", "The finals!", "-o", file]) == 4
    run = [*head, "worker", str(phase.folder), "--store", str(tmp_path / "store"), "--once"]
    monkeypatch.delenv("API_SERVER", raising=False)
    assert main(run) == 4
    message(platform, log_text.encode())
    for name, value in {
        "API_SERVER": f"http://127.0.0.1:{platform.server_address[1]}",
        "AUTH_TOKEN": "secret",
        "QUEUE_NAME": "queue",
        "CHALLENGE_PK": "7",
    }.items():
        monkeypatch.setenv(name, value)
    assert main(run) == 0
    assert len(platform.taken) == 1
