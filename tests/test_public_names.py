"""Every public name has an example, in its docstring or on the page of public names; all of them hold."""

from __future__ import annotations

import doctest
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import ariac_score
from ariac_score import Body, Signal, Span, Trial, monitors

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/public_names.md").read_text(encoding="utf-8")
SECTION = re.compile(r"^### (?P<names>`[^\n]+)\n(?P<text>.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)
NAMES = {name: room for room in (ariac_score, monitors) for name in room.__all__}


def sections() -> Iterator[tuple[tuple[str, ...], str]]:
    """The names of each heading, and the text below it."""
    for section in SECTION.finditer(PAGE):
        yield tuple(re.findall(r"`(\w+)`", section["names"])), section["text"]


def in_docstring(name: str) -> bool:
    """Whether the docstring of a name, or of a method of it, has an example; the suite runs those."""
    thing = getattr(NAMES[name], name)
    if not (inspect.isclass(thing) or inspect.isroutine(thing)):
        return False
    module = import_module(thing.__module__)
    return any(test.examples for test in doctest.DocTestFinder(recurse=True).find(thing, name, module=module))


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_an_example_that_uses_it(name: str) -> None:
    on_page = [text for names, text in sections() if name in names]

    assert on_page or in_docstring(name), f"{name} has no example in its docstring or docs/public_names.md"
    for text in on_page:
        shown = doctest.DocTestParser().get_examples(text)
        code = "".join(f"{example.source}{example.want}" for example in shown)
        assert re.search(rf"\b{name}\b", code), f"the example of {name} does not use it"


@pytest.mark.parametrize(("names", "text"), [*sections()])
def test_every_example_of_the_page_holds(
    names: tuple[str, ...], text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert set(names) <= set(NAMES), "the page names what is not public"
    monkeypatch.chdir(ROOT)
    offered = {name: getattr(room, name) for name, room in NAMES.items()}
    speed = Signal("speed/gantry", "m/s", np.arange(4) * 0.04, np.array([0.1, 0.3, 0.5, 0.1]))
    gantry = Body("gantry", "robot")
    trial = Trial("t", bodies=(gantry,), signals={speed.name: speed}, recorded=Span(0.0, 0.12))
    known = {**offered, "np": np, "LOG": "examples/kitting_near_miss.mcap", "TRIAL": trial}
    code = "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    test = doctest.DocTestParser().get_doctest(code, known, ", ".join(names), "docs/public_names.md", 0)
    output: list[str] = []

    doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=output.append)

    assert not output, "".join(output)
