"""docs/python.md is done as it is written: every block is run, in order, and what it prints is compared."""

from __future__ import annotations

import importlib.util
import linecache
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "docs/python.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"```(?P<language>\w+)\n(?P<text>.*?)```", re.DOTALL)
EXTRAS = {"to_frame(": "pandas", "table.": "pandas", "matplotlib": "matplotlib"}


def steps() -> Iterator[tuple[str, str, str]]:
    """Language and text of every block, and what it shall print."""
    blocks = [(block["language"], block["text"]) for block in BLOCK.finditer(PAGE)]
    for (language, text), (after, output) in zip(blocks, [*blocks[1:], ("", "")], strict=True):
        if language != "text":
            yield language, text, output if after == "text" else ""


def lacking(text: str) -> str:
    """The extra that a block needs and that is not installed."""
    wanted = (module for word, module in EXTRAS.items() if word in text)
    return next((module for module in wanted if importlib.util.find_spec(module) is None), "")


@pytest.mark.slow
def test_every_block_prints_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {"__name__": "__main__"}
    skipped = set()
    for number, (language, text, output) in enumerate(steps()):
        if language == "sh":
            command = [sys.executable if word == "python" else word for word in text.split()]
            subprocess.run(command, check=True, capture_output=True)
            continue
        assert language == "python"
        if module := lacking(text):
            skipped.add(module)
            continue
        file = f"<block {number}>"  # as a notebook does: the text of a cell can be looked up
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        exec(compile(text, file, "exec"), names)  # noqa: S102  # our own page
        # pandas pads its columns; the page has no spaces at the ends of its lines.
        assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == output.splitlines(), text
    if skipped:
        pytest.skip(f"without {' and '.join(sorted(skipped))} only the other blocks were run")


def test_the_page_has_a_sweep_with_its_plot_in_ten_lines() -> None:
    (sweep,) = [text for _, text, _ in steps() if "savefig" in text]

    assert len([line for line in sweep.splitlines() if line.strip()]) <= 12  # two of them are imports
    assert "with_parameters" in sweep
