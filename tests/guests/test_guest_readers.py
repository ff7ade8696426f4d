"""A file of a guest that is damaged is refused with the file, the place and what to do about it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score.cli import main

pytestmark = pytest.mark.usefixtures("guests")


def refused(path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What `info` and `score` say of files that hold no trial; neither may end in a traceback."""
    main(["info", str(path)])
    capsys.readouterr()
    code = main(["score", str(path), "--rules", "paper2020.published"])
    said = capsys.readouterr().err
    assert code in (4, 5, 6), said
    assert "Traceback" not in said
    assert "hint:" in said
    return said


# BARN ----------------------------------------------------------------------------------

TRACE = "# time x y collided\n0.0 -2.0 3.0 0\n0.1 -2.0 3.2 0\n# end\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TRACE.removesuffix("# end\n"), "cut off"),
        (TRACE.replace("3.2 0", "3.2"), "line 3"),
        (TRACE.replace("3.2", "nan"), "line 3"),
        (TRACE.replace("3.2", "north"), "'0.1 -2.0 north 0' is not 4 numbers"),
        (TRACE + "0.2 -2.0 3.4 0\n", "after '# end'"),
        ("# time x y collided\n# end\n", "no position"),
        (TRACE.replace("0.1", "-99.0"), "time runs backwards"),
        (TRACE.replace("3.2", "3.2\u00b5"), "not plain text"),
    ],
)
def test_a_trace_that_is_not_whole_is_refused(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.txt"
    path.write_text(text, encoding="utf-8")

    said = refused(path, capsys)

    assert words in said
    assert "trace.txt" in said


def _npy(array: Any) -> Callable[[Path], None]:
    return lambda path: np.save(path, array, allow_pickle=True)


def _cut(path: Path) -> None:
    np.save(path, np.zeros((40, 2)))
    path.write_bytes(path.read_bytes()[:-8])


def _bomb(path: Path) -> None:
    np.save(path, np.zeros((40, 2)))
    path.write_bytes(path.read_bytes().replace(b"(40, 2), }        ", b"(9999999999, 2), }"))


@pytest.mark.parametrize(
    "write",
    [
        _npy(np.zeros((0, 2))),
        _npy(np.zeros((5, 3))),
        _npy(np.zeros(4)),
        _npy(np.array([[1.0, np.nan]])),
        _npy(np.array([[{}, None]])),
        _npy(np.array([["a", "b"]])),
        _cut,
        _bomb,
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"\x93NUMPY" + bytes(40)),
        lambda path: path.write_bytes(bytes(2_000_000)),
    ],
)
def test_a_path_that_is_no_path_through_a_world_is_refused(
    write: Callable[[Path], Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "path_7.npy")

    assert "path_7.npy" in refused(tmp_path / "path_7.npy", capsys)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("42 1 0 0 16.0\n", "line 1"),
        ("42 1 1 0 16.0 0.3\n", "does not say how the run ended"),
        ("42 0 0 0 16.0 0.0\n", "does not say how the run ended"),
        ("42 1 0 0 16.0 0.3\n43 1 0 0 16.0 0.3\n", "holds 2 runs"),
        ("42 1 0 0 16.0 inf\n", "line 1"),
    ],
)
def test_an_outcome_that_contradicts_itself_is_refused(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out.txt").write_text(text, encoding="utf-8")

    assert words in refused(tmp_path / "out.txt", capsys)


def test_the_outcome_of_another_world_is_refused(
    guests: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in (guests / "barn/recording/world_42").iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "out.txt").write_text("41 1 0 0 16.0000 0.3125\n", encoding="utf-8")

    assert "'out.txt' (recorder) says 41" in refused(tmp_path, capsys)


# RoboCup@Work --------------------------------------------------------------------------

HEAD = "time_s,event,object,place,remark\n"
SHEET = HEAD + "0,competition_started,,,\n5,grasped,nut,WS01,\n9,competition_ended,,,\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD, "no event"),
        (SHEET.removesuffix("9,competition_ended,,,\n"), "cut off"),
        (SHEET.replace("0,competition_started,,,\n", ""), "line 2"),
        (SHEET.replace("grasped", "graspt"), "did you mean 'grasped'?"),
        (SHEET.replace("5,grasped", "50,grasped"), "out of order"),
        (SHEET.replace("5,grasped", "later,grasped"), "time 'later'"),
        (SHEET.replace("nut", ""), "line 3"),
        (SHEET.replace(",WS01,", ","), "4 columns"),
        (SHEET + "9,cheating,,,\n", "out of order"),
        (SHEET.replace("nut", '"nut'), "not a table"),
        (SHEET.replace("9,comp", "inf,comp"), "time 'inf'"),
    ],
)
def test_a_sheet_that_nobody_can_follow_is_refused(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "referee.csv"
    path.write_text(text, encoding="utf-8")

    assert words in refused(path, capsys)


TASK = """\
test: BMT
objects: real
time_limit_s: 300
tasks:
  - {id: t, source: WS01, target: WS02, objects: [{id: nut, type: M20}, {id: axis, type: AXIS2}]}
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("test: BMT\n", "", "'test' is missing"),
        ("real", "toys", "real or april_tags"),
        ("300", "-1", "$.time_limit_s"),
        ("300", "five minutes", "'time_limit_s' is 'five minutes'"),
        ("source", "sauce", "did you mean 'source'?"),
        ("id: axis", "id: nut", "'nut' is there twice"),
        ("[{id: nut, type: M20}, {id: axis, type: AXIS2}]", "[]", "$.tasks[0]"),
        ("id: nut", "id: a/b", "a/b"),
        ("BMT", "{", "malformed YAML"),
    ],
)
def test_a_task_that_nobody_could_set_is_refused(
    old: str, new: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "task.yaml").write_text(TASK.replace(old, new), encoding="utf-8")
    (tmp_path / "referee.csv").write_text(SHEET, encoding="utf-8")

    said = refused(tmp_path, capsys)

    assert words in said
    assert "task.yaml" in said


# CARLA ---------------------------------------------------------------------------------


def _set(path: str, value: object) -> Callable[[Any], None]:
    """Put a value at a path such as `_checkpoint.records.0.status`; `None` removes it."""
    *folders, last = [int(key) if key.isdigit() else key for key in path.split(".")]

    def change(data: Any) -> None:
        for key in folders:
            data = data[key]
        if value is None:
            del data[last]
        else:
            data[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_set("_checkpoint", []), "'_checkpoint' is '[]'"),
        (_set("_checkpoint.records", []), "no route"),
        (_set("_checkpoint.progress", [2, 3]), "2 of 3 routes are done"),
        (_set("_checkpoint.progress", [3]), "'progress' is [3]"),
        (_set("_checkpoint.records.1", "route"), "_checkpoint.records[1]"),
        (_set("_checkpoint.records.1.scores", None), "_checkpoint.records[1]: 'scores' is missing"),
        (_set("_checkpoint.records.1.scores.score_route", 104.0), "it is a percentage"),
        (_set("_checkpoint.records.1.scores.score_route", float("nan")), "_checkpoint.records[1].scores"),
        (_set("_checkpoint.records.1.scores.score_route", True), "_checkpoint.records[1].scores"),
        (_set("_checkpoint.records.1.meta.duration_game", "long"), "_checkpoint.records[1].meta"),
        (_set("_checkpoint.records.1.route_id", "RouteScenario_0_rep0"), "recorded twice"),
        (_set("_checkpoint.records.1.route_id", "a/b"), "no name"),
        (_set("_checkpoint.records.1.infractions.red_light", None), "'red_light' is missing"),
        (_set("_checkpoint.records.1.infractions.red_light", [1]), "not a list of texts"),
        (_set("_checkpoint.records.1.infractions.jaywalking", []), "'jaywalking' is unknown"),
        (_set("_checkpoint.global_record", None), "'global_record' is missing"),
        (_set("_checkpoint.global_record.scores_mean.score_composed", "high"), "scores_mean"),
    ],
)
def test_results_without_what_the_score_needs_are_refused(
    change: Callable[[Any], None],
    words: str,
    guests: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    data = json.loads((guests / "carla/recording/results_2_0.json").read_text(encoding="utf-8"))
    change(data)
    (tmp_path / "results.json").write_text(json.dumps(data), encoding="utf-8")

    assert words in refused(tmp_path / "results.json", capsys)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.999])
def test_results_that_are_cut_off_are_refused(
    share: float, guests: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = (guests / "carla/recording/results_2_0.json").read_bytes()
    (tmp_path / "results.json").write_bytes(whole[: int(len(whole) * share)])

    assert "rewritten after every route" in refused(tmp_path / "results.json", capsys)
