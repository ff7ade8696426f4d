"""Settings from files and the environment: what comes before what, what is refused, and that it is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.cli.settings import COMMANDS, FILE, SETTINGS, load_settings

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"
COMPETITION = ROOT / "examples/competition/2024"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder two levels below the one whose settings count; nothing is set from outside."""
    (tmp_path / "team/logs").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "team/logs")
    for setting in SETTINGS.values():
        monkeypatch.delenv(setting.variable, raising=False)
    monkeypatch.delenv("ARIAC_SCORE_CONFIG", raising=False)
    return tmp_path / "team"


def _taken(folder: Path, command: str, environment: dict[str, str] | None = None) -> dict[str, object]:
    settings = load_settings(folder, environment or {})
    return {name: taken.value for name, taken in settings.of(command).items()}


def test_a_score_by_settings_has_the_bytes_of_one_by_options(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text('rules = "paper2020.published"\n[score]\noutput-format = "json"\n')

    assert main(["score", str(EXAMPLE)]) == 0
    out, err = capsys.readouterr()
    assert main(["score", str(EXAMPLE), "--rules", "paper2020.published", "--output-format", "json"]) == 0
    by_options = capsys.readouterr()

    assert json.loads(out)["score"] == 19.761677
    assert out == by_options.out
    assert err == "rules: paper2020.published (../ariac-score.toml, line 1)\n"  # never in silence
    assert by_options.err == ""


def test_a_rule_set_beside_the_file_is_found_from_anywhere_and_leaves_no_trace_of_the_place(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "ours.yaml").write_text("id: ours\ntitle: Ours\nsource: us\nextends: paper2020.published\n")
    (folder / FILE).write_text('rules = "ours.yaml"\noutput-format = "json"\n')

    assert main(["-q", "score", str(EXAMPLE)]) == 0
    below = capsys.readouterr()
    monkeypatch.chdir(folder)
    assert main(["-q", "score", str(EXAMPLE)]) == 0

    assert below.err == ""
    assert capsys.readouterr().out == below.out


def test_the_command_line_comes_before_the_environment_and_that_before_a_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text('rules = "paper2020.published"\n')
    monkeypatch.setenv("ARIAC_SCORE_RULES", "ariac2020.as_coded")

    assert main(["check", str(EXAMPLE)]) == 0
    out, err = capsys.readouterr()
    assert "can be scored under ariac2020.as_coded" in out
    assert err == "rules: ariac2020.as_coded (ARIAC_SCORE_RULES)\n"
    assert main(["check", str(EXAMPLE), "--rules", "paper2020.published"]) == 0
    out, err = capsys.readouterr()
    assert "can be scored under paper2020.published" in out
    assert err == ""


def test_the_table_of_a_command_comes_before_what_is_said_for_all(folder: Path) -> None:
    (folder / FILE).write_text('[batch]\njobs = 2\n[score]\njobs = 3\nfail-on = ["unknown", "score<5"]\n')

    assert _taken(folder, "score") == {"jobs": 3, "fail-on": ["unknown", "score<5"]}
    assert _taken(folder, "batch") == {"jobs": 2}
    assert _taken(folder, "score", {"ARIAC_SCORE_JOBS": "4"})["jobs"] == 4
    assert _taken(folder, "price") == {}


@pytest.mark.parametrize("nearest", [FILE, "pyproject.toml"])
def test_the_nearest_file_counts_and_no_other(folder: Path, nearest: str) -> None:
    head = "" if nearest == FILE else "[tool.ariac-score]\n"
    (folder / "logs" / nearest).write_text(f'{head}rules = "near"\n')
    (folder / FILE).write_text('rules = "far"\nlog-map = "far"\n')

    assert _taken(folder / "logs", "score") == {"rules": "near"}


def test_a_project_without_settings_of_ours_is_passed_over_whatever_is_wrong_with_it(folder: Path) -> None:
    (folder / "logs/pyproject.toml").write_text("[tool.other\nthis is no TOML")
    (folder / FILE).write_text('rules = "far"\n')

    assert _taken(folder / "logs", "score") == {"rules": "far"}


def test_a_file_can_be_named_or_left_out(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text("this is no TOML")
    (folder / "other.toml").write_text('rules = "paper2020.published"\n')

    assert main(["check", str(EXAMPLE), "--config", "../other.toml"]) == 0
    assert main(["--config=../other.toml", "check", str(EXAMPLE)]) == 0
    assert main(["check", str(EXAMPLE), "--rules", "paper2020.published", "--no-config"]) == 0
    monkeypatch.setenv("ARIAC_SCORE_CONFIG", "../other.toml")
    assert main(["check", str(EXAMPLE)]) == 0
    capsys.readouterr()
    monkeypatch.delenv("ARIAC_SCORE_CONFIG")
    assert main(["check", str(EXAMPLE), "--rules", "paper2020.published"]) == 4
    assert "../ariac-score.toml: line 1: not TOML" in capsys.readouterr().err


def test_verbose_says_where_every_setting_comes_from_and_quiet_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text('rules = "paper2020.published"\n\n[score]\njobs = 1\n')

    assert main(["score", "-v", str(EXAMPLE)]) == 0
    loud = capsys.readouterr()
    assert main(["score", "-q", str(EXAMPLE)]) == 0
    quiet = capsys.readouterr()

    assert loud.err.splitlines() == [
        "rules: paper2020.published (../ariac-score.toml, line 1)",
        "jobs: 1 (../ariac-score.toml, line 4)",
        "file of settings: ../ariac-score.toml",
    ]
    assert quiet.err == ""
    assert loud.out == quiet.out


REFUSED = {
    'rulez = "x"': ("line 1: there is no setting 'rulez'", "did you mean 'rules'?"),
    '\n[scor]\nrules = "x"': ("line 2: there is no table 'scor'", "did you mean 'score'?"),
    '[score]\n\nrulez = "x"': ("line 3: 'score' has no setting 'rulez'", "did you mean 'rules'?"),
    '[check]\ncohort = "x"': ("line 2: 'check' has no setting 'cohort'", "it can have: "),
    "rules = 1": ("line 1: rules cannot be 1", "give a text in quotes"),
    'rules = ""': ('line 1: rules cannot be ""', "give a text in quotes"),
    "rules = ": ("its end: not TOML: ", "settings look like this"),
    'rules = "a"\nrules = "b"\n': ("line 2: not TOML: ", ""),
    "jobs = true": ("line 1: jobs cannot be true", "give a number"),
    'jobs = "4"': ('line 1: jobs cannot be "4"', "give a number"),
    'fail-on = "violation"': ('line 1: fail-on cannot be "violation"', "give a list"),
    "fail-on = [1]": ("line 1: fail-on cannot be [1]", "give a list"),
    "log_map = 'x'": ("line 1: there is no setting 'log_map'", "did you mean 'log-map'?"),
    "local-plugins = true": ("line 1: there is no setting 'local-plugins'", "on the command line alone"),
    "[tool.ariac-score]\nrules = 'x'": ("there is no table 'tool'", "tables can be"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_setting_is_refused_with_its_line_and_what_was_meant(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    cause, hint = REFUSED[text]
    (folder / FILE).write_text(text)

    assert main(["score", str(EXAMPLE), "--rules", "paper2020.published"]) == 4

    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"error: ../{FILE}: {cause}")
    assert hint in err


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("jobs = 65", "jobs: '65' is no number of threads from 0 to 64"),
        ('fail-on = ["violatoin"]', "fail-on: 'violatoin' is not violation"),
        ('output-format = "jsno"', "output-format cannot be 'jsno'"),
    ],
)
def test_what_the_option_would_refuse_is_refused_with_its_place(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str, cause: str
) -> None:
    (folder / FILE).write_text(text)

    assert main(["score", str(EXAMPLE), "--rules", "paper2020.published"]) == 4
    assert capsys.readouterr().err.startswith(f"error: ../{FILE}, line 1: {cause}")


def test_a_format_that_only_other_commands_know_is_left_to_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text('output-format = "junit"\n')

    assert main(["check", str(EXAMPLE), "--rules", "paper2020.published"]) == 0
    assert "can be scored" in capsys.readouterr().out
    assert main(["score", str(EXAMPLE), "--rules", "paper2020.published"]) == 0
    assert capsys.readouterr().out.startswith("<?xml")


def test_a_table_for_the_command_itself_must_name_a_format_it_knows(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text('[check]\noutput-format = "junit"\n')

    assert main(["check", str(EXAMPLE), "--rules", "paper2020.published"]) == 4
    assert "output-format cannot be 'junit'" in capsys.readouterr().err


def test_two_files_in_one_folder_contradict_each_other(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / FILE).write_text('rules = "paper2020.published"\n')
    (folder / "pyproject.toml").write_text('[tool.ariac-score]\nrules = "ariac2020.as_coded"\n')

    assert main(["score", str(EXAMPLE)]) == 4
    assert "pyproject.toml beside it has a table [tool.ariac-score] as well" in capsys.readouterr().err


def test_what_cannot_be_read_is_refused_in_words(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "latin.toml").write_bytes(b'rules = "\xe4"')
    (folder / "large.toml").write_bytes(b"#" * 1_000_001)
    (folder / "deep.toml").write_bytes(b"a = " + b"[" * 3000 + b"]" * 3000)

    for name, words in (
        ("latin.toml", "byte 9: it is not UTF-8 text"),
        ("large.toml", "it is larger than 1,000,000 bytes"),
        ("deep.toml", "not TOML: "),
        ("none.toml", "cannot be read: No such file or directory"),
        ("logs", "cannot be read: Is a directory"),
    ):
        assert main(["score", "x", "--config", f"../{name}"]) == 4, name
        assert words in capsys.readouterr().err


def test_a_number_of_the_environment_that_is_none_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ARIAC_SCORE_JOBS", "many")

    assert main(["score", "x", "--rules", "paper2020.published"]) == 4
    assert "ARIAC_SCORE_JOBS: 'many' is no number" in capsys.readouterr().err


@pytest.mark.slow
def test_a_competition_keeps_the_rules_it_names_and_a_folder_without_any_takes_those_that_are_set(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ARIAC_SCORE_RULES", "ariac2024.release_5")
    assert main(["rank", str(COMPETITION)]) == 0
    out, err = capsys.readouterr()
    assert "by ariac2024.official\n" in out
    assert err == ""

    (folder / "cup").mkdir()
    (folder / "cup/logs").symlink_to(COMPETITION / "logs")
    main(["rank", str(folder / "cup")])
    out, err = capsys.readouterr()
    assert err.startswith("rules: ariac2024.release_5 (ARIAC_SCORE_RULES)\n")


def test_a_file_beside_a_log_sets_nothing_and_runs_nothing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    handed_in = tmp_path / "submission"
    handed_in.mkdir()
    (handed_in / "run.mcap").symlink_to(EXAMPLE)
    (handed_in / FILE).write_text('rules = "./theirs.yaml"\n')
    (handed_in / "theirs.yaml").write_text("this would be refused if it were read")

    assert main(["score", str(handed_in / "run.mcap"), "--rules", "paper2020.published"]) == 0
    assert capsys.readouterr().err == ""


def test_code_beside_a_rule_set_needs_the_command_line_wherever_the_rule_set_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "theirs.yaml").write_text(
        "id: theirs\ntitle: T\nsource: t\nextends: paper2020\nmonitors:\n  mine: {use: './code.py:Mine'}\n"
    )
    (folder / "code.py").write_text("raise SystemExit('this ran')")
    (folder / FILE).write_text('rules = "theirs.yaml"\n')

    assert main(["score", str(EXAMPLE)]) == 4
    assert "--local-plugins" in capsys.readouterr().err


def test_help_works_whatever_the_settings_say(folder: Path) -> None:
    (folder / FILE).write_text("this is no TOML")

    with pytest.raises(SystemExit) as left:
        main(["score", "--help"])
    assert left.value.code == 0


def test_every_setting_is_an_option_of_its_commands_and_is_documented(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = (ROOT / "docs/settings.md").read_text(encoding="utf-8")
    for command in COMMANDS:
        with pytest.raises(SystemExit):
            main([command, "--help"])
        shown = capsys.readouterr().out
        for setting in SETTINGS.values():
            if command in setting.commands:
                assert f"--{setting.name} " in shown, (command, setting.name)
            row = f"| `{setting.name}` | `{setting.variable}` |"
            assert row in page
