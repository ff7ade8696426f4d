"""A finding that cannot be has no price: it names plugin, version, check, finding and field."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from itertools import count
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from ariac_score.checks.contracts import SignalNeed
from ariac_score.checks.finding_contract import Grounds, breach_of, watched_in
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.checks.registry import Plugin
from ariac_score.checks.units import is_unit
from ariac_score.cli import main
from ariac_score.engine.ask import ask
from ariac_score.errors import PluginError
from ariac_score.installed.points import installed_points
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.trial.events import Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span
from ariac_score_ariac.testing import kitting_trial

T = np.arange(101) * 0.1
TRIAL = Trial(
    "t",
    bodies=(Body("robot", "robot"), Body("human", "human")),
    signals={"speed/robot": Signal("speed/robot", "m/s", T, np.zeros(101))},
    recorded=Span(0.0, 10.0),
)
CHECK = """
from ariac_score import Finding, Sample, SignalNeed, Span, Verdict
from ariac_score.checks.measures import Measure

class Check:
    measures = {{
        "takes_s": Measure("s"),
        "offset_s": Measure("s", signed=True),
        "things": Measure("count"),
        "depth_m": Measure("m", signed=False),
        "level_m": Measure("m"),
    }}
    {holds}

    def needs(self):
        yield SignalNeed("speed", "m/s")

    def watch(self, trial):
        yield Finding.satisfied("robot", "as it should be")
        yield Finding({finding})
"""

Asked = Callable[..., list[Finding]]
_NUMBER = count()


def source_of(finding: str, holds: str = "") -> str:
    given = {"subject": "'trial'", "verdict": "Verdict.VIOLATED", "message": "'too near'"}
    fields = [f"{name}={value}" for name, value in given.items() if f"{name}=" not in finding]
    return CHECK.format(finding=", ".join([*fields, finding]), holds=holds)


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Asked]:
    """Put a check, whose second finding has the fields given, to the trial."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)

    def findings(finding: str, holds: str = "", trial: Trial = TRIAL) -> list[Finding]:
        module = f"odd_finding_{next(_NUMBER)}"
        (tmp_path / f"{module}.py").write_text(source_of(finding, holds), encoding="utf-8")
        plugin = Plugin("odd.check", "ariac_score.monitors", f"{module}:Check", "odd-rules", "6.6")
        return ask(plugin, "oddity", plugin.build({}), trial)

    yield findings
    for name in set(sys.modules) - before:
        if name.startswith("odd_finding_"):
            del sys.modules[name]


BROKEN = {
    "a span after what was recorded": ("span=Span(9.0, 10.5)", "span", "10.5 s, outside what was watched"),
    "a span before what was recorded": ("span=Span(-0.5, 1.0)", "span", "-0.5 s, outside what was watched"),
    "a span that is a pair": ("span=(1.0, 2.0)", "span", "is no Span"),
    "a negative time": (
        "quantities={'takes_s': -5.0}",
        "quantities.takes_s",
        "-5 s, and it is never negative",
    ),
    "a negative count": ("quantities={'things': -1}", "quantities.things", "-1 count, and it is never"),
    "a negative length that is declared to be none": (
        "quantities={'depth_m': -0.1}",
        "quantities.depth_m",
        "-0.1 m, and it is never negative",
    ),
    "an undeclared quantity": (
        "quantities={'time_s': 1.0}",
        "quantities.time_s",
        "is not declared; the check declares depth_m, level_m, offset_s, takes_s, things",
    ),
    "another unit than declared": (
        "quantities={'level_m': 1.0}, units={'level_m': 's'}",
        "units.level_m",
        "is 's', but the check declares 'm'",
    ),
    "NaN": ("quantities={'takes_s': float('nan')}", "quantities.takes_s", "nan, which is no finite number"),
    "infinity": ("quantities={'level_m': float('inf')}", "quantities.level_m", "inf, which is no finite"),
    "an integer beyond all floats": (
        "quantities={'level_m': 10**400}",
        "quantities.level_m",
        "which is no finite number",
    ),
    "a truth for a number": ("quantities={'things': True}", "quantities.things", "True, which is no finite"),
    "a word for a number": ("quantities={'things': '2'}", "quantities.things", "'2', which is no finite"),
    "a violation that kept its limit": (
        "robustness=0.1, unit='m'",
        "robustness",
        "+0.1, but a violation has none above 0",
    ),
    "something satisfied beyond its limit": (
        "verdict=Verdict.SATISFIED, robustness=-0.1, unit='m'",
        "robustness",
        "-0.1, but what is satisfied has none below 0",
    ),
    "a margin where nothing was judged": (
        "verdict=Verdict.NOT_APPLICABLE, robustness=1.0, unit='m'",
        "robustness",
        "where nothing was judged there is no margin",
    ),
    "a margin that is NaN": ("robustness=float('nan'), unit='m'", "robustness", "nan, which is no finite"),
    "a margin without a unit": ("robustness=-0.1", "unit", "is empty, but it has a margin of -0.1"),
    "a margin in an unknown unit": (
        "robustness=-0.1, unit='furlong'",
        "unit",
        "'furlong', which is no known unit",
    ),
    "a body that is not there": ("subject='robto'", "subject", "no body or pair of bodies"),
    "a pair with nobody": ("subject='robot/humna'", "subject", "no body or pair of bodies"),
    "no subject": ("subject=''", "subject", "is empty"),
    "no message": ("message=''", "message", "is empty"),
    "a message that is a number": ("message=5", "message", "is 5, which is no text"),
    "a clause that is a number": ("clause=5.4", "clause", "is 5.4, which is no text"),
    "a label that is a number": ("labels={'phase': 2}", "labels.phase", "is 2, which is no text"),
    "critical by a word": ("critical='no'", "critical", "neither True nor False"),
    "evidence after the recording": (
        "evidence=(Sample('speed/robot', 11.0, 1.0, 'm/s'),)",
        "evidence 1",
        "11 s, outside what was watched",
    ),
    "evidence of a signal that is not there": (
        "evidence=(Sample('speed/human', 1.0, 1.0, 'm/s'),)",
        "evidence 1",
        "a signal that this trial does not have",
    ),
    "evidence in another unit": (
        "evidence=(Sample('speed/robot', 1.0, 1.0, 'm'),)",
        "evidence 1",
        "in 'm', recorded in 'm/s'",
    ),
    "evidence without a unit": (
        "evidence=(Sample('limit/robot', 1.0, 1.0, ''),)",
        "evidence 1",
        "without a unit",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_finding_that_cannot_be_is_named_in_full(asked: Asked, name: str) -> None:
    finding, field, words = BROKEN[name]

    with pytest.raises(PluginError) as error:
        asked(finding)

    said = str(error.value)
    assert said.startswith("check 'oddity': plugin odd.check (odd-rules 6.6) gives finding 2, ")
    assert f"which cannot be: its {field} " in said
    assert words in said
    assert error.value.exit_code == 3


KEPT = {
    "a span of all that was recorded": "span=Span(0.0, 10.0)",
    "a moment at the end": "span=Span(10.0, 10.0)",
    "no time at all": "quantities={'takes_s': 0.0, 'things': 0}",
    "an offset back in time": "quantities={'offset_s': -5.0}",
    "a level below the floor": "quantities={'level_m': -5.0}",
    "the declared unit": "quantities={'takes_s': 1.0}, units={'takes_s': 's'}",
    "a violation with no margin left": "robustness=0.0, unit='m'",
    "a limit met exactly": "verdict=Verdict.SATISFIED, robustness=0.0, unit='m'",
    "an undecided margin": "verdict=Verdict.INCONCLUSIVE, robustness=-1.0, unit='m'",
    "a product of units": "robustness=-1.0, unit='N s'",
    "a link of a body": "subject='robot::tcp'",
    "two bodies": "subject='robot/human'",
    "the team": "subject='team'",
    "a signal": "subject='speed/robot'",
    "a body looked for in vain": "subject='robto', verdict=Verdict.INCONCLUSIVE",
    "a limit the check computed": "evidence=(Sample('limit/robot', 10.0, 1.0, 'm/s'),)",
    "a sample": "evidence=(Sample('speed/robot', 0.0, 0.0, 'm/s'),)",
}


@pytest.mark.parametrize("name", KEPT)
def test_a_finding_at_its_limits_is_kept(asked: Asked, name: str) -> None:
    assert len(asked(KEPT[name])) == 2


class Turning(float):
    """Two seconds at first, and -700 from then on."""

    asked = 0

    def __float__(self) -> float:
        self.asked += 1
        return 2.0 if self.asked == 1 else -700.0


class Raising(float):
    asked = 0

    def __float__(self) -> float:
        self.asked += 1
        if self.asked > 1:
            raise RuntimeError("not again")
        return 2.0


@pytest.mark.parametrize(
    ("value", "cause"), [(Turning(2.0), "takes_s"), (Raising(2.0), "cannot be stored: RuntimeError")]
)
def test_a_number_that_turns_into_another_when_it_is_stored_is_refused(value: float, cause: str) -> None:
    with pytest.raises(PluginError, match=cause):
        ask_about(value)


def test_a_fraction_is_stored_as_the_float_nearest_to_it() -> None:
    (finding,) = ask_about(Fraction(1, 4))  # type: ignore[arg-type]  # what a plugin may do

    assert finding.quantities["takes_s"] == 0.25


def ask_about(value: float) -> list[Finding]:
    class Check:
        measures: ClassVar = {"takes_s": Measure("s")}

        def needs(self) -> list[SignalNeed]:
            return []

        def watch(self, trial: Trial) -> list[Finding]:
            return [Finding("trial", Verdict.VIOLATED, trial.id, quantities={"takes_s": value})]

    plugin = Plugin("odd.check", "ariac_score.monitors", "odd:Check", "odd-rules", "6.6")
    return ask(plugin, "oddity", Check(), TRIAL)


def test_the_units_of_the_declaration_are_stored_with_the_finding(asked: Asked) -> None:
    _, found = asked("quantities={'takes_s': 1.0, 'things': 2}")

    assert dict(found.units) == {"takes_s": "s", "things": "count"}


def test_what_was_broken_too_briefly_to_count_is_satisfied_where_the_check_says_how_long_counts(
    asked: Asked,
) -> None:
    brief = "verdict=Verdict.SATISFIED, robustness=-0.1, unit='m'"

    assert len(asked(brief, holds="t_on_s = 0.5")) == 2
    with pytest.raises(PluginError, match="none below 0"):
        asked(brief, holds="t_on_s = 0.0")


def test_a_check_may_have_words_of_its_own_for_what_it_is_about(asked: Asked) -> None:
    assert len(asked("subject='pit lane'", holds="also_about = ('pit lane',)")) == 2
    with pytest.raises(PluginError, match="its subject is 'pit lane'"):
        asked("subject='pit lane'")


def test_a_unit_is_known_where_a_signal_is_declared_in_it(asked: Asked) -> None:
    margin = "robustness=-1.0, unit='mmHg'"
    signal = Signal("blood_pressure/human", "mmHg", T, np.zeros(101))
    trial = replace(TRIAL, signals={**TRIAL.signals, signal.name: signal})

    assert len(asked(margin, trial=trial)) == 2
    with pytest.raises(PluginError, match="its unit is 'mmHg'"):
        asked(margin)


@pytest.mark.parametrize(
    ("measures", "words"),
    [
        ("measures = ['takes_s']", "has 'measures' that are a list"),
        ("measures = {'takes_s': 's'}", "declares 'takes_s' by 's', which is no Measure"),
        ("measures = {'takes_s': Measure('sec')}", "declares 'takes_s' in 'sec', which is no known unit"),
        ("measures = property(lambda self: 1 / 0)", "raised ZeroDivisionError about what it measures"),
    ],
)
def test_a_declaration_that_is_none_is_named(asked: Asked, measures: str, words: str) -> None:
    with pytest.raises(PluginError) as error:
        asked("critical=True", holds=measures)

    assert f"plugin odd.check (odd-rules 6.6) {words}" in str(error.value)


def test_what_happened_before_and_after_the_recording_was_watched_too() -> None:
    early = replace(TRIAL, events=(Event(-3.0, "order_announced", "o"), Event(12.0, "door_closed")))

    assert watched_in(TRIAL) == Span(0.0, 10.0)
    assert watched_in(early) == Span(-3.0, 12.0)
    assert watched_in(Trial("nothing")) is None


def test_without_a_recording_its_signals_say_what_was_watched() -> None:
    assert watched_in(replace(TRIAL, recorded=None)) == Span(0.0, 10.0)


@pytest.mark.parametrize("unit", ["m/s2", "m s", "N·s", "1/s", "points", "kg*m/s", "s^2"])
def test_a_product_or_quotient_of_known_units_is_known(unit: str) -> None:
    assert is_unit(unit)


@pytest.mark.parametrize("unit", ["", "meter", "ms", "m/", "/s", "m//s", "m s s_"])
def test_anything_else_is_no_unit(unit: str) -> None:
    assert not is_unit(unit)


def test_where_nobody_knows_what_a_finding_rests_on_its_own_fields_are_held_against_each_other() -> None:
    sound = Finding("anything", Verdict.VIOLATED, "x", span=Span(0.0, 1e9), quantities={"w": -1.0})
    forged = replace(sound, quantities={"w": -1.0}, units={"w": "s"})

    assert breach_of(sound, Grounds()) is None
    assert "never negative" in str(breach_of(forged, Grounds()))
    assert breach_of(forged, Grounds(measures={"w": Measure("s", signed=True)})) is None


# As its user meets it ------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a negative time", "a span after what was recorded", "no message"])
def test_no_score_is_printed_for_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    finding, field, _ = BROKEN[name]
    module = f"odd_scored_{next(_NUMBER)}"
    finding = finding.replace("10.5", "1e5")  # the example is longer
    (tmp_path / f"{module}.py").write_text(source_of(finding), encoding="utf-8")
    stranger = Plugin("odd.check", "ariac_score.monitors", f"{module}:Check", "odd-rules", "6.6")
    monkeypatch.setattr(
        "ariac_score.checks.registry.installed_points", lambda: [*installed_points(), stranger]
    )
    rules = tmp_path / "odd.yaml"
    rules.write_text(
        "{id: odd, title: odd, source: test, log_map: ariac2020, monitors: {oddity: {use: odd.check}}, "
        "score: '10 - measure(oddity, takes_s)'}",
        encoding="utf-8",
    )
    log = write_trial_log(tmp_path / "t.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)

    code = main(["score", str(log), "--rules", str(rules)])

    out, err = capsys.readouterr()
    assert (code, out) == (3, "")
    assert "check 'oddity': plugin odd.check (odd-rules 6.6) gives finding 2, violated 'trial'" in err
    assert f"which cannot be: its {field} " in err


def test_a_margin_that_is_none_or_a_decimal_is_refused_with_what_to_do() -> None:
    with pytest.raises(TypeError, match=r"where none is known, yield Finding\.inconclusive"):
        Verdict.of(None)

    finding = Finding("trial", Verdict.SATISFIED, "x", robustness=Decimal("0.5"), unit="m")  # type: ignore[arg-type]
    assert str(breach_of(finding, Grounds())) == (
        "its robustness is Decimal('0.5'), a Decimal where a float belongs: float(…) makes one"
    )
