"""RML, the Runtime Monitoring Language: parser, checks, formatter, interpreter, monitor.

The text of a specification becomes a `Program` (`running`), by `tokens`, `parser` and
`checks`; its `Machine` (`machine`) rewrites states (`terms`) with each event that its
event types (`matching`, `guards`) match. `columns` and `automaton` do the same for
whole signals at once, and `monitor` makes findings of it.
"""

from __future__ import annotations

from ariac_score_rml.faults import RmlError, RmlRunError
from ariac_score_rml.formatter import format_rml
from ariac_score_rml.monitor import RmlSpec
from ariac_score_rml.running import Program, Run, compile_rml, run_trace

__all__ = ["Program", "RmlError", "RmlRunError", "RmlSpec", "Run", "compile_rml", "format_rml", "run_trace"]
