"""What the oracle answers, frame by frame, without a network."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Event,
    Finding,
    InstantVerdict,
    Measure,
    OnlineWatch,
    Sample,
    SignalNeed,
    Trial,
    Verdict,
    load_rule_set,
)
from ariac_score.checks.contracts import OnlineMonitor
from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginNotFoundError, RuleSetError, UsageError
from ariac_score.oracle.conversation import Conversation
from ariac_score.oracle.judges import Judge, Opinion, RulesBench, SpecBench
from ariac_score.scoring.ruleset import RuleSet

PAPER = RulesBench(load_rule_set("paper2020.published"), Registry())
NEGATIVE = ("false", "currently_false")


def snapshot(time: object, distance_m: object = 9.0, **changed: object) -> dict[str, Any]:
    fields = {"human_operator_speed": 0.0, "robot_speed": 0.0, "distance_robot_human_operator": distance_m}
    return {"topic": "snapshot", **fields, "time": time, **changed}


@pytest.fixture
def talk(tmp_path: Path) -> Iterator[Conversation]:
    conversation = Conversation(PAPER.judge(), tmp_path / "log.jsonl")
    yield conversation
    conversation.close("tested")


def ask(talk: Conversation, event: object) -> dict[str, Any]:
    reply: dict[str, Any] = json.loads(talk.answer(json.dumps(event)))
    return reply


def verdict(talk: Conversation, event: object) -> str:
    return str(ask(talk, event)["verdict"])


# The reply -------------------------------------------------------------------------------


def test_a_kept_distance_is_echoed_with_its_verdict_and_nothing_else(talk: Conversation) -> None:
    event = snapshot(1.0, 2.6)  # both at rest: d_min is delta, and equal distance satisfies

    assert ask(talk, event) == {**event, "verdict": "currently_true"}


def test_a_broken_distance_says_by_how_much(talk: Conversation) -> None:
    event = snapshot(1.0, 2.5)

    assert ask(talk, event) == {
        **event,
        "verdict": "currently_false",
        "spec": "separation: robot/human: 0.100 m nearer than the required 2.600 m",
    }


def test_the_event_comes_back_to_the_character() -> None:
    judge = SimpleNamespace(take=lambda _event: Opinion("currently_true"))
    text = ' {"topic":"x",  "time": 1782458598.6852260, "n": 1e0, "nan": NaN, "u": "\\u00e9é" } \n'

    talk = Conversation(judge, Path("/dev/null"))

    assert talk.answer(text) == text.rstrip()[:-1].rstrip() + ', "verdict": "currently_true"}'
    assert talk.answer(text.encode()) == talk.answer(text)
    talk.close("tested")


def test_the_verdict_of_an_earlier_run_gives_way(talk: Conversation) -> None:
    event = snapshot(1.0)

    assert ask(talk, {**event, "verdict": "currently_false", "spec": "old"}) == {
        **event,
        "verdict": "currently_true",
    }


_JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.integers() | st.text(max_size=6),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
_NAMES = st.sampled_from([*snapshot(1.0), "service", "request", "verdict", "spec", "x"])


@given(events=st.lists(st.dictionaries(_NAMES, _JSON, max_size=6) | _JSON, max_size=6))
@settings(max_examples=60)
def test_every_frame_is_answered_in_the_form_the_strictest_nodes_ask_for(events: list[object]) -> None:
    talk = Conversation(PAPER.judge(), Path("/dev/null"))
    for event in events:
        reply = ask(talk, event)
        added = {"verdict", "spec"} if reply["verdict"] in NEGATIVE else {"verdict"}
        known = (
            {k: v for k, v in event.items() if k not in ("verdict", "spec")}
            if isinstance(event, dict)
            else {}
        )
        assert reply["verdict"] in ("currently_true", "currently_false", "unknown")
        assert reply.keys() == known.keys() | added
        assert {name: reply[name] for name in known} == known
        assert reply.get("spec", "said")
    talk.close("tested")


@pytest.mark.parametrize(
    "frame",
    [
        *("", " ", "hello", "{", "[]", "3", "null", '"text"', '{"a": 1} {"a": 2}', "[" * 100_000),
        *(b"\xff\xfe", b"", '{"a": 1, "a": 2}', "\ufeff{}"),
    ],
)
def test_what_is_no_event_is_answered_and_counted(talk: Conversation, frame: str | bytes) -> None:
    assert verdict(talk, snapshot(1.0, 2.5)) == "currently_false"

    assert talk.answer(frame) == '{"verdict": "unknown"}'

    assert talk.bad_frames == 1
    assert talk.first_fault.startswith("no event: ")
    assert verdict(talk, snapshot(1.01, 2.5)) == "currently_false"
    assert talk.events == 2  # the log holds events only


# The verdict -----------------------------------------------------------------------------


def test_nothing_is_known_before_the_first_snapshot(talk: Conversation) -> None:
    assert verdict(talk, {"topic": "chatter", "data": "hello", "time": 1.0}) == "unknown"
    assert talk.unjudged == 0


def test_an_event_about_something_else_leaves_the_trace_as_it_stands(talk: Conversation) -> None:
    ask(talk, snapshot(1.0, 1.0))

    reply = ask(talk, {"topic": "/chatter", "data": "hello", "time": 1.01})

    assert reply["verdict"] == "currently_false"
    assert reply["spec"]


def test_what_is_older_than_the_accepted_gap_says_nothing_any_more(talk: Conversation) -> None:
    for distance_m in (1.0, 9.0):
        ask(talk, snapshot(distance_m, distance_m))
        chatter = {"topic": "/chatter", "data": ""}
        assert verdict(talk, {**chatter, "time": distance_m + 0.05}) != "unknown"
        assert verdict(talk, {**chatter, "time": distance_m + 0.06}) == "unknown"
        # A wall clock says nothing about how old a simulated stamp is.
        assert verdict(talk, {**chatter, "time": 1.7e9}) != "unknown"


@pytest.mark.parametrize(
    ("event", "fault"),
    [
        ({"topic": "snapshot", "time": 2.0, "robot_speed": 0.0}, "'human_operator_speed' is missing"),
        (snapshot(2.0, "near"), "is no number"),
        (snapshot(2.0, None), "is no number"),
        (snapshot(2.0, float("nan")), "cannot be"),
        (snapshot(2.0, float("inf")), "cannot be"),
        (snapshot(2.0, -0.1), "cannot be"),
        (snapshot(2.0, 10**400), "cannot be"),
        (snapshot(None), "no time"),
        (snapshot(float("nan")), "no time"),
        (snapshot(1.0), "and is at 1.0 s"),
        (snapshot(0.5), "and is at 0.5 s"),
        ({"data": 1, "time": 2.0}, "names no topic"),
        ({}, "names no topic"),
    ],
)
def test_an_event_that_cannot_be_judged_is_echoed_unknown_and_counted(
    talk: Conversation, event: dict[str, Any], fault: str
) -> None:
    assert verdict(talk, snapshot(1.0)) == "currently_true"

    text = talk.answer(json.dumps(event))

    assert json.loads(text)["verdict"] == "unknown"
    assert "spec" not in json.loads(text)
    assert (talk.unjudged, talk.bad_frames) == (1, 0)
    assert fault in talk.first_fault
    assert verdict(talk, snapshot(3.0, 1.0)) == "currently_false"  # the trace goes on


def test_two_conversations_have_a_state_each(tmp_path: Path) -> None:
    first, second = (Conversation(PAPER.judge(), tmp_path / f"{i}.jsonl") for i in (1, 2))
    ask(first, snapshot(5.0, 1.0))

    assert verdict(second, snapshot(1.0, 9.0)) == "currently_true"
    for talk in (first, second):
        talk.close("tested")


def test_the_log_is_what_came_one_event_a_line(talk: Conversation) -> None:
    event = json.dumps(snapshot(1.0), indent=1)

    talk.answer(event)
    talk.answer("no event")
    talk.answer(json.dumps(snapshot(1.01)))

    lines = talk.log.read_text().splitlines()
    assert [json.loads(line) for line in lines] == [snapshot(1.0), snapshot(1.01)]


def test_a_rule_set_says_what_is_judged_when() -> None:
    assert {*PAPER.live} == {"separation", "human_contact", "no_arm_collision"}
    assert PAPER.later["part_pose"] == "rules judge whole items of work"


# Every way of writing a monitor, on the snapshots of the paper ------------------------------

MIXED = """
id: mixed
title: One property in RML, one in temporal logic, one as a formula, one in Python, and some that wait
source: this test
log_map: ariac2020
monitors:
  in_rml:
    use: rml.spec
    with:
      spec: "far matches {topic:'snapshot', d:d} with d >= 2; Main = far*;"
      events: {snapshot: {d: "centre_distance/{robot}/{human}"}}
  in_stl:
    use: stl.formula
    with:
      formula: always (d < 2 -> eventually[0,0.02] v < 0.1)
      signals: {d: centre_distance in m, v: speed of robot in m/s}
  in_stl_without_bound:
    use: stl.formula
    with:
      formula: always (d < 2 -> eventually v < 0.1)
      signals: {d: centre_distance in m, v: speed of robot in m/s}
  in_a_formula:
    use: formula.never
    with: {holds: d < 2, signals: {d: "centre_distance/{robot}/{human}"}, unit: m}
  in_python: {use: iso_ts_15066.ssm_separation, with: {delta_m: 2.0}}
  too_fast: {use: iso_ts_15066.ssm_speed_cap, with: {delta_m: 2.0}}
  reacts:
    use: formula.within
    with:
      trigger: d < 2
      response: v < 0.1
      within_s: 0.5
      signals: {d: "centre_distance/{robot}/{human}", v: "speed/{robot}"}
  drops: {use: ariac.no_event, with: {kind: part_dropped}}
score: 1
"""


@pytest.fixture
def mixed(tmp_path: Path) -> RulesBench:
    file = tmp_path / "mixed.yaml"
    file.write_text(MIXED, encoding="utf-8")
    return RulesBench(load_rule_set(str(file)), Registry())


def test_a_rule_set_says_what_is_judged_at_the_end_and_why(mixed: RulesBench) -> None:
    assert {*mixed.live} == {"in_rml", "in_stl", "in_a_formula", "in_python", "too_fast", "drops"}
    assert {*mixed.later} == {"in_stl_without_bound", "reacts"}
    assert (
        "'eventually v < 0.1' (column 18) looks ahead without a bound" in mixed.later["in_stl_without_bound"]
    )
    assert mixed.later["reacts"] == "its monitor watches whole trials only"


def test_every_way_of_writing_a_monitor_is_answered_live(mixed: RulesBench, tmp_path: Path) -> None:
    talk = Conversation(mixed.judge(), tmp_path / "log.jsonl")
    distances = [3.0, 3.0, 1.5, 3.0, 3.0, 3.0]
    said = [ask(talk, snapshot(k / 100, d, robot_speed=0.5)).get("spec", "") for k, d in enumerate(distances)]
    talk.close("tested")

    at_once = {"in_rml", "in_a_formula", "in_python", "too_fast"}
    broken = [{part.partition(":")[0] for part in spec.split("; ")} - {""} for spec in said]
    # What was promised for the next two samples is known after these, and for that instant alone.
    assert broken == [set(), set(), at_once, set(), {"in_stl"}, set()]
    assert "in_rml: robot/human: 'snapshot' is rejected: it is no 'far'" in said[2]
    assert "in_a_formula: robot/human: 'not (d < 2)' does not hold by 0.500 m" in said[2]


def test_something_that_happened_is_said_until_the_end(mixed: RulesBench, tmp_path: Path) -> None:
    talk = Conversation(mixed.judge(), tmp_path / "log.jsonl")
    for k in range(3):
        ask(talk, snapshot(k / 100))
    assert verdict(talk, snapshot(0.03)) == "currently_true"

    dropped = {
        "topic": "/ariac_score/events",
        "time": 0.035,
        "kind": "part_dropped",
        "subject": "",
        "detail": "",
    }
    assert "drops: trial: part dropped at 0.035 s" in ask(talk, dropped)["spec"]
    assert "drops: trial: part dropped" in ask(talk, snapshot(0.04))["spec"]
    talk.close("tested")


def test_a_monitor_whose_signals_have_to_be_derived_judges_at_the_end() -> None:
    bench = RulesBench(load_rule_set("paper2020.published"), Registry(), log_map="ariac2022")

    assert bench.live == ("no_arm_collision",)  # which needs no signal
    assert bench.later["separation"] == "no topic gives its centre_distance and speed as they are"
    assert bench.judge().take(snapshot(1.0)) == Opinion("unknown")


def test_what_is_as_consumed_is_judged_by_nobody_event_by_event(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(
        "id: consumed\ntitle: t\nsource: s\nextends: ariac2020\n"
        "channels:\n  - {topic: /snapshot, as_consumed: true}\n"
    )
    bench = RulesBench(load_rule_set("paper2020.published"), Registry(), log_map=tmp_path / "map.yaml")

    assert "separation" in PAPER.live
    assert bench.live == ("no_arm_collision",)
    assert bench.later["separation"] == "no topic gives its centre_distance and speed as they are"


def test_an_event_that_the_log_map_makes_of_a_message_is_judged_when_it_comes(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(
        "id: bumps\ntitle: t\nsource: s\nextends: ariac2020\n"
        "channels:\n  - {topic: /bump, event: {kind: arm_collision}}\n"
    )
    judge = RulesBench(
        load_rule_set("paper2020.published"), Registry(), log_map=tmp_path / "map.yaml"
    ).judge()

    assert "collision" not in judge.take(snapshot(0.0)).spec
    assert "no_arm_collision" in judge.take({"topic": "/bump", "time": 0.01}).spec


# Monitors of all sorts -------------------------------------------------------------------


@dataclass(frozen=True)
class Scripted:
    """An online monitor that says what it is told to, sample by sample."""

    said: tuple[InstantVerdict | Exception, ...]

    @property
    def measures(self) -> dict[str, Measure]:
        """What the rule set prices."""
        return {"relative_depth_integral_s": Measure("s", best=0.0)}

    def needs(self) -> Iterator[SignalNeed]:
        yield SignalNeed("centre_distance", "m")

    def watch(self, _trial: Trial) -> Iterator[Finding]:
        yield Finding.satisfied("trial", "fine")

    def begin(self, _bodies: Sequence[Body] = ()) -> OnlineWatch:
        left = list(self.said)

        def step(_samples: list[Sample], _events: Sequence[Event] = ()) -> Iterator[InstantVerdict]:
            said = left.pop(0)
            if isinstance(said, Exception):
                raise said
            yield said

        return SimpleNamespace(step=step, end=lambda _trial: ())  # type: ignore[return-value]


def judge_of(*said: InstantVerdict | Exception) -> Judge:
    """A judge under rules whose only monitor is scripted."""
    paper = load_rule_set("paper2020.published")
    rules = replace(paper, checks={"separation": paper.checks["separation"]})
    monitor = Scripted(said)
    assert isinstance(monitor, OnlineMonitor)

    class Rules(RuleSet):
        def build(self, _registry: Registry) -> dict[str, Any]:
            return {"separation": monitor}

    return RulesBench(Rules(**vars(rules)), Registry()).judge()


def standing(verdict: Verdict, *, final: bool = False) -> InstantVerdict:
    return InstantVerdict("robot/human", 1.0, verdict, "so it is", final=final)


@pytest.mark.parametrize(
    ("said", "word"),
    [
        (standing(Verdict.SATISFIED), "currently_true"),
        (standing(Verdict.NOT_APPLICABLE), "currently_true"),
        (standing(Verdict.INCONCLUSIVE), "unknown"),
        (standing(Verdict.VIOLATED), "currently_false"),
        (standing(Verdict.VIOLATED, final=True), "false"),
        (standing(Verdict.SATISFIED, final=True), "true"),
    ],
)
def test_standings_become_the_words_of_the_protocol(said: InstantVerdict, word: str) -> None:
    assert judge_of(said).take(snapshot(1.0)).verdict == word


def test_what_is_final_stays_so(tmp_path: Path) -> None:
    judge = judge_of(standing(Verdict.VIOLATED, final=True), standing(Verdict.VIOLATED, final=True))
    judge.take(snapshot(1.0))

    assert judge.take({"topic": "chatter", "time": 99.0}).verdict == "false"


def test_a_monitor_that_raises_is_named_and_the_conversation_goes_on(tmp_path: Path) -> None:
    talk = Conversation(judge_of(KeyError("x"), standing(Verdict.SATISFIED)), tmp_path / "log.jsonl")

    assert verdict(talk, snapshot(1.0)) == "unknown"
    assert verdict(talk, snapshot(1.01)) == "currently_true"

    talk.close("tested")
    assert "iso_ts_15066.ssm_separation" in talk.first_fault
    assert "KeyError" in talk.first_fault


# Specifications --------------------------------------------------------------------------


class Spec:
    """Stands for a monitor that judges events: `data` may never be `bad`."""

    def needs(self) -> Iterator[SignalNeed]:
        return iter(())

    def watch(self, _trial: Trial) -> Iterator[Finding]:
        return iter(())

    def begin_events(self) -> Any:
        def take(event: Mapping[str, object]) -> InstantVerdict:
            assert "verdict" not in event
            if "data" not in event:
                raise ValueError("no data")
            bad = event["data"] == "bad"
            return InstantVerdict(
                "trace", 0.0, Verdict.VIOLATED if bad else Verdict.SATISFIED, "it is bad", final=bad
            )

        return SimpleNamespace(take=take)


def registry_with(monitor: object) -> Any:
    plugin = SimpleNamespace(origin="rml.spec (x 1)", distribution="x", build=lambda _parameters: monitor)
    return SimpleNamespace(find=lambda _group, _name: plugin)


def test_a_specification_judges_events_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "some.rml"
    file.touch()
    bench = SpecBench(file, registry_with(Spec()))
    talk = Conversation(bench.judge(), tmp_path / "log.jsonl")

    assert verdict(talk, {"topic": "x", "data": "good", "verdict": "old"}) == "currently_true"
    assert verdict(talk, {"topic": "x"}) == "unknown"
    assert ask(talk, {"topic": "x", "data": "bad"})["spec"] == "it is bad"
    assert talk.verdicts == {"currently_true": 1, "unknown": 1, "false": 1}
    talk.close("tested")


def test_a_specification_that_cannot_be_judged_is_refused_in_words(tmp_path: Path) -> None:
    file = tmp_path / "some.rml"
    file.touch()

    def find(_group: str, name: str) -> None:
        raise PluginNotFoundError(f"no installed distribution provides {name!r}")

    with pytest.raises(PluginNotFoundError, match="judges specifications"):
        SpecBench(file, SimpleNamespace(find=find))  # type: ignore[arg-type]
    with pytest.raises(RuleSetError, match="cannot judge event by event"):
        SpecBench(file, registry_with(object()))
    with pytest.raises(UsageError, match="no such specification"):
        SpecBench(tmp_path / "other.rml", registry_with(Spec()))
