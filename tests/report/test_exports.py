"""Results as JUnit, SARIF, annotations, Markdown, CSV, JSON Lines: whole, and safe from what names hold."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from dataclasses import replace
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from ariac_score import Finding, Result, Span, Verdict, load_result, score_trial
from ariac_score.cli import main
from ariac_score.report.exports import export_names, exported
from ariac_score.report.text import score_text
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "tests/data/as_published/kitting_near_miss.result.json"

HOSTILE = [
    "<script>alert(1)</script>",
    "\"quoted\" & 'single'",
    "\u202eright to left",
    "x" * 10_000,
    "=cmd|'/c calc'!A0",
    "first\nsecond\r\nthird",
    "::error::forged",
    "100%0A::error::forged",
    "../../etc/passwd",
    "]]>",
    "| cell | cell |",
    "[link](javascript:alert)",
    "\x00\x1b[31m",
    "half a pair \ud800",
    "\ufffe",
]


@cache
def near_miss() -> Result:
    return load_result(EXAMPLE)


def renamed(text: str) -> Result:
    """The example with a stranger's text wherever a log can put one."""
    result = near_miss()
    findings = {
        key: replace(f, subject=text, message=text, clause=text)
        for key, f in result.measured.findings.items()
    }
    measured = replace(result.measured, team=text, trial=text, findings=findings)
    return replace(result, measured=measured)


def with_findings(*findings: Finding) -> Result:
    result = near_miss()
    made = {f"{f.check}#{i}": f for i, f in enumerate(findings, start=1)}
    return replace(result, measured=replace(result.measured, findings=made))


def lacking(topic: str, verdict: Verdict) -> Result:
    """The example with one finding that ends as a list of what the log lacks would."""
    finding = Finding("robot", verdict, f"nobody moved; not in the log: {topic}", check="separation")
    result = with_findings(finding)
    return replace(result, measured=replace(result.measured, unrecorded=(topic,)))


@pytest.mark.parametrize("name", ["junit", "sarif", "github", "markdown"])
def test_what_the_log_lacks_is_listed_where_something_is_undecided(name: str) -> None:
    text = exported(lacking("topic human", Verdict.INCONCLUSIVE), name).replace("\\:", ":")

    assert text.count("not recorded: topic human") == 1
    assert "not recorded" not in exported(lacking("topic human", Verdict.SATISFIED), name)


def test_the_words_of_a_plugin_are_shown_whole_whatever_they_end_in() -> None:
    text = score_text(lacking("topic human", Verdict.INCONCLUSIVE))

    assert "nobody moved; not in the log: topic human\n" in text
    assert text.count("log: not recorded: topic human") == 1


@pytest.fixture(scope="module")
def undecided(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The example without the signals of the human, by rules that withhold a score that is open."""
    return _without_the_human(tmp_path_factory.mktemp("withheld"), "withhold")


@pytest.fixture(scope="module")
def left_open(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The same by rules under which the worst counts: 0, as the human may have been touched; 28 at most."""
    return _without_the_human(tmp_path_factory.mktemp("open"), "worst")


def _without_the_human(folder: Path, counts: str) -> Result:
    kept = [name for name in SNAPSHOT_SIGNALS if "human" not in name]
    log = write_trial_log(folder / "trial.jsonl", kitting_trial(), signals=kept)
    rules = f"id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\nopen: {counts}\n"
    (folder / "mine.yaml").write_text(rules, encoding="utf-8")
    return score_trial(log, folder / "mine.yaml")


def parsed(xml: str) -> ElementTree.Element:
    return ElementTree.fromstring(xml)  # noqa: S314  # our own output


# JUnit ---------------------------------------------------------------------------------


def test_junit_has_a_case_for_each_finding_and_one_for_the_score() -> None:
    root = parsed(exported(near_miss(), "junit"))

    assert root.tag == "testsuites"
    # By the official page of the example: 30 findings of which 6 are violated.
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == ("31", "6", "0")
    failed = [case.get("name") for case in root.iter("testcase") if case.find("failure") is not None]
    assert "separation#1 robot/human" in failed
    assert sum(int(suite.get("tests", "")) for suite in root) == 31


def test_undecided_is_an_error_in_junit_and_so_is_a_withheld_score(undecided: Result) -> None:
    root = parsed(exported(undecided, "junit"))

    assert int(root.get("errors", "0")) >= 2
    (score,) = [case for case in root.iter("testcase") if case.get("name") == "score"]
    error = score.find("error")
    assert error is not None
    assert error.get("type") == "incomplete"


def test_an_open_score_is_no_error_in_junit_but_what_is_undecided_is(left_open: Result) -> None:
    root = parsed(exported(left_open, "junit"))
    (score,) = [case for case in root.iter("testcase") if case.get("name") == "score"]
    said = {one.get("name"): one.get("value") for one in root.iter("property")}

    assert score.find("error") is None
    assert int(root.get("errors", "0")) >= 2
    assert (said["score"], said["score_least"], said["score_most"]) == ("0", "0", "28")


def test_junit_tells_when_by_how_much_and_on_what_evidence() -> None:
    (case,) = [
        case
        for case in parsed(exported(near_miss(), "junit")).iter("testcase")
        if case.get("name") == "separation#1 robot/human"
    ]
    failure = case.findtext("failure") or ""

    assert "when: 18.810 s to 21.210 s" in failure
    assert "margin: -0.956 m" in failure  # 4.50249528 - 5.45849528301
    assert "centre_distance/robot/human = 4.50249528 m at 20.000 s" in failure


def test_what_does_not_apply_is_skipped() -> None:
    result = with_findings(Finding("x", Verdict.NOT_APPLICABLE, "nothing there", check="separation"))
    root = parsed(exported(result, "junit"))

    assert [s.get("skipped") for s in root if s.get("name") == "paper2020.published.separation"] == ["1"]


# SARIF ---------------------------------------------------------------------------------

LEVELS = {"none", "note", "warning", "error"}


def sarif(result: Result) -> dict[str, Any]:
    log: dict[str, Any] = json.loads(exported(result, "sarif"))
    return log


def check_sarif(log: dict[str, Any]) -> None:
    """What the standard asks of the parts that we use (clause numbers of SARIF 2.1.0)."""
    assert log["version"] == "2.1.0"  # 3.13.2
    for run in log["runs"]:
        driver = run["tool"]["driver"]
        assert driver["name"]  # 3.19.8
        ids = [rule["id"] for rule in driver["rules"]]
        assert len(set(ids)) == len(ids)  # 3.19.23: unique
        for rule in driver["rules"]:
            assert rule["shortDescription"]["text"]
        for invocation in run["invocations"]:
            assert invocation["executionSuccessful"] in (True, False)  # 3.20.14
            for note in invocation["toolExecutionNotifications"]:
                assert note["message"]["text"]
                assert note["level"] in LEVELS
        for artifact in run["artifacts"]:
            assert re.fullmatch(r"[0-9a-f]{64}", artifact["hashes"]["sha-256"])  # 3.24.11
        for result in run["results"]:
            assert ids[result["ruleIndex"]] == result["ruleId"]  # 3.27.6
            assert result["message"]["text"]  # 3.27.11
            assert result["kind"] in ("fail", "open")
            assert result["level"] in LEVELS
            assert (result["level"] == "none") == (result["kind"] != "fail")  # 3.27.10
            assert all(isinstance(v, str) for v in result["partialFingerprints"].values())  # 3.27.17
            for location in result["locations"]:
                physical = location["physicalLocation"]
                assert physical["region"]["startLine"] >= 1  # 3.30.5
                uri = physical["artifactLocation"]["uri"]
                assert re.fullmatch(r"[A-Za-z0-9._~/%-]+", uri)  # 3.10.1: a valid URI reference
                index = physical["artifactLocation"]["index"]
                assert run["artifacts"][index]["location"]["uri"] == uri  # 3.4.5


def test_sarif_has_every_violation_with_message_and_time() -> None:
    log = sarif(near_miss())

    check_sarif(log)
    results = {r["properties"]["finding"]: r for r in log["runs"][0]["results"]}
    violated = [k for k, f in near_miss().measured.findings.items() if f.verdict is Verdict.VIOLATED]
    assert sorted(results) == sorted(violated)
    separation = results["separation#1"]
    assert "18.810 s to 21.210 s" in separation["message"]["text"]
    assert (separation["properties"]["start_s"], separation["properties"]["end_s"]) == (18.81, 21.21)
    assert separation["level"] == "error"


def test_what_is_undecided_is_open_in_sarif(undecided: Result) -> None:
    log = sarif(undecided)

    check_sarif(log)
    assert {r["kind"] for r in log["runs"][0]["results"]} == {"fail", "open"}
    assert log["runs"][0]["properties"]["score"] is None


@pytest.mark.parametrize("text", HOSTILE)
def test_sarif_keeps_its_rules_whatever_names_hold(text: str) -> None:
    result = renamed(text)
    source = structs.replace(result.provenance.inputs[0], name=text)
    check_sarif(sarif(replace(result, provenance=replace(result.provenance, inputs=(source,)))))


def test_a_finding_has_the_same_fingerprint_in_the_next_run() -> None:
    before = sarif(near_miss())["runs"][0]["results"][-1]
    later = replace(near_miss().measured.findings["separation#1"], span=Span(3.0, 4.0))
    again = sarif(with_findings(later))["runs"][0]["results"][0]

    assert before["ruleId"] == again["ruleId"] == "separation"
    assert before["partialFingerprints"] == again["partialFingerprints"]


def test_sarif_is_valid_against_the_published_schema(undecided: Result) -> None:
    file = os.environ.get("ARIAC_SCORE_SARIF_SCHEMA")
    if not file:
        pytest.skip("ARIAC_SCORE_SARIF_SCHEMA does not name the schema of SARIF 2.1.0")
    from jsonschema import validators  # noqa: PLC0415  # slow

    schema = json.loads(Path(file).read_text(encoding="utf-8"))
    validator = validators.validator_for(schema)(schema)
    for result in (near_miss(), undecided, *map(renamed, HOSTILE)):
        assert [error.message for error in validator.iter_errors(sarif(result))] == []


# GitHub --------------------------------------------------------------------------------

_COMMAND = re.compile(r"::(notice|warning|error) title=([^\r\n]*?)::([^\r\n]*)")


def read_command(line: str) -> tuple[str, str, str]:
    """As the runner reads a workflow command: the first `::` after the properties ends them."""
    match = _COMMAND.fullmatch(line)
    assert match is not None, line
    command, title, message = match.groups()
    assert "," not in title
    assert ":" not in title
    for plain, code in ((":", "%3A"), (",", "%2C"), ("\r", "%0D"), ("\n", "%0A"), ("%", "%25")):
        title, message = title.replace(code, plain), message.replace(code, plain)
    return command, title, message


def test_github_annotations_name_check_time_and_message() -> None:
    commands = [read_command(line) for line in exported(near_miss(), "github").splitlines()]

    assert commands[0] == ("notice", "kitting_near_miss", "score 19.761677 of 36 possible")
    assert commands[1][:2] == ("error", "separation violated (separation#1, -8.546224 points)")
    assert commands[1][2].startswith("robot/human, 18.810 s to 21.210 s: too close for 2.40 s")


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_begins_a_command_of_its_own(text: str) -> None:
    shown = exported(renamed(text), "github")

    assert shown.count("\n") == len(shown.split("\n")) - 1 == 7  # the score and six violations
    for line in shown.split("\n")[:-1]:
        read_command(line)


@given(st.text(max_size=80))
def test_every_message_survives_the_escaping(text: str) -> None:
    kept = "".join(c for c in text if c.isprintable())
    finding = Finding("s", Verdict.VIOLATED, kept, check="separation")

    line = exported(with_findings(finding), "github").split("\n")[1]
    message = _COMMAND.fullmatch(line)
    assert message is not None
    unescaped = message[3].replace("%0D", "\r").replace("%0A", "\n").replace("%25", "%")
    assert unescaped == f"s: {kept}"


def test_more_violations_than_github_shows_are_counted() -> None:
    many = [Finding("s", Verdict.VIOLATED, f"number {i}", check="separation") for i in range(40)]
    lines = exported(with_findings(*many), "github").splitlines()

    assert len([line for line in lines if line.startswith("::error")]) <= 10
    assert "33 more are violated" in lines[-1]


def test_a_withheld_score_is_an_error_and_the_undecided_are_warnings(undecided: Result) -> None:
    commands = [read_command(line) for line in exported(undecided, "github").splitlines()]

    assert commands[0][0] == "error"
    assert commands[0][2].startswith("no score, open between 0 and 28 (neither counts")
    assert any(command == "warning" and "inconclusive" in title for command, title, _ in commands)


# Markdown ------------------------------------------------------------------------------


def test_markdown_begins_with_the_score_and_lists_what_was_violated() -> None:
    text = exported(near_miss(), "markdown")

    assert text.startswith("## score 19.761677 of 36 possible\n")
    assert "| separation\\#1 | robot/human | 18.810 s to 21.210 s | -0.956 m |" in text


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_makes_markup_links_or_cells(text: str) -> None:
    shown = exported(renamed(text), "markdown")
    own = exported(renamed("x"), "markdown")

    assert len(shown.splitlines()) == len(own.splitlines())
    for row, same in zip(shown.splitlines(), own.splitlines(), strict=True):
        assert len(re.findall(r"(?<!\\)\|", row)) == len(re.findall(r"(?<!\\)\|", same))
        assert not re.search(r"(?<!\\)[<>\[\]]", row)
    assert shown.isascii() or all(c.isprintable() or c == "\n" for c in shown)


# CSV and JSON Lines --------------------------------------------------------------------


def test_csv_has_a_row_for_each_finding() -> None:
    rows = list(csv.DictReader(io.StringIO(exported(near_miss(), "csv"))))

    assert len(rows) == len(near_miss().measured.findings)
    (separation,) = [row for row in rows if row["finding"] == "separation#1"]
    assert float(separation["margin"]) == near_miss().measured.findings["separation#1"].robustness
    assert (separation["start_s"], separation["end_s"], separation["score"]) == (
        "18.81",
        "21.21",
        "19.761677",
    )


@pytest.mark.parametrize(
    "text", [*HOSTILE, "+1", "-1", "@x", "\tx", "\rx", " =1", "\uff1d1", "%x", "|x", "\n=1"]
)
def test_no_cell_of_text_is_a_formula(text: str) -> None:
    rows = list(csv.reader(io.StringIO(exported(renamed(text), "csv"))))

    assert {len(row) for row in rows} == {len(rows[0])}
    for row in rows[1:]:
        for name, cell in zip(rows[0], row, strict=True):
            if name not in ("score", "automatic_score", "start_s", "end_s", "margin"):
                assert not cell.lstrip(" ").startswith(tuple("=+-@\t\r\n|%\uff1d")), name
            elif cell:
                float(cell)


def test_json_lines_hold_the_amounts_of_the_score_and_every_finding() -> None:
    lines = [json.loads(line) for line in exported(near_miss(), "jsonl").split("\n")[:-1]]

    assert lines[0]["record"] == "result"
    amounts = [Decimal(str(line["amount"])) for line in lines if line["record"] == "amount"]
    assert sum(amounts, Decimal(0)) == Decimal("19.761677")
    assert len([line for line in lines if line["record"] == "finding"]) == len(near_miss().measured.findings)


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("name", export_names())
def test_every_format_can_be_written_as_utf_8_whatever_names_hold(name: str, text: str) -> None:
    shown = exported(renamed(text), name)

    assert shown.encode("utf-8")
    assert shown.endswith("\n")
    if name == "junit":
        parsed(shown)


@pytest.mark.parametrize("name", export_names())
def test_the_same_result_gives_the_same_text(name: str) -> None:
    assert exported(near_miss(), name) == exported(load_result(EXAMPLE), name)


# The command line ----------------------------------------------------------------------


@pytest.mark.parametrize("name", export_names())
def test_export_of_a_stored_result_is_what_score_writes(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = ROOT / "examples/kitting_near_miss.mcap"
    score = ["score", str(log), "--rules", "paper2020.published"]
    assert main([*score, "--output-format", "json", "-o", str(tmp_path / "r.json")]) == 0
    assert main([*score, "--output-format", name]) == 0
    direct = capsys.readouterr().out

    assert main(["export", str(tmp_path / "r.json"), "--output-format", name]) == 0
    assert capsys.readouterr().out == direct


@pytest.mark.parametrize(
    ("criteria", "code"),
    [
        ([], 0),
        (["violation"], 1),
        (["violation:separation"], 1),
        (["violation:human_contact"], 0),
        (["unknown"], 0),
        (["score<19.761677"], 0),
        (["score<19.761678"], 1),
        (["score<-1"], 0),
        (["unknown", "score<36"], 1),
    ],
)
def test_criteria_decide_the_exit_code(
    criteria: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [word for text in criteria for word in ("--fail-on", text)]

    assert main(["export", str(EXAMPLE), *options]) == code
    assert ("failed:" in capsys.readouterr().err) == (code == 1)


def test_no_score_is_worse_than_a_failed_criterion(tmp_path: Path) -> None:
    log = tmp_path / "trial.jsonl"
    write_trial_log(log, kitting_trial(), signals=[n for n in SNAPSHOT_SIGNALS if "human" not in n])

    assert main(["score", str(log), "--rules", "paper2020.published", "--fail-on", "unknown"]) == 6


@pytest.mark.parametrize(
    "text", ["violations", "score<", "score<nan", "score>3", "score<1e3", "unknown:", ""]
)
def test_a_criterion_that_is_none_is_a_usage_error(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["export", str(EXAMPLE), "--fail-on", text])

    assert left.value.code == 4
    assert "is not violation" in capsys.readouterr().err


def test_a_criterion_about_an_unknown_check_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(EXAMPLE), "--fail-on", "violation:seperation"]) == 4

    out, err = capsys.readouterr()
    assert out == ""
    assert "did you mean 'separation'" in err
