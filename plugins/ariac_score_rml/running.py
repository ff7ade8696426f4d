"""Whole traces: their letters and their verdict."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ariac_score_rml.checks import check
from ariac_score_rml.faults import RmlRunError, Warned
from ariac_score_rml.guards import TOLERANCE
from ariac_score_rml.machine import MAX_STATE, Letter, Machine
from ariac_score_rml.parser import parse
from ariac_score_rml.progress import Progress
from ariac_score_rml.syntax import Spec
from ariac_score_rml.tokens import Dialect
from ariac_score_rml.values import Json

__all__ = ["Program", "Run", "compile_rml", "run_trace"]


@dataclass(frozen=True)
class Program:
    """A specification that has passed all checks.

    Attributes:
        spec: Its syntax.
        warnings: What looks wrong in it.
    """

    spec: Spec
    warnings: tuple[Warned, ...]

    def machine(self, *, tolerance: float = TOLERANCE, max_state: int = MAX_STATE) -> Machine:
        """A machine that runs it."""
        return Machine(self.spec, tolerance=tolerance, max_state=max_state)


def compile_rml(text: str, *, dialect: Dialect = "2024", file: object = None) -> Program:
    """Parse and check a specification.

    Raises:
        RmlError: It is refused; `kind`, `line` and `column` give cause and place.

    >>> program = compile_rml("a matches {x:1}; Main = a*;")
    >>> run_trace(program.machine(), [{"x": 1}, {"x": 2}]).letters
    'tF'
    """
    spec = parse(text, dialect=dialect, file=file)
    return Program(spec, tuple(check(spec, dialect=dialect, file=file)))


@dataclass(frozen=True)
class Run:
    """The outcome of a trace.

    Attributes:
        initial: Letter before any event.
        letters: One for each event, up to the first `F` or `E`.
        error: Why an event could not be judged.
        close: Comparisons that would come out differently without the tolerance.
    """

    initial: Letter
    letters: str
    error: RmlRunError | None = None
    close: int = 0

    @property
    def end(self) -> str:
        """The last letter."""
        return self.letters[-1:] or self.initial

    @property
    def accepted(self) -> bool | None:
        """Whether the trace keeps the specification; `None` when it cannot be judged."""
        return None if self.end == "E" else self.end in "Tt"


def run_trace(machine: Machine, events: Iterable[Json]) -> Run:
    """Run a specification over a trace, event by event."""
    letters: list[str] = []
    before = machine.matcher.solver.close

    def found(initial: Letter, error: RmlRunError | None = None) -> Run:
        return Run(initial, "".join(letters), error, machine.matcher.solver.close - before)

    try:
        progress = Progress(machine, "once")
    except RmlRunError as error:
        return found("E", error)
    for event in events:
        try:
            progress.take(machine.after(progress.state, event))
        except RmlRunError as error:
            letters.append("E")
            return found(progress.initial, error)
        letters.append(progress.letter)
        if progress.over:
            break
    return found(progress.initial)
