"""`plugins doctor` and its companions: what is wrong with an installed plugin, and which one it is."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from ariac_score.checks.registry import package_sha256
from ariac_score.cli import main
from ariac_score.testing import write_trial_log
from ariac_score.testing.doctor import ailments
from ariac_score_ariac.testing import kitting_trial

Install = Callable[..., str]

RULE = '''
from dataclasses import dataclass
from ariac_score import Finding

@dataclass(frozen=True)
class Rule:
    """Everything is fine.

    Measures:
        Nothing.
    Violated when:
        Never.
    Source:
        Nobody.
    """

    limit_m: float = 1.0

    def judge(self, trial, order):
        yield Finding.satisfied(order.id, "fine")
'''

ILL: dict[str, tuple[str, str, str]] = {
    "no such attribute": ("class Rule", "class Rool", "has no attribute 'Rule'"),
    "raises when imported": (
        "@dataclass",
        "raise RuntimeError('no licence')\n@dataclass",
        "RuntimeError: no licence",
    ),
    "no source": ("    Source:\n        Nobody.\n", "", "has no section 'Source' in its docstring"),
    "by position": (
        "    limit_m: float = 1.0\n",
        "    def __init__(self, limit_m=1.0, /): ...\n",
        "takes 'limit_m' by position alone",
    ),
    "raises when built": (
        "    limit_m: float = 1.0\n",
        "    def __post_init__(self): raise KeyError('x')\n",
        "cannot be built: KeyError",
    ),
    "called otherwise": (
        "def judge(self, trial, order)",
        "def judge(self, trial)",
        "has judge(self, trial) where",
    ),
    "of an older kind": ("def judge(", "def check(", "has no judge(trial, item)"),
    "no class": (
        "\n@dataclass",
        "\ndef Rule():\n    return 1\n\n@dataclass",
        "is a function, not a class",
    ),
}


def found(capsys: pytest.CaptureFixture[str]) -> str:
    """What the doctor says; something must be wrong."""
    assert main(["plugins", "doctor"]) == 1
    listed, _, problems = capsys.readouterr().out.partition("\n\n")
    assert re.search(r" BROKEN$", listed, re.MULTILINE)
    assert re.search(r"^rules +kitting.pose +ariac-score 0\S* +ok$", listed, re.MULTILINE)
    return problems


@pytest.mark.slow
def test_what_is_shipped_is_sound(capsys: pytest.CaptureFixture[str]) -> None:
    assert ailments() == []
    assert main(["plugins", "doctor"]) == 0
    listed, _, problems = capsys.readouterr().out.partition("\n\n")
    assert problems == "every installed plugin can be used\n"
    assert all(line.endswith(" ok") for line in listed.splitlines())
    kinds = {line.split()[0] for line in listed.splitlines()}
    assert kinds >= {"rules", "readers", "rule_sets", "log_maps", "penalties", "exports", "commands"}


@pytest.mark.slow
def test_a_sound_stranger_is_nothing_to_speak_of(install: Install) -> None:
    install("fair-rules", {"fair.play": "Rule"}, source=RULE)

    assert ailments() == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ILL)
def test_what_is_wrong_is_named_with_distribution_and_version(
    install: Install, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new, words = ILL[name]
    source = RULE.replace(old, new, 1)
    if name == "no class":
        source = source.replace("class Rule:", "class Other:")
    install("odd-rules", {"odd.rule": "Rule"}, source=source, version="6.6")

    printed = found(capsys)

    assert printed.startswith("odd.rule (odd-rules 6.6): ")
    assert words in printed
    assert "\n  hint: " in printed


@pytest.mark.slow
def test_an_entry_point_to_nothing_is_named(install: Install, tmp_path: Path) -> None:
    install("odd-rules", {"odd.rule": "Rule"}, source=RULE, version="6.6")
    (tmp_path / "odd-rules-6.6/stranger_odd_rules.py").unlink()

    (ill,) = ailments()
    assert ill.origin == "odd.rule (odd-rules 6.6)"
    assert "ModuleNotFoundError" in ill.problem


@pytest.mark.slow
def test_two_distributions_with_one_name_are_both_named(install: Install) -> None:
    for distribution in ("fair-rules", "foul-rules"):
        install(distribution, {"fair.play": "Rule"}, source=RULE)

    found_wrong = [(ill.origin, ill.problem) for ill in ailments()]
    both = "'fair.play' is provided by fair-rules 1.0 and foul-rules 1.0"
    assert found_wrong == [("fair.play (fair-rules 1.0)", both), ("fair.play (foul-rules 1.0)", both)]


@pytest.mark.slow
def test_a_group_that_does_not_exist_is_named(install: Install) -> None:
    install("odd-rules", {"odd.rule": "Rule"}, source=RULE, group="ariac_score.rule")

    (ill,) = ailments()
    assert ill.problem == "is in the group 'ariac_score.rule', which does not exist"
    assert ill.hint == "did you mean 'ariac_score.rules'?"


@pytest.mark.slow
def test_a_name_that_no_rule_set_can_use_is_named(install: Install) -> None:
    install("odd-rules", {"Odd": "Rule"}, source=RULE)

    assert [ill.problem for ill in ailments()] == ["has a name that no rule set can use"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("required", "ill"),
    [
        pytest.param("ariac-score>=0.1", False, marks=pytest.mark.slow),
        ("ariac_score (>=0.1,<1)", False),
        pytest.param("ariac-score==0.1.0; python_version > '3'", False, marks=pytest.mark.slow),
        ("ariac-score-extras>=9", False),
        pytest.param("numpy>=99", False, marks=pytest.mark.slow),
        ("ariac-score>=9", True),
        pytest.param("ariac-score<0.1", True, marks=pytest.mark.slow),
        ("ariac-score[dev]!=0.1.0", True),
    ],
)
def test_a_distribution_for_another_version_of_ours_is_named(
    install: Install, tmp_path: Path, required: str, ill: bool
) -> None:
    install("odd-rules", {"odd.rule": "Rule"}, source=RULE)
    metadata = tmp_path / "odd-rules-1.0/odd_rules-1.0.dist-info/METADATA"
    metadata.write_text(metadata.read_text() + f"Requires-Dist: {required}\n")

    assert [("and 0.1.0 is installed" in each.problem) for each in ailments()] == ([True] if ill else [])


@pytest.mark.slow
def test_a_distribution_without_metadata_is_named(install: Install, tmp_path: Path) -> None:
    install("odd-rules", {"odd.rule": "Rule"}, source=RULE)
    (tmp_path / "odd-rules-1.0/odd_rules-1.0.dist-info/METADATA").unlink()

    assert any("distribution without metadata" in ill.problem for ill in ailments())


# The other actions ---------------------------------------------------------------------


@pytest.mark.slow
def test_plugins_are_listed_with_the_hash_of_their_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "list", "--hash"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if " kitting.pose " in line]
    assert package_sha256("ariac_score_ariac")[:16] in line


@pytest.mark.slow
def test_the_list_can_be_had_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "list", "--output-format", "json"]) == 0

    rows = {(row["kind"], row["name"]): row for row in json.loads(capsys.readouterr().out)}
    row = rows["rules", "kitting.pose"]
    assert row["distribution"] == "ariac-score"
    assert row["sha256"] == package_sha256("ariac_score_ariac")
    assert row["problem"] == ""


@pytest.mark.slow
def test_a_broken_plugin_is_in_the_list_and_stops_no_other(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install("odd-rules", {"odd.rule": "Rule"}, source="raise RuntimeError('no licence')", version="6.6")

    assert main(["plugins", "list"]) == 3

    out, err = capsys.readouterr()
    assert "BROKEN: plugin odd.rule (odd-rules 6.6) cannot be imported: RuntimeError: no licence" in out
    assert "kitting.pose" in out
    assert err.splitlines() == [
        "error: 1 plugin cannot be used: odd.rule",
        "hint: 'ariac-score plugins doctor' says what is wrong with each, and what to do",
    ]


@pytest.mark.slow
def test_the_signature_of_a_dataclass_is_no_description(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    source = (
        "from dataclasses import dataclass\n"
        "@dataclass(frozen=True)\nclass Rule:\n    limit_m: float = 1.0\n"
        "    def judge(self, trial, order): ...\n"
    )
    install("odd-rules", {"odd.rule": "Rule"}, source=source, version="6.6")

    assert main(["plugins", "list"]) == 0

    (line,) = [line for line in capsys.readouterr().out.splitlines() if "odd.rule" in line]
    assert line.endswith("(no description)")


def test_the_page_of_a_plugin_begins_with_who_brought_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "show", "kitting.pose"]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("rule of ariac-score 0.1.0, ariac_score_ariac.tasks:KitPose")
    assert lines[1] == f"code {package_sha256('ariac_score_ariac')}"
    assert lines[3] == "# `kitting.pose`"


@pytest.mark.parametrize("action", ["show", "check"])
def test_an_unknown_plugin_is_refused_with_the_nearest_known_one(
    action: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", action, "kitting.poze"]) == 4
    assert "did you mean 'kitting.pose'?" in capsys.readouterr().err


@pytest.mark.slow
def test_a_check_says_of_every_requirement_whether_it_is_kept(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "check", "kitting.pose"]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"kitting.pose (ariac-score 0.1.0): {len(lines) - 1} checks on the made trial"
    assert all(line.startswith("  kept    ") for line in lines[1:])


@pytest.mark.slow
def test_a_broken_contract_is_said_and_the_other_checks_go_on(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    source = RULE.replace("        yield", "        print('hello')\n        yield")
    install("odd-rules", {"odd.rule": "Rule"}, source=source, version="6.6")

    assert main(["plugins", "check", "odd.rule"]) == 1

    out = capsys.readouterr().out
    assert "BROKEN  prints_nothing           plugin odd.rule (odd-rules 6.6) printed 'hello'" in out
    assert "kept    time_shift" in out


@pytest.mark.slow
def test_a_plugin_that_cannot_be_built_fails_its_check(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    source = RULE.replace("    limit_m: float = 1.0\n", "    def __init__(self, limit_m, /): ...\n")
    install("odd-rules", {"odd.rule": "Rule"}, source=source, version="6.6")

    assert main(["plugins", "check", "odd.rule"]) == 1
    assert (
        "BROKEN  built                    plugin odd.rule (odd-rules 6.6) cannot" in capsys.readouterr().out
    )


@pytest.mark.slow
def test_a_budget_that_is_not_kept_is_named(install: Install, capsys: pytest.CaptureFixture[str]) -> None:
    source = RULE.replace("        yield", "        while True: pass\n        yield")
    install("odd-rules", {"odd.rule": "Rule"}, source=source, version="6.6")

    assert main(["plugins", "check", "odd.rule", "--budget", "0.1"]) == 1
    assert "plugin odd.rule (odd-rules 6.6) ran longer than its budget" in capsys.readouterr().out


@pytest.mark.slow
def test_a_check_can_be_made_on_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_trial_log(tmp_path / "mine.jsonl", kitting_trial(), signals=["speed/robot"])

    assert main(["plugins", "check", "iso_10218_1.reduced_speed", "--trial", str(log)]) == 0
    assert "checks on mine.jsonl" in capsys.readouterr().out
    assert main(["plugins", "check", "jsonl", "--trial", str(log)]) == 0
    assert "kept    cut_off" in capsys.readouterr().out


@pytest.mark.slow
def test_a_monitor_is_checked_on_a_log_without_orders_and_a_rule_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = replace(kitting_trial(), work=(), submissions=())
    log = write_trial_log(tmp_path / "alone.jsonl", alone, signals=["speed/robot"])

    assert main(["plugins", "check", "iso_10218_1.reduced_speed", "--trial", str(log)]) == 0
    assert "checks on alone.jsonl" in capsys.readouterr().out
    assert main(["plugins", "check", "kitting.pose", "--trial", str(log)]) == 5
    assert "no item was found" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["jsonl"], "a reader is checked with a log that it reads"),
        (["nist_gear.2020"], "a decoder is checked with the reader that uses it"),
        (["kitting.pose", "--budget", "0"], "a budget of 0 s is none"),
        (["kitting.pose", "--budget", "nan"], "a budget of nan s is none"),
    ],
)
def test_a_check_that_makes_no_sense_is_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", "check", *arguments]) == 4
    assert words in capsys.readouterr().err


@pytest.mark.slow
def test_a_log_that_is_not_there_is_the_users_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "check", "kitting.pose", "--trial", "nowhere.jsonl"]) == 5
    assert "nowhere.jsonl" in capsys.readouterr().err
