"""What a check's findings are worth where its log is cut off, and nobody knows what came after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

__all__ = ["WHEN_CUT", "WhenCut", "when_cut_of"]

WhenCut: TypeAlias = Literal["adds", "kept", "witnessed", "official", "open"]

WHEN_CUT: Mapping[str, str] = {
    "adds": "what was seen stays, and more may have come",
    "kept": "nothing that came after changes it",
    "witnessed": "it leaves open itself what the log would not have shown (`Trial.witnessed`)",
    "official": "it rests on the official record, which is whole where it is a file of its own",
    "open": "what came after may change all of it",
}
"""What a rule or monitor can say of itself, as `when_cut`; `open` where it says nothing."""

assert WHEN_CUT.keys() == {*get_args(WhenCut)}


def when_cut_of(check: object) -> str:
    """What a check says."""
    return str(getattr(check, "when_cut", "open"))
