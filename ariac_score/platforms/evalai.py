"""EvalAI: the configuration of a challenge, and the worker that scores its submissions remotely.

Its own workers are too old and too small for this engine, so challenges are evaluated remotely.

Source: notes on EvalAI (commit 0f04039), section 3; where the guide and the code differ, the code.
"""

from __future__ import annotations

import json
import re
import shutil
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec
import yaml

from ariac_score.documents.plain_file import read_plain
from ariac_score.documents.yaml import is_there, parse_yaml
from ariac_score.errors import ScoreError, UsageError
from ariac_score.platforms.archives import is_archive, zipped
from ariac_score.platforms.neutral import COLUMNS, PlatformScores
from ariac_score.platforms.problems import Problem, mapping_in, mappings_in
from ariac_score.platforms.submission import Phase, score_submission

__all__ = [
    "Api",
    "ApiError",
    "Challenge",
    "Evaluation",
    "Worker",
    "challenge_config",
    "challenge_files",
    "check_challenge",
]

SUFFIXES = (".zip", ".mcap", ".bag", ".db3", ".jsonl")
"""Files that may be submitted; of these the platform's default list has only `.zip`."""
LARGEST_SUBMISSION = 4 << 30
_CODENAME = re.compile(r"[a-z0-9_]{1,100}")
_DONE = ("finished", "failed", "cancelled")
_TIMEOUT_S = 60.0
_BLOCK = 1 << 20
_PUT_ATTEMPTS = 5
_LONGEST_NAME = 200


# The configuration -----------------------------------------------------------------------


@dataclass(frozen=True)
class Challenge:
    """What an organiser decides about a challenge.

    Attributes:
        title: Of the challenge.
        phase: Code name of its phase and split, `[a-z0-9_]`.
        submissions: At most, in all and in a month.
        submissions_per_day: At most.
        digits: Decimals shown.
    """

    title: str
    phase: str
    submissions: int = 30
    submissions_per_day: int = 3
    digits: int = 3


_LARGEST_CONFIG_BYTES = 4 << 20


def challenge_config(challenge: Challenge) -> str:
    """`challenge_config.yaml` for a challenge that is evaluated remotely.

    Raises:
        UsageError: The code name has other characters.
    """
    if not _CODENAME.fullmatch(challenge.phase):
        raise UsageError(
            f"{challenge.phase!r} is no code name of a phase", hint="use a-z, 0-9 and _, such as finals"
        )
    schema = {
        "labels": [column.key for column in COLUMNS],
        "default_order_by": COLUMNS[0].key,
        # Where a label has metadata without `sort_ascending`, it is sorted ascending.
        "metadata": {
            column.key: {"sort_ascending": not column.descending, "description": column.meaning}
            for column in COLUMNS
        },
    }
    config = {
        "title": challenge.title,
        "remote_evaluation": True,
        "evaluation_script": "evaluation_script.zip",
        "leaderboard": [{"id": 1, "schema": schema}],
        "dataset_splits": [{"id": 1, "name": challenge.title, "codename": challenge.phase}],
        "challenge_phases": [
            {
                "id": 1,
                "name": challenge.title,
                "codename": challenge.phase,
                "is_public": True,
                "leaderboard_public": True,
                "max_submissions_per_day": challenge.submissions_per_day,
                "max_submissions": challenge.submissions,
                "max_submissions_per_month": challenge.submissions,
                "max_concurrent_submissions_allowed": 2,
                "disable_logs": False,
                "allowed_submission_file_types": ", ".join(SUFFIXES),
                "test_annotation_file": f"annotations/{challenge.phase}.json",
            }
        ],
        "challenge_phase_splits": [
            {
                "challenge_phase_id": 1,
                "leaderboard_id": 1,
                "dataset_split_id": 1,
                "visibility": 3,
                "leaderboard_decimal_precision": challenge.digits,
                "is_leaderboard_order_descending": True,
                "show_execution_time": True,
                "show_leaderboard_by_latest_submission": False,
            }
        ],
    }
    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True)


_SCRIPT = """\
def evaluate(*_, **__):
    raise RuntimeError("this challenge is evaluated remotely: run 'ariac-score platform evalai worker'")
"""


def challenge_files(challenge: Challenge) -> dict[str, bytes]:
    """The configuration with the files that it names, by name.

    The importer requires a script and an annotation file even where neither is used; the script raises an
    error that says so.

    Raises:
        UsageError: The code name has other characters than the platform takes.
    """
    config = challenge_config(challenge)
    script = {"__init__.py": b"from .main import evaluate\n", "main.py": _SCRIPT.encode()}
    return {
        "challenge_config.yaml": config.encode("utf-8"),
        "evaluation_script.zip": zipped(script),
        f"annotations/{challenge.phase}.json": b"{}\n",
    }


def check_challenge(file: Path) -> list[Problem]:
    """Everything about a configuration that the platform gets wrong in silence."""
    try:
        config = parse_yaml(read_plain(file, _LARGEST_CONFIG_BYTES), file=str(file)).data
    except OSError as cause:
        return [Problem(str(file), f"cannot be read: {cause.strerror}", "check the path")]
    except ScoreError as error:
        return [Problem(str(file), error.cause, error.hint)]
    if not isinstance(config, dict):
        return [Problem(str(file), "it is no mapping", "write it with 'platform evalai config'")]
    return [*_problems(config), *_file_problems(config, file.parent)]


def _file_problems(config: Mapping[str, Any], folder: Path) -> Iterator[Problem]:
    named = [("evaluation_script", config.get("evaluation_script"))]
    named += [
        (f"challenge_phases[{number}]: test_annotation_file", phase.get("test_annotation_file"))
        for number, phase in enumerate(mappings_in(config, "challenge_phases"))
    ]
    for where, name in named:
        if not isinstance(name, str) or not is_there(folder / name) or not (folder / name).is_file():
            yield Problem(
                where,
                f"{name!r} is not in the folder of the configuration, and the importer requires it",
                "write it with 'platform evalai config --folder'",
                severe=False,
            )


def _problems(config: Mapping[str, Any]) -> Iterator[Problem]:
    if config.get("remote_evaluation") is not True:
        what = "the platform's own workers are Python 3.7 to 3.9 with 1 GiB: this engine does not run there"
        yield Problem("remote_evaluation", what, "set it to true, and run 'platform evalai worker'")
    labels = [column.key for column in COLUMNS]
    for key in ("leaderboard", "dataset_splits", "challenge_phases", "challenge_phase_splits"):
        if not mappings_in(config, key):
            yield Problem(
                key,
                "there is none, or it is no list of mappings",
                "write it as 'platform evalai config' does",
            )
    for number, board in enumerate(mappings_in(config, "leaderboard")):
        where, schema = f"leaderboard[{number}]", mapping_in(board.get("schema"))
        stated = schema.get("labels")
        if not isinstance(stated, list) or sorted(map(str, stated)) != sorted(labels):
            yield Problem(where, "its labels are not those of the worker", f"use {', '.join(labels)}")
        for label, about in mapping_in(schema.get("metadata")).items():
            if "sort_ascending" not in mapping_in(about):
                yield Problem(
                    f"{where}: metadata: {label}",
                    "without 'sort_ascending' the label is sorted ascending: the worst would lead",
                    "add sort_ascending: false for scores",
                )
    splits = {str(split.get("codename")) for split in mappings_in(config, "dataset_splits")}
    for number, phase in enumerate(mappings_in(config, "challenge_phases")):
        yield from _phase_problems(f"challenge_phases[{number}]", phase, splits)
    for number, split in enumerate(mappings_in(config, "challenge_phase_splits")):
        if split.get("show_leaderboard_by_latest_submission"):
            yield Problem(
                f"challenge_phase_splits[{number}]",
                "the leaderboard would come newest first, not sorted by score",
                "set show_leaderboard_by_latest_submission: false",
            )


def _phase_problems(where: str, phase: Mapping[str, Any], splits: set[str]) -> Iterator[Problem]:
    allowed = str(phase.get("allowed_submission_file_types", ""))
    missing = [suffix for suffix in SUFFIXES if suffix not in allowed]
    if missing:
        yield Problem(
            where,
            f"submissions ending in {', '.join(missing)} are refused",
            f'set allowed_submission_file_types: "{", ".join(SUFFIXES)}"',
        )
    if str(phase.get("codename")) not in splits:
        yield Problem(
            where,
            f"no dataset split has its code name {phase.get('codename')!r}, under which the worker answers",
            "give phase and split one code name",
        )


# What the platform is sent ---------------------------------------------------------------


@dataclass(frozen=True)
class Evaluation:
    """The body that ends an evaluation, in the shape that the platform's code takes.

    Its guide has another shape, with `result` as a list; the code parses a text.

    Attributes:
        challenge_phase: Number of the phase.
        submission: Number of the submission.
        submission_status: `FINISHED` or `FAILED`.
        stdout: Shown to the participant.
        stderr: Why it failed.
        environment_log: Of the container that the platform would have started.
        result: The rows of the leaderboard, as JSON.
        metadata: For the host of the challenge, as JSON.
    """

    challenge_phase: int
    submission: int
    submission_status: str
    stdout: str = ""
    stderr: str = ""
    environment_log: str = ""
    result: str = "[]"
    metadata: str = "{}"

    @classmethod
    def finished(cls, scores: PlatformScores, *, split: str, phase_pk: int, submission_pk: int) -> Evaluation:
        """The end of an evaluation with scores.

        Args:
            scores: Of the submission.
            split: Code name of the dataset split; the platform knows no other name.
            phase_pk: Number of the phase.
            submission_pk: Number of the submission.
        """
        row = {"split": split, "show_to_participant": True, "accuracies": scores.metrics.by_column()}
        return cls(
            phase_pk,
            submission_pk,
            "FINISHED",
            stdout=f"{scores.message}\nresult sha256 {scores.result_sha256 or 'none'}\n",
            result=json.dumps([row], allow_nan=False),
            metadata=json.dumps({"status": scores.status, "result_sha256": scores.result_sha256}),
        )

    @classmethod
    def failed(cls, message: str, *, phase_pk: int, submission_pk: int) -> Evaluation:
        """The end of an evaluation that the scorer could not do."""
        return cls(phase_pk, submission_pk, "FAILED", stderr=message)


# The worker ------------------------------------------------------------------------------


class ApiError(Exception):
    """The platform answered with an error, or not at all.

    Attributes:
        status: Of the answer; 0 when there was none.
        text: Of the answer.
    """

    def __init__(self, status: int, text: str) -> None:
        super().__init__(f"HTTP {status}: {text}" if status else text)
        self.status, self.text = status, text

    @property
    def transient(self) -> bool:
        """Whether the same request may succeed later."""
        return self.status == 0 or self.status >= 500


_SCHEMES = ("Bearer", "Token")
_UNAUTHORIZED = 401


@dataclass(frozen=True)
class Api:
    """The part of the platform's interface that a worker needs.

    Attributes:
        server: Such as `https://eval.ai`.
        token: Of the organiser; it goes into a header and nowhere else.
        queue: Name of the challenge's queue.
        challenge: Number of the challenge.
        scheme: Word before the token; empty to try `Bearer` and `Token` until one is accepted: the
            platform's starter sends one, its own worker the other.
    """

    server: str
    token: str = field(repr=False)
    queue: str
    challenge: int
    scheme: str = ""
    _accepted: list[str] = field(default_factory=list, init=False, repr=False, compare=False)

    def request(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> Any:
        """Make one request; its answer.

        Raises:
            ApiError: It failed.
        """
        schemes = (self.scheme,) if self.scheme else tuple(self._accepted) or _SCHEMES
        for scheme in schemes:
            try:
                answer = self._send(scheme, method, path, body)
            except ApiError as error:
                if error.status == _UNAUTHORIZED and scheme != schemes[-1]:
                    continue
                if error.status not in (0, _UNAUTHORIZED):
                    self._accepted[:] = [scheme]
                raise
            self._accepted[:] = [scheme]
            return answer
        raise AssertionError("the last attempt returns or raises")

    def _send(self, scheme: str, method: str, path: str, body: Mapping[str, Any] | None) -> Any:
        data = None if body is None else json.dumps(body, allow_nan=False).encode()
        headers = {"Authorization": f"{scheme} {self.token}", "Content-Type": "application/json"}
        url = urllib.parse.urljoin(self.server, path)
        request = urllib.request.Request(_web(url), data=data, headers=headers, method=method)  # noqa: S310
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310
                text = answer.read()
        except urllib.error.HTTPError as error:
            raise ApiError(error.code, error.read(4096).decode("utf-8", "replace")) from error
        except (OSError, ValueError) as error:
            raise ApiError(0, str(error)) from error
        try:
            return json.loads(text) if text.strip() else {}
        except ValueError as error:
            raise ApiError(0, f"no JSON: {text[:200]!r}") from error

    def download(self, url: str, file: Path) -> None:
        """Fetch a submission, whole or not at all; the address needs no token.

        Raises:
            ApiError: It cannot be fetched, is too large, or is cut off.
        """
        full = _web(urllib.parse.urljoin(self.server, url))
        try:
            with urllib.request.urlopen(full, timeout=_TIMEOUT_S) as answer, file.open("wb") as out:  # noqa: S310
                announced = int(answer.headers.get("Content-Length") or -1)
                size = 0
                while block := answer.read(_BLOCK):
                    size += len(block)
                    if size > LARGEST_SUBMISSION:
                        raise ApiError(413, f"it has more than {LARGEST_SUBMISSION} bytes")
                    out.write(block)
        except urllib.error.HTTPError as error:
            raise ApiError(error.code, str(error)) from error
        except (OSError, ValueError) as error:
            raise ApiError(0, str(error)) from error
        if announced not in (-1, size):
            raise ApiError(0, f"{size} of {announced} bytes arrived")


def _web(url: str) -> str:
    """The URL, if it is one of the web: a submission may not name a file of this machine."""
    if urllib.parse.urlsplit(url).scheme not in ("http", "https"):
        raise ApiError(400, f"{url!r} is no address on the web")
    return url


@dataclass
class Worker:
    """Takes submissions from a queue, scores them, and sends back the outcomes.

    Each answer is kept, so that a message that comes twice is answered with the same bytes.

    Attributes:
        api: The platform.
        phase: Rules, trials, limits.
        store: Folder for submissions and answers.
        pause: Called with seconds before a request is tried again.
        on_line: Called with a line for each step.
        codename: Of the phase that is scored; empty for any phase in the queue.
    """

    api: Api
    phase: Phase
    store: Path
    pause: Callable[[float], None]
    on_line: Callable[[str], None]
    codename: str = ""

    def once(self) -> bool:
        """Process one message; whether there was one.

        Raises:
            ApiError: The platform cannot be reached; the message comes again.
        """
        message = mapping_in(self.api.request("GET", f"/api/jobs/challenge/queues/{self.api.queue}/"))
        if not message.get("body"):
            return False
        submission, phase, receipt = _numbers(message)
        state = mapping_in(self.api.request("GET", f"/api/jobs/submission/{submission}"))
        if str(state.get("status", "")).lower() in _DONE:
            self.on_line(f"submission {submission}: is {state['status']} already")
        else:
            self._answer(submission, phase, self._split(phase), str(state.get("input_file", "")))
        # Only now: a message that is not acknowledged comes again, also to another worker.
        self.api.request("POST", f"/api/jobs/queues/{self.api.queue}/", {"receipt_handle": receipt})
        return True

    def _split(self, phase: int) -> str:
        """The code name of a phase, which is that of its split.

        Raises:
            ApiError: The message belongs to a worker with other reference data.
        """
        answer = mapping_in(
            self.api.request("GET", f"/api/challenges/challenge/{self.api.challenge}/challenge_phase/{phase}")
        )
        name = str(answer.get("codename", ""))
        if not _CODENAME.fullmatch(name):
            raise ApiError(400, f"phase {phase} has no code name")
        if self.codename and name != self.codename:
            raise ApiError(
                400, f"a submission is for phase {name!r}, and this worker scores {self.codename!r}"
            )
        return name

    def _answer(self, submission: int, phase: int, split: str, url: str) -> None:
        place = self.store / str(submission)
        place.mkdir(parents=True, exist_ok=True)
        kept = place / "answer.json"
        update = f"/api/jobs/challenge/{self.api.challenge}/update_submission/"
        if not kept.is_file():
            running = {"submission": submission, "submission_status": "RUNNING", "job_name": ""}
            self.api.request("PATCH", update, running)
            temporary = place / ".answer.json"
            evaluation = self._evaluated(place, submission, phase, split, url)
            temporary.write_text(json.dumps(asdict(evaluation)), encoding="utf-8")
            temporary.replace(kept)
        answer = msgspec.convert(json.loads(kept.read_text(encoding="utf-8")), Evaluation)
        try:
            self._put(update, answer)
        except ApiError as error:
            if error.transient:
                raise
            # The platform refuses the answer for good: report that, or the submission hangs for ever.
            self._put(update, Evaluation.failed(error.text, phase_pk=phase, submission_pk=submission))
        self.on_line(f"submission {submission}: {answer.submission_status.lower()}")

    def _evaluated(self, place: Path, submission: int, phase: int, split: str, url: str) -> Evaluation:
        files = place / "files"
        shutil.rmtree(files, ignore_errors=True)  # of an attempt that was cut off
        files.mkdir()
        try:
            self._fetch(url, files)
            scored = score_submission(files, self.phase, place / "work", on_line=self.on_line)
            return Evaluation.finished(scored.export, split=split, phase_pk=phase, submission_pk=submission)
        except ApiError as error:
            if error.transient:
                raise
            # Left in the queue, it would stop this worker again and again, and all submissions behind it.
            cause = f"the submission cannot be fetched: {error}"
            return Evaluation.failed(cause, phase_pk=phase, submission_pk=submission)
        except ScoreError as error:
            return Evaluation.failed(str(error), phase_pk=phase, submission_pk=submission)

    def _fetch(self, url: str, files: Path) -> None:
        """Download a submission under the name of its trial: the platform may have renamed it."""
        file = files / _file_name(url)
        self.api.download(url, file)
        if len(self.phase.trials) == 1 and not is_archive(file):
            file.rename(files / f"{self.phase.trials[0].id}_1{file.suffix}")

    def _put(self, path: str, evaluation: Evaluation) -> None:
        body = asdict(evaluation)
        for attempt in range(1, _PUT_ATTEMPTS + 1):
            try:
                self.api.request("PUT", path, body)
                return
            except ApiError as error:
                if not error.transient or attempt == _PUT_ATTEMPTS:
                    raise
                self.pause(2.0**attempt)


def _numbers(message: Mapping[str, Any]) -> tuple[int, int, str]:
    """Submission, phase and receipt of a message.

    Raises:
        ApiError: It is no message of a submission.
    """
    try:
        body = message["body"]
        return int(body["submission_pk"]), int(body["phase_pk"]), str(message["receipt_handle"])
    except (KeyError, TypeError, ValueError) as error:
        raise ApiError(400, f"the queue gave no message of a submission: {str(message)[:200]}") from error


def _file_name(url: str) -> str:
    """The name for a submission here: its suffix shows the kind of file, the rest the trial."""
    name = PurePosixPath(urllib.parse.unquote(urllib.parse.urlsplit(url).path)).name
    plain = re.sub(r"[^A-Za-z0-9._-]", "_", name)[-_LONGEST_NAME:].lstrip(".")
    return plain or "submission"
