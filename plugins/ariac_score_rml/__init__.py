"""RML, the Runtime Monitoring Language: parser, checks, formatter, interpreter, monitor.

The text of a specification becomes a `Program` (`running`), by `tokens`, `parser` and
`checks`; its `Machine` (`machine`) rewrites states (`terms`) with each event that its
event types (`matching`, `guards`) match. `columns` and `automaton` do the same for
whole signals at once, `lines` and `digits` for traces whose lines are alike, and
`monitor` makes findings of it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ariac_score_rml.faults import RmlError, RmlRunError
    from ariac_score_rml.formatter import format_rml
    from ariac_score_rml.monitor import RmlSpec
    from ariac_score_rml.running import Program, Run, compile_rml, run_trace

_MODULE_OF = {
    "Program": "running",
    "RmlError": "faults",
    "RmlRunError": "faults",
    "RmlSpec": "monitor",
    "Run": "running",
    "compile_rml": "running",
    "format_rml": "formatter",
    "run_trace": "running",
}

__all__ = ["Program", "RmlError", "RmlRunError", "RmlSpec", "Run", "compile_rml", "format_rml", "run_trace"]


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for: the commands need few of them."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
