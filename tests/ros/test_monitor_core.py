"""The monitor node's core, which knows no ROS: what it asks, lets pass, counts and tells the oracle."""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

REPOSITORY = Path(__file__).parents[2]
sys.path.insert(0, str(REPOSITORY / "ros/ariac_score_monitor/src"))

from ariac_score_monitor import core as node_core  # noqa: E402
from ariac_score_monitor.core import Log, Monitor, Queue, event_of  # noqa: E402
from ariac_score_monitor.plan import Plan, PlanError, load_plan  # noqa: E402
from ariac_score_monitor.websocket import LostError  # noqa: E402

from ariac_score.logs.rosmonitoring import UNSEEN  # noqa: E402

PLAN = {"name": "cell", "topics": [{"name": "/x", "type": "std_msgs/String"}], "without_oracle": "open"}


class Link:
    """An oracle that answers what the test says, or nothing."""

    def __init__(self) -> None:
        self.is_there, self.verdict = True, "currently_true"
        self.asked: list[dict[str, Any]] = []

    def ask(self, text: str) -> str:
        if not self.is_there:
            raise LostError("it is gone")
        self.asked.append(json.loads(text))
        return json.dumps({"verdict": self.verdict})


class Cell:
    """A monitor, and what it wrote."""

    def __init__(self, **plan: Any) -> None:
        self.link = Link()
        self.events: list[dict[str, Any]] = []
        self.status: list[dict[str, Any]] = []
        self.monitor = Monitor(
            Plan({**PLAN, **plan}),
            self.link,
            SimpleNamespace(write=self.events.append),
            SimpleNamespace(write=self.status.append),
        )

    def passes(self, time: float) -> bool:
        return bool(self.monitor.take({"topic": "/x", "time": time}, is_filtered=True))


@pytest.mark.parametrize(
    ("verdict", "passes"),
    [
        ("true", True),
        ("currently_true", True),
        ("unknown", True),
        ("currently_false", False),
        ("false", False),
        ("FALSE", False),
    ],
)
def test_a_message_passes_by_its_verdict(verdict: str, passes: bool) -> None:
    cell = Cell()
    cell.link.verdict = verdict

    assert cell.passes(1.0) is passes
    assert cell.monitor.take({"topic": "/x", "time": 2.0}) is True  # only watched
    assert cell.events == cell.link.asked == [{"topic": "/x", "time": 1.0}, {"topic": "/x", "time": 2.0}]


@pytest.mark.parametrize(("declared", "passes"), [("open", True), ("closed", False)])
def test_without_an_oracle_messages_pass_or_not_as_declared(declared: str, passes: bool) -> None:
    cell = Cell(without_oracle=declared)
    cell.link.is_there = False

    assert cell.passes(1.0) is passes
    assert cell.monitor.verdict == "unknown"
    assert cell.monitor.counts == {"answered": 0, "unseen": 1, "blocked": 0 if passes else 1}


@pytest.mark.parametrize(("declared", "passes"), [("open", True), ("closed", False)])
def test_an_unknown_verdict_lets_pass_or_not_as_declared(declared: str, passes: bool) -> None:
    cell = Cell(unknown=declared)
    cell.link.verdict = "unknown"

    assert cell.passes(1.0) is passes


def test_what_the_oracle_did_not_see_is_told_before_anything_else_is_asked() -> None:
    cell = Cell()
    cell.passes(1.0)
    cell.link.is_there = False
    for time in (2.0, 3.0):
        cell.passes(time)
    cell.link.is_there = True
    cell.passes(4.0)
    cell.passes(5.0)

    told = {"topic": UNSEEN, "events": 2, "why": "it is gone", "since": 1.0, "time": 4.0}
    times = [one["time"] for one in cell.link.asked]
    assert cell.link.asked[1] == told
    assert times == [1.0, 4.0, 4.0, 5.0]
    assert [one["time"] for one in cell.events] == [1.0, 2.0, 3.0, 4.0, 5.0]  # its own log has them all
    unseen = [row for row in cell.status if row["status"] == "unseen"]
    assert [(row["events"], row["since"], row["why"]) for row in unseen] == [(2, 1.0, "it is gone")]


def test_an_oracle_that_is_lost_again_before_it_was_told_is_told_later() -> None:
    cell = Cell()
    cell.link.is_there = False
    cell.passes(1.0)
    cell.passes(2.0)
    cell.monitor.close()

    assert cell.status[-1]["status"] == "stopped"
    assert cell.status[-1]["unseen_at_the_end"] == 2


@pytest.mark.parametrize("answer", ["", "yes", "[]", "null", '{"ok": true}', '{"verdict": null}'])
def test_an_answer_without_a_verdict_is_never_taken_for_good(answer: str) -> None:
    cell = Cell(unknown="closed")
    cell.link.ask = lambda _: answer  # type: ignore[method-assign]

    assert cell.passes(1.0) is False


def test_what_does_not_fit_into_the_queue_is_dropped_by_name_in_its_place() -> None:
    cell = Cell()
    passed: list[int] = []
    begun, go_on = threading.Event(), threading.Event()
    ask = cell.link.ask

    def slowly(text: str) -> str:
        begun.set()
        assert go_on.wait(10)
        return ask(text)

    cell.link.ask = slowly  # type: ignore[method-assign]
    queue = Queue(cell.monitor, 1, True, SimpleNamespace(write=cell.events.append))
    events = [{"topic": "/x", "time": float(n)} for n in range(4)]
    taken = [queue.put(events[0], lambda: passed.append(0))]
    assert begun.wait(10)  # the first is being asked about: one more fits
    taken += [queue.put(event, lambda n=n: passed.append(n)) for n, event in enumerate(events[1:], 1)]
    go_on.set()
    queue.end(10)
    cell.passes(4.0)

    assert taken == [True, True, False, False]
    assert sorted(passed) == [0, 1, 2, 3]  # `open` lets pass what nobody was asked about
    assert queue.dropped == 2
    assert [(one["topic"], one["time"]) for one in cell.link.asked] == [
        ("/x", 0.0),
        ("/x", 1.0),
        (UNSEEN, 4.0),
        ("/x", 4.0),
    ]
    assert cell.link.asked[2]["why"] == "more messages came than could be asked about"
    assert [one["time"] for one in cell.events] == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_who_ends_lets_nothing_pass_that_nobody_was_asked_about() -> None:
    cell = Cell()
    passed: list[int] = []
    queue = Queue(cell.monitor, 10, True, SimpleNamespace(write=cell.events.append))
    queue.put({"topic": "/x", "time": 0.0}, lambda: passed.append(0))
    queue.end(10)
    taken = queue.put({"topic": "/x", "time": 1.0}, lambda: passed.append(1))

    assert (taken, passed, queue.dropped) == (False, [0], 0)
    assert [one["time"] for one in cell.link.asked] == [0.0]


def test_what_still_waits_in_the_end_is_written_down_and_counted_and_does_not_pass() -> None:
    cell = Cell()
    passed: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def never(_: str) -> str:
        begun.set()
        assert go_on.wait(10)
        raise LostError("the link was ended")

    cell.link.ask = never  # type: ignore[method-assign]
    queue = Queue(cell.monitor, 2, True, SimpleNamespace(write=cell.events.append))
    for n in range(4):  # one is asked about, two wait, one does not fit
        queue.put({"topic": "/x", "time": float(n)}, lambda n=n: passed.append(n) if n < 3 else None)
        assert begun.wait(10)
    queue.end(0.0)
    go_on.set()
    queue.join(10)
    cell.monitor.close()

    assert passed == []
    assert sorted(one["time"] for one in cell.events) == [0.0, 1.0, 2.0, 3.0]
    assert cell.status[-1] == {**cell.status[-1], "status": "stopped", "unseen": 4, "unseen_at_the_end": 4}


def test_logs_have_a_limit_and_the_oldest_part_is_deleted(tmp_path: Path) -> None:
    file = tmp_path / "cell.jsonl"
    log = Log(str(file), 10, 2)  # a row has 9 bytes with its end
    for n in range(1, 6):
        log.write({"n": n * 10})
    log.close()
    again = Log(str(file), 10, 2)
    again.write({"n": 60})
    again.close()

    assert sorted(one.name for one in tmp_path.iterdir()) == [
        "cell.jsonl",
        "cell.part0004.jsonl",
        "cell.part0005.jsonl",
    ]
    assert file.read_text() == '{"n": 60}\n'
    assert (log.dropped, again.dropped) == (2, 1)


@pytest.mark.parametrize(
    ("fields", "time"),
    [
        ({"header": {"stamp": {"secs": 3, "nsecs": 500000000}}}, 3.5),
        ({"header": {"stamp": {"sec": 3, "nanosec": 500000000}}}, 3.5),
        ({"stamp": {"secs": 4, "nsecs": 0}}, 4.0),
        ({"data": 1}, 1700000000.25),
        ({"header": "none", "stamp": "none"}, 1700000000.25),
    ],
)
def test_an_event_has_the_time_of_its_message_or_the_clocks(fields: dict[str, Any], time: float) -> None:
    assert event_of("/x", fields, 1700000000.25) == {**fields, "topic": "/x", "time": time}


def test_the_oracle_and_the_node_mean_the_same_topic() -> None:
    assert node_core.UNSEEN == UNSEEN


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"without_oracle": None}, "'without_oracle' is missing"),
        ({"without_oracle": "maybe"}, "'without_oracle' is maybe, not 'open' or 'closed'"),
        ({"unknown": "pass"}, "'unknown' is pass"),
        ({"topics": []}, "lists no topic"),
        ({"topics": [{"name": "/x"}]}, "topic 1: 'type' is missing"),
        ({"topics": [{"name": "/x", "type": "a/B", "to": "/x"}]}, "is the topic itself"),
        ({"name": "../x"}, "'name' has letters"),
        ({"oracle": "http://127.0.0.1"}, "is no address such as"),
        ({"oracle": "ws://127.0.0.1:99999"}, "is no address such as"),
        ({"oracle": "ws://127.0.0.1:8080/x"}, "the name of the monitor is added"),
        ({"queue": 0}, "'queue' is 0, not from 1"),
        ({"timeout_s": True}, "'timeout_s' is True"),
        ({"timeuot_s": 1}, "'timeuot_s' is unknown; known: log_bytes"),
        ({"token_file": "nowhere"}, "the token in nowhere cannot be read"),
    ],
)
def test_a_plan_that_cannot_be_followed_is_refused_in_words(change: dict[str, Any], words: str) -> None:
    with pytest.raises(PlanError) as refused:
        Plan({**PLAN, **change})
    assert words in str(refused.value)


def test_a_plan_is_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    file.write_text(json.dumps({**PLAN, "oracle": "ws://[::1]:9000"}))
    plan = load_plan(str(file))

    assert (plan.host, plan.port, plan.name, plan.queue) == ("::1", 9000, "cell", 1000)
    file.write_text("{")
    with pytest.raises(PlanError, match="it is no JSON"):
        load_plan(str(file))
    with pytest.raises(PlanError, match="cannot be read"):
        load_plan(str(tmp_path / "nowhere"))
