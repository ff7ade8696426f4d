"""Finding plugins: every shipped one, strangers' by the same door, and all that can be wrong with them."""

from __future__ import annotations

import inspect
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any, Protocol

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import Plugin, Registry, package_sha256, parameters_of
from ariac_score.cli import main
from ariac_score.engine.prepared import prepare
from ariac_score.errors import (
    PluginConflictError,
    PluginError,
    PluginNotFoundError,
    RuleSetError,
)

EXAMPLE = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
RULES, MONITORS = "ariac_score.rules", "ariac_score.monitors"

SHIPPED = {
    RULES: [
        "aic.contacts",
        "aic.finals_force",
        "aic.force_bounds",
        "aic.force_time",
        "aic.insertion",
        "aic.insertion_in_port",
        "aic.path_length",
        "aic.polynomial_jerk",
        "aic.pose_jerk",
        "aic.seen_jerk",
        "aic.start_distance",
        "aic.task_path",
        "aic.task_time",
        "aic.watched_contacts",
        "assembly.counters",
        "assembly.insert",
        "assembly.pairs",
        "assembly.part",
        "assembly.reported",
        "kitting.destination",
        "kitting.extra_parts",
        "kitting.none_faulty",
        "kitting.none_missing",
        "kitting.none_unwanted",
        "kitting.only_kitting",
        "kitting.order_submitted",
        "kitting.order_time",
        "kitting.pose",
        "kitting.presence",
        "kitting.quadrant",
        "kitting.right_number",
        "kitting.submitted",
        "kitting.task_kind",
        "kitting.tray",
        "kitting.tray_number",
        "kitting.wrong_color_pose",
        "official.order",
        "official.printed",
        "run.order",
    ],
    MONITORS: [
        "aic.off_limit_contact",
        "aic.wrist_force",
        "ariac.collision_episodes",
        "ariac.human_contact",
        "ariac.no_event",
        "formula.always",
        "formula.never",
        "formula.within",
        "iec_60204_1.stop_performance",
        "iso_10218_1.reduced_speed",
        "iso_10218_1.space_limit",
        "iso_10218_2.hand_guiding",
        "iso_10218_2.monitored_standstill",
        "iso_10218_2.pfl_contact",
        "iso_10218_2.pfl_speed",
        "iso_13850.estop_restart",
        "iso_13854.crush_gap",
        "iso_13855.safeguard_distance",
        "iso_3691_4.agv_protective_field",
        "iso_3691_4.agv_speed_clearance",
        "iso_9283.pose_performance",
        "iso_ts_15066.ssm_response",
        "iso_ts_15066.ssm_separation",
        "iso_ts_15066.ssm_speed_cap",
        "log.signal_coverage",
        "official.trial",
        "proxemics.proximity_comfort",
        "rml.spec",
        "run.record",
        "stl.formula",
        "team.positive_sensor_cost",
        "team.sensor_cost",
    ],
    "ariac_score.readers": [
        "aic.bag",
        "aic.config",
        "aic.scoring",
        "aic.task_times",
        "ariac_config",
        "ariac_database",
        "ariac_team",
        "ariac_team_name",
        "gazebo",
        "gazebo_text",
        "jsonl",
        "ros_monitoring",
        "rosbag",
        "sensor_cost",
        "trial_log",
    ],
    "ariac_score.decoders": [
        "ariac.agv1_state",
        "ariac.agv2_state",
        "ariac.agv3_state",
        "ariac.agv4_state",
        "ariac.console",
        "ariac.current_score",
        "ariac.kit_calls",
        "ariac.module_calls",
        "ariac.service_calls",
        "ariac_interfaces.2025",
        "ariac_msgs.2023",
        "ariac_score.events",
        "ariac_score.records",
        "nist_gear.2020",
        "nist_gear.2021",
        "nist_gear.2022",
        "osrf_gear.2017",
        "osrf_gear.2018",
        "osrf_gear.2019",
    ],
    "ariac_score.tracks": ["ariac.models"],
    "ariac_score.record_kinds": ["order", "submission"],
    "ariac_score.competitions": ["aic", "ariac"],
}


MUST_BE_TOLD: dict[str, dict[str, Any]] = {
    "stl.formula": {"formula": "always d > 1", "signals": {"d": "centre_distance in m"}},
}
"""Parameters without which a plugin has nothing to judge."""


class Install(Protocol):
    def __call__(
        self,
        distribution: str,
        points: dict[str, str],
        *,
        source: str = "",
        version: str = "1.0",
        group: str = RULES,
    ) -> str: ...


FINE = """
from dataclasses import dataclass
from typing import Literal
from ariac_score import Finding

@dataclass(frozen=True)
class Fine:
    limit_m: float = 1.0
    times: int = 1
    strict: bool = False
    word: str = "x"
    side: Literal["left", "right"] = "left"
    maybe_s: float | None = None
    names: tuple[str, ...] = ()

    def judge(self, trial, order):
        yield Finding.satisfied(order.id, "fine")
"""


# What is shipped -----------------------------------------------------------------------


@pytest.mark.parametrize(("group", "name"), [(g, n) for g, names in SHIPPED.items() for n in names])
def test_every_shipped_plugin_is_found_built_and_keeps_its_contract(group: str, name: str) -> None:
    plugin = Registry().find(group, name)

    assert isinstance(plugin.build(MUST_BE_TOLD.get(name, {})), GROUPS[group])
    assert plugin.distribution == "ariac-score"
    assert plugin.origin == f"{name} (ariac-score {plugin.version})"


@pytest.mark.parametrize("group", GROUPS)
def test_nothing_is_shipped_that_this_list_does_not_know(group: str) -> None:
    ours = {plugin.name for plugin in Registry().all(group) if plugin.distribution == "ariac-score"}

    assert ours == set(SHIPPED[group])


@pytest.mark.parametrize("group", GROUPS)
def test_names_come_sorted(group: str) -> None:
    assert Registry().names(group) == sorted(Registry().names(group))


@pytest.mark.parametrize("name", SHIPPED[RULES] + SHIPPED[MONITORS])
def test_the_docstring_of_every_check_is_its_help_page(name: str) -> None:
    kind = Registry().find(RULES if name in SHIPPED[RULES] else MONITORS, name).load()

    page = inspect.cleandoc(kind.__doc__)  # from 3.13 on Python takes the indent away itself

    assert all(f"\n{part}:\n" in page for part in ("Measures", "Violated when", "Source"))


# Strangers -----------------------------------------------------------------------------


def test_a_strangers_plugin_comes_in_by_the_same_door(install: Install) -> None:
    install("fair-play", {"fair.play": "Fine"}, source=FINE, version="2.3")

    plugin = Registry().find(RULES, "fair.play")

    assert (plugin.distribution, plugin.version, plugin.package) == ("fair-play", "2.3", "stranger_fair_play")
    assert plugin.build({"limit_m": 2}).limit_m == 2.0


def test_an_unknown_name_is_refused_with_the_nearest_known_one() -> None:
    with pytest.raises(PluginNotFoundError, match=r"'kitting\.poze'") as error:
        Registry().find(RULES, "kitting.poze")

    assert "did you mean 'kitting.pose'?" in error.value.hint


def test_a_name_of_another_group_is_refused_and_the_group_named() -> None:
    with pytest.raises(PluginNotFoundError) as error:
        Registry().find(MONITORS, "kitting.pose")

    assert "it is a plugin of ariac_score.rules" in error.value.hint


def test_two_distributions_with_one_name_are_refused_and_both_named(install: Install) -> None:
    install("fair-play", {"fair.play": "Fine", "fair.other": "Fine"}, source=FINE, version="2.3")
    install("foul-play", {"fair.play": "Fine"}, source=FINE, version="0.1")
    registry = Registry()

    with pytest.raises(PluginConflictError) as error:
        registry.find(RULES, "fair.play")

    assert "fair-play 2.3" in str(error.value)
    assert "foul-play 0.1" in str(error.value)
    assert registry.find(RULES, "fair.other").distribution == "fair-play"  # the rest still works


def test_a_stranger_cannot_take_the_name_of_a_shipped_plugin(install: Install) -> None:
    install("foul-play", {"kitting.pose": "Fine"}, source=FINE)

    with pytest.raises(PluginConflictError, match=r"foul-play 1\.0"):
        Registry().find(RULES, "kitting.pose")


@pytest.mark.parametrize("first", ["a", "b"])
def test_the_order_of_the_path_chooses_no_referee(install: Install, first: str) -> None:
    for distribution in ("a", "b") if first == "a" else ("b", "a"):
        install(f"{distribution}-rules", {"fair.play": "Fine"}, source=FINE)

    with pytest.raises(PluginConflictError, match=r"a-rules 1\.0 and b-rules 1\.0"):
        Registry().find(RULES, "fair.play")


def test_one_distribution_seen_twice_is_no_conflict(monkeypatch: pytest.MonkeyPatch) -> None:
    (once,) = entry_points(group=RULES, name="kitting.pose")
    monkeypatch.setattr("ariac_score.installed.points.entry_points", lambda: EntryPoints([once, once]))

    assert Registry().find(RULES, "kitting.pose").target == once.value


BROKEN = {
    "raise RuntimeError('no licence')": "RuntimeError: no licence",
    "import a_module_that_nobody_has": "ModuleNotFoundError: No module named 'a_module_that_nobody_has'",
    "this is no Python": "SyntaxError",
    "class Other: ...": "AttributeError",
}


@pytest.mark.parametrize("source", BROKEN)
def test_a_plugin_that_cannot_be_imported_is_named_with_its_distribution(
    install: Install, source: str
) -> None:
    install("broken-rules", {"broken.rule": "Rule"}, source=source, version="7.1")
    registry = Registry()

    with pytest.raises(PluginError) as error:
        registry.find(RULES, "broken.rule").load()

    assert "plugin broken.rule (broken-rules 7.1) cannot be imported" in str(error.value)
    assert BROKEN[source] in str(error.value)
    assert registry.find(RULES, "kitting.pose").build({}) is not None  # it stops only what uses it


UNBUILDABLE = {
    "class Rule:\n    def __init__(self, limit, /): ...\n    def judge(self, t, o): ...": (
        "takes 'limit' by position alone"
    ),
    "class Rule:\n    def __init__(self, limit=1.0, /): ...\n    def judge(self, t, o): ...": (
        "takes 'limit' by position alone"
    ),
    "class Rule:\n    def __init__(self, wanted): ...\n    def judge(self, t, o): ...": "cannot be built",
    "class Rule:\n    def watch(self, trial): ...": "does not keep the contract of a Rule",
    "Rule = 3": "cannot be built",
    "def Rule(): return None": "does not keep the contract of a Rule",
}


@pytest.mark.parametrize("source", UNBUILDABLE)
def test_a_plugin_that_cannot_be_built_is_named_with_its_distribution(install: Install, source: str) -> None:
    install("broken-rules", {"broken.rule": "Rule"}, source=source, version="7.1")

    with pytest.raises(PluginError) as error:
        Registry().find(RULES, "broken.rule").build({})

    assert "plugin broken.rule (broken-rules 7.1)" in str(error.value)
    assert UNBUILDABLE[source] in str(error.value)


def test_a_constructor_that_raises_anything_is_named_with_its_distribution(install: Install) -> None:
    source = "class Rule:\n    def __init__(self): raise RuntimeError('x')\n    def judge(self, t, o): ..."
    install("broken-rules", {"broken.rule": "Rule"}, source=source)

    with pytest.raises(PluginError, match="broken-rules"):
        Registry().find(RULES, "broken.rule").build({})


def test_an_annotation_that_cannot_be_resolved_is_named_with_its_distribution(install: Install) -> None:
    annotated = FINE.replace("word: str", "word: 'OnlyForTheTypeChecker'")
    install("broken-rules", {"broken.rule": "Fine"}, source=annotated)

    with pytest.raises(PluginError, match="broken-rules"):
        Registry().find(RULES, "broken.rule").build({})


# Parameters ----------------------------------------------------------------------------


@pytest.fixture
def fine(install: Install) -> Plugin:
    install("fair-play", {"fair.play": "Fine"}, source=FINE)
    return Registry().find(RULES, "fair.play")


@pytest.mark.parametrize(
    ("given_", "built"),
    [
        ({"limit_m": 2}, 2.0),
        ({"limit_m": 0.5}, 0.5),
        ({"times": 3}, 3),
        ({"strict": True}, True),
        ({"word": "3"}, "3"),
        ({"side": "right"}, "right"),
        ({"maybe_s": None}, None),
        ({"maybe_s": 4}, 4.0),
        ({"names": ["a", "b"]}, ("a", "b")),
    ],
    ids=str,
)
def test_a_parameter_is_taken_as_the_type_its_field_declares(
    fine: Plugin, given_: dict[str, Any], built: Any
) -> None:
    value = getattr(fine.build(given_), next(iter(given_)))

    assert (value, type(value)) == (built, type(built))


@pytest.mark.parametrize(
    "given_",
    [
        {"limit_m": "1"},
        {"limit_m": True},
        {"limit_m": None},
        {"limit_m": [1.0]},
        {"limit_m": float("nan")},
        {"limit_m": float("-inf")},
        {"times": 1.0},
        {"times": True},
        {"strict": 1},
        {"strict": "yes"},
        {"word": 3},
        {"word": None},
        {"side": "up"},
        {"maybe_s": "soon"},
        {"maybe_s": float("inf")},
        {"names": "ab"},
        {"names": [1]},
    ],
    ids=str,
)
def test_a_parameter_of_another_type_is_refused_and_named(fine: Plugin, given_: dict[str, Any]) -> None:
    name = next(iter(given_))

    with pytest.raises(RuleSetError, match=rf"parameter '{name}' of fair\.play") as error:
        fine.build(given_, place=lambda where: f"line 7, {where}")

    assert error.value.place == f"line 7, {name}"


@given(st.floats() | st.integers(-(10**6), 10**6))
@settings(max_examples=100, derandomize=True, deadline=None)
def test_a_number_is_taken_exactly_when_it_is_finite(value: float) -> None:
    pose = Registry().find(RULES, "kitting.pose")

    if value - value == 0:
        assert pose.build({"max_distance_m": value}).max_distance_m == value
    else:
        with pytest.raises(RuleSetError, match="not finite"):
            pose.build({"max_distance_m": value})


def test_a_choice_that_looks_like_a_number_needs_its_quotes_and_is_told_so() -> None:
    plugin = Registry().find(MONITORS, "iso_13855.safeguard_distance")

    with pytest.raises(RuleSetError, match="2024 is not one of 2010, 2024") as refused:
        plugin.build({"edition": 2024})
    assert refused.value.hint == "it is text, not a number: write '2024' in quotes"
    assert plugin.build({"edition": "2024"}).edition == "2024"


def test_an_unknown_parameter_is_refused_with_the_nearest_known_one(fine: Plugin) -> None:
    with pytest.raises(RuleSetError, match=r"fair\.play has no parameter 'limit_mm'") as error:
        fine.build({"limit_mm": 1.0})

    assert error.value.hint == "did you mean 'limit_m'?"


def test_a_value_that_the_plugin_refuses_is_the_rule_sets_fault(install: Install) -> None:
    source = FINE + "\n    def __post_init__(self):\n        raise ValueError('limit_m is odd')\n"
    install("fair-play", {"fair.play": "Fine"}, source=source)

    with pytest.raises(RuleSetError, match=r"fair\.play refuses its parameters: limit_m is odd"):
        Registry().find(RULES, "fair.play").build({})


def test_a_plugin_that_is_no_dataclass_has_no_parameters(install: Install) -> None:
    install(
        "fair-play", {"fair.play": "Plain"}, source="class Plain:\n    def judge(self, trial, order): ..."
    )
    plugin = Registry().find(RULES, "fair.play")

    assert parameters_of(plugin.load()) == {}
    with pytest.raises(RuleSetError, match="no parameter 'limit_m'"):
        plugin.build({"limit_m": 1.0})


# Hashes --------------------------------------------------------------------------------


def package(folder: Path, name: str, files: dict[str, bytes]) -> str:
    for path, content in files.items():
        file = folder / name / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return package_sha256(name)


def test_the_hash_of_a_package_tells_contents_and_names_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    whole = {"__init__.py": b"", "rule.py": b"LIMIT = 1\n", "inner/more.py": b""}

    first = package(tmp_path, "stranger_hash_a", whole)

    assert package(tmp_path, "stranger_hash_b", whole) == first
    assert package(tmp_path, "stranger_hash_c", {**whole, "rule.py": b"LIMIT = 2\n"}) != first
    assert package(tmp_path, "stranger_hash_d", {**whole, "empty.py": b""}) != first
    moved = {"__init__.py": b"", "rule_.py": b"LIMIT = 1\n", "inner/more.py": b""}
    assert package(tmp_path, "stranger_hash_e", moved) != first
    assert package(tmp_path, "stranger_hash_f", {**whole, "rule.py": b"LIMIT = 1\r\n"}) == first
    assert package(tmp_path, "stranger_hash_g", {**whole, "notes.txt": b"x"}) == first


def test_a_package_that_is_not_on_disk_has_no_hash() -> None:
    with pytest.raises(PluginError, match="not on disk"):
        package_sha256("a_package_that_nobody_has")


OTHER_UNITS = """
from ariac_score import Finding, SignalNeed
class Speed:
    def needs(self): yield SignalNeed('speed', 'km/h')
    def watch(self, trial):
        yield Finding.satisfied('trial', f"{trial.signal('speed/robot', unit='km/h')}")
"""


def test_a_monitor_that_reads_another_unit_is_refused_with_a_remedy(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install("slow-rules", {"slow.speed": "Speed"}, source=OTHER_UNITS, version="6.6", group=MONITORS)
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "id: r\ntitle: R\nsource: a test\nextends: paper2020.published\nmonitors: {slow: {use: slow.speed}}\n"
    )

    for arguments in (["score", str(EXAMPLE), "--rules"], ["rules", "validate"]):
        assert main([*arguments, str(rules)]) == 4
        said = capsys.readouterr().err
        assert "check 'slow': plugin slow.speed (slow-rules 6.6) reads 'speed' in 'km/h'" in said
        assert "but it is measured in 'm/s'" in said
        assert "hint: read it in 'm/s'" in said


@pytest.mark.parametrize(("unit", "code"), [("bar", 4), ("Pa", 0)])
def test_a_quantity_of_the_log_map_has_the_unit_that_the_map_gives_it(
    unit: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "map.yaml").write_text(
        "id: m\ntitle: M\nsource: a test\nquantities: {pressure: {unit: Pa, of: body}}\n"
    )
    (tmp_path / "rules.yaml").write_text(
        "id: r\ntitle: R\nsource: a test\nlog_map: ./map.yaml\nscore: holds(grip)\nmonitors:\n  grip:\n"
        "    use: formula.always\n"
        f"    with: {{holds: p > 1, signals: {{p: 'pressure/{{robot}} [{unit}]'}}}}\n"
    )

    assert main(["rules", "validate", str(tmp_path / "rules.yaml")]) == code
    assert ("'pressure' in 'bar', but it is measured in 'Pa'" in capsys.readouterr().err) is (code != 0)


def test_a_monitor_that_asks_for_an_unknown_quantity_is_named_before_a_log_is_read(
    install: Install, tmp_path: Path
) -> None:
    source = (
        "from ariac_score import Finding, SignalNeed\n"
        "class Grip:\n"
        "    def needs(self): yield SignalNeed('forse', 'N')\n"
        "    def watch(self, trial): yield Finding.satisfied('trial', 'x')\n"
    )
    install("grip-rules", {"grip.force": "Grip"}, source=source, group=MONITORS)
    (tmp_path / "map.yaml").write_text(
        "id: m\ntitle: M\nsource: a test\nquantities: {force: {unit: N, of: body}}\n"
    )
    (tmp_path / "rules.yaml").write_text(
        "id: r\ntitle: R\nsource: a test\nlog_map: ./map.yaml\n"
        "monitors: {grip: {use: grip.force}}\nscore: holds(grip)\n"
    )
    prepared = prepare(str(tmp_path / "rules.yaml"))

    with pytest.raises(RuleSetError, match="'grip' asks for the quantity 'forse'") as refused:
        prepared.refuse_unknown_quantities()

    assert refused.value.hint.startswith("did you mean 'force'?")


# Distributions of others ---------------------------------------------------------------


@pytest.fixture(
    params=[b"[any.group]\na line without a value\n", b"[any.group]\nname = m:\xff\n"], ids=["=", "ff"]
)
def malformed(request: pytest.FixtureRequest, install: Install, tmp_path: Path) -> None:
    """A distribution, of anything, whose entry points cannot be read."""
    install("foul-points", {})
    (file,) = tmp_path.rglob("foul_points-1.0.dist-info/entry_points.txt")
    file.write_bytes(request.param)


@pytest.mark.usefixtures("malformed")
def test_entry_points_that_cannot_be_read_hide_no_other_plugin(install: Install) -> None:
    install("fair-play", {"fair.play": "Fine"}, source=FINE)
    registry = Registry()

    assert registry.find(RULES, "fair.play").distribution == "fair-play"
    assert set(registry.names(RULES)) >= set(SHIPPED[RULES])


@pytest.mark.slow
@pytest.mark.usefixtures("malformed")
def test_a_distribution_that_cannot_be_read_is_named_wherever_a_plugin_is_missed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = "foul-points 1.0: its entry points cannot be read"

    with pytest.raises(PluginNotFoundError) as missed:
        Registry().find(RULES, "foul.play")

    assert words in missed.value.hint
    assert main(["plugins", "doctor"]) == 1
    assert words in capsys.readouterr().out
    assert main(["plugins", "list"]) == 3
    assert words in capsys.readouterr().err
    assert main(["plugins", "show", "foul.play"]) == 4
    assert words in capsys.readouterr().err


def test_metadata_that_are_not_utf_8_leave_a_distribution_without_a_name(
    install: Install, tmp_path: Path
) -> None:
    install("fair-play", {"fair.play": "Fine"}, source=FINE)
    (file,) = tmp_path.rglob("fair_play-1.0.dist-info/METADATA")
    file.write_bytes(b"Name: \xff\n")

    assert Registry().find(RULES, "fair.play").distribution == "?"
