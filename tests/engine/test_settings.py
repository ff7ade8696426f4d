"""What a result says of the parameters in force: every one, its value, and whose choice it was."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from ariac_score import (
    Finding,
    Result,
    SignalNeed,
    Trial,
    as_json,
    load_result,
    load_rule_set,
    parameter,
    reprice,
    score_trial,
)
from ariac_score.checks.registry import Plugin, Registry, parameters_of
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.engine.prepared import PreparedCheck, prepare
from ariac_score.engine.settings import settings_of
from ariac_score.errors import PluginError, ResultError, RuleSetError
from ariac_score.report.html.trial import trial_page
from ariac_score.results.result import Setting, Settings
from ariac_score.results.result_file import check_follows, measured_sha256
from ariac_score.review.verify import verify_result
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.testing import contract_checks
from ariac_score.testing.contract_check import ContractError
from ariac_score_ariac.testing import kitting_trial, made_trial

ROOT = Path(__file__).parents[2]
LOG = ROOT / "examples/kitting_near_miss.mcap"
REGISTRY = Registry()
_COUNT = iter(range(1000))


@pytest.fixture(scope="module")
def result() -> Result:
    return score_trial(LOG, "paper2020.published")


def rules(folder: Path, use: str, given: Mapping[str, Any]) -> RuleSet:
    file = folder / "rules.yaml"
    content = {
        "id": "made.rules",
        "title": "One monitor",
        "source": "made for this test",
        "log_map": "ariac2020",
        "monitors": {"it": {"use": use, "with": given}},
        "score": "holds(it)",
    }
    file.write_text(json.dumps(content))
    return load_rule_set(str(file))


def settings(folder: Path, use: str, **given: Any) -> dict[str, Setting]:
    rule_set = rules(folder, use, given)
    found = settings_of(prepare(rule_set, registry=REGISTRY))["it"]
    return {setting.name: setting for setting in found.parameters}


# Which values are in force -------------------------------------------------------------


def test_the_seed_profile_comes_to_the_values_of_the_paper(tmp_path: Path) -> None:
    # Ferrando et al.: t1 = 1.0 s, t2 = 1.5 s, B = 0, delta = 2.6 m, between centres.
    found = settings(tmp_path, "iso_ts_15066.ssm_separation")

    told = {name: (found[name].value, found[name].unit, found[name].origin) for name in found}
    assert told["profile"] == ("seed", "", "default")
    assert told["t1_s"] == (1.0, "s", "derived")
    assert told["t2_s"] == (1.5, "s", "derived")
    assert told["stopping_distance_m"] == (0.0, "m", "derived")
    assert told["delta_m"] == (2.6, "m", "derived")
    assert told["distance"] == ("centre_distance", "", "derived")
    assert told["human_speed"] == ("measured", "", "derived")
    assert told["intrusion_m"][0] is None  # C is part of delta there


def test_the_standard_profile_takes_the_sum_apart(tmp_path: Path) -> None:
    # docs of ssm_separation: t1 0.1 s, t2 0.3 s, C 0.20 m, Z_d 0.10 m, Z_r 0.05 m, 1.6 m/s of ISO 13855.
    found = settings(tmp_path, "iso_ts_15066.ssm_separation", profile="standard", t2_s=0.4)

    values = {name: found[name].value for name in found}
    assert (values["t1_s"], values["t2_s"]) == (0.1, 0.4)
    assert (found["t1_s"].origin, found["t2_s"].origin) == ("derived", "rule_set")
    parts = [values[name] for name in ("intrusion_m", "human_uncertainty_m", "robot_uncertainty_m")]
    assert (values["delta_m"], parts) == (None, [0.2, 0.1, 0.05])
    assert (values["human_speed"], values["human_speed_m_s"]) == ("fixed", 1.6)
    assert found["human_speed_m_s"].status == "verified"
    assert (values["stop_model"], values["speeds"], values["robot_must_move"]) == (
        "linear",
        "directed",
        "yes",
    )
    assert values["stopping_distance_m"] is None  # a linear stop has none of its own


@pytest.mark.parametrize("profile", ["seed", "ariac2023", "ariac2023_agent", "standard"])
def test_what_a_profile_comes_to_given_by_hand_is_the_same_monitor(profile: str, tmp_path: Path) -> None:
    """The values that are told are those that count: with them alone the same is found."""
    from ariac_score.trial.derive import Derivation, derive_signals  # noqa: PLC0415

    kind = REGISTRY.find("ariac_score.monitors", "iso_ts_15066.ssm_separation").load()
    by_profile = kind(profile=profile)
    needs = [Derivation(need.quantity, need.max_gap_s) for need in by_profile.needs()]
    trial = derive_signals(kitting_trial(), needs)
    values = by_profile.resolved()
    by_hand = kind(profile="standard" if profile == "seed" else "seed", **values)

    assert [f.robustness for f in by_hand.watch(trial)] == [f.robustness for f in by_profile.watch(trial)]


def test_without_a_region_the_face_and_half_an_arm_count(tmp_path: Path) -> None:
    found = settings(tmp_path, "iso_10218_2.pfl_speed", load_kg=2.0)

    # ISO/TS 15066, A.3.4: m_R = M / 2 + m_L, of 33.5 kg and 2 kg.
    assert (found["robot_mass_kg"].value, found["robot_mass_kg"].origin) == (18.75, "derived")
    assert found["region"].value == "face"
    assert (found["load_kg"].value, found["load_kg"].unit, found["load_kg"].origin) == (2.0, "kg", "rule_set")


def test_a_given_value_has_no_source_of_a_default(tmp_path: Path) -> None:
    found = settings(tmp_path, "iso_10218_1.reduced_speed", t_on_s=0.1)

    assert found["t_on_s"] == Setting("t_on_s", 0.1, "s", "rule_set")
    speed = found["max_speed_m_s"]
    assert (speed.value, speed.unit, speed.origin, speed.status) == (0.25, "m/s", "default", "verified")
    assert "OSHA STD 01-12-002" in speed.source


BETWEEN = {"separation": ("human", "robot"), "human_contact": ("human", "robot")}
"""Whose motion fills the gaps of a monitor."""


def test_no_parameter_of_any_shipped_plugin_is_left_out(result: Result) -> None:
    kept = result.measured.settings
    assert kept is not None
    assert list(kept) == list(result.checks)
    for name, check in result.checks.items():
        group = next(
            g for g in ("ariac_score.rules", "ariac_score.monitors") if check["use"] in REGISTRY.names(g)
        )
        declared = parameters_of(REGISTRY.find(group, check["use"]).load())
        names = [one.name for one in kept[name].parameters]
        assert [one for one in names if not one.startswith("bounds.")] == list(declared)
        # Also where no gap had to be filled: what bodies can do is stated in every result.
        bounds = [one for one in names if one.startswith("bounds.")]
        assert bounds == [f"bounds.{kind}.max_speed_m_s" for kind in BETWEEN.get(name, ())]
        given = {one.name: one.value for one in kept[name].parameters if one.origin == "rule_set"}
        assert given == dict(check["with"])


_ENDINGS = {
    "_rad_s": "rad/s",
    "_m_s2": "m/s2",
    "_m_s": "m/s",
    "_rad": "rad",
    "_kg": "kg",
    "_m": "m",
    "_s": "s",
}


@pytest.mark.parametrize("group", ["ariac_score.rules", "ariac_score.monitors"])
def test_every_shipped_number_with_a_unit_in_its_name_declares_that_unit(group: str) -> None:
    for plugin in REGISTRY.all(group):
        for name, declared in parameters_of(plugin.load()).items():
            wanted = next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), None)
            assert wanted in (None, declared.facts.unit), f"{plugin.name}: {name}"


# It prices nothing ---------------------------------------------------------------------


def test_nothing_is_priced_by_it(result: Result) -> None:
    bare = replace(result, measured=replace(result.measured, settings=None))

    check_follows(bare)
    assert measured_sha256(bare) == measured_sha256(result)
    assert reprice(bare, load_rule_set("paper2020.published")).score == result.score


def test_it_comes_back_to_the_byte_and_keeps_the_schema(result: Result, tmp_path: Path) -> None:
    text = as_json(result)
    (tmp_path / "result.json").write_text(text)

    again = load_result(tmp_path / "result.json")
    assert again.measured.settings == result.measured.settings
    assert as_json(again) == text
    assert schema_errors(json.loads(text), "result") == []


def test_a_result_of_a_version_that_kept_none_stays_as_it_was(result: Result, tmp_path: Path) -> None:
    bare = replace(result, measured=replace(result.measured, settings=None))
    text = as_json(bare)
    assert '"settings": null' in text
    (tmp_path / "old.json").write_text(text)

    old = load_result(tmp_path / "old.json")
    assert as_json(old) == text
    assert reprice(old, load_rule_set("paper2020.published")).measured.settings is None
    assert main(["verify", str(tmp_path / "old.json")]) == 8
    step = next(s for s in verify_result(tmp_path / "old.json", log=LOG).steps if s.name == "recomputed")
    assert step.words == "the same score, ledger and findings; the result does not keep its settings"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("between_samples: bounded\n", "between_samples: held, and these rules have bounded"),
        (
            "bounds: {human: {max_speed_m_s: 1.6, source: a walk}}\n",
            "bounds.human.max_speed_m_s: 4.0, and these rules have 1.6",
        ),
        ("bounds: {human: {max_speed_m_s: 4.0, source: a run}}\n", ""),
    ],
)
def test_gaps_that_were_bounded_otherwise_have_no_other_price(
    result: Result, tmp_path: Path, more: str, said: str
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"extends: paper2020.published\nid: mine\ntitle: Mine\nsource: here\n{more}")

    if said:
        with pytest.raises(RuleSetError, match=said):
            reprice(result, load_rule_set(str(mine)))
    else:
        assert reprice(result, load_rule_set(str(mine))).score == result.score


def test_new_prices_keep_what_was_set_under_new_names(result: Result, tmp_path: Path) -> None:
    text = (ROOT / "rules/paper2020/published.yaml").read_text()
    mine = tmp_path / "mine.yaml"
    mine.write_text(re.sub(r"(?<![._])\bseparation\b", "apart", text))

    again = reprice(result, load_rule_set(str(mine)))
    kept, then = again.measured.settings, result.measured.settings
    assert kept is not None
    assert then is not None
    assert list(kept) == list(again.checks)
    assert kept["apart"] == then["separation"]


def test_an_edited_setting_is_found_with_the_log(result: Result, tmp_path: Path) -> None:
    kept = dict(result.measured.settings or {})
    at = next(i for i, one in enumerate(kept["separation"].parameters) if one.name == "max_gap_s")
    changed = list(kept["separation"].parameters)
    changed[at] = structs.replace(changed[at], value=0.5)
    kept["separation"] = structs.replace(kept["separation"], parameters=tuple(changed))
    file = tmp_path / "edited.json"
    file.write_text(as_json(replace(result, measured=replace(result.measured, settings=kept))))

    (step,) = [s for s in verify_result(file, log=LOG).steps if s.outcome == "failed"]
    assert (step.name, f"$.measured.settings.separation.parameters[{at}].value: 0.5" in step.words) == (
        "recomputed",
        True,
    )


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("delta_m", lambda one: structs.replace(one, value=1.6)),
        ("max_gap_s", lambda one: structs.replace(one, origin="rule_set")),
        ("delta_m", lambda one: structs.replace(one, name="gamma_m")),
    ],
)
def test_settings_that_are_not_those_of_the_rules_are_found_without_the_log(
    name: str, change: Any, result: Result, tmp_path: Path
) -> None:
    kept = dict(result.measured.settings or {})
    edited = tuple(change(one) if one.name == name else one for one in kept["separation"].parameters)
    kept["separation"] = structs.replace(kept["separation"], parameters=edited)
    file = tmp_path / "edited.json"
    file.write_text(as_json(replace(result, measured=replace(result.measured, settings=kept))))

    (step,) = [s for s in verify_result(file).steps if s.outcome == "failed"]
    assert step.name == "rules"
    assert "settings of 'separation' give" in step.words


@pytest.mark.parametrize(
    "damage",
    [
        lambda told: told["separation"].update(more=1),
        lambda told: told["separation"]["parameters"][0].pop("value"),
        lambda told: told["separation"]["parameters"][0].update(origin="thin air"),
        lambda told: told["separation"]["parameters"][0].update(unit=5),
        lambda told: told.update(separation=[]),
    ],
)
def test_settings_that_are_none_are_refused(damage: Any, result: Result, tmp_path: Path) -> None:
    data = json.loads(as_json(result))
    damage(data["measured"]["settings"])
    file = tmp_path / "damaged.json"
    file.write_text(json.dumps(data))

    with pytest.raises(ResultError, match="settings"):
        load_result(file)


# Strangers' plugins --------------------------------------------------------------------


@dataclass(frozen=True)
class Strange:
    """A monitor with every kind of default.

    Source:
        A stranger,
        who says so.
    """

    reach_m: float = math.inf
    words: object = field(default_factory=object)
    names: tuple[str, ...] = ("a", "b")
    grid_m: tuple[tuple[float, ...], ...] = parameter(((0.1 + 0.2, 1.0),), unit="m")
    limit_m: float = 0.5
    strict: bool = True
    come_to: Any = None

    def needs(self) -> Iterator[SignalNeed]:
        return iter(())

    def watch(self, _trial: Trial) -> Iterator[Finding]:
        yield Finding.satisfied("trial", "fine")


@dataclass(frozen=True)
class Choosing(Strange):
    def resolved(self) -> Any:
        return self.come_to()


def _of(check: Any, tmp_path: Path) -> Settings:
    rule_set = rules(tmp_path, "iso_10218_1.reduced_speed", {})
    prepared = prepare(rule_set)
    stranger = PreparedCheck(
        "it", Plugin("stranger.it", "ariac_score.monitors", "stranger:It", "stranger", "1.0"), check, ()
    )
    return settings_of(replace(prepared, checks={"it": stranger}))["it"]


def test_any_default_can_stand_in_a_result(tmp_path: Path) -> None:
    found = _of(Strange(), tmp_path)

    assert found.source == "A stranger, who says so."
    told = {one.name: (one.value, one.unit) for one in found.parameters}
    assert told["reach_m"] == ("inf", "")
    assert told["words"] == ("(object)", "")  # never an address: it would differ from run to run
    assert told["names"] == (["a", "b"], "")
    assert told["grid_m"] == ([[0.3, 1.0]], "m")
    assert told["limit_m"] == (0.5, "")  # a unit is declared, never guessed from a name
    assert told["strict"] == (True, "")
    assert [one.name for one in found.parameters] == [f.name for f in fields(Strange)]


@pytest.mark.parametrize(
    ("come_to", "words"),
    [
        (lambda: 1 / 0, "raised ZeroDivisionError when it resolved its parameters"),
        (lambda: None, "raised TypeError when it resolved its parameters"),
        (lambda: {"rech_m": 1.0}, "resolves 'rech_m', which is no parameter of it"),
    ],
)
def test_a_plugin_that_cannot_say_what_its_parameters_come_to_is_named(
    come_to: Any, words: str, tmp_path: Path
) -> None:
    with pytest.raises(PluginError, match=words) as caught:
        _of(Choosing(come_to=come_to), tmp_path)
    assert "stranger" in str(caught.value.cause)


@pytest.mark.parametrize(
    ("come_to", "words"),
    [
        (lambda: 1 / 0, "raised ZeroDivisionError when asked what its parameters come to"),
        (lambda: {"rech_m": 1.0}, "says what 'rech_m' comes to, which is no parameter of it"),
        (lambda: {"reach_m": next(_COUNT)}, "come to something else when asked again"),
    ],
)
def test_the_contract_holds_a_plugin_to_what_it_says_of_its_parameters(come_to: Any, words: str) -> None:
    (check,) = [c for c in contract_checks(Choosing(come_to=come_to), made_trial()) if c.name == "resolved"]

    with pytest.raises(ContractError, match=words):
        check()


def test_the_shipped_profiles_keep_that_contract() -> None:
    kind = REGISTRY.find("ariac_score.monitors", "iso_ts_15066.ssm_separation").load()
    for profile in ("seed", "ariac2023", "ariac2023_agent", "standard"):
        (check,) = [c for c in contract_checks(kind(profile=profile), made_trial()) if c.name == "resolved"]
        check()


# On the page ---------------------------------------------------------------------------


def test_the_page_says_every_value_and_whose_it_is(result: Result) -> None:
    page = trial_page(result, as_json(result))
    table = page[page.index('id="parameters"') : page.index('id="origin"')]

    for one in (result.measured.settings or {})["separation"].parameters:
        assert f"<bdi>{one.name}</bdi>" in table
    assert "<bdi>2.6 m</bdi>" in table
    assert "our choice: catalogue, 1.4" in table
    assert "plugin&#39;s default" in table
    assert "did not keep defaults" not in page


def test_the_page_of_an_old_result_says_that_it_kept_no_defaults(result: Result) -> None:
    bare = replace(result, measured=replace(result.measured, settings=None))
    page = trial_page(bare, as_json(bare))
    table = page[page.index('id="parameters"') : page.index('id="origin"')]

    assert "made by a version that did not keep defaults. For its checks only" in table
    assert "plugin&#39;s default" not in table
    assert "<bdi>contact_distance_m</bdi>" in table


def test_hostile_parameters_are_text_on_the_page(result: Result) -> None:
    script = "<script>alert(1)</script>"
    told = Settings(script, (Setting(script, [script], script, "default", script, script),))
    hostile = replace(result, measured=replace(result.measured, settings={"separation": told}))
    page = trial_page(hostile, as_json(hostile))

    assert script not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "For some checks only" in page
