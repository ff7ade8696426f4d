"""Series as an official program consumes them: in its order, stamps repeated or running back, nothing merged.

The numbers are worked out by hand: an official program that sums left-hand steps while it reads takes
`t[i + 1] - t[i]` for every sample above its threshold, and a step back takes away.
"""

from __future__ import annotations

import json
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import (
    Body,
    LogMap,
    MissingSignalError,
    Series,
    Signal,
    Span,
    Trial,
    Verdict,
    Wanted,
    align,
    score_trial,
)
from ariac_score.errors import LogError
from ariac_score.logs.jsonl import JsonLinesReader
from ariac_score.monitors import state_over
from ariac_score.testing import write_trial_log
from ariac_score.testing.variants import only, reordered, without
from ariac_score.trial.build import TrialBuilder, merge_trials
from ariac_score.trial.clock import Clock
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.shift import shifted
from ariac_score.trial.spans import episodes_where, longest_silence_s, sample_durations, uncovered_spans

T, FORCE = (0.0, 0.5, 0.5, 0.25), (30.0, 10.0, 40.0, 50.0)
ARM = Body("arm", "robot")


def series(name: str = "force/arm", unit: str = "N") -> Series:
    return Series(name, unit, np.array(T), np.array(FORCE))


def trial(*own: Series, **more: Any) -> Trial:
    return Trial(
        "t", bodies=(ARM,), as_consumed={one.name: one for one in own}, recorded=Span(0.0, 1.0), **more
    )


def seconds_above(limit_n: float, force: Series) -> float:
    """As the official program counts: the step after each sample above the limit."""
    return sum(float(force.t[i + 1] - force.t[i]) for i in range(len(force) - 1) if force.values[i] > limit_n)


def log(folder: Path, *samples: tuple[float, float], name: str = "force/arm") -> Path:
    head = {
        "record": "trial",
        "format": "ariac-score-trial-log/1",
        "id": "run",
        "quantities": {"force": {"unit": "N", "of": "body"}},
        "as_consumed": [name],
    }
    records = [head, {"record": "body", "id": "arm", "kind": "robot"}]
    records += [{"record": "sample", "t_s": t_s, "values": {"force/arm": value}} for t_s, value in samples]
    records.append({"record": "end", "records": len(records) + 1})
    path = folder / "run.jsonl"
    path.write_text("".join(f"{json.dumps(one)}\n" for one in records), encoding="utf-8")
    return path


def read(path: Path) -> Trial:
    return JsonLinesReader().read(path, Wanted(LogMap("none"), frozenset({"force"})))


# It stays as it is ----------------------------------------------------------------------------


def test_a_log_gives_a_series_in_the_order_of_its_lines(tmp_path: Path) -> None:
    force = read(log(tmp_path, *zip(T, FORCE, strict=True))).series("force/arm", unit="N")

    assert force.t.tolist() == [*T]
    assert force.values.tolist() == [*FORCE]
    # 30 N stands for 0.5 s, 40 N for -0.25 s; the last sample for nothing.
    assert seconds_above(20.0, force) == 0.25


def test_the_same_lines_without_the_declaration_are_settled_into_a_signal(tmp_path: Path) -> None:
    read_back = read(log(tmp_path, *zip(T, FORCE, strict=True), name="force/other"))

    # 10 N and 40 N at one stamp contradict each other, so neither is kept; the rest is sorted.
    assert not read_back.as_consumed
    assert read_back.signals["force/arm"].t.tolist() == [0.0, 0.25]
    assert {d.kind for d in read_back.log_defects} == {
        "contradicting_stamps",
        "disordered_stamps",
        "repeated_stamps",
    }


def test_a_series_may_run_back_further_than_a_signal_may(tmp_path: Path) -> None:
    samples = ((9.0, 1.0), (2.0, 1.0))

    assert read(log(tmp_path, *samples)).as_consumed["force/arm"].t.tolist() == [9.0, 2.0]
    with pytest.raises(LogError, match="time runs backwards"):
        read(log(tmp_path, *samples, name="force/other"))


def test_a_written_series_comes_back_in_its_order(tmp_path: Path) -> None:
    position = Series("position/arm", "m", np.array(T), np.arange(12.0).reshape(4, 3))
    path = write_trial_log(tmp_path / "t.jsonl", trial(position))
    (back,) = JsonLinesReader().read(path, Wanted(LogMap("x"), frozenset({"position"}))).sampled

    assert isinstance(back, Series)
    assert (back.t.tolist(), back.values.tolist()) == ([*T], position.values.tolist())


def test_a_shift_of_the_clock_moves_its_stamps_and_keeps_their_order() -> None:
    (later,) = shifted(trial(series()), 2.0).sampled

    assert later.t.tolist() == [2.0, 2.5, 2.5, 2.25]
    assert later.values.tolist() == [*FORCE]


def test_merging_and_derivation_leave_it_alone() -> None:
    recorded = trial(series())
    merged = derive_signals(merge_trials("t", [recorded, Trial("b")], file="t"), [Derivation("speed", 1.0)])

    assert dict(merged.as_consumed) == dict(recorded.as_consumed)
    assert not merged.signals


def test_two_logs_with_one_series_contradict_each_other() -> None:
    signal = Signal("force/arm", "N", np.array([0.0]), np.array([1.0]))
    as_signal = Trial("b", signals={"force/arm": signal})

    for other in (trial(series()), as_signal):
        with pytest.raises(LogError, match="two logs record the signal 'force/arm'"):
            merge_trials("t", [trial(series()), other], file="t")
    with pytest.raises(ValueError, match="'force/arm' is given as a signal and as consumed"):
        trial(series(), signals={"force/arm": signal})


def test_its_numbers_are_finite_and_cannot_be_written_to(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="'force/arm': values must be finite") as fault:
        read(log(tmp_path, (0.0, 1.0), (0.5, float("nan"))))
    assert fault.value.hint == "nothing is left out of a series as consumed"
    with pytest.raises(ValueError, match="read-only"):
        series().values[0] = 1.0


def test_one_name_is_recorded_once() -> None:
    builder = TrialBuilder("t", file="t.bag", clock=Clock("log time"))
    builder.add_series("force/arm", "N", np.array(T), np.array(FORCE))

    assert builder.build().recorded == Span(0.0, 0.5)  # not from the first to the last sample
    for add in (builder.add_series, builder.add_signal):
        with pytest.raises(LogError, match="'force/arm' is recorded twice"):
            add("force/arm", "N", np.array(T), np.array(FORCE))


# Whatever needs increasing time refuses it ----------------------------------------------------


def test_it_is_no_signal_and_a_signal_is_no_series() -> None:
    cause = "signal 'force/arm' is there as consumed only: its stamps may repeat and run back"
    signal = Signal("force/arm", "N", np.array([0.0]), np.array([1.0]))

    for ask in (lambda t: t.signal("force/arm", unit="N"), lambda t: t.to_frame("force/arm")):
        with pytest.raises(MissingSignalError, match=cause) as refused:
            ask(trial(series()))
        assert "trial.series('force/arm', unit=...)" in refused.value.hint
    with pytest.raises(MissingSignalError, match=cause):
        trial(series()).find_signal("force/arm")
    with pytest.raises(MissingSignalError, match="'force/arm' is not in the log"):
        trial(signals={"force/arm": signal}).series("force/arm", unit="N")
    with pytest.raises(LogError, match="is in 'N', the check asks for 'kN'"):
        trial(series()).series("force/arm", unit="kN")


def test_signals_are_not_aligned_with_it() -> None:
    own: Any = series()
    with pytest.raises(MissingSignalError, match="'force/arm' is there as consumed only"):
        align([own], max_gap_s=1.0)


def test_functions_of_times_refuse_its_stamps() -> None:
    for t in (np.array([0.0, 0.5, 0.5]), np.array([0.0, 0.5, 0.25])):
        holds = np.ones(3, dtype=bool)
        window = Span(0.0, 1.0)
        for refuse in (
            lambda t=t: sample_durations(t),
            lambda t=t, holds=holds: episodes_where(t, holds),
            lambda t=t, window=window: uncovered_spans(t, window, max_gap_s=1.0),
            lambda t=t, window=window: longest_silence_s(t, window),
        ):
            with pytest.raises(ValueError, match=r"times must increase, and do not at 0\.\d+ s; a series"):
                refuse()
    assert sample_durations(np.array([0.0, 0.5, 0.75])).tolist() == [0.5, 0.25, 0.0]


def test_no_speed_is_derived_from_a_position_as_consumed_nor_in_place_of_a_speed_as_consumed() -> None:
    t = np.array([0.0, 0.1, 0.2])
    moving = Signal("position/arm", "m", t, np.column_stack([t, t, t]))
    position = Series("position/arm", "m", np.array(T), np.zeros((4, 3)))
    wanted = [Derivation("speed", 1.0)]

    assert "speed/arm" in derive_signals(trial(signals={moving.name: moving}), wanted).signals
    recorded = trial(series("speed/arm", "m/s"), signals={moving.name: moving})
    assert "speed/arm" not in derive_signals(recorded, wanted).signals
    unusable = derive_signals(trial(position), wanted)
    with pytest.raises(MissingSignalError, match=r"nothing is derived from .* as consumed: position/arm"):
        unusable.signal("speed/arm", unit="m/s")


def test_the_speed_of_links_alone_is_not_that_of_a_body_whose_origin_is_as_consumed() -> None:
    t = np.array([0.0, 0.1, 0.2])
    hand = Signal("position/arm::hand", "m", t, np.column_stack([t, t, t]))
    linked = replace(trial(signals={hand.name: hand}), bodies=(replace(ARM, links=("hand",)),))
    origin = Series("position/arm", "m", np.array(T), np.zeros((4, 3)))
    wanted = [Derivation("speed", 1.0)]

    assert "speed/arm" in derive_signals(linked, wanted).signals
    known = replace(linked, as_consumed={origin.name: origin})
    assert "speed/arm" not in derive_signals(known, wanted).signals


def test_a_flag_as_consumed_is_not_taken_for_one_that_was_never_on() -> None:
    t = np.array([0.0, 1.0])
    silent = trial(witnessed=frozenset({"brake"}))
    assert state_over(silent, "brake", "arm", t, max_age_s=1.0) is not None

    flagged = trial(series("brake/arm", "1"), witnessed=frozenset({"brake"}))
    with pytest.raises(MissingSignalError, match="'brake/arm' is there as consumed only"):
        state_over(flagged, "brake", "arm", t, max_age_s=1.0)


def test_a_table_of_it_goes_by_number() -> None:
    pytest.importorskip("pandas")
    table = series().to_frame()

    assert table["t_s"].tolist() == [*T]
    assert table.loc[2, "force/arm"] == 40.0
    assert table.attrs["units"] == {"t_s": "s", "force/arm": "N"}


def test_a_trial_without_a_quantity_lacks_its_series_too() -> None:
    both = trial(series(), series("torque/arm", "N m"))

    assert [one.name for one in without(both, {"force"}).sampled] == ["torque/arm"]
    assert [one.name for one in only(both, {"force"}).sampled] == ["force/arm"]
    assert list(reordered(both).as_consumed) == ["torque/arm", "force/arm"]


# Checks --------------------------------------------------------------------------------------

CHECKS = """
from dataclasses import dataclass
from ariac_score import Finding, Measure, SignalNeed, Verdict
from ariac_score.monitors import MarginMonitor, bodies


@dataclass(frozen=True)
class Gentle(MarginMonitor):
    'Presses no harder than 20 N, over time.'

    subjects, what, unit = bodies("robot"), "force", "N"
    wanted = {"force/{robot}": "N"}

    def margin(self, signals):
        return self.at_most(signals["force/{robot}"], 20.0)


class ForceTime:
    'Seconds above 20 N, as the official program counts them.'

    measures = {"above_s": Measure("s", "measure")}

    def needs(self):
        return [SignalNeed("force", "N")]

    def watch(self, trial):
        force = trial.series("force/arm", unit="N")
        steps = [float(force.t[i + 1] - force.t[i]) for i in range(len(force) - 1) if force.values[i] > 20.0]
        yield Finding(
            "arm", Verdict.SATISFIED, "time above 20 N", quantities={"above_s": sum(steps)},
            evidence=(force.sample(3),),
        )
"""

LOG_MAP = """
id: mine
title: Mine
source: this test
quantities: {force: {unit: N, of: body}}
"""

RULES = """
id: pressed
title: Pressed
source: this test
log_map: log_map.yaml
window: recording
monitors:
  gentle: {use: "./checks.py:Gentle"}
  force_time: {use: "./checks.py:ForceTime"}
score: 10 * measure(force_time, above_s)
"""


def test_a_check_reads_it_by_index_and_a_monitor_over_time_is_undecided(tmp_path: Path) -> None:
    (tmp_path / "checks.py").write_text(CHECKS)
    (tmp_path / "rules.yaml").write_text(RULES)
    (tmp_path / "log_map.yaml").write_text(
        "id: mine\ntitle: Mine\nsource: this test\nquantities: {force: {unit: N, of: body}}\n"
    )
    path = log(tmp_path, *zip(T, FORCE, strict=True))
    result = score_trial(path, tmp_path / "rules.yaml", local_plugins=True)

    assert result.score == Decimal("2.5")
    (undecided,) = result.measured.of("gentle").values()
    assert undecided.verdict is Verdict.INCONCLUSIVE
    assert "signal 'force/arm' is there as consumed only" in undecided.message
    # Four samples over half a second; between two stamps, in order of time, a quarter at most, and the
    # recording ends with the last of them.
    (coverage,) = result.measured.coverage
    assert (coverage.samples, coverage.rate_hz, coverage.largest_gap_s) == (4, 6.0, 0.25)
