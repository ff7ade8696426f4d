"""Errors in a specification, and errors when it runs."""

from __future__ import annotations

from ariac_score import ScoreError

__all__ = ["RmlError", "RmlRunError", "Warned"]


class RmlError(ScoreError):
    """A specification is refused.

    Attributes:
        kind: One word for programs, such as `syntax` or `not_contractive`.
        line: Where it begins, counted from 1; 0 when it concerns the whole text.
        column: Likewise, in characters.
    """

    exit_code = 4

    def __init__(
        self,
        cause: str,
        *,
        kind: str = "syntax",
        line: int = 0,
        column: int = 0,
        file: object = None,
        hint: str = "",
    ) -> None:
        self.kind, self.line, self.column = kind, line, column
        place = f"line {line}, column {column}" if line else ""
        super().__init__(cause, file=file, place=place, hint=hint)


class RmlRunError(ScoreError):
    """An event cannot be judged: where the reference program dies, and where a limit is reached.

    Attributes:
        kind: `type_error`, `evaluation_error`, `unbound`, `unsupported` or `limit`.
    """

    exit_code = 6

    def __init__(self, cause: str, *, kind: str, hint: str = "") -> None:
        self.kind = kind
        super().__init__(cause, hint=hint)


class Warned(str):
    """A sentence about a specification that runs, but hardly as its author means it."""

    __slots__ = ()
