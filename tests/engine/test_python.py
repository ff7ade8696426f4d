"""The package as people use it in Python: what they give, what they get, and what they are told."""

from __future__ import annotations

import builtins
import hashlib
import linecache
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import (
    Finding,
    MissingSignalError,
    Result,
    RuleSet,
    ScoreError,
    Signal,
    SignalNeed,
    Span,
    Trial,
    UsageError,
    Verdict,
    as_json,
    load_cohort,
    load_log_map,
    load_result,
    load_rule_set,
    load_yaml,
    measure_trial,
    open_trial,
    parameter,
    read_messages,
    reprice,
    score_trial,
    write_output,
)
from ariac_score.checks.registry import Registry
from ariac_score.errors import FormulaError, LocalPluginError, PluginError, RuleSetError
from ariac_score.results.notebook import result_html
from ariac_score.review.verify import verify_result
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.testing import write_trial_log
from ariac_score_ariac.testing import kitting_trial

LOG = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
RULES = load_rule_set("paper2020.published")
TASK = 28  # what the shipments of the example are worth under paper2020.published


@pytest.fixture(scope="module")
def scored() -> Result:
    return score_trial(LOG, RULES)


# Wrong things given ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "call",
    [
        lambda wrong: score_trial(wrong, "paper2020.published"),
        lambda wrong: score_trial(LOG, wrong),
        lambda wrong: score_trial(LOG, "paper2020.published", log_map=wrong),
        lambda wrong: score_trial(LOG, "paper2020.published", also=[wrong]),
        lambda wrong: open_trial(wrong),
        lambda wrong: open_trial(LOG, 3 if wrong is None else wrong),
        lambda wrong: load_rule_set(wrong),
        lambda wrong: load_result(wrong),
        lambda wrong: load_log_map(wrong),
        lambda wrong: load_yaml(wrong),
        lambda wrong: load_cohort(wrong, RULES),
        lambda wrong: load_cohort("cohort.json", wrong),
        lambda wrong: list(read_messages(wrong)),
        lambda wrong: measure_trial(wrong, "paper2020.published"),
        lambda wrong: measure_trial(Trial("t"), wrong),
        lambda wrong: reprice(wrong, "paper2020.published"),
        lambda wrong: as_json(wrong),
        lambda wrong: RULES.with_parameters(3 if wrong is None else wrong),
        lambda wrong: RULES.with_monitor("near_miss", wrong),
        lambda wrong: RULES.with_score([wrong]),  # type: ignore[arg-type]
        lambda wrong: RULES.with_parameters({wrong: 1.0} if wrong != [] else {"": 1.0}),
        lambda wrong: RULES.with_parameters({"separation_weight": "x" if wrong != [] else wrong}),
        lambda wrong: write_output("x", 3 if wrong is None else wrong),
    ],
)
@pytest.mark.parametrize("wrong", [3, None, 1.5, []], ids=repr)
def test_a_wrong_thing_is_refused_with_a_remedy_and_no_traceback_of_ours(
    call: Callable[[Any], object], wrong: object
) -> None:
    with pytest.raises(ScoreError) as error:
        call(wrong)

    assert error.value.cause
    assert error.value.hint


def test_a_path_is_text_or_a_path_and_a_rule_set_its_name_its_path_or_itself(
    tmp_path: Path, scored: Result
) -> None:
    file = tmp_path / "same.yaml"
    file.write_text(RULES.text, encoding="utf-8")

    for rules in ("paper2020.published", file, str(file), RULES):
        for path in (LOG, str(LOG)):
            assert score_trial(path, rules).score == scored.score


def test_a_path_without_an_ending_is_never_taken_for_a_name(tmp_path: Path) -> None:
    with pytest.raises(ScoreError, match="no such file"):
        load_rule_set(Path("paper2020.published"))


# The trial ------------------------------------------------------------------------------


def test_an_opened_trial_is_the_one_that_checks_see(scored: Result) -> None:
    trial = open_trial(str(LOG), "paper2020.published")

    assert measure_trial(trial, "paper2020.published").findings == scored.findings
    assert not trial.signals["speed/robot"].values.flags.writeable


def test_what_the_checks_need_is_derived(tmp_path: Path) -> None:
    trial = kitting_trial()
    recorded = [name for name in trial.signals if name.startswith("position/")]
    log = write_trial_log(tmp_path / "t.jsonl", trial, signals=recorded)

    assert open_trial(log, "paper2020.published").signals["centre_distance/robot/human"].source == "derived"
    assert "centre_distance/robot/human" not in open_trial(log).signals


def test_without_rules_a_log_map_says_what_topics_mean_and_nothing_is_derived() -> None:
    trial = open_trial(LOG, log_map=RULES.log_map)

    assert not [name for name, signal in trial.signals.items() if signal.source == "derived"]
    with pytest.raises(UsageError, match="nothing says which of its topics is which signal"):
        open_trial(LOG)


# Tables ---------------------------------------------------------------------------------


def test_a_signal_as_a_table_has_its_samples_and_its_unit() -> None:
    pytest.importorskip("pandas")
    t = np.array([0.0, 0.5, 1.5])
    flat = Signal("speed/robot", "m/s", t, np.array([1.0, 2.0, 3.0])).to_frame()
    wide = Signal("position/robot", "m", t, np.arange(9.0).reshape(3, 3)).to_frame()

    assert flat.index.name == "t_s"
    assert flat["speed/robot"].tolist() == [1.0, 2.0, 3.0]
    assert flat.attrs == {"units": {"speed/robot": "m/s"}}
    assert wide.columns.tolist() == ["position/robot[0]", "position/robot[1]", "position/robot[2]"]
    assert wide.loc[0.5].tolist() == [3.0, 4.0, 5.0]


def test_signals_side_by_side_are_not_invented_in_gaps() -> None:
    pytest.importorskip("pandas")
    slow = Signal("a/x", "m", np.array([0.0, 1.0, 5.0]), np.array([0.0, 1.0, 5.0]))
    fast = Signal("b/x", "s", np.array([0.0, 0.5, 3.0]), np.array([0.0, 1.0, 2.0]))
    trial = Trial("t", signals={"a/x": slow, "b/x": fast})

    assert trial.to_frame("a/x", "b/x", max_gap_s=1.0).index.tolist() == [0.0, 0.5]
    both = trial.to_frame()
    assert both.index.tolist() == [0.0, 0.5, 1.0, 3.0]
    assert both.loc[3.0].tolist() == [3.0, 2.0]  # `a` runs straight from 1 to 5
    assert both.attrs["units"] == {"a/x": "m", "b/x": "s"}
    with pytest.raises(MissingSignalError, match="'a/y' is not in the log"):
        trial.to_frame("a/y")
    assert Trial("empty").to_frame().empty


def test_findings_and_ledger_as_tables_hold_what_the_result_holds(scored: Result) -> None:
    pytest.importorskip("pandas")
    findings, ledger = scored.measured.to_frame(), scored.ledger.to_frame() if scored.ledger else None

    assert findings.index.tolist() == list(scored.findings)
    near = scored.findings["separation#1"]
    assert near.span is not None
    assert findings.loc["separation#1", "start_s"] == near.span.start_s
    assert findings.loc["separation#1", "quantities.depth_max_m"] == near.quantities["depth_max_m"]
    assert findings.attrs["units"]["quantities.depth_max_m"] == "m"
    assert np.isnan(findings.loc["part_type#1", "quantities.depth_max_m"])
    assert ledger is not None
    assert scored.score is not None
    leaves = {line.path for line in scored.ledger.leaves} if scored.ledger else set()
    assert ledger.loc[sorted(leaves), "amount"].sum() == pytest.approx(float(scored.score))


def test_without_pandas_a_table_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, scored: Result) -> None:
    known = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name == "pandas":
            raise ImportError(name)
        return known(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    for make in (scored.measured.to_frame, Trial("t").to_frame):
        with pytest.raises(UsageError, match="needs pandas") as error:
            make()
        assert error.value.hint == "pip install 'ariac-score[notebook]'"


# In a notebook --------------------------------------------------------------------------


class _Tags(HTMLParser):
    """Every tag, attribute and text of some HTML."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[str] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_result_shows_its_score_its_ledger_and_what_was_violated(scored: Result) -> None:
    shown = _Tags(scored._repr_html_())

    assert shown.text.startswith("19.761677 of 36 · kitting_near_miss under paper2020.published: scored")
    assert "earned30" in shown.text
    assert "separation#1robot/human" in shown.text


def test_what_is_hostile_in_a_result_is_text_and_long_results_stay_small() -> None:
    attack = "<script>alert(1)</script><img src=x onerror=alert(1)>&\"'"
    findings = {
        f"{attack}#{k}": Finding(attack, verdict, attack * 99)
        for k, verdict in enumerate([Verdict.VIOLATED, Verdict.INCONCLUSIVE] * 500)
    }

    html = result_html(attack, Decimal("1.50"), None, None, findings)

    shown = _Tags(html)
    assert set(shown.tags) <= {"div", "p", "b", "table", "thead", "tbody", "tr", "th", "td"}
    assert set(shown.attributes) <= {"colspan"}
    assert attack in shown.text
    assert "and 488 more" in shown.text
    assert len(html) < 50_000
    assert _Tags(result_html("t", None, None, None, {})).text == "no score · t"


# Sweeps ---------------------------------------------------------------------------------


def test_other_numbers_are_those_of_a_file_with_them(tmp_path: Path) -> None:
    file = tmp_path / "other.yaml"
    file.write_text(
        "id: other\ntitle: t\nsource: s\nextends: paper2020.published\nparameters: {separation_weight: 0.8}\n"
        "monitors:\n  separation: {use: iso_ts_15066.ssm_separation, with: {profile: seed, t1_s: 0.6, "
        "t2_s: 1.5, stopping_distance_m: 0.0, delta_m: 2.6}}\n",
        encoding="utf-8",
    )

    swept = score_trial(LOG, RULES.with_parameters({"separation.t1_s": 0.6}, separation_weight=0.8))

    assert swept.score == score_trial(LOG, file).score


def test_a_changed_rule_set_stands_in_the_result_with_a_hash_of_its_own(tmp_path: Path) -> None:
    rules = RULES.with_parameters({"separation.t1_s": 0.6})
    result = score_trial(LOG, rules)

    assert RULES.checks["separation"].parameters["t1_s"] == 1.0
    assert result.provenance.rule_set.sha256 not in ("", RULES.sha256)
    assert rule_set_from_text(result.rules, file="x").checks["separation"].parameters["t1_s"] == 0.6
    assert rules.with_parameters({"separation.t1_s": 0.7}).sha256 != rules.sha256
    stored = tmp_path / "result.json"
    write_output(as_json(result), str(stored))
    assert load_result(str(stored)).score == result.score
    (tmp_path / "swept.yaml").write_text(result.rules, encoding="utf-8")
    assert verify_result(stored, log=LOG, rules=str(tmp_path / "swept.yaml")).holds
    assert verify_result(stored, log=LOG).steps_that_are("failed") == ("rules",)  # a published name


@pytest.mark.parametrize(
    ("values", "hint"),
    [
        ({"separation_wieght": 1.0}, "did you mean 'separation_weight'?"),
        ({"separatoin.t1_s": 1.0}, "did you mean 'separation.t1_s'?"),
        ({"nothing": 1.0}, "it has:"),
    ],
)
def test_a_number_that_is_not_there_is_answered_with_the_nearest(values: dict[str, float], hint: str) -> None:
    with pytest.raises(RuleSetError, match="has no parameter") as error:
        RULES.with_parameters(values)

    assert error.value.hint.startswith(hint)


@pytest.mark.parametrize("value", ["1 s", [1.0], True, float("nan"), -1e99])
def test_a_value_that_a_check_refuses_is_refused_by_name(value: object) -> None:
    with pytest.raises(RuleSetError, match="t1_s"):
        RULES.with_parameters({"separation.t1_s": value}).build(Registry())


# A class of one's own -------------------------------------------------------------------


@dataclass(frozen=True)
class Told:
    """Says so many violations."""

    times: int = parameter(1, unit="1", at_least=0, at_most=9)
    notes: tuple[str, ...] = ()

    def needs(self) -> Iterator[SignalNeed]:
        yield from ()

    def watch(self, trial: Trial) -> Iterator[Finding]:
        if not self.times:
            yield Finding.satisfied("trial", "none")
        for k in range(self.times):
            yield Finding.violated("trial", f"number {k}")


class Plain:
    """Without fields; what it says was given to its constructor."""

    def __init__(self, word: str = "so") -> None:
        self.word = word

    def needs(self) -> list[SignalNeed]:
        return []

    def watch(self, trial: Trial) -> list[Finding]:
        return [Finding.violated("trial", self.word)]


@dataclass
class Holder:
    """A field that no rule set can hold."""

    window: Span = field(default_factory=lambda: Span(0.0, 1.0))

    def needs(self) -> list[SignalNeed]:
        return []

    def watch(self, trial: Trial) -> list[Finding]:
        return [Finding.violated("trial", f"{self.window.duration_s:g} s")]


def with_told(monitor: object) -> RuleSet:
    return RULES.with_monitor("told", monitor).with_score("task - count(told)")


def code_of(result: Result) -> Any:
    (code,) = [one for one in result.provenance.code if one.distribution == "notebook class"]
    return code


@pytest.mark.parametrize(("monitor", "cost"), [(Told, 1), (Told(times=3), 3), (Told(0, ("a", "b")), 0)])
def test_a_class_or_an_object_of_it_is_a_monitor_with_its_parameters(monitor: object, cost: int) -> None:
    rules = with_told(monitor)

    result = score_trial(LOG, rules)

    assert result.score == TASK - cost
    assert result.checks["told"]["use"] == "notebook:Told"
    assert rules.with_parameters({"told.times": 2}).build(Registry())["told"].times == 2
    text = Path(__file__).read_text(encoding="utf-8")
    found = re.search(r"@dataclass\(frozen=True\)\nclass Told:.*?(?=\n\n\nclass)", text, re.DOTALL)
    assert found is not None
    assert code_of(result).sha256 == hashlib.sha256(f"{found[0]}\n".encode()).hexdigest()


@pytest.mark.parametrize("monitor", [Plain("hm"), Holder(Span(0.0, 2.0))])
def test_an_object_that_fields_cannot_make_again_is_unverifiable_and_says_so(monitor: object) -> None:
    rules = with_told(monitor)
    result = score_trial(LOG, rules)

    assert result.findings["told#1"].message in ("hm", "2 s")
    assert (code_of(result).version, code_of(result).sha256) == ("unverifiable", "")
    with pytest.raises(RuleSetError, match="a number of an object"):
        rules.with_parameters({"told.word": "x"})


def test_a_class_without_a_text_is_unverifiable_and_one_of_a_cell_has_its_hash() -> None:
    text = "class Cell:\n    def needs(self): return []\n    def watch(self, trial): return []\n"
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(text, "<typed at a prompt>", "exec"), names)  # noqa: S102  # our own text
    assert RULES.with_monitor("told", names["Cell"]).given["told"].code_sha256() == ""

    linecache.cache["<cell 7>"] = (len(text), None, text.splitlines(keepends=True), "<cell 7>")
    exec(compile(text, "<cell 7>", "exec"), names)  # noqa: S102  # our own text
    sha256 = RULES.with_monitor("told", names["Cell"]).given["told"].code_sha256()
    assert sha256 == hashlib.sha256(text.encode()).hexdigest()


def test_a_given_monitor_takes_the_place_of_the_check_of_its_name() -> None:
    rules = RULES.with_monitor("separation", Told).with_monitor("right_agv", Told)

    assert rules.checks["right_agv"].group == "ariac_score.monitors"
    assert rules.checks["separation"].use == "notebook:Told"


@pytest.mark.parametrize("name", ["", "Near Miss", "1st", "near-miss", "<script>"])
def test_a_name_that_is_none_of_a_check_is_refused(name: str) -> None:
    with pytest.raises((RuleSetError, FormulaError)):
        RULES.with_monitor(name, Told)


def test_its_failures_name_the_class() -> None:
    class Broken(Plain):
        def watch(self, trial: Trial) -> list[Finding]:
            raise KeyError("gone")

    with pytest.raises(PluginError, match="check 'told': plugin notebook:Broken") as error:
        score_trial(LOG, with_told(Broken))
    assert error.value.hint.endswith("correct the class 'Broken'")


def test_a_result_of_a_notebook_keeps_its_sums_but_nobody_can_measure_it_again(tmp_path: Path) -> None:
    stored = tmp_path / "result.json"
    write_output(as_json(score_trial(LOG, with_told(Told))), stored)

    alone = verify_result(stored)
    assert alone.steps_that_are("open") == ("code", "log")
    assert any("the class Told, given in Python, made it" in step.words for step in alone.steps)
    with pytest.raises(LocalPluginError, match="was a class in somebody's Python"):
        verify_result(stored, log=LOG)
    assert not verify_result(stored, log=LOG, local_plugins=True).holds


def test_a_sweep_may_take_its_numbers_from_numpy() -> None:
    rules = RULES

    for t_s in np.linspace(0.5, 1.5, 3):
        assert rules.with_parameters({"separation.t1_s": t_s}).expanded == (
            rules.with_parameters({"separation.t1_s": float(t_s)}).expanded
        )
