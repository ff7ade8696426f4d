"""RML, the Runtime Monitoring Language: parser, checks, formatter, interpreter, monitor.

The text of a specification becomes a `Program` (`running`), by `tokens`, `parser` and
`checks`; its `Machine` (`machine`) rewrites states (`terms`) with each event that its
event types (`matching`, `guards`) match. `columns` and `automaton` do the same for whole
signals at once, `trace_columns` for traces; `monitor` turns the outcome into findings, `cli` into letters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ariac_score_rml.faults import RmlError, RmlRunError
from ariac_score_rml.formatter import format_rml
from ariac_score_rml.running import Program, Run, compile_rml, run_trace

if TYPE_CHECKING:
    from ariac_score_rml.monitor import RmlSpec

__all__ = ["Program", "RmlError", "RmlRunError", "RmlSpec", "Run", "compile_rml", "format_rml", "run_trace"]


def __getattr__(name: str) -> Any:
    """The monitor, loaded when it is used.

    `rml check` and `rml format` need neither signals nor numpy: this package takes 0.08 s of processor
    time to load without the monitor and 0.28 s with it.
    """
    if name != "RmlSpec":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ariac_score_rml.monitor import RmlSpec  # noqa: PLC0415  # see above

    return RmlSpec
