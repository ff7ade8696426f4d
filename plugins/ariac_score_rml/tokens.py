"""The words of a specification, each with its place."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from ariac_score_rml.faults import RmlError
from ariac_score_rml.syntax import Place

__all__ = ["FUNCTIONS", "Dialect", "Token", "tokenize"]

Dialect = Literal["2024", "rosmonitoring"]
"""`rosmonitoring`: the older language of ROSMonitoring's own specifications."""

FUNCTIONS = {"abs": 1, "sin": 1, "cos": 1, "tan": 1, "min": 2, "max": 2}
"""Functions and how many arguments they take."""

_KEYWORDS = frozenset(
    [
        "not",
        "matches",
        "with",
        "empty",
        "all",
        "let",
        "var",
        "if",
        "else",
        "true",
        "false",
        "null",
        "abs",
        "sin",
        "cos",
        "tan",
        "min",
        "max",
    ]
)
_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n]+)
    |(?P<comment>//[^\n]*)
    |(?P<float>[0-9]+\.[0-9]+)
    |(?P<int>[0-9]+)
    |(?P<upper>[A-Z][A-Za-z0-9_]*)
    |(?P<lower>[a-z][A-Za-z0-9_]*)
    |(?P<string>'(?:[^'\\]|\\[trn'\\])*')
    |(?P<symbol>\.\.\.|<=|>=|==|!=|&&|\|\||>>|/\\|\\/|[;:,.(){}\[\]<>+\-*/^?!|=_])
    """,
    re.VERBOSE,
)
_ESCAPES = {"t": "\t", "r": "\r", "n": "\n", "'": "'", "\\": "\\"}


@dataclass(frozen=True)
class Token:
    """One word.

    Attributes:
        kind: `int`, `float`, `upper`, `lower`, `string`, `end`, or the keyword or symbol itself.
        text: As written; of a string, what it stands for.
        place: Where it begins.
    """

    kind: str
    text: str
    place: Place

    def __str__(self) -> str:
        return "the end of the text" if self.kind == "end" else repr(self.text)


def tokenize(text: str, dialect: Dialect = "2024") -> tuple[list[Token], list[Token]]:
    """The tokens of a text, ending with one of kind `end`; and, separately, its comments.

    Raises:
        RmlError: A character that begins no token, a string without its end.

    >>> [token.kind for token in tokenize("G<n>=p")[0]]
    ['upper', '<', 'lower', '>=', 'lower', 'end']
    """
    keywords = _KEYWORDS - {"min", "max"} if dialect == "rosmonitoring" else _KEYWORDS
    tokens: list[Token] = []
    comments: list[Token] = []
    at, line, line_start = 0, 1, 0
    while at < len(text):
        place = Place(line, at - line_start + 1)
        found = _TOKEN.match(text, at)
        if found is None:
            raise _unknown(text, at, place)
        kind, word = str(found.lastgroup), found.group()
        if kind == "comment":
            comments.append(Token(kind, word.rstrip(), place))
        elif kind != "space":
            tokens.append(_token(kind, word, place, keywords))
        newlines = word.count("\n")
        if newlines:
            line, line_start = line + newlines, at + word.rindex("\n") + 1
        at = found.end()
    tokens.append(Token("end", "", Place(line, at - line_start + 1)))
    return tokens, comments


def _token(kind: str, word: str, place: Place, keywords: frozenset[str]) -> Token:
    if kind == "string":
        meaning = re.sub(r"\\(.)", lambda m: _ESCAPES[m.group(1)], word[1:-1], flags=re.DOTALL)
        return Token(kind, meaning, place)
    if kind == "symbol":
        return Token(word, word, place)
    # `var` is the older word for `let`, and still the same token.
    if kind == "lower" and word in keywords:
        return Token("let" if word == "var" else word, word, place)
    return Token(kind, word, place)


def _unknown(text: str, at: int, place: Place) -> RmlError:
    character = text[at]
    where = {"line": place.line, "column": place.column}
    if character == "'":
        return RmlError(
            "this string has no end or an escape other than \\t \\r \\n \\' \\\\",
            **where,  # type: ignore[arg-type]
            hint="close it with ' and write a backslash as \\\\",
        )
    hint = "strings are written in single quotes" if character == '"' else "see the rules of the language"
    return RmlError(f"the character {character!r} means nothing here", **where, hint=hint)  # type: ignore[arg-type]
