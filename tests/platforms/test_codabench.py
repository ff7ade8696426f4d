"""Codabench, against a worker that does what the notes on the platform say its code does."""

from __future__ import annotations

import errno
import hashlib
import html
import io
import json
import math
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import yaml

from ariac_score import as_json, load_result, load_rule_set, score_trial
from ariac_score.batch.outcomes import outcome_document
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.batch.worker import Done
from ariac_score.cli import main
from ariac_score.errors import BatchError, DataFileError, ScoreError, UsageError
from ariac_score.platforms import codabench, submission
from ariac_score.platforms.codabench import Bundle, check_bundle, dry_run, pack, score, write_bundle
from ariac_score.platforms.neutral import COLUMNS, Metrics, PlatformScores
from ariac_score.platforms.submission import load_phase, phase_text
from ariac_score.report.html.trial import trial_page
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log

sys.path.insert(0, str(Path(__file__).parent))
from platform_cases import ORGANISERS, SCORE, trial_config, without_orders

from ariac_score_ariac.testing import kitting_trial

RULES = "ariac2020.as_coded"
IMAGE = f"example.org/ariac-score@sha256:{'a' * 64}"
BUNDLE = Bundle("Practice", IMAGE, "2026-09-01", "2026-10-01")


@pytest.fixture(scope="session")
def log_text(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("made") / "trial.jsonl"
    write_trial_log(file, kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    return file.read_text(encoding="utf-8")


def reference(folder: Path, *trials: str, limits: Limits | None = None, config: str = "") -> Path:
    rule_set = load_rule_set(RULES)
    setting = BatchSetting.of(rule_set, limits or Limits(120.0, 0))
    (folder / "ref").mkdir(parents=True)
    (folder / "res").mkdir()
    names = dict.fromkeys(trials, "trial.yaml" if config else "")
    if config:
        (folder / "ref/trial.yaml").write_text(config, encoding="utf-8")
    (folder / "ref/phase.json").write_text(phase_text("practice", setting, names), encoding="utf-8")
    (folder / "ref/ruleset.yaml").write_text(setting.rules, encoding="utf-8")
    return folder


def stored_scores(output: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((output / "scores.json").read_text(encoding="utf-8"))
    return found


def zipped(file: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file


# The scoring program -------------------------------------------------------------------


def test_a_submission_is_scored_into_every_column(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input", "kit")
    (inputs / "res/metadata").write_text("exitCode: 0\n", encoding="utf-8")
    (inputs / "res/kit_1").mkdir()
    (inputs / "res/kit_1/trial.jsonl").write_text(log_text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    result = score_trial(inputs / "res/kit_1", RULES)
    assert stored_scores(tmp_path / "output") == {
        "final": float(result.score or 0),
        "raw": float(result.score or 0),
        "penalty": 0.0,
        "violations": sum(f.verdict.value == "violated" for f in result.measured.findings.values()),
        "coverage": 1.0,
        "status_code": 0,
        # Nothing is open in this log.
        "least": float(result.score or 0),
        "most": float(result.score or 0),
    }
    files = {f.relative_to(tmp_path / "output").as_posix() for f in (tmp_path / "output").rglob("*.*")}
    assert files == {"scores.json", "platform_scores.json", "detailed_results.html", "results/kit_1.json"}
    assert not (tmp_path / "output/metadata").exists()  # the platform's own name


def test_the_best_run_counts_and_the_others_are_shown(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input", "kit")
    worse = log_text.replace('"gear_part_blue"', '"gear_part_red"')
    for number, text in ((1, worse), (2, log_text), (3, "half a line")):
        (inputs / f"res/kit_{number}.jsonl").write_text(text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    found = stored_scores(tmp_path / "output")
    assert found["final"] == float(score_trial(inputs / "res/kit_2.jsonl", RULES).score or 0)
    assert found["status_code"] == 1  # one run could not be read, and that is said
    page = (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    assert "kit, run 3: " in page


def test_the_page_of_a_run_that_counts_is_the_page_of_a_trial(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input", "kit")
    (inputs / "res/kit_1.jsonl").write_text(log_text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    page = (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    result = load_result(tmp_path / "output/results/kit_1.json")
    own = trial_page(result, as_json(result), run="run 1 of 1")
    assert "Two shipments delivered, one wrong colour and one wrong pose." in page
    # Nothing but the outcome of the submission is added.
    outcome = page[page.index('<section id="submission"') : page.index("</section>") + len("</section>")]
    assert page.replace(outcome, "").split() == own.split()
    assert "Column" in outcome
    assert len(page) < 1_000_000


def test_each_of_several_runs_that_count_is_a_page_inside_the_page(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input", "kit", "other")
    for name in ("kit_1", "other_1"):
        (inputs / f"res/{name}.jsonl").write_text(log_text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    page = (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    inside = [html.unescape(text) for text in re.findall(r'<iframe srcdoc="([^"]*)"', page)]
    results = [load_result(tmp_path / f"output/results/{name}_1.json") for name in ("kit", "other")]
    assert [text.strip() for text in inside] == [
        trial_page(r, as_json(r), run="run 1 of 1").strip() for r in results
    ]


EMPTY = ({}, {"metadata": b"exitCode: 0\n"}, {".hidden": b"x"})


@pytest.mark.parametrize("files", EMPTY)
def test_an_empty_submission_is_a_scored_outcome_that_says_why(
    tmp_path: Path, files: dict[str, bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = reference(tmp_path / "input", "kit")
    for name, content in files.items():
        (inputs / "res" / name).write_bytes(content)

    assert score(inputs, tmp_path / "output") == 0

    found = stored_scores(tmp_path / "output")
    assert (found["final"], found["status_code"]) == (-1e6, 2)
    assert set(found) == {column.key for column in COLUMNS}
    assert "is taken for a program" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({"other_1.jsonl": b"{}"}, "belongs to no trial of this phase"),
        ({"kit_1.jsonl": b"{}", "kit.jsonl": b"{}"}, "two entries are run 1 of"),
        ({"kit_1.zip": b"PK\x03\x04 no archive"}, "kit"),
    ],
)
def test_what_is_wrong_with_a_submission_is_told_and_scored(
    tmp_path: Path, members: dict[str, bytes], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = reference(tmp_path / "input", "kit")
    for name, content in members.items():
        (inputs / "res" / name).write_bytes(content)

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 2
    assert said in capsys.readouterr().out


def test_a_hostile_archive_in_a_submission_is_its_own_fault(
    tmp_path: Path, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = reference(tmp_path / "input", "kit")
    zipped(inputs / "res/a.zip", {"../../kit_1.jsonl": log_text.encode()})

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 2
    assert "leads out of the archive" in capsys.readouterr().out
    assert not (tmp_path / "kit_1.jsonl").exists()


def test_a_run_beyond_its_time_leaves_the_others_their_score(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input", "kit", "slow", limits=Limits(60.0, 0, output_bytes=200_000))
    (inputs / "res/kit_1.jsonl").write_text(log_text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 1  # `slow` was never run
    assert stored_scores(tmp_path / "output")["final"] > 0


def test_runs_that_would_begin_too_late_do_not_cost_the_others_their_score(
    tmp_path: Path, log_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A platform that stops a submission keeps none of its scores."""
    inputs = reference(tmp_path / "input", "kit", "more", limits=Limits(100.0, 0))
    for name in ("kit_1", "more_1"):
        (inputs / f"res/{name}.jsonl").write_text(log_text, encoding="utf-8")
    clock = iter([0.0, 89.9, 90.0])  # at the beginning, and when a run is asked for
    monkeypatch.setattr(submission, "time", SimpleNamespace(monotonic=lambda: next(clock)))

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 1
    assert stored_scores(tmp_path / "output")["final"] > 0
    page = (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    assert "not scored: the runs before it took all the time" in page


@pytest.mark.parametrize(
    "damage",
    [
        "no phase",
        "no rules",
        "other schema",
        "rules that compare teams",
        "no log map",
        "no such plugin",
        "damaged configuration",
    ],
)
def test_a_broken_scorer_is_a_failure_and_never_a_score(
    tmp_path: Path, damage: str, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    config = "orders: [" if damage == "damaged configuration" else ""
    inputs = reference(tmp_path / "input", "kit", config=config)
    (inputs / "res/kit_1.jsonl").write_text(log_text, encoding="utf-8")
    phase = inputs / "ref/phase.json"
    if damage == "no phase":
        phase.unlink()
    elif damage == "no rules":
        (inputs / "ref/ruleset.yaml").write_text("id: [", encoding="utf-8")
    elif damage == "other schema":
        phase.write_text(phase.read_text().replace("phase/2", "phase/9"), encoding="utf-8")
    elif damage in ("no log map", "no such plugin"):
        rules = inputs / "ref/ruleset.yaml"
        old, new = {
            "no log map": ("log_map: ariac2020", "log_map: ./ours.yaml"),
            "no such plugin": ("use: kitting.pose", "use: nobody.pose"),
        }[damage]
        assert old in rules.read_text(encoding="utf-8")
        rules.write_text(rules.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    elif damage == "rules that compare teams":
        setting = BatchSetting.of(load_rule_set("ariac2024.official"), Limits())
        phase.write_text(phase_text("practice", setting, {"kit": ""}), encoding="utf-8")
        (inputs / "ref/ruleset.yaml").write_text(setting.rules, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 3

    assert not (tmp_path / "output/scores.json").exists()
    assert "The scorer failed" in (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    assert capsys.readouterr().err


@pytest.mark.parametrize("outcome", ["failed", "plugin_failed"])
def test_a_run_that_the_scorer_failed_at_is_no_score(
    tmp_path: Path, log_text: str, monkeypatch: pytest.MonkeyPatch, outcome: str
) -> None:
    def failing(_: object, tasks: Iterable[RunTask], __: object) -> Iterator[Done]:
        document = outcome_document(outcome, "no such table", team="submission", trial="kit")
        return (Done(task, "", "", "", document) for task in tasks)

    monkeypatch.setattr(submission.LocalExecutor, "run", failing)
    inputs = reference(tmp_path / "input", "kit")
    (inputs / "res/kit_1.jsonl").write_text(log_text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 3
    assert not (tmp_path / "output/scores.json").exists()


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "onerror")]


def test_what_a_stranger_wrote_is_text_on_the_page(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input")
    hostile = "<img src=x onerror=alert(1)>"
    text = log_text.replace("gear_part_blue", f"{hostile}</script>")
    (inputs / "res" / f"{hostile}_1.jsonl").write_text(text, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    text = (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert not {"img", "iframe", "base", "form"} & set(page.tags)
    assert page.tags.count("script") <= 2  # the one of every page of a trial, and the result
    assert [link for link in page.links if not link.startswith("#")] == ["data:,"]  # it has no icon
    assert "&lt;img src=x onerror=alert(1)&gt;" in text
    names = [file.name for file in (tmp_path / "output/results").iterdir()]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", name) for name in names)


# What a platform can store -------------------------------------------------------------

SOUND = Metrics(final=1.5, violations=3, penalty=-0.5, raw=2.0, coverage=1.0, status_code=0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e10, -1e10, 10**10])
def test_what_a_platform_cannot_store_is_refused_by_us_first(value: float) -> None:
    with pytest.raises(BatchError, match=r"'final': .* cannot be stored"):
        PlatformScores.of("finals", "scored", replace(SOUND, final=value), "")


@pytest.mark.parametrize("value", [0, 0.0, -0.0, 9999999999.0, -9999999999.9, 1 / 3])
def test_what_it_can_store_is_rounded_once(value: float) -> None:
    stored = PlatformScores.of("finals", "scored", replace(SOUND, final=value), "").metrics.final
    assert stored == round(value, 10)
    assert str(stored) != "-0.0"


def test_there_is_a_number_for_each_column_under_a_name_that_platforms_take() -> None:
    assert [*SOUND.by_column()] == [column.key for column in COLUMNS]
    assert all(re.fullmatch(r"[a-z][a-z0-9_]{0,35}", column.key) for column in COLUMNS)


def test_a_submission_without_a_score_is_behind_every_other() -> None:
    nothing = PlatformScores.without_score("finals", "invalid_log", "nothing")
    assert nothing.metrics.final == -1e6
    assert nothing.metrics.status_code == 2


def test_the_export_is_read_as_it_was_written() -> None:
    scores = PlatformScores.of("finals", "scored", SOUND, "caf\udce9 counts", "ab")
    document = json.loads(scores.text())

    assert document["schema"] == "platform-scores/1"
    assert document["splits"] == [{"name": "finals", "public": True, "metrics": SOUND.by_column()}]
    assert document["message"] == "caf\\udce9 counts"
    assert msgspec.json.decode(scores.text(), type=PlatformScores) == scores


def test_a_name_that_is_no_utf8_fails_no_scorer(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input")
    content = log_text.encode()
    with tarfile.open(inputs / "res/runs.tar", "w", format=tarfile.GNU_FORMAT, encoding="latin-1") as archive:
        member = tarfile.TarInfo("caf\xe9_1.jsonl")
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 0
    assert "caf\\udce9" in (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")


def test_a_full_disk_is_a_failure_of_the_scorer_and_no_damaged_archive(
    tmp_path: Path, log_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs = reference(tmp_path / "input", "kit")
    zipped(inputs / "res/runs.zip", {"kit_1.jsonl": log_text.encode()})
    opened = Path.open

    def full(path: Path, mode: str = "r", *arguments: Any, **named: Any) -> Any:
        if mode == "xb":
            raise OSError(errno.ENOSPC, "No space left on device")
        return opened(path, mode, *arguments, **named)

    monkeypatch.setattr(Path, "open", full)

    assert score(inputs, tmp_path / "output") == 3
    assert not (tmp_path / "output/scores.json").exists()


def test_reference_data_of_the_version_before_are_read(tmp_path: Path) -> None:
    inputs = reference(tmp_path / "input", "kit")
    before = {
        "schema": "ariac-score/phase/1",
        "phase": "practice",
        "rule_set": {"id": "ariac2020.as_coded", "sha256": "ab"},
        "limits": {"wall_s": 300, "memory_bytes": 1 << 30, "output_bytes": 1 << 20},
        "trials": {"kit": ""},
    }
    (inputs / "ref/phase.json").write_text(json.dumps(before, indent=1, sort_keys=True), encoding="utf-8")

    phase = load_phase(inputs / "ref")

    assert (phase.name, [trial.id for trial in phase.trials]) == ("practice", ["kit"])
    assert phase.setting.limits == Limits(300.0, 1 << 30, 1 << 20)


def test_reference_data_whose_rules_were_edited_under_their_hash_are_refused(tmp_path: Path) -> None:
    inputs = reference(tmp_path / "input", "kit")
    rules = inputs / "ref/ruleset.yaml"
    text = rules.read_text(encoding="utf-8")
    load_phase(inputs / "ref")
    assert "round: 0" in text
    rules.write_text(text.replace("round: 0", "round: 3"), encoding="utf-8")

    with pytest.raises(UsageError, match="the rules have SHA-256"):
        load_phase(inputs / "ref")


def test_reference_data_with_a_fault_name_its_place(tmp_path: Path) -> None:
    inputs = reference(tmp_path / "input", "kit")
    file = inputs / "ref/phase.json"
    file.write_text(file.read_text().replace('"wall_s": 120.0', '"wall_s": "long"'), encoding="utf-8")

    with pytest.raises(DataFileError, match="expected 'float', got 'str'") as refused:
        load_phase(inputs / "ref")

    assert (refused.value.file, refused.value.place) == (str(file), "$.limits.wall_s")


# The bundle ----------------------------------------------------------------------------


def bundle(folder: Path, **changes: Any) -> Path:
    rule_set = load_rule_set(RULES)
    values = {**vars(BUNDLE), **changes}
    write_bundle(
        Bundle(**values),
        rule_set,
        BatchSetting.of(rule_set, Limits(120.0, 0)),
        {"kit": None},
        folder / "bundle.zip",
    )
    return folder / "bundle.zip"


@pytest.mark.slow
def test_a_bundle_is_executed_as_the_worker_would(tmp_path: Path, log_text: str) -> None:
    (tmp_path / "kit_1").mkdir()
    (tmp_path / "kit_1/trial.jsonl").write_text(log_text, encoding="utf-8")
    pack([tmp_path / "kit_1"], tmp_path / "submission.zip")

    assert dry_run(bundle(tmp_path), tmp_path / "submission.zip", tmp_path / "dry") == 0

    found = stored_scores(tmp_path / "dry/output")
    assert found["final"] == float(score_trial(tmp_path / "kit_1", RULES).score or 0)


def test_the_same_bundle_has_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "again").mkdir()
    assert bundle(tmp_path).read_bytes() == bundle(tmp_path / "again").read_bytes()


def test_the_bundle_has_what_the_unpacker_asks_for(tmp_path: Path) -> None:
    with zipfile.ZipFile(bundle(tmp_path)) as archive:
        names = archive.namelist()
        competition = yaml.safe_load(archive.read("competition.yaml"))
        with zipfile.ZipFile(archive.open("scoring_program.zip")) as program:
            assert set(program.namelist()) == {"metadata.yaml", "scoring.py"}  # no folder around them
            command = yaml.safe_load(program.read("metadata.yaml"))["command"]
            compile(program.read("scoring.py"), "scoring.py", "exec")
    assert command == "python3 /app/program/scoring.py /app/input /app/output"
    assert competition["version"] == 2
    assert "leaderboard" not in competition
    columns = competition["leaderboards"][0]["columns"]
    assert [column["index"] for column in columns] == list(range(len(columns)))
    assert (columns[0]["key"], columns[0]["sorting"]) == ("final", "desc")
    assert all(len(column["key"]) <= 36 for column in columns)
    assert {"rules.md", "terms.md", "logo.png"} <= set(names)
    assert check_bundle(tmp_path / "bundle.zip") == []


@pytest.mark.slow
def test_a_submission_that_looks_like_a_program_arrives_empty_and_is_told_so(
    tmp_path: Path, log_text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    members = {"metadata.yaml": b"rosbag2_bagfile_information: {}\n", "kit_1.jsonl": log_text.encode()}
    zipped(tmp_path / "trap.zip", members)

    assert dry_run(bundle(tmp_path), tmp_path / "trap.zip", tmp_path / "dry") == 0

    assert stored_scores(tmp_path / "dry/output")["status_code"] == 2
    assert "is taken for a program" in capfd.readouterr().out


def test_a_program_without_the_engine_fails_with_a_page(tmp_path: Path) -> None:
    with (
        zipfile.ZipFile(bundle(tmp_path)) as archive,
        zipfile.ZipFile(archive.open("scoring_program.zip")) as program,
    ):
        (tmp_path / "scoring.py").write_bytes(program.read("scoring.py"))
    (tmp_path / "output").mkdir()
    ended = subprocess.run(
        [sys.executable, "-I", "-S", str(tmp_path / "scoring.py"), str(tmp_path), str(tmp_path / "output")],
        capture_output=True,
        check=False,
    )
    assert ended.returncode == 3
    assert "could not be started" in (tmp_path / "output/detailed_results.html").read_text()


def changed(tmp_path: Path, change: Any) -> list[str]:
    """What the check says of a bundle whose competition.yaml was changed."""
    with zipfile.ZipFile(bundle(tmp_path)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    competition = yaml.safe_load(members["competition.yaml"])
    change(competition, members)
    members["competition.yaml"] = yaml.safe_dump(competition).encode()
    return [problem.what for problem in check_bundle(zipped(tmp_path / "changed.zip", members))]


def _program(content: dict[str, bytes]) -> bytes:
    import io  # noqa: PLC0415  # for this helper alone

    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, text in content.items():
            archive.writestr(name, text)
    return out.getvalue()


def _edited(zipped_file: bytes, name: str) -> bytes:
    """A zip with a blank line more in one of its files."""
    import io  # noqa: PLC0415  # for this helper alone

    with zipfile.ZipFile(io.BytesIO(zipped_file)) as archive:
        return _program({n: archive.read(n) + (b"\n" if n == name else b"") for n in archive.namelist()})


TRAPS = {
    "leaderboard": (
        lambda c, _m: c.update(leaderboard=c.pop("leaderboards")),
        "is rejected by the platform",
    ),
    "other keys": (lambda c, _m: c["leaderboards"][0]["columns"].pop(), "the scorer writes"),
    "long key": (
        lambda c, _m: c["leaderboards"][0]["columns"][1].update(key="k" * 37),
        "is longer than 36 characters",
    ),
    "ascending": (
        lambda c, _m: c["leaderboards"][0]["columns"][0].update(sorting="asc"),
        "a submission without a score would lead",
    ),
    "computed": (
        lambda c, _m: c["leaderboards"][0]["columns"][2].update(computation="avg"),
        "is computed by the platform",
    ),
    "enclosing folder": (
        lambda _c, m: m.update(
            {"scoring_program.zip": _program({"p/metadata.yaml": b"", "p/scoring.py": b""})}
        ),
        "lies in a folder",
    ),
    "no command": (
        lambda _c, m: m.update(
            {"scoring_program.zip": _program({"metadata.yaml": b"{}", "scoring.py": b""})}
        ),
        "it has no 'command'",
    ),
    "no program": (lambda _c, m: m.pop("scoring_program.zip"), "is not in the zip"),
    "tag": (lambda c, _m: c.update(docker_image="example.org/x:latest"), "is not named by its digest"),
    "long": (lambda c, _m: c["phases"][0].update(execution_time_limit=601), "own queue stops at 600 s"),
    "no date": (lambda c, _m: c["phases"][0].update(start="soon"), "start 'soon' is no date"),
    "end before start": (lambda c, _m: c["phases"][0].update(end="2026-08-31"), "it ends before it begins"),
    "no time": (lambda c, _m: c["phases"][0].update(execution_time_limit=0), "is no time"),
    "no task": (lambda c, _m: c.update(tasks=[]), "there is none"),
    "no phase": (lambda c, _m: c.update(phases=5), "there is none"),
    "another rule set": (
        lambda _c, m: m.update({"reference_data.zip": _edited(m["reference_data.zip"], "ruleset.yaml")}),
        "ruleset.yaml has the SHA-256",
    ),
    "no page": (lambda _c, m: m.pop("rules.md"), "rules.md is not in the zip"),
}


@pytest.mark.parametrize("trap", TRAPS)
def test_every_trap_is_found_before_the_upload(tmp_path: Path, trap: str) -> None:
    change, words = TRAPS[trap]
    assert any(words in what for what in changed(tmp_path, change)), trap


def test_a_bundle_without_traps_has_no_problem(tmp_path: Path) -> None:
    assert changed(tmp_path, lambda _c, _m: None) == []


def test_rules_that_compare_teams_are_refused_for_a_platform(tmp_path: Path) -> None:
    rule_set = load_rule_set("ariac2024.official")
    with pytest.raises(UsageError, match="compares teams"):
        write_bundle(BUNDLE, rule_set, BatchSetting.of(rule_set, Limits()), {}, tmp_path / "b.zip")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "trials", "words"),
    [
        ({"start": "soon"}, {"kit": None}, "is no date"),
        ({"time_limit_s": -5}, {"kit": None}, "is no time"),
        ({}, {"../../kit": None}, "is no name of a trial"),
        ({}, {"kit": Path("nowhere.yaml")}, "cannot be read"),
    ],
)
def test_a_bundle_that_cannot_work_is_not_written(
    tmp_path: Path, changes: dict[str, Any], trials: dict[str, Path | None], words: str
) -> None:
    rule_set = load_rule_set(RULES)
    one = Bundle(**{**vars(BUNDLE), **changes})
    with pytest.raises(UsageError, match=words):
        write_bundle(one, rule_set, BatchSetting.of(rule_set, Limits()), trials, tmp_path / "b.zip")
    assert not list(tmp_path.iterdir())


def test_an_output_that_cannot_be_written_is_a_failure_of_the_scorer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "output").write_text("a file where the folder should be")

    assert score(tmp_path, tmp_path / "output") == 3
    assert "output" in capsys.readouterr().err


def test_reference_data_with_a_wrong_checksum_score_nobody(
    tmp_path: Path, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        zipfile.ZipFile(bundle(tmp_path)) as archive,
        zipfile.ZipFile(archive.open("reference_data.zip")) as reference,
    ):
        reference.extractall(tmp_path / "in/ref")  # noqa: S202  # our own
    (tmp_path / "in/res").mkdir()
    (tmp_path / "in/res/kit_1.jsonl").write_text(log_text, encoding="utf-8")
    assert score(tmp_path / "in", tmp_path / "out") == 0

    with (tmp_path / "in/ref/ruleset.yaml").open("a") as rules:
        rules.write("\n")
    assert score(tmp_path / "in", tmp_path / "out") == 3

    assert "ruleset.yaml has the SHA-256" in capsys.readouterr().err
    assert not (tmp_path / "out/scores.json").exists()


# The pack ------------------------------------------------------------------------------


OWN_MAP = """\
id: workshop
title: A map of the organiser's own
source: the organiser
channels: [{topic: /records, decoder: ariac_score.records}]
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["./ours.yaml", "../maps/ours.yaml", "{absolute}/maps/ours.yaml"])
@pytest.mark.parametrize("extended", [False, True])
def test_a_log_map_of_the_organisers_own_is_packed(
    tmp_path: Path, log_text: str, name: str, extended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("rules", "maps", "children"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "ours.yaml").write_text(OWN_MAP, encoding="utf-8")
    own = f"id: ours\ntitle: Ours\nsource: us\nextends: {RULES}\nlog_map: {name.format(absolute=tmp_path)}\n"
    (tmp_path / "rules/rules.yaml").write_text(own, encoding="utf-8")
    child = "id: child\ntitle: Child\nsource: us\nextends: ../rules/rules.yaml\n"
    (tmp_path / "children/child.yaml").write_text(child, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    rule_set = load_rule_set("children/child.yaml" if extended else "rules/rules.yaml")
    bundle = tmp_path / "bundle.zip"
    write_bundle(BUNDLE, rule_set, BatchSetting.of(rule_set, Limits(120.0, 0)), {"kit": None}, bundle)
    for folder in ("rules", "maps", "children"):
        (tmp_path / folder / "ours.yaml").unlink()  # the platform has what is in the bundle, and no more
    submission = zipped(tmp_path / "kit.zip", {"kit_1/trial.jsonl": log_text.encode()})

    assert check_bundle(bundle) == []
    assert dry_run(bundle, submission, tmp_path / "dry") == 0
    assert stored_scores(tmp_path / "dry/output")["status_code"] == 0


def test_a_bundle_without_the_log_map_that_its_rules_name_is_refused(tmp_path: Path) -> None:
    own = f"id: ours\ntitle: Ours\nsource: us\nextends: {RULES}\nlog_map: ./ours.yaml\n"
    (tmp_path / "rules.yaml").write_text(own, encoding="utf-8")
    rule_set = load_rule_set(str(tmp_path / "rules.yaml"))
    setting = BatchSetting.of(rule_set, Limits(120.0, 0))

    with pytest.raises(ScoreError, match=r"ours\.yaml"):
        write_bundle(BUNDLE, rule_set, setting, {"kit": None}, tmp_path / "bundle.zip")

    assert not (tmp_path / "bundle.zip").exists()


def _tgz(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as packed:
        for name, content in members.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            packed.addfile(info, io.BytesIO(content))
    return out.getvalue()


def test_archives_in_archives_share_one_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inputs = reference(tmp_path / "input", "kit")
    inner = {f"part_{number}.tgz": _tgz({"kit_1.jsonl": bytes(900_000)}) for number in range(9)}
    submission = inputs / "res/kit.tgz"
    submission.write_bytes(_tgz(inner))
    assert submission.stat().st_size * 200 < 9 * 900_000

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 2
    assert "it holds more than" in capsys.readouterr().out


def test_archives_are_unpacked_only_so_deep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inputs = reference(tmp_path / "input", "kit")
    content = _tgz({"kit_1.jsonl": b"{}"})
    for _ in range(9):
        content = _tgz({"again.tgz": content})
    (inputs / "res/kit.tgz").write_bytes(content)

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 2
    assert "archives inside one another" in capsys.readouterr().out


def test_two_archives_of_one_stem_are_both_scored(tmp_path: Path, log_text: str) -> None:
    inputs = reference(tmp_path / "input", "kit")
    zipped(inputs / "res/day.zip", {"kit_1.jsonl": log_text.encode()})
    (inputs / "res/day.tgz").write_bytes(_tgz({"kit_2.jsonl": log_text.encode()}))

    assert score(inputs, tmp_path / "output") == 0

    assert stored_scores(tmp_path / "output")["status_code"] == 0
    names = {file.name for file in (tmp_path / "output/results").iterdir()}
    assert names == {"kit_1.json", "kit_2.json"}


def test_a_pack_keeps_recordings_in_their_folders(tmp_path: Path) -> None:
    bag = tmp_path / "kit_1"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("a: 1\n")
    (bag / "kit.db3").write_bytes(b"x")

    assert pack([bag], tmp_path / "s.zip") == 2

    with zipfile.ZipFile(tmp_path / "s.zip") as archive:
        assert archive.namelist() == ["kit_1/kit.db3", "kit_1/metadata.yaml"]


def test_what_cannot_be_packed_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("command: evil\n")
    (tmp_path / "link").symlink_to("/etc/passwd")
    for name in ("a", "b"):
        (tmp_path / name / "kit_1").mkdir(parents=True)
        (tmp_path / name / "kit_1/x").touch()
    cases: dict[str, list[Path]] = {
        "take the submission for a program": [tmp_path / "metadata.yaml"],
        "it is a link": [tmp_path / "link"],
        "two trials are named 'kit_1'": [tmp_path / "a/kit_1", tmp_path / "b/kit_1"],
        "there is no such file": [tmp_path / "gone"],
    }
    for words, paths in cases.items():
        with pytest.raises(UsageError, match=words):
            pack(paths, tmp_path / "s.zip")
    assert not (tmp_path / "s.zip").exists()


def test_a_phase_says_what_a_recording_is_worth_that_nobody_attests(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rules = tmp_path / "ours.yaml"
    words = ["platform", "codabench", "bundle", "--rules", str(rules), "--title", "P", "--image", IMAGE]
    words += ["--start", "2026-09-01", "--end", "2026-10-01", "--trial", "kit", "-o", str(tmp_path / "b.zip")]
    head = f"extends: {RULES}\nid: ours\ntitle: Ours\nsource: this test\n"
    key = "RW" + "Q" * 54
    attested = f"completeness: attested\nauthority: {{recorder_keys: [{key}]}}\n"
    for more, options, code, says in (
        ("", (), 4, ""),
        ("", ("--unattested",), 0, "Every recording counts"),
        ("completeness: believed\n", (), 0, "Every recording counts"),
        (attested, (), 0, "Only recordings count"),
    ):
        rules.write_text(head + more, encoding="utf-8")
        assert main([*words, *options]) == code
        said = capsys.readouterr().err
        if code:
            assert f"{rules}: teams hand in their own recordings, and ours does not say" in said
            assert "hint: extend the rules with 'completeness: attested'" in said
        else:
            with zipfile.ZipFile(tmp_path / "b.zip") as bundle:
                assert says in bundle.read("rules.md").decode()


@pytest.mark.slow
def test_the_commands_say_what_they_did(
    tmp_path: Path, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "kit_1").mkdir()
    (tmp_path / "kit_1/trial.jsonl").write_text(log_text, encoding="utf-8")
    head = ["platform", "codabench"]
    bundle_arguments = ["--rules", RULES, "--unattested", "--title", "P", "--image", IMAGE]
    bundle_arguments += ["--start", "2026-09-01"]
    zips = [str(tmp_path / name) for name in ("b.zip", "s.zip")]
    assert (
        main([*head, "bundle", *bundle_arguments, "--end", "2026-10-01", "--trial", "kit", "-o", zips[0]])
        == 0
    )
    assert main([*head, "check", zips[0]]) == 0
    assert main([*head, "pack", str(tmp_path / "kit_1"), "-o", zips[1]]) == 0
    assert main([*head, "dry-run", *zips, "-o", str(tmp_path / "dry")]) == 0
    said = capsys.readouterr().out
    assert "no problem found" in said
    assert "1 file, " in said
    assert main([*head, "dry-run", *zips, "-o", str(tmp_path / "dry")]) == 4
    assert "the folder is not empty" in capsys.readouterr().err
    shutil.rmtree(tmp_path / "dry")
    (tmp_path / "b.zip").write_bytes(b"no zip")
    assert main([*head, "check", zips[0]]) == 1
    assert main([*head, "dry-run", *zips, "-o", str(tmp_path / "dry")]) == 4


# The organiser's configuration ---------------------------------------------------------

EASIER = trial_config("gear_part_green")  # what the log shows on the tray


def hosted(tmp_path: Path, log: str, **brought: str) -> Path:
    """The output of what organiser, team and platform do, by the commands of the documentation."""
    (tmp_path / "organiser.yaml").write_text(ORGANISERS, encoding="utf-8")
    recording = tmp_path / "kitting_1"
    recording.mkdir()
    for name, text in {"trial.jsonl": log, **brought}.items():
        (recording / name).write_text(text, encoding="utf-8")
    zips = [str(tmp_path / name) for name in ("bundle.zip", "submission.zip")]
    head = ["platform", "codabench"]
    dates = ["--start", "2026-09-01", "--end", "2026-10-01", "--image", IMAGE, "--unattested"]
    trial = f"kitting={tmp_path / 'organiser.yaml'}"
    assert (
        main([*head, "bundle", "--rules", RULES, "--title", "P", *dates, "--trial", trial, "-o", zips[0]])
        == 0
    )
    assert main([*head, "pack", str(recording), "-o", zips[1]]) == 0
    assert main([*head, "dry-run", *zips, "-o", str(tmp_path / "dry")]) == 0
    return tmp_path / "dry/output"


@pytest.mark.slow
def test_an_honest_submission_is_scored_by_the_configuration_of_the_organiser(
    tmp_path: Path, log_text: str
) -> None:
    output = hosted(tmp_path, without_orders(log_text))

    found = stored_scores(output)
    assert (found["final"], found["status_code"]) == (SCORE, 0)
    inputs = json.loads((output / "results/kitting_1.json").read_text(encoding="utf-8"))["provenance"][
        "inputs"
    ]
    assert [source["name"] for source in inputs] == ["kitting_1/trial.jsonl", "kitting.yaml"]
    assert inputs[1]["sha256"] == hashlib.sha256(ORGANISERS.encode()).hexdigest()


NAMED = f"""\
logs: [trial.jsonl]
trial_config: mine.yaml
sha256: {{mine.yaml: {hashlib.sha256(EASIER.encode()).hexdigest()}}}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "brought",
    [{"mine.yaml": EASIER}, {"kitting.yaml": EASIER}, {"mine.yaml": EASIER, "bundle.yaml": NAMED}],
)
def test_a_configuration_that_says_something_else_than_the_organisers_is_refused_and_named(
    tmp_path: Path, log_text: str, brought: dict[str, str]
) -> None:
    output = hosted(tmp_path, without_orders(log_text), **brought)

    assert (stored_scores(output)["final"], stored_scores(output)["status_code"]) == (-1e6, 2)
    message = json.loads((output / "platform_scores.json").read_text(encoding="utf-8"))["message"]
    assert "(organiser) says" in message
    assert f"{next(iter(brought))}' (run) says" in message


@pytest.mark.slow
def test_a_configuration_that_is_handed_in_may_repeat_the_organisers(tmp_path: Path, log_text: str) -> None:
    output = hosted(tmp_path, without_orders(log_text), **{"mine.yaml": ORGANISERS})

    assert stored_scores(output)["final"] == SCORE


@pytest.mark.slow
def test_a_configuration_alone_is_no_submission(tmp_path: Path) -> None:
    inputs = reference(tmp_path / "input", "kit", config=ORGANISERS)
    (inputs / "res/kit_1.yaml").write_text(EASIER, encoding="utf-8")

    assert score(inputs, tmp_path / "output") == 0

    assert (
        stored_scores(tmp_path / "output")["final"],
        stored_scores(tmp_path / "output")["status_code"],
    ) == (-1e6, 2)
    page = (tmp_path / "output/detailed_results.html").read_text(encoding="utf-8")
    assert "no log of a trial" in page


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (
            (Path(__file__).parents[1] / "data/trial_2022.yaml").read_text(encoding="utf-8"),
            "a trial configuration of 2022",
        ),
        ("sensors: {}\narm: {type: ur10}\n", "it is no trial configuration|no reader recognises"),
        (ORGANISERS.replace("order_0:", "order_0: 1\n  other:"), "trials/kit.yaml"),
    ],
)
def test_a_configuration_under_which_nobody_could_score_is_refused_before_the_upload(
    tmp_path: Path, config: str, words: str
) -> None:
    (tmp_path / "trial.yaml").write_text(config, encoding="utf-8")
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))

    with pytest.raises(UsageError, match=words) as refused:
        write_bundle(
            BUNDLE, load_rule_set(RULES), setting, {"kit": tmp_path / "trial.yaml"}, tmp_path / "b.zip"
        )
    assert "trials/kit.yaml" in str(refused.value)
    assert not (tmp_path / "b.zip").exists()


def test_the_time_of_the_default_queue_ends_a_dry_run(
    tmp_path: Path, log_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kit_1").mkdir()
    (tmp_path / "kit_1/trial.jsonl").write_text(log_text, encoding="utf-8")
    pack([tmp_path / "kit_1"], tmp_path / "submission.zip")
    made = bundle(tmp_path)
    monkeypatch.setattr(codabench, "DEFAULT_QUEUE_S", 0.001)

    assert dry_run(made, tmp_path / "submission.zip", tmp_path / "dry") == 3
