"""What is watched is recorded, and its result is that of the recording; what is lost is unknown."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from ariac_score import as_json, open_trial, score_trial
from ariac_score.checks.findings import Verdict
from ariac_score.cli import main
from ariac_score.cli.watch import stopped_by_signals
from ariac_score.engine.ask import margins_of
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LiveError, NothingToScoreError, ScoreError
from ariac_score.live.replay import source_items
from ariac_score.live.running import Running, status_text
from ariac_score.live.source import (
    Announced,
    Disconnected,
    Ended,
    LiveItem,
    Lost,
    Received,
    Reconnected,
)
from ariac_score.live.watch import Settings, Watch
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.monitors import monitor as monitor_module
from ariac_score.results.result import Result
from ariac_score.testing import write_bag
from ariac_score.trial.chart import Chart
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
RARELY = Settings(period_s=1e9, tail_period_s=1e9, apart=False)
"""Judged at the first message and at the end."""


class Made:
    """A source that gives what it is told to."""

    address, sees_losses = "made:", True
    stamps: Literal["arrival", "recorder"] = "arrival"

    def __init__(self, items: Iterator[LiveItem | None]) -> None:
        self._items = items
        self.closed = False

    def open(self, topics: frozenset[str] | None) -> None:
        assert topics

    def next(self, timeout_s: float) -> LiveItem | None:
        assert timeout_s > 0
        return next(self._items, Ended("it is over"))

    def close(self) -> None:
        self.closed = True


def _items() -> list[LiveItem]:
    return list(source_items(open_scan(EXAMPLE, jobs=1)))


def _unnumbered(items: list[LiveItem]) -> Iterator[LiveItem]:
    for item in items:
        yield Received(item.message._replace(sequence=0)) if isinstance(item, Received) else item


def _watch(
    items: Iterator[LiveItem | None], record: Path, told: Callable[[Running], None] = lambda _: None
) -> tuple[Result, Watch]:
    source = Made(items)
    watch = Watch(source, prepare("paper2020.published"), record, settings=RARELY, told=told)
    result = watch.run()
    assert source.closed
    return result, watch


@pytest.mark.slow
def test_the_result_is_that_of_the_recording_to_the_byte(tmp_path: Path) -> None:
    watched, _ = _watch(_unnumbered(_items()), tmp_path / "seen.mcap")

    assert as_json(watched) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020.published"))
    assert watched.score == score_trial(EXAMPLE, "paper2020.published").score


def test_a_loss_that_the_source_sees_is_unknown_in_the_recording_too(tmp_path: Path) -> None:
    items = _items()
    messages = [i for i, item in enumerate(items) if isinstance(item, Received)]
    first, behind = messages[len(messages) // 2], messages[len(messages) // 2 + 5]
    before, after = items[first - 1], items[behind]
    assert isinstance(before, Received)
    assert isinstance(after, Received)
    lost = Lost("/snapshot", before.message.stamp_ns, after.message.stamp_ns, "a full queue dropped them", 5)

    watched, watch = _watch(_unnumbered([*items[:first], lost, *items[behind:]]), tmp_path / "seen.mcap")

    assert "5 messages of /snapshot were lost: a full queue dropped them" in [
        n.text for n in watch.state.notes
    ]
    (defect,) = (d for d in watched.measured.log_defects if d.kind == "missing_messages")
    assert (defect.where, defect.count) == ("/snapshot", 5)
    assert any(f.verdict is Verdict.INCONCLUSIVE for f in watched.measured.findings.values())
    assert as_json(watched) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020.published"))


def test_a_source_that_was_gone_leaves_a_gap(tmp_path: Path) -> None:
    items = _items()
    cut = len(items) // 2
    last = items[cut - 1]
    assert isinstance(last, Received)
    since_ns = last.message.stamp_ns
    until_ns = since_ns + 10 * 10**9
    gone: list[LiveItem] = [Disconnected(since_ns, "connection reset"), Reconnected(since_ns, until_ns)]
    rest = [i for i in items[cut:] if isinstance(i, Received) and i.message.stamp_ns >= until_ns]
    announced = {r.message.connection: Connection(**vars(r.message.connection)) for r in rest}
    again = [r._replace(message=r.message._replace(connection=announced[r.message.connection])) for r in rest]
    states: list[Running] = []

    watched, watch = _watch(
        _unnumbered([*items[:cut], *gone, *map(Announced, announced.values()), *again]),
        tmp_path / "seen.mcap",
        states.append,
    )

    assert {s.connected for s in states} == {True, False}
    assert [n.kind for n in watch.state.notes][:2] == ["disconnected", "reconnected"]
    assert "nothing is known of 10.0 s" in watch.state.notes[1].text
    assert watched.is_open or any(
        f.verdict is Verdict.INCONCLUSIVE for f in watched.measured.findings.values()
    )
    assert as_json(watched) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020.published"))


@pytest.mark.slow
def test_a_source_that_is_gone_for_too_long_ends_the_trial(tmp_path: Path) -> None:
    def items() -> Iterator[LiveItem | None]:
        yield from _items()
        yield Disconnected(0, "connection reset")
        while True:
            yield None

    watch = Watch(
        Made(items()),
        prepare("paper2020.published"),
        tmp_path / "seen.mcap",
        settings=Settings(patience_s=0.0, period_s=1e9, apart=False),
    )

    assert watch.run().score is not None
    assert "gone for 0 s" in watch.state.ended


def test_what_changes_under_way_is_said(tmp_path: Path) -> None:
    items = _items()
    (first, *_) = (i.message for i in items if isinstance(i, Received))
    other = Connection(first.connection.topic, "std_msgs/msg/String", "cdr")
    unknown = Connection("/cell/extra", "ours/msg/Unknown", "cdr")
    huge = Message(unknown, first.stamp_ns, bytes(20_000_000), 1)
    extra = [
        Announced(other),
        Announced(unknown),
        Received(huge._replace(stamp_ns=first.stamp_ns - 2 * 10**9)),
    ]

    watched, watch = _watch(iter([*items, *extra]), tmp_path / "seen.mcap")

    texts = [note.text for note in watch.state.notes]
    assert any("is now std_msgs/msg/String" in text for text in texts)
    assert any("go back by" in text and "/cell/extra" in text for text in texts)
    assert as_json(watched) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020.published"))


def test_the_running_score_holds_the_final_one(tmp_path: Path) -> None:
    states: list[Running] = []
    taken = [0]

    def counted() -> Iterator[LiveItem]:
        for item in _items():
            taken[0] += 1
            yield item

    watch = Watch(
        Made(counted()),
        prepare("paper2020.published"),
        tmp_path / "seen.mcap",
        settings=Settings(period_s=600.0, share=1.0, tail_period_s=150.0, tail_share=1.0, apart=False),
        told=states.append,
        now_s=lambda: float(taken[0]),
    )

    final = watch.run().score

    known = [s for s in states if s.interval is not None]
    assert final is not None
    assert known
    # More orders may follow those that are known, so only the worst end is sure before the last.
    assert all(s.interval is not None and s.interval[0] <= final for s in known)
    assert known[-1].worst_margin is not None
    assert "score" in status_text(known[-1])
    # At each moment from the last second alone: what the monitor says of the whole recording there.
    charts = {c.subject: c for c in _margins_of_all(tmp_path / "seen.mcap")}
    told = [(one, charts[one.subject]) for s in states for one in s.now if one.check == "separation"]
    assert len(told) > 5
    for one, chart in told:
        assert one.margin == pytest.approx(float(np.interp(one.at_s, chart.t, chart.margin)), abs=1e-6)


@pytest.mark.slow
def test_what_comes_all_at_once_has_its_margins_all_the_same(tmp_path: Path) -> None:
    """As a chunk of a recording that grows: no time passes while all of it is taken in."""
    states: list[Running] = []
    settings = Settings(period_s=1e9, tail_period_s=0.001, tail_share=1.0, least_tail_share=1.0, apart=False)
    watch = Watch(
        Made(iter(_items())),
        prepare("paper2020.published"),
        tmp_path / "seen.mcap",
        settings=settings,
        told=states.append,
        now_s=lambda: 0.0,
    )
    watch.run()

    shown = sorted({one.at_s for state in states for one in state.now if one.check == "separation"})
    # The competition ends at 38 s, and with it what is asked of anybody.
    assert (shown[0], shown[-1]) == (pytest.approx(0.0, abs=0.2), pytest.approx(38.0, abs=0.2))
    assert max(np.diff(shown)) < 0.15
    assert len(shown) < 500  # of 4000 samples


def _margins_of_all(recording: Path) -> list[Chart]:
    prepared = prepare("paper2020.published")
    each = prepared.checks["separation"]
    return margins_of(each.plugin, "separation", each.check, open_trial(recording, "paper2020.published"))


@pytest.mark.slow
def test_the_margins_of_the_moment_are_looked_at_without_what_may_have_been_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They come from the last moments alone: to work out what may have been before takes ever longer."""
    worked_out: list[object] = []
    real = monitor_module.open_worlds

    def open_worlds(*given: Any) -> Any:
        worked_out.append(given)
        return real(*given)

    monkeypatch.setattr(monitor_module, "open_worlds", open_worlds)
    calls, looks = [], 0
    for name, period_s in (("often", 0.0), ("never", 1e9)):
        settings = Settings(period_s=1e9, tail_period_s=period_s, tail_share=1.0, apart=False)
        shown: list[Running] = []
        source, record = Made(iter(_items()[:400])), tmp_path / f"{name}.mcap"
        clock = iter(range(10**9))
        rules = prepare("paper2020.published")
        watch = Watch(
            source, rules, record, settings=settings, told=shown.append, now_s=lambda c=clock: float(next(c))
        )
        watch.run()
        looks = looks or sum(bool(state.now) for state in shown)
        calls.append(len(worked_out))
        worked_out.clear()

    assert looks > 100
    assert calls[0] == calls[1] > 0


def test_where_one_topic_alone_has_sent_something_the_margin_is_there_and_why_there_is_no_score_yet(
    tmp_path: Path,
) -> None:
    """A file in which one topic alone has messages may have been sorted; what comes live was not."""
    items = [
        item
        for item in _items()
        if isinstance(item, Announced)
        or (isinstance(item, Received) and item.message.connection.topic == "/snapshot")
    ]
    states: list[Running] = []
    clock = iter(range(10**9))
    watch = Watch(
        Made(iter(items[:900])),
        prepare("paper2020.published"),
        tmp_path / "seen.mcap",
        settings=Settings(period_s=300.0, share=1.0, tail_period_s=100.0, tail_share=1.0, apart=False),
        told=states.append,
        now_s=lambda: float(next(clock)),
    )
    with suppress(ScoreError):
        watch.run()

    assert any(one.check == "separation" for state in states for one in state.now)
    assert {state.open for state in states[1:]} <= {
        "no message yet",
        "less than a second was seen",
        "no order was found",
    }


def test_a_clock_that_was_set_back_far_leaves_the_score_to_the_end_and_says_so(tmp_path: Path) -> None:
    items = [item for item in _items() if not isinstance(item, Ended)]
    back = [
        Received(item.message._replace(stamp_ns=item.message.stamp_ns - 60 * 10**9), item.sent_ns)
        if isinstance(item, Received) and number > 700
        else item
        for number, item in enumerate(items[:1400])
    ]
    states: list[Running] = []
    clock = iter(range(10**9))
    watch = Watch(
        Made(iter(back)),
        prepare("paper2020.published"),
        tmp_path / "seen.mcap",
        settings=Settings(period_s=300.0, share=1.0, tail_period_s=1e9, apart=False),
        told=states.append,
        now_s=lambda: float(next(clock)),
    )
    with suppress(ScoreError):
        watch.run()

    assert states[-2].open == "times of recording run back by 60.0 s, so it is scored when it ends"
    assert any(note.kind == "clock" and "go back by 60.0 s" in note.text for note in states[-2].notes)


def test_nothing_came(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="no message"):
        _watch(iter(()), tmp_path / "seen.mcap")


def test_a_recording_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "seen.mcap").write_bytes(b"")

    with pytest.raises(LiveError, match="is there already"):
        _watch(iter(()), tmp_path / "seen.mcap")


@pytest.mark.slow
def test_the_command_says_what_score_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seen, watched, scored = tmp_path / "seen.mcap", tmp_path / "watched.json", tmp_path / "scored.json"
    rules = ["--rules", "paper2020.published"]

    assert (
        main(["watch", f"replay:{EXAMPLE}?speed=0", *rules, "--record", str(seen), "-o", str(watched)]) == 0
    )
    assert "ended: the recording is over" in capsys.readouterr().err
    assert main(["score", str(seen), *rules, "-o", str(scored)]) == 0
    assert watched.read_bytes() == scored.read_bytes()
    assert main(["watch", "nowhere://cell", *rules]) == 4


def test_a_ctrl_c_after_the_end_does_not_lose_the_result_and_a_second_one_ends_the_program() -> None:
    watch = Watch(Made(iter(())), prepare("paper2020.published"), Path("never-written.mcap"))
    watch.stop("the recording is over")

    with stopped_by_signals(watch):
        signal.raise_signal(signal.SIGINT)
        assert watch.stopped
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.slow
def test_who_came_after_the_order_is_told_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bridge keeps nothing for who comes late; the error is about the cell, not about a file of ours."""
    late = tmp_path / "late.mcap"
    orderless = [m for m in recorded_messages(kitting_trial()) if m.topic != "/ariac/orders"]
    write_bag(late, orderless, storage="mcap")

    code = main(["watch", f"replay:{late}?speed=0", "--rules", "paper2020"])

    said = capsys.readouterr().err
    assert code == 5
    assert f"error: replay:{late}?speed=0: no order was found" in said
    assert "give the trial configuration (--trial-config)" in said
