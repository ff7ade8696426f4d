"""What the documentation says is tried here."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from ariac_score import errors, load_rule_set, score_trial
from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.in_gaps import in_gaps_of
from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.scoring.policy import POLICIES
from ariac_score.scoring.ruleset import rule_set_names
from ariac_score.scoring.sheet import CHECK_FUNCTIONS
from ariac_score.testing import Recorded, write_bag

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
SHIPPED = (ROOT / "docs/shipped_rule_sets.md").read_text(encoding="utf-8")


def _blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def test_ci_runs_the_two_commands_of_the_readme_to_the_letter() -> None:
    commands = [block.strip() for block in _blocks(README, "sh")[:2]]
    ci = (ROOT / ".ci/run").read_text(encoding="utf-8")

    assert len(commands) == 2
    for command in commands:
        assert command in ci.splitlines()


def test_the_readme_starts_with_the_two_commands() -> None:
    assert README.index("pytest") < README.index("## What it does")
    assert README.index("ariac-score score") < README.index("pytest")


def test_the_page_on_shipped_rule_sets_lists_every_one() -> None:
    listed = set(re.findall(r"`([a-z0-9_.]+)`", SHIPPED)) | {"ariac2018.as_coded", "ariac2019.as_coded"}

    assert "`ariac2017.as_coded` … `ariac2020.as_coded`" in SHIPPED
    assert set(rule_set_names()) <= listed


def test_the_page_on_commands_lists_every_command_of_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    commands = re.findall(r"^  ([a-z]+) ", capsys.readouterr().out, re.MULTILINE)

    assert {"score", "sign"} <= set(commands)
    for command in commands:
        assert re.search(rf"^ariac-score {command}\b", COMMANDS, re.MULTILINE), command


def test_the_page_on_commands_has_every_exit_code() -> None:
    codes = {
        cls.exit_code
        for cls in vars(errors).values()
        if isinstance(cls, type) and issubclass(cls, errors.ScoreError)
    }

    assert codes == {3, 4, 5, 6, 7}
    for code in (0, 2, *codes):
        assert re.search(rf"^\| {code} \|", COMMANDS, re.MULTILINE)


def test_the_python_example_of_the_readme_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    (example,) = _blocks(README, "python")

    exec(compile(example, "README.md", "exec"), {})  # noqa: S102  # our own text

    assert capsys.readouterr().out.startswith("25.760398\nviolated Span(start_s=18.81, end_s=21.21)")


def test_the_rule_set_of_its_page_is_sound(tmp_path: Path) -> None:
    page = (ROOT / "docs/rule_sets.md").read_text(encoding="utf-8")
    (tmp_path / "example.yaml").write_text(_blocks(page, "yaml")[0])

    rule_set = load_rule_set(str(tmp_path / "example.yaml"))

    assert set(rule_set.build(Registry())) == {"part_color", "right_agv", "separation"}
    # 3 * (2 + 2) colour points, one breach of 0.4 * (1 + 0.211047… / 5) demerits
    result = score_trial(ROOT / "examples/kitting_near_miss.mcap", rule_set)
    assert result.score is not None
    assert float(result.score) == pytest.approx(12 / (1 + 0.4 * (1 + 1.152 / 5.45849528 / 5)), abs=1e-6)


def test_the_page_on_rule_sets_names_every_function_fact_and_policy() -> None:
    page = (ROOT / "docs/rule_sets.md").read_text(encoding="utf-8")

    for name in CHECK_FUNCTIONS:
        assert f"`{name}(check" in page or f", `{name}(check" in page
    facts = load_rule_set("paper2020").sheet.facts
    for name in (*POLICIES, "duration_s", *(fact for own in facts.values() for fact in own)):
        assert f"`{name}`" in page


def test_the_trial_log_of_its_page_keeps_the_schema_and_scores(tmp_path: Path) -> None:
    page = (ROOT / "docs/recording.md").read_text(encoding="utf-8")
    (log,) = _blocks(page, "json")
    (tmp_path / "run_7.jsonl").write_text(log)

    for line in log.splitlines():
        assert schema_errors(json.loads(line), "trial_log") == []
    result = score_trial(tmp_path / "run_7.jsonl", "paper2020")
    # One sample says nothing about the nine seconds: at worst somebody was hurt in them, at best nobody.
    assert result.is_open
    assert result.interval is not None
    assert result.score == result.interval.least == 0
    assert result.interval.most > 0


TEAHOUSE_NS = 1_800_000_000_000_000_000


def _teahouse_recording(file: Path, *, spilt: bool) -> Path:
    """Twenty seconds at 50 Hz: the tray tilts from 6 s to 7 s, the guest comes within a metre at 10 s."""
    messages = []
    for number in range(1001):
        t_ns = TEAHOUSE_NS + number * 20_000_000
        stamp = {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}
        for body, x in (("waiter", 0.0), ("guest", max(0.5, abs(number - 500) * 0.02))):
            fields = {"header": {"stamp": stamp, "frame_id": "hall"}, "point": {"x": x, "y": 0.0, "z": 0.0}}
            messages.append(Recorded(f"/{body}/position", "geometry_msgs/msg/PointStamped", t_ns, fields))
        tilt = 0.5 if 300 <= number < 350 else 0.1
        messages.append(Recorded("/tray/tilt", "std_msgs/msg/Float64", t_ns, {"data": tilt}))
        word = {0: "serving", 1000: "over", **({700: "spill"} if spilt else {})}.get(number)
        if word:
            messages.append(Recorded("/match", "std_msgs/msg/String", t_ns, {"data": word}))
    return write_bag(file, messages, storage="mcap")


@pytest.mark.parametrize(("spilt", "score"), [(False, 100 - 10 - 20), (True, 100 - 10 - 20 - 50)])
def test_the_competition_of_its_page_is_scored(
    install: Callable[..., str], tmp_path: Path, spilt: bool, score: int
) -> None:
    page = (ROOT / "docs/write-a-competition.md").read_text(encoding="utf-8")
    log_map, rules = _blocks(page, "yaml")
    (decoder,) = _blocks(page, "python")
    (entry,) = _blocks(page, "toml")
    (tmp_path / "teahouse_map.yaml").write_text(log_map, encoding="utf-8")
    (tmp_path / "teahouse.yaml").write_text(rules, encoding="utf-8")
    group, name, attribute = re.findall(r'entry-points\."(.+)"\]\n"(.+)" = "teahouse:(.+)"', entry)[0]
    install("teahouse", {name: attribute}, source=decoder, group=group)

    result = score_trial(
        _teahouse_recording(tmp_path / "t.mcap", spilt=spilt), str(tmp_path / "teahouse.yaml")
    )

    assert result.score == score
    decode = Registry().find(group, name).build({}).decode
    assert decode("std_msgs/msg/String", SimpleNamespace(data="tea break"), 1.0) is None


def test_the_page_on_competitions_names_every_group() -> None:
    page = (ROOT / "docs/write-a-competition.md").read_text(encoding="utf-8")

    for group in (*GROUPS, "ariac_score.messages"):
        assert f"`{group}`" in page


def test_the_architecture_page_names_every_module() -> None:
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    for path in (ROOT / "ariac_score").rglob("*.py"):
        part = path.relative_to(ROOT / "ariac_score")
        if path.name.startswith("__") or part.parts[0] in ("cli", "report", "testing"):
            continue
        assert path.name in page, f"{part} is not on the architecture page"


def test_no_file_speaks_of_the_machine_it_was_made_on() -> None:
    for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("rules/**/*.yaml")]:
        assert str(ROOT) not in path.read_text(encoding="utf-8")


def test_the_page_about_gaps_says_of_every_monitor_what_it_declares() -> None:
    """One line for each; a class whose parameters decide is built as its `example` has it."""
    text = (ROOT / "docs/gaps.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"^\| `([a-z0-9_.]+)` \| (\w+) \|", text, flags=re.MULTILINE))
    declared = {}
    for plugin in Registry().all("ariac_score.monitors"):
        if plugin.distribution == "ariac-score":
            declared[plugin.name] = in_gaps_of(plugin.build(getattr(plugin.load(), "example", {})))

    assert said == declared
