"""What a competition unlike ours asks of the core: twenty needs, a test for each.

A crane hangs lamps. Its distribution brings what is its own (readers, a decoder, checks); whatever it cannot
do itself, the core does. Expected numbers are worked out by hand beside the tests.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Result, as_json, load_log_map, load_result, score_trial
from ariac_score.checks.registry import package_sha256
from ariac_score.cli import main
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED

Install = Callable[..., str]

SOURCE = '''
import json
import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from ariac_score import (
    Body, Event, Finding, Item, LogDefect, LogDescription, Measure, OfficialResult, ReaderFacts, Series,
    SignalNeed, Span, Trial,
)


class Trace:
    """Messages in the order in which the official program takes them: `stamp what number`."""

    facts = ReaderFacts(a_file="a trace of the crane", formats="traces")

    def can_read(self, path):
        return path.suffix == ".trace"

    def describe(self, path):
        return LogDescription("trace")

    def read(self, path, wanted):
        base, places, forces = None, [], []
        for line in path.read_text().splitlines():
            t_s, what, number = line.split()
            if what == "base":  # fixed to the world; said again, the new one counts
                base = float(number)
            elif what == "hook" and base is not None:  # asked after each message, as far as is known then
                places.append((float(t_s), base + float(number)))
            elif what == "force":
                forces.append((float(t_s), float(number)))
        found = {}
        for name, unit, rows in (("place/hook", "m", places), ("force/hook", "N", forces)):
            if rows:
                t, values = np.array(rows).T
                found[name] = Series(name, unit, t, values)
        return Trial(path.stem, bodies=(Body("hook", "hook"),), as_consumed=found, recorded=Span(0.0, 10.0))


class Sheet:
    """What the recording does not say: lamps, facts, when the task began and ended."""

    facts = ReaderFacts("sheet", "a sheet", "sheets (sheet.json)")

    def can_read(self, path):
        return path.name == "sheet.json"

    def describe(self, path):
        return LogDescription("sheet")

    def read(self, path, wanted):
        data = json.loads(path.read_text())
        lamps = tuple(Item(one["id"], "lamp", {"socket": one["socket"]}) for one in data.get("lamps", ()))
        events = tuple(Event(t_s, kind) for t_s, kind in data.get("events", ()))
        return Trial(path.parent.name, work=lamps, facts=data.get("facts", {}), events=events)


class Official:
    """The number that the official program printed."""

    facts = ReaderFacts("official", "an official text", "official texts (printed.txt)")

    def can_read(self, path):
        return path.name == "printed.txt"

    def describe(self, path):
        return LogDescription("official text")

    def read(self, path, wanted):
        text = path.read_text().strip()
        printed = OfficialResult(path.name, float(text), None, items={"final_score": text})
        return Trial(path.parent.name, official=printed)


class Markers:
    """Lines of a text log that say when the final began and ended."""

    def decode(self, msgtype, message, t_s):
        for word, kind in (("GO!", "competition_started"), ("STOP", "competition_ended")):
            if word in message.data:
                return Event(t_s, kind)
        return None


@dataclass(frozen=True)
class Measured:
    """Numbers of a run: how long the hook was pulled, how far it went, how it jerked, how fast it was."""

    quantity: str = "force"
    unit: str = "N"
    limit_n: float = 20.0
    measures: ClassVar = {
        "above_s": Measure("s", signed=True),
        "path_m": Measure("m"),
        "jerk_m_s3": Measure("m/s3", signed=True),
        "fastest_m_s": Measure("m/s"),
        "samples": Measure("count"),
    }

    def needs(self):
        return [SignalNeed(self.quantity, self.unit, max_gap_s=math.inf)]

    def watch(self, trial):
        name = f"{self.quantity}/hook"
        if name in trial.as_consumed:
            one = trial.series(name, unit=self.unit)
        else:
            one = trial.signal(name, unit=self.unit)
        yield replace(Finding.satisfied("hook", "measured"), quantities=self.numbers(one.t, one.values))

    def numbers(self, t, values):
        found = {"samples": float(len(t))}
        if self.quantity == "force":
            found["above_s"] = sum(
                float(t[i + 1] - t[i]) for i in range(len(t) - 1) if values[i] > self.limit_n
            )
        if self.quantity == "place":
            found["path_m"] = sum(abs(float(b - a)) for a, b in pairwise(values))
            if len(t) == 4:  # 6 times the third divided difference: the jerk of the cubic through them
                level = list(values)
                for k in (1, 2, 3):
                    level = [(b - a) / (t[i + k] - t[i]) for i, (a, b) in enumerate(pairwise(level))]
                found["jerk_m_s3"] = 6.0 * float(level[0])
        if values.ndim == 2:
            found["fastest_m_s"] = max(math.sqrt(float(x * x + y * y + z * z)) for x, y, z in values)
        return found


@dataclass(frozen=True)
class Hung:
    """How each lamp hangs: 0 not at all, 1 beside its socket, 2 partly in it, 3 home."""

    measures: ClassVar = {"case": Measure("1"), "depth_m": Measure("m")}
    level = "lamp"

    def judge(self, trial, item):
        depth_m = trial.facts.get(f"{item.id}_depth_m")
        case = 0 if depth_m is None else 3 if depth_m >= 0.02 else 2 if depth_m > 0 else 1
        made = Finding.satisfied if case == 3 else Finding.violated
        found = {"case": float(case), **({"depth_m": depth_m} if case == 2 else {})}
        yield replace(made(item.id, f"case {case}"), quantities=found)


@dataclass(frozen=True)
class Untouched:
    """Nobody touched a lamp, as far as the log would show it."""

    def needs(self):
        return []

    def watch(self, trial):
        if any(event.kind == "touch" for event in trial.events):
            yield Finding.violated("trial", "a lamp was touched")
        elif "touch" in trial.witnessed:
            yield Finding.satisfied("trial", "no lamp was touched")
        else:
            yield Finding.inconclusive("trial", "the log records no touches")


@dataclass(frozen=True)
class Lamps:
    """The competition: a lamp listed twice is counted twice, as the official program does, and said so."""

    levels: ClassVar = ("lamp", "trial")
    facts: ClassVar = {"lamp": {"socket": {"type": "text"}}}

    def defects(self, trial):
        if len(trial.work) > 1 and trial.facts.get("listed_twice"):
            return [LogDefect("unknown_item", "lamps", 1, "the second lamp is listed twice, and counted so")]
        return []
'''
POINTS = {
    "readers": {"lamps.trace": "Trace", "lamps.sheet": "Sheet", "lamps.official": "Official"},
    "decoders": {"lamps.markers": "Markers"},
    "monitors": {"lamps.measured": "Measured", "lamps.untouched": "Untouched"},
    "competitions": {"lamps": "Lamps"},
}
LOG_MAP = """\
id: lamps
title: Lamps
source: this test
bodies: {hook: {kind: hook}}
frames: [{match: "{crane}/{tool}_link", kind: hook, body: hook}]
quantities:
  force: {unit: N, of: body}
  place: {unit: m, of: body}
  swing: {unit: m/s, of: body, components: 3}
channels:
  - {topic: /log, type: std_msgs/msg/String, decoder: lamps.markers, stamp: log}
"""


@pytest.fixture(autouse=True)
def folder(install: Install, tmp_path: Path) -> Iterator[Path]:
    """The folder of a run, where the distribution of the competition is installed."""
    groups = {f"ariac_score.{group}": points for group, points in POINTS.items()}
    install("lamp-score", {"lamps.hung": "Hung"}, source=SOURCE, group="ariac_score.rules", also=groups)
    run = tmp_path / "run"
    run.mkdir()
    (tmp_path / "lamps.yaml").write_text(LOG_MAP, encoding="utf-8")
    yield run
    package_sha256.cache_clear()


def write_rules(folder: Path, score: str, more: str = "") -> Path:
    path = folder.parent / "rules.yaml"
    head = "id: lamps\ntitle: Lamps\nsource: this test\nlog_map: lamps.yaml\nwindow: recording\n"
    path.write_text(f"{head}{more}\nscore: {score}\n", encoding="utf-8")
    return path


def scored(folder: Path, score: str, more: str = "") -> Result:
    return score_trial(folder, write_rules(folder, score, more))


def measured(folder: Path, score: str, **parameters: str) -> Decimal | None:
    return scored(
        folder, score, f"monitors: {{hook: {{use: lamps.measured, with: {json.dumps(parameters)}}}}}"
    ).score


def write_trace(folder: Path, *lines: str) -> None:
    (folder / "run.trace").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_sheet(folder: Path, **data: Any) -> None:
    (folder / "sheet.json").write_text(json.dumps(data), encoding="utf-8")


def write_log(folder: Path, *records: dict[str, Any], **head: Any) -> None:
    first = {"record": "trial", "format": "ariac-score-trial-log/1", "id": "run", **head}
    body = {"record": "body", "id": "hook", "kind": "hook"}
    lines = [first, body, *records, {"record": "end", "records": len(records) + 3}]
    (folder / "run.jsonl").write_text("".join(f"{json.dumps(one)}\n" for one in lines), encoding="utf-8")


def samples(name: str, *rows: tuple[float, Any]) -> list[dict[str, Any]]:
    return [{"record": "sample", "t_s": t_s, "values": {name: value}} for t_s, value in rows]


PULLED = (("0.0", 30), ("0.5", 10), ("0.5", 40), ("0.25", 50))


def test_01_numbers_are_taken_in_the_order_of_the_official_program(folder: Path) -> None:
    write_trace(folder, *(f"{t} force {n}" for t, n in PULLED))

    # 30 N stand for 0.5 s, 40 N for -0.25 s, for the stamp runs back; the last message for nothing.
    assert measured(folder, "measure(hook, above_s)") == Decimal("0.25")


def test_02_a_reader_chains_transforms_as_the_official_program_knew_them_then(folder: Path) -> None:
    write_trace(folder, "0 hook 1", "0 base 1", "1 hook 2", "1 base 5", "2 hook 2")

    # Before the base is known nothing is asked; then 1 + 2 and 5 + 2: no place is made in between.
    assert measured(folder, "measure(hook, path_m)", quantity="place", unit="m") == 4


def test_03_names_of_frames_come_from_the_configuration(folder: Path) -> None:
    log_map = load_log_map(folder.parent / "lamps.yaml").filled({"crane": "north", "tool": "claw"})

    assert [frame.match for frame in log_map.frames] == ["north/claw_link"]


LAMPS = [{"id": "a", "socket": "wall"}, {"id": "b", "socket": "ceiling"}]


def test_04_a_task_is_whatever_the_competition_says_it_is(folder: Path) -> None:
    write_trace(folder, "0 base 0")
    write_sheet(folder, lamps=LAMPS)

    result = scored(
        folder,
        "sum(lamp.worth)",
        'competition: {use: lamps}\nterms: {lamp: {worth: 3 if lamp.socket == "ceiling" else 2}}',
    )

    assert result.score == 5
    assert [scope.path for scope in result.measured.scopes.each("lamp")] == ["a", "b"]


DONE = "facts: {trial: {done_s: number}}"
BY_TIME = "0 if absent(trial.done_s) else 12 - trial.done_s"


def test_05_begin_and_end_come_from_beside_the_recording_and_an_end_may_be_known_not_to_be(
    folder: Path,
) -> None:
    write_trace(folder, "0 base 0")
    ends = [[2.0, COMPETITION_STARTED], [7.0, COMPETITION_ENDED]]

    write_sheet(folder, events=ends, facts={"done_s": 4})
    result = scored(folder, f"trial.duration_s + ({BY_TIME})", DONE)
    assert (result.score, result.measured.window.start_s) == (5 + 8, 2.0)  # type: ignore[union-attr]

    write_sheet(folder, events=ends, facts={"done_s": None})
    assert scored(folder, BY_TIME, DONE).score == 0
    write_sheet(folder, events=ends)
    assert scored(folder, BY_TIME, DONE).status == "incomplete"


def test_06_facts_may_be_texts(folder: Path) -> None:
    write_trace(folder, "0 base 0")
    write_sheet(folder, facts={"arena": "pier"})

    assert scored(folder, '7 if trial.arena == "pier" else 1', "facts: {trial: {arena: text}}").score == 7


def test_07_a_quantity_of_ones_own_may_be_a_vector(folder: Path) -> None:
    of = {"swing": {"unit": "m/s", "of": "body", "components": 3}}
    write_log(folder, *samples("swing/hook", (0.0, [0, 0, 0]), (0.1, [0.2, 0.3, 0.6])), quantities=of)

    # 0.2^2 + 0.3^2 + 0.6^2 = 0.49
    fastest = measured(folder, "measure(hook, fastest_m_s)", quantity="swing", unit="m/s")
    assert fastest == Decimal("0.7")


def test_08_stamps_may_repeat_where_an_official_program_counts_them_so_and_nowhere_else(folder: Path) -> None:
    of = {"force": {"unit": "N", "of": "body"}}
    rows = samples("force/hook", (0.0, 30.0), (0.5, 10.0), (0.5, 40.0), (1.0, 50.0))

    write_log(folder, *rows, quantities=of, as_consumed=["force/hook"])
    assert measured(folder, "measure(hook, samples)") == 4
    write_log(folder, *rows, quantities=of)  # of two values at one time neither is known to be right
    assert measured(folder, "measure(hook, samples)") == 2


def test_09_what_a_check_adds_up_is_priced_by_the_rules(folder: Path) -> None:
    write_trace(folder, "0 force 30", "3 force 10", "4 force 25", "6 force 0")

    # Above 20 N for 3 s and 2 s, twice a point a second.
    assert measured(folder, "40 - 2 * measure(hook, above_s)") == 30
    assert measured(folder, "40 - 2 * count(hook)") == 40


def test_10_a_derivative_on_uneven_stamps_is_the_business_of_its_monitor(folder: Path) -> None:
    write_trace(folder, "0 base 0", *(f"{t} hook {t**3}" for t in (0, 1, 3, 4)))

    # The third derivative of t^3 is 6, wherever it is sampled.
    assert measured(folder, "measure(hook, jerk_m_s3)", quantity="place", unit="m") == 6


RAMP = ((60, 5, 12), (60, 4.9, 12), (60, 60, 0), (60, 61, 0), (60, 32.5, 6), (5, 5, 0), (5, 4.9, 12))


@pytest.mark.slow
def test_11_points_fall_along_a_ramp_whose_worst_end_counts_first(folder: Path) -> None:
    write_trace(folder, "0 base 0")
    for high, taken, points in RAMP:
        write_sheet(folder, facts={"taken": taken})
        formula = f"ramp(12, 0, {high}, 5, trial.taken)"
        assert scored(folder, formula, "facts: {trial: {taken: number}}").score == points


def test_12_a_tier_counts_only_where_the_one_above_it_does(folder: Path) -> None:
    write_trace(folder, "0 base 0")
    tiers = "third: 50 * trial.lit, second: 10 * trial.hung if third > 0 else 0"
    more = f"facts: {{trial: {{lit: number, hung: number}}}}\nterms: {{trial: {{{tiers}}}}}"
    for lit, hung, points in ((1, 1, 60), (0, 1, 0), (1, 0, 50)):
        write_sheet(folder, facts={"lit": lit, "hung": hung})
        assert scored(folder, "third + second", more).score == points


def test_13_a_verdict_may_have_four_kinds_and_each_its_price(folder: Path) -> None:
    write_trace(folder, "0 base 0")
    partly = "1000 * measure(hung, depth_m) if case == 2 else 5 if case == 1 else 0"
    terms = f"{{case: 'measure(hung, case)', worth: '60 if case == 3 else {partly}'}}"
    more = f"competition: {{use: lamps}}\nrules: {{hung: {{use: lamps.hung}}}}\nterms: {{lamp: {terms}}}"
    for depth_m, points in ((0.02, "60"), (0.0199, "19.9"), (0.0, "5"), (-0.1, "5"), (None, "0")):
        write_sheet(folder, lamps=LAMPS[:1], facts={} if depth_m is None else {"a_depth_m": depth_m})
        assert scored(folder, "sum(lamp.worth)", more).score == Decimal(points)


def write_competition(root: Path, taken: dict[tuple[str, str], float]) -> Path:
    """A competition of two trials whose names have the character that divides names from numbers."""
    (root / "trials").mkdir()
    for trial in ("two_lamps", "two_lamps_2"):
        (root / "trials" / trial).mkdir()
    for (team, run), value in taken.items():
        place = root / "logs" / team / run
        place.mkdir(parents=True)
        write_trace(place, "0 base 0")
        write_sheet(place, facts={"taken": value})
    write_rules(root / "x", "20 - trial.taken", "facts: {trial: {taken: number}}")
    (root / "competition.yaml").write_text(
        "id: lamps\nrules: rules.yaml\nruns: logs/{team}/{trial}_{run}\n"
        "trials: [{id: two_lamps}, {id: two_lamps_2}]\n",
        encoding="utf-8",
    )
    return root


RUNS = {
    ("ebb", "two_lamps_1"): 5.0,
    ("ebb", "two_lamps_2_1"): 6.0,
    ("tide", "two_lamps_1"): 1.0,
    ("tide", "two_lamps_2_1"): 2.0,
}


@pytest.mark.slow
def test_14_the_trials_of_a_team_add_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rank", str(write_competition(tmp_path, RUNS)), "--output-format", "json"]) == 0

    standings = json.loads(capsys.readouterr().out)["standings"]
    # 20 - 1 + 20 - 2 and 20 - 5 + 20 - 6
    assert [(one["team"], one["execution"]) for one in standings] == [("tide", 37), ("ebb", 29)]


THIRD = "trial.taken / 3"


def audited(folder: Path, printed: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    write_trace(folder, "0 base 0")
    write_sheet(folder, facts={"taken": 7})
    (folder / "printed.txt").write_text(printed, encoding="utf-8")
    more = (
        "facts: {trial: {taken: number}}\nround: 9\nprinted: {layouts: [lamps], trial: {final_score: score}}"
    )
    rules = write_rules(folder, THIRD, more)
    code = main(["audit", str(folder), "--rules", str(rules)])
    return code, capsys.readouterr().out


@pytest.mark.slow
def test_15_what_the_official_program_printed_is_held_against_our_score(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = audited(folder, "2.4", capsys)

    assert "differ 1" in text
    assert code == 1


def test_16_a_run_is_joined_to_its_trial_though_names_hold_the_dividing_character(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rank", str(write_competition(tmp_path, RUNS)), "--output-format", "json"]) == 0

    runs = json.loads(capsys.readouterr().out)["runs"]
    assert {(one["trial"], one["run"]) for one in runs} == {("two_lamps", 1), ("two_lamps_2", 1)}


@pytest.mark.parametrize(
    ("events", "policy", "status", "score"),
    [
        ([], "withhold", "incomplete", None),  # the log would not have shown it: that is no proof
        ([], "exclude", "scored", 10),
        ([{"kind": "watching", "subject": "touch"}], "withhold", "scored", 10),
        ([{"kind": "touch"}], "withhold", "scored", 7),
    ],
)
def test_17_silence_is_innocence_only_where_the_log_would_have_shown_it(
    folder: Path, events: Sequence[dict[str, str]], policy: str, status: str, score: int | None
) -> None:
    write_log(folder, *({"record": "event", "t_s": 1.0, **event} for event in events))

    more = f"monitors: {{calm: {{use: lamps.untouched, on_inconclusive: {policy}}}}}"
    result = scored(folder, "10 - 3 * count(calm)", more)
    assert (result.status, result.score) == (status, score)


def test_18_what_the_official_program_counts_twice_is_counted_so_and_said(folder: Path) -> None:
    write_trace(folder, "0 base 0")
    write_sheet(folder, lamps=LAMPS, facts={"listed_twice": 1})

    result = scored(folder, "2 * count(lamp)", "competition: {use: lamps}")

    assert result.score == 4
    assert "the second lamp is listed twice, and counted so" in {
        defect.message for defect in result.measured.log_defects
    }


def test_19_a_text_in_a_log_by_the_time_it_was_recorded_begins_and_ends_a_final(folder: Path) -> None:
    texts = [(1, "warm-up"), (3, "referee: GO!"), (8, "crane: STOP pressed"), (9, "bye")]
    write_sheet(folder, facts={"crane": "north", "tool": "claw"})
    messages = [Recorded("/log", "std_msgs/msg/String", t * 10**9, {"data": text}) for t, text in texts]
    write_bag(folder / "final.mcap", messages, storage="mcap")

    assert scored(folder, "trial.duration_s").score == 5


@pytest.mark.slow
def test_20_official_numbers_have_more_digits_than_ours_and_agree_within_ours(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = audited(folder, "2.3333333333333335", capsys)  # 7 / 3 as a program prints it

    assert "agree 1" in text
    assert code == 0
    result = scored(folder, THIRD, "facts: {trial: {taken: number}}\nround: 9")
    assert result.score == Decimal("2.333333333")
    (tmp_path / "result.json").write_text(as_json(result), encoding="utf-8")
    assert load_result(tmp_path / "result.json") == result
