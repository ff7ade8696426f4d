"""The rulebook of a rule set: what a referee reads."""

from __future__ import annotations

from ariac_score.cli import main


def test_a_rulebook_begins_with_the_title_of_the_rules(capsys) -> None:  # type: ignore[no-untyped-def]
    assert main(["rules", "show", "paper2020", "--as", "rulebook"]) == 0

    assert capsys.readouterr().out.startswith("# ARIAC 2020 task rules with the paper's separation monitor")
