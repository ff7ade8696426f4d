"""`ariac-score new`: what it writes works at once, grows without losing a byte, and refuses bad names."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import score_trial
from ariac_score.cli import main
from ariac_score.errors import ScoreError, UsageError
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.testing.grow import grow
from ariac_score.testing.starter import KINDS, new_files
from ariac_score_ariac.testing import kitting_trial

ONE_FILE = ("monitor", "rule")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["monitor", "rule"])
def test_a_new_check_is_scored_at_once_and_grows_into_a_distribution_that_passes_its_own_tests(
    kind: str, environment: Any, tmp_path: Path
) -> None:
    name, stem = f"made_{kind}.trial", f"made_{kind}_trial"  # one that scopes, signals and classes have, too
    for command in (
        f"ariac-score new {kind} {name}",
        "python -m ariac_score.testing trial.mcap",
        f"ariac-score score trial.mcap --rules {stem}.yaml --local-plugins",
        "python -m pytest -q -p no:cacheprovider",
        f"ariac-score new distribution {name} --from {stem}.yaml",
    ):
        done = environment.run(command, tmp_path)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    folder = tmp_path / stem.replace("_", "-")

    for command in ("pip install -q -e .", "python -m pytest -q -p no:cacheprovider"):
        done = environment.run(command, folder)
        assert done.returncode == 0, done.stdout + done.stderr

    assert " passed" in done.stdout
    doctor = environment.run("ariac-score plugins doctor", tmp_path)
    assert doctor.returncode == 0, doctor.stdout
    shown = environment.run(f"ariac-score plugins show {name}", folder)
    cls = f"Trial{kind.capitalize()}"
    assert shown.stdout.startswith(f"{kind} of {folder.name} 0.1.0, {stem}:{cls}")
    # By the name of its rule set, from anywhere, and without a file of code: what others will do with it.
    scored = environment.run(f"ariac-score score ../trial.mcap --rules {stem}", folder)
    assert scored.stdout.startswith("26 of 36 possible"), scored.stderr


@pytest.mark.slow
def test_a_new_reader_installs_and_passes_its_own_tests_at_once(environment: Any, tmp_path: Path) -> None:
    made = environment.run("ariac-score new reader made_reader.trial", tmp_path)
    assert made.returncode == 0, made.stderr
    folder = tmp_path / "made-reader-trial"

    for command in ("pip install -q -e .", "python -m pytest -q -p no:cacheprovider"):
        done = environment.run(command, folder)
        assert done.returncode == 0, done.stdout + done.stderr

    assert " passed" in done.stdout
    doctor = environment.run("ariac-score plugins doctor", tmp_path)
    assert "made_reader.trial (made-reader-trial" not in doctor.stdout


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("check", "cls"),
    [
        ("none", "None{}"),
        ("true", "True{}"),
        ("finding", "Finding{}"),
        ("trial", "Trial{}"),
        ("calm", "Calm"),
    ],
)
def test_a_class_is_called_what_nothing_else_in_its_file_is(
    kind: str, check: str, cls: str, tmp_path: Path
) -> None:
    if check == "finding" and kind != "rule":
        cls = "Finding"  # no other template speaks of findings
    made = new_files(kind, f"fair.{check}", tmp_path)

    (module,) = [file for file in made if file.name in ("__init__.py", f"fair_{check}.py")]
    named = [
        n.name for n in ast.parse(module.read_text(encoding="utf-8")).body if isinstance(n, ast.ClassDef)
    ]
    assert named == [cls.format(kind.capitalize())]
    if kind in ONE_FILE:
        made = grow(tmp_path, f"fair.{check}", tmp_path)
    project = (tmp_path / f"fair-{check}/pyproject.toml").read_text(encoding="utf-8")
    assert f'"fair.{check}" = "fair_{check}:{named[0]}"' in project


@pytest.mark.parametrize(
    ("name", "check"),
    [
        ("fair.trial", "fair_trial"),  # `trial` alone is a scope of every rule set
        ("fair.count", "fair_count"),
        ("human.contact", "human_contact_rule"),  # the rule set that is extended has one of that name
        ("separation.weight", "separation_weight_rule"),
    ],
)
def test_the_check_of_its_rule_set_is_called_what_nothing_else_in_it_is(
    name: str, check: str, tmp_path: Path
) -> None:
    made = new_files("rule", name, tmp_path)

    (rules,) = [file for file in made if file.suffix == ".yaml"]
    written = yaml.safe_load(rules.read_text(encoding="utf-8"))
    assert list(written["rules"]) == [check]
    assert written["score"] == f"task - 2 * count({check})"


def test_nothing_needs_a_family_until_it_is_installed(tmp_path: Path) -> None:
    new_files("monitor", "near_miss", tmp_path)
    new_files("reader", "lab_log", tmp_path)

    assert '"lab_log" = "lab_log:LabLog"' in (tmp_path / "lab-log/pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "hint"),
    [("My-Robot", "workshop.my_robot"), ("Play", "workshop.play"), ("!", "workshop.calm_robot")],
)
def test_a_name_that_is_refused_is_answered_with_one_that_would_do(
    name: str, hint: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="cannot be the name") as error:
        new_files("rule", name, tmp_path)

    assert error.value.hint is not None
    assert error.value.hint.endswith(hint)
    new_files("rule", hint, tmp_path)


@pytest.mark.parametrize("file", ["fair_play.py", "fair_play.yaml", "test_fair_play.py"])
def test_nothing_is_overwritten(file: str, tmp_path: Path) -> None:
    (tmp_path / file).write_text("mine", encoding="utf-8")

    with pytest.raises(UsageError, match="exists already"):
        new_files("rule", "fair.play", tmp_path)

    assert [path.name for path in tmp_path.iterdir()] == [file]
    assert (tmp_path / file).read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Fair.play", "cannot be the name"),
        ("fair.play!", "cannot be the name"),
        ("fair..play", "cannot be the name"),
        ("fair._play", "cannot be the name"),
        ("fair.1st", "cannot be the name"),
        ("fair/../play", "cannot be the name"),
        ("fair.play\n", "cannot be the name"),
        ("", "cannot be the name"),
        ("fair.class", "is a word of Python"),
        ("kitting.pose", "provided by ariac-score 0"),
        ("ariac_score.ariac", "a module 'ariac_score_ariac' already"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=words) as error:
        new_files("monitor", name, tmp_path)

    assert error.value.hint
    assert not [*tmp_path.iterdir()]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(UsageError, match="cannot be written"):
        new_files("monitor", "fair.play", tmp_path / "file")


def test_the_command_names_the_files_and_what_to_do_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    assert main(["new", "rule", "fair.play"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        *sorted(p.name for p in tmp_path.iterdir()),
        "",
        "next: ariac-score score LOG --rules fair_play.yaml --local-plugins",
    ]

    assert main(["new", "distribution", "fair.play", "--from", "fair_play.yaml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    grown = tmp_path / "fair-play"
    assert lines[:-2] == sorted(p.relative_to(tmp_path).as_posix() for p in grown.rglob("*") if p.is_file())
    assert lines[-1] == "next: cd fair-play && pip install -e . && python -m pytest"

    (tmp_path / "test_fair_play.py").unlink()
    assert main(["new", "distribution", "untested.play", "--from", "fair_play.yaml"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith("pip install -e . && ariac-score plugins doctor")


def test_a_kind_that_does_not_exist_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["new", "judge", "fair.play"])

    assert left.value.code == 4
    assert "kind cannot be 'judge'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["monitor", "fair.play", "--from", "x.yaml"], ["distribution", "fair.play"]]
)
def test_only_a_distribution_grows_from_something(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", *words]) == 4
    assert "a distribution grows from a rule set, and nothing else does" in capsys.readouterr().err


# Growing --------------------------------------------------------------------------------

CODE = """# Mine, with a tail of spaces   \r\n
class NearMiss:
    def needs(self): return []
    def watch(self, trial):
        from ariac_score import Finding
        yield Finding.violated("trial", "near")

class Far(NearMiss): ...
"""
RULES = """# Prices, by me
id: lab
title: t
source: s
extends: ./base.yaml   # ours
monitors:
  near_miss: {use: "./lab.py:NearMiss"}
  far:
    use: ./lab.py:Far  # further
score: task - count(near_miss) - 2 * count(far)
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Two classes in a file, used by a rule set that extends another one beside it."""
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "lab.py").write_bytes(CODE.encode())
    (folder / "lab.yaml").write_text(RULES, encoding="utf-8")
    base = "id: lab_base\ntitle: t\nsource: s\nextends: paper2020.published\n"
    (folder / "base.yaml").write_text(base, encoding="utf-8")
    (folder / "test_lab.py").write_text("def test_it(): ...\n", encoding="utf-8")
    return folder


def test_growing_keeps_the_authors_code_to_the_byte_and_rule_sets_but_for_the_names(
    lab: Path, tmp_path: Path
) -> None:
    before = {path.name: path.read_bytes() for path in lab.iterdir()}

    grow(lab / "lab.yaml", "workshop", tmp_path)

    grown = tmp_path / "workshop"
    assert (grown / "lab/__init__.py").read_bytes() == CODE.encode()
    assert (grown / "tests/test_lab.py").read_bytes() == before["test_lab.py"]
    assert (grown / "lab/base.yaml").read_bytes() == before["base.yaml"]
    named = RULES.replace('"./lab.py:NearMiss"', "workshop.near_miss").replace("./lab.py:Far", "workshop.far")
    assert (grown / "lab/lab.yaml").read_text(encoding="utf-8") == named
    assert {path.name: path.read_bytes() for path in lab.iterdir() if path.is_file()} == before
    project = (grown / "pyproject.toml").read_text(encoding="utf-8")
    monitors = '"workshop.near_miss" = "lab:NearMiss"\n"workshop.far" = "lab:Far"\n'
    assert f'[project.entry-points."ariac_score.monitors"]\n{monitors}' in project
    rule_sets = '"lab" = "lab:lab"\n"lab_base" = "lab:base"\n'
    assert f'[project.entry-points."ariac_score.rule_sets"]\n{rule_sets}' in project


def test_a_log_map_beside_the_rule_set_comes_along_and_is_no_rule_set(lab: Path, tmp_path: Path) -> None:
    # As in the example of docs/recording.md, it has the id of the rule set, and a source.
    (lab / "lab_map.yaml").write_text("{id: lab, title: t, source: s}\n", encoding="utf-8")
    (lab / "lab.yaml").write_text(f"{RULES}log_map: ./lab_map.yaml\n", encoding="utf-8")

    grow(lab / "lab.yaml", "workshop", tmp_path)

    assert (tmp_path / "workshop/lab/lab_map.yaml").is_file()
    project = (tmp_path / "workshop/pyproject.toml").read_text(encoding="utf-8")
    (points,) = re.findall(r'rule_sets"\]\n(.*?)\n\n', project, re.DOTALL)
    assert points == '"lab" = "lab:lab"\n"lab_base" = "lab:base"'


def test_grown_and_local_checks_give_the_same_score(lab: Path, tmp_path: Path, install: Any) -> None:
    log = write_trial_log(tmp_path / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    local = score_trial(log, lab / "lab.yaml", local_plugins=True)
    grow(lab, "workshop", tmp_path)
    install(
        "lab_grown",
        {"workshop.near_miss": "NearMiss", "workshop.far": "Far"},
        source=CODE,
        group="ariac_score.monitors",
    )

    grown = score_trial(log, tmp_path / "workshop/lab/lab.yaml")

    assert grown.score == local.score == 28 - 1 - 2
    assert grown.measured.findings == local.measured.findings


@pytest.mark.parametrize(
    ("name", "file", "old", "new", "words"),
    [
        ("workshop", "lab.yaml", "./lab.py:Far", "./lab.py:Fra", "no class of that name"),
        ("workshop", "lab.yaml", "./base.yaml", "../base.yaml", "no such file"),
        ("workshop", "lab.yaml", "./lab.py", "./absent.py", "cannot be read"),
        ("workshop", "lab.yaml", "id: lab", "id: paper2020.published", "is provided by ariac-score"),
        ("Workshop", "lab.yaml", "", "", "cannot be the name"),
        ("kitting", "lab.py", "NearMiss", "Pose", "has no class|no class of that name"),
        ("workshop", "test_lab.py", "def", "\udcff", "can.t decode byte"),
    ],
)
def test_what_cannot_grow_is_refused_before_a_file_is_written(
    name: str, file: str, old: str, new: str, words: str, lab: Path, tmp_path: Path
) -> None:
    text = (lab / file).read_bytes().decode().replace(old, new)
    (lab / file).write_bytes(text.encode("utf-8", "surrogateescape"))

    with pytest.raises(ScoreError, match=words) as error:
        grow(lab / "lab.yaml", name, tmp_path / "out")

    assert error.value.hint
    assert not (tmp_path / "out").exists()


def test_a_module_that_is_installed_already_is_not_hidden(lab: Path, tmp_path: Path) -> None:
    (lab / "lab.py").rename(lab / "yaml.py")
    (lab / "lab.yaml").write_text(RULES.replace("./lab.py", "./yaml.py"), encoding="utf-8")

    with pytest.raises(UsageError, match="a module 'yaml' already"):
        grow(lab / "lab.yaml", "workshop", tmp_path)


def test_a_folder_with_no_or_two_such_rule_sets_is_refused(lab: Path, tmp_path: Path) -> None:
    (lab / "other.yaml").write_text(RULES, encoding="utf-8")
    with pytest.raises(UsageError, match=r"there is lab\.yaml, other\.yaml"):
        grow(lab, "workshop", tmp_path)
    with pytest.raises(UsageError, match="there is none"):
        grow(tmp_path, "workshop", tmp_path)
    with pytest.raises(UsageError, match="names no class in a file"):
        grow(lab / "base.yaml", "workshop", tmp_path)
    with pytest.raises(UsageError, match="no such file or folder"):
        grow(lab / "absent.yaml", "workshop", tmp_path)


def test_growing_overwrites_nothing(lab: Path, tmp_path: Path) -> None:
    (tmp_path / "workshop").mkdir()

    with pytest.raises(UsageError, match="exists already"):
        grow(lab, "workshop", tmp_path)
