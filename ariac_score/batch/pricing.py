"""Other prices on what was measured: thousands of results in seconds, without a log.

Pricing is code of ours and asks no plugin, so results are priced in a few processes that stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from ariac_score.batch.local import fresh_processes, usable_cores
from ariac_score.batch.tasks import Setting, Task
from ariac_score.batch.worker import prepared
from ariac_score.engine import reprice
from ariac_score.errors import ScoreError
from ariac_score.result_json import as_json, load_result, read_result

__all__ = ["Measurement", "priced_again"]

_AT_A_TIME = 32


@dataclass(frozen=True)
class Measurement:
    """A run that is measured, and priced by other rules.

    Attributes:
        task: The run.
        address: Of what was measured.
        stored: The result under other rules.
        sha256: Its hash, where the tables know it: then it need not be checked again.
    """

    task: Task
    address: str
    stored: str
    sha256: str


def priced_again(
    measurements: Sequence[Measurement], setting: Setting, work: Path
) -> Iterator[tuple[Measurement, bytes | None]]:
    """Each measurement with its result under the rules of the setting; `None` where it must be measured.

    Args:
        measurements: What is stored.
        setting: The rules.
        work: Folder for unfinished work.
    """
    told = 0
    chunks = [measurements[i : i + _AT_A_TIME] for i in range(0, len(measurements), _AT_A_TIME)]
    context = fresh_processes(work, setting)
    with ProcessPoolExecutor(min(usable_cores(), max(1, len(chunks))), mp_context=context) as pool:
        try:
            for chunk, documents in zip(
                chunks, pool.map(_price, chunks, [setting] * len(chunks)), strict=True
            ):
                yield from zip(chunk, documents, strict=True)
                told += len(chunk)
        except BrokenProcessPool:
            yield from ((one, None) for one in measurements[told:])


def _price(measurements: Sequence[Measurement], setting: Setting) -> list[bytes | None]:
    _, rule_set, _ = prepared(setting)
    documents: list[bytes | None] = []
    for one in measurements:
        try:
            file = Path(one.stored)
            known = sha256(file.read_bytes()).hexdigest() == one.sha256
            stored = read_result(file, known=True) if known else load_result(file)
            documents.append(as_json(reprice(stored, rule_set)).encode("utf-8"))
        except (OSError, ScoreError):
            documents.append(None)  # an outcome, or a check that was not measured: look at the log
    return documents
