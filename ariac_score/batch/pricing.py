"""Other prices on what was measured: thousands of results in seconds, without a log.

Pricing is code of ours and asks no plugin, so results are priced in a few processes that stay. They
read and write the documents themselves: between processes go only names and rows.
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
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, RunTask, TaskKey
from ariac_score.batch.worker import prepared
from ariac_score.engine.price import reprice
from ariac_score.errors import ScoreError
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json, check_follows, result_in
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["Measurement", "Priced", "Pricing"]

_AT_A_TIME = 32
_AHEAD = 1024
"""So many are looked for while the processes start, and are known at a time."""
_AT_LEAST_S = 60.0
"""How long an answer may take where the limit of a run is shorter: these are some at a time."""
_GOING_S = 10.0
"""How long a process may take to finish what it has begun when nobody wants more of it."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """A run that is measured, and priced by other rules.

    Attributes:
        task: The run.
        address: Of what was measured.
        stored: Name of the result under other rules, beside which the one under these will lie.
        sha256: Its hash, where the tables know it: then it need not be checked again.
    """

    task: RunTask
    address: str
    stored: str
    sha256: str


_Asked = tuple[TaskKey, str, str, str]
"""A measurement on its way to a process: key, address, stored, sha256."""


Priced = tuple[Measurement, "Written | None"]
"""A measurement with the row of its result, which is stored; `None` where its log must be looked at."""


class Pricing:
    """Puts other prices on measurements, in a few processes, while more of them are looked for.

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
        """Take a measurement, and give those that are priced by now.

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
        """Give all that are left.

        Raises:
            OSError: As in `take`.
        """
        while self._waiting or any(pricer.asked for pricer in self._pricers.values()):
            yield from self._go_on()

    def close(self) -> None:
        """Let the processes go."""
        for pricer in self._pricers.values():
            pricer.end()
        self._pricers.clear()

    def _go_on(self) -> Iterator[Priced]:
        """Hand out what waits, and wait for whoever is ready first."""
        if not self._started:
            self._start()
        for pricer in self._pricers.values():
            self._hand_out(pricer)
        if not self._pricers:  # nobody is left to price them
            yield from ((self._waiting.popleft(), None) for _ in range(len(self._waiting)))
            return
        at_work = [place for place, pricer in self._pricers.items() if pricer.asked]
        ready = wait(at_work, timeout=max(self._setting.limits.wall_s, _AT_LEAST_S))
        for connection in () if ready else at_work:  # they are stopped or stuck: somebody else has to do it
            yield from self._without(connection)
        for connection in ready:
            pricer = self._pricers[connection]
            asked, rows = pricer.asked, pricer.answer()
            if rows is None:
                pricer.asked = asked
                yield from self._without(connection)
            else:
                self._hand_out(pricer)
                yield from zip(asked, rows, strict=True)

    def _without(self, connection: Any) -> Iterator[Priced]:
        """Go on without a process; what it was asked for has no price."""
        pricer = self._pricers.pop(connection)
        asked, pricer.asked = pricer.asked, ()
        pricer.end()
        yield from ((one, None) for one in asked)

    def _start(self) -> None:
        self._started = True
        for _ in range(min(usable_cores(), -(-len(self._waiting) // _AT_A_TIME))):
            pricer = _Pricer(self._context, self._setting, self._store)
            self._pricers[pricer.connection] = pricer

    def _hand_out(self, pricer: _Pricer) -> None:
        if self._waiting and not pricer.asked:
            count = min(_AT_A_TIME, len(self._waiting))
            pricer.ask([self._waiting.popleft() for _ in range(count)])


class _Pricer:
    """A process that prices what it is asked to, some at a time."""

    def __init__(self, context: Any, setting: BatchSetting, store: Store) -> None:
        self.asked: Sequence[Measurement] = ()
        self.connection, other = context.Pipe()
        self._process: BaseProcess = started(context, _serve, (other, setting, str(store.root)))
        other.close()

    def ask(self, measurements: Sequence[Measurement]) -> None:
        """Have some priced; a process that has died says so when it is to answer."""
        self.asked = measurements
        with suppress(OSError):
            self.connection.send(
                [(one.task.key, one.address, one.stored, one.sha256) for one in measurements]
            )

    def answer(self) -> list[Written | None] | None:
        """The rows of what was asked; `None` when the process died.

        Raises:
            OSError: It could not write.
        """
        try:
            rows: list[Written | None] | OSError = self.connection.recv()
        except (EOFError, ConnectionError):
            return None
        finally:
            self.asked = ()
        if isinstance(rows, OSError):
            raise rows
        return rows

    def end(self) -> None:
        """Let the process finish what it writes, and go."""
        self.connection.close()
        self._process.join(_GOING_S)
        stop(self._process)


def _serve(connection: Connection, setting: BatchSetting, out: str) -> None:
    """What such a process does, until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    store = Store(Path(out))
    with suppress(EOFError, ConnectionError, ScoreError):
        rule_set = prepared(setting)[0].rule_set
        while True:
            asked: list[_Asked] = connection.recv()
            try:
                connection.send([_priced(*one, setting.rules_sha256, rule_set, store) for one in asked])
            except ConnectionError:
                return
            except OSError as error:
                connection.send(error)


def _priced(
    key: TaskKey, address: str, stored: str, known: str, rules_sha256: str, rule_set: RuleSet, store: Store
) -> Written | None:
    """The row of a result under other rules, once it is stored; `None` where the log must be looked at.

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
    """A stored result, checked as a whole unless it has the hash that is known."""
    document = place.read_bytes()
    if sha256(document).hexdigest() == known:
        return result_in(document, place, known=True)
    result = result_in(document, place)
    check_follows(result)
    return result
