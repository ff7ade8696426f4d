"""What the official scorers of eight states give on random trials, held against our rule sets.

`--official-vectors DIR` runs the files (`*.jsonl`, `*.jsonl.gz`) of another folder; a folder
that is given and holds none is a failure. A line is one trial of the format
`ariac-official-vectors/1`, which the README beside the vectors describes; the state that
scored it stands before the first hyphen of its `case`.

Scores must be equal, not close: official ones are doubles that hold small integers. Times
must be equal in nanoseconds, in which the simulator counts before it prints a double.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Event, LogError, Pose, RuleSet, Trial, TrialBuilder, Verdict, measure_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.price import price_trial
from ariac_score.results.result import Measured, Provenance
from ariac_score.scoring.expression import Expression
from ariac_score.trial.build import merge_trials
from ariac_score.trial.clock import Clock
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, Tray, WantedProduct

DEFAULT_FOLDER = Path(__file__).parents[3] / "shared/ariac/vectors"

RULE_SETS: Mapping[str, str] = {
    "2020": "ariac2020.as_coded",
    "2021t": "ariac2021.tip_as_coded",
    "2021q": "ariac2021.qualifiers_as_coded",
    "2021f": "ariac2021.finals_as_coded",
    "2022": "ariac2022.as_coded",
    "2023": "ariac2023.as_coded",
    "2024.3": "ariac2024.release_3",
    "2024.5": "ariac2024.release_5",
}
"""The rule set of each state of the official scorer."""

FIELDS = {"case", "orders", "submissions", "arm_collision", "floor_penalty", "quality_checks", "expected"}
SHOWN = 20
SAMPLED = 10
"""The suite of the README takes one trial in so many of each file, the slow tests every one."""
REGISTRY = Registry()
NO_PROVENANCE = Provenance((), (), ("", ""), ("", ""), ())


# Which files ---------------------------------------------------------------------------


def folder_of(config: pytest.Config) -> Path:
    given = config.getoption("--official-vectors")
    return Path(given) if given else DEFAULT_FOLDER


def files_in(folder: Path) -> list[Path]:
    return sorted([*folder.glob("*.jsonl"), *folder.glob("*.jsonl.gz")])


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each file, whose failure lists the trials that differ."""
    if "vectors" in metafunc.fixturenames:
        files = files_in(folder_of(metafunc.config))
        whole = [(file, 1) for file in files]
        if metafunc.config.getoption("--official-vectors"):  # of a folder that somebody names, every one
            metafunc.parametrize(("vectors", "each"), whole, ids=[file.name for file in files])
            return
        slow = [pytest.param(*of, marks=pytest.mark.slow, id=of[0].name) for of in whole]
        few = [pytest.param(file, SAMPLED, id=f"{file.name}: one in {SAMPLED}") for file in files]
        metafunc.parametrize(("vectors", "each"), [*few, *slow])


def test_the_folder_of_official_vectors_is_not_empty(request: pytest.FixtureRequest) -> None:
    folder = folder_of(request.config)
    if not folder.is_dir() and not request.config.getoption("--official-vectors"):
        pytest.skip("the folder of official vectors (../shared/ariac/vectors) is not here")
    assert files_in(folder), f"no vectors (*.jsonl, *.jsonl.gz) in {folder}"


def test_every_trial_scores_as_in_the_official_scorer(vectors: Path, each: int) -> None:
    differing, trials = differences_in(vectors, each)

    if differing:
        more = [f"and {len(differing) - SHOWN} more"] if len(differing) > SHOWN else []
        head = f"{vectors}: {len(differing)} of {trials} trials differ from the official scorer"
        pytest.fail("\n".join([head, *differing[:SHOWN], *more]), pytrace=False)
    assert trials, f"{vectors} holds no trial"


def differences_in(file: Path, each: int = 1) -> tuple[list[str], int]:
    """What differs in each trial of a file, or in one of so many, by its number, and how many were scored."""
    unpack = gzip.open if file.suffix == ".gz" else open
    with unpack(file, "rt", encoding="utf-8") as lines:
        rows = [line for line in lines if line.strip()]
    taken = [*enumerate(rows, start=1)][::each]
    found = [(number, list(differences(line))) for number, line in taken]
    return [f"  trial {number}, {'; '.join(words)}" for number, words in found if words], len(found)


def differences(line: str) -> Iterator[str]:
    """What differs between one line and our score of it, in words, first of all which trial it is."""
    try:
        document = json.loads(line)
        trial, _ = trial_of(document), float(document["expected"]["total"])
    except (ValueError, KeyError, TypeError, LogError) as error:
        yield f"which is not of the format ariac-official-vectors/1: {error!r}"
        return
    compared = list(compare(document, trial))
    if compared:
        yield f"{document['case']}: {compared[0]}"
        yield from compared[1:]


# From a vector to a trial --------------------------------------------------------------


def state_of(document: Mapping[str, Any]) -> str:
    return str(document["case"]).partition("-")[0]


def pose_of(document: Mapping[str, Any] | None) -> Pose | None:
    if document is None:
        return None
    (x, y, z), (w, i, j, k) = document["position_m"], document["orientation_wxyz"]
    return Pose((x, y, z), (w, i, j, k))


def wanted_of(number: int, document: Mapping[str, Any]) -> WantedProduct:
    # Of a quadrant of which a vector does not say that it is challenged it is known that it is not.
    return WantedProduct(
        f"part_{number}",
        document["type"],
        pose_of(document["pose"]),
        document.get("quadrant", 0),
        document.get("challenged", False) if "quadrant" in document else None,
    )


def task_of(document: Mapping[str, Any]) -> Task:
    return Task(
        document["id"],
        document["kind"],
        tuple(wanted_of(number, product) for number, product in enumerate(document["products"])),
        document["agv"],
        document["station"],
        Tray(document["tray"]) if document["tray"] else None,
    )


def order_of(document: Mapping[str, Any]) -> Order:
    tasks = tuple(task_of(task) for task in document["tasks"])
    return Order(
        document["id"], tasks, document["time_s"], document["priority"], updates=document.get("updates", "")
    )


def submission_of(document: Mapping[str, Any], *, tray_is_seen: bool) -> KitSubmission:
    tray = Tray(document["tray"], pose_of(document.get("tray_pose")))
    return KitSubmission(
        document["task"],
        document["time_s"],
        tuple(
            Product(p["type"], pose_of(p["pose"]), p.get("faulty", False), p.get("name", ""))
            for p in document["products"]
        ),
        document["agv"],
        document["station"],
        # From 2023 on an empty name says that no tray or insert was seen.
        tray if document["tray"] or tray_is_seen else None,
    )


def trial_of(document: Mapping[str, Any]) -> Trial:
    builder = TrialBuilder(document["case"], file=document["case"], clock=Clock("simulated time"))
    builder.witnessed |= {"submissions", "arm_collision", "part_dropped", "quality_check"}
    for order in document["orders"]:
        builder.add(order_of(order))
    for submission in document["submissions"]:
        builder.add(submission_of(submission, tray_is_seen=state_of(document) >= "2023"))
    end_s = max([0.0, *(submission["time_s"] for submission in document["submissions"])]) + 1.0
    if document.get("arm_collision", False):
        builder.add(Event(end_s, "arm_collision"))
    for number in range(document.get("floor_penalty", 0)):
        builder.add(Event(end_s, "part_dropped", f"part_{number}"))
    for check in document.get("quality_checks", []):
        builder.add(Event(check["time_s"], "quality_check", check["order"]))
    return merge_trials("case", [builder.build()], file="case", competition=Ariac())


# From a trial to what differs ----------------------------------------------------------


@cache
def prepared(name: str) -> Prepared:
    return prepare(name, registry=REGISTRY)


def compare(document: Mapping[str, Any], trial: Trial) -> Iterator[str]:
    """Each number of a vector that is not ours, in words; an expectation that we do not know, too."""
    unknown = sorted({*document} - FIELDS) + sorted(
        f"expected.{key}" for key in {*document["expected"]} - {"total", "orders"}
    )
    if unknown:
        yield f"nobody compares {', '.join(unknown)}"
    if state_of(document) not in RULE_SETS:
        yield f"no rule set is of the state {state_of(document)!r}; known are {', '.join(RULE_SETS)}"
        return
    rules = prepared(RULE_SETS[state_of(document)])
    rule_set, measured = rules.rule_set, measure_trial(trial, rules)
    result = price_trial(measured, rule_set, NO_PROVENANCE)
    if result.score is None:
        undecided = [f for f in measured.findings.values() if f.verdict is Verdict.INCONCLUSIVE]
        because = "; ".join(f"{f.check} of {f.subject}: {f.message}" for f in undecided[:3])
        yield f"no score ({result.status}): {because}"
        return
    if result.score != document["expected"]["total"]:
        yield f"total: expected {document['expected']['total']:g}, got {result.score:f}"
    if "orders" in document["expected"]:
        yield from compare_orders(document["expected"]["orders"], rule_set, measured)


def compare_orders(
    expected: Mapping[str, Mapping[str, float]], rule_set: RuleSet, measured: Measured
) -> Iterator[str]:
    total = Expression.parse("total")
    totals = rule_set.sheet.evaluate_in(total, measured.scopes, measured.findings, level="order")
    # Printed as 0 while the order is not complete.
    times = {f.subject: f.quantities.get("time_taken_s", 0.0) for f in measured.of("order_time").values()}
    if set(expected) != set(totals):
        yield f"orders: expected {', '.join(sorted(expected))}, got {', '.join(sorted(totals))}"
        return
    for order, numbers in expected.items():
        for key, value in numbers.items():
            if key == "total":
                if totals[order].value != value:
                    yield f"{order} total: expected {value:g}, got {totals[order].value:g}"
            elif key == "time_taken_s":
                if in_ns(times[order]) != in_ns(value):
                    yield f"{order} time taken: expected {value!r} s, got {times[order]!r} s"
            else:
                yield f"nobody compares {order} {key}"


def in_ns(time_s: float) -> int:
    return round(time_s * 1e9)


# The harness itself --------------------------------------------------------------------


def vector(**changed: Any) -> dict[str, Any]:
    """One gear of 2020 where it was ordered, after 5 s: type, colour, bonus and pose make 4."""
    gear = {
        "type": "gear_part_red",
        "pose": {"position_m": [0.1, 0.0, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]},
    }
    place = {"agv": "agv1", "station": "", "tray": "", "products": [gear]}
    task = {"kind": "kitting", "id": "kit", **place}
    return {
        "case": "2020-made-0",
        "orders": [{"id": "order_0", "time_s": 1.0, "priority": 1, "tasks": [task]}],
        "submissions": [{"kind": "kitting", "task": "kit", "time_s": 6.0, **place}],
        "arm_collision": False,
        "floor_penalty": 0,
        "expected": {"total": 4.0, "orders": {"order_0": {"total": 4.0, "time_taken_s": 5.0}}},
        **changed,
    }


def expecting(total: float, order_total: float, time_taken_s: float) -> dict[str, Any]:
    orders = {"order_0": {"total": order_total, "time_taken_s": time_taken_s}}
    return vector(expected={"total": total, "orders": orders})


def written(folder: Path, name: str, *vectors: Any) -> Path:
    folder.mkdir(exist_ok=True)
    text = "".join(f"{one if isinstance(one, str) else json.dumps(one)}\n" for one in vectors)
    file = folder / name
    file.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return file


@pytest.mark.parametrize("name", ["made.jsonl", "made.jsonl.gz"])
def test_a_right_vector_passes_in_a_folder_of_ones_own(name: str, tmp_path: Path) -> None:
    file = written(tmp_path / "elsewhere", name, vector(), vector())

    assert files_in(tmp_path / "elsewhere") == [file]
    assert differences_in(file) == ([], 2)


WRONG: Mapping[str, tuple[Any, str]] = {
    "total": (expecting(5, 4, 5), "2020-made-0: total: expected 5, got 4"),
    "order": (expecting(4, 3, 5), "2020-made-0: order_0 total: expected 3, got 4"),
    "a nanosecond": (expecting(4, 4, 5.000000001), "time taken: expected 5.000000001 s, got 5.0 s"),
    "orders": (vector(expected={"total": 4, "orders": {}}), "orders: expected , got order_0"),
    "a misspelt total": (vector(expected={"total": 4, "tottal": 4}), "nobody compares expected.tottal"),
    "a number of an order": (
        vector(expected={"total": 4, "orders": {"order_0": {"sum": 4}}}),
        "nobody compares order_0 sum",
    ),
    "a field": (vector(human_collision=True), "nobody compares human_collision"),
    "a collision": (vector(arm_collision=True), "total: expected 4, got 0"),
    "a state": (vector(case="2019-made-0"), "no rule set is of the state '2019'"),
    "undecided": (
        vector(
            orders=[
                {
                    **vector()["orders"][0],
                    "tasks": [{**vector()["orders"][0]["tasks"][0], "kind": "combined"}],
                }
            ]
        ),
        "no score (incomplete): only_kitting of order_0",
    ),
    "a submission": (vector(submissions=[{"task": "kit"}]), "/1: KeyError("),
    "no total": (vector(expected={}), "/1: KeyError('total')"),
    "half a line": ("{", "not of the format ariac-official-vectors/1: JSONDecodeError"),
    "no object": ("[]", "not of the format ariac-official-vectors/1: TypeError"),
}
"""Vectors with one thing wrong, and the words for it."""


@pytest.mark.parametrize(("wrong", "words"), WRONG.values(), ids=list(WRONG))
def test_a_wrong_vector_is_named_with_its_trial_and_what_differs(
    wrong: Any, words: str, tmp_path: Path
) -> None:
    file = written(tmp_path, "made.jsonl", vector(), wrong, vector())

    (differing,), trials = differences_in(file)

    assert differing.startswith("  trial 2, ")
    assert words in differing
    assert trials == 3


def test_a_file_with_wrong_vectors_fails_and_lists_them(tmp_path: Path) -> None:
    file = written(tmp_path, "made.jsonl", vector(), *[expecting(5, 4, 5)] * (SHOWN + 1))

    with pytest.raises(pytest.fail.Exception) as failed:
        test_every_trial_scores_as_in_the_official_scorer(file, 1)

    lines = str(failed.value).splitlines()
    assert lines[0] == f"{file}: 21 of 22 trials differ from the official scorer"
    assert lines[1] == "  trial 2, 2020-made-0: total: expected 5, got 4"
    assert lines[-1] == "and 1 more"


def test_an_empty_file_of_vectors_fails(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="holds no trial"):
        test_every_trial_scores_as_in_the_official_scorer(written(tmp_path, "made.jsonl"), 1)
