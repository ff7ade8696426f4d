"""The contract checks: every plugin of ours passes them, and every kind of bad one is named."""

from __future__ import annotations

import dataclasses
import re
import sqlite3
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import (
    QUANTITIES,
    Body,
    Event,
    Finding,
    InstantVerdict,
    Sample,
    SignalNeed,
    Span,
    Trial,
    Verdict,
)
from ariac_score.checks.registry import Registry
from ariac_score.errors import LogError, PluginError
from ariac_score.testing import (
    SNAPSHOT_SIGNALS,
    ContractCheck,
    ContractError,
    contract_checks,
    write_event_log,
    write_trial_log,
)
from ariac_score.testing.pages import example_parameters
from ariac_score.testing.variants import SIGNAL_VARIANTS, reordered, shifted
from ariac_score_ariac.testing import kitting_trial, made_trial
from ariac_score_ariac.testing.official_database import write_database_competition
from ariac_score_ariac.testing.recordings import recorded_messages

Install = Callable[..., str]

RULES, MONITORS, READERS = "ariac_score.rules", "ariac_score.monitors", "ariac_score.readers"
ROOT = Path(__file__).parents[2]
MADE = made_trial()
REGISTRY = Registry()


def first_party(group: str) -> list[str]:
    return [p.name for p in REGISTRY.all(group) if p.distribution == "ariac-score"]


# Ours ----------------------------------------------------------------------------------


def test_the_made_trial_has_every_quantity_there_is() -> None:
    assert {name.partition("/")[0] for name in MADE.signals} == set(QUANTITIES)


def test_the_made_trial_is_the_same_every_time() -> None:
    other = made_trial()

    assert [*other.signals] == [*MADE.signals]
    for name, signal in other.signals.items():
        np.testing.assert_array_equal(signal.values, MADE.signals[name].values)


MUST_BE_TOLD = {"stl.formula"}
"""Without parameters it has nothing to judge, and refuses."""


@pytest.mark.slow
@pytest.mark.parametrize("name", first_party(MONITORS))
def test_every_monitor_of_ours_keeps_the_contract(name: str) -> None:
    found = REGISTRY.find(MONITORS, name)
    plain = [] if name in MUST_BE_TOLD else [found.build({})]
    for plugin in (*plain, found.build(example_parameters(found))):
        for trial in (MADE, kitting_trial()):
            for check in contract_checks(plugin, trial):
                check()


FURTHER: tuple[tuple[str, dict[str, Any]], ...] = (
    ("iso_ts_15066.ssm_separation", {"profile": "standard", "human_speed": "by_distance"}),
    ("iso_ts_15066.ssm_response", {"profile": "standard", "stop_model": "deceleration"}),
    (
        "iso_ts_15066.ssm_response",
        {"profile": "standard", "stop_model": "deceleration", "human_speed": "measured"},
    ),
    ("iso_10218_2.pfl_contact", {"region": "hand"}),
    ("iso_10218_2.pfl_speed", {"region": "hand"}),
    ("iso_10218_1.space_limit", {"keep_out": [[[0, 0], [2, 0], [2, 2], [0, 2]]], "keep_out_z_m": [0, 1]}),
    ("iso_10218_1.reduced_speed", {"applies": "manual_mode", "speed": "tcp_speed"}),
    ("iso_13850.estop_restart", {"after": ["emergency_stop", "protective_stop"]}),
    ("log.signal_coverage", {"share_of": "exposure", "quantities": ["position", "speed"]}),
)
"""Monitors that work in another way with these parameters."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameters"), FURTHER)
def test_the_contract_is_kept_with_other_parameters_too(name: str, parameters: dict[str, Any]) -> None:
    for check in contract_checks(REGISTRY.find(MONITORS, name).build(parameters), MADE):
        check()


@pytest.mark.parametrize("name", first_party(RULES))
def test_every_rule_of_ours_keeps_the_contract(name: str) -> None:
    found = REGISTRY.find(RULES, name)
    for plugin in (found.build({}), found.build(example_parameters(found))):
        for trial in (MADE, kitting_trial()):
            for check in contract_checks(plugin, trial):
                check()


STATES = "".join(
    f"<sdf version='1.6'><state world_name='w'><sim_time>{k // 10} {k % 10}00000000</sim_time>"
    f"<model name='gantry'><pose>{k / 100} 0 0 0 0 0 </pose></model></state></sdf>"
    for k in range(30)
)
STATE_LOG = (
    "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<log_version>1.0</log_version>\n</header>\n"
    "<chunk encoding='txt'>\n<![CDATA[<sdf version ='1.6'><world name='w'></world></sdf>]]>\n</chunk>\n"
    f"<chunk encoding='txt'>\n<![CDATA[{STATES}]]>\n</chunk>\n</gazebo_log>\n"
)
RUN_2024 = ROOT / "examples/competition/2024/logs/aurora/assembly_1"


def _database(folder: Path) -> Path:
    """A database of one run."""
    path = folder / "results.db"
    write_database_competition(path)
    connection = sqlite3.connect(path)
    for table, column in (("Run", "id"), ("Penalty", "run_id"), ("OrderSubmission", "run_id")):
        connection.execute(f"DELETE FROM {table} WHERE {column} <> 1")  # noqa: S608  # our own words
    connection.commit()
    connection.close()
    return path


def _written(name: str, text: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text(text, encoding="utf-8")
        return folder / name

    return write


RUN_2026 = ROOT / "examples/aic/run"

LOGS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "aic.bag": (lambda _: RUN_2026 / "bag_trial_1_20260520_101112_345", ""),
    "aic.config": (lambda _: RUN_2026 / "engine_config.yaml", ""),
    "aic.scoring": (lambda _: RUN_2026 / "scoring.yaml", ""),
    "aic.task_times": (lambda _: RUN_2026 / "task_times.yaml", ""),
    "ariac_config": (lambda _: ROOT / "tests/data/trial_2022.yaml", ""),
    "ariac_database": (_database, ""),
    "ariac_team": (_written("team.yaml", "sensors:\n  b: {type: break_beam}\n"), ""),
    "ariac_team_name": (_written("team.yaml", "team_name: aurora\ngithub: {}\n"), ""),
    "gazebo": (_written("state.log", STATE_LOG), "ariac2020"),
    "gazebo_text": (lambda _: ROOT / "tests/data/performance_2022.log", ""),
    "jsonl": (
        lambda folder: write_trial_log(folder / "t.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS),
        "",
    ),
    "ros_monitoring": (
        lambda folder: write_event_log(folder / "e.jsonl", list(recorded_messages(kitting_trial()))),
        "ariac2020",
    ),
    "rosbag": (lambda _: ROOT / "examples/kitting_near_miss.mcap", "ariac2020"),
    "sensor_cost": (lambda _: RUN_2024 / "sensor_cost.txt", ""),
    "trial_log": (lambda _: RUN_2024 / "trial_log.txt", ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first_party(READERS))
def test_every_reader_of_ours_keeps_the_contract(name: str, tmp_path: Path) -> None:
    make, log_map = LOGS[name]
    reader = REGISTRY.find(READERS, name).build({})

    for check in contract_checks(reader, make(tmp_path), log_map=log_map):
        check()


# Trials changed in one respect ---------------------------------------------------------


def test_a_shifted_trial_is_the_same_trial_later() -> None:
    later = shifted(MADE, 8.0)

    assert later.window is not None
    assert MADE.window is not None
    assert later.window.start_s == MADE.window.start_s + 8.0
    assert [o.announced_s for o in later.work] == [o.announced_s + 8.0 for o in MADE.work if o.announced_s]
    assert shifted(later, -8.0).events == MADE.events


def test_a_reordered_trial_has_the_same_signals() -> None:
    assert [*reordered(MADE).signals] == [*MADE.signals][::-1]
    assert dict(reordered(MADE).signals) == dict(MADE.signals)


@pytest.mark.parametrize("name", SIGNAL_VARIANTS)
def test_a_fault_of_the_recorder_changes_every_signal(name: str) -> None:
    changed = SIGNAL_VARIANTS[name](MADE)

    for signal, before in ((changed.signals[n], MADE.signals[n]) for n in MADE.signals):
        assert len(signal) < len(before)
        assert np.isfinite(signal.values).all()


# Strangers -----------------------------------------------------------------------------

GOOD = """
from dataclasses import dataclass
import numpy as np
from ariac_score import Event, Finding, Sample, SignalNeed, Span, Verdict

STATE = []

@dataclass(frozen=True)
class Plugin:
    '''Robots are slow.

    Measures:
        The speed of every robot.
    Violated when:
        It is above the limit.
    Source:
        Nobody.
    '''

    limit_m_s: float = 0.25

    def needs(self):
        yield SignalNeed("speed", "m/s")

    def watch(self, trial):
        for robot in trial.bodies_of("robot") or (None,):
            if robot is None:
                yield Finding.inconclusive("trial", "no robot")
                return
            speed = trial.signal(f"speed/{robot.id}", unit="m/s")
            if len(speed) < 3:
                yield Finding.inconclusive(robot.id, "too few samples", span=trial.window)
                return
            worst = int(np.argmax(speed.values))
            margin = self.limit_m_s - float(speed.values[worst])
            words = f"{speed.values[worst]:.3f} m/s at {speed.t[worst]:.3f} s"
            yield Finding(robot.id, Verdict.of(margin), words,
                          span=speed.span, robustness=margin, unit="m/s", evidence=(speed.sample(worst),))
"""

SPEAK = '        for robot in trial.bodies_of("robot") or (None,):\n'
FIRST = "            worst = int(np.argmax(speed.values))\n"
SIGNAL = '            speed = trial.signal(f"speed/{robot.id}", unit="m/s")\n'
NEEDS = '        yield SignalNeed("speed", "m/s")\n'
FIELD = "    limit_m_s: float = 0.25\n"

BAD: dict[str, tuple[str, str, str, str]] = {
    "has no source": ("    Source:\n        Nobody.\n", "", "docstring_sections", "no section 'Source'"),
    "has no docstring": ("'''Robots", "''\n    x = '''Robots", "docstring_sections", "'Measures'"),
    "takes a parameter by position": (
        FIELD,
        "    def __init__(self, limit_m_s=0.25, /):\n        self.__dict__['limit_m_s'] = limit_m_s\n",
        "built_by_name",
        "takes 'limit_m_s' by position alone",
    ),
    "takes any parameter": (
        FIELD,
        "    def __init__(self, **limits):\n        self.__dict__['limit_m_s'] = 0.25\n",
        "built_by_name",
        "takes *limits",
    ),
    "can be changed": ("(frozen=True)", "", "built_by_name", "not frozen"),
    "can be built only once": (
        FIELD,
        FIELD
        + "    def __post_init__(self):\n        STATE.append(1)\n        if len(STATE) > 1:\n"
        + "            raise RuntimeError('again')\n",
        "built_by_name",
        "cannot be built: RuntimeError: again",
    ),
    "makes something else when built": (
        FIELD,
        FIELD
        + "    def __new__(cls, limit_m_s=0.25):\n        STATE.append(1)\n"
        + "        return object.__new__(cls) if len(STATE) == 1 else None\n",
        "built_by_name",
        "makes a NoneType",
    ),
    "runs too long": (
        SPEAK,
        "        while True:\n            x = 0\n            try:\n                x = 1\n"
        "            except Exception:\n                pass\n" + SPEAK,
        "time_budget",
        "ran longer than its budget of 0.05",
    ),
    "prints": (
        SPEAK,
        "        print('hello\\nthere')\n" + SPEAK,
        "prints_nothing",
        "printed 'hello' and 1 more",
    ),
    "raises": (SPEAK, "        raise KeyError('x')\n" + SPEAK, "at_least_one_finding", "raised KeyError"),
    "returns None": (
        SPEAK,
        "        return None\n    def other(self, trial):\n" + SPEAK,
        "at_least_one_finding",
        "raised TypeError",
    ),
    "says nothing": (
        SPEAK,
        "        return []\n    def other(self, trial):\n" + SPEAK,
        "at_least_one_finding",
        "says nothing",
    ),
    "says nothing without robots": (
        '                yield Finding.inconclusive("trial", "no robot")\n',
        "",
        "at_least_one_finding",
        "says nothing",
    ),
    "yields a word": (SPEAK, "        yield 'fine'\n" + SPEAK, "at_least_one_finding", "yields a str"),
    "yields NaN": (
        SPEAK,
        "        yield Finding('trial', Verdict.VIOLATED, 'x', robustness=float('nan'), unit='m')\n" + SPEAK,
        "at_least_one_finding",
        "its robustness is nan, which is no finite number",
    ),
    "has a margin without unit": (
        'unit="m/s", evidence',
        "evidence",
        "possible_findings",
        "its unit is empty, but it has a margin of -",
    ),
    "has evidence without unit": (
        "(speed.sample(worst),)",
        "(Sample('speed', float(speed.t[worst]), 1.0, ''),)",
        "possible_findings",
        "its evidence 1 gives 'speed' without a unit",
    ),
    "has evidence in another unit": (
        "(speed.sample(worst),)",
        "(Sample(speed.name, float(speed.t[worst]), 1.0, 'km/h'),)",
        "possible_findings",
        "in 'km/h', recorded in 'm/s'",
    ),
    "speaks of another time": (
        "span=speed.span",
        "span=Span(0.0, 1e4)",
        "possible_findings",
        "gives the time 10000 s",
    ),
    "counts its calls": (
        SPEAK,
        "        STATE.append(1)\n        yield Finding.violated('trial', f'call {len(STATE)}')\n" + SPEAK,
        "same_trial_same_findings",
        "other findings the second time: violated trial 'call 1', then violated trial 'call 2'",
    ),
    "changes the trial": (
        SPEAK,
        "        object.__setattr__(trial, 'events', ())\n" + SPEAK,
        "trial_unchanged",
        "changed the trial",
    ),
    "changes an order": (
        SPEAK,
        "        object.__setattr__(trial.work[0], 'id', trial.work[0].id + 'x')\n" + SPEAK,
        "trial_unchanged",
        "changed the trial",
    ),
    "writes into a signal": (
        FIRST,
        "            speed.values.setflags(write=True)\n" + FIRST,
        "trial_unchanged",
        "raised ValueError",
    ),
    "takes the first signal": (
        SIGNAL,
        "            speed = trial.signals[next(n for n in trial.signals if n.startswith('speed/'))]\n",
        "order_of_signals",
        "depends on the order of signals",
    ),
    "counts from zero": (
        "margin = self.limit_m_s -",
        "margin = float(speed.t[worst]) -",
        "time_shift",
        "on a clock 64 s ahead",
    ),
    "reads more than it says": (
        NEEDS,
        "        return iter(())\n",
        "needs_declared",
        "does not say it needs",
    ),
    "needs another unit": (NEEDS, NEEDS.replace("m/s", "km/h"), "needs_declared", "needs 'speed' in 'km/h'"),
    "needs a word": (NEEDS, "        yield 'speed'\n", "needs_declared", "needs a str"),
    "accepts no gap": (NEEDS, NEEDS.replace('"m/s"', '"m/s", 0.0'), "needs_declared", "accepts no gap"),
    "assumes what is missing": (
        SIGNAL,
        "            if f'speed/{robot.id}' not in trial.signals:\n"
        "                yield Finding.satisfied(robot.id, 'nothing seen')\n                return\n"
        + SIGNAL,
        "missing_signals",
        "is satisfied although every signal it needs is missing",
    ),
    "waves away what is missing": (
        SIGNAL,
        "            if f'speed/{robot.id}' not in trial.signals:\n"
        "                yield Finding.not_applicable(robot.id, 'nothing seen')\n                return\n"
        + SIGNAL,
        "missing_signals",
        "is never inconclusive",
    ),
    "guesses from one sample": (
        "if len(speed) < 3:",
        "if not len(speed):",
        "first_and_last_sample",
        "show nothing",
    ),
    "trips over an empty signal": (
        "if len(speed) < 3:",
        "if len(speed) == 1:",
        "empty_signal",
        "raised ValueError",
    ),
    "begins nothing": (
        FIELD,
        FIELD + "    def begin(self, bodies=()):\n        return None\n",
        "one_by_one",
        "begins a NoneType",
    ),
}


def stranger(install: Install, source: str, version: str = "6.6") -> Any:
    install("odd-monitors", {"odd.monitor": "Plugin"}, source=source, version=version, group=MONITORS)
    return Registry().find(MONITORS, "odd.monitor").load()()


def checks_of(plugin: Any, **options: Any) -> dict[str, ContractCheck]:
    # A trial of its own: some of them do change it.
    return {check.name: check for check in contract_checks(plugin, made_trial(), **options)}


def test_a_good_stranger_passes_every_check(install: Install) -> None:
    slow_enough = GOOD.replace("0.25", "2.5")  # it is satisfied where the other is violated
    for check in checks_of(stranger(install, slow_enough)).values():
        check()


@pytest.mark.parametrize("name", BAD)
def test_a_bad_stranger_is_named_with_distribution_and_version(install: Install, name: str) -> None:
    old, new, check, words = BAD[name]
    assert GOOD.count(old) == 1
    limit = "2.5" if check in ("first_and_last_sample", "missing_signals") else "0.25"
    plugin = stranger(install, GOOD.replace(old, new).replace("= 0.25", f"= {limit}"))
    budget = {"budget_s": 0.17} if check == "time_budget" else {}

    with pytest.raises(PluginError) as error:
        checks_of(plugin, **budget)[check]()

    assert "plugin odd.monitor (odd-monitors 6.6)" in str(error.value)
    assert words in str(error.value)


def test_a_rule_that_assumes_submissions_is_named(install: Install) -> None:
    source = textwrap.dedent(
        """
        from dataclasses import dataclass
        from ariac_score import Finding

        @dataclass(frozen=True)
        class Plugin:
            def judge(self, trial, order):
                done = any(s.item_id == order.tasks[0].id for s in trial.submissions)
                make = Finding.satisfied if done else Finding.violated
                yield make(order.id, "handed in" if done else "not handed in")
        """
    )
    install("odd-rules", {"odd.rule": "Plugin"}, source=source, version="6.6")
    rule = Registry().find(RULES, "odd.rule").build({})

    with pytest.raises(
        ContractError, match=r"odd\.rule \(odd-rules 6\.6\) decides 'ABCD1234' although no subm"
    ):
        checks_of(rule)["missing_submissions"]()


def test_a_plugin_that_is_not_installed_is_named_by_its_package() -> None:
    class Silent:
        def needs(self) -> Iterator[SignalNeed]:
            return iter(())

        def watch(self, _trial: Trial) -> list[Finding]:
            return []

    with pytest.raises(PluginError, match=r"plugin Silent \(\w+ not installed\) says nothing"):
        checks_of(Silent())["at_least_one_finding"]()


@pytest.mark.parametrize("nothing", [object(), None, 3, Finding])
def test_what_is_no_plugin_cannot_be_checked(nothing: object) -> None:
    with pytest.raises(TypeError, match="no rule, monitor or reader"):
        contract_checks(nothing, MADE)


def test_each_kind_is_checked_with_what_it_reads(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="path of a log"):
        contract_checks(REGISTRY.find(READERS, "jsonl").build({}), MADE)
    with pytest.raises(TypeError, match="with a trial"):
        contract_checks(REGISTRY.find(RULES, "kitting.pose").build({}), tmp_path)


def test_a_check_has_the_name_by_which_pytest_calls_it() -> None:
    checks = contract_checks(REGISTRY.find(RULES, "kitting.pose").build({}), MADE)

    assert [check.__name__ for check in checks] == [check.name for check in checks]
    assert len({check.name for check in checks}) == len(checks)
    assert all(check.about for check in checks)


# One message at a time -----------------------------------------------------------------


@dataclass
class Fastest:
    """The watch of `FastestSeen`."""

    fault: str
    seen: list[tuple[float, float]] = dataclasses.field(default_factory=list)

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[InstantVerdict]:
        del events
        for sample in samples:
            if sample.signal != "speed/robot":
                continue
            if self.seen and not sample.t_s > self.seen[-1][1] and self.fault != "takes any time":
                raise ValueError("the time does not increase")
            assert isinstance(sample.value, float)
            self.seen = [*([] if self.fault == "forgets" else self.seen), (sample.value, sample.t_s)]
            yield from self._verdicts(sample.value, sample.t_s, len(samples))

    def _verdicts(self, value: float, t_s: float, together: int) -> Iterator[InstantVerdict]:
        verdict = Verdict.VIOLATED if value > MEDIAN_M_S else Verdict.SATISFIED
        instant = InstantVerdict("robot", t_s, verdict, f"{value} m/s", value, "m/s")
        match self.fault:
            case "sees what is to come":
                instant = replace(instant, t_s=t_s + 1.0)
            case "goes back":
                instant = replace(instant, t_s=-t_s)
            case "has no unit":
                instant = replace(instant, unit="")
            case "changes its mind":
                instant = replace(instant, final=True)
            case "says nothing of it":
                instant = replace(instant, verdict=Verdict.SATISFIED)
            case "counts what comes":
                instant = replace(instant, message=f"{together} at once")
        yield instant

    def end(self, trial: Trial) -> Iterator[Finding]:
        if not self.seen:
            message = "no speed" if self.fault != "is unlike an empty log" else "nothing"
            yield Finding.inconclusive("robot", message, span=trial.window)
            return
        speed, t_s = max(self.seen, key=lambda row: (row[0], -row[1]))
        yield Finding("robot", Verdict.VIOLATED, f"{speed:.3f} m/s at {t_s:.3f} s", span=Span(t_s, t_s))


@dataclass(frozen=True)
class FastestSeen:
    """The fastest moment of the robot, reported while it is watched; or with a fault."""

    fault: str = ""

    def needs(self) -> Iterator[SignalNeed]:
        yield SignalNeed("speed", "m/s")

    def begin(self, _bodies: Sequence[Body] = ()) -> Fastest:
        return Fastest(self.fault)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        watcher, speed = Fastest(""), trial.signals.get("speed/robot")
        if speed:
            list(watcher.step([speed.sample(i) for i in range(len(speed))]))
        yield from watcher.end(trial)


WAVES = replace(
    MADE, signals={**MADE.signals, "speed/robot": replace(MADE.signals["speed/agv1"], name="speed/robot")}
)
MEDIAN_M_S = float(np.median(WAVES.signals["speed/robot"].values))
ONLINE = ["one_by_one", "instant_by_instant", "standings", "nothing_stepped", "repeated_time"]


@pytest.mark.parametrize("name", ONLINE)
def test_a_monitor_that_is_stepped_finds_what_it_finds_in_the_whole_log(name: str) -> None:
    checks = {check.name: check for check in contract_checks(FastestSeen(), WAVES)}

    checks[name]()


@pytest.mark.parametrize(
    ("fault", "name", "words"),
    [
        ("forgets", "one_by_one", r"given one sample at a time: .* then "),
        ("forgets", "instant_by_instant", r"given one instant at a time: .* then "),
        ("counts what comes", "instant_by_instant", "when the samples of an instant come together"),
        ("sees what is to come", "standings", "when only .* has come"),
        ("goes back", "standings", "and then at"),
        ("has no unit", "standings", "no unit"),
        ("changes its mind", "standings", "for good"),
        ("says nothing of it", "standings", "calls it so at no instant"),
        ("is unlike an empty log", "nothing_stepped", "when nothing comes"),
        ("takes any time", "repeated_time", "two samples of one time without a word"),
    ],
)
def test_a_watch_with_a_fault_is_found_out(fault: str, name: str, words: str) -> None:
    checks = {check.name: check for check in contract_checks(FastestSeen(fault), WAVES)}

    with pytest.raises(ContractError, match=words):
        checks[name]()


def test_only_who_can_begin_is_held_to_it() -> None:
    names = {
        check.name
        for check in contract_checks(REGISTRY.find(MONITORS, "iso_ts_15066.ssm_response").build({}), MADE)
    }

    assert not names & {*ONLINE}


# Readers -------------------------------------------------------------------------------

READER = """
from ariac_score import LogDescription, LogError, Signal, Span, Trial

CALLS = []

class Plugin:
    '''Reads tables of speeds.

    Reads:
        A time and a speed on each line.
    Refuses:
        A line that is none.
    Source:
        Nobody.
    '''

    def can_read(self, path):
        return path.suffix == ".speeds" and path.is_file()

    def describe(self, path):
        return LogDescription("table of speeds")

    def read(self, path, wanted):
        try:
            rows = [[float(word) for word in line.split()] for line in path.read_text().splitlines()]
            t, speed = [row[0] for row in rows], [row[1] for row in rows]
            signals = {"speed/robot": Signal("speed/robot", "m/s", t, speed)}
        except (ValueError, IndexError) as cause:
            raise LogError(str(cause), file=path) from cause
        return Trial(path.stem, signals=signals, recorded=Span(t[0], t[-1]) if t else None)
"""
READ = "        try:\n"

BAD_READERS: dict[str, tuple[str, str, str, str]] = {
    "has no source": ("    Source:\n        Nobody.\n", "", "docstring_sections", "no section 'Source'"),
    "wants a parameter": (
        "    def can_read",
        "    def __init__(self, *names): ...\n    def can_read",
        "built_by_name",
        "takes *names",
    ),
    "prints": (READ, "        print('reading')\n" + READ, "prints_nothing", "printed 'reading'"),
    "runs too long": (READ, "        while True: pass\n" + READ, "time_budget", "ran longer than its budget"),
    "knows nobody": (
        'return path.suffix == ".speeds" and',
        "return False and",
        "knows_its_own",
        "does not know",
    ),
    "describes by words": (
        'return LogDescription("table of speeds")',
        'return "speeds"',
        "knows_its_own",
        "a str",
    ),
    "opens whatever there is": (
        'return path.suffix == ".speeds" and path.is_file()',
        'return b"0.0" in path.read_bytes()',
        "strange_files",
        "raised IsADirectoryError",
    ),
    "answers in words": (
        'return path.suffix == ".speeds" and path.is_file()',
        'return "yes" if path.suffix == ".speeds" else "no"',
        "strange_files",
        "answers 'no'",
    ),
    "brings something else": (
        "        return Trial(path.stem",
        "        return str(path.stem",
        "same_log_same_trial",
        "raised TypeError",
    ),
    "counts its calls": (
        "Trial(path.stem",
        "Trial(CALLS.append(1) or path.stem * len(CALLS)",
        "same_log_same_trial",
        "another trial",
    ),
    "tidies the log": (
        READ,
        "        path.write_text(path.read_text() + '9 9\\n')\n" + READ,
        "log_unchanged",
        "changed",
    ),
    "brings another unit": ('"m/s", t', '"km/h", t', "units_declared", "in 'km/h'; a speed is in 'm/s'"),
    "brings no unit": ('"m/s", t', '"", t', "units_declared", "without a unit"),
    "forgets how long it was": (
        "Span(t[0], t[-1]) if t else None",
        "None",
        "times_inside",
        "not when the recording",
    ),
    "trips over a cut": (", IndexError", "", "cut_off", "raised IndexError"),
}


@pytest.fixture
def speeds(tmp_path: Path) -> Path:
    path = tmp_path / "run.speeds"
    path.write_text("".join(f"{k / 10} {k % 7}\n" for k in range(50)))
    return path


def reader(install: Install, source: str) -> Any:
    install("odd-readers", {"odd": "Plugin"}, source=source, version="6.6", group=READERS)
    return Registry().find(READERS, "odd").build({})


def test_a_good_reader_passes_every_check(install: Install, speeds: Path) -> None:
    for check in contract_checks(reader(install, READER), speeds):
        check()


@pytest.mark.parametrize("name", BAD_READERS)
def test_a_bad_reader_is_named_with_distribution_and_version(
    install: Install, speeds: Path, name: str
) -> None:
    old, new, wanted, words = BAD_READERS[name]
    assert READER.count(old) == 1
    # A trial without an end is among those tried: 0.3 s in all for the one that never ends.
    budget = {"budget_s": 0.003} if wanted == "time_budget" else {}
    checks = contract_checks(reader(install, READER.replace(old, new)), speeds, **budget)

    with pytest.raises(PluginError) as error:
        next(check for check in checks if check.name == wanted)()

    assert "plugin odd (odd-readers 6.6)" in str(error.value)
    assert words in str(error.value)


def test_a_log_that_its_reader_refuses_is_the_logs_fault(install: Install, speeds: Path) -> None:
    speeds.write_text("fast\n")
    checks = {check.name: check for check in contract_checks(reader(install, READER), speeds)}

    with pytest.raises(LogError, match="could not convert"):
        checks["units_declared"]()


# What a gap leaves open ----------------------------------------------------------------


@dataclass(frozen=True)
class Untroubled(FastestSeen):
    """As it says of gaps; documented as its base."""

    in_gaps: str = "blunt"

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Satisfied, whatever a gap may hide."""
        yield Finding.satisfied("trial", f"all is well in {trial.id}")


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("blunt", "is satisfied across two of 2 s"),
        ("unsampled", "reads no samples, and needs"),
        ("outer", "has no 'watch_worlds'"),
        ("soft", "'in_gaps' is one of tight, outer, blunt"),
    ],
)
def test_a_monitor_is_held_to_what_it_says_of_gaps(said: str, message: str) -> None:
    (check,) = [c for c in contract_checks(Untroubled(in_gaps=said), WAVES) if c.name == "in_gaps"]
    with pytest.raises(ContractError, match=re.escape(message)):
        check()


def test_a_first_party_monitor_has_to_say_what_a_gap_leaves_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monitor = REGISTRY.find(MONITORS, "ariac.no_event").build({})
    monkeypatch.delattr(type(monitor), "in_gaps")
    (check,) = [c for c in contract_checks(monitor, made_trial()) if c.name == "in_gaps"]

    with pytest.raises(ContractError, match="does not say what a gap leaves open"):
        check()


# What a cut leaves ---------------------------------------------------------------------


@dataclass(frozen=True)
class Fast:
    """Too fast at a moment; all of the log decides, or what was seen, as it says.

    Measures:
        Speed.
    Violated when:
        It is above the limit, in the mean of all of the log or at a sample.
    Source:
        This test.
    """

    when_cut: str = "adds"
    of_all: bool = False

    def needs(self) -> Iterator[SignalNeed]:
        yield SignalNeed("speed", "m/s")

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """The first sample that is too fast; or whether the log has fewer than all of the samples."""
        speed = trial.signals.get("speed/robot")
        if speed is None or not len(speed):
            yield Finding.inconclusive("trial", "no speed")
            return
        too_fast = speed.values > MEDIAN_M_S
        if self.of_all:
            too_fast = np.array([speed.t[-1] - speed.t[0] < WAVES.signals["speed/robot"].t[-1] - 1.5])
        if not too_fast.any():
            yield Finding.satisfied("trial", "never too fast")
            return
        at_s = float(speed.t[int(np.argmax(too_fast))])
        yield replace(Finding.violated("trial", "too fast"), span=Span(at_s, at_s))


@pytest.mark.parametrize(
    ("when_cut", "of_all", "message"),
    [
        ("adds", False, ""),
        ("open", True, ""),
        ("adds", True, "says 'adds' of a cut (what was seen stays, and more may have come), but 'trial' is "),
        ("kept", True, "but it finds something else of a log that is cut off at "),
        ("stays", False, "'when_cut' is one of adds, kept, witnessed, official, open"),
    ],
)
def test_a_check_is_held_to_what_it_says_of_a_cut(when_cut: str, of_all: bool, message: str) -> None:
    (check,) = [c for c in contract_checks(Fast(when_cut, of_all), WAVES) if c.name == "when_cut"]
    if not message:
        check()
        return
    with pytest.raises(ContractError, match=re.escape(message)):
        check()


def test_a_rule_that_needs_all_of_the_log_may_not_say_that_a_cut_leaves_it_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rule = REGISTRY.find(RULES, "kitting.order_time").build({})
    trial = kitting_trial()
    (check,) = [c for c in contract_checks(rule, trial) if c.name == "when_cut"]
    check()
    monkeypatch.setattr(type(rule), "when_cut", "kept", raising=False)

    with pytest.raises(ContractError, match="finds something else of a log that is cut off"):
        check()
