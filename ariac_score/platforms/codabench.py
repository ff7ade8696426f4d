"""Codabench: a bundle for the organiser, a pack for the team, and the scoring program.

Source: notes on Codabench (commit c7dbc75), sections 2 and 5.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from ariac_score.batch.tasks import BatchSetting
from ariac_score.documents.yaml import is_there, parse_yaml
from ariac_score.errors import LogError, ScoreError, UsageError
from ariac_score.platforms.archives import PACKED_STAMP, unpack, zipped
from ariac_score.platforms.neutral import COLUMNS
from ariac_score.platforms.page import progress_page, result_page
from ariac_score.platforms.problems import Problem, mappings_in
from ariac_score.platforms.submission import (
    HASHES,
    PHASE,
    RULES,
    hashes_text,
    load_phase,
    phase_text,
    rules_and_log_map,
    score_submission,
)
from ariac_score.results.result_file import as_json
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["Bundle", "check_bundle", "dry_run", "pack", "refuse_unattested", "score", "write_bundle"]

EXIT_SCORER_FAILED = 3
DEFAULT_QUEUE_S = 600
"""Longest run on the platform's own queue, s, whatever a phase asks for."""
LONGEST_KEY = 36
"""Characters of the key of a column, which the platform's database holds."""
_DIGEST = re.compile(r".+@sha256:[0-9a-f]{64}")
_TRIAL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_RESERVED = ("metadata.yaml", "metadata")
"""Files at the root of a zip by which the platform takes it for a program."""

_PROGRAM = '''\
"""Scores a submission with ariac-score, which is part of the image."""

import html
import os
import sys
import traceback
from pathlib import Path


def main(inputs, output):
    try:
        from ariac_score.platforms.codabench import score
    except Exception:
        traceback.print_exc()
        text = "The scorer could not be started. The organisers have the log; this attempt should not count."
        page = Path(output) / "detailed_results.html"
        page.write_text(f"<!doctype html><meta charset=utf-8><p>{html.escape(text)}</p>", encoding="utf-8")
        return 3
    return score(Path(inputs), Path(output))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))
'''


@dataclass(frozen=True)
class Bundle:
    """What an organiser decides about a phase.

    Attributes:
        title: Of the competition.
        image: Container image with ariac-score, by digest.
        start: First day, ISO 8601.
        end: Last day, ISO 8601.
        time_limit_s: For one submission.
        submissions: At most, in all.
        submissions_per_day: At most.
    """

    title: str
    image: str
    start: str
    end: str
    time_limit_s: int = DEFAULT_QUEUE_S
    submissions: int = 30
    submissions_per_day: int = 3


# The bundle ------------------------------------------------------------------------------


def refuse_unattested(rule_set: RuleSet) -> None:
    """Refuse rules that do not say what a team's own recording is worth which nobody attests.

    Raises:
        UsageError: They say nothing of it.
    """
    if not rule_set.authority.completeness:
        raise UsageError(
            f"teams hand in their own recordings, and {rule_set.id} does not say whether one counts that no "
            "recorder of the organiser attests: a collision could have been left out",
            file=rule_set.file,
            hint="extend the rules with 'completeness: attested' and the key of your recorder, or give "
            "--unattested to believe every recording",
        )


def write_bundle(
    bundle: Bundle, rule_set: RuleSet, setting: BatchSetting, trials: Mapping[str, Path | None], output: Path
) -> None:
    """Write a complete competition bundle.

    Args:
        bundle: The organiser's decisions.
        rule_set: By which submissions are scored.
        setting: The same with limits.
        trials: Each trial with its configuration, or `None`.
        output: The zip.

    Raises:
        UsageError: The rules compare teams, or the bundle would not work.
        LogMapError: The log map that the rules name is not there, or is malformed.
    """
    if rule_set.sheet.needs_cohort:
        raise UsageError(
            f"{rule_set.id} compares teams, and a platform scores one submission at a time",
            hint="let the phase use the task rules (as_coded), and rank with 'ariac-score rank' afterwards",
        )
    for trial in trials:
        if not _TRIAL.fullmatch(trial):
            raise UsageError(
                f"{trial!r} is no name of a trial",
                hint="use letters, digits, '_', '.' and '-', such as first_task",
            )
    names = {trial: f"trials/{trial}.yaml" if config else "" for trial, config in trials.items()}
    packed = rules_and_log_map(setting)
    phase = phase_text(bundle.title, setting, names, rules=packed[RULES].decode())
    reference = {PHASE: phase.encode(), **packed}
    reference |= {names[trial]: _content(config) for trial, config in trials.items() if config}
    reference[HASHES] = hashes_text(reference).encode()
    metadata = "command: python3 /app/program/scoring.py /app/input /app/output\n"
    program = {"metadata.yaml": metadata.encode(), "scoring.py": _PROGRAM.encode()}
    files = {
        "competition.yaml": _competition(bundle, rule_set).encode(),
        "rules.md": _rules_page(rule_set).encode(),
        "terms.md": b"Submissions are scored by ariac-score; results and logs may be published.\n",
        "logo.png": _logo(),
        "scoring_program.zip": zipped(program),
        "reference_data.zip": zipped(reference),
    }
    temporary = output.with_name(f".part-{output.name}")
    try:
        temporary.write_bytes(zipped(files))
    except OSError as cause:
        raise _unwritable(output, cause) from cause
    problems = [problem for problem in check_bundle(temporary) if problem.severe]
    if problems:
        temporary.unlink()
        raise UsageError(f"{problems[0].where}: {problems[0].what}", file=output, hint=problems[0].remedy)
    temporary.replace(output)


def _content(config: Path) -> bytes:
    try:
        return config.read_bytes()
    except OSError as cause:
        raise UsageError(
            f"cannot be read: {cause.strerror}", file=config, hint="give --trial ID=CONFIG a configuration"
        ) from cause


def _unwritable(output: Path, cause: OSError) -> UsageError:
    return UsageError(
        f"cannot be written: {cause.strerror or cause}", file=output, hint="check folder and room"
    )


def _competition(bundle: Bundle, rule_set: RuleSet) -> str:
    competition = {
        "version": 2,
        "title": bundle.title,
        "description": f"Scored by ariac-score under {rule_set.id}: {rule_set.title}",
        "image": "logo.png",
        "terms": "terms.md",
        "docker_image": bundle.image,
        "enable_detailed_results": True,
        "show_detailed_results_in_submission_panel": True,
        "show_detailed_results_in_leaderboard": True,
        "pages": [{"title": "Rules", "file": "rules.md"}],
        "tasks": [
            {
                "index": 0,
                "name": bundle.title,
                "scoring_program": "scoring_program.zip",
                "reference_data": "reference_data.zip",
            }
        ],
        "phases": [
            {
                "index": 0,
                "name": bundle.title,
                "start": bundle.start,
                "end": bundle.end,
                "tasks": [0],
                "max_submissions": bundle.submissions,
                "max_submissions_per_day": bundle.submissions_per_day,
                "execution_time_limit": bundle.time_limit_s,
                "hide_output": False,
                "hide_score_output": False,
            }
        ],
        "leaderboards": [
            {
                "title": "Results",
                "key": "main",
                "submission_rule": "Force_Best",
                "columns": [
                    {
                        "title": column.title,
                        "key": column.key,
                        "index": index,
                        "sorting": "desc" if column.descending else "asc",
                        "precision": rule_set.digits if column.precision is None else column.precision,
                        "hidden": column.hidden,
                    }
                    for index, column in enumerate(COLUMNS)
                ],
            }
        ],
    }
    return yaml.safe_dump(competition, sort_keys=False, allow_unicode=True)


_BELIEVED = "Every recording counts, whether or not the organiser's recorder attests that nothing is missing."
_RECORDINGS = {
    "": _BELIEVED,
    "believed": _BELIEVED,
    "attested": "Only recordings count of which the organiser's recorder attests that nothing is missing.",
}


def _rules_page(rule_set: RuleSet) -> str:
    said = "".join(f"- {note}\n" for note in (_RECORDINGS[rule_set.authority.completeness], *rule_set.notes))
    columns = "".join(f"- **{column.title}**: {column.meaning}\n" for column in COLUMNS)
    return f"# {rule_set.title}\n\nSource: {rule_set.source}\n\n{said}\n## Columns\n\n{columns}"


def _logo() -> bytes:
    """A plain square, 64 pixels wide: the platform requires a picture."""
    row = b"\0" + b"\x1f\x5f\x8b" * 64
    header = struct.pack(">IIBBBBB", 64, 64, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(row * 64)), (b"IEND", b""))
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + body


# Before the upload -----------------------------------------------------------------------


def check_bundle(path: Path) -> list[Problem]:
    """Everything about a bundle that the platform rejects late or gets wrong in silence."""
    if path.exists() and not path.is_file():  # a pipe would be waited for
        return [Problem(str(path), "it is no plain file", "name the zip of the bundle")]
    with tempfile.TemporaryDirectory() as folder:
        try:
            unpack(path, Path(folder))
        except LogError as error:
            return [Problem(str(path), error.cause, error.hint)]
        return list(_problems(Path(folder)))


def _problems(folder: Path) -> Iterator[Problem]:
    file = folder / "competition.yaml"
    if not file.is_file():
        yield Problem(
            "competition.yaml", "it is not at the root of the zip", "zip the files, not their folder"
        )
        return
    try:
        competition = parse_yaml(file.read_bytes(), file=file.name).data
    except ScoreError as error:
        yield Problem("competition.yaml", error.cause, error.hint)
        return
    if not isinstance(competition, dict):
        yield Problem("competition.yaml", "it is no mapping", _WRITE)
        return
    yield from _leaderboard_problems(competition)
    yield from _phase_problems(competition)
    if not _DIGEST.fullmatch(str(competition.get("docker_image", ""))):
        yield Problem(
            "competition.yaml: docker_image",
            "the image is not named by its digest: scores may change when another one is pushed",
            "give NAME@sha256:DIGEST",
            severe=False,
        )
    tasks = mappings_in(competition, "tasks")
    if not tasks:
        yield Problem("competition.yaml: tasks", "there is none", _WRITE)
    for task in tasks:
        for key in ("scoring_program", "reference_data"):
            yield from _member_problems(folder, str(task.get(key, "")), key)
    pages = [page.get("file") for page in mappings_in(competition, "pages")]
    for page in (*pages, competition.get("image"), competition.get("terms")):
        if page and not (is_there(folder / str(page)) and (folder / str(page)).is_file()):
            yield Problem("competition.yaml", f"{page} is not in the zip", "add the file")


_WRITE = "write it with 'platform codabench bundle'"


def _leaderboard_problems(competition: Mapping[str, Any]) -> Iterator[Problem]:
    where = "competition.yaml: leaderboards"
    if "leaderboards" not in competition:
        wrong = " ('leaderboard', as the documentation has it, is rejected by the platform)"
        yield Problem(
            where, f"there is none{wrong if 'leaderboard' in competition else ''}", "name it 'leaderboards'"
        )
        return
    boards = mappings_in(competition, "leaderboards")
    columns = [column for board in boards for column in mappings_in(board, "columns")]
    keys = [str(column.get("key")) for column in columns]
    wanted = [column.key for column in COLUMNS]
    if sorted(keys) != sorted(wanted):
        yield Problem(
            where,
            f"its keys are {', '.join(keys)}; the scorer writes {', '.join(wanted)}",
            "use those of the scorer: the platform skips unknown keys without a message",
        )
    for key in keys:
        if len(key) > LONGEST_KEY:
            yield Problem(where, f"key {key!r} is longer than {LONGEST_KEY} characters", "shorten it")
    for column in columns:
        if "computation" in column:
            yield Problem(
                where,
                f"{column.get('key')!r} is computed by the platform, and the scorer sends it",
                "drop 'computation'",
            )
        if column.get("index") == 0 and column.get("sorting") != "desc":
            yield Problem(
                where,
                "the first column is not sorted 'desc': a submission without a score would lead",
                "sort it 'desc'",
            )
    if not any(column.get("index") == 0 and column.get("key") == "final" for column in columns):
        yield Problem(where, "the column with index 0 is not 'final'", "give 'final' the index 0")


def _phase_problems(competition: Mapping[str, Any]) -> Iterator[Problem]:
    phases = mappings_in(competition, "phases")
    if not phases:
        yield Problem("competition.yaml: phases", "there is none", _WRITE)
    for number, phase in enumerate(phases):
        where = f"competition.yaml: phases[{number}]"
        limit = phase.get("execution_time_limit")
        if type(limit) is not int or limit < 1:
            yield Problem(where, f"execution_time_limit {limit!r} is no time", "give seconds, such as 600")
        elif limit > DEFAULT_QUEUE_S:
            yield Problem(
                where,
                f"the phase grants {limit} s, and the platform's own queue stops at {DEFAULT_QUEUE_S} s",
                "set up a queue with workers of your own",
                severe=False,
            )
        for key in ("start", "tasks"):
            if not phase.get(key) and phase.get(key) != 0:
                yield Problem(where, f"it has no {key!r}", f"add {key!r}")
        yield from _date_problems(where, phase)


def _date_problems(where: str, phase: Mapping[str, Any]) -> Iterator[Problem]:
    dates = {}
    for key in ("start", "end"):
        if not phase.get(key):
            continue
        try:
            dates[key] = datetime.fromisoformat(str(phase[key]).replace("Z", "+00:00")).replace(tzinfo=None)
        except ValueError:
            yield Problem(where, f"{key} {str(phase[key])!r} is no date", "write it as 2026-09-01")
    if len(dates) == 2 and dates["end"] <= dates["start"]:
        yield Problem(where, "it ends before it begins", "give an end after the start")


def _member_problems(folder: Path, name: str, key: str) -> Iterator[Problem]:
    file = folder / name
    if not name or not is_there(file) or not file.is_file():
        yield Problem("competition.yaml: tasks", f"{key} {name!r} is not in the zip", "add the file")
        return
    with tempfile.TemporaryDirectory() as inner:
        try:
            members = unpack(file, Path(inner))
        except LogError as error:
            yield Problem(name, error.cause, error.hint)
            return
        names = {member.relative_to(inner).as_posix() for member in members}
        needed = ("metadata.yaml", "scoring.py") if key == "scoring_program" else (PHASE, RULES)
        for one in needed:
            if one not in names:
                deeper = [other for other in names if other.endswith(f"/{one}")]
                what = f"{one} lies in a folder ({deeper[0]})" if deeper else f"it has no {one}"
                yield Problem(name, what, "zip the files themselves, without a folder around them")
        if key == "scoring_program" and "metadata.yaml" in names:
            yield from _command_problems(name, (Path(inner) / "metadata.yaml").read_bytes())
        if key == "reference_data" and HASHES not in names:
            what = f"it has no {HASHES}, so that a changed file would go unnoticed"
            yield Problem(name, what, _WRITE, severe=False)
        if key == "reference_data" and {PHASE, RULES} <= names:
            try:
                load_phase(Path(inner))
            except ScoreError as error:
                place = str(error.file or inner).removeprefix(inner).lstrip("/")
                yield Problem(f"{name}: {place}" if place else name, error.cause, error.hint)


def _command_problems(name: str, text: bytes) -> Iterator[Problem]:
    try:
        metadata = parse_yaml(text, file=f"{name}/metadata.yaml").data
    except ScoreError as error:
        yield Problem(f"{name}/metadata.yaml", error.cause, error.hint)
        return
    if not isinstance(metadata, dict) or not metadata.get("command"):
        yield Problem(f"{name}/metadata.yaml", "it has no 'command'", "give the command that starts it")


# What teams hand in ----------------------------------------------------------------------


def pack(paths: Sequence[Path], output: Path) -> int:
    """Pack trials into a submission that the platform does not take for a program.

    Args:
        paths: Logs and folders of trials; each keeps its own name.
        output: The zip.

    Returns:
        How many files are in it.

    Raises:
        UsageError: Two have one name, one is not there or is a link, or the pack would be a program.
    """
    names = [path.resolve().name for path in paths]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"two trials are named {twice[0]!r}", hint="rename one: <trial>_<n>")
    members = sorted((name, file) for path in paths for name, file in _members_of(path))
    for name, _ in members:
        if name in _RESERVED:
            raise UsageError(
                f"{name!r} at the root would make the platform take the submission for a program",
                file=output,
                hint="pack the folder of the recording, not its contents",
            )
    if not members:
        raise UsageError("there is no file to pack", hint="name logs or folders of trials")
    temporary = output.with_name(f".part-{output.name}")
    try:
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, strict_timestamps=False) as packed:
            for name, file in members:
                info = zipfile.ZipInfo(name, PACKED_STAMP)
                info.compress_type = zipfile.ZIP_DEFLATED
                info.external_attr = 0o644 << 16  # by default only the owner could read it
                with file.open("rb") as source, packed.open(info, "w", force_zip64=True) as out:
                    shutil.copyfileobj(source, out, 1 << 20)
        temporary.replace(output)
    except OSError as cause:
        temporary.unlink(missing_ok=True)
        raise _unwritable(output, cause) from cause
    return len(members)


def _members_of(path: Path) -> Iterator[tuple[str, Path]]:
    if path.is_symlink() or not path.exists():
        what = "it is a link" if path.is_symlink() else "there is no such file or folder"
        raise UsageError(what, file=path, hint="name the logs and folders of trials themselves")
    root = path.resolve().parent
    for file in sorted(path.resolve().rglob("*")) if path.is_dir() else [path.resolve()]:
        if file.is_symlink():
            raise UsageError("it is a link", file=file, hint="replace it by the file it leads to")
        if file.is_file():
            yield file.relative_to(root).as_posix(), file


# Scoring ---------------------------------------------------------------------------------


def score(inputs: Path, output: Path) -> int:
    """Score a submission in the container of the platform; the exit code.

    A bad submission is a scored outcome and ends with 0. A broken scorer ends with 3: the platform
    then keeps neither scores nor files, and only the page survives.

    Args:
        inputs: The folder with `ref` and `res`.
        output: Where `scores.json` and the page go.
    """
    lines: list[str] = []

    def on_line(line: str) -> None:
        lines.append(line)
        _write(output / "detailed_results.html", progress_page(lines))

    try:
        output.mkdir(parents=True, exist_ok=True)
        # The page first: it is all that a participant sees of a scorer that fails.
        _write(output / "detailed_results.html", progress_page(()))
        phase = load_phase(inputs / "ref")
        with tempfile.TemporaryDirectory(prefix="ariac-score-") as work:
            scored = score_submission(inputs / "res", phase, Path(work), on_line=on_line)
        for (trial, number), result in sorted(scored.results.items()):
            place = output / "results" / f"{_file_name(trial)}_{number}.json"
            place.parent.mkdir(exist_ok=True)
            _write(place, as_json(result))
        _write(output / "platform_scores.json", scored.export.text())
        _write(output / "detailed_results.html", result_page(scored))
        # The scores last: whatever fails before this leaves none.
        numbers = scored.export.metrics.by_column()
        _write(output / "scores.json", json.dumps(numbers, allow_nan=False))
        print(scored.export.message)  # noqa: T201  # the platform shows what the program prints
    except Exception as error:  # noqa: BLE001  # no fault of ours may look like a score
        print(f"{type(error).__name__}: {error}", file=sys.stderr)  # noqa: T201
        notice = "The scorer failed. The organisers have the log; this attempt should not count."
        with suppress(OSError):  # a folder that cannot be written has no page either
            (output / "scores.json").unlink(missing_ok=True)
            _write(output / "detailed_results.html", progress_page([*lines, notice]))
        return EXIT_SCORER_FAILED
    return 0


def _file_name(name: str) -> str:
    """A name under which any file system stores one file."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", name).lstrip(".") or "trial"


def _write(place: Path, text: str) -> None:
    """Write a file completely or not at all: the platform reads it every few seconds."""
    temporary = place.with_name(f".{place.name}.tmp")
    # A name in a tar archive may have no place in UTF-8.
    temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    temporary.replace(place)


def dry_run(bundle: Path, submission: Path, folder: Path, *, python: str = sys.executable) -> int:
    """Score a submission as the platform's worker does, in the same folders; the exit code.

    Args:
        bundle: The competition bundle.
        submission: The zip of a team.
        folder: Where `program`, `input` and `output` are laid out; empty or not there.
        python: The interpreter to use instead of the image.

    Raises:
        UsageError: The bundle cannot work, or the folder is in use.
        LogError: An archive is damaged.
    """
    problems = [problem for problem in check_bundle(bundle) if problem.severe]
    if problems:
        raise UsageError(f"{problems[0].where}: {problems[0].what}", file=bundle, hint=problems[0].remedy)
    if folder.exists() and any(folder.iterdir()):
        raise UsageError("the folder is not empty", file=folder, hint="name a new one")
    folder = folder.absolute()
    unpack(bundle, folder / "bundle")
    competition = yaml.safe_load((folder / "bundle/competition.yaml").read_text(encoding="utf-8"))
    task = competition["tasks"][0]
    unpack(folder / "bundle" / task["scoring_program"], folder / "program")
    unpack(folder / "bundle" / task["reference_data"], folder / "input/ref")
    _predict(submission, folder)
    output = folder / "output"
    output.mkdir()
    command = yaml.safe_load((folder / "program/metadata.yaml").read_text(encoding="utf-8"))["command"]
    arguments = [word.replace("/app", str(folder), 1) for word in str(command).split()]
    arguments[0] = python if arguments[0].startswith("python") else arguments[0]
    environment = {"PYTHONUNBUFFERED": "1", "PATH": os.environ.get("PATH", "")}
    limit_s = min(competition["phases"][0]["execution_time_limit"], DEFAULT_QUEUE_S)
    try:
        ended = subprocess.run(  # noqa: S603  # the bundle is the organiser's own
            arguments, cwd=folder / "program", env=environment, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return EXIT_SCORER_FAILED
    (output / "metadata").write_text(f"exitCode: {ended.returncode}\n", encoding="utf-8")
    return ended.returncode


def _predict(submission: Path, folder: Path) -> None:
    """Lay out a submission as the platform does: one with `metadata` at its root is run as a program."""
    result = folder / "input/res"
    unpacked = folder / "submission"
    unpack(submission, unpacked)
    result.mkdir(parents=True)
    if not any((unpacked / name).exists() for name in _RESERVED):
        shutil.copytree(unpacked, result, dirs_exist_ok=True)
    # The worker puts it among the files of the submission, where the scorer has to skip it.
    (result / "metadata").write_text("exitCode: 0\nelapsedTime: 0.1\n", encoding="utf-8")
