"""Which facts a run has: a run of which one is otherwise is refused before it is scored."""

from __future__ import annotations

from ariac_score import FactSchemas

__all__ = ["FACTS"]

_NAME = {"type": "string", "minLength": 1}

FACTS = FactSchemas(
    {
        "trial": {
            "type": "object",
            "required": ["test", "objects", "time_limit_s"],
            "properties": {
                "test": _NAME,
                "objects": {"enum": ["real", "april_tags"]},
                "time_limit_s": {"type": "number", "exclusiveMinimum": 0},
            },
        },
        "task": {"type": "object", "required": ["source", "target"]},
        "object": {
            "type": "object",
            "required": ["type", "source", "target"],
            "properties": {"type": _NAME, "source": _NAME, "target": _NAME},
        },
    }
)
