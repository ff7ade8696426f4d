"""What nobody saw: said live as it is found afterwards, and never taken for good."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Verdict, load_rule_set
from ariac_score.checks.findings import Finding
from ariac_score.checks.registry import Registry
from ariac_score.logs.rosmonitoring import UNSEEN
from ariac_score.oracle.conversation import Conversation
from ariac_score.oracle.judges import RulesBench
from ariac_score.oracle.results import measured_log, write_results

RULES = load_rule_set("paper2020")
BENCH = RulesBench(RULES, Registry())
LONGEST_S = 0.05
"""Between two samples that the separation distance accepts, by its parameter `max_gap_s`."""


def state(word: str, time: float) -> dict[str, Any]:
    return {"topic": "ariac/competition_state", "data": word, "time": time}


def snapshot(time: float, distance_m: float = 9.0) -> dict[str, Any]:
    fields = {"human_operator_speed": 0.0, "robot_speed": 0.3, "distance_robot_human_operator": distance_m}
    return {"topic": "snapshot", **fields, "time": time}


def ask(talk: Conversation, event: dict[str, Any]) -> str:
    return str(json.loads(talk.answer(json.dumps(event)))["verdict"])


@dataclass(frozen=True)
class Judged:
    """The answers to snapshots, by their times, and what is found of the separation afterwards."""

    live: dict[float, str]
    gaps: int
    afterwards: list[Finding]


def judged(steps: list[tuple[float, float]]) -> Judged:
    """A competition of snapshots, each some time after the one before, at some distance."""
    with TemporaryDirectory() as folder:
        talk = Conversation(BENCH.judge(), Path(folder) / "log.jsonl")
        talk.answer(json.dumps(state("go", 1.0)))
        t_s, live = 1.0, {}
        for step_s, distance_m in steps:
            live[t_s] = ask(talk, snapshot(t_s, distance_m))
            t_s = round(t_s + step_s, 3)
        talk.answer(json.dumps(state("end_game", max(live))))
        talk.close("tested")
        found = measured_log(talk.log, RULES, "", Registry())
    return Judged(live, talk.gaps, [*found.of("separation").values()])


@pytest.mark.slow  # scores a log for each example
@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.01, 0.01, 0.01, 0.02, 0.049, 0.05, 0.051, 0.06, 0.2, 1.5]),
            st.sampled_from([-0.04, 0.0, 0.04]),
        ),
        min_size=2,
        max_size=120,
    ),
    st.sampled_from([6.0, 1.9]),
)
def test_live_and_afterwards_say_the_same_of_every_instant_and_every_hole(
    steps: list[tuple[float, float]], begins_m: float
) -> None:
    distances, now_m = [], begins_m
    for step_s, way_m in steps:
        now_m += way_m
        distances.append((step_s, round(now_m, 3)))

    found = judged(distances)

    holes = [(a, b) for a, b in pairwise(found.live) if b - a > LONGEST_S + 1e-9]
    negative = {t_s for t_s, verdict in found.live.items() if verdict == "currently_false"}
    unknown = {t_s for t_s, verdict in found.live.items() if verdict == "unknown"}
    spans = {v: [f.span for f in found.afterwards if f.verdict is v and f.span] for v in Verdict}
    # What was broken before and after is one violation whatever was in between: only how deep it was is open.
    open_ = {(s.start_s, s.end_s) for s in spans[Verdict.INCONCLUSIVE]}
    assert {(a, b) for a, b in holes if not {a, b} <= negative} <= open_ <= {*holes}
    assert negative == {
        t_s for t_s in found.live if any(s.start_s <= t_s <= s.end_s for s in spans[Verdict.VIOLATED])
    }
    assert unknown == {b for _, b in holes} - negative
    assert found.gaps == len(holes)


def test_eight_holes_are_eight_times_unknown_and_no_score(tmp_path: Path) -> None:
    talk = Conversation(BENCH.judge(), tmp_path / "log.jsonl")
    talk.answer(json.dumps(state("go", 0.0)))
    verdicts = [ask(talk, snapshot(n / 100)) for n in range(1000) if not 100 <= n % 120 < 110]
    talk.answer(json.dumps(state("end_game", 9.99)))
    talk.close("tested")

    assert verdicts.count("unknown") == talk.gaps == 8
    assert set(verdicts) == {"unknown", "currently_true"}
    open_ = [
        f.message
        for f in measured_log(talk.log, RULES, "", Registry()).of("separation").values()
        if f.verdict is Verdict.INCONCLUSIVE
    ]
    assert len(open_) == 8


def test_a_stretch_as_long_as_accepted_is_no_hole_and_a_longer_one_is(tmp_path: Path) -> None:
    talk = Conversation(BENCH.judge(), tmp_path / "log.jsonl")

    answers = [ask(talk, snapshot(t)) for t in (1.0, 1.05, 1.101, 1.111)]

    assert answers == ["currently_true", "currently_true", "unknown", "currently_true"]
    talk.close("tested")


def test_a_violation_behind_a_hole_is_one_all_the_same(tmp_path: Path) -> None:
    talk = Conversation(BENCH.judge(), tmp_path / "log.jsonl")

    assert [ask(talk, snapshot(t, 1.0)) for t in (1.0, 3.0)] == ["currently_false"] * 2
    assert talk.gaps == 1
    talk.close("tested")


# Conversations that are interrupted ------------------------------------------------------


def interrupted(folder: Path) -> Conversation:
    """A conversation whose oracle was killed half way through writing an event."""
    log = folder / "cell.jsonl"
    talk = Conversation(BENCH.judge(), log)
    talk.answer(json.dumps(state("go", 1.0)))
    for n in range(10):
        ask(talk, snapshot(1 + n / 100))
    talk.close("killed")
    with log.open("ab") as stream:
        stream.write(b'{"topic": "snap')
    return Conversation(BENCH.judge(), log)


def test_after_a_crash_the_state_is_that_of_the_log_and_the_hole_is_written_down(tmp_path: Path) -> None:
    talk = interrupted(tmp_path)
    counted = dict(talk.verdicts)

    # Twenty milliseconds are no gap for the monitor, but nobody knows what was sent in them.
    answers = [ask(talk, snapshot(t)) for t in (1.11, 1.12)]
    talk.close("tested")

    assert counted == {"unknown": 1, "currently_true": 10}
    assert answers == ["unknown", "unknown"]  # no collision may have been seen: that stays open
    lines = [json.loads(line) for line in talk.log.read_text().splitlines()]
    assert lines[11] == {
        "topic": UNSEEN,
        "why": "the oracle was started again",
        "since": 1.09,
        "time": 1.11,
    }
    assert lines[12] == snapshot(1.11)
    assert talk.interruptions == 1


def test_a_violation_is_said_after_a_crash_as_before(tmp_path: Path) -> None:
    talk = interrupted(tmp_path)

    assert ask(talk, snapshot(1.11, 1.0)) == "currently_false"
    talk.close("tested")


def test_afterwards_the_log_of_an_interrupted_conversation_has_the_hole(tmp_path: Path) -> None:
    talk = interrupted(tmp_path)
    for n in range(11, 20):
        ask(talk, snapshot(1 + n / 100))
    talk.answer(json.dumps(state("end_game", 1.19)))
    talk.close("tested")

    found = measured_log(talk.log, RULES, "", Registry())

    spans = [f.span for f in found.of("separation").values() if f.verdict is Verdict.INCONCLUSIVE]
    assert [(span.start_s, span.end_s) for span in spans if span] == [(1.09, 1.11)]
    (silent,) = found.of("no_arm_collision").values()
    assert silent.verdict is Verdict.INCONCLUSIVE  # one may have happened where nobody looked


def test_what_a_node_says_it_did_not_see_is_unknown_at_once_and_written_once(tmp_path: Path) -> None:
    talk = interrupted(tmp_path)
    said = {"topic": UNSEEN, "since": 1.09, "time": 3.0, "events": 190, "why": "no oracle"}

    assert ask(talk, said) == "unknown"
    assert ask(talk, snapshot(3.0)) == "unknown"
    talk.close("tested")

    lines = [json.loads(line) for line in talk.log.read_text().splitlines()]
    assert lines[11:] == [said, snapshot(3.0)]
    assert talk.interruptions == 1


def test_a_log_that_has_a_hole_without_times_is_open_throughout(tmp_path: Path) -> None:
    talk = Conversation(BENCH.judge(), tmp_path / "log.jsonl")
    for n in range(10):
        ask(talk, snapshot(1 + n / 100))
    talk.answer(json.dumps({"topic": UNSEEN, "why": "nobody knows"}))
    talk.close("tested")

    found = measured_log(talk.log, RULES, "", Registry()).of("separation").values()

    assert Verdict.SATISFIED not in {f.verdict for f in found}


def test_a_log_in_parts_is_not_scored_but_named(tmp_path: Path) -> None:
    talk = Conversation(BENCH.judge(), tmp_path / "cell.jsonl", largest_log_bytes=300, log_parts=1)
    for n in range(10):
        ask(talk, snapshot(1 + n / 100))
    talk.close("tested")

    (report,) = write_results(tmp_path, [talk], judged_by="paper2020", rule_set=RULES)

    (connection,) = json.loads(report.read_text())["connections"]
    assert connection["log_parts"] == [talk.kept.parts[0].name]
    assert connection["dropped_parts"] > 0
    assert connection["not_scored"] == "its beginning was deleted: the log grew beyond its limits"
