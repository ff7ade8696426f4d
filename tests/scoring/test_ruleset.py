"""Rule sets: the shipped ones are sound, and each kind of mistake is told with place, cause and remedy."""

from __future__ import annotations

from pathlib import Path

import ariac_score.rules
import pytest

from ariac_score.checks.contracts import Monitor, Rule
from ariac_score.checks.registry import FILE_GROUPS, Registry
from ariac_score.errors import FormulaError, PluginNotFoundError, RuleSetError, ScoreError, UsageError
from ariac_score.logs.logmap import load_log_map
from ariac_score.scoring.policy import POLICIES
from ariac_score.scoring.ruleset import load_rule_set, rule_set_from_text, rule_set_names

REGISTRY = Registry()
SOUND = """\
id: example
title: Example
source: by hand
log_map: ariac2020
parameters:
  weight: 0.4
rules:
  pose:
    use: kitting.pose
    with: {max_distance_m: 0.03}
monitors:
  separation:
    use: iso_ts_15066.ssm_separation
    with:
      profile: seed
      delta_m: 2.6
terms:
  order:
    total: points(pose) * order.priority
  trial:
    demerits: weight * demerits(separation, tau_s=5)
score: sum(order.total) / (1 + demerits)
round: 3
competition: {use: ariac}
"""


@pytest.fixture
def written(tmp_path: Path) -> Path:
    return tmp_path / "rules.yaml"


def mistaken(path: Path, old: str, new: str) -> str:
    """The sound rule set with one mistake, as a path."""
    assert SOUND.count(old) == 1
    path.write_text(SOUND.replace(old, new), encoding="utf-8")
    return str(path)


def refusal(path: Path, old: str, new: str, kind: type[ScoreError]) -> ScoreError:
    """The error on loading or building the mistaken rule set."""
    with pytest.raises(ScoreError) as refused:
        load_rule_set(mistaken(path, old, new)).build(REGISTRY)
    assert type(refused.value) is kind
    assert refused.value.file == str(path)
    assert refused.value.exit_code == 4
    return refused.value


# Shipped -------------------------------------------------------------------------------


def test_every_shipped_yaml_file_is_a_rule_set_a_log_map_or_a_penalty() -> None:
    registry, folder = Registry(), Path(ariac_score.rules.__path__[0])
    brought = [file.path for group in FILE_GROUPS for file in registry.files(group)]

    assert len(brought) == len(set(brought))
    shipped = {file for root in {folder, *(path.parent for path in brought)} for file in root.rglob("*.yaml")}
    assert {*brought, folder / "penalty/classes.yaml"} == {
        file for file in shipped if not file.name.endswith(".audit.yaml")
    }


@pytest.mark.parametrize("name", rule_set_names())
def test_every_shipped_rule_set_loads_and_goes_by_its_own_name(name: str) -> None:
    rule_set = load_rule_set(name)

    assert rule_set.id == name
    assert rule_set.source
    assert all(check.on_inconclusive in POLICIES for check in rule_set.checks.values())


@pytest.mark.parametrize("name", rule_set_names())
def test_every_shipped_rule_set_builds_with_installed_plugins_only(name: str) -> None:
    rule_set = load_rule_set(name)
    built = rule_set.build(REGISTRY)

    assert list(built) == list(rule_set.checks)
    for check in rule_set.checks.values():
        assert check.use in REGISTRY.names(check.group)
        assert isinstance(
            built[check.name], {"ariac_score.rules": Rule, "ariac_score.monitors": Monitor}[check.group]
        )


@pytest.mark.parametrize("name", rule_set_names())
def test_every_shipped_rule_set_names_a_log_map_that_exists(name: str) -> None:
    rule_set = load_rule_set(name)

    assert load_log_map(rule_set.log_map).id == rule_set.log_map


# The sound one -------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in rule_set_names() if name.startswith("ariac")])
def test_a_rule_set_reads_recordings_by_the_log_map_of_its_own_edition(name: str) -> None:
    rule_set = load_rule_set(name)
    has_its_own = (Path(rule_set.file).parent / "log_map.yaml").is_file()

    assert rule_set.competition is not None
    assert not has_its_own or rule_set.log_map == f"ariac{rule_set.competition.parameters['edition']}"


def test_a_sound_rule_set_is_read_as_written(written: Path) -> None:
    written.write_text(SOUND, encoding="utf-8")

    rule_set = load_rule_set(str(written))

    assert (rule_set.id, rule_set.digits, rule_set.file) == ("example", 3, str(written))
    assert list(rule_set.checks) == ["pose", "separation"]
    assert rule_set.checks["pose"].group == "ariac_score.rules"
    assert dict(rule_set.checks["separation"].parameters) == {"profile": "seed", "delta_m": 2.6}
    assert (rule_set.checks["pose"].on_inconclusive, rule_set.counts) == ("open", "worst")
    assert rule_set.sheet.priced == {"pose", "separation"}
    built = rule_set.build(REGISTRY)
    assert built["pose"].max_distance_m == 0.03
    assert built["separation"].delta_m == 2.6


def test_a_different_byte_is_a_different_rule_set(written: Path) -> None:
    written.write_text(SOUND, encoding="utf-8")
    before = load_rule_set(str(written)).sha256
    written.write_text(SOUND.replace("0.4", "0.5"), encoding="utf-8")

    assert load_rule_set(str(written)).sha256 != before


def test_digits_default_to_6(written: Path) -> None:
    assert load_rule_set(mistaken(written, "round: 3\n", "")).digits == 6


# Mistakes ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "place", "cause", "hint"),
    [
        ("title:", "tilte:", "line 2, $.tilte", "unknown key 'tilte' (and 1 more)", "did you mean 'title'?"),
        ("title: Example\n", "", "line 1, $", "key 'title' is missing", "add 'title'"),
        (
            "parameters:",
            "parameter:",
            "line 5, $.parameter",
            "unknown key 'parameter'",
            "did you mean 'parameters'?",
        ),
        (
            "    use: kitting.pose\n    with:",
            "    use: kitting.pose\n    wiht:",
            "line 10, $.rules.pose.wiht",
            "unknown key 'wiht'",
            "did you mean 'with'?",
        ),
        (
            "{max_distance_m: 0.03}",
            "{max_distanc_m: 0.03}",
            "line 10, $.rules.pose.with.max_distanc_m",
            "kitting.pose has no parameter 'max_distanc_m'",
            "did you mean 'max_distance_m'?",
        ),
        (
            "{max_distance_m: 0.03}",
            "{max_distance_m: 3 cm}",
            "line 10, $.rules.pose.with.max_distance_m",
            "parameter 'max_distance_m' of kitting.pose: '3 cm' is not a float",
            "give a number in m, such as 0.03",
        ),
        (
            "delta_m: 2.6",
            "delta_m: yes",
            "line 16, $.monitors.separation.with.delta_m",
            "parameter 'delta_m' of iso_ts_15066.ssm_separation: True is not a float",
            "its default is",
        ),
        (
            "delta_m: 2.6",
            "delta_m: .nan",
            "line 16, $.monitors.separation.with.delta_m",
            "nan is not a finite number",
            "give a number",
        ),
        (
            "delta_m: 2.6",
            "delta_m: [2.6]",
            "line 16, $.monitors.separation.with.delta_m",
            "[2.6] is not a float",
            "its default is",
        ),
        (
            "profile: seed",
            "profile: sed",
            "line 15, $.monitors.separation.with.profile",
            "'sed' is not one of",
            "its default is",
        ),
        (
            "weight: 0.4",
            "weight: true",
            "line 6, $.parameters.weight",
            "True is not of type 'number'",
            "give a number",
        ),
        (
            "weight: 0.4",
            "weight: heavy",
            "line 6, $.parameters.weight",
            "'heavy' is not of type 'number'",
            "",
        ),
        ("round: 3", "round: 3.5", "line 23, $.round", "3.5 is not of type 'integer'", "give an integer"),
        (
            "round: 3",
            "round: 13",
            "line 23, $.round",
            "13 is greater than the maximum of 12",
            "Decimal digits",
        ),
        ("  pose:", "  Pose:", "line 7, $.rules", "'Pose' does not match", ""),
        (
            "use: kitting.pose",
            "use: kitting",
            "$.rules.pose.use",
            "'kitting' does not match",
            "Entry-point name",
        ),
        (
            "  separation:\n",
            "  pose:\n    use: ariac.human_contact\n  separation:\n",
            "line 12, $.monitors.pose",
            "'pose' is both a rule and a monitor",
            "each must be one thing",
        ),
        (
            "    with: {max",
            "    on_inconclusive: worst\n    with: {max",
            "line 10, $.rules.pose.on_inconclusive",
            "'worst' is not allowed here",
            "did you mean 'worst_case'?",
        ),
        (
            "title: Example",
            "title: Example\ntitle: Twice",
            "line 3",
            "key 'title' is given twice",
            "keep one",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place_its_cause_and_a_remedy(
    written: Path, old: str, new: str, place: str, cause: str, hint: str
) -> None:
    error = refusal(written, old, new, RuleSetError)

    assert place in error.place
    assert cause in error.cause
    assert hint in error.hint


@pytest.mark.parametrize(
    ("old", "new", "place", "cause", "hint"),
    [
        ("points(pose)", "points(pos)", "line 19, $.terms.order.total", "'pos', which is no check", "'pose'"),
        (
            "points(pose)",
            "pose",
            "line 19, $.terms.order.total",
            "unknown name 'pose'",
            "'pose' is a check: ask",
        ),
        (
            "points(pose)",
            "pionts(pose)",
            "line 19, $.terms.order.total",
            "unknown function 'pionts'",
            "'points'",
        ),
        ("points(pose)", "count(pos)", "line 19, $.terms.order.total", "'pos', which is no check", "'pose'"),
        (
            "order.priority",
            "order.prority",
            "line 19",
            "unknown name 'order.prority'",
            "did you mean 'priority'?",
        ),
        (
            "weight * dem",
            "wieght * dem",
            "line 21, $.terms.trial.demerits",
            "unknown name 'wieght'",
            "'weight'",
        ),
        ("tau_s=5", "tau=5", "line 21, $.terms.trial.demerits", "wrong arguments", "tau_s"),
        ("(1 + demerits)", "(1 + demerit)", "line 22, $.score", "unknown name 'demerit'", "'demerits'"),
        ("(1 + demerits)", "(1 + demerits", "line 22, $.score", "is not a formula", "formulas have numbers"),
        (
            "(1 + demerits)",
            "open('x')",
            "line 22, $.score",
            "a text as a number is not allowed",
            "compare texts with facts",
        ),
        (
            "(1 + demerits)",
            "order.__class__",
            "line 22, $.score",
            "leading underscore",
            "formulas have numbers",
        ),
        (
            "    total:",
            "    priority:",
            "$.terms.order.priority",
            "also the name of a fact of each order",
            "one thing",
        ),
        ("    demerits:", "    weight:", "$.terms.trial.weight", "also the name of a parameter", "one thing"),
    ],
)
def test_a_mistake_in_a_formula_is_told_with_its_term(
    written: Path, old: str, new: str, place: str, cause: str, hint: str
) -> None:
    error = refusal(written, old, new, FormulaError)

    assert place in error.place
    assert cause in error.cause
    assert hint in error.hint


@pytest.mark.parametrize(
    ("old", "new", "place", "hint"),
    [
        ("kitting.pose", "kitting.poze", "line 9, $.rules.pose.use", "did you mean 'kitting.pose'?"),
        (
            "kitting.pose",
            "ariac.no_event",
            "line 9, $.rules.pose.use",
            "it is a plugin of ariac_score.monitors",
        ),
        (
            "iso_ts_15066.ssm_separation",
            "kitting.pose",
            "line 13, $.monitors",
            "it is a plugin of ariac_score.rules",
        ),
    ],
)
def test_a_plugin_that_is_not_there_is_told_with_its_place(
    written: Path, old: str, new: str, place: str, hint: str
) -> None:
    error = refusal(written, f"use: {old}", f"use: {new}", PluginNotFoundError)

    assert place in error.place
    assert hint in error.hint
    assert repr(new) in error.cause


@pytest.mark.parametrize(("written_as", "said"), [(".nan", "nan"), (".inf", "inf"), ("-.inf", "-inf")])
def test_a_parameter_that_is_no_finite_number_is_refused_with_its_line(
    written: Path, written_as: str, said: str
) -> None:
    # JSON Schema counts NaN as a number; a score must not.
    with pytest.raises(RuleSetError, match=f": {said} is not a finite number") as error:
        load_rule_set(mistaken(written, "weight: 0.4", f"weight: {written_as}"))

    assert error.value.place == "line 6, $.parameters.weight"


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("paper202", "did you mean 'paper2020'?"),
        ("", "installed rule sets"),
        ("x y", "a path to"),
        ("x" * 300, "a path to"),
    ],
)
def test_an_unknown_rule_set_is_a_mistake_in_the_command(name: str, hint: str) -> None:
    with pytest.raises(UsageError, match="there is no rule set") as refused:
        load_rule_set(name)
    assert hint in refused.value.hint


@pytest.mark.parametrize("name", ["ariac2020", "ariac2020.log_map"])
def test_a_log_map_is_no_rule_set(name: str) -> None:
    with pytest.raises(UsageError, match="there is no rule set"):
        load_rule_set(name)


def test_a_rule_set_file_that_is_missing_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(RuleSetError, match="no such file"):
        load_rule_set(str(tmp_path / "gone.yaml"))


def test_every_fact_a_formula_may_name_is_described() -> None:
    facts = load_rule_set("paper2020.published").sheet.facts

    assert {level for level, own in facts.items() if own} == {"submission", "order", "trial"}
    assert all(fact.meaning for own in facts.values() for fact in own.values())


# The competition -----------------------------------------------------------------------


def test_the_competition_is_built_with_its_parameters(written: Path) -> None:
    text = SOUND.replace("{use: ariac}", "{use: ariac, with: {edition: 2020}}")
    written.write_text(text, encoding="utf-8")

    competition = load_rule_set(str(written)).build_competition(REGISTRY)

    assert type(competition).__name__ == "Ariac"
    assert competition.edition == 2020


def test_a_rule_set_that_names_no_competition_has_none(written: Path) -> None:
    text = SOUND.replace(
        "competition: {use: ariac}", "levels: [order, trial]\nfacts: {order: {priority: number}}"
    )
    written.write_text(text, encoding="utf-8")

    assert load_rule_set(str(written)).build_competition(REGISTRY) is None


def test_a_parameter_of_the_competition_at_the_top_is_refused_with_the_line_to_write(written: Path) -> None:
    error = refusal(written, "source: by hand", "source: by hand\nedition: 2020", RuleSetError)

    assert error.cause == "'edition' is a parameter of the competition"
    assert "line 4" in error.place
    assert error.hint == "write 'competition: {use: ariac, with: {edition: 2020}}'"


@pytest.mark.parametrize(
    ("competition", "kind", "cause", "line"),
    [
        ("{use: regatta}", PluginNotFoundError, "no installed distribution provides 'regatta'", 24),
        ("{use: ariac, with: {editoin: 2020}}", RuleSetError, "ariac has no parameter 'editoin'", 24),
        ("{use: ariac, with: {edition: latest}}", RuleSetError, "'latest' is not an int", 24),
        ("ariac", RuleSetError, "'ariac' is not of type 'object'", 24),
        ("{with: {edition: 2020}}", RuleSetError, "key 'use' is missing", 24),
    ],
)
def test_a_mistake_in_the_competition_is_told_at_its_place(
    written: Path, competition: str, kind: type[ScoreError], cause: str, line: int
) -> None:
    text = SOUND.replace("competition: {use: ariac}", f"competition: {competition}")
    written.write_text(text, encoding="utf-8")

    with pytest.raises(kind) as refused:
        load_rule_set(str(written)).build_competition(REGISTRY)

    assert cause in refused.value.cause
    assert refused.value.file == str(written)
    assert f"line {line}" in refused.value.place


def test_the_rules_of_an_older_result_name_their_competition_by_its_parameter() -> None:
    text = SOUND.replace("competition: {use: ariac}", "edition: 2019")

    competition = rule_set_from_text(text, file="the rules in the result").competition

    assert competition is not None
    assert (competition.use, dict(competition.parameters)) == ("ariac", {"edition": 2019})


# Levels and facts ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "place", "cause", "hint"),
    [
        ("  order:\n", "  ordr:\n", "line 18, $.terms.ordr", "level 'ordr' is not declared", "'order'?"),
        ("sum(order.total)", "sum(odrer.total)", "line 22", "level 'odrer' is not declared", "'order'?"),
        (
            "sum(order.total)",
            "sum(object.total)",
            "line 22",
            "level 'object' is not declared",
            "write for instance 'levels: [object, part, submission, order, trial]'",
        ),
        (
            "round: 3",
            "printed: {objects: {}}",
            "line 23, $.printed.objects",
            "not declared",
            "part, submission",
        ),
        (
            "round: 3",
            "adds_up: {objects: {}}",
            "line 23, $.adds_up.objects",
            "not declared",
            "part, submission",
        ),
        (
            "round: 3",
            "cohort: {t: {of: run, mean: 1}}",
            "line 23, $.cohort.t.of",
            "'run' is not declared",
            "part",
        ),
        (
            "round: 3",
            "facts: {run: {time_s: number}}",
            "line 23, $.facts.run",
            "'run' is not declared",
            "part",
        ),
        ("round: 3", "levels: [order, order, trial]", "line 23, $.levels", "declared twice", "once"),
        (
            "round: 3",
            "levels: [trial, order]",
            "line 23, $.levels",
            "the last level is 'order'",
            "inside out",
        ),
        ("round: 3", "levels: [weight, order, trial]", "$.levels", "the name of a parameter", "one thing"),
        ("round: 3", "levels: [runs, order, trial]", "$.levels", "value across runs", "one thing"),
        ("round: 3", "levels: [count, order, trial]", "$.levels", "the name of a function", "one thing"),
        ("round: 3", "levels: [lambda, order, trial]", "$.levels", "'lambda' is no name", "a word"),
        ("round: 3", "facts: {order: {total: number}}", "$.terms.order.total", "a fact of each order", "one"),
        (
            "round: 3",
            "facts: {trial: {duration_s: text}}",
            "$.facts.trial",
            "a number of every",
            "another name",
        ),
    ],
)
def test_a_mistake_in_levels_or_facts_is_told_with_its_place(
    written: Path, old: str, new: str, place: str, cause: str, hint: str
) -> None:
    error = refusal(written, old, new, FormulaError)

    assert place in error.place
    assert cause in error.cause
    assert hint in error.hint


@pytest.mark.parametrize("facts", ["{order: {kind: word}}", "{order: {kind: {unit: m}}}", "{order: [kind]}"])
def test_a_fact_is_a_number_or_a_text(written: Path, facts: str) -> None:
    error = refusal(written, "round: 3", f"facts: {facts}", RuleSetError)

    assert "line 23, $.facts.order" in error.place


def test_a_rule_set_without_a_competition_has_the_trial_alone(written: Path) -> None:
    error = refusal(written, "competition: {use: ariac}", "", FormulaError)

    assert error.cause == "terms: level 'order' is not declared"
    assert "or name the competition that declares it" in error.hint


def test_its_own_levels_and_facts_come_before_those_of_the_competition(written: Path) -> None:
    own = "round: 3\nlevels: [order, trial]\nfacts: {order: {priority: text, kind: text}}"
    text = SOUND.replace("round: 3", own).replace(" * order.priority", " * order.index")
    written.write_text(text, encoding="utf-8")

    sheet = load_rule_set(str(written)).sheet

    assert sheet.levels == ("order", "trial")
    kinds = {name: fact.type for name, fact in sheet.facts_of("order").items()}
    assert kinds == {"index": "number", "priority": "text", "parts": "number", "kind": "text"}


def test_levels_and_facts_are_inherited_and_replaced_by_those_of_the_heir(
    written: Path, tmp_path: Path
) -> None:
    own = "round: 3\nlevels: [object, order, trial]\nfacts: {object: {kind: text}}"
    written.write_text(SOUND.replace("round: 3", own), encoding="utf-8")
    heir = tmp_path / "heir.yaml"
    head = "id: heir\ntitle: H\nsource: s\nextends: ./rules.yaml\n"
    heir.write_text(head + "facts: {object: {mass_kg: number}, order: {name: text}}\n", encoding="utf-8")

    sheet = load_rule_set(str(heir)).sheet

    assert sheet.levels == ("object", "order", "trial")
    assert set(sheet.facts_of("object")) == {"kind", "mass_kg"}
    assert {"name", "priority"} <= set(sheet.facts_of("order"))

    heir.write_text(head + "levels: [object, run, order, trial]\n", encoding="utf-8")
    assert load_rule_set(str(heir)).sheet.levels == ("object", "run", "order", "trial")


def test_what_a_result_holds_needs_no_plugin_of_the_competition() -> None:
    text = load_rule_set("paper2020.published").text.replace("use: ariac\n", "use: gone_with_its_authors\n")

    sheet = rule_set_from_text(text, file="the rules in the result").sheet

    assert sheet.levels == ("part", "submission", "order", "trial")
    assert "priority" in sheet.facts_of("order")


def test_the_rules_of_an_older_result_have_the_levels_all_rules_had() -> None:
    text = SOUND.replace("competition: {use: ariac}", "")

    sheet = rule_set_from_text(text, file="the rules in the result").sheet

    assert sheet.levels == ("part", "submission", "order", "trial")
    assert set(sheet.facts_of("order")) == {"index", "priority", "parts"}
    assert set(sheet.facts_of("trial")) == {"duration_s", "orders"}
