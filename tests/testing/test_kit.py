"""`ariac-score new`: what it writes installs, passes its own tests and checks, and refuses bad names."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score.cli import main
from ariac_score.errors import UsageError
from ariac_score.testing.kit import KINDS, new_distribution


@pytest.mark.parametrize(
    "kind", [kind if kind == "monitor" else pytest.param(kind, marks=pytest.mark.slow) for kind in KINDS]
)
def test_a_new_distribution_installs_and_passes_its_own_tests_at_once(
    kind: str, environment: Any, tmp_path: Path
) -> None:
    # The name is one that scopes, signals and classes have, too.
    made = environment.run(f"ariac-score new {kind} made_{kind}.trial", tmp_path)
    assert made.returncode == 0, made.stderr
    folder = tmp_path / f"made-{kind}-trial"

    for command in ("pip install -q -e .", "python -m pytest -q -p no:cacheprovider"):
        done = environment.run(command, folder)
        assert done.returncode == 0, done.stdout + done.stderr

    assert "failed" not in done.stdout
    assert " passed" in done.stdout
    doctor = environment.run("ariac-score plugins doctor", tmp_path)
    assert f"made_{kind}" not in doctor.stdout
    shown = environment.run(f"ariac-score plugins show made_{kind}.trial", tmp_path)
    cls = f"Trial{kind.capitalize()}"
    assert shown.stdout.startswith(f"{kind} of made-{kind}-trial 0.1.0, made_{kind}_trial:{cls}")


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
    made = new_distribution(kind, f"fair.{check}", tmp_path)

    (module,) = [file for file in made if file.name == "__init__.py"]
    named = [
        n.name for n in ast.parse(module.read_text(encoding="utf-8")).body if isinstance(n, ast.ClassDef)
    ]
    assert named == [cls.format(kind.capitalize())]
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
    made = new_distribution("rule", name, tmp_path)

    (rules,) = [file for file in made if file.suffix == ".yaml"]
    written = yaml.safe_load(rules.read_text(encoding="utf-8"))
    assert list(written["rules"]) == [check]
    assert written["score"] == f"task - 2 * count({check})"


def test_a_reader_needs_no_family(tmp_path: Path) -> None:
    new_distribution("reader", "lab_log", tmp_path)

    assert '"lab_log" = "lab_log:LabLog"' in (tmp_path / "lab-log/pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "hint"),
    [("My-Robot", "workshop.my_robot"), ("play", "workshop.play"), ("!", "workshop.calm_robot")],
)
def test_a_name_that_is_refused_is_answered_with_one_that_would_do(
    name: str, hint: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="cannot be the name") as error:
        new_distribution("rule", name, tmp_path)

    assert error.value.hint is not None
    assert error.value.hint.endswith(hint)
    new_distribution("rule", hint, tmp_path)


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    new_distribution("rule", "fair.play", tmp_path)
    (tmp_path / "fair-play/README.md").write_text("mine")

    with pytest.raises(UsageError, match="exists already"):
        new_distribution("rule", "fair.play", tmp_path)
    assert (tmp_path / "fair-play/README.md").read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("play", "cannot be the name"),
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
        new_distribution("monitor", name, tmp_path)

    assert error.value.hint
    assert not [*tmp_path.iterdir()]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(UsageError, match="cannot be written"):
        new_distribution("monitor", "fair.play", tmp_path / "file")


def test_the_command_names_the_files_and_what_to_do_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    assert main(["new", "rule", "fair.play"]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[:-2] == sorted(
        p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()
    )
    assert lines[-1] == "next: cd fair-play && pip install -e . && python -m pytest"


def test_a_kind_that_does_not_exist_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["new", "judge", "fair.play"])

    assert left.value.code == 4
    assert "invalid choice: 'judge'" in capsys.readouterr().err
