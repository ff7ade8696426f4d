"""Laws proven by types: the rules of the calculus, certificates, and what is not proven."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.cli import prove as prove_command
from ariac_score.review.laws.laws import LAWS
from ariac_score.review.laws.prices import ALL_LAWS, PRICE_LAWS
from ariac_score.review.laws.reference import DEFAULT
from ariac_score.review.proofs import certificate as certificate_module
from ariac_score.review.proofs.borders import borders
from ariac_score.review.proofs.by_types import BY_TYPES
from ariac_score.review.proofs.grades import Grades
from ariac_score.review.proofs.laws_page import laws_table, must_be_proven
from ariac_score.review.proofs.proving import prove
from ariac_score.review.proofs.quantities import Quantity
from ariac_score.review.proofs.solver import BY_SOLVER, find_solver
from ariac_score.review.proofs.subject import Subject, subject_of
from ariac_score.review.proofs.tree import Known, Node, Op, Taken
from ariac_score.scoring.ruleset import rule_set_names
from ariac_score.scoring.signs import Sign

REGISTRY = Registry()
RULES = """\
id: made
title: Made
source: a test
log_map: ariac2020
competition: {use: ariac}
rules:
  part_color: {use: kitting.presence, with: {compare: type_and_color}}
monitors:
  separation: {use: iso_ts_15066.ssm_separation, with: {profile: seed}}
  dropped: {use: ariac.no_event, with: {kind: part_dropped}}
terms:
  submission: {kit: points(part_color), place: 1}
  trial: {earned: sum(submission.kit)}
score: SCORE
"""


def made(folder: Path, score: str) -> Subject:
    """A rule set that gives a point for each part, under some formula."""
    file = folder / "made.yaml"
    file.write_text(RULES.replace("SCORE", score), encoding="utf-8")
    return subject_of(str(file), REGISTRY)


def verdicts(subject: Subject, *, cases: int = 0) -> dict[str, str]:
    return {one.law.name: one.verdict for one in prove(subject, cases=cases)}


# Types of trees ------------------------------------------------------------------------

X = Taken(Quantity("x", "violations", 0, math.inf, smooth=True))
FREE = Taken(Quantity("free", "task", -math.inf, math.inf))
WORTH = Taken(Quantity("worth", "task", 0, math.inf))


def over(node: Node) -> Node:
    """1 / (1 + what it is)."""
    return Op("/", (Known(1), Op("+", (Known(1), node))))


@pytest.mark.parametrize(
    ("tree", "sign", "strict", "jumps"),
    [
        (Op("+", (X, Known(3))), Sign.UP, True, False),
        (Op("*", (Known(-2), X)), Sign.DOWN, True, False),
        (over(X), Sign.DOWN, True, False),
        # 0 points stay 0 points: strict only where the score is not 0.
        (Op("*", (WORTH, over(X))), Sign.DOWN, False, False),
        # Points that may be negative are helped by a divisor.
        (Op("*", (FREE, over(X))), Sign.BOTH, False, False),
        (Op("**", (Known(0.5), X)), Sign.DOWN, True, False),
        (Op("**", (Known(1), X)), Sign.NONE, False, False),
        (Op("min", (X, Known(1))), Sign.UP, False, False),
        (Op("clip", (X, Known(0), Known(1))), Sign.UP, False, False),
        (Op("floor", (X,)), Sign.UP, False, True),
        (Op("ramp", (Known(1), Known(0), Known(10), Known(2), X)), Sign.DOWN, False, False),
        (Op("ramp", (Known(1), Known(0), Known(10), Known(10), X)), Sign.DOWN, False, True),
        (Op("<", (Known(10), X)), Sign.UP, False, True),
        # A step down is one: 10 until 5 s, nothing from then on.
        (Op("if", (Op("<", (X, Known(5))), Known(10), Known(0))), Sign.DOWN, False, True),
        # A rescue: beyond 5 nothing more is taken off.
        (
            Op("if", (Op("<", (Known(5), X)), Known(0), Op("+", (Known(10), Op("*", (Known(-3), X)))))),
            Sign.BOTH,
            False,
            True,
        ),
        # Without a rescue: until 3 at least 4 is left, and 0 is less.
        (
            Op("if", (Op("<", (Known(3), X)), Known(0), Op("+", (Known(10), Op("*", (Known(-2), X)))))),
            Sign.DOWN,
            False,
            True,
        ),
        (Op("+", (X, Op("*", (Known(-1), X)))), Sign.BOTH, False, False),
    ],
)
def test_types_of_formulas(tree: Node, sign: Sign, strict: bool, jumps: bool) -> None:
    grade = Grades().of(tree)

    assert grade.sign("x") is sign
    assert ("x" in grade.strict, "x" in grade.jumps) == (strict, jumps)


def test_what_is_left_of_points_falls_strictly() -> None:
    assert "x" in Grades(nonzero=True).of(Op("*", (WORTH, over(X)))).strict


@pytest.mark.parametrize(
    ("tree", "steepest"),
    [
        (Op("*", (Known(-2), X)), 2.0),
        (over(X), 1.0),  # 1 / (1 + x) is steepest at x = 0
        (Op("**", (Known(0.5), X)), math.log(2)),
        (Op("ramp", (Known(6), Known(0), Known(10), Known(7), X)), 2.0),
        (Op("min", (X, Op("*", (Known(3), X)))), 3.0),
    ],
)
def test_how_steep_a_formula_is_at_most(tree: Node, steepest: float) -> None:
    assert Grades().of(tree).steep["x"] == pytest.approx(steepest)


COST = Taken(Quantity("cost", "fact", 0, math.inf))


def test_a_value_exists_only_where_its_divisor_is_not_0() -> None:
    worth_over_cost = Grades().of(Op("/", (WORTH, COST))).typed
    assert (worth_over_cost.least, worth_over_cost.signs) == (0, {"worth": Sign.UP, "cost": Sign.BOTH})
    # Of what violations divide by nothing is known: without one there is no value at all.
    assert Grades().of(Op("/", (Known(1), X))).sign("x") is Sign.BOTH
    assert Grades().of(Op("/", (WORTH, FREE))).typed.least == -math.inf


def test_a_condition_that_holds_keeps_a_divisor_from_0() -> None:
    guarded = Op("if", (Op("<", (Known(0), X)), Op("/", (Known(1), X)), Known(math.inf)))
    not_guarded = Op("if", (Op("<=", (Known(0), X)), Op("/", (Known(1), X)), Known(math.inf)))
    assert Grades().of(guarded).sign("x") is Sign.DOWN
    assert Grades().of(not_guarded).sign("x") is Sign.BOTH


@pytest.mark.parametrize(("bound", "strict"), [(0, True), (-1, True), (0.5, False)])
def test_a_number_that_is_never_beyond_another_does_not_make_it_stay(bound: float, strict: bool) -> None:
    assert ("x" in Grades().of(Op("max", (X, Known(bound)))).strict) is strict


def test_a_mean_over_teams_lies_between_what_each_of_them_can_contribute() -> None:
    found = subject_of("ariac2020.as_documented", REGISTRY).quantities["cohort.order_time_s"]

    assert (found.least, found.most) == (0, math.inf)


# Laws ----------------------------------------------------------------------------------


def test_every_law_is_judged_once() -> None:
    assert set(BY_TYPES) == {law.name for law in ALL_LAWS}
    assert len(ALL_LAWS) == len(LAWS) + len(PRICE_LAWS)


@pytest.mark.parametrize(
    ("score", "proven"),
    [
        ("earned / (1 + seconds(separation))", {"more_violations", "no_cliff", "stopping_early", "waiting"}),
        ("earned / (1 + count(separation))", {"stopping_early", "waiting", "short_pause"}),
        ("earned / (1 + count(dropped))", {"more_violations", "always_costs", "stopping_early", "waiting"}),
        ("earned - 2 * seconds(separation)", {"more_violations", "no_cliff", "waiting"}),
        ("earned * max(0, 1 - seconds(separation) / trial.duration_s)", {"more_points"}),
        ("earned * product(dropped, p=0.5)", {"more_violations", "always_costs", "waiting"}),
        ("earned * (1 - violated(dropped))", {"more_violations", "waiting"}),
        ("earned * gate(separation)", {"more_violations", "short_pause"}),
        ("earned / (1 + floor(seconds(separation)))", {"more_violations", "more_points"}),
        # Joining two violations may pay; but the deeper of two is as long, and costs more.
        ("earned / (1 + demerits(separation, tau_s=5))", {"severity"}),
        # Negative points are rescued by the gate; but of a score above 0 every violation takes something.
        ("earned - count(dropped) if holds(dropped) else 0 - earned", {"always_costs"}),
        # The stricter charge, which costs in the shadow of something heavier as well.
        (
            "earned / (1 + charged(separation=1, dropped=1) + measure(separation, relative_depth_integral_s)"
            " / 50 + count(dropped) / 50)",
            {"more_violations", "always_costs", "severity"},
        ),
    ],
)
def test_types_prove_laws(score: str, proven: set[str], tmp_path: Path) -> None:
    found = verdicts(made(tmp_path, score))

    assert proven <= {law for law, verdict in found.items() if verdict == "proven"}


@pytest.mark.parametrize(
    ("score", "law"),
    [
        ("earned / (1 + count(separation))", "more_violations"),  # joining two makes one
        ("earned + seconds(separation)", "more_violations"),
        ("earned / (1 + min(1, seconds(separation)))", "always_costs"),
        ("earned / (1 + seconds(separation))", "severity"),
        ("earned / (1 + floor(seconds(separation)))", "no_cliff"),
        ("earned / (1 + occurrences(separation))", "log_rate"),
        ("earned * max(0, 1 - seconds(separation) / trial.duration_s)", "waiting"),
        ("earned * product(dropped, p=0.5)", "stopping_early"),
        ("earned - 2 * count(dropped)", "doing_nothing"),
        ("5 * holds(dropped) + earned", "stopping_early"),
        ("holds(dropped) * (5 + earned)", "stopping_early"),
        ("earned / (1 + seconds(separation))", "short_pause"),
        ("3 - earned", "more_points"),
        # What is not done is worth a point as well, and the first violation takes of all of them.
        ("(earned + sum(submission.place)) / (1 + seconds(separation))", "stopping_early"),
        # A violation that takes the score below 0 is charged again by what then counts for it.
        ("earned - 2 * seconds(separation) if holds(dropped) else 5", "always_costs"),
    ],
)
def test_what_does_not_hold_is_not_proven(score: str, law: str, tmp_path: Path) -> None:
    assert verdicts(made(tmp_path, score))[law] == "open"  # no search here, so no exploit either


def test_the_default_charges_depth_and_nothing_for_running_again() -> None:
    found = verdicts(subject_of(DEFAULT, REGISTRY), cases=3)

    assert found["more_violations"] == "proven"
    assert found["running_again"] == "proven"  # of all runs the worst counts
    assert found["severity"] == "proven"
    assert found["nothing_left"] == "proven"  # a tie-break tells
    assert found["always_costs"] != "proven"  # not in the shadow of something heavier
    assert found["no_cliff"] != "proven"  # the gate


@pytest.mark.slow  # reduced from a random trial, step by step
def test_an_exploit_is_priced_by_the_engine_and_as_small_as_can_be(tmp_path: Path) -> None:
    subject = made(tmp_path, "earned / (1 + count(dropped) - seconds(separation) / 100)")

    refuted = next(one for one in prove(subject, cases=60) if one.law.name == "more_violations")

    assert refuted.verdict == "refuted"
    assert refuted.exploit is not None
    assert refuted.exploit.broken is not None
    # One part, one point; then the shortest violation there is, of 0.1 s.
    assert refuted.exploit.broken.first_score == 1
    assert refuted.exploit.broken.second_score == pytest.approx(1 / (1 - 0.1 / 100))


def test_a_term_outside_the_calculus_is_named(tmp_path: Path) -> None:
    subject = made(tmp_path, "earned * (1 - seconds(separation)) ** 2")
    open_ = next(one for one in prove(subject, cases=0) if one.law.name == "more_violations")

    # 1 - t is below 0 for long violations, and its square grows again.
    assert open_.because[0] == (
        "seconds(separation) may move '(1 + -1 * seconds(separation)) ** 2' in the term 'score' either way"
    )


TABLE = """\
  trial:
    earned: sum(submission.kit)
    left:
      columns: [share]
      table:
        - {row: calm, when: {separation: holds, dropped: holds}, share: CALM}
        - {row: something dropped, when: {separation: holds, dropped: violated}, share: DROPPED}
        - {row: too near, when: {separation: violated}, share: NEAR}
"""


@pytest.mark.parametrize(
    ("calm", "dropped", "near", "proves"),
    [
        (1, 0.5, 0, True),
        (1, 0.25, 0.5, False),  # who dropped something comes too near as well, and has more
        (1, 1.5, 0, False),  # a negative price
    ],
)
def test_a_table_has_the_type_of_its_rows(
    calm: float, dropped: float, near: float, proves: bool, tmp_path: Path
) -> None:
    table = TABLE.replace("CALM", str(calm)).replace("DROPPED", str(dropped)).replace("NEAR", str(near))
    text = RULES.replace("  trial: {earned: sum(submission.kit)}\n", table).replace("SCORE", "earned * share")
    (tmp_path / "made.yaml").write_text(text, encoding="utf-8")
    subject = subject_of(str(tmp_path / "made.yaml"), REGISTRY)

    found = {one.law.name: one.verdict for one in prove(subject, cases=0, solver=find_solver())}

    assert (found["more_violations"] == "proven") is proves
    assert found["waiting"] == "proven"


# What the solver is asked ---------------------------------------------------------------

FREE_POINTS = "earned - 5"  # what was earned, less a fee: it may be below 0


@pytest.mark.parametrize(
    ("law", "score", "proves"),
    [
        # Points divided by 1 + violations: fair where points are never negative, or mirrored where they are.
        ("more_violations", "earned / (1 + count(dropped))", True),
        ("more_violations", f"({FREE_POINTS}) / (1 + count(dropped))", False),
        (
            "more_violations",
            f"({FREE_POINTS}) / (1 + count(dropped)) if {FREE_POINTS} >= 0 "
            f"else ({FREE_POINTS}) * (2 - 1 / (1 + count(dropped)))",
            True,
        ),
        # A gate on the number: 4 of 10 are left before it, and then 0; or -2, and then the gate rescues.
        ("more_violations", "0 if count(dropped) > 3 else 10 - 2 * count(dropped)", True),
        ("more_violations", "0 if count(dropped) > 5 else 10 - 3 * count(dropped)", False),
        ("always_costs", "earned / (1 + count(dropped)) ** 2", True),
        ("always_costs", "earned / (1 + min(1, count(dropped)))", False),
        ("waiting", "earned * max(0, 1 - count(dropped) / trial.duration_s)", False),
        ("waiting", "earned * trial.duration_s / trial.duration_s if trial.duration_s > 0 else earned", True),
        ("stopping_early", "earned / (1 + count(dropped))", True),
        ("stopping_early", "earned * product(dropped, p=0.25)", False),
        ("stopping_early", "earned / (1 + count(dropped)) ** 2", False),
        ("stopping_early", "earned - count(dropped)", False),
        # What is negative is helped, so it never falls below the -5 of no work.
        ("doing_nothing", f"({FREE_POINTS}) / (1 + count(dropped))", True),
        ("doing_nothing", "earned * product(dropped, p=0.25)", True),
        ("doing_nothing", "earned - count(dropped)", False),
    ],
)
def test_what_the_solver_proves(law: str, score: str, proves: bool, tmp_path: Path) -> None:
    solver = find_solver()
    assert solver is not None

    assert BY_SOLVER[law](solver, made(tmp_path, score)).proves is proves


def test_numbers_that_break_a_law_are_shown(tmp_path: Path) -> None:
    solver = find_solver()
    assert solver is not None

    answer = BY_SOLVER["more_violations"](solver, made(tmp_path, "(earned - 5) / (1 + count(dropped))"))

    assert "count(dropped)' = " in answer.words
    assert "of which no trial was found" in answer.words


def test_without_the_solver_a_law_is_open_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rules, file = certificate(tmp_path, TAKEN_BACK)
    assert "PROVEN    more violations never help (by solver)" in capsys.readouterr().out
    for module in (prove_command, certificate_module):
        monkeypatch.setattr(module, "find_solver", lambda: None)

    assert main(["rules", "prove", str(rules), "--cases", "0", "--tries", "0"]) == 6
    assert "pip install 'ariac-score[prove]'" in " ".join(capsys.readouterr().out.split())
    assert main(["verify", str(file), "--rules", str(rules)]) == 6
    assert "not checked: decided by z3 " in capsys.readouterr().out


TAKEN_BACK = "earned / (1 + count(dropped)) + 2 * count(dropped) - 2 * count(dropped)"
"""A sum of what rises and what falls, whose type is not known."""

# The command and its certificate -------------------------------------------------------


def certificate(folder: Path, score: str = "earned / (1 + count(dropped))") -> tuple[Path, Path]:
    rules, file = folder / "made.yaml", folder / "certificate.json"
    rules.write_text(RULES.replace("SCORE", score), encoding="utf-8")
    main(["rules", "prove", str(rules), "--cases", "0", "--tries", "0", "-o", str(file)])
    return rules, file


def test_a_certificate_is_proven_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules, file = certificate(tmp_path)

    assert main(["verify", str(file), "--rules", str(rules)]) == 0
    assert "everything was proven again" in capsys.readouterr().out


def test_a_certificate_of_another_rule_set_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, file = certificate(tmp_path)

    assert main(["verify", str(file), "--rules", "safety"]) == 1
    assert "the certificate is of 'made', not of 'safety'" in capsys.readouterr().out


def test_a_certificate_of_another_text_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules, file = certificate(tmp_path)
    rules.write_text(rules.read_text(encoding="utf-8").replace("1 + count", "2 + count"), encoding="utf-8")

    assert main(["verify", str(file), "--rules", str(rules)]) == 1
    assert "another text of 'made'" in capsys.readouterr().out


def test_a_forged_verdict_does_not_hold(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules, file = certificate(tmp_path, "earned / (1 + count(separation))")
    data = json.loads(file.read_text(encoding="utf-8"))
    forged = next(law for law in data["laws"] if law["law"] == "more_violations")
    assert forged["verdict"] != "proven"
    forged["verdict"] = "proven"
    file.write_text(json.dumps(data), encoding="utf-8")

    assert main(["verify", str(file), "--rules", str(rules)]) == 1
    assert "the certificate says proven; proven again it is" in capsys.readouterr().out


def test_a_law_that_a_certificate_leaves_out_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rules, file = certificate(tmp_path)
    data = json.loads(file.read_text(encoding="utf-8"))
    data["laws"] = data["laws"][1:]
    file.write_text(json.dumps(data), encoding="utf-8")

    assert main(["verify", str(file), "--rules", str(rules)]) == 1
    assert "the certificate leaves it out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ({"laws": 3}, "no sound certificate"),
        ({"cases": 10**9}, "are not from 0 to"),
        ({"more": 1}, "no sound certificate"),
    ],
)
def test_a_broken_certificate_is_refused(
    broken: dict[str, object], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, file = certificate(tmp_path)
    file.write_text(json.dumps(json.loads(file.read_text(encoding="utf-8")) | broken), encoding="utf-8")

    assert main(["verify", str(file)]) == 6
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("score", "cases", "code"),
    [
        ("floor(earned)", "0", 0),
        ("earned / (1 + violated(separation))", "3", 1),
        ("earned / (1 + seconds(separation))", "0", 6),
    ],
)
def test_exit_codes(score: str, cases: str, code: int, tmp_path: Path) -> None:
    rules = tmp_path / "made.yaml"
    rules.write_text(RULES.replace("SCORE", score), encoding="utf-8")

    assert main(["rules", "prove", str(rules), "--cases", cases, "--tries", "0"]) == code


def test_a_certificate_is_not_held_against_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, file = certificate(tmp_path)

    assert main(["verify", str(file), "--log", str(tmp_path)]) == 4
    assert "about a rule set, not about a log" in capsys.readouterr().err


# Borders -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("score", "border"),
    [
        ("earned / (1 + demerits)", "going on pays iff e/E >= d/(1+D):"),
        ("earned - 3 * demerits", "going on pays iff e >= 3 * d:"),
    ],
)
def test_from_which_size_on_a_piece_of_work_pays(score: str, border: str, tmp_path: Path) -> None:
    (tmp_path / "made.yaml").write_text(
        RULES.replace("sum(submission.kit)}", "sum(submission.kit), demerits: seconds(separation)}").replace(
            "SCORE", score
        ),
        encoding="utf-8",
    )

    found = borders(subject_of(str(tmp_path / "made.yaml"), REGISTRY), find_solver())

    assert found[-1].startswith(border)


def test_what_the_slightest_violation_costs(tmp_path: Path) -> None:
    found = borders(made(tmp_path, "earned * (1 - 0.25 * violated(separation))"), None)

    assert found == ("one sample of separation, hardly violated, takes 25 % of a piece",)


def test_a_border_is_known_where_rules_measure_what_work_is_worth() -> None:
    found = borders(subject_of("aic2026.strict_penalised", REGISTRY), None)

    # 1/(1 + demerits): demerits of one sample, weighed as each class of the penalty is.
    assert [line.partition(",")[0] for line in found] == [
        f"one sample of {check}" for check in ("off_limit_contact", "separation", "wrist_force")
    ]


# Shipped rule sets ---------------------------------------------------------------------

PAGE = Path(__file__).parents[2] / "docs/laws.md"


def test_violations_never_help_under_a_rule_set_that_multiplies_with_a_collision() -> None:
    """Of 2020 as documented that rests on parts being counted, and on times that are not negative."""
    subject = subject_of("ariac2020.as_documented", REGISTRY)

    assert BY_TYPES["more_violations"](subject).proves
    assert BY_TYPES["always_costs"](subject).proves


@pytest.mark.slow
@pytest.mark.parametrize("name", rule_set_names())
def test_what_must_be_proven_of_a_shipped_rule_set_is(name: str) -> None:
    subject = subject_of(name, REGISTRY)
    found = {one.law.name: one.verdict for one in prove(subject, cases=0, solver=find_solver())}

    assert {law: found[law] for law in must_be_proven(subject) if found[law] in ("refuted", "open")} == {}


def test_what_a_shipped_rule_set_breaks_it_declares() -> None:
    table = laws_table_of(PAGE.read_text(encoding="utf-8"))

    assert len(table) > 10
    assert [row[0] for row in table if "**no**" in row] == []


def laws_table_of(page: str) -> list[list[str]]:
    """The cells of each row: the rule sets, and what is known of each law."""
    rows = [line.strip("|").split("|") for line in page.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in row] for row in rows if len(row) == 1 + len(ALL_LAWS)]


@pytest.mark.slow
def test_the_table_of_laws_is_up_to_date() -> None:
    """Written by `laws_table()`."""
    assert laws_table() in PAGE.read_text(encoding="utf-8")
