"""Quantities and derived signals of installed distributions: declared once, computed where logs lack them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ariac_score import QUANTITIES, DerivedSignal, Quantity, as_json, load_log_map, score_trial
from ariac_score.checks.registry import Registry, package_sha256
from ariac_score.cli import main
from ariac_score.engine.prepared import prepare
from ariac_score.engine.signal_needs import deriver_of
from ariac_score.errors import (
    LogError,
    LogMapError,
    PluginConflictError,
    PluginError,
    RuleSetError,
    ScoreError,
)
from ariac_score.testing.doctor import ailments
from ariac_score.trial.derive import source_quantities

Install = Callable[..., str]
QUANTITY, DERIVED, MONITORS = (f"ariac_score.{g}" for g in ("quantities", "derived_signals", "monitors"))

SOURCE = """\
import numpy as np
from ariac_score import DerivedSignal, Finding, Quantity, SignalNeed

HEIGHT = Quantity("m", 1, "body", "height of the body above the floor")
HEAT = Quantity("K", 1, "environment", "temperature of the hall")
OVERLAP = Quantity("m", 1, "pair", "how much higher one is than the other")
RISE = DerivedSignal({"p": "position/{body}"}, lambda t, p: p[:, 2])
ABOVE = DerivedSignal({"a": "height/{first}", "b": "height/{second}"}, lambda t, a, b: a - b)


class Low:
    '''Nobody jumps.'''

    def needs(self):
        return [SignalNeed("height", "m", 0.5)]

    def watch(self, trial):
        for body in trial.bodies:
            highest = float(trial.signal(f"height/{body.id}", unit="m").values.max())
            yield Finding.violated(body.id, f"as high as {highest:.3f} m")


class Flat(Low):
    def needs(self):
        return [SignalNeed("overlap", "m", 0.5)]

    def watch(self, trial):
        values = trial.signal("overlap/waiter/guest", unit="m").values
        yield Finding.violated("waiter", f"{values.tolist()}")
"""
RULES = """\
{id: hop, title: Hop, source: ours, log_map: none_needed.yaml,
 monitors: {low: {use: hop.low}}, score: 10 - count(low)}
"""


@pytest.fixture(autouse=True)
def _own_hashes() -> Iterator[None]:
    yield
    package_sha256.cache_clear()


def hop(install: Install, source: str = SOURCE, **others: dict[str, str]) -> str:
    named = {
        QUANTITY: {"height": "HEIGHT", "heat": "HEAT", "overlap": "OVERLAP"},
        DERIVED: {"height": "RISE", "overlap": "ABOVE"},
        MONITORS: {"hop.low": "Low", "hop.flat": "Flat"},
        **others,
    }
    return install("hop-score", named.pop(MONITORS), group=MONITORS, source=source, also=named)


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    (tmp_path / "none_needed.yaml").write_text("{id: none_needed, title: None, source: ours}\n")
    (tmp_path / "rules.yaml").write_text(RULES)
    return tmp_path / "rules.yaml"


def log(tmp_path: Path, **signals: list[object]) -> Path:
    """Three samples, one a second, of a robot called waiter and a human called guest."""
    samples = [
        {
            "record": "sample",
            "t_s": float(k),
            "values": {name.replace("__", "/"): v[k] for name, v in signals.items()},
        }
        for k in range(3)
    ]
    records = [
        {"record": "trial", "format": "ariac-score-trial-log/1", "id": "t", "witnessed": []},
        {"record": "body", "id": "waiter", "kind": "robot"},
        {"record": "body", "id": "guest", "kind": "human"},
        {"record": "event", "t_s": 0.0, "kind": "competition_started"},
        *samples,
        {"record": "event", "t_s": 2.0, "kind": "competition_ended"},
    ]
    records.append({"record": "end", "records": len(records) + 1})
    path = tmp_path / "run.jsonl"
    path.write_text("".join(json.dumps(record) + "\n" for record in records))
    return path


UP_AND_DOWN: dict[str, list[object]] = {
    "position__waiter": [[0, 0, 0.25], [0, 0, 1.5], [0, 0, 0.5]],
    "position__guest": [[1, 0, 0.125], [1, 0, 0.25], [1, 0, 0.125]],
}


# Quantities -----------------------------------------------------------------------------


def test_a_declared_quantity_belongs_to_the_vocabulary(install: Install) -> None:
    assert "height" not in QUANTITIES
    hop(install)

    assert (QUANTITIES["height"].unit, QUANTITIES["heat"].of) == ("m", "environment")
    # After ours, in the order of their names.
    assert [name for name in QUANTITIES if name in ("heat", "height", "overlap")] == [
        "heat",
        "height",
        "overlap",
    ]
    assert len(QUANTITIES) == len(list(QUANTITIES))


def test_a_log_map_maps_a_field_to_a_declared_quantity_and_to_one_of_the_environment(
    install: Install, tmp_path: Path
) -> None:
    hop(install)
    text = """\
id: m
title: M
source: ours
bodies: {waiter: {kind: robot}}
channels:
  - {topic: /h, signals: {height/waiter: z, heat/environment: k}}
"""
    (tmp_path / "m.yaml").write_text(text)

    (channel,) = load_log_map(str(tmp_path / "m.yaml")).channels
    assert [(f.signal, f.unit) for f in channel.signals] == [
        ("height/waiter", "m"),
        ("heat/environment", "K"),
    ]

    (tmp_path / "m.yaml").write_text(text.replace("heat/environment", "heat/waiter"))
    with pytest.raises(LogMapError, match="'heat/waiter' does not name the environment"):
        load_log_map(str(tmp_path / "m.yaml"))


def test_a_trial_log_records_a_declared_quantity_without_declaring_it(
    install: Install, tmp_path: Path, rules: Path
) -> None:
    hop(install)
    result = score_trial(log(tmp_path, height__waiter=[1, 3, 2], height__guest=[1, 1, 1]), str(rules))

    # What the log records is never replaced by what is derived.
    messages = {f.subject: f.message for f in result.measured.findings.values()}
    assert messages == {"waiter": "as high as 3.000 m", "guest": "as high as 1.000 m"}


@pytest.mark.parametrize("name", ["heat/waiter", "height/environment", "heat/environment/x", "heat/"])
def test_a_signal_about_the_wrong_kind_of_subject_is_refused(
    install: Install, tmp_path: Path, rules: Path, name: str
) -> None:
    hop(install)
    path = log(tmp_path, **{name.replace("/", "__"): [1, 1, 1]})

    with pytest.raises(LogError, match=r"is not named|no 'body' record"):
        score_trial(path, str(rules))


@pytest.mark.slow
def test_two_distributions_that_declare_one_quantity_in_other_units_are_refused_and_both_are_named(
    install: Install, rules: Path, tmp_path: Path
) -> None:
    hop(install)
    source = 'from ariac_score import Quantity\nH = Quantity("cm", 1, "body", "the same in cm")\n'
    install("foot-score", {"height": "H"}, source=source, group=QUANTITY)

    with pytest.raises(
        PluginConflictError, match=r"'height' is declared by foot-score 1\.0 in 'cm' .* hop-score 1\.0 in 'm'"
    ) as refused:
        prepare(str(rules))
    assert refused.value.file == str(rules)
    # It stops only what uses it.
    assert prepare("paper2020.published").rule_set.id == "paper2020.published"
    assert any("'cm'" in ailment.problem for ailment in ailments())


@pytest.mark.parametrize(("unit", "components", "of"), [("m", 3, "body"), ("m", 1, "pair")])
def test_another_shape_or_subject_is_a_contradiction_too(
    install: Install, unit: str, components: int, of: str
) -> None:
    hop(install)
    source = f'from ariac_score import Quantity\nH = Quantity("{unit}", {components}, "{of}", "")\n'
    install("foot-score", {"height": "H"}, source=source, group=QUANTITY)

    with pytest.raises(PluginConflictError, match=r"foot-score .* and hop-score"):
        QUANTITIES["height"]


@pytest.mark.slow
def test_two_distributions_that_agree_about_a_quantity_are_both_welcome(install: Install) -> None:
    hop(install)
    source = 'from ariac_score import Quantity\nH = Quantity("m", 1, "body", "in other words")\n'
    install("foot-score", {"height": "H"}, source=source, group=QUANTITY)

    assert QUANTITIES["height"].unit == "m"
    assert not [a for a in ailments() if "height" in a.origin]


@pytest.mark.slow
def test_a_quantity_of_ours_keeps_its_meaning(install: Install) -> None:
    source = 'from ariac_score import Quantity\nS = Quantity("km/h", 1, "body", "faster")\n'
    install("odd-score", {"speed": "S"}, source=source, group=QUANTITY)

    assert QUANTITIES["speed"].unit == "m/s"
    (ailment,) = [a for a in ailments() if "odd-score" in a.origin]
    assert "'speed' has its meaning already" in ailment.problem


def test_a_log_map_may_declare_a_quantity_only_as_a_distribution_does(
    install: Install, tmp_path: Path
) -> None:
    hop(install)
    path = tmp_path / "m.yaml"
    path.write_text("{id: m, title: M, source: ours, quantities: {height: {unit: m, of: body}}}")
    assert load_log_map(str(path)).quantities["height"].unit == "m"

    path.write_text("{id: m, title: M, source: ours, quantities: {height: {unit: mm, of: body}}}")
    with pytest.raises(LogMapError, match=r"hop-score 1\.0 declares it in 'm'"):
        load_log_map(str(path))


@pytest.mark.parametrize("source", ["H = 3", "raise RuntimeError('no licence')"])
def test_what_is_no_quantity_is_named_when_it_is_used_and_not_before(
    install: Install, source: str, rules: Path
) -> None:
    install("odd-score", {"height": "H"}, source=source, group=QUANTITY)

    assert prepare("paper2020.published").rule_set.id == "paper2020.published"
    with pytest.raises(PluginError, match=r"height \(odd-score 1\.0\)"):
        QUANTITIES.get("height")


# Derived signals ------------------------------------------------------------------------


def test_a_quantity_that_the_log_lacks_is_computed_from_what_it_has(
    install: Install, tmp_path: Path, rules: Path
) -> None:
    hop(install)
    result = score_trial(log(tmp_path, **UP_AND_DOWN), str(rules))

    messages = {f.subject: f.message for f in result.measured.findings.values()}
    assert messages == {"waiter": "as high as 1.500 m", "guest": "as high as 0.250 m"}
    assert {(c.signal, c.source) for c in result.measured.coverage if "height" in c.signal} == {
        ("height/guest", "derived"),
        ("height/waiter", "derived"),
    }


def test_a_derived_quantity_of_a_pair_follows_from_derived_ones_of_its_bodies(
    install: Install, tmp_path: Path, rules: Path
) -> None:
    hop(install)
    rules.write_text(RULES.replace("hop.low", "hop.flat"))

    (finding,) = score_trial(log(tmp_path, **UP_AND_DOWN), str(rules)).measured.findings.values()

    # 0.25 - 0.125, 1.5 - 0.25, 0.5 - 0.125
    assert finding.message == "[0.125, 1.25, 0.375]"
    assert prepare(str(rules)).sources == {"overlap", "height", "position"}


def test_where_the_sources_are_missing_too_the_check_is_undecided(
    install: Install, tmp_path: Path, rules: Path
) -> None:
    hop(install)
    result = score_trial(log(tmp_path, position__waiter=UP_AND_DOWN["position__waiter"]), str(rules))

    assert result.status == "incomplete"


def test_moments_without_a_value_are_left_out_and_make_a_gap(
    install: Install, tmp_path: Path, rules: Path
) -> None:
    source = SOURCE.replace("p[:, 2])", "np.where(p[:, 2] > 1, np.nan, p[:, 2]))")
    hop(install, source)
    result = score_trial(log(tmp_path, **UP_AND_DOWN), str(rules))

    assert {f.subject: f.message for f in result.measured.findings.values()}["waiter"] == "as high as 0.500 m"
    assert {c.signal: c.samples for c in result.measured.coverage}["height/waiter"] == 2


def test_the_distributions_of_quantities_and_derived_signals_stand_in_the_result(
    install: Install, tmp_path: Path, rules: Path
) -> None:
    install("quantity-score", {"height": "HEIGHT"}, source=SOURCE, group=QUANTITY)
    install("derive-score", {"height": "RISE"}, source=SOURCE, group=DERIVED)
    install("hop-score", {"hop.low": "Low"}, source=SOURCE, group=MONITORS)

    result = score_trial(log(tmp_path, **UP_AND_DOWN), str(rules))

    assert {code.distribution for code in result.provenance.code} == {
        "ariac-score",
        "derive-score",
        "hop-score",
        "quantity-score",
    }
    # To the byte again, and with nothing of it for rules that do not ask.
    assert as_json(score_trial(log(tmp_path, **UP_AND_DOWN), str(rules))) == as_json(result)
    assert {plugin.distribution for plugin in prepare("paper2020.published").plugins} == {"ariac-score"}


@pytest.mark.parametrize(
    ("lambda_", "cause"),
    [
        ("lambda t, p: 1 / 0", "raised ZeroDivisionError"),
        ("lambda t: t", "raised TypeError"),
        ("lambda t, p: p", r"gives values of shape \(3, 3\) where \(3,\)"),
        ("lambda t, p: p[:2, 2]", r"gives values of shape \(2,\) where \(3,\)"),
        ("lambda t, p: 'high'", "raised ValueError"),
        ("lambda t, p: None", r"gives values of shape \(\) where"),
    ],
)
def test_a_failure_to_compute_names_the_plugin(
    install: Install, tmp_path: Path, rules: Path, lambda_: str, cause: str
) -> None:
    hop(install, SOURCE.replace("lambda t, p: p[:, 2]", lambda_))

    with pytest.raises(PluginError, match=rf"height \(hop-score 1\.0\) {cause}"):
        score_trial(log(tmp_path, **UP_AND_DOWN), str(rules))


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ('{"p": "position/{body}"}', '{"p": "position/{first}"}', r"needs \{first\} for 'height'"),
        ('{"p": "position/{body}"}', '{"p": "position/{tray}"}', "not such as"),
        ('{"p": "position/{body}"}', '{"p": "position"}', "not such as"),
        ("RISE = DerivedSignal(", "RISE = dict(a=", "is a dict, not a DerivedSignal"),
    ],
)
def test_a_derived_signal_that_cannot_be_is_refused_before_a_log_is_read(
    install: Install, rules: Path, old: str, new: str, cause: str
) -> None:
    source = SOURCE.replace(old, new, 1)
    source = source.replace("lambda t, p: p[:, 2])", "b=1)") if "dict(" in new else source
    hop(install, source)

    with pytest.raises(ScoreError, match=cause) as refused:
        prepare(str(rules))
    assert "hop-score" in str(refused.value)


def test_what_two_distributions_derive_is_refused_and_so_is_what_we_derive_ourselves(
    install: Install, rules: Path
) -> None:
    hop(install)
    install("odd-score", {"speed": "RISE"}, source=SOURCE, group=DERIVED)
    with pytest.raises(
        PluginConflictError, match=r"speed \(odd-score 1\.0\) derives 'speed', which ariac-score"
    ):
        deriver_of("speed", Registry())

    install("foul-score", {"height": "RISE"}, source=SOURCE, group=DERIVED)
    with pytest.raises(PluginConflictError, match=r"foul-score .* and hop-score"):
        prepare(str(rules))


def test_what_nobody_declares_cannot_be_derived(install: Install) -> None:
    install("odd-score", {"depth": "RISE"}, source=SOURCE, group=DERIVED)

    with pytest.raises(PluginError, match="derives 'depth', which nobody declares"):
        deriver_of("depth", Registry())


def test_two_that_follow_from_each_other_end(install: Install, tmp_path: Path, rules: Path) -> None:
    """Each is right where the log has the other; where it has neither, neither can be had."""
    source = SOURCE + (
        'BACK = DerivedSignal({"h": "overlap/waiter/guest"}, lambda t, h: h)\n'
        'ON = DerivedSignal({"h": "height/waiter"}, lambda t, h: h)\n'
    )
    hop(install, source, **{DERIVED: {"height": "BACK", "overlap": "ON"}})

    assert score_trial(log(tmp_path, **UP_AND_DOWN), str(rules)).status == "incomplete"
    path = log(tmp_path, overlap__waiter__guest=[1, 4, 2])
    assert "as high as 4.000 m" in as_json(score_trial(path, str(rules)))


def test_the_closure_of_sources_goes_through_ours_and_theirs() -> None:
    theirs = {"haste": DerivedSignal({"v": "speed/{body}"}, lambda t, v: v + 0 * t)}

    assert source_quantities(["haste"], theirs) == {"haste", "speed", "velocity", "position"}
    assert source_quantities(["haste"]) == {"haste"}


def test_a_monitor_that_reads_a_declared_quantity_in_another_unit_is_refused(
    install: Install, rules: Path
) -> None:
    hop(install, SOURCE.replace('SignalNeed("height", "m"', 'SignalNeed("height", "cm"'))

    with pytest.raises(RuleSetError, match="reads 'height' in 'cm', but it is measured in 'm'"):
        prepare(str(rules))


def test_the_doctor_and_validate_know_declared_quantities(
    install: Install, rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hop(install)

    assert main(["rules", "validate", str(rules)]) == 0
    assert "sound" in capsys.readouterr().out


def test_a_quantity_says_what_it_is_about() -> None:
    assert Quantity("K", 1, "environment", "heat").of == "environment"
    assert np.isneginf(Quantity("K", 1, "environment", "heat").at_least)
