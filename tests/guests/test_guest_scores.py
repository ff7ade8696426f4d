"""Three competitions that the core does not know: scored, explained, compared with the official rule."""

from __future__ import annotations

import json
import random
import runpy
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ariac_score import Result, load_rule_set, score_trial
from ariac_score.cli import main

pytestmark = pytest.mark.usefixtures("guests")

official = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "official.py")))

CASES = [
    ("barn", "world_42", "barn"),
    ("barn", "world_42", "barn.2022"),
    ("robocup_work", "bmt_1", "robocup_work.bmt_2024"),
    ("carla", "results_2_0.json", "carla.2_0"),
    ("carla", "results_2_1.json", "carla.2_1"),
]


def rounded(value: Fraction | float, digits: int = 6) -> Decimal:
    """Half to even, as scores are."""
    exact = Decimal(value.numerator) / value.denominator if isinstance(value, Fraction) else Decimal(value)
    return exact.quantize(Decimal(1).scaleb(-digits))


def score_of(path: Path, rules: str) -> Result:
    return score_trial(path, load_rule_set(rules))


def expected(guests: Path, guest: str, recording: str, rules: str) -> dict[str, Any]:
    by_hand: dict[str, Any] = json.loads((guests / guest / "expected.json").read_text("utf-8"))
    found: dict[str, Any] = by_hand[recording][rules]
    return found


@pytest.mark.parametrize(("guest", "recording", "rules"), CASES)
def test_the_recording_scores_what_the_rule_gives_by_hand(
    guest: str, recording: str, rules: str, guests: Path
) -> None:
    result = score_of(guests / guest / "recording" / recording, rules)

    by_hand = expected(guests, guest, recording, rules)
    assert result.score == Decimal(by_hand["score"])
    assert result.possible == Decimal(by_hand["possible"])
    assert result.status == "scored"


def test_what_was_derived_by_hand_is_what_the_official_rule_gives(guests: Path) -> None:
    length_m = official.path_length_m([(17, row) for row in range(31)])
    for rules, fastest in (("barn", 2), ("barn.2022", 4)):
        metric = official.nav_metric(True, length_m, 16.0, fastest)
        assert Decimal(expected(guests, "barn", "world_42", rules)["score"]) == rounded(metric)

    routes = [
        ("100", {"collisions_vehicle": 1, "red_light": 1}, [], []),
        ("62.5", {}, ["50.0"], ["8.0"]),
        ("100", {}, [], []),
    ]
    for version in ("2.0", "2.1"):
        name = version.replace(".", "_")
        by_hand = expected(guests, "carla", f"results_{name}.json", f"carla.{name}")["score"]
        assert Decimal(by_hand) == rounded(official.driving_score(routes, version))

    sheet = (guests / "robocup_work/recording/bmt_1/referee.csv").read_text("utf-8").splitlines()[1:]
    events = [
        (int(t), kind, thing or place) for t, kind, thing, place, _ in (row.split(",") for row in sheet)
    ]
    points = official.manipulation_test(events, limit_s=300, objects=3)
    by_hand = expected(guests, "robocup_work", "bmt_1", "robocup_work.bmt_2024")["score"]
    assert Decimal(by_hand) == rounded(points)


@pytest.mark.parametrize(("guest", "recording", "rules"), CASES)
def test_the_ledger_gives_each_finding_the_amount_derived_by_hand(
    guest: str, recording: str, rules: str, guests: Path
) -> None:
    by_hand = expected(guests, guest, recording, rules)
    ledger = score_of(guests / guest / "recording" / recording, rules).ledger
    assert ledger is not None
    lines = list(ledger.walk())
    taken = {line.findings[0]: line.amount for line in lines if line.kind == "taken" and not line.children}

    assert taken == {
        finding: Decimal(amount) for finding, amount in by_hand["taken"].items() if amount != "0"
    }
    told = {key: line.reason for line in lines if line.kind == "neutral" for key in line.findings}
    for finding in (finding for finding, amount in by_hand["taken"].items() if amount == "0"):
        assert told[finding].startswith("hidden by clip(")
    (earned,) = [line.amount for line in lines if line.path == "score/earned"]
    assert earned == Decimal(by_hand["earned"])
    assert sum(line.amount for line in ledger.leaves) == Decimal(by_hand["score"])


def test_each_finding_that_changed_nothing_says_so(guests: Path) -> None:
    result = score_of(guests / "robocup_work/recording/bmt_1", "robocup_work.bmt_2024")
    assert result.ledger is not None

    told = [finding for line in result.ledger.leaves for finding in line.findings]

    assert sorted(set(told)) == sorted(result.measured.findings)
    assert all(line.amount == 0 and line.reason for line in result.ledger.leaves if line.kind == "neutral")


# Any run, against the official rule ------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_any_run_through_a_world_scores_the_official_metric(seed: int, tmp_path: Path) -> None:
    draw = random.Random(seed)  # noqa: S311  # not for secrets
    cells = [(draw.randrange(30), row) for row in range(30)]
    np.save(tmp_path / "path_7.npy", np.array(cells))
    speed_m_s = draw.choice([0.09, 0.2, 0.5, 1.5])
    crash = draw.random() < 0.3
    rows, end_s = [], None
    for k in range(1200):
        t, y = k / 10, 3 + speed_m_s * k / 10
        crashed = int(crash and y > 8)
        rows.append(f"{t:.1f} -2.0 {y:.6f} {crashed}")
        if y >= 12 or crashed or k > 1100:
            break
    (tmp_path / "trace.txt").write_text("# time x y collided\n" + "\n".join(rows) + "\n# end\n", "utf-8")
    start_s = next(float(row.split()[0]) for row in rows if float(row.split()[2]) - 3 >= 0.1)
    end_s = min(float(rows[-1].split()[0]), start_s + 100)
    success = not crash and end_s - start_s < 100

    metric = official.nav_metric(success, official.path_length_m(cells), end_s - start_s, 2)

    assert float(score_of(tmp_path, "barn").score or 0) == pytest.approx(metric, abs=1e-6)


def results_file(path: Path, routes: list[Any]) -> Path:
    """A results file of these routes; its own scores are those of nobody."""
    kinds = [*official.COEFFICIENTS_2_0, "min_speed_infractions", "outside_route_lanes"]
    records = []
    for i, (driven, counts, speeds, off_road) in enumerate(routes):
        lists: dict[str, list[str]] = {
            k: [] for k in (*kinds, "route_dev", "vehicle_blocked", "route_timeout")
        }
        lists |= {kind: [f"{kind} at (x={n}, y=0)" for n in range(count)] for kind, count in counts.items()}
        lists["min_speed_infractions"] = [
            f"Average speed is {p}% of the surrounding traffic's one" for p in speeds
        ]
        lists["outside_route_lanes"] = [
            f"Agent went outside its route lanes for about 3.2 meters ({p}% of the completed route)"
            for p in off_road
        ]
        records.append(
            {
                "route_id": f"RouteScenario_{i}_rep0",
                "status": "Completed",
                "infractions": lists,
                "scores": {"score_route": float(driven), "score_penalty": 0.0, "score_composed": 0.0},
                "meta": {"route_length": 100.0, "duration_game": 10.0},
            }
        )
    mean = {"score_composed": 0.0, "score_route": 0.0, "score_penalty": 0.0}
    checkpoint = {"global_record": {"scores_mean": mean}, "progress": [len(routes)] * 2, "records": records}
    path.write_text(json.dumps({"_checkpoint": checkpoint}), encoding="utf-8")
    return path


@pytest.mark.parametrize("version", ["2.0", "2.1"])
@pytest.mark.parametrize("seed", range(4))
def test_any_entry_scores_the_official_driving_score(version: str, seed: int, tmp_path: Path) -> None:
    draw = random.Random(seed)  # noqa: S311  # not for secrets
    routes = [
        (
            str(draw.choice([100, 100, 83.25, 0])),
            {kind: draw.randrange(3) for kind in official.COEFFICIENTS_2_0 if draw.random() < 0.4},
            [str(round(draw.uniform(0, 100), 2)) for _ in range(draw.randrange(3))],
            [str(round(draw.uniform(0, 100), 2)) for _ in range(draw.randrange(2))],
        )
        for _ in range(draw.randrange(1, 5))
    ]

    result = score_of(results_file(tmp_path / "results.json", routes), f"carla.{version.replace('.', '_')}")

    assert result.score == rounded(official.driving_score(routes, version))


def test_published_results_of_an_agent_have_the_published_score(tmp_path: Path) -> None:
    # Result 1102_0_0 of the data set andreas122001/AD_pdm-lite_carla-lb2: 100 % driven, slow at two checks.
    path = results_file(tmp_path / "results.json", [("100", {}, ["89.22", "79.46"], [])])

    assert score_of(path, "carla.2_0").score == pytest.approx(Decimal("90.803279"), abs=Decimal("0.0005"))


PLACES = {"WS01": "reached", "WS02": "reached", "finish": "reached"}


@pytest.mark.parametrize("seed", range(8))
def test_any_run_of_a_manipulation_test_scores_the_points_of_the_rulebook(seed: int, tmp_path: Path) -> None:
    draw = random.Random(seed)  # noqa: S311  # not for secrets
    tags = seed % 4 == 3
    perfect = seed in (0, 3)
    steps: list[tuple[str, str, str]] = []
    for thing in ("nut", "axis", "tube"):
        if perfect or draw.random() < 0.9:
            steps.append(("grasped", thing, "WS01"))
            if perfect or draw.random() < 0.7:
                steps.append(("placed", thing, "WS02"))
                steps += [("deduction", thing, "")] * (not perfect and draw.random() < 0.3)
            else:
                steps.append((draw.choice(["lost", "incorrect"]), thing, ""))
    mishaps = [
        "minor_collision",
        "tape_collision",
        "human_interaction",
        "major_collision",
        "cheating",
        "restart",
    ]
    steps += [(kind, "", "") for kind in mishaps if not perfect for _ in range(draw.choice([0, 0, 0, 1, 6]))]
    draw.shuffle(steps)
    steps += [("reached", "", place) for place in PLACES if perfect or draw.random() < 0.8]
    rows = [("competition_started", "", ""), *steps, ("competition_ended", "", "")]
    timed = [(10 * i, *row) for i, row in enumerate(rows)]
    sheet = "".join(f"{t},{kind},{thing},{place},\n" for t, kind, thing, place in timed)
    (tmp_path / "referee.csv").write_text("time_s,event,object,place,remark\n" + sheet, encoding="utf-8")
    objects = ", ".join(f"{{id: {thing}, type: M20}}" for thing in ("nut", "axis", "tube"))
    (tmp_path / "task.yaml").write_text(
        f"{{test: BMT, objects: {'april_tags' if tags else 'real'}, time_limit_s: 250, tasks: "
        f"[{{id: t, source: WS01, target: WS02, objects: [{objects}]}}]}}\n",
        encoding="utf-8",
    )
    events = [(t, kind, thing or place) for t, kind, thing, place in timed]

    points = official.manipulation_test(events, limit_s=250, objects=3, tags=tags)

    assert score_of(tmp_path, "robocup_work.bmt_2024").score == rounded(points)


def test_a_perfect_run_has_the_points_of_the_rulebooks_example(tmp_path: Path) -> None:
    # Rulebook 2024, Scoring: 2 * 100 + 100 + 3 * 100 + 3 * 100 + 6 * 10 = 960; no time is left.
    things = ("a", "b", "c")
    rows = [(0, "competition_started", "", ""), (1, "reached", "", "WS01"), (2, "reached", "", "WS02")]
    rows += [(3, "grasped", thing, "WS01") for thing in things] + [(4, "placed", t, "WS02") for t in things]
    rows += [(300, "reached", "", "finish"), (300, "competition_ended", "", "")]
    sheet = "".join(f"{t},{kind},{thing},{place},\n" for t, kind, thing, place in rows)
    (tmp_path / "referee.csv").write_text("time_s,event,object,place,remark\n" + sheet, encoding="utf-8")
    objects = ", ".join(f"{{id: {thing}, type: M20}}" for thing in things)
    (tmp_path / "task.yaml").write_text(
        "{test: BMT, objects: real, time_limit_s: 300, "
        f"tasks: [{{id: t, source: WS01, target: WS02, objects: [{objects}]}}]}}\n",
        encoding="utf-8",
    )

    assert score_of(tmp_path, "robocup_work.bmt_2024").score == 960


# Beside the score ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("guest", "recording", "rules", "words"),
    [
        (
            "barn",
            "world_42",
            "barn",
            "total 0.3125: the same as ours, to the digits that are printed",
        ),
        ("barn", "world_42", "barn.2022", "official total 0.3125: not ours"),
        ("carla", "results_2_0.json", "carla.2_0", "official total 63.625: the same as ours"),
        ("carla", "results_2_1.json", "carla.2_1", "official total 65.1786: the same as ours"),
        ("carla", "results_2_1.json", "carla.2_0", "official total 65.1786: not ours"),
    ],
)
def test_the_official_score_is_kept_beside(
    guest: str, recording: str, rules: str, words: str, guests: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["score", str(guests / guest / "recording" / recording), "--rules", rules]) == 0

    assert words in capsys.readouterr().out


@pytest.mark.parametrize(("recording", "code"), [("results_2_0.json", 0), ("results_2_1.json", 1)])
def test_an_audit_compares_the_scores_of_every_route(
    recording: str, code: int, guests: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = guests / "carla/recording" / recording

    assert main(["audit", str(path), "--rules", "carla.2_0"]) == code
    assert "final_score" in capsys.readouterr().out


def test_a_command_of_a_guest_reports_many_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out.txt").write_text("0 1 0 0 10.0 0.5\n0 0 1 0 4.0 0.0\n6 1 0 0 20.0 0.25\n", "utf-8")

    assert main(["barn", "report", str(tmp_path / "out.txt")]) == 0

    # By hand: world 0 has the metrics 0.5 and 0, world 6 has 0.25; (0.25 + 0.25) / 2.
    assert "Avg Time: 15.0000, Avg Metric: 0.2500, Avg Success: 0.7500" in capsys.readouterr().out


def test_a_run_without_its_world_is_undecided_and_says_what_is_missing(
    guests: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = guests / "barn/recording/world_42/trace.txt"
    (tmp_path / "trace.txt").write_bytes(trace.read_bytes())

    assert main(["score", str(tmp_path / "trace.txt"), "--rules", "barn"]) == 6
    assert "optimal_time_s" in capsys.readouterr().err
