"""Rule sets, log maps and penalties of installed distributions: by name, extended, refused, recorded."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ariac_score import as_json, load_log_map, load_rule_set, score_trial
from ariac_score.batch.tasks import BatchSetting, Limits
from ariac_score.checks.registry import Registry, package_sha256
from ariac_score.cli import main
from ariac_score.engine.prepared import prepare
from ariac_score.engine.provenance import code_of
from ariac_score.errors import LogMapError, PluginConflictError, PluginError, RuleSetError, UsageError
from ariac_score.platforms.submission import LOG_MAP, rules_and_log_map
from ariac_score.results.result_file import load_result
from ariac_score.review.verify import verify_result
from ariac_score.scoring.ruleset import installed_rule_sets, rule_set_names
from ariac_score.testing import write_trial_log
from ariac_score.trial.model import Body
from ariac_score_ariac.testing import kitting_trial

Install = Callable[..., str]
SETS, MAPS, PENALTIES = (f"ariac_score.{name}" for name in ("rule_sets", "log_maps", "penalties"))

CUP = """\
id: cup
title: Teahouse cup
source: our rules, page 1
log_map: cup
monitors:
  calm: {use: ariac.no_event, with: {kind: spill}}
score: 100 - 10 * count(calm)
"""
FINALS = "{id: cup.finals, title: The finals, source: page 2, extends: cup, score: 50 - 10 * count(calm)}\n"
MAP = """\
id: cup
title: What our recorder writes
source: our recorder
speed_window_s: 0.2
bodies: {waiter: {kind: robot, radius_m: 0.3}, guest: {kind: human}}
channels:
  - topic: /waiter
    type: geometry_msgs/msg/PointStamped
    signals: {position/waiter: [point.x, point.y, point.z]}
    witnesses: [spill]
  - {topic: /guest, signals: {speed/guest: v}}
models:
  - {match: "person_*", kind: human}
"""
GATE = """\
id: cup.mild
title: Half the points
source: our rules, page 3
in_words: what was earned, halved by each critical violation
terms:
  factor: {each: "0.5 ** count(CHECK)", join: " * "}
  penalised_score: earned * factor
"""


@pytest.fixture(autouse=True)
def _own_hashes() -> Iterator[None]:
    yield
    package_sha256.cache_clear()


@pytest.fixture
def cup(install: Install) -> str:
    """A distribution with a folder of two rule sets, one log map and one penalty."""
    return install(
        "cup-score",
        {"cup": "rules"},
        group=SETS,
        files={
            "rules/ruleset.yaml": CUP,
            "rules/finals.yaml": FINALS,
            "rules/log_map.yaml": MAP,
            "mild.yaml": GATE,
        },
        also={MAPS: {"cup": "rules.log_map"}, PENALTIES: {"cup.mild": "mild"}},
    )


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_trial_log(tmp_path / "trial.jsonl", kitting_trial())


def sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def foreign(result: object) -> list[tuple[str, str, str]]:
    code = result.provenance.code  # type: ignore[attr-defined]
    return [(c.distribution, c.version, c.package) for c in code if c.distribution != "ariac-score"]


# Names -----------------------------------------------------------------------------------


def test_a_folder_of_rule_sets_gives_each_file_a_name_and_its_main_file_the_name_of_the_entry_point(
    cup: str,
) -> None:
    assert [name for name in rule_set_names() if "cup" in name] == ["cup", "cup.finals"]
    assert load_rule_set("cup").title == "Teahouse cup"
    assert load_rule_set("cup.finals").checks.keys() == {"calm"}
    assert load_log_map("cup").speed_window_s == 0.2


@pytest.mark.slow
def test_rules_list_says_who_brings_a_rule_set_and_rules_show_prints_it(
    cup: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rules", "list"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["cup.finals"].endswith("The finals (cup-score 1.0)")
    assert "(" not in lines["ariac2020.as_coded"].removesuffix(")")[-20:]

    assert main(["rules", "show", "cup"]) == 0
    assert capsys.readouterr().out == CUP
    assert main(["rules", "validate", "cup", "cup.finals"]) == 0


def test_a_trial_is_scored_by_the_name_of_a_foreign_rule_set(
    cup: str, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["score", str(log), "--rules", "cup"]) in (0, 6)
    assert "cup" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["cu", "cup.final", "cup.finals.x", "cup.log_map", "cupp"])
def test_a_name_that_no_file_has_is_refused_and_near_ones_are_named(cup: str, name: str) -> None:
    with pytest.raises(UsageError, match=f"no rule set '{name}'") as refused:
        load_rule_set(name)

    assert refused.value.hint


def test_a_rule_set_that_two_distributions_bring_is_refused_and_both_are_named(
    install: Install, cup: str
) -> None:
    """One as a file of a folder, one by itself: what counts is the name that people use."""
    install("foul-cup", {"cup.finals": "f"}, group=SETS, files={"f.yaml": FINALS})

    with pytest.raises(
        PluginConflictError, match=r"'cup.finals' is provided by cup-score 1.0 and foul-cup 1.0"
    ):
        load_rule_set("cup.finals")
    assert load_rule_set("cup").id == "cup"


@pytest.mark.parametrize("target", ["nowhere", "rules.nowhere", ""])
def test_an_entry_point_that_leads_to_no_file_is_named(install: Install, target: str) -> None:
    install("odd-cup", {"odd": target or "x.y"}, group=SETS, files={"rules/a.yaml": CUP})

    with pytest.raises(PluginError, match="no file lies") as refused:
        load_rule_set("odd")
    assert "odd-cup 1.0" in str(refused.value)
    assert "paper2020.published" in rule_set_names()


def test_a_distribution_whose_package_cannot_be_imported_stops_only_its_own_rule_sets(
    install: Install, tmp_path: Path
) -> None:
    module = install(
        "odd-cup", {"odd": "rules"}, group=SETS, source="1 / 0", files={"rules/ruleset.yaml": CUP}
    )
    entry = next(tmp_path.rglob("odd_cup-1.0.dist-info")) / "entry_points.txt"
    entry.write_text(f"[{SETS}]\nodd = {module}.rules\n", encoding="utf-8")

    with pytest.raises(PluginError, match=r"odd-cup 1\.0.*ZeroDivisionError"):
        load_rule_set("odd")
    assert load_rule_set("paper2020.published").id == "paper2020.published"


@pytest.mark.slow
def test_a_rule_set_with_a_fault_stops_neither_the_list_nor_audits(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install("odd-cup", {"odd": "odd"}, group=SETS, files={"odd.yaml": "id: odd\n"})

    assert "odd" not in {one.id for one in installed_rule_sets()}
    assert main(["rules", "list"]) == 0
    assert "CANNOT BE USED: key" in capsys.readouterr().out


# Provenance -----------------------------------------------------------------------------


def test_the_distribution_of_rules_and_log_map_stands_in_the_result(cup: str, log: Path) -> None:
    result = score_trial(log, "cup")

    assert foreign(result) == [("cup-score", "1.0", cup)]
    assert result.provenance.rule_set.sha256 == sha256(result.rules)
    assert result.provenance.log_map.sha256 == sha256(MAP)


def test_a_rule_set_of_ones_own_that_only_has_the_name_of_an_installed_one_is_not_from_there(
    cup: str, log: Path, tmp_path: Path
) -> None:
    (tmp_path / "own.yaml").write_text(
        CUP.replace("log_map: cup", "log_map: ariac2020").replace("100", "99"), encoding="utf-8"
    )

    assert foreign(score_trial(log, str(tmp_path / "own.yaml"))) == []


def test_a_batch_that_is_sent_the_rules_as_text_names_the_same_origin(cup: str) -> None:
    direct = prepare("cup")
    sent = prepare(BatchSetting.of(direct.rule_set, Limits()).rule_set())

    assert code_of(sent) == code_of(direct)
    assert {distribution for distribution, *_ in code_of(direct)} == {"ariac-score", "cup-score"}


PENALTY_OF_CUP = "include: [cup.mild]\nsafety: {calm: {class: limit}}\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rules", "brought"),
    [
        ("title: Extended\nextends: cup\nlog_map: ariac2020\n", "cup-score"),
        ("title: Twice\nextends: derby\nlog_map: ariac2020\n", "cup-score derby-score"),
        (CUP.replace("log_map: cup", "log_map: ariac2020") + PENALTY_OF_CUP, "cup-score"),
        (CUP.replace("log_map: cup", "log_map: ./map.yaml"), "cup-score"),
        (CUP.replace("log_map: cup", "log_map: ariac2020"), ""),
    ],
)
def test_what_a_rule_set_of_ones_own_is_made_of_stands_in_the_result_and_where_it_is_sent_as_text(
    install: Install, cup: str, log: Path, tmp_path: Path, rules: str, brought: str
) -> None:
    text = "{id: derby, title: Derby, source: ours, extends: cup.finals}"
    install("derby-score", {"derby": "derby"}, group=SETS, files={"derby.yaml": text})
    (tmp_path / "map.yaml").write_text("{id: m, title: Map, source: ours, extends: cup}", encoding="utf-8")
    own = tmp_path / "own.yaml"
    body = rules.removeprefix("id: cup\n").replace("source: our rules, page 1\n", "")
    own.write_text(f"id: own\nsource: ours\n{body}", encoding="utf-8")

    result = score_trial(log, own)

    assert sorted(distribution for distribution, *_ in foreign(result)) == brought.split()
    sent = BatchSetting.of(load_rule_set(own), Limits()).rule_set()
    assert foreign(score_trial(log, sent)) == foreign(result)
    stored = tmp_path / "result.json"
    stored.write_text(as_json(result), encoding="utf-8")
    if "./map.yaml" not in rules:  # the rules in the result name it, and lie in no folder
        steps = verify_result(stored, log=log).steps
        assert {step.name: step.outcome for step in steps}["recomputed"] == "ok"


def test_a_result_by_a_foreign_rule_set_is_verified_to_the_byte(cup: str, log: Path, tmp_path: Path) -> None:
    stored = tmp_path / "result.json"
    stored.write_text(as_json(score_trial(log, "cup")), encoding="utf-8")

    steps = verify_result(stored, log=log).steps
    assert {step.name: step.outcome for step in steps}["recomputed"] == "ok"
    assert load_result(stored).provenance.rule_set.id == "cup"


# Extending ------------------------------------------------------------------------------


def test_a_rule_set_extends_one_of_another_distribution(install: Install, cup: str) -> None:
    text = "{id: derby, title: Derby, source: ours, extends: cup.finals, score: 7 - count(calm)}"
    install("derby-score", {"derby": "derby"}, group=SETS, files={"derby.yaml": text})

    derby = load_rule_set("derby")
    assert (derby.checks.keys(), derby.log_map) == ({"calm"}, "cup")
    assert derby.sha256 == sha256(derby.text)


def extending(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "own.yaml"
    path.write_text(f"id: own\ntitle: Own\nsource: ours\nextends: cup\n{text}", encoding="utf-8")
    return path


def test_a_log_map_extends_another_key_by_key(cup: str, tmp_path: Path) -> None:
    path = extending(
        tmp_path,
        """\
speed_window_s: 0.5
bodies: {waiter: {kind: robot, radius_m: 0.4}, cat: {kind: human}}
channels:
  - topic: waiter
    signals: {speed/waiter: v}
  - {topic: /cat, signals: {speed/cat: v}}
models:
  - {match: "person_vip", kind: robot}
""",
    )

    own = load_log_map(str(path))

    assert (own.id, own.speed_window_s) == ("own", 0.5)
    assert own.bodies == (Body("waiter", "robot", 0.4), Body("guest", "human"), Body("cat", "human"))
    waiter, cat, guest = own.channels
    assert (waiter.topic, cat.topic, guest.topic) == ("/waiter", "/cat", "/guest")
    assert waiter.type == "geometry_msgs/msg/PointStamped"
    assert [field.signal for field in waiter.signals] == ["position/waiter", "speed/waiter"]
    assert waiter.witnesses == ("spill",)
    # The narrower pattern stands first, for the first that fits counts.
    assert [model.match for model in own.models] == ["person_vip", "person_*"]


def test_a_channel_of_another_message_type_is_another_channel(cup: str, tmp_path: Path) -> None:
    text = "channels: [{topic: /waiter, type: a/msg/B, signals: {speed/waiter: v}}]\n"

    channels = load_log_map(str(extending(tmp_path, text))).channels

    assert [(c.topic, c.type) for c in channels] == [
        ("/waiter", "a/msg/B"),
        ("/waiter", "geometry_msgs/msg/PointStamped"),
        ("/guest", ""),
    ]


def test_the_hash_of_a_log_map_covers_what_it_extends(cup: str, tmp_path: Path) -> None:
    path = extending(tmp_path, "")
    own = sha256(path.read_text(encoding="utf-8"))

    assert load_log_map(str(path)).sha256 == sha256(f"{own} extends {sha256(MAP)}")


@pytest.mark.parametrize(
    ("base", "cause"),
    [("own.yaml", "circle"), ("nowhere", "no log map 'nowhere'"), ("./nowhere.yaml", "no such file")],
)
def test_a_base_that_cannot_be_had_is_refused(cup: str, tmp_path: Path, base: str, cause: str) -> None:
    path = extending(tmp_path, "")
    path.write_text(path.read_text().replace("extends: cup", f"extends: {base}"), encoding="utf-8")

    with pytest.raises(LogMapError, match=cause) as refused:
        load_log_map(str(path))
    assert refused.value.hint


def test_a_fault_of_the_base_is_said_of_its_file_and_one_of_the_extension_of_its_own(
    install: Install, tmp_path: Path
) -> None:
    install("odd-cup", {"cup": "m"}, group=MAPS, files={"m.yaml": MAP.replace("speed/guest", "sped/guest")})
    with pytest.raises(LogMapError, match="unknown quantity 'sped'") as refused:
        load_log_map(str(extending(tmp_path, "")))
    assert refused.value.file is not None
    assert refused.value.file.endswith("m.yaml")


def test_a_fault_of_an_extension_is_placed_at_its_line(cup: str, tmp_path: Path) -> None:
    path = extending(tmp_path, "channels:\n  - topic: /waiter\n    signals: {sped/waiter: v}\n")

    with pytest.raises(LogMapError, match="unknown quantity 'sped'") as refused:
        load_log_map(str(path))
    assert (refused.value.file, refused.value.place) == (
        str(path),
        "line 7, $.channels[0].signals.sped/waiter",
    )


def test_a_platform_is_given_a_log_map_that_stands_alone(cup: str, tmp_path: Path) -> None:
    path = extending(tmp_path, "speed_window_s: 0.7\n")
    (tmp_path / "rules.yaml").write_text(CUP.replace("log_map: cup", "log_map: ./own.yaml"), encoding="utf-8")

    files = rules_and_log_map(BatchSetting.of(load_rule_set(str(tmp_path / "rules.yaml")), Limits()))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/map.yaml").write_bytes(files[LOG_MAP])

    alone = load_log_map(str(tmp_path / "elsewhere/map.yaml"))
    assert b"extends" not in files[LOG_MAP]
    assert (alone.channels, alone.speed_window_s) == (load_log_map(str(path)).channels, 0.7)


# Penalties ------------------------------------------------------------------------------


def test_a_rule_set_includes_a_penalty_of_a_distribution(cup: str, tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(f"{CUP}include: [cup.mild]\nsafety: {{calm: {{class: limit}}}}\n", encoding="utf-8")

    terms = load_rule_set(str(path)).sheet.terms["trial"]

    assert terms["factor"].source == "0.5 ** count(calm)"
    assert Registry().file(PENALTIES, "cup.mild").plugin.origin == "cup.mild (cup-score 1.0)"


def test_an_unknown_penalty_is_refused_with_those_that_are_installed(cup: str, tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(f"{CUP}include: [cup.mil]\nsafety: {{calm: {{class: limit}}}}\n", encoding="utf-8")

    with pytest.raises(RuleSetError, match=r"no penalty 'cup\.mil'") as refused:
        load_rule_set(str(path))
    assert "cup.mild" in refused.value.hint
