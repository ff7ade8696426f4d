"""Pricing stored measurements by other rules: thousands of results in seconds, without a log.

Pricing runs no plugin, so it needs no process for each run: a few processes stay. They read and write
the documents themselves; only names and rows are sent between processes.
"""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from ariac_score.batch.index import Row, Written
from ariac_score.batch.local import begin_server, fresh_processes, started, stop, usable_cores
from ariac_score.batch.store import Store, read_document
from ariac_score.batch.tasks import BatchSetting, RunTask, TaskKey
from ariac_score.batch.worker import prepared
from ariac_score.engine.price import reprice
from ariac_score.errors import ResultError, ScoreError
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json, result_in
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["Measurement", "Priced", "Pricing"]

_AT_A_TIME = 32
"""Measurements that a process gets in one message."""
_AHEAD = 1024
"""Measurements that wait, at most; the first so many are looked up while the processes start."""
_AT_LEAST_S = 60.0
"""How long an answer may take where the limit of a run is shorter: it is about `_AT_A_TIME` of them."""
_GOING_S = 10.0
"""How long a process may take to finish what it has begun before it is killed."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """A run that is measured, and priced by other rules.

    Attributes:
        task: The run.
        address: Of the measurement.
        stored: File name of the result under other rules; the new one is written to the same folder.
        sha256: Its hash in the tables.
    """

    task: RunTask
    address: str
    stored: str
    sha256: str


_Request = tuple[TaskKey, str, str, str]
"""A measurement as it is sent to a process: key, address, stored, sha256."""


Priced = tuple[Measurement, "Written | None"]
"""A measurement with the row of its new result, which is stored; `None` where its log has to be read."""


class Pricing:
    """Prices measurements by other rules, in a few processes, while the caller looks up more of them.

    Args:
        setting: The rules.
        store: The folder of the batch.
        work: Folder for unfinished work.
    """

    def __init__(self, setting: BatchSetting, store: Store, work: Path) -> None:
        self._setting, self._store, self._work = setting, store, work
        self._context: Any = None
        self._waiting: deque[Measurement] = deque()
        self._pricers: dict[Any, _Pricer] = {}
        self._started = False

    def take(self, one: Measurement) -> Iterator[Priced]:
        """Take a measurement, and yield those that are priced by now.

        Raises:
            OSError: The folder cannot be written, as when the disk is full.
        """
        if self._context is None:
            self._context = fresh_processes(self._work, self._setting)
            begin_server(self._context)
        self._waiting.append(one)
        if len(self._waiting) >= _AHEAD:
            yield from self._go_on()

    def rest(self) -> Iterator[Priced]:
        """Yield all that are left.

        Raises:
            OSError: As in `take`.
        """
        while self._waiting or any(pricer.at_work for pricer in self._pricers.values()):
            yield from self._go_on()

    def close(self) -> None:
        """End the processes."""
        for pricer in self._pricers.values():
            pricer.end()
        self._pricers.clear()

    def _go_on(self) -> Iterator[Priced]:
        """Hand out what waits, and wait for the first answer."""
        if not self._started:
            self._start()
        for pricer in self._pricers.values():
            self._hand_out(pricer)
        if not self._pricers:  # all of them have died
            yield from ((self._waiting.popleft(), None) for _ in range(len(self._waiting)))
            return
        at_work = [place for place, pricer in self._pricers.items() if pricer.at_work]
        ready = wait(at_work, timeout=max(self._setting.limits.wall_s, _AT_LEAST_S))
        for connection in () if ready else at_work:  # they are stopped or stuck: their logs are read instead
            yield from self._without(connection)
        for connection in ready:
            pricer = self._pricers[connection]
            measurements, rows = pricer.at_work, pricer.answer()
            if rows is None:
                pricer.at_work = measurements
                yield from self._without(connection)
            else:
                self._hand_out(pricer)  # first, so that it works while the caller takes the rows
                yield from zip(measurements, rows, strict=True)

    def _without(self, connection: Any) -> Iterator[Priced]:
        """Go on without a process; what it was working on has no price."""
        pricer = self._pricers.pop(connection)
        measurements, pricer.at_work = pricer.at_work, ()
        pricer.end()
        yield from ((one, None) for one in measurements)

    def _start(self) -> None:
        self._started = True
        for _ in range(min(usable_cores(), -(-len(self._waiting) // _AT_A_TIME))):
            pricer = _Pricer(self._context, self._setting, self._store)
            self._pricers[pricer.connection] = pricer

    def _hand_out(self, pricer: _Pricer) -> None:
        if self._waiting and not pricer.at_work:
            count = min(_AT_A_TIME, len(self._waiting))
            pricer.send([self._waiting.popleft() for _ in range(count)])


class _Pricer:
    """A process that prices measurements, some at a time.

    Attributes:
        at_work: Those that it is pricing; empty when it waits.
        connection: To the process.
    """

    def __init__(self, context: Any, setting: BatchSetting, store: Store) -> None:
        self.at_work: Sequence[Measurement] = ()
        self.connection, other = context.Pipe()
        self._process: BaseProcess = started(context, _serve, (other, setting, str(store.root)))
        other.close()

    def send(self, measurements: Sequence[Measurement]) -> None:
        """Have some priced; that the process has died is noticed by `answer`."""
        self.at_work = measurements
        with suppress(OSError):
            self.connection.send(
                [(one.task.key, one.address, one.stored, one.sha256) for one in measurements]
            )

    def answer(self) -> list[Written | None] | None:
        """The rows of the measurements that were sent; `None` when the process died.

        Raises:
            OSError: It could not write.
        """
        try:
            rows: list[Written | None] | OSError = self.connection.recv()
        except (EOFError, ConnectionError):
            return None
        finally:
            self.at_work = ()
        if isinstance(rows, OSError):
            raise rows
        return rows

    def end(self) -> None:
        """End the process once it has finished what it writes."""
        self.connection.close()
        self._process.join(_GOING_S)
        stop(self._process)


def _serve(connection: Connection, setting: BatchSetting, out: str) -> None:
    """What such a process does until the connection is closed."""
    # Ctrl-C goes to the whole process group; the supervisor decides when its processes end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    store = Store(Path(out))
    with suppress(EOFError, ConnectionError, ScoreError):
        rule_set = prepared(setting)[0].rule_set
        while True:
            requests: list[_Request] = connection.recv()
            try:
                connection.send([_priced(*one, setting.rules_sha256, rule_set, store) for one in requests])
            except ConnectionError:
                return
            except OSError as error:
                connection.send(error)


def _priced(
    key: TaskKey, address: str, stored: str, known: str, rules_sha256: str, rule_set: RuleSet, store: Store
) -> Written | None:
    """Store a result under other rules; its row, or `None` where the log has to be read.

    Raises:
        OSError: It cannot be written.
    """
    try:
        before = _measured(store.measured(address) / stored, known)
        document = as_json(reprice(before, rule_set)).encode("utf-8")
    except (OSError, ScoreError):
        return None  # an outcome, or a check that was not measured
    name = store.name_of(address, rules_sha256)
    store.put(store.root / name, document)
    return Written.of(Row.kept(key, document, name))


def _measured(place: Path, known: str) -> Result:
    """The stored result that the tables recorded.

    Raises:
        ResultError: Another lies there, or none.
        OSError: It cannot be read.
    """
    document = read_document(place)
    if sha256(document).hexdigest() != known:
        raise ResultError("it is not what the tables recorded", file=place)
    return result_in(document, place, known=True)
