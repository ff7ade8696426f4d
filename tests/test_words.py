"""The core knows no competition: none of its words stand in what the core is made of."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
CORE = ROOT / "ariac_score"
WORDS = frozenset(
    {"kit", "kits", "kitting", "tray", "trays", "agv", "agvs", "shipment", "shipments", "briefcase"}
    | {"quadrant", "quadrants", "gantry", "nist", "edition", "editions", "ariac"}
)
OWN_NAME = re.compile(r"ariac[-_ ]?score\w*", re.IGNORECASE)
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")


def words_in(text: str) -> set[str]:
    """The words of a competition in a text or an identifier, the package's own name aside."""
    plain = _HUMP.sub(" ", OWN_NAME.sub(" ", text.replace("ariac[-_.]score", " ")))
    return WORDS & set(re.split(r"[^a-z]+", plain.lower()))


def code_of(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every identifier and every text of a module but its docstrings, with its line."""
    described = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for each in body if isinstance(body, list) else ():
            if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
                described.add(id(each.value))
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described:
            yield line, node.value
        for name in ("id", "attr", "name", "arg", "module"):
            value = getattr(node, name, None)
            if isinstance(value, str):
                yield line, value


def schema_texts(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from schema_texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from schema_texts(inner)
    elif isinstance(value, str):
        yield value


def found_in_code() -> list[str]:
    found = []
    for path in sorted(CORE.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for line, text in code_of(tree):
            found += [f"{path.relative_to(ROOT)}:{line}: {word}" for word in sorted(words_in(text))]
    return found


@pytest.mark.slow
def test_no_identifier_or_message_of_the_core_holds_a_word_of_a_competition() -> None:
    assert not found_in_code()


def texts_shipped() -> list[Path]:
    """What else the core is made of: templates of pages and of `new`, styles, scripts, messages."""
    kinds = {".j2", ".css", ".js", ".msg", ".tmpl", ".json", ".yaml"}
    return sorted(path for path in CORE.rglob("*") if path.suffix in kinds)


def test_no_template_style_or_message_of_the_core_holds_a_word_of_a_competition() -> None:
    shipped = texts_shipped()
    assert {path.suffix for path in shipped} >= {".j2", ".css", ".js", ".msg", ".tmpl"}

    found = [
        f"{path.relative_to(ROOT)}:{number}: {word}"
        for path in shipped
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for word in sorted(words_in(line))
    ]
    assert not found


def test_no_schema_holds_a_word_of_a_competition() -> None:
    for path in sorted((ROOT / "schemas").glob("*.json")):
        texts = schema_texts(json.loads(path.read_text(encoding="utf-8")))
        assert not {word for text in texts for word in words_in(text)}, path.name


def test_words_are_found_in_every_spelling_and_the_own_name_is_none() -> None:
    assert words_in("KitRecord") == {"kit"}
    assert words_in("find_trays_on_agv") == {"trays", "agv"}
    assert not words_in("ariac_score.trial, ariac-score 1.0, AriacScoreRecords, kite, portrayal")
    (text,) = (
        t for _, t in code_of(ast.parse("def f():\n    '''A kit.'''\n    return 'no kit'")) if words_in(t)
    )
    assert text == "no kit"
