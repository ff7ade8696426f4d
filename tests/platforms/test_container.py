"""The Dockerfile, read line by line: no engine is needed to see what it promises."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINES = [
    line
    for line in (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    if line.strip() and not line.startswith("#")
]


def of(instruction: str) -> list[str]:
    return [line.split(maxsplit=1)[1].strip() for line in LINES if line.split(maxsplit=1)[0] == instruction]


def test_it_ends_as_somebody_without_rights() -> None:
    assert of("USER")[-1] not in ("0", "root")
    assert int(of("USER")[-1]) >= 10_000
    assert LINES.index(f"USER {of('USER')[-1]}") > max(
        i for i, line in enumerate(LINES) if line.startswith("RUN")
    )


def test_bases_have_a_version_and_a_supported_python() -> None:
    assert of("FROM")
    for base in of("FROM"):
        assert re.fullmatch(r"python:3\.1[0-3]-slim( AS build)?", base), base


def test_nothing_is_fetched_by_address_and_no_secret_is_named() -> None:
    text = "\n".join(LINES)
    assert not re.search(r"curl|wget|http://|https://|ADD ", text)
    assert not re.search(r"(?i)token|password|secret", text)


def test_the_command_of_a_platform_is_run_as_it_is() -> None:
    """Codabench gives `python3 /app/program/scoring.py …`; an entry point would take it for arguments."""
    assert of("ENTRYPOINT") == []


def test_what_it_does_of_itself_is_a_command_we_have(capsys: pytest.CaptureFixture[str]) -> None:
    from ariac_score.cli import main  # noqa: PLC0415  # it is what is called

    assert of("CMD") == ['["ariac-score", "--help"]']
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "platform" in capsys.readouterr().out
