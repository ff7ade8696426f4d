"""Logs that are cut off, scored as far as they go where that is asked for (`partial`).

The law: cut a log anywhere, and the interval contains the score of the whole log, or it is refused by name.
"""

from __future__ import annotations

import bz2
import math
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

import lz4.frame
import pytest
from backports import zstd

from ariac_score import (
    ARM_COLLISION,
    COMPETITION_STARTED,
    Event,
    LogError,
    Result,
    Trial,
    Verdict,
    load_result,
    score_trial,
)
from ariac_score.errors import CutOffError
from ariac_score.report.text import score_text
from ariac_score.results.result_file import as_json
from ariac_score.testing import SNAPSHOT_SIGNALS, write_bag, write_event_log, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages
from ariac_score_ariac.work import orders_of

Ends = tuple[Decimal, Decimal]
FORMATS = ("trial.jsonl", "trial.mcap", "trial.bag", "trial.db3")


def configuration(trial: Trial) -> str:
    """The trial configuration of 2020 that asks for the orders of a trial."""
    lines = ["options: {}", "orders:"]
    for order in orders_of(trial):
        (task,) = order.tasks
        lines += [
            f"  {order.id}:",
            "    announcement_condition: time",
            "    announcement_condition_value: 0.0",
        ]
        lines += [f"    priority: {order.priority}", f"    destinations: [{task.agv}]", "    products:"]
        for wanted in task.products:
            assert wanted.pose is not None
            w, _, _, z = wanted.pose.orientation_wxyz
            yaw_rad = 2 * math.atan2(z, w)
            lines += [f"      {wanted.slot}:", f"        type: {wanted.type}", "        pose:"]
            lines += [f"          xyz: {list(wanted.pose.position_m)}", f"          rpy: [0, 0, {yaw_rad!r}]"]
    return "\n".join(lines) + "\n"


def write_log(path: Path, trial: Trial) -> Path:
    if path.suffix == ".jsonl":
        signals = [name for name in SNAPSHOT_SIGNALS if name in trial.signals]
        write_trial_log(path, trial, signals=signals)
        return path
    storage = {".mcap": "mcap", ".bag": "ros1", ".db3": "sqlite3"}[path.suffix]
    return write_bag(path, recorded_messages(trial), storage=storage)


def ends(result: Result) -> Ends | None:
    """Between which scores a trial lies; `None` where nothing is said to bound it."""
    if result.interval is not None:
        return result.interval.least, result.interval.most
    return None if result.score is None else (result.score, result.score)


@dataclass(frozen=True)
class Whole:
    """A whole log, its configuration, and between which scores it lies."""

    log: Path
    config: Path
    ends: Ends

    def cut(self, share: float, into: Path) -> Path:
        file = into / self.log.name
        data = self.log.read_bytes()
        file.write_bytes(data[: int(len(data) * share)])
        return file

    def scored(self, log: Path) -> Result:
        return score_trial(log, "paper2020.published", partial=True, also=[self.config], root=log.parent)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Whole]:
    known: dict[str, Whole] = {}

    def made(name: str) -> Whole:
        if name not in known:
            folder, trial = tmp_path_factory.mktemp("whole"), kitting_trial()
            config = folder / "trial.yaml"
            config.write_text(configuration(trial))
            log = write_log(folder / name, trial)
            found = ends(score_trial(log, "paper2020.published", also=[config], root=folder))
            assert found is not None
            known[name] = Whole(log, config, found)
        return known[name]

    return made


@pytest.fixture(scope="module")
def cut_in_the_middle(whole: Callable[[str], Whole], tmp_path_factory: pytest.TempPathFactory) -> Result:
    log = whole("trial.jsonl")
    return log.scored(log.cut(0.5, tmp_path_factory.mktemp("cut")))


def contains(found: Ends | None, honest: Ends) -> bool:
    return found is not None and found[0] <= honest[0] <= honest[1] <= found[1]


def test_a_log_that_is_cut_off_is_refused_and_the_hint_names_the_option(
    whole: Callable[[str], Whole], tmp_path: Path
) -> None:
    with pytest.raises(CutOffError) as refused:
        score_trial(whole("trial.jsonl").cut(0.5, tmp_path), "paper2020.published")

    assert "--partial" in refused.value.hint
    assert refused.value.exit_code == 6


def test_its_interval_contains_the_score_of_the_whole_log(
    cut_in_the_middle: Result, whole: Callable[[str], Whole]
) -> None:
    honest = whole("trial.jsonl").ends
    found = ends(cut_in_the_middle)

    assert contains(found, honest)
    assert found != honest
    assert cut_in_the_middle.status == "scored"


def test_the_result_says_that_it_is_unofficial_also_when_it_is_read_again(
    cut_in_the_middle: Result, tmp_path: Path
) -> None:
    (tmp_path / "result.json").write_text(as_json(cut_in_the_middle))
    again = load_result(tmp_path / "result.json")

    assert again.measured.unofficial == cut_in_the_middle.measured.unofficial
    (why,) = again.measured.unofficial
    assert why.startswith("trial.jsonl is cut off, and scored up to ")
    assert again.interval == cut_in_the_middle.interval


def test_what_was_handed_in_before_the_cut_is_decided_and_the_rest_is_open(cut_in_the_middle: Result) -> None:
    # Half of the log is some 20 s; the first kit was handed in at 14 s, the second at 31 s.
    undecided = {
        finding.subject.split("/")[0]
        for finding in cut_in_the_middle.measured.of("part_type").values()
        if finding.verdict is Verdict.INCONCLUSIVE
    }

    assert undecided == {"order_1"}


def test_a_log_that_is_cut_off_behind_the_end_of_the_competition_lacks_nothing(
    whole: Callable[[str], Whole], tmp_path: Path
) -> None:
    log = whole("trial.mcap")  # the competition ends at 38 s of 40 s, and an index follows
    result = log.scored(log.cut(0.85, tmp_path))

    assert ends(result) == log.ends
    assert result.interval is None
    (why,) = result.measured.unofficial
    assert why.endswith("after the end of the competition")


def test_without_a_configuration_nothing_says_what_else_was_asked_for(
    whole: Callable[[str], Whole], tmp_path: Path
) -> None:
    result = score_trial(whole("trial.jsonl").cut(0.15, tmp_path), "paper2020.published", partial=True)

    assert (result.status, result.score, result.interval) == ("incomplete", None, None)
    assert "what was asked for is known from the log alone" in result.missing
    assert "--trial-config" in result.missing


def test_a_log_of_which_less_than_a_second_is_left_is_refused(
    whole: Callable[[str], Whole], tmp_path: Path
) -> None:
    with pytest.raises(LogError, match="too little of it can be read"):
        score_trial(whole("trial.jsonl").cut(0.02, tmp_path), "paper2020.published", partial=True)


def test_a_log_that_is_sorted_by_topic_is_refused_for_nobody_knows_when_what_is_lost_was(
    tmp_path: Path,
) -> None:
    messages = sorted(recorded_messages(kitting_trial()), key=lambda message: message.topic, reverse=True)
    log = write_bag(tmp_path / "trial.mcap", messages, storage="mcap")
    data = log.read_bytes()
    log.write_bytes(data[: int(len(data) * 0.8)])

    with pytest.raises(LogError, match="does not stand in order of time"):
        score_trial(log, "paper2020.published", partial=True)


def _split(folder: Path, trial: Trial) -> Iterator[Path]:
    """The storage files of a recording that was split, without the metadata that its recorder never wrote."""
    messages = recorded_messages(trial)
    third = len(messages) // 3
    for number in range(3):
        part = messages[number * third : (number + 1) * third]
        bag = write_bag(folder.with_name(f"part{number}.mcap"), part, storage="mcap")
        yield bag.rename(folder / f"run_{number}.mcap")


def test_a_folder_that_a_killed_recorder_left_without_metadata_is_read_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    trial = kitting_trial()
    files = list(_split(folder, trial))
    (tmp_path / "trial.yaml").write_text(configuration(trial))
    files[-1].write_bytes(files[-1].read_bytes()[:-3000])

    with pytest.raises(CutOffError, match=r"no metadata.yaml: its recorder was killed"):
        score_trial(folder, "paper2020.published")
    result = score_trial(
        folder, "paper2020.published", partial=True, also=[tmp_path / "trial.yaml"], root=tmp_path
    )

    assert result.measured.cut is not None
    assert result.measured.cut.until_s == pytest.approx(39.0, abs=0.5)


@pytest.mark.parametrize("suffix", [".zstd", ".zst"])
def test_a_compressed_file_without_its_folder_is_read_and_in_part_where_that_is_asked_for(
    tmp_path: Path, suffix: str
) -> None:
    plain = write_log(tmp_path / "run.mcap", kitting_trial())
    packed = tmp_path / f"run.mcap{suffix}"
    packed.write_bytes(zstd.compress(plain.read_bytes()))
    cut = tmp_path / f"cut.mcap{suffix}"
    cut.write_bytes(packed.read_bytes()[: -packed.stat().st_size // 4])

    whole, named = (score_trial(path, "paper2020") for path in (packed, plain))
    part = score_trial(cut, "paper2020", partial=True)

    assert (whole.score, whole.measured.trial) == (named.score, "run")
    assert part.measured.cut is not None
    with pytest.raises(CutOffError, match=r"zstd data ends early.*cut.mcap"):
        score_trial(cut, "paper2020")


def test_changes_that_a_killed_recorder_left_beside_a_database_are_settled_in_a_copy(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.db3", kitting_trial())
    base = sqlite3.connect(whole)
    base.execute("PRAGMA journal_mode=WAL")
    base.execute("PRAGMA wal_autocheckpoint=0")
    base.execute("DELETE FROM messages WHERE timestamp > (SELECT min(timestamp) + 25e9 FROM messages)")
    base.commit()  # into the journal alone, which closing the database would settle
    for suffix in ("", "-wal"):
        shutil.copy(f"{whole}{suffix}", tmp_path / f"trial.db3{suffix}")
    base.close()
    (tmp_path / "trial.yaml").write_text(configuration(kitting_trial()))
    before = {file.name: file.read_bytes() for file in tmp_path.glob("trial.db3*")}

    with pytest.raises(CutOffError, match=r"trial\.db3-wal holds changes"):
        score_trial(tmp_path / "trial.db3", "paper2020.published")
    given = [tmp_path / "trial.yaml"]
    result = score_trial(
        tmp_path / "trial.db3", "paper2020.published", partial=True, also=given, root=tmp_path
    )

    assert result.measured.cut is not None
    assert result.measured.cut.until_s == pytest.approx(24.0, abs=0.02)
    assert {file.name: file.read_bytes() for file in tmp_path.glob("trial.db3*")} == before


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_the_chunk_that_a_killed_recorder_was_writing_is_read_as_far_as_it_inflates(
    compression: str, tmp_path: Path
) -> None:
    log = write_log(tmp_path / "trial.bag", kitting_trial())
    data = log.read_bytes()

    def after(at: int) -> int:  # bytes that follow their length
        return at + 4 + int.from_bytes(data[at : at + 4], "little")

    chunk = after(after(len(b"#ROSBAG V2.0\n")))  # behind header and padding of the record of the bag
    records = data[after(chunk) + 4 : after(after(chunk))]
    fields = (b"compression=" + compression.encode(), b"op=\x05", b"size=\0\0\0\0")
    head = b"".join(len(field).to_bytes(4, "little") + field for field in fields)
    compress = {
        "lz4": lambda raw: lz4.frame.compress(raw, block_size=lz4.frame.BLOCKSIZE_MAX64KB),
        "bz2": lambda raw: bz2.compress(raw, 1),
    }[compression]
    packed = compress(records)
    lengths = len(head).to_bytes(4, "little"), bytes(4)  # that of the records it writes when it is done
    log.write_bytes(data[:chunk] + lengths[0] + head + lengths[1] + packed[: -len(packed) // 9])

    with pytest.raises(CutOffError, match="its recorder was killed while it wrote this chunk"):
        score_trial(log, "paper2020.published")
    result = score_trial(log, "paper2020.published", partial=True)

    assert result.measured.cut is not None
    assert 5.0 < (result.measured.cut.until_s or 0.0) < 39.0


def test_where_a_log_prints_no_verdict_none_was_lost(tmp_path: Path) -> None:
    trial = kitting_trial()
    log = write_log(tmp_path / "trial.jsonl", trial)
    (tmp_path / "trial.yaml").write_text(configuration(trial))
    data = log.read_bytes()
    log.write_bytes(data[: len(data) // 2])
    given = [tmp_path / "trial.yaml"]
    result = score_trial(log, "ariac2020.as_coded", partial=True, also=given, root=tmp_path)

    assert result.measured.cut is not None
    assert result.measured.cut.official


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_wherever_a_log_is_cut_its_interval_contains_the_score_or_it_is_refused(
    name: str, whole: Callable[[str], Whole], tmp_path: Path, subtests: pytest.Subtests
) -> None:
    log, scored = whole(name), 0
    for number in range(1, 14):
        with subtests.test(f"cut at {number} of 14"):
            try:
                result = log.scored(log.cut(number / 14, tmp_path))
            except LogError:  # too little, or no message at all
                continue
            found = ends(result)
            scored += found is not None
            assert found is None or contains(found, log.ends)
            assert found is not None or result.missing
    assert scored >= 11  # the law would hold if all were refused


@pytest.mark.parametrize("share", [0.4, 0.9])
def test_where_the_start_is_not_stated_a_collision_before_all_work_may_have_been_before_it(
    share: float, tmp_path: Path
) -> None:
    """Orders come from 1 s on. Of a competition that started at 0.8 s it is no collision."""
    trial = kitting_trial()
    others = [one for one in trial.events if one.kind != COMPETITION_STARTED]
    collided, config = Event(0.4, ARM_COLLISION), tmp_path / "trial.yaml"
    config.write_text(configuration(trial))
    truth, nowhere = (
        write_log(tmp_path / name, replace(trial, events=tuple(sorted([*others, collided, *started]))))
        for name, started in (("truth.jsonl", [Event(0.8, COMPETITION_STARTED)]), ("trial.jsonl", []))
    )
    honest = ends(score_trial(truth, "paper2020.published", also=[config], root=tmp_path))
    assert honest is not None
    assert honest[0] > 0
    whole = Whole(nowhere, config, honest)
    (tmp_path / "cut").mkdir()

    for log in (nowhere, whole.cut(share, tmp_path / "cut")):
        assert contains(ends(whole.scored(log)), honest)


REAL = Path(__file__).parents[2].parent / "shared" / "real"


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason=f"the real recordings are not at {REAL}")
def test_a_real_recording_that_was_cut_off_contains_what_the_whole_one_has(tmp_path: Path) -> None:
    (tmp_path / "trial.yaml").write_text(
        "options: {}\norders:\n  order_0:\n    announcement_condition: time\n"
        "    announcement_condition_value: 0.0\n    priority: 1\n    destinations: [agv1]\n    products:\n"
        "      part_0: {type: gear_part_red, pose: {xyz: [0.1, 0.1, 0], rpy: [0, 0, 0]}}\n"
        "      part_1: {type: piston_rod_part_blue, pose: {xyz: [-0.1, 0.1, 0], rpy: [0, 0, 0]}}\n"
    )
    config = tmp_path / "trial.yaml"
    shutil.copy(REAL / "walk_killed.bag", tmp_path)
    cut = score_trial(
        tmp_path / "walk_killed.bag", "paper2020.published", partial=True, also=[config], root=tmp_path
    )
    honest = ends(
        score_trial(REAL / "walk_jitter.bag", "paper2020.published")
    )  # of which the other is the beginning

    assert honest is not None
    assert contains(ends(cut), honest)
    assert cut.status == "scored"


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason=f"the real recordings are not at {REAL}")
def test_without_a_score_all_that_lacks_is_listed() -> None:
    """Nobody says what was asked for, so there is none; gaps, cut and submissions lack all the same."""
    text = score_text(score_trial(REAL / "walk_killed.bag", "paper2020", partial=True))

    _, _, said = text.partition("What would narrow it\n")
    lines = said.partition("\n\n")[0].splitlines()
    assert text.startswith("no score — withheld")
    for lack in ("gaps of 15 to 97 ms on /snapshot", "the log is cut off at", "does not show submissions"):
        assert any(lack in line for line in lines), lack
    assert len(lines) == len(set(lines))


@pytest.mark.slow
def test_an_event_log_of_another_monitor_that_was_killed_is_scored_as_far_as_it_goes(tmp_path: Path) -> None:
    honest = ends(
        score_trial(
            write_event_log(tmp_path / "whole.txt", recorded_messages(kitting_trial())), "paper2020.published"
        )
    )
    log = tmp_path / "trial.txt"
    log.write_bytes((tmp_path / "whole.txt").read_bytes()[:340_000])
    (tmp_path / "trial.yaml").write_text(configuration(kitting_trial()))

    with pytest.raises(CutOffError):
        score_trial(log, "paper2020.published")
    result = score_trial(
        log, "paper2020.published", partial=True, also=[tmp_path / "trial.yaml"], root=tmp_path
    )

    assert honest is not None
    assert contains(ends(result), honest)
    assert result.measured.unofficial


GAZEBO = Path(__file__).parents[2].parent / "shared/bags/gazebo/ariac2022_kitting_state.log"


@pytest.mark.slow
@pytest.mark.skipif(not GAZEBO.is_file(), reason=f"the real state.log of 2022 is not at {GAZEBO}")
def test_a_state_log_of_a_killed_simulator_ends_a_second_before_its_last_frame(tmp_path: Path) -> None:
    data = GAZEBO.read_bytes()
    log = tmp_path / "state.log"
    log.write_bytes(data[: len(data) * 6 // 10])

    result = score_trial(log, "safety", partial=True)

    (said,) = (d.message for d in result.measured.log_defects if "</gazebo_log>" in d.message)
    assert result.measured.cut is not None
    last_s = float(said.partition("read up to ")[2].partition(" s")[0])
    assert result.measured.cut.until_s == pytest.approx(last_s - 1.0, abs=1e-3)
    assert result.measured.unofficial
