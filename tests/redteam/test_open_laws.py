"""`rules prove` asks an adversary where types and solver leave a law open."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ariac_score.cli import main
from ariac_score.testing.copies import Copy

EXAMPLE = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
RULES = """\
extends: paper2020.published
id: ours
title: Ours
source: this test
score: SCORE
"""
BLIND = "task * max(0.5, 1 - 0.3 * seconds(separation))"
"""A floor at half of the points: what comes behind it is free."""


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    file = tmp_path / "ours.yaml"
    file.write_text(RULES.replace("SCORE", BLIND), encoding="utf-8")
    return file


def certified(rules: Path, *words: str) -> dict[str, Any]:
    """By law; made trials are left out, so that what is refuted is refuted by the log."""
    file = rules.with_name("certificate.json")
    main(["rules", "prove", str(rules), "--cases", "0", "-o", str(file), *words])
    return {law["law"]: law for law in json.loads(file.read_text(encoding="utf-8"))["laws"]}


@pytest.mark.slow
def test_a_law_that_is_open_is_refuted_on_a_log(rules: Path) -> None:
    found = certified(rules, "--tries", "6")["always_costs"]

    assert (found["verdict"], found["by"]) == ("refuted", "search")
    told = found["exploit"]
    assert told["trial"] == "the log kitting_near_miss.mcap"
    assert told["second"].startswith("come as near from ")
    assert told["second_score"] == told["first_score"] > 0


@pytest.mark.slow
def test_what_was_tried_in_vain_is_counted(rules: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules.write_text(RULES.replace("SCORE", "task - seconds(separation) ** 2"), encoding="utf-8")

    found = certified(rules, "--tries", "3")["short_pause"]

    assert (found["verdict"], found["searched"]) == ("open", ["3 doctored copies of kitting_near_miss.mcap"])
    assert "searched: 3 doctored copies of kitting_near_miss.mcap: nothing" in capsys.readouterr().out


@pytest.mark.slow
def test_the_same_search_gives_the_same_bytes_and_is_checked(
    rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = rules.with_name("certificate.json")
    certified(rules, "--tries", "4")
    first = file.read_bytes()
    certified(rules, "--tries", "4")

    assert file.read_bytes() == first
    assert main(["verify", str(file), "--rules", str(rules)]) == 0
    assert "everything was proven again" in capsys.readouterr().out


@pytest.mark.slow
def test_a_log_that_is_not_here_leaves_its_laws_unchecked(
    rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = Copy.of(EXAMPLE).write(tmp_path / "ours")  # the same messages in other bytes
    certified(rules, "--tries", "4", "--log", str(log))
    file = str(rules.with_name("certificate.json"))
    capsys.readouterr()

    assert main(["verify", file, "--rules", str(rules)]) == 6
    assert "always_costs     not checked: searched on ours.mcap, which is not here (--log)" in (
        said := capsys.readouterr().out
    )
    assert "nothing speaks against it" in said
    assert main(["verify", file, "--rules", str(rules), "--log", str(log)]) == 0
    assert main(["verify", file, "--rules", str(rules), "--log", str(EXAMPLE)]) == 1
    assert "of other bytes than kitting_near_miss.mcap" in capsys.readouterr().out


@pytest.mark.slow
def test_a_log_of_a_certificate_cannot_be_forged(rules: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Who writes that the log showed nothing is found out where the log is at hand."""
    certified(rules, "--tries", "4")
    file = rules.with_name("certificate.json")
    data = json.loads(file.read_text(encoding="utf-8"))
    (law,) = [law for law in data["laws"] if law["law"] == "always_costs"]
    law.update(verdict="open", by="", searched=["4 doctored copies of kitting_near_miss.mcap"])
    del law["exploit"]
    file.write_text(json.dumps(data), encoding="utf-8")

    assert main(["verify", str(file), "--rules", str(rules)]) == 1
    assert "the certificate says open; proven again it is refuted" in capsys.readouterr().out


@pytest.mark.slow
def test_rules_of_another_log_map_have_no_example_and_none_is_searched(tmp_path: Path) -> None:
    assert "searched" not in certified_of("safety", tmp_path)["more_violations"]


def certified_of(name: str, folder: Path) -> dict[str, Any]:
    file = folder / "certificate.json"
    main(["rules", "prove", name, "--cases", "0", "-o", str(file)])
    data = json.loads(file.read_text(encoding="utf-8"))
    assert data["log"] is None
    return {law["law"]: law for law in data["laws"]}


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["penalty.gated_hyperbolic", "--log", str(EXAMPLE)], 4, "a penalty alone scores no log"),
        (["paper2020", "--log", "nowhere.mcap"], 5, "no such file"),
        (["paper2020", "--tries", "1001"], 4, "a number from 0 to 1000"),
    ],
)
def test_what_cannot_be_searched_is_refused(
    words: list[str], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        found = main(["rules", "prove", *words])
    except SystemExit as left:
        found = int(left.code or 0)

    assert (found, says in capsys.readouterr().err) == (code, True)
