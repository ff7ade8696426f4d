"""Batches: the same bytes whatever happens, and nothing lost or counted twice."""

from __future__ import annotations

import csv
import errno
import filecmp
import json
import multiprocessing
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import load_result, load_rule_set, score_trial
from ariac_score.batch import address, pricing, supervise, worker
from ariac_score.batch.description import Shard
from ariac_score.batch.index import Row, read_rows
from ariac_score.batch.isolated import earlier_document, measure_isolated
from ariac_score.batch.local import LocalExecutor
from ariac_score.batch.merge import merge_batches
from ariac_score.batch.outcomes import OUTCOMES, Summary, summary_of
from ariac_score.batch.store import Store
from ariac_score.batch.supervise import Report, run_batch
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask, of_shard, plan_batch, shard
from ariac_score.batch.worker import Done, perform
from ariac_score.cli import main
from ariac_score.engine import measure
from ariac_score.engine.measure import needs_alike
from ariac_score.engine.prepared import prepare
from ariac_score.engine.price import price_trial
from ariac_score.errors import BatchError, NothingToScoreError, UsageError
from ariac_score.results.result_file import as_json
from ariac_score.scoring.ruleset import expanded_yaml, rule_set_from_text
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log

# What fresh processes do is named by a module that they can import, too.
sys.path.insert(0, str(Path(__file__).parent))
import batch_hands as hands

from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
COMPETITION = ROOT / "examples" / "competition" / "2024"
LIMITS = Limits(wall_s=120.0, memory_bytes=0)
RULES = "ariac2020.as_coded"


class Inline:
    """Scores in this process, so that tests can get a word in."""

    def __init__(self, out: Path) -> None:
        self.out = out

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """One after the other."""
        for task in tasks:
            yield perform(task, setting, self.out)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="session")
def trial_text(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("made") / "trial.jsonl"
    write_trial_log(file, kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    return file.read_text(encoding="utf-8")


@pytest.fixture
def trials(tmp_path: Path, trial_text: str) -> Path:
    """Four whole trials, one cut off, one that is no log at all."""
    folder = tmp_path / "trials"
    folder.mkdir()
    for name in ("a", "b", "c", "d_bad"):
        (folder / f"{name}.jsonl").write_text(trial_text, encoding="utf-8")
    (folder / "cut.jsonl").write_text(trial_text[:2000], encoding="utf-8")
    (folder / "note.txt").write_text("hello\n", encoding="utf-8")
    return folder


def batch(
    path: Path,
    out: Path,
    rules: str = RULES,
    *,
    executor: Callable[[Path, Path], supervise.Executor] | None = None,
    limits: Limits = LIMITS,
    part: tuple[int, int] = (1, 1),
    again: bool = False,
) -> Report:
    plan = plan_batch(path, rules)
    rule_set = load_rule_set(plan.rules)
    store = Store(out)
    own = None if part == (1, 1) else Shard(*part)
    with store.working() as work:
        chosen = executor(out, work) if executor else Inline(out)
        tasks = of_shard(plan.tasks, *part)
        setting = BatchSetting.of(rule_set, limits)
        return run_batch(tasks, rule_set, setting, store, work, chosen, name=plan.id, shard=own, again=again)


def local(target: Callable[..., None] = worker.perform_into) -> Callable[[Path, Path], LocalExecutor]:
    return lambda out, work: LocalExecutor(2, out, work, target)


def rows(out: Path) -> dict[str, Row]:
    lines = (out / "runs.jsonl").read_text(encoding="ascii").splitlines()
    found = [Row.from_line(line) for line in lines]
    return {"/".join(map(str, row.key)): row for row in found}


def outcomes(out: Path) -> dict[str, str]:
    return {name.removeprefix("/").removesuffix("/1"): row.summary.outcome for name, row in rows(out).items()}


def same(first: Path, second: Path) -> bool:
    """Whether two folders hold the same files with the same bytes; hidden ones count."""
    names = [sorted(p.relative_to(f).as_posix() for p in f.rglob("*")) for f in (first, second)]
    assert names[0] == names[1]
    files = [name for name in names[0] if (first / name).is_file()]
    _, differing, errors = filecmp.cmpfiles(first, second, files, shallow=False)
    assert (differing, errors) == ([], [])
    return True


AS_THEY_ARE = {
    "a.jsonl": "scored",
    "b.jsonl": "scored",
    "c.jsonl": "scored",
    "cut.jsonl": "unreadable",
    "d_bad.jsonl": "scored",
    "note.txt": "nothing_to_score",
}


# What comes out ------------------------------------------------------------------------


@pytest.mark.slow
def test_every_entry_of_a_folder_has_an_outcome_and_the_results_of_score(
    trials: Path, tmp_path: Path
) -> None:
    report = batch(trials, tmp_path / "out", executor=local())

    assert outcomes(tmp_path / "out") == AS_THEY_ARE
    assert (report.runs, report.scored_now, report.unsettled) == (6, 6, 2)
    stored = tmp_path / "out" / rows(tmp_path / "out")["/a.jsonl/1"].object
    assert stored.read_text(encoding="utf-8") == as_json(score_trial(trials / "a.jsonl", RULES))
    cut = rows(tmp_path / "out")["/cut.jsonl/1"].summary.reason
    assert cut.startswith("cut.jsonl")
    assert str(tmp_path) not in cut


@pytest.mark.slow
def test_it_makes_no_difference_where_how_many_or_in_which_order(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "inline")
    batch(trials, tmp_path / "local", executor=local())
    moved = tmp_path / "elsewhere" / "trials"
    shutil.copytree(trials, moved)
    batch(moved, tmp_path / "moved", executor=lambda out, work: LocalExecutor(1, out, work))

    assert same(tmp_path / "inline", tmp_path / "local")
    assert same(tmp_path / "inline", tmp_path / "moved")


@pytest.mark.slow
def test_shards_join_to_the_bytes_of_the_whole(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "whole")
    parts = [tmp_path / f"part{number}" for number in (1, 2, 3)]
    for number, part in enumerate(parts, start=1):
        batch(trials, part, part=(number, 3))
    for order in (parts, parts[::-1]):
        joined = tmp_path / f"joined_{order[0].name}"
        store = Store(joined)
        with store.working() as work:
            report = merge_batches(order, store, work)
        assert report.runs == 6
        assert same(tmp_path / "whole", joined)


@pytest.mark.slow
def test_a_competition_keeps_team_trial_and_run(tmp_path: Path) -> None:
    report = batch(COMPETITION, tmp_path / "out", rules="")

    assert report.runs == 45
    assert set(report.outcomes) == {"needs_cohort", "crashed", "cancelled"}
    crashed = [name for name, row in rows(tmp_path / "out").items() if row.summary.outcome == "crashed"]
    assert crashed == ["cygnus/mixed_tasks/4"]


@pytest.mark.slow
def test_the_index_says_what_the_lines_say(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out")
    connection = sqlite3.connect(tmp_path / "out" / "index.sqlite")
    scores = dict(connection.execute("SELECT trial, score FROM runs ORDER BY trial"))
    checks = connection.execute("SELECT sum(violated) FROM checks WHERE trial = 'a.jsonl'").fetchone()[0]
    connection.close()

    lines = {name[1:-2]: row.summary.score for name, row in rows(tmp_path / "out").items()}
    assert scores == lines
    assert scores["a.jsonl"] == float(score_trial(trials / "a.jsonl", RULES).score or 0)
    measured = score_trial(trials / "a.jsonl", RULES).measured.findings.values()
    assert checks == sum(1 for finding in measured if finding.verdict.value == "violated")


@pytest.mark.parametrize(
    ("field", "value"),
    [("team", None), ("trial", ["a"]), ("run", "1"), ("run", True), ("outcome", {}), ("object", 3)],
)
def test_a_line_whose_fields_are_of_other_kinds_is_no_row(field: str, value: object) -> None:
    row = Row.of(("", "a", 1), Summary("scored", "", 1.0, None), "objects/ab/cd/ef.json", "00")
    assert Row.from_line(row.as_line()) == row

    with pytest.raises(ValueError, match="no row"):
        Row.from_line(json.dumps({**json.loads(row.as_line()), field: value}))


def test_whatever_changes_among_the_files_of_a_run_changes_its_signature(tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / "below").mkdir(parents=True)
    (run / "below" / "log.txt").write_text("one")
    task = RunTask("", "run", 1, str(run))
    signatures = [address.signature_of(task)]

    def tell() -> None:
        signatures.append(address.signature_of(task))

    assert address.signature_of(task) == signatures[0]
    (run / "below" / "log.txt").write_text("other")
    tell()
    (run / "empty.txt").touch()
    tell()
    (run / "loop").symlink_to("loop")
    tell()
    (run / "elsewhere").symlink_to(tmp_path)
    tell()
    (run / "elsewhere").unlink()
    (run / "elsewhere").symlink_to(run / "below" / "log.txt")
    tell()
    shutil.rmtree(run)
    tell()
    assert len(set(signatures)) == len(signatures) == 7


def test_the_signature_of_a_relative_path_is_that_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "log.txt").touch()
    signatures = []
    for name in ("here", "there"):
        monkeypatch.chdir(tmp_path / name)
        signatures.append(address.signature_of(RunTask("", "a", 1, "log.txt")))

    assert signatures[0] != signatures[1]


# Going on ------------------------------------------------------------------------------


def test_a_second_call_does_nothing_again(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch(trials, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    monkeypatch.setattr(worker, "contents_of", lambda _task: pytest.fail("it was read again"))

    report = batch(trials, tmp_path / "out")

    assert report.scored_now == 0
    assert same(tmp_path / "before", tmp_path / "out")


def test_without_the_cache_files_are_hashed_again_and_nothing_else(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch(trials, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    shutil.rmtree(tmp_path / "cache")
    scored: list[str] = []
    whole = worker.score_trial
    monkeypatch.setattr(
        worker, "score_trial", lambda path, *a, **k: (scored.append(path.name), whole(path, *a, **k))[1]
    )

    batch(trials, tmp_path / "out")

    assert sorted(scored) == ["cut.jsonl", "note.txt"]  # there is no result of these to be found
    assert same(tmp_path / "before", tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("lines", [1, 3, 5])
@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGINT])
def test_whatever_ends_a_batch_the_next_call_goes_on(
    trials: Path, tmp_path: Path, ending: signal.Signals, lines: int
) -> None:
    batch(trials, tmp_path / "undisturbed")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "ariac_score.cli", "batch", str(trials), "--rules", RULES, "-j", "1"]
    with subprocess.Popen([*command, "-o", str(out)], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        seen = [process.stderr.readline() for _ in range(lines)]
        process.send_signal(ending)
        said = process.stderr.read()
    assert len(seen) == lines

    report = batch(trials, out)

    assert same(tmp_path / "undisturbed", out)
    assert report.runs == 6
    if ending == signal.SIGINT and process.returncode == 2:
        assert "the same command goes on" in said


@pytest.mark.slow
def test_a_full_disk_ends_the_batch_and_loses_nothing(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    batch(trials, tmp_path / "undisturbed")
    put, room = Store.put, iter(range(5))

    def full(self: Store, place: Path, document: bytes) -> None:
        if next(room, None) is None:
            raise OSError(errno.ENOSPC, "No space left on device")
        put(self, place, document)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "put", full)
        with pytest.raises(BatchError, match="the disk is full") as caught:
            batch(trials, tmp_path / "out")
    assert caught.value.exit_code == 7
    assert "call again" in caught.value.hint
    assert not (tmp_path / "out" / "runs.jsonl").exists()

    report = batch(trials, tmp_path / "out")

    assert report.scored_now < 6
    assert same(tmp_path / "undisturbed", tmp_path / "out")


def test_a_document_is_whole_or_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path)
    place = store.place("ab" * 32, "cd" * 32)

    def fails(self: Path, _target: Path) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(OSError, match="No space"):
        store.put(place, b"document")

    assert list(place.parent.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["gone", "cut", "forged", "empty"])
def test_a_stored_result_that_is_not_what_the_index_says_is_made_again(
    trials: Path, tmp_path: Path, damage: str
) -> None:
    batch(trials, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    stored = tmp_path / "out" / rows(tmp_path / "out")["/b.jsonl/1"].object
    text = stored.read_text(encoding="utf-8")
    if damage == "gone":
        stored.unlink()
    else:
        forged = text.replace(f'"score": {json.loads(text)["score"]}', '"score": 99.0')
        assert forged != text
        stored.write_text({"cut": text[:-20], "forged": forged, "empty": ""}[damage], encoding="utf-8")

    batch(trials, tmp_path / "out")

    assert same(tmp_path / "before", tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["", "hashes", "runs.jsonl"])
def test_a_forged_result_from_which_all_follows_is_scored_again_from_its_log(
    trials: Path, tmp_path: Path, lost: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch(trials, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    stored = tmp_path / "out" / rows(tmp_path / "out")["/b.jsonl/1"].object
    result = load_result(stored)
    findings = {key: replace(one, message="kept") for key, one in result.measured.findings.items()}
    measured = replace(result.measured, findings=findings, trial="better")
    forged = as_json(price_trial(measured, load_rule_set(RULES), result.provenance))
    stored.write_text(forged, encoding="utf-8")
    load_result(stored)  # nothing in it says that it is forged
    if lost == "runs.jsonl":
        (tmp_path / "out" / lost).unlink()
    if lost == "hashes":
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "another"))

    batch(trials, tmp_path / "out")

    assert same(tmp_path / "before", tmp_path / "out")


def rewrite(out: Path, document: str) -> None:
    """Put another document in the place of the result of b.jsonl, and all that the tables say of it."""
    own = rows(out)["/b.jsonl/1"]
    (out / own.object).write_text(document, encoding="utf-8")
    forged = Row.kept(own.key, document.encode("utf-8"), own.object)
    lines = [forged if row.key == own.key else row for row, _ in read_rows(out / "runs.jsonl")]
    (out / "runs.jsonl").write_text("".join(row.as_line() for row in lines), encoding="ascii")


@pytest.mark.slow
@pytest.mark.parametrize(("forged", "elsewhere"), [("score", True), ("finding, priced again", False)])
def test_a_result_that_was_rewritten_with_its_row_is_scored_again_from_its_log(
    trials: Path, tmp_path: Path, forged: str, elsewhere: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch(trials, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    stored = tmp_path / "out" / rows(tmp_path / "out")["/b.jsonl/1"].object
    text, result = stored.read_text(encoding="utf-8"), load_result(stored)
    if forged == "score":
        rewrite(tmp_path / "out", text.replace(f'"score": {json.loads(text)["score"]}', '"score": 99.0'))
    else:
        findings = {key: replace(one, message="kept") for key, one in result.measured.findings.items()}
        measured = replace(result.measured, findings=findings)
        rewrite(tmp_path / "out", as_json(price_trial(measured, load_rule_set(RULES), result.provenance)))
    if elsewhere:
        # A machine that never saw the true one takes a signature to find a forgery from which all follows.
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "another"))

    batch(trials, tmp_path / "out")

    assert same(tmp_path / "before", tmp_path / "out")


def test_a_score_that_was_rewritten_with_its_row_is_not_joined(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out")
    stored = tmp_path / "out" / rows(tmp_path / "out")["/b.jsonl/1"].object
    text = stored.read_text(encoding="utf-8")
    rewrite(tmp_path / "out", text.replace(f'"score": {json.loads(text)["score"]}', '"score": 99.0'))
    (tmp_path / "out" / "index.sqlite").unlink()

    with pytest.raises(BatchError, match=r"is 99\.0|does not follow|add up"):
        joined([tmp_path / "out"], tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("table", ["runs.jsonl", "index.sqlite"])
@pytest.mark.parametrize("content", [None, b"", b"nonsense \xff\n{}\n"])
def test_tables_that_are_lost_or_damaged_are_made_again(
    trials: Path, tmp_path: Path, table: str, content: bytes | None
) -> None:
    batch(trials, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    (tmp_path / "out" / table).unlink()
    if content is not None:
        (tmp_path / "out" / table).write_bytes(content)

    batch(trials, tmp_path / "out")

    assert same(tmp_path / "before", tmp_path / "out")


def forge_line(out: Path) -> None:
    """Another score in the table; place and hash of the document stay."""
    lines = [json.loads(line) for line in (out / "runs.jsonl").read_text(encoding="ascii").splitlines()]
    (scored, *_) = [line for line in lines if line["outcome"] == "scored"]
    scored["score"] = 99.0
    (out / "runs.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="ascii")


def forge_index(out: Path) -> None:
    """Another score in the index alone."""
    connection = sqlite3.connect(out / "index.sqlite")
    connection.execute("UPDATE runs SET score = 99 WHERE trial = 'b.jsonl'")
    connection.commit()
    connection.close()


def lose_a_check(out: Path) -> None:
    """A check of one run less in the index."""
    connection = sqlite3.connect(out / "index.sqlite")
    connection.execute(
        "DELETE FROM checks WHERE trial = 'c.jsonl' AND name IN (SELECT max(name) FROM checks)"
    )
    connection.commit()
    connection.close()


def test_a_folder_that_lets_nobody_write_is_named(trials: Path, tmp_path: Path) -> None:
    (tmp_path / "out" / ".lock").mkdir(parents=True)
    with pytest.raises(UsageError, match="cannot be written") as caught:
        batch(trials, tmp_path / "out")
    assert caught.value.file == str(tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("forge", [forge_line, forge_index, lose_a_check])
def test_tables_that_contradict_the_documents_are_made_again_and_it_is_said(
    trials: Path, tmp_path: Path, forge: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    assert batch(trials, tmp_path / "out").contradictions == 0
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    forge(tmp_path / "out")

    assert main(["batch", str(trials), "--rules", RULES, "-j", "1", "-o", str(tmp_path / "out")]) == 6

    assert "1 row of the tables contradicted the stored results" in capsys.readouterr().out
    assert same(tmp_path / "before", tmp_path / "out")
    assert batch(trials, tmp_path / "out").contradictions == 0


@pytest.mark.parametrize("forge", [forge_line, forge_index, lose_a_check])
def test_tables_that_contradict_the_documents_are_neither_exported_nor_joined(
    trials: Path, tmp_path: Path, forge: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    batch(trials, tmp_path / "out")
    forge(tmp_path / "out")

    for name in ("t.csv", "t.parquet"):
        assert main(["export", str(tmp_path / "out"), "-o", str(tmp_path / name)]) == 7
        assert not (tmp_path / name).exists()
    assert "call 'batch' again" in capsys.readouterr().err
    with pytest.raises(BatchError, match=r"contradicts its document|contradicts runs\.jsonl"):
        joined([tmp_path / "out"], tmp_path / "whole")


def test_a_line_that_is_no_row_is_not_passed_over_when_joining(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out")
    table = tmp_path / "out" / "runs.jsonl"
    table.write_text(table.read_text(encoding="ascii")[:-20], encoding="ascii")

    with pytest.raises(BatchError, match="no row of a run"):
        joined([tmp_path / "out"], tmp_path / "whole")


def test_a_changed_log_is_scored_again_and_the_old_result_stays(
    trials: Path, tmp_path: Path, trial_text: str
) -> None:
    batch(trials, tmp_path / "out")
    before = rows(tmp_path / "out")["/a.jsonl/1"]
    changed = trial_text.replace('"gear_part_blue"', '"gear_part_red"')
    assert changed != trial_text
    (trials / "a.jsonl").write_text(changed, encoding="utf-8")

    report = batch(trials, tmp_path / "out")

    assert report.scored_now == 1
    assert rows(tmp_path / "out")["/a.jsonl/1"].object != before.object
    assert (tmp_path / "out" / before.object).is_file()


def test_a_run_that_is_new_is_scored_and_one_that_is_gone_leaves_the_tables(
    trials: Path, tmp_path: Path, trial_text: str
) -> None:
    batch(trials, tmp_path / "out")
    (trials / "a.jsonl").unlink()
    (trials / "z.jsonl").write_text(trial_text, encoding="utf-8")

    report = batch(trials, tmp_path / "out")

    assert (report.runs, report.scored_now) == (6, 1)
    assert "z.jsonl" in outcomes(tmp_path / "out")
    assert "a.jsonl" not in outcomes(tmp_path / "out")


# Other rules ---------------------------------------------------------------------------


def rules(folder: Path, name: str, text: str) -> str:
    file = folder / f"{name}.yaml"
    file.write_text(text, encoding="utf-8")
    return str(file)


def _own(folder: Path, name: str, *, price: int = 1, tolerance: float | None = None) -> str:
    data = yaml.safe_load(expanded_yaml(load_rule_set(RULES)))
    data["score"] = f"{price} * ({data['score']})"
    if tolerance is not None:
        data["parameters"]["tolerance"]["distance"]["value"] = tolerance
    return rules(folder, name, yaml.safe_dump(data, sort_keys=False))


@pytest.mark.slow
def test_other_prices_are_put_on_what_was_measured(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2)
    batch(trials, tmp_path / "fresh", second)
    batch(trials, tmp_path / "out", first)
    measured: list[str] = []
    whole = worker.score_trial
    monkeypatch.setattr(
        worker, "score_trial", lambda path, *a, **k: (measured.append(path.name), whole(path, *a, **k))[1]
    )

    batch(trials, tmp_path / "out", second)

    assert sorted(measured) == ["cut.jsonl", "note.txt"]
    for name, row in rows(tmp_path / "fresh").items():
        assert row == rows(tmp_path / "out")[name]
        stored = [tmp_path / folder / row.object for folder in ("fresh", "out")]
        assert stored[0].read_bytes() == stored[1].read_bytes()


def _same_results(first: Path, second: Path) -> bool:
    for name, row in rows(first).items():
        assert row == rows(second)[name]
        assert (first / row.object).read_bytes() == (second / row.object).read_bytes()
    return True


@pytest.mark.slow
@pytest.mark.parametrize("lost", [1, 2, 10])
def test_prices_are_put_on_results_by_others_when_processes_for_that_die(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: int
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2)
    batch(trials, tmp_path / "fresh", second)
    batch(trials, tmp_path / "out", first)
    start, dying = pricing.started, iter(range(lost))

    def dies(*arguments: Any) -> Any:
        process = start(*arguments)
        if next(dying, None) is not None:
            process.kill()
        return process

    monkeypatch.setattr(pricing, "_AT_A_TIME", 1)
    monkeypatch.setattr(pricing, "_AHEAD", 2)
    monkeypatch.setattr(pricing, "usable_cores", lambda: 2)
    monkeypatch.setattr(pricing, "started", dies)

    report = batch(trials, tmp_path / "out", second)

    assert report.runs == 6
    assert _same_results(tmp_path / "fresh", tmp_path / "out")


@pytest.mark.slow
def test_results_are_looked_at_again_when_the_processes_for_prices_never_answer(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2)
    batch(trials, tmp_path / "fresh", second)
    batch(trials, tmp_path / "out", first)
    start = pricing.started

    def stops(*arguments: Any) -> Any:
        process = start(*arguments)
        os.kill(process.pid, signal.SIGSTOP)
        return process

    monkeypatch.setattr(pricing, "usable_cores", lambda: 1)
    monkeypatch.setattr(pricing, "started", stops)
    monkeypatch.setattr(pricing, "_GOING_S", 0.1)
    monkeypatch.setattr(pricing, "_AT_LEAST_S", 1.0)

    report = batch(trials, tmp_path / "out", second, limits=Limits(wall_s=5.0, memory_bytes=0))

    assert report.runs == 6
    assert _same_results(tmp_path / "fresh", tmp_path / "out")


@pytest.mark.slow
def test_a_result_that_cannot_be_written_beside_the_other_ends_the_batch(
    trials: Path, tmp_path: Path
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2)
    batch(trials, tmp_path / "fresh", second)
    batch(trials, tmp_path / "out", first)
    before = tmp_path / "out" / rows(tmp_path / "out")["/b.jsonl/1"].object
    taken = before.parent / f"{load_rule_set(second).sha256[:16]}.json"
    taken.mkdir()

    with pytest.raises(BatchError, match="cannot be written") as caught:
        batch(trials, tmp_path / "out", second)

    assert caught.value.exit_code == 7
    assert not list((tmp_path / "out").rglob(".part-*"))
    taken.rmdir()
    batch(trials, tmp_path / "out", second)
    assert _same_results(tmp_path / "fresh", tmp_path / "out")


@pytest.mark.slow
def test_no_price_is_put_on_a_forged_result(trials: Path, tmp_path: Path) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2)
    batch(trials, tmp_path / "fresh", second)
    batch(trials, tmp_path / "out", first)
    _forge(tmp_path / "out")

    report = batch(trials, tmp_path / "out", second)

    assert report.scored_now == 6
    assert _same_results(tmp_path / "fresh", tmp_path / "out")


def test_a_process_for_prices_ends_when_nobody_is_left_to_ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pricing.signal, "signal", lambda *_: None)
    ours, its = multiprocessing.Pipe()
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS)
    ours.send([(("", "a", 1), "ab" * 32, "none.json", "")])
    ours.close()

    pricing._serve(its, setting, str(tmp_path / "out"))


@pytest.mark.slow
def test_another_parameter_of_a_check_measures_again(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", tolerance=0.5)
    batch(trials, tmp_path / "out", first)
    before = rows(tmp_path / "out")["/a.jsonl/1"]

    report = batch(trials, tmp_path / "out", second)

    assert report.scored_now == 6
    after = rows(tmp_path / "out")["/a.jsonl/1"]
    assert after.object.split("/")[2] != before.object.split("/")[2]
    assert after.summary.score != before.summary.score


def _asked(patch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Which checks are asked from now on, about which trial."""
    asked: list[tuple[str, str]] = []
    whole = measure.ask_worlds

    def ask(plugin: Any, name: str, check: Any, trial: Any, **others: Any) -> Any:
        asked.append((name, trial.id))
        return whole(plugin, name, check, trial, **others)

    patch.setattr(measure, "ask_worlds", ask)
    return asked


@pytest.mark.slow
def test_only_checks_whose_parameters_changed_are_asked_again(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2, tolerance=0.5)
    batch(trials, tmp_path / "fresh", second)
    batch(trials, tmp_path / "out", first)
    asked = _asked(monkeypatch)

    report = batch(trials, tmp_path / "out", second)

    assert {name for name, _ in asked} == {"part_pose"}
    assert len(asked) == 4
    assert report.scored_now == 6
    for name, row in rows(tmp_path / "fresh").items():
        assert row == rows(tmp_path / "out")[name]
        stored = [tmp_path / folder / row.object for folder in ("fresh", "out")]
        assert stored[0].read_bytes() == stored[1].read_bytes()


@pytest.mark.slow
def test_back_to_rules_of_before_only_what_differs_is_asked(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", tolerance=0.5)
    batch(trials, tmp_path / "out", first)
    before = rows(tmp_path / "out")
    batch(trials, tmp_path / "out", second)
    asked = _asked(monkeypatch)

    batch(trials, tmp_path / "out", first)

    # The results of before lie there still, but no table vouches for them any more.
    assert {check for check, _ in asked} == {"part_pose"}
    assert rows(tmp_path / "out") == before


def _another_log(trials: Path, out: Path, _patch: pytest.MonkeyPatch) -> None:
    del out
    for name in ("a", "b", "c", "d_bad"):
        file = trials / f"{name}.jsonl"
        file.write_text(file.read_text(encoding="utf-8").replace('"t_s": 40.0', '"t_s": 40.5'), "utf-8")
        file.touch()


def _other_code(_trials: Path, _out: Path, patch: pytest.MonkeyPatch) -> None:
    """As after an update of a plugin, a reader or the engine: its file has another hash."""
    whole = address.code_of
    worker.prepared.cache_clear()
    patch.setattr(address, "code_of", lambda *a: (*whole(*a), ("plugins", "1.0", "some_plugin", "0" * 64)))


def _forged(_trials: Path, out: Path, _patch: pytest.MonkeyPatch) -> None:
    _forge(out)


def _forge(out: Path) -> None:
    for file in out.glob("objects/*/*/*.json"):
        file.write_text(file.read_text(encoding="utf-8").replace('"violated"', '"satisfied"'), "utf-8")


def _other_log_map(trials: Path, _out: Path, _patch: pytest.MonkeyPatch) -> None:
    shipped = (ROOT / "rules" / "ariac2020" / "log_map.yaml").read_text(encoding="utf-8")
    (trials.parent / "own_map.yaml").write_text(f"{shipped}\n# changed\n", encoding="utf-8")
    file = trials.parent / "second.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("log_map: ariac2020", "log_map: own_map.yaml"), encoding="utf-8")
    assert load_rule_set(str(file)).log_map == "own_map.yaml"


class Interrupted(Inline):
    """Somebody presses Ctrl-C after two runs."""

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """One after the other, and no more than two."""
        yield from islice(super().run(tasks, setting), 2)
        raise KeyboardInterrupt


@pytest.mark.slow
@pytest.mark.parametrize("calls", [1, 3])
def test_a_call_that_is_interrupted_while_it_measures_again_goes_on_with_what_it_knew(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: int
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", price=2, tolerance=0.5)
    batch(trials, tmp_path / "whole", first)
    batch(trials, tmp_path / "whole", second)
    batch(trials, tmp_path / "out", first)
    asked = _asked(monkeypatch)

    for _ in range(calls):
        with pytest.raises(KeyboardInterrupt):
            batch(trials, tmp_path / "out", second, executor=lambda out, _work: Interrupted(out))
    batch(trials, tmp_path / "out", second)

    assert {name for name, _ in asked} == {"part_pose"}
    assert len(asked) == 4
    assert same(tmp_path / "whole", tmp_path / "out")


@pytest.mark.slow
def test_rules_of_before_an_interruption_are_of_use_to_others_still(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", tolerance=0.5)
    third = _own(tmp_path, "third", tolerance=0.25)
    batch(trials, tmp_path / "fresh", third)
    batch(trials, tmp_path / "out", first)
    with pytest.raises(KeyboardInterrupt):
        batch(trials, tmp_path / "out", second, executor=lambda out, _work: Interrupted(out))
    asked = _asked(monkeypatch)

    batch(trials, tmp_path / "out", third)

    # Of the two runs that the interrupted call measured, the tables know what these measured.
    checks = len(load_rule_set(third).checks)
    assert len(asked) <= 2 + 2 * checks
    assert not (tmp_path / "out" / ".rules-before.yaml").exists()
    for name, row in rows(tmp_path / "fresh").items():
        assert row == rows(tmp_path / "out")[name]


@pytest.mark.slow
@pytest.mark.parametrize("change", [_another_log, _other_code, _forged, _other_log_map])
def test_what_was_measured_of_something_else_or_by_other_code_is_not_used(
    trials: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[Path, Path, pytest.MonkeyPatch], None],
) -> None:
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", tolerance=0.5)
    batch(trials, tmp_path / "out", first)
    change(trials, tmp_path / "out", monkeypatch)
    asked = _asked(monkeypatch)

    batch(trials, tmp_path / "out", second)

    checks = set(load_rule_set(second).checks)
    assert {name for name, _ in asked} == checks
    assert len(asked) == 4 * len(checks)
    worker.prepared.cache_clear()


def test_rules_that_ask_for_other_signals_share_no_measurement() -> None:
    first = load_rule_set("paper2020.published")
    again = rule_set_from_text(expanded_yaml(first), file=first.file)

    assert needs_alike(prepare(first), prepare(replace(again, file=first.file)))
    assert not needs_alike(prepare(first), prepare("ariac2024.official"))
    assert not needs_alike(prepare(first), prepare(RULES))


# What goes wrong in a process ------------------------------------------------------------


@pytest.mark.slow
def test_a_process_that_somebody_kills_costs_its_run_nothing(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "undisturbed")

    batch(trials, tmp_path / "out", executor=local(hands.dies_at_first))

    for marks in (tmp_path / "out").glob("marks-*"):
        assert len(list(marks.iterdir())) == 4  # each was killed three times
        shutil.rmtree(marks)
    assert same(tmp_path / "undisturbed", tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "outcome", "reason"),
    [
        (
            hands.crashes,
            "killed",
            "the process that scored it ended by signal 11 (SIGSEGV), 2 times in 2 times",
        ),
        (hands.leaves, "killed", "the process that scored it ended with exit code 0, 2 times in 2 times"),
        pytest.param(
            hands.never_ends,
            "timed_out",
            "it took longer than 10 s; raise --time-limit-s if the log is sound",
            marks=pytest.mark.slow,  # it waits for its end
        ),
        (hands.devours, "out_of_memory", "raise --memory-mb if the log is sound"),
        (hands.has_a_devouring_plugin, "out_of_memory", "raise --memory-mb if the log is sound"),
        (
            hands.dies_of_both,
            "killed",
            "the process that scored it ended by signal 11 (SIGSEGV), 2 times in 2 times",
        ),
        (hands.raises, "failed", "ZeroDivisionError: division by zero"),
    ],
)
def test_what_one_run_does_costs_that_run_alone(
    trials: Path, tmp_path: Path, target: Callable[..., None], outcome: str, reason: str
) -> None:
    limits = Limits(wall_s=10.0, memory_bytes=4 << 30)
    report = batch(trials, tmp_path / "out", executor=local(target), limits=limits)

    assert outcomes(tmp_path / "out") == {**AS_THEY_ARE, "d_bad.jsonl": outcome}
    assert rows(tmp_path / "out")["/d_bad.jsonl/1"].summary.reason.endswith(reason)
    assert report.unsettled == 3
    assert batch(trials, tmp_path / "out").scored_now == 0  # it is known, and not tried for ever

    batch(trials, tmp_path / "out", again=True)

    assert outcomes(tmp_path / "out") == AS_THEY_ARE


def test_a_result_beyond_its_size_is_an_outcome(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out", limits=Limits(output_bytes=1000, memory_bytes=0))

    assert outcomes(tmp_path / "out")["a.jsonl"] == "too_large"
    assert "at most 1000 are kept" in rows(tmp_path / "out")["/a.jsonl/1"].summary.reason


def test_a_log_that_is_still_being_written_is_looked_at_again(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = worker.score_trial

    def meanwhile(path: Path, *arguments: object, **options: object) -> object:
        result = whole(path, *arguments, **options)  # type: ignore[arg-type]
        if path.name == "a.jsonl":
            with path.open("a", encoding="utf-8") as log:
                log.write("\n")
        if path.name == "b.jsonl":
            path.unlink()
        return result

    with monkeypatch.context() as patch:
        patch.setattr(worker, "score_trial", meanwhile)
        batch(trials, tmp_path / "out")
    found = outcomes(tmp_path / "out")
    assert (found["a.jsonl"], found["b.jsonl"]) == ("changing", "changing")
    assert rows(tmp_path / "out")["/a.jsonl/1"].object == ""  # nothing is kept of it

    report = batch(trials, tmp_path / "out")

    assert report.scored_now == 1
    assert outcomes(tmp_path / "out")["a.jsonl"] == "scored"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_nobody_may_read_is_an_outcome(trials: Path, tmp_path: Path) -> None:
    (trials / "a.jsonl").chmod(0)
    batch(trials, tmp_path / "out")

    assert outcomes(tmp_path / "out")["a.jsonl"] == "unreadable"


# Elsewhere -----------------------------------------------------------------------------


@pytest.mark.slow
def test_a_cluster_gives_the_bytes_of_one_machine(trials: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    from ariac_score.batch.dask import dask_executor  # noqa: PLC0415  # of that extra

    batch(trials, tmp_path / "here")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=True, dashboard_address=":0", host="127.0.0.1"
    ) as cluster:
        batch(
            trials,
            tmp_path / "there",
            executor=lambda out, work: dask_executor(
                jobs=0, scheduler=cluster.scheduler_address, out=out, work=work
            ),
        )

    assert same(tmp_path / "here", tmp_path / "there")


@pytest.mark.slow
def test_a_worker_that_sees_no_folder_asks_only_the_checks_that_changed(trials: Path, tmp_path: Path) -> None:
    first, second = (
        load_rule_set(_own(tmp_path, n, tolerance=t)) for n, t in (("first", None), ("second", 0.5))
    )
    batch(trials, tmp_path / "out", first.file)
    row = rows(tmp_path / "out")["/a.jsonl/1"]
    said, ours = b"the log records no arm collision", b"as it was sent along"
    document = (tmp_path / "out" / row.object).read_bytes()
    assert said in document
    document = document.replace(said, ours)
    task = RunTask("", "a.jsonl", 1, str(trials / "a.jsonl"), earlier=row.object)
    task = replace(task, earlier_sha256=sha256(document).hexdigest())
    setting = replace(BatchSetting.of(second, LIMITS), earlier_basis=address.basis_of(prepare(first)))

    with_it, without = (measure_isolated(task, setting, earlier).document for earlier in (document, b""))
    other = measure_isolated(replace(task, earlier_sha256="0" * 64), setting, document).document

    assert with_it is not None
    assert ours in with_it
    assert without == other == with_it.replace(ours, said)


@pytest.mark.slow
def test_what_is_stored_already_is_not_made_by_a_worker_that_is_sent_it(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out")
    row = rows(tmp_path / "out")["/a.jsonl/1"]
    task = RunTask("", "a.jsonl", 1, str(trials / "a.jsonl"), earlier=row.object, earlier_sha256=row.sha256)
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS)

    done = measure_isolated(task, setting, earlier_document(task, tmp_path / "out"))

    assert done.document is None
    assert Path(row.object).parent.name == done.address
    assert earlier_document(task, None) == earlier_document(replace(task, earlier=""), tmp_path) == b""
    assert earlier_document(task, tmp_path / "elsewhere") == b""


@pytest.mark.slow
def test_a_cluster_measures_again_to_the_bytes_of_one_machine(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    from ariac_score.batch import dask  # noqa: PLC0415  # of that extra

    sent: list[int] = []
    whole = dask.earlier_document
    monkeypatch.setattr(dask, "earlier_document", lambda *a: (found := whole(*a), sent.append(len(found)))[0])
    first, second = _own(tmp_path, "first"), _own(tmp_path, "second", tolerance=0.5)
    for folder in ("here", "there"):
        batch(trials, tmp_path / folder, first)
    batch(trials, tmp_path / "here", second)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        address_ = cluster.scheduler_address
        make = lambda out, work: dask.dask_executor(jobs=0, scheduler=address_, out=out, work=work)  # noqa: E731
        batch(trials, tmp_path / "there", second, executor=make)

    assert len(sent) == 6
    assert all(sent)
    assert same(tmp_path / "here", tmp_path / "there")


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_named(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    from ariac_score.batch import dask  # noqa: PLC0415  # of that extra

    monkeypatch.setattr(dask, "_CONNECT_S", 0.2)
    for scheduler, cause in (("", "needs a scheduler"), ("tcp://127.0.0.1:9", "cannot be reached")):
        with pytest.raises(UsageError, match=cause):
            dask.dask_executor(jobs=0, scheduler=scheduler, out=tmp_path, work=tmp_path)
    with pytest.raises(UsageError, match="the workers decide how many runs"):
        dask.dask_executor(jobs=2, scheduler="tcp://127.0.0.1:9", out=tmp_path, work=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "outcome"), [("a.jsonl", "scored"), ("gone.jsonl", "unreachable")])
def test_a_run_named_by_a_uri_is_fetched_where_it_is_scored(
    trials: Path, tmp_path: Path, name: str, outcome: str
) -> None:
    pytest.importorskip("fsspec", reason="the extra 'remote' is not installed")
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS)

    done = measure_isolated(RunTask("", name, 1, f"file://{trials / name}"), setting)

    assert done.document is not None
    found = summary_of(done.document)
    assert found.outcome == outcome
    if outcome == "scored":
        assert done.document.decode() == as_json(score_trial(trials / name, RULES))
    else:
        assert "no such file or folder; check the address" in found.reason


# What becomes of it --------------------------------------------------------------------


@pytest.mark.slow
def test_a_batch_is_ranked_as_its_logs_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    batch(COMPETITION, tmp_path / "out", rules="")
    command = ["rank", str(COMPETITION), "--output-format", "json"]

    assert main(command) == main([*command, "--batch", str(tmp_path / "out")])

    said = capsys.readouterr().out
    first, second = said[: len(said) // 2], said[len(said) // 2 :]
    assert first == second


@pytest.mark.slow
def test_a_batch_of_other_rules_or_other_runs_is_not_ranked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(COMPETITION, tmp_path / "in")
    batch(tmp_path / "in", tmp_path / "out", rules="")
    command = ["rank", str(tmp_path / "in"), "--batch", str(tmp_path / "out")]
    assert main([*command, "--rules", "ariac2024.release_5"]) == 4
    assert "put the new prices on it first" in capsys.readouterr().err
    shutil.copytree(tmp_path / "in/logs/aurora/kitting_1", tmp_path / "in/logs/aurora/kitting_9")
    assert main(command) == 4
    assert "1 run is not in it: aurora/kitting/9" in capsys.readouterr().err
    assert main(["rank", str(tmp_path / "in"), "--batch", str(tmp_path / "in")]) == 4
    assert "this is no folder of a batch" in capsys.readouterr().err


@pytest.mark.slow
def test_tables_are_exported_with_every_row_and_no_formula(trials: Path, tmp_path: Path) -> None:
    (trials / "a.jsonl").rename(trials / "=cmd().jsonl")
    batch(trials, tmp_path / "out")
    assert main(["export", str(tmp_path / "out"), "-o", str(tmp_path / "runs.csv")]) == 0
    with (tmp_path / "runs.csv").open(encoding="utf-8", newline="") as text:
        table = list(csv.DictReader(text))
    assert [row["trial"] for row in table][:2] == ["'=cmd().jsonl", "b.jsonl"]
    assert {row["trial"]: row["outcome"] for row in table}["cut.jsonl"] == "unreadable"
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet' is not installed")
    file = tmp_path / "checks.parquet"
    assert main(["export", str(tmp_path / "out"), "--table", "checks", "-o", str(file)]) == 0
    connection = sqlite3.connect(tmp_path / "out" / "index.sqlite")
    (count,) = connection.execute("SELECT count(*) FROM checks").fetchone()
    connection.close()
    assert parquet.read_table(file).num_rows == count > 0


def test_a_folder_without_a_batch_has_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(tmp_path)]) == 4
    assert "call 'batch' again" in capsys.readouterr().err


# What is refused -----------------------------------------------------------------------


@pytest.mark.parametrize("text", ["", "0/3", "4/3", "1", "1/0", "a/b", "-1/3", "1/3/3", "1.0/3"])
def test_what_is_no_shard_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is no shard"):
        shard(text)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 50])
def test_every_task_is_in_exactly_one_shard(count: int) -> None:
    tasks = [RunTask("", str(number), 1, str(number)) for number in range(23)]
    parts = [list(of_shard(tasks, number, count)) for number in range(1, count + 1)]

    assert sorted(task.trial for part in parts for task in part) == sorted(task.trial for task in tasks)


def test_a_folder_without_rules_or_entries_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no rule set is given"):
        plan_batch(tmp_path)
    with pytest.raises(NothingToScoreError, match="the folder is empty"):
        plan_batch(tmp_path, RULES)
    with pytest.raises(NothingToScoreError, match="no such file or folder"):
        plan_batch(tmp_path / "gone", RULES)


@pytest.mark.slow
def test_two_runs_with_one_number_are_both_refused_by_name(tmp_path: Path) -> None:
    shutil.copytree(COMPETITION, tmp_path / "in")
    runs = tmp_path / "in/logs/aurora"
    shutil.copytree(runs / "kitting_1", runs / "kitting_01")
    report = batch(tmp_path / "in", tmp_path / "out", rules="")

    assert report.outcomes["refused"] == 1
    (row,) = [r for r in rows(tmp_path / "out").values() if r.summary.outcome == "refused"]
    assert (row.key, row.object) == (("aurora", "kitting", 1), "")
    assert "2 runs have the number 1" in row.summary.reason


def test_two_batches_never_write_into_one_folder(trials: Path, tmp_path: Path) -> None:
    store = Store(tmp_path / "out")
    with store.working(), pytest.raises(UsageError, match="another batch is writing here"):
        batch(trials, tmp_path / "out")


@pytest.mark.parametrize("arguments", [["-j", "-1"], ["--time-limit-s", "0"], ["--shard", "3/2"]])
def test_a_senseless_argument_is_a_usage_error(
    trials: Path, tmp_path: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["batch", str(trials), "--rules", RULES, "-o", str(tmp_path / "out"), *arguments]) == 4
    assert "hint:" in capsys.readouterr().err


def test_a_batch_may_not_lie_among_its_own_trials(
    trials: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for output in (trials, trials / "out"):
        assert main(["batch", str(trials), "--rules", RULES, "-o", str(output)]) == 4
        assert "among the trials it scores" in capsys.readouterr().err


def test_an_executor_nobody_brings_is_refused_with_the_installed_ones(
    trials: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["batch", str(trials), "--rules", RULES, "-o", str(tmp_path / "out"), "--executor", "locl"]
    assert main(command) == 4
    assert "did you mean 'local'?" in capsys.readouterr().err


# Joining -------------------------------------------------------------------------------


def halves(trials: Path, folder: Path, second_rules: str = RULES) -> list[Path]:
    parts = [folder / "part1", folder / "part2"]
    for number, (part, by) in enumerate(zip(parts, (RULES, second_rules), strict=True), start=1):
        batch(trials, part, by, part=(number, 2))
    return parts


def joined(parts: list[Path], out: Path, *, mixed_code: bool = False) -> Report:
    store = Store(out)
    with store.working() as work:
        return merge_batches(parts, store, work, mixed_code=mixed_code)


def test_a_part_whose_rules_are_not_those_it_states_is_not_joined(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out")
    rules = tmp_path / "out/rules.yaml"
    rules.write_text(rules.read_text(encoding="utf-8") + "# edited\n", encoding="utf-8")

    with pytest.raises(UsageError, match="and the part states"):
        joined([tmp_path / "out"], tmp_path / "whole")


def describe(part: Path, **changes: object) -> None:
    file = part / "batch.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}), encoding="utf-8")


def test_a_description_that_is_damaged_is_written_anew(trials: Path, tmp_path: Path) -> None:
    batch(trials, tmp_path / "out")
    file = tmp_path / "out/batch.json"
    before = file.read_bytes()
    file.write_bytes(b"\xff" + before)

    assert batch(trials, tmp_path / "out").scored_now == 0
    assert file.read_bytes() == before


def test_a_missing_shard_is_named(trials: Path, tmp_path: Path) -> None:
    parts = halves(trials, tmp_path)
    with pytest.raises(UsageError, match="1 of 2 shards is missing: 2/2"):
        joined(parts[:1], tmp_path / "out")


@pytest.mark.slow
def test_parts_of_other_rules_or_other_code_are_refused(trials: Path, tmp_path: Path) -> None:
    first, second = halves(trials, tmp_path, "ariac2019.as_coded")
    with pytest.raises(UsageError, match="another rule set") as caught:
        joined([first, second], tmp_path / "out")
    assert caught.value.file == str(second)
    assert "ariac2019.as_coded" in caught.value.cause
    shutil.rmtree(second)
    batch(trials, second, part=(2, 2))
    code = json.loads((second / "batch.json").read_text())["code"]
    describe(second, code=[{**code[0], "sha256": "0" * 64}, *code[1:]])
    with pytest.raises(UsageError, match="another code"):
        joined([first, second], tmp_path / "out")

    assert joined([first, second], tmp_path / "out", mixed_code=True).runs == 6


@pytest.mark.slow
def test_two_results_for_one_run_are_refused(trials: Path, tmp_path: Path, trial_text: str) -> None:
    parts = [tmp_path / "one", tmp_path / "two"]
    batch(trials, parts[0])
    changed = trial_text.replace('"gear_part_blue"', '"gear_part_red"')
    (trials / "a.jsonl").write_text(changed, encoding="utf-8")
    batch(trials, parts[1])

    with pytest.raises(BatchError, match=r"run a\.jsonl/1 has two results"):
        joined(parts, tmp_path / "out")


def test_a_part_of_a_newer_version_or_none_at_all_is_refused(trials: Path, tmp_path: Path) -> None:
    parts = halves(trials, tmp_path)
    describe(parts[1], schema="ariac-score/batch/9")
    with pytest.raises(UsageError, match="it was made as"):
        joined(parts, tmp_path / "out")
    (tmp_path / "nothing").mkdir()
    with pytest.raises(UsageError, match="this is no folder of a batch"):
        joined([parts[0], tmp_path / "nothing"], tmp_path / "out")
    describe(parts[1], schema="ariac-score/batch/1")
    (parts[1] / "runs.jsonl").unlink()
    with pytest.raises(UsageError, match="this batch has not finished"):
        joined(parts, tmp_path / "out")


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda line: {**line, "object": "../../etc/passwd"}, "is no place of a result"),
        (lambda line: {**line, "object": "objects/../../x"}, "is no place of a result"),
        (lambda line: {**line, "sha256": "0" * 64}, "its hash is another one"),
        (lambda line: {**line, "object": f"objects/ab/{'ab' * 32}/{'0' * 16}.json"}, "cannot be read"),
    ],
)
def test_a_table_that_leads_astray_is_refused(
    trials: Path, tmp_path: Path, change: Callable[[dict[str, object]], dict[str, object]], cause: str
) -> None:
    parts = halves(trials, tmp_path)
    table = parts[1] / "runs.jsonl"
    lines = [json.loads(line) for line in table.read_text(encoding="ascii").splitlines()]
    table.write_text("".join(json.dumps(change(line)) + "\n" for line in lines), encoding="ascii")

    with pytest.raises(BatchError, match=cause):
        joined(parts, tmp_path / "out")


@pytest.mark.parametrize(
    ("becomes", "cause"),
    [
        (lambda place: os.truncate(place, 400 * 10**9), "it has 400,000,000,000 bytes, and such a file"),
        (lambda place: (place.unlink(), os.mkfifo(place)), "it is no plain file"),
    ],
)
def test_a_document_without_end_is_named_when_joining(
    trials: Path, tmp_path: Path, becomes: Callable[[Path], object], cause: str
) -> None:
    parts = halves(trials, tmp_path)
    place = next(parts[1] / row.object for row in rows(parts[1]).values())
    try:
        becomes(place)
    except OSError as error:
        pytest.skip(f"this file system cannot hold it: {error.strerror}")

    with pytest.raises(BatchError, match=cause) as caught:
        joined(parts, tmp_path / "out")
    assert caught.value.file == str(place)


@pytest.mark.slow
def test_a_part_cannot_be_joined_into_itself(
    trials: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = halves(trials, tmp_path)
    assert main(["merge", str(parts[0]), *map(str, parts)]) == 4
    assert "into itself" in capsys.readouterr().err


def test_every_outcome_has_a_meaning_in_words() -> None:
    assert all(meaning and not meaning.endswith(".") for meaning in OUTCOMES.values())
