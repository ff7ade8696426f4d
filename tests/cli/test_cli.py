"""The command line: what it prints where, and with which exit code it leaves."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from ariac_score.cli import _COMMANDS, _parser, main
from ariac_score.cli.parser import leaves
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_trial_log(tmp_path / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)


@pytest.fixture
def stored(log: Path, tmp_path: Path) -> Path:
    result = tmp_path / "result.json"
    assert (
        main(
            [
                "score",
                str(log),
                "--rules",
                "paper2020.published",
                "--output-format",
                "json",
                "-o",
                str(result),
            ]
        )
        == 0
    )
    return result


def _run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ariac_score.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)


def test_a_result_goes_to_the_file_and_nothing_to_stdout(
    stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert json.loads(stored.read_text())["score"] == 19.761677
    assert capsys.readouterr().out == ""
    assert sorted(p.name for p in stored.parent.iterdir()) == ["result.json", "trial.jsonl"]


def test_a_score_that_fails_leaves_an_older_result_alone(
    stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = stored.read_bytes()

    assert main(["score", "nowhere", "--rules", "paper2020.published", "-o", str(stored)]) == 5

    assert stored.read_bytes() == before
    assert "no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["scroe"],
        ["score"],
        ["score", "x"],
        ["score", "x", "--rules", "r", "--output-format", "xml"],
        ["rules"],
        ["rules", "show"],
    ],
)
def test_a_usage_error_has_its_own_exit_code_and_points_to_help(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(arguments)

    out, err = capsys.readouterr()
    assert left.value.code == 4
    assert out == ""
    assert "error:" in err
    assert "--help" in err


@pytest.mark.parametrize(
    "command",
    [
        ["score", "LONG", "--rules", "paper2020"],
        ["score", "t.jsonl", "--rules", "paper2020", "--trial-config", "LONG"],
        ["explain", "LONG"],
        ["batch", "LONG", "--rules", "paper2020", "-o", "out"],
    ],
)
def test_a_name_that_no_file_can_have_is_a_mistake_in_the_command(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """It was called an output that cannot be written, or a broken plugin."""
    code = main([word.replace("LONG", "x" * 300) for word in command])

    assert code == 4
    assert capsys.readouterr().err.startswith(f"error: the file name '{'x' * 60}…' is too long\nhint: ")


def test_version_and_help_need_neither_numpy_nor_rosbags_nor_plugins() -> None:
    code = (
        "import sys; from ariac_score.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        "print({'numpy', 'rosbags', 'jsonschema', 'rich', 'yaml', 'ariac_score_rml'} & set(sys.modules))"
    )
    for argument in ("--version", "--help"):
        done = subprocess.run(  # our own command
            [sys.executable, "-c", code, argument], capture_output=True, text=True, check=True
        )
        assert done.stdout.splitlines()[-1] == "set()"


def test_every_command_that_help_lists_says_how_it_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    listed = re.findall(r"^  (\w+) ", capsys.readouterr().out, re.MULTILINE)

    assert "score" in listed
    for name in listed:
        with pytest.raises(SystemExit) as left:
            main([name, "--help"])
        assert left.value.code == 0
        assert capsys.readouterr().out.startswith(f"usage: ariac-score {name} ")


def test_the_module_can_be_run_and_says_its_version() -> None:
    done = _run("--version")

    assert (done.returncode, done.stdout.split()[0]) == (0, "ariac-score")


@pytest.mark.slow
def test_a_pipe_that_closes_early_is_not_an_error() -> None:
    done = subprocess.run(
        ["/bin/sh", "-c", f"{sys.executable} -m ariac_score.cli rules show paper2020.published | head -n 1"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )

    assert done.stdout.startswith("id: paper2020.published")
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_colours_stay_away_from_anything_but_a_terminal(log: Path) -> None:
    assert "\x1b" not in _run("score", log, "--rules", "paper2020.published").stdout


def test_text_from_a_log_cannot_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = write_trial_log(tmp_path / "a.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS).read_text()
    hostile = tmp_path / "b.jsonl"
    hostile.write_text(lines.replace("gear_part_red", "gear_\\u001b[31m_red"))

    assert main(["score", str(hostile), "--rules", "paper2020.published"]) == 0

    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert "gear_\\x1b[31m_red" in out


def test_explain_leads_from_the_score_to_the_samples(
    stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", str(stored)]) == 0

    out = capsys.readouterr().out
    assert out.splitlines()[0] == "score"
    assert "gate(human_contact) * task / (1 + demerits) = 19.7616774" in out
    assert "at 20.000 s: centre_distance/robot/human = 4.50249528 m" in out
    assert "at 20.000 s: required_distance/robot/human = 5.45849528 m" in out


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("order_1", "score/earned/order_1"),
        ("score/earned/order_0", "score/earned/order_0"),
        ("separation", "time_in_violation_s = 2.4"),
        ("separation#1", "robot_moving: yes"),
        ("part_pose#5", "distance 0.031 m (at most 0.03)"),
        ("order_0/order_0_shipment_0/part_1", "no blue gear for it"),
    ],
)
def test_explain_finds_lines_checks_findings_and_subjects(
    path: str, expected: str, stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", str(stored), path]) == 0
    assert expected in capsys.readouterr().out


def test_explain_of_a_check_prices_each_of_its_findings(
    stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # 28 points before the only violation; 28 / (1 + 0.416884) after it.
    assert main(["explain", str(stored), "separation"]) == 0
    breach = capsys.readouterr().out
    assert "separation#1 too close for 2.40 s" in breach
    assert "without it alone: 28 (+8.238323)" in breach

    # Four colours of five, in the points and again in the bonus; order_1 counts three times.
    assert main(["explain", str(stored), "part_color"]) == 0
    lines = capsys.readouterr().out.splitlines()
    parts = [line.split("·")[-1].strip() for line in lines if "part_" in line or " color ·" in line]
    amounts = [part for part in parts if part[0].isdigit()]
    nothing = "0  (it earned nothing)"
    assert amounts == ["2", "1", nothing, "1", "1", nothing, "1", "6", "3", "3", "3", "3"]

    assert main(["explain", str(stored), "order_time"]) == 0
    assert "(not priced)" in capsys.readouterr().out


@pytest.mark.slow
def test_explain_of_a_term_shows_its_value_and_the_price_of_what_it_rests_on(
    stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", str(stored), "demerits"]) == 0

    out = capsys.readouterr().out
    # 0.4 (1 + 0.211047 / tau of 5 s), derived in tests/test_same_bytes.py.
    assert "demerits = 0.416883774" in out
    assert "separation#1 violated" in out
    assert "(-8.546224)" in out
    assert "part_color" not in out


def test_explain_refuses_a_name_that_is_not_there(stored: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(stored), "seperation"]) == 4
    assert "did you mean 'separation'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("damage", "cause"),
    [
        (lambda d: d.update(score=20.0), "the ledger adds up to 19.761677, the score is 20"),
        (lambda d: d["ledger"]["children"][0].update(amount=29.0), "its lines add up to"),
        (lambda d: d.update(scorre=1), "unknown key 'scorre'"),
        (lambda d: d.pop("provenance"), "key 'provenance' is missing"),
        (lambda d: d.update(status="incomplete"), "status 'incomplete' does not go with score"),
        (lambda d: d["measured"]["findings"]["separation#1"].update(verdict="satisfied"), "does not follow"),
        (lambda d: d["measured"]["findings"].pop("separation#1"), "findings"),
        (lambda d: d.update(rules=d["rules"].replace("0.4", "0.1")), "they were edited"),
        (lambda d: d.update(rules="score: 20"), "they were edited"),
        (lambda d: d.update(possible=100.0), "does not follow"),
        (lambda d: d.update(ledger=None), "status 'scored' does not go with"),
    ],
)
def test_a_result_that_was_tampered_with_is_refused(
    damage: object, cause: str, stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(stored.read_text())
    damage(data)  # type: ignore[operator]
    stored.write_text(json.dumps(data))

    assert main(["explain", str(stored)]) == 6

    err = capsys.readouterr().err
    assert cause in err
    assert "hint:" in err


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"schema": "other"}', "\x00"])
def test_a_file_that_is_no_result_is_refused(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.json").write_text(text)

    assert main(["explain", str(tmp_path / "x.json")]) == 6
    assert "x.json" in capsys.readouterr().err


@pytest.mark.slow
def test_rules_are_listed_shown_and_validated(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "list"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert {"paper2020.published", "ariac2022.as_coded"} <= set(names)

    assert main(["rules", "validate", *names]) == 0
    assert capsys.readouterr().out.count("sound") == len(names)

    assert main(["rules", "show", "paper2020.published"]) == 0
    assert capsys.readouterr().out == (ROOT / "rules/paper2020/published.yaml").read_text()


def test_plugins_are_listed_with_who_brought_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "list"]) == 0

    out = capsys.readouterr().out
    assert re.search(r"^monitors +iso_ts_15066.ssm_separation ", out, re.MULTILINE)
    assert re.search(r"^rule_sets +paper2020.published +ariac-score 0", out, re.MULTILINE)
    assert all("ariac-score 0." in line for line in out.splitlines() if " kitting." in line)


def test_info_says_what_a_log_holds_and_what_could_be_decided(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(EXAMPLE), "--rules", "paper2020.published"]) == 0

    out = capsys.readouterr().out
    assert "/snapshot" in out
    assert "100.0 Hz" in out
    assert "order order_1, parts 2, priority 1, announced 8.000 s" in out
    assert "separation           has what it needs" in out


def test_info_without_rules_describes_the_log_and_says_how_to_learn_more(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["info", str(EXAMPLE)]) == 0
    assert "--rules" in capsys.readouterr().out


@pytest.mark.parametrize(("out", "err", "times"), [(True, True, 1), (True, False, 2), (False, True, 2)])
def test_what_is_open_is_said_twice_unless_one_terminal_shows_both(
    out: bool,
    err: bool,
    times: int,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_trial_log(tmp_path / "x.jsonl", kitting_trial(human=False), signals=["speed/robot"])
    monkeypatch.setattr(sys.stdout, "isatty", lambda: out)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: err)

    assert main(["score", str(tmp_path / "x.jsonl"), "--rules", "paper2020"]) == 6
    both = "".join(capsys.readouterr())
    assert both.count("the lower end counts") == times


def test_what_is_open_is_explained_with_the_time_of_each_gap_and_both_worlds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = kitting_trial()
    kept = (trial.signals["speed/human"].t < 20.0) | (trial.signals["speed/human"].t > 20.3)
    gap = {
        name: replace(one, t=one.t[kept], values=one.values[kept]) if len(one.t) == len(kept) else one
        for name, one in trial.signals.items()
    }
    for name, given in (("whole", trial), ("gap", replace(trial, signals=gap))):
        write_trial_log(tmp_path / f"{name}.jsonl", given, signals=SNAPSHOT_SIGNALS)
        main(
            [
                "score",
                str(tmp_path / f"{name}.jsonl"),
                "--rules",
                "paper2020",
                "-o",
                str(tmp_path / f"{name}.json"),
            ]
        )
    capsys.readouterr()

    assert main(["explain", str(tmp_path / "gap.json"), "interval"]) == 0
    told = capsys.readouterr().out
    assert "open: separation of robot/human" in told
    assert "19.990 to 20.310 s" in told
    assert "in the best world" in told
    assert "in the worst world" in told
    worst = re.search(r"separation#worst\d+", told)
    assert worst is not None
    assert main(["explain", str(tmp_path / "gap.json"), worst[0]]) == 0
    capsys.readouterr()

    assert main(["explain", str(tmp_path / "whole.json"), "interval"]) == 0
    assert capsys.readouterr().out == "no gap is open\n"


def test_info_on_a_log_without_a_human_says_what_could_not_be_decided(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = kitting_trial(human=False)
    write_trial_log(tmp_path / "x.jsonl", trial, signals=["speed/robot"])

    assert main(["info", str(tmp_path / "x.jsonl"), "--rules", "paper2020.published"]) == 0
    assert "separation           undecided: the log shows no human" in capsys.readouterr().out


MONITORS_ONLY = """\
id: apart
title: Keep apart
source: a competition without orders
log_map: {log_map}
monitors: {{near: {{use: iso_ts_15066.ssm_separation, with: {{profile: seed}}}}}}
score: 100 - 5 * count(near)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "ways",
    [
        "| head -n 1",
        "2>&1 | head -n 1",
        "2>&1 >/dev/null | true",
        ">&-",
        "2>&-",
        ">&- 2>&-",
    ],
)
def test_who_reads_the_output_changes_no_code(tmp_path: Path, ways: str) -> None:
    write_trial_log(tmp_path / "x.jsonl", kitting_trial(human=False), signals=["speed/robot"])
    scored = f"{sys.executable} -m ariac_score.cli score x.jsonl --rules paper2020.published"

    done = subprocess.run(
        ["/bin/bash", "-c", f"set -o pipefail; {scored} {ways}"],
        cwd=tmp_path,
        capture_output=True,
        check=False,
    )

    assert done.returncode == 6  # withheld, for nobody saw the human
    assert b"Traceback" not in done.stderr


@pytest.mark.slow
def test_info_shows_bodies_and_signals_where_the_rules_need_no_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_trial_log(tmp_path / "x.jsonl", replace(kitting_trial(), work=(), submissions=()))
    (tmp_path / "apart.yaml").write_text(MONITORS_ONLY.format(log_map="ariac2020"), encoding="utf-8")

    assert main(["info", str(tmp_path / "x.jsonl"), "--rules", str(tmp_path / "apart.yaml")]) == 0
    out = capsys.readouterr().out
    assert "human human" in out
    assert "centre_distance/robot/human" in out
    assert "no order was found" not in out
    assert main(["info", str(tmp_path / "x.jsonl"), "--rules", "paper2020.published"]) == 0
    out = capsys.readouterr().out
    assert "no order was found" in out
    assert "centre_distance/robot/human" in out
    assert "--rules safety" in out
    assert main(["score", str(tmp_path / "x.jsonl"), "--rules", "safety"]) == 0


def test_a_rule_set_whose_log_map_names_a_decoder_that_is_not_installed_is_not_sound(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    channel = "channels: [{topic: /state, type: std_msgs/msg/String, decoder: nobody.has_it}]\n"
    (tmp_path / "map.yaml").write_text(f"id: m\ntitle: M\nsource: a test\n{channel}", encoding="utf-8")
    (tmp_path / "apart.yaml").write_text(MONITORS_ONLY.format(log_map="./map.yaml"), encoding="utf-8")

    assert main(["rules", "validate", str(tmp_path / "apart.yaml")]) == 4
    assert "no installed distribution provides 'nobody.has_it'" in capsys.readouterr().err


@pytest.mark.slow
def test_rules_that_only_take_points_away_are_told_why_laws_about_work_say_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "apart.yaml").write_text(MONITORS_ONLY.format(log_map="ariac2020"), encoding="utf-8")

    main(["rules", "check", str(tmp_path / "apart.yaml"), "--cases", "20"])

    out = capsys.readouterr().out
    assert "doing nothing is not optimal: nothing in it earns points" in out
    assert "read from a record" not in out


@pytest.mark.slow
def test_an_official_total_is_not_called_different_from_a_score_that_is_withheld(
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = Path(__file__).parents[1] / "data/performance_2020.log"

    assert main(["score", str(log), "--rules", "ariac2020.as_coded"]) == 6

    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("official total")]
    assert line.endswith("ours is withheld, so nothing says whether it is the same")


def _all_help() -> str:
    commands = [*_COMMANDS, "rml"]
    return "".join(leaf.format_help() for name in commands for leaf in leaves(_parser(name)))


def test_no_help_points_at_a_file_that_an_installation_does_not_have() -> None:
    assert "docs/" not in _all_help()
    assert "README" not in _all_help()


@pytest.mark.slow
def test_nothing_that_is_printed_points_at_the_documentation_of_the_checkout() -> None:
    for file in [*(ROOT / "ariac_score").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
                assert "docs/" not in node.value, (file, node.lineno)


@pytest.mark.parametrize("name", [*_COMMANDS, "rml"])
def test_every_command_and_action_can_be_quiet_or_verbose(name: str) -> None:
    for leaf in leaves(_parser(name)):
        assert {"-q", "--quiet", "-v", "--verbose", "--config", "--no-config"} <= {
            option for action in leaf._actions for option in action.option_strings
        }, leaf.prog


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("scroe", "there is no command 'scroe'\nhint: did you mean 'score'?"),
        ("rules lst", "there is no action 'lst'\nhint: did you mean 'list'?"),
        ("rules", "the following arguments are required: ACTION\nhint: one of: list, show, diff, "),
        ("score x --rulez y", "there is no option '--rulez'\nhint: did you mean '--rules'?"),
        ("score x --rules y --rulez y", "there is no option '--rulez'\nhint: did you mean '--rules'?"),
        ("score x --rules y -z", "there is no option '-z'\nhelp: "),
        ("score x y --rules z", "there is one argument too many: 'y'\nhelp: ariac-score score --help"),
        ("score x", "the following arguments are required: --rules\nhint: give --rules NAME"),
        ("score x --rules y --output-format jsno", "--output-format cannot be 'jsno'\nhint: did you mean"),
        ("rml chekc", "there is no action 'chekc'\nhint: did you mean 'check'?"),
        ("--verbos score x --rules y", "there is no option '--verbos'\nhint: did you mean '--verbose'?"),
    ],
)
def test_a_slip_is_named_with_what_was_meant(
    line: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(line.split())

    assert left.value.code == 4
    assert capsys.readouterr().err.startswith(f"error: {said}")


TAKES_RESULTS = ("report", "verify", "explain", "export", "price --rules paper2020.published", "sensitivity")


@pytest.mark.parametrize("command", TAKES_RESULTS)
def test_a_log_in_the_place_of_a_result_is_told_apart(
    command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "run.mcap").write_bytes(EXAMPLE.read_bytes())
    name, *more = command.split()

    for log in (EXAMPLE, folder) if name == "report" else (EXAMPLE,):
        assert main([name, str(log), *more]) == 6
        err = capsys.readouterr().err
        assert f"{log}: this is a log, and '{name}' takes a result\n" in err
        first, then = err.partition("hint: score it first: ")[2].split("; then: ")
        assert first == f"ariac-score score {log} --rules NAME -o {log.stem}.json"
        assert then == f"ariac-score {name} {log.stem}.json\n"


def test_a_log_map_is_named_from_where_one_stands_and_a_rule_set_names_its_own_from_its_file(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rules").mkdir()
    (tmp_path / "rules/apart.yaml").write_text(MONITORS_ONLY.format(log_map="./here.yaml"), encoding="utf-8")
    for name, folder in (("here", tmp_path / "rules"), ("ours", tmp_path)):
        text = f"{{id: {name}, title: t, source: s, extends: ariac2020}}"
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    command = ["score", log.name, "--rules", "rules/apart.yaml", "--output-format", "json"]

    for option, used in ([], "here"), (["--log-map", "ours.yaml"], "ours"):
        assert main([*command, *option]) == 0
        assert json.loads(capsys.readouterr().out)["provenance"]["log_map"]["id"] == used
    assert main([*command, "--log-map", "here.yaml"]) == 4
    assert "here.yaml" in capsys.readouterr().err


def test_a_result_that_is_not_there_is_nothing_to_show(capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["report"], ["verify"], ["explain"], ["price", "--rules", "paper2020.published"]):
        assert main([*command, "nothere.json"]) == 5
        assert "error: nothere.json: no such file" in capsys.readouterr().err


def test_a_slip_in_what_if_is_named_by_its_option(capsys: pytest.CaptureFixture[str]) -> None:
    competition = str(ROOT / "examples/competition/2025")

    assert main(["report", competition, "-o", "nowhere", "--what-if", "colision=1,2"]) == 4
    error = capsys.readouterr().err
    assert error.startswith("error: --what-if: the rule set has no number 'colision' to vary\nhint: ")
    assert "rules.yaml" not in error


@pytest.mark.slow
def test_a_file_for_json_holds_json_and_one_of_another_name_text(log: Path, tmp_path: Path) -> None:
    for name in ("r.json", "r.txt"):
        assert main(["score", str(log), "--rules", "paper2020.published", "-o", str(tmp_path / name)]) == 0
    for form, name in (("text", "forced.json"), ("json", "forced.txt")):
        arguments = ["score", str(log), "--rules", "paper2020.published", "--output-format", form]
        assert main([*arguments, "-o", str(tmp_path / name)]) == 0

    assert json.loads((tmp_path / "r.json").read_text())["score"] == 19.761677
    assert (tmp_path / "r.txt").read_text().startswith("19.761677 of 36")
    assert (tmp_path / "forced.json").read_text() == (tmp_path / "r.txt").read_text()
    assert (tmp_path / "forced.txt").read_text() == (tmp_path / "r.json").read_text()
