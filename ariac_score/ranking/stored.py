"""The results of a ranked competition: files that the ranking names with their SHA-256."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from pathlib import Path

from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import DataFileError, ResultError
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.outcomes import WITH_SCORE, Ranking, RunOutcome
from ariac_score.ranking.publication import Publication, StoredResult
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.result import Pinned, Result
from ariac_score.results.result_file import as_json, load_result

__all__ = ["read_stored", "results_folder", "write_results"]

Write = Callable[[str, Path], None]

_PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,79}")


def write_results(ranking: Ranking, folder: Path, write: Write) -> dict[RunKey, StoredResult]:
    """Write the result of every run that has one, as `<team>/<trial>_<n>.json`.

    A name that some system does not allow for a file is replaced by its plain characters and a hash.

    Args:
        ranking: Whose runs.
        folder: Created where missing.
        write: Writes a text to a file.
    """
    stored: dict[RunKey, StoredResult] = {}
    taken: set[str] = set()
    for run in ranking.runs:
        if run.result is None:
            continue
        name = f"{_file_name(run.team)}/{_file_name(run.trial)}_{run.number}.json"
        if name.lower() in taken:  # some file systems take `A` and `a` for one name
            name = f"{_hashed(run.team)}/{_hashed(run.trial)}_{run.number}.json"
        taken.add(name.lower())
        text = as_json(run.result)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write(text, folder / name)
        stored[run.key] = StoredResult(name, hashlib.sha256(text.encode("utf-8")).hexdigest())
    return stored


def _file_name(text: str) -> str:
    # Windows drops a point or a space at the end, so that two names become one.
    return text if _PLAIN.fullmatch(text) and not text.endswith((".", " ")) else _hashed(text)


def _hashed(text: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-")[:40] or "x"
    return f"{plain}-{hashlib.sha256(text.encode('utf-8', 'surrogatepass')).hexdigest()[:12]}"


def results_folder(publication: Publication, file: Path) -> Path | None:
    """The folder a published ranking names; `None` when it names none."""
    return file.parent / publication.folder if publication.folder else None


def read_stored(stored: StoredResult, folder: Path, run: RunOutcome, rule_set: Pinned) -> tuple[Result, str]:
    """The result of one run and its text, checked against the ranking.

    Args:
        stored: Where it is.
        folder: Of the results.
        run: The run as the ranking states it.
        rule_set: The rule set of the ranking.

    Raises:
        DataFileError: The file is missing, or not the one that was ranked.
        ResultError: It is no complete result, or of other rules, or of another run.
    """
    file = folder / stored.file
    hint = "give the results that were written with this ranking"
    if not _is_inside(file, folder):
        raise DataFileError(f"{stored.file!r} leads out of the folder of results", file=folder, hint=hint)
    try:
        content = read_plain(file, MAX_BYTES)
    except OSError as cause:
        raise DataFileError(f"cannot be read: {cause.strerror}", file=file, hint=hint) from None
    found = hashlib.sha256(content).hexdigest()
    if found != stored.sha256:
        raise DataFileError(
            f"its SHA-256 is {found[:12]}…, the ranking was made of {stored.sha256[:12]}…",
            file=file,
            hint=hint,
        )
    # The hash was checked, so the slow search for edits can be spared.
    result = load_result(file, known=True)
    if result.provenance.rule_set != rule_set:
        raise ResultError(
            f"it was made under {result.provenance.rule_set.id}, the ranking under {rule_set.id}",
            file=file,
            hint="results of different rule sets are not ranked together: score all runs under one",
        )
    measured = result.measured
    # A crashed or disqualified run counts another number than its result says.
    same_score = run.outcome not in WITH_SCORE or result.score == run.score
    if measured.trial != run.trial or measured.team not in ("", run.team) or not same_score:
        raise ResultError(
            f"it is of {measured.team or 'no team'}, trial {measured.trial}, score {result.score}; "
            f"the ranking says {run.team}, {run.trial}, {run.score}",
            file=file,
            hint=hint,
        )
    return result, content.decode("utf-8")


def _is_inside(file: Path, folder: Path) -> bool:
    try:
        return file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a loop of links
        return False
