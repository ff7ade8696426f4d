"""Classes in files beside a rule set: used where the caller allows them, refused everywhere else."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from pathlib import Path
from textwrap import dedent

import pytest
import yaml

from ariac_score import RuleSet, ScoreError, load_rule_set, score_trial
from ariac_score.checks.local import MAX_CODE_BYTES, LocalFiles
from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LocalPluginError, PluginError, RuleSetError
from ariac_score.ranking.competition import load_competition
from ariac_score.results.result_file import as_json
from ariac_score.review.verify import verify_result
from ariac_score.scoring.ruleset import rule_set_from_text

LOG = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
TASK = 28  # what the shipments of the example are worth under paper2020.published, see examples/README.md

MONITOR = '''
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ariac_score import Finding, SignalNeed, Trial, parameter


@dataclass(frozen=True)
class NearMiss:
    """Somebody came near, says this monitor of every trial."""

    limit_m: float = parameter(0.5, unit="m", above=0, at_most=10, source="our workshop")

    def needs(self) -> Iterator[SignalNeed]:
        yield from ()

    def watch(self, trial: Trial) -> Iterator[Finding]:
        yield Finding.violated("trial", f"nearer than {self.limit_m:g} m")
'''

RULES = """
id: ours
title: The task, less two points for every near miss
source: our workshop
extends: paper2020.published
monitors:
  near_miss: {use: "./ours.py:NearMiss", with: {limit_m: 0.4}}
score: task - 2 * count(near_miss)
"""


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    """A rule set with a monitor in a file beside it."""
    (tmp_path / "ours.py").write_text(dedent(MONITOR), encoding="utf-8")
    (tmp_path / "ours.yaml").write_text(RULES, encoding="utf-8")
    return tmp_path / "ours.yaml"


def sha256_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def allowed(rules: Path, **pinned: str) -> RuleSet:
    """The rule set, after its checks were built with files allowed."""
    rule_set = load_rule_set(rules)
    rule_set.build(Registry(LocalFiles(pinned or None)))
    return rule_set


def refusal(rules: Path) -> PluginError:
    """Why the checks of a rule set cannot be built where files are allowed."""
    with pytest.raises(PluginError) as error:
        allowed(rules)
    assert error.value.hint
    return error.value


def naming(rules: Path, use: str) -> Path:
    rules.write_text(RULES.replace("./ours.py:NearMiss", use), encoding="utf-8")
    return rules


# Where it is allowed --------------------------------------------------------------------


def test_a_class_beside_the_rule_set_is_scored_and_its_text_is_in_the_provenance(rules: Path) -> None:
    result = score_trial(LOG, rules, local_plugins=True)

    assert result.score == TASK - 2
    (code,) = [one for one in result.provenance.code if one.distribution == "local file"]
    assert (code.package, code.sha256) == ("./ours.py", sha256_of(rules.with_name("ours.py")))
    assert result.checks["near_miss"]["use"] == "./ours.py:NearMiss"
    assert str(rules.parent) not in as_json(result)


def test_its_settings_have_units_like_those_of_an_installed_plugin(rules: Path) -> None:
    result = score_trial(LOG, rules, local_plugins=True)

    assert result.measured.settings is not None
    (limit,) = result.measured.settings["near_miss"].parameters
    assert (limit.name, limit.value, limit.unit, limit.origin) == ("limit_m", 0.4, "m", "rule_set")


def test_a_parameter_that_it_does_not_have_is_refused_with_the_nearest_name(rules: Path) -> None:
    rules.write_text(RULES.replace("limit_m", "limit"), encoding="utf-8")

    with pytest.raises(RuleSetError, match="has no parameter 'limit'") as error:
        allowed(rules)

    assert error.value.hint == "did you mean 'limit_m'?"


def test_two_checks_of_one_file_share_its_module(rules: Path) -> None:
    text = RULES.replace("score:", '  other: {use: "./ours.py:NearMiss"}\nscore:')
    rules.write_text(text, encoding="utf-8")

    built = load_rule_set(rules).build(Registry(LocalFiles()))

    assert type(built["near_miss"]) is type(built["other"])


def test_what_was_read_is_what_runs_though_the_file_changes_meanwhile(rules: Path) -> None:
    registry = Registry(LocalFiles())
    prepared = prepare(load_rule_set(rules), registry=registry)
    before = sha256_of(rules.with_name("ours.py"))
    rules.with_name("ours.py").write_text("raise SystemExit\n", encoding="utf-8")

    result = score_trial(LOG, prepared)

    assert before in [code.sha256 for code in result.provenance.code]


def test_line_ends_of_another_system_are_no_other_text(rules: Path) -> None:
    file = rules.with_name("ours.py")
    unix = sha256_of(file)
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))

    allowed(rules, **{"./ours.py": unix})


@pytest.mark.parametrize(
    "command",
    [
        ["score", str(LOG), "--rules"],
        ["check", str(LOG), "--rules"],
        ["info", str(LOG), "--rules"],
        ["rules", "validate"],
        ["rules", "check", "--cases", "2"],
    ],
    ids=lambda command: " ".join(part for part in command if part.isalpha()),
)
def test_a_command_runs_it_only_when_it_is_told_to(
    command: list[str], rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, str(rules)]) == 4
    error = capsys.readouterr().err
    assert "'./ours.py:NearMiss' is code in a file, and the caller does not allow that" in error
    assert "--local-plugins" in error

    assert main([*command, str(rules), "--local-plugins"]) in (0, 1)  # 1: a law does not hold


@pytest.mark.slow
def test_a_class_in_a_file_is_checked_and_shown_like_an_installed_plugin(
    rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = f"{rules.with_name('ours.py')}:NearMiss"

    main(["plugins", "check", name, "--local-plugins"])  # as other commands need it
    assert "./ours.py:NearMiss (local file " in capsys.readouterr().out
    assert main(["plugins", "show", name]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("monitor of local file ")
    assert f"code {sha256_of(rules.with_name('ours.py'))}" in shown
    assert main(["plugins", "check", f"{name}es"]) == 3
    assert "did you mean 'NearMiss'?" in capsys.readouterr().err


@pytest.mark.slow
def test_what_reads_a_result_needs_no_code(
    rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = tmp_path / "result.json"
    stored.write_text(as_json(score_trial(LOG, rules, local_plugins=True)), encoding="utf-8")
    rules.with_name("ours.py").unlink()

    for command in (
        ["explain", str(stored), "near_miss"],
        ["price", str(stored), "--rules", str(rules)],
        ["report", str(stored), "-o", str(tmp_path / "page.html")],
        ["export", str(stored), "--output-format", "markdown"],
    ):
        assert main(command) == 0, capsys.readouterr().err
    assert "./ours.py" in (tmp_path / "page.html").read_text(encoding="utf-8")


# Where it is not ------------------------------------------------------------------------


def test_python_refuses_it_unless_told_to(rules: Path) -> None:
    with pytest.raises(LocalPluginError, match="the caller does not allow that") as error:
        score_trial(LOG, rules)

    assert error.value.place.startswith("line 7, $.monitors.near_miss")


def test_no_text_is_run_before_it_is_allowed(rules: Path, tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    rules.with_name("ours.py").write_text(f"open({str(mark)!r}, 'w')\n", encoding="utf-8")

    for command in ("score", "check", "info"):
        assert main([command, str(LOG), "--rules", str(rules)]) == 4
    assert not mark.exists()


def competition(rules: Path, **more: object) -> Path:
    """A competition of one team and one run, under the rule set."""
    logs = rules.parent / "logs/blue"
    logs.mkdir(parents=True)
    (logs / "day_1.mcap").write_bytes(LOG.read_bytes())
    told = {"id": "cup", "rules": "ours.yaml", "runs": "logs/{team}/{trial}_{run}.mcap", **more}
    file = rules.with_name("competition.yaml")
    file.write_text(yaml.safe_dump(told), encoding="utf-8")
    return file


def test_a_ranking_refuses_a_file_that_the_competition_does_not_name(
    rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = competition(rules)

    assert main(["rank", str(file)]) == 4
    assert "'local_plugins:' in competition.yaml" in capsys.readouterr().err.replace("\n", " ")


def test_a_ranking_runs_the_file_that_the_competition_names_with_its_hash(
    rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = competition(rules, local_plugins={"./ours.py": sha256_of(rules.with_name("ours.py"))})

    assert main(["rank", str(file), "--output-format", "json"]) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["score"] == TASK - 2


def test_a_file_that_is_not_among_those_allowed_is_refused_with_the_nearest_name(
    rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = competition(rules, local_plugins={"./our.py": "0" * 64})

    assert main(["rank", str(file)]) == 4
    error = capsys.readouterr().err
    assert "'./ours.py' is not among the files that are allowed here" in error
    assert "did you mean './our.py'?" in error


@pytest.mark.parametrize("command", ["rank", "batch"])
def test_another_state_of_the_file_is_refused_and_both_hashes_are_named(
    command: str, rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = competition(rules, local_plugins={"./ours.py": "0" * 64})
    more = ["-o", str(tmp_path / "out" / "batch")] if command == "batch" else []

    assert main([command, str(file.parent if more else file), *more]) == 4

    error = capsys.readouterr().err
    assert "0" * 64 in error
    assert sha256_of(rules.with_name("ours.py")) in error


@pytest.mark.parametrize("name", ["../ours.py", "/ours.py", "ours.py", "./sub/ours.py", "./ours.pyc"])
def test_a_competition_names_files_beside_its_rule_set_alone(name: str, rules: Path) -> None:
    file = competition(rules, local_plugins={name: "0" * 64})

    with pytest.raises(ScoreError, match=r"does not match|is not"):
        load_competition(file)


def test_a_batch_runs_the_file_that_the_competition_names_and_knows_when_it_changes(
    rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place, code = tmp_path.parent / f"{tmp_path.name}_batch", rules.with_name("ours.py")
    file = competition(rules, local_plugins={"./ours.py": sha256_of(code)})

    assert main(["batch", str(file), "-o", str(place), "--jobs", "1"]) == 0
    first = sorted(place.rglob("*.json"))
    described = json.loads((place / "batch.json").read_text(encoding="utf-8"))
    assert ["./ours.py", sha256_of(code)] in [[c["package"], c["sha256"]] for c in described["code"]]

    code.write_text(code.read_text(encoding="utf-8") + "\n# another state\n", encoding="utf-8")
    told = yaml.safe_load(file.read_text(encoding="utf-8"))
    told["local_plugins"] = {"./ours.py": sha256_of(code)}
    file.write_text(yaml.safe_dump(told), encoding="utf-8")
    assert main(["batch", str(file), "-o", str(place), "--jobs", "1"]) == 0
    assert len(sorted(place.rglob("*.json"))) > len(first)  # measured anew, under another address


def test_a_batch_of_a_folder_runs_no_file(
    rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    (runs / "a.mcap").write_bytes(LOG.read_bytes())

    assert main(["batch", str(runs), "--rules", str(rules), "-o", str(tmp_path / "out")]) == 4
    assert "the caller does not allow that" in capsys.readouterr().err


def test_a_platform_hosts_installed_plugins_alone(
    rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["platform", "codabench", "bundle", "--rules", str(rules), "--title", "Cup", "--trial", "day"]
    words += ["--unattested", "--image", "example/ariac:1", "--start", "2030-01-01", "--end", "2030-02-01"]

    assert main([*words, "-o", str(tmp_path / "bundle.zip")]) == 4
    assert "'./ours.py:NearMiss' is code in a file" in capsys.readouterr().err
    assert not (tmp_path / "bundle.zip").exists()


def test_the_oracle_runs_no_file(rules: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["oracle", "--rules", str(rules), "--port", "0"]) == 4
    assert "'./ours.py:NearMiss' is code in a file" in capsys.readouterr().err


def test_a_result_brings_its_rules_but_never_their_code(rules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = score_trial(LOG, rules, local_plugins=True)
    monkeypatch.chdir(rules.parent)  # where a file of that name lies
    rule_set = rule_set_from_text(result.rules, file="the rules in the result")

    with pytest.raises(LocalPluginError, match="these rules lie in no file"):
        rule_set.build(Registry(LocalFiles()))


# Verifying ------------------------------------------------------------------------------


@pytest.fixture
def stored(rules: Path) -> Path:
    """A result made with the file beside the rule set."""
    path = rules.with_name("result.json")
    path.write_text(as_json(score_trial(LOG, rules, local_plugins=True)), encoding="utf-8")
    return path


def test_verifying_runs_the_very_file_that_the_result_states(stored: Path, rules: Path) -> None:
    found = verify_result(stored, log=LOG, rules=str(rules), local_plugins=True)

    assert found.holds
    outcomes = {step.name: step.outcome for step in found.steps}
    assert {"recomputed": "ok", "code": "ok", "local": "ok"}.items() <= outcomes.items()


def test_a_file_that_changed_between_measuring_and_verifying_does_not_run(stored: Path, rules: Path) -> None:
    code = rules.with_name("ours.py")
    before = sha256_of(code)
    mark = rules.with_name("ran")
    code.write_text(f"open({str(mark)!r}, 'w')\n{code.read_text(encoding='utf-8')}", encoding="utf-8")

    found = verify_result(stored, log=LOG, rules=str(rules), local_plugins=True)

    (step,) = [step for step in found.steps if step.outcome == "failed"]
    assert step.name == "local"
    assert not any("ours.py" in other.words for other in found.steps if other is not step)
    assert before in step.words
    assert sha256_of(code) in step.words
    assert not mark.exists()


def test_verifying_without_the_permission_says_what_made_it_and_refuses_to_run_it(
    stored: Path, rules: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = verify_result(stored)

    assert alone.steps_that_are("open") == ("rules", "code", "log")
    assert any("./ours.py beside the rule set made it" in step.words for step in alone.steps)
    assert main(["verify", str(stored), "--log", str(LOG), "--rules", str(rules)]) == 4
    assert "the caller does not allow that" in capsys.readouterr().err
    assert main(["verify", str(stored), "--log", str(LOG), "--local-plugins"]) == 4
    assert "add --rules FILE" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ["sensitivity", "RESULT"],
        ["annotate", str(LOG), "RESULT", "-o", "RESULT.mcap"],
        ["verify", "RESULT", "--log", str(LOG)],
    ],
)
def test_what_needs_the_code_of_a_result_says_at_once_how_to_give_it(
    command: list[str], stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([part.replace("RESULT", str(stored)) for part in command]) == 4

    assert "--rules FILE --local-plugins" in capsys.readouterr().err


def test_a_competition_in_a_file_is_refused_in_words(rules: Path) -> None:
    told = rules.read_text(encoding="utf-8") + 'competition: {use: "./ours.py:Cup"}\n'
    rules.write_text(told, encoding="utf-8")

    with pytest.raises(RuleSetError, match="a competition comes by an installed distribution alone") as error:
        load_rule_set(rules)

    assert error.value.place.endswith("$.competition.use")
    assert "ariac_score.competitions" in error.value.hint


# Hostile and broken files ---------------------------------------------------------------


@pytest.mark.parametrize(
    "use",
    [
        "../ours.py:NearMiss",
        "./../ours.py:NearMiss",
        "./sub/ours.py:NearMiss",
        "/etc/ours.py:NearMiss",
        "ours.py:NearMiss",
        "./ours.py",
        "./ours.py:",
        "./ours.py:Near.Miss",
        "./ours.py:NearMiss()",
        "./ours.py\x00:NearMiss",
        "./ours.py:NearMiss\n",
        "./ours.so:NearMiss",
        "./öurs.py:NearMiss",
        ".\\ours.py:NearMiss",
        "./ours.py:NearMiss:Other",
        "file:///ours.py:NearMiss",
        "os:system",
    ],
)
def test_a_name_that_is_no_file_beside_the_rule_set_is_refused(use: str, rules: Path) -> None:
    told = yaml.safe_load(RULES)
    told["monitors"]["near_miss"]["use"] = use
    rules.write_text(yaml.safe_dump(told, allow_unicode=True), encoding="utf-8")

    with pytest.raises(ScoreError) as error:
        allowed(rules)
    assert error.value.exit_code == 4
    with pytest.raises(LocalPluginError):
        LocalFiles().find("ariac_score.monitors", use, rules.parent)


def test_a_link_out_of_the_folder_is_refused(rules: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path.parent / f"{tmp_path.name}_elsewhere.py"
    elsewhere.write_text(MONITOR, encoding="utf-8")
    rules.with_name("ours.py").unlink()
    rules.with_name("ours.py").symlink_to(elsewhere)

    assert "a link that leads out of the folder" in refusal(rules).cause


def test_a_link_in_a_circle_is_refused(rules: Path) -> None:
    rules.with_name("ours.py").unlink()
    rules.with_name("ours.py").symlink_to(rules.with_name("ours.py"))

    refusal(rules)


def test_a_pipe_is_refused_without_waiting_for_it(rules: Path) -> None:
    rules.with_name("ours.py").unlink()
    os.mkfifo(rules.with_name("ours.py"))

    assert refusal(rules).cause == "'./ours.py' is no file"


def test_a_file_that_is_not_there_or_too_large_is_refused(rules: Path) -> None:
    code = rules.with_name("ours.py")
    code.write_text("#" * MAX_CODE_BYTES, encoding="utf-8")
    assert "no class of that name" in refusal(rules).cause
    code.write_text("#" * (MAX_CODE_BYTES + 1), encoding="utf-8")
    assert "more than 1,000,000 bytes" in refusal(rules).cause
    code.unlink()
    assert "cannot be read" in refusal(rules).cause


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("class NearMiss(:", "SyntaxError"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("raise SystemExit(0)", "SystemExit"),
        ("class NearMis: ...", "has no class of that name"),
        ("from ariac_score import Span as NearMiss", "does not define that class itself"),
        ("NearMiss = lambda: 1", "does not define that class itself"),
        ("class NearMiss: ...", "does not keep the contract of a Monitor"),
        ("class NearMiss:\n    def __init__(self): raise KeyError(1)", "KeyError"),
        ("\x00", "cannot be imported"),
    ],
)
def test_a_failure_names_the_file_and_the_class(text: str, words: str, rules: Path) -> None:
    naming(rules, "./ours.py:NearMiss").write_text(
        RULES.replace(", with: {limit_m: 0.4}", ""), encoding="utf-8"
    )
    rules.with_name("ours.py").write_text(text, encoding="utf-8")

    error = refusal(rules)

    assert words in str(error)
    assert "./ours.py:NearMiss" in str(error)


def test_a_failure_while_it_watches_asks_to_correct_it_and_not_its_authors(rules: Path) -> None:
    code = rules.with_name("ours.py")
    code.write_text(MONITOR.replace("yield Finding.violated", "yield Finding.vielated"), encoding="utf-8")

    with pytest.raises(PluginError, match=r"check 'near_miss': plugin \./ours.py:NearMiss") as error:
        score_trial(LOG, rules, local_plugins=True)

    assert error.value.hint.endswith("correct the class 'NearMiss' in ./ours.py")


@pytest.mark.parametrize(
    "line",
    [
        "import helpers",
        "from helpers import f",
        "def f():\n    import helpers.inner",
        "from . import helpers",
    ],
)
def test_an_import_of_a_neighbour_is_refused_for_nobody_knows_its_hash(
    line: str, rules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rules.with_name("helpers.py").write_text("def f(): ...\n", encoding="utf-8")
    rules.with_name("ours.py").write_text(f"{MONITOR}\n{line}\n", encoding="utf-8")
    monkeypatch.setattr(sys, "path", [str(rules.parent), *sys.path])  # as for `python -m` in that folder

    assert "imports its neighbour" in refusal(rules).cause


def test_a_check_in_a_file_is_not_inherited_from_another_folder(rules: Path) -> None:
    (rules.parent / "finals").mkdir()
    heir = rules.parent / "finals/ours.yaml"
    heir.write_text("id: finals\ntitle: t\nsource: s\nextends: ../ours.yaml\n", encoding="utf-8")

    with pytest.raises(RuleSetError, match="of another folder"):
        load_rule_set(heir)

    beside = rules.with_name("finals.yaml")
    beside.write_text("id: finals\ntitle: t\nsource: s\nextends: ./ours.yaml\n", encoding="utf-8")
    assert allowed(beside).checks["near_miss"].use == "./ours.py:NearMiss"


def test_what_lies_beside_a_log_is_never_run(rules: Path) -> None:
    # A bundle with a file of the same name beside the log: only the folder of the rule set counts.
    bundle = rules.parent / "bundle"
    bundle.mkdir()
    (bundle / "run.mcap").write_bytes(LOG.read_bytes())
    (bundle / "ours.py").write_text("raise SystemExit\n", encoding="utf-8")
    (bundle / "ours.yaml").write_text(RULES, encoding="utf-8")

    result = score_trial(bundle, rules, local_plugins=True)

    assert result.score == TASK - 2
