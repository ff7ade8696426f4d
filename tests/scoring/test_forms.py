"""Tables, blocks for each kind of task, and the file for auditors."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.registry import Registry
from ariac_score.errors import FormulaError, RuleSetError
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet, load_rule_set, rule_set_from_text, rule_set_names
from ariac_score.scoring.scope import Scope

RULES = """\
id: cup
title: A cup
source: a test
log_map: ariac2020
levels: [part, task, trial]
parameters: {points: {unit: points, as_ordered: 3, wrong_color: 1}}
kinds: {kit: holds(is_kit), assembly: otherwise}
rules:
  is_kit: {use: kitting.task_kind, with: {kind: kitting}}
  type: {use: kitting.quadrant, with: {compare: type}}
  color: {use: kitting.quadrant, with: {compare: color}}
terms:
  part:
    worth:
      columns: [in_kit, in_assembly]
      table:
        - {row: another type, when: {type: violated}, in_kit: 0, in_assembly: 0}
        - {row: as ordered, when: {type: holds, color: holds}, in_kit: points.as_ordered, in_assembly: 5}
        - row: the wrong colour
          when: {type: holds, color: violated}
          in_kit: points.as_ordered - points.wrong_color
          in_assembly: 4
  task:
    kit:
      parts: sum(part.in_kit)
      total: parts + 1
    assembly:
      parts: sum(part.in_assembly)
      total: 2 * parts
score: sum(task.total)
"""


def read(text: str = RULES) -> RuleSet:
    return rule_set_from_text(text, file="cup.yaml")


def changed(old: str, new: str) -> RuleSet:
    assert old in RULES
    return read(RULES.replace(old, new))


def score(rules: RuleSet, *, kit: bool, violated: set[str]) -> object:
    """Of one task with one part."""
    trial = Scope("trial", "", inner=(Scope("task", "task_1", inner=(Scope("part", "task_1/part_1"),)),))
    said = {
        "is_kit": ("task_1", kit),
        **{check: ("task_1/part_1", check not in violated) for check in ("type", "color")},
    }
    findings = {
        f"{check}#1": Finding(subject, Verdict.SATISFIED if holds else Verdict.VIOLATED, check, check=check)
        for check, (subject, holds) in said.items()
    }
    return value_of(findings, trial, rules.sheet, rules.policies)


# What they are worth -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kit", "violated", "worth"),
    [
        (True, set(), 3 + 1),
        (True, {"color"}, 3 - 1 + 1),
        (True, {"type"}, 0 + 1),
        (True, {"type", "color"}, 0 + 1),
        (False, set(), 2 * 5),
        (False, {"color"}, 2 * 4),
        (False, {"type", "color"}, 0),
    ],
)
def test_the_row_that_applies_and_the_block_of_the_kind_give_the_score(
    kit: bool, violated: set[str], worth: int
) -> None:
    assert score(read(), kit=kit, violated=violated) == worth


def test_a_price_in_a_table_is_turned_by_its_name() -> None:
    rules = read().with_parameters({"points.wrong_color": 2})

    assert score(rules, kit=True, violated={"color"}) == 3 - 2 + 1


def test_the_row_of_everything_else_applies_where_no_other_does_wherever_it_stands() -> None:
    row = "        - {row: another type, when: {type: violated}, in_kit: 0, in_assembly: 0}\n"
    rules = read(RULES.replace(row, row.replace("{type: violated}", "otherwise")))

    assert [score(rules, kit=True, violated=one) for one in (set(), {"color"}, {"type"})] == [4, 3, 1]


def test_a_row_may_apply_in_several_ways() -> None:
    text = RULES[: RULES.index("        - row: the wrong")] + RULES[RULES.index("  task:\n") :]
    rules = read(text.replace("when: {type: violated}", "when: [{type: violated}, {color: violated}]"))

    assert [score(rules, kit=False, violated=one) for one in ({"color"}, {"type"}, set())] == [0, 0, 10]


def test_tables_are_told_as_they_are_written() -> None:
    (table,) = read().tables

    assert (table.level, table.name, table.columns) == ("part", "worth", ("in_kit", "in_assembly"))
    assert [row.name for row in table.rows] == ["another type", "as ordered", "the wrong colour"]
    assert table.checks == ["type", "color"]


def test_an_extension_changes_one_term_of_one_block(tmp_path: Path) -> None:
    (tmp_path / "cup.yaml").write_text(RULES)
    head = "id: mine\ntitle: Mine\nsource: a test\nextends: ./cup.yaml\n"
    (tmp_path / "mine.yaml").write_text(head + "terms: {task: {kit: {total: parts + 7}}}\n")

    rules = load_rule_set(tmp_path / "mine.yaml")

    assert score(rules, kit=True, violated=set()) == 3 + 7
    assert score(rules, kit=False, violated=set()) == 10


# Mistakes ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "place", "cause", "hint"),
    [
        (
            "{type: holds, color: violated}",
            "{color: violated}",
            "line 16, $.terms.part.worth.table",
            "rows 'another type' and 'the wrong colour' both apply to {type: violated, color: violated}",
            "say more",
        ),
        (
            "{type: holds, color: holds}",
            "{type: holds, color: violated}",
            "$.terms.part.worth.table",
            "no row applies to {type: holds, color: holds}",
            "add a row",
        ),
        (
            "{type: violated}",
            "{type: violated, color: holds}",
            "",
            "no row applies to {type: violated",
            "add a row",
        ),
        ("in_assembly: 4", "in_asembly: 4", "line 19", "'in_asembly' is no column", "in_kit, in_assembly"),
        ("          in_assembly: 4\n", "", "line 19", "has no 'in_assembly'", "its columns"),
        ("{type: violated}", "{type: wrong}", "line 17", "'wrong' is not allowed here", "allowed: "),
        ("[in_kit, in_assembly]", "[in_kit, in_kit]", "line 15", "", ""),
        (
            "assembly: otherwise",
            "assembly: violated(is_kit)",
            "line 7, $.kinds",
            "takes what is left",
            "otherwise",
        ),
        (
            "    assembly:\n",
            "    assembley:\n",
            "line 27",
            "'assembley' is no kind",
            "did you mean 'assembly'?",
        ),
        (
            "      total: 2 * parts\n",
            "",
            "line 27",
            "block 'assembly' of each task has no term 'total'",
            "add it",
        ),
        ("  task:\n", "  task:\n    total: 3\n", "", "term 'total' is given twice", "one thing"),
        (
            "      parts: sum(part.in_assembly)\n      total: 2 * parts\n",
            "      total: 3\n      parts: 2 * total\n",
            "$.terms.task",
            "different orders",
            "same order",
        ),
        (
            "    kit:\n      parts: sum(part.in_kit)\n      total: parts + 1\n",
            "",
            "",
            "no block for the kind 'kit'",
            "add",
        ),
    ],
)
def test_a_mistake_in_a_form_is_told_with_its_place(
    old: str, new: str, place: str, cause: str, hint: str
) -> None:
    with pytest.raises(RuleSetError) as refused:
        changed(old, new)

    assert cause in refused.value.cause
    assert place in refused.value.place
    assert hint in refused.value.hint


@pytest.mark.parametrize(
    ("old", "new", "line", "cause"),
    [
        ("in_assembly: 4", "in_assembly: pints", 14, "unknown name 'pints'"),
        ("{type: violated}", "{tpye: violated}", 14, "'tpye', which is no check"),
        ("total: 2 * parts", "total: 2 * prats", 29, "unknown name 'prats'"),
    ],
)
def test_a_mistake_in_a_formula_of_a_form_is_told_with_its_line(
    old: str, new: str, line: int, cause: str
) -> None:
    text = RULES if "tpye" not in new else RULES.replace("{type: holds, ", "{tpye: holds, ")
    with pytest.raises(FormulaError) as refused:
        read(text.replace(old, new))

    assert cause in refused.value.cause
    assert f"line {line}," in refused.value.place


def test_a_table_of_too_many_checks_is_refused_before_its_cases_are_tried() -> None:
    verdicts = ", ".join(f"c{number}: holds" for number in range(13))

    with pytest.raises(RuleSetError, match="looks at 15 checks, more than 12"):
        changed("{type: violated}", f"{{type: violated, {verdicts}}}")


# The file for auditors -----------------------------------------------------------------


def _audited(folder: Path, audit: str, line: str = "audit: cup.audit.yaml\n") -> RuleSet:
    (folder / "cup.yaml").write_text(RULES + line)
    (folder / "cup.audit.yaml").write_text(audit)
    return load_rule_set(folder / "cup.yaml")


def test_what_auditors_need_may_stand_in_a_file_of_its_own(tmp_path: Path) -> None:
    rules = _audited(tmp_path, "printed:\n  trial: {total: score}\nbreaks: {waiting: it pays}\n")

    assert [item.name for item in rules.printed.items] == ["total"]
    assert rules.breaks == {"waiting": "it pays"}
    assert rule_set_from_text(rules.text, file="result").printed.items == rules.printed.items


def test_the_hash_covers_the_file_for_auditors(tmp_path: Path) -> None:
    first = _audited(tmp_path, "breaks: {waiting: it pays}\n").sha256

    assert _audited(tmp_path, "breaks: {waiting: it does}\n").sha256 != first


@pytest.mark.parametrize(
    ("audit", "line", "file", "place", "cause"),
    [
        ("printed: {trial: {total: scoer}}\n", "", "cup.audit.yaml", "line 1", "unknown name 'scoer'"),
        ("prnted: {}\n", "", "cup.audit.yaml", "line 1", "unknown key 'prnted'"),
        ("score: 3\n", "", "cup.audit.yaml", "line 1", "unknown key 'score'"),
        ("", "", "cup.yaml", "line 31", "cup.audit.yaml: the file is empty"),
        ("breaks: {waiting: a}\n", "breaks: {waiting: b}\n", "cup.yaml", "line 32", "stands here and in"),
    ],
)
def test_a_mistake_in_it_is_told_with_its_file(
    tmp_path: Path, audit: str, line: str, file: str, place: str, cause: str
) -> None:
    with pytest.raises((RuleSetError, FormulaError)) as refused:
        _audited(tmp_path, audit, "audit: cup.audit.yaml\n" + line)

    assert cause in refused.value.cause
    assert Path(str(refused.value.file)).name == file
    assert place in refused.value.place


def test_a_file_for_auditors_that_is_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "cup.yaml").write_text(RULES + "audit: other.audit.yaml\n")

    with pytest.raises(RuleSetError, match=r"cup\.yaml: line 31, \$\.audit: other\.audit\.yaml: "):
        load_rule_set(tmp_path / "cup.yaml")


def test_no_file_for_auditors_is_taken_for_a_rule_set() -> None:
    assert not [name for name in rule_set_names() if "audit" in name]


# What is shipped -----------------------------------------------------------------------


@pytest.mark.parametrize("name", rule_set_names())
def test_what_a_wrong_colour_costs_is_a_parameter_wherever_colours_are_judged(name: str) -> None:
    rules = load_rule_set(name)
    colored = any("color" in str(check.parameters.get("compare", "")) for check in rules.checks.values())

    named = [one for one in rules.parameters if "color" in one or one == "points.right_part"]

    assert bool(named) == colored


@pytest.mark.parametrize("name", rule_set_names())
def test_every_named_number_of_a_shipped_rule_set_says_what_it_means(name: str) -> None:
    rules = load_rule_set(name)

    rules.build(Registry())  # units fit
    assert [name for name, one in rules.parameters.items() if not one.meaning] == []
