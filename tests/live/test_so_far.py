"""What a trial comes to so far, judged stretch by stretch, is what it comes to judged as a whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ariac_score.engine.prepared import prepare
from ariac_score.live import so_far as so_far_module
from ariac_score.live.running import Running
from ariac_score.live.source import source_at
from ariac_score.live.watch import Settings, Watch
from ariac_score.monitors import monitor as monitors
from ariac_score.results.result import Result
from ariac_score.testing import write_bag
from ariac_score.trial.model import Trial
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"

Stated = list[tuple[object, ...]]


def _stated(result: Result) -> Stated:
    return sorted(
        (f.check, f.subject, f.verdict.name, str(f.span), str(f.robustness), f.message)
        for f in result.measured.findings.values()
    )


def _states(log: Path, every: int, record: Path) -> dict[float, Result]:
    """The trial so far after every so many messages, by when that was, s."""
    source = source_at(f"replay:{log}?speed=0")
    taken = [0]

    class Counting:
        address, sees_losses, stamps = "made:", True, source.stamps
        open, close = source.open, source.close

        def next(self, timeout_s: float) -> object:
            taken[0] += 1
            return source.next(timeout_s)

    found: dict[float, Result] = {}

    def told(state: Running) -> None:
        if state.result is not None:
            found[state.judged_until_s] = state.result

    settings = Settings(period_s=every, share=1.0, tail_period_s=1e18, apart=False)
    Watch(
        Counting(),  # type: ignore[arg-type]  # as a source
        prepare("paper2020"),
        record,
        settings=settings,
        told=told,
        now_s=lambda: float(taken[0]),
    ).run()
    return found


def _held_to_the_whole(log: Path, every: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flat = _states(log, every, folder / "flat.mcap")
    monkeypatch.setattr(so_far_module, "_is_monitor", lambda _: False)
    whole = _states(log, every, folder / "whole.mcap")
    assert flat.keys() == whole.keys()
    assert len(flat) > 3
    for at_s, one in flat.items():
        assert _stated(one) == _stated(whole[at_s]), at_s
        assert (one.score, one.interval) == (whole[at_s].score, whole[at_s].interval), at_s


@pytest.mark.slow
def test_judged_by_stretches_it_comes_to_what_the_whole_comes_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _held_to_the_whole(EXAMPLE, 700, tmp_path, monkeypatch)


@pytest.mark.slow
def test_so_it_does_over_four_minutes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    messages = recorded_messages(kitting_trial(duration_s=240.0))
    log = write_bag(tmp_path / "long.mcap", messages, storage="mcap")
    _held_to_the_whole(log, 1500, tmp_path, monkeypatch)


@pytest.mark.slow
def test_motion_that_is_settled_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[int] = []
    judge = so_far_module.SoFar.judge

    def counting(self: so_far_module.SoFar) -> Result:
        result = judge(self)
        kept.append(sum(len(one) for one in self._recent._kept.values()))
        return result

    monkeypatch.setattr(so_far_module.SoFar, "judge", counting)
    _states(EXAMPLE, 700, tmp_path / "seen.mcap")

    # At 100 Hz: what was kept at most is less than half of what came.
    assert max(kept) < 2000


@pytest.mark.slow
def test_no_time_that_is_settled_is_looked_at_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_s: list[float] = []
    real = monitors.watch_subjects

    def watched(trial: Trial, *others: Any, **named: Any) -> Any:
        if trial.window is not None:
            looked_s.append(trial.window.duration_s)
        return real(trial, *others, **named)

    monkeypatch.setattr(monitors, "watch_subjects", watched)
    _states(EXAMPLE, 700, tmp_path / "seen.mcap")

    # Of 40 s. The last looks are at the recording, which ends the trial: each of two monitors looks at the
    # competition as stated, at the shortest and at the longest one, and at the stated one once more.
    so_far_s, whole_s = looked_s[:-8], looked_s[-8:]
    assert min(whole_s) > 35
    assert len(so_far_s) > 4
    assert max(so_far_s) < 20


@pytest.mark.slow
def test_a_process_of_its_own_says_the_same(tmp_path: Path) -> None:
    states: list[Running] = []
    watch = Watch(
        source_at(f"replay:{EXAMPLE}?speed=10"),
        prepare("paper2020"),
        tmp_path / "seen.mcap",
        settings=Settings(period_s=0.1, share=0.9),
        told=states.append,
    )
    final = watch.run().score

    known = [state.interval for state in states if state.interval is not None]
    assert final is not None
    assert known
    assert all(least <= final for least, _ in known)
