"""Who damages, trims or doctors a log gets a clear refusal or an undecided score, never more points."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_result, score_trial
from ariac_score.cli import main
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

Records = list[dict[str, Any]]
HONEST = 19.761677


def _doctored(folder: Path, change: Callable[[Records], Records | None]) -> Path:
    path = write_trial_log(folder / "t.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    records = [json.loads(line) for line in path.read_text().splitlines()]
    records = change(records) or records
    records[-1]["records"] = len(records)
    path.write_text("".join(json.dumps(record) + "\n" for record in records))
    return path


def _samples(records: Records) -> Records:
    return [record for record in records if record["record"] == "sample"]


def _set(signal: str, value: float, low: float = 18.0, high: float = 22.0) -> Callable[[Records], None]:
    def change(records: Records) -> None:
        for record in _samples(records):
            if low <= record["t_s"] <= high:
                record["values"][signal] = value

    return change


def _without(kind: str) -> Callable[[Records], Records]:
    return lambda records: [r for r in records if r.get("kind") != kind]


def _at(kind: str, t_s: float) -> Callable[[Records], None]:
    def change(records: Records) -> None:
        next(r for r in records if r.get("kind") == kind)["t_s"] = t_s

    return change


def _duplicate_safely(records: Records) -> Records:
    out: Records = []
    for record in records:
        out.append(record)
        if record["record"] == "sample":
            out.append({**record, "values": {**record["values"], "centre_distance/robot/human": 99.0}})
    return out


DOCTORED: dict[str, Callable[[Records], Records | None]] = {
    "the end is not recorded": _without("competition_ended"),
    "the start is not recorded": _without("competition_started"),
    "the end comes before the near miss and before a submission": _at("competition_ended", 18.0),
    "the start comes after the near miss and after a submission": _at("competition_started", 22.0),
    "start and end are one instant": lambda r: (
        _at("competition_started", 10.0)(r) or _at("competition_ended", 10.0)(r)
    ),
    "the human's speed is negative in the near miss": _set("speed/human", -5.0),
    "the robot's speed is negative in the near miss": _set("speed/robot", -9.0),
    "the distance is absurd in the near miss": _set("centre_distance/robot/human", 1e300),
    "a safe sample follows every sample, with its stamp": _duplicate_safely,
    "the near miss is cut out": lambda r: [x for x in r if x["record"] != "sample" or not 18 < x["t_s"] < 22],
}


@pytest.mark.parametrize("name", DOCTORED)
def test_a_doctored_log_never_scores_more_than_the_honest_one(name: str, tmp_path: Path) -> None:
    result = score_trial(_doctored(tmp_path, DOCTORED[name]), "paper2020.published")

    assert result.score is None or float(result.score) <= HONEST


@pytest.mark.parametrize(
    ("lost", "most"),
    [
        ("competition_started", HONEST),
        # The near miss comes after the last order, and may have been behind the end.
        ("competition_ended", 28.0),
    ],
)
def test_a_log_that_shows_only_one_end_of_the_competition_leaves_the_whole_task_open(
    lost: str, most: float, tmp_path: Path
) -> None:
    result = score_trial(_doctored(tmp_path, _without(lost)), "paper2020.published")

    # At worst somebody was hurt in what is missing: 0.
    assert result.is_open
    assert result.interval is not None
    assert result.score == result.interval.least == 0
    assert float(result.interval.most) == most
    assert {"separation", "human_contact", "no_arm_collision"} < {a.check for a in result.assumptions}


def _first(kind: str, records: Records) -> dict[str, Any]:
    return next(record for record in records if record["record"] == kind)


REFUSED: dict[str, tuple[Callable[[Records], Any], str]] = {
    "an undeclared human": (
        lambda r: r.remove(next(x for x in r if x.get("id") == "human")),
        "speaks of 'human', which no 'body' record declares",
    ),
    "two slots of one name": (
        lambda r: [p.update(slot="part_0") for p in _first("order", r)["tasks"][0]["products"]],
        "holds two items named 'part_0'",
    ),
    "an order announced again with less in it": (
        lambda r: r.insert(-1, {**_first("order", r), "t_s": 30.0, "tasks": []}),
        "announced twice, with different contents",
    ),
    "an integer beyond all measure": (lambda r: _samples(r)[3].update(t_s=10**400), "t_s is 1000"),
    "a time beyond all measure": (lambda r: _samples(r)[3].update(t_s=1e308), "t_s is 1e+308"),
    "a sample without a value": (
        lambda r: _samples(r)[3].update(values={}),
        "a sample has exactly 't_s' and 'values'",
    ),
    "a huge integer in a pose": (
        lambda r: _first("submission", r)["contents"][0]["pose"].update(position_m=[10**400, 0, 0]),
        "a number is too large",
    ),
    "an item within 450 others": (
        lambda r: r.insert(
            -1,
            {
                "record": "item",
                "t_s": 30.0,
                **functools.reduce(
                    lambda inner, k: {"id": f"i{k}", "level": "task", "items": [inner]},
                    range(450),
                    {"id": "i", "level": "task"},
                ),
            },
        ),
        "nested more than 64 deep",
    ),
    "a negative radius": (
        lambda r: _first("body", r).update(radius_m=-5),
        "-5 is less than the minimum of 0",
    ),
    "a record of another kind": (lambda r: r[3].update(record="sampel"), "record 'sampel' is unknown"),
    "a quantity with a new meaning": (
        lambda r: r[0].update(quantities={"speed": {"unit": "km/h", "of": "body"}}),
        "quantity 'speed' has its meaning already",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_contradiction_in_a_log_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, cause = REFUSED[name]

    def doctor(records: Records) -> None:
        change(records)

    assert main(["score", str(_doctored(tmp_path, doctor)), "--rules", "paper2020.published"]) == 6

    err = capsys.readouterr().err
    assert cause in err
    assert "t.jsonl" in err
    assert "hint:" in err


def test_a_pose_too_far_to_compute_with_is_open_and_counts_as_wrong(tmp_path: Path) -> None:
    def change(records: Records) -> None:
        _first("submission", records)["contents"][0]["pose"]["position_m"] = [1e200, 0.0, 0.0]

    result = score_trial(_doctored(tmp_path, change), "paper2020.published")

    # One pose point, under the demerits that the honest log has.
    assert result.is_open
    assert result.interval is not None
    assert result.score == result.interval.least
    assert float(result.interval.most) == HONEST
    assert float(result.interval.least) == pytest.approx(HONEST * 27 / 28, abs=2e-6)


def test_half_a_surrogate_pair_in_a_name_does_not_stop_the_result(tmp_path: Path) -> None:
    def change(records: Records) -> None:
        _first("submission", records)["contents"][0]["name"] = "\ud800"
        _first("submission", records)["contents"][0]["faulty"] = True

    log, out = _doctored(tmp_path, change), tmp_path / "r.json"

    assert (
        main(["score", str(log), "--rules", "paper2020.published", "--output-format", "json", "-o", str(out)])
        == 0
    )
    assert load_result(out).score is not None


@pytest.mark.parametrize("name", ["t.jsonl", "./t.jsonl", "link.jsonl"])
def test_a_result_is_never_written_over_its_log(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = _doctored(tmp_path, lambda records: records)
    (tmp_path / "link.jsonl").symlink_to(log)
    before = log.read_bytes()
    monkeypatch.chdir(tmp_path)

    assert main(["score", "t.jsonl", "--rules", "paper2020.published", "-o", name]) == 4

    assert log.read_bytes() == before
    assert "would overwrite" in capsys.readouterr().err


def test_a_link_keeps_its_target_and_a_device_stays_a_device(tmp_path: Path) -> None:
    log = _doctored(tmp_path, lambda records: records)
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")

    assert main(["score", str(log), "--rules", "paper2020.published", "-o", str(tmp_path / "link.txt")]) == 0
    assert main(["score", str(log), "--rules", "paper2020.published", "-o", "/dev/null"]) == 0

    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text().startswith("19.761677")
    assert not Path("/dev/null").is_file()


def test_a_score_beyond_decimals_in_a_result_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = _doctored(tmp_path, lambda records: records), tmp_path / "r.json"
    main(["score", str(log), "--rules", "paper2020.published", "--output-format", "json", "-o", str(out)])
    out.write_text(out.read_text().replace('"score": 19.761677', '"score": 1e400'))

    assert main(["explain", str(out)]) == 6
    assert "hint:" in capsys.readouterr().err


def test_a_quantity_of_ones_own_is_recorded_and_read(tmp_path: Path) -> None:
    def change(records: Records) -> None:
        records[0]["quantities"] = {"force": {"unit": "N", "of": "body"}}
        for record in _samples(records):
            record["values"]["force/robot"] = 12.5

    from ariac_score.checks.contracts import Wanted  # noqa: PLC0415  # only this test reads by hand
    from ariac_score.logs.jsonl import JsonLinesReader  # noqa: PLC0415
    from ariac_score.trial.channels import LogMap  # noqa: PLC0415

    path = _doctored(tmp_path, change)
    trial = JsonLinesReader().read(path, Wanted(LogMap("none"), frozenset({"force"})))

    assert set(trial.signal("force/robot", unit="N").values) == {12.5}
    assert score_trial(path, "paper2020.published").score is not None
