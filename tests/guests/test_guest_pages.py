"""The pages of the guests: their words, their amounts, what they bring to them."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest

from ariac_score.cli import main

pytestmark = pytest.mark.usefixtures("guests")


def page_of(path: Path, rules: str, folder: Path) -> str:
    result, page = folder / "result.json", folder / "page.html"
    assert main(["score", str(path), "--rules", rules, "--output-format", "json", "-o", str(result)]) == 0
    assert main(["report", str(result), "-o", str(page)]) == 0
    return page.read_text(encoding="utf-8")


def exact(page: str) -> str:
    """A page with every amount as exact as its title says it."""
    return re.sub(r'<data value="[^"]*" title="exactly ([^"]*)">[^<]*</data>', r"\1", page)


def seen(page: str) -> str:
    """What a reader sees: no scripts, styles or marks, and the minus of typographers as that of programs."""
    text = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text)).replace("\u2212", "-")


@pytest.mark.parametrize(
    ("guest", "recording", "rules", "amounts"),
    [
        ("barn", "world_42", "barn", ["0.312508", "-0.187492"]),
        ("robocup_work", "bmt_1", "robocup_work.bmt_2024", ["577.8", "-95.137998", "-73.924004"]),
        ("carla", "results_2_1.json", "carla.2_1", ["65.178571", "-11.111111", "-6.349206"]),
    ],
)
def test_a_page_shows_the_amounts_derived_by_hand(
    guest: str, recording: str, rules: str, amounts: list[str], guests: Path, tmp_path: Path
) -> None:
    text = seen(exact(page_of(guests / guest / "recording" / recording, rules, tmp_path)))

    for amount in amounts:
        assert amount in text


def test_what_a_run_lost_by_its_time_alone_is_named_though_no_rule_was_broken(
    guests: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = seen(page_of(guests / "barn/recording/world_42", "barn", tmp_path))

    assert re.search(r"Had this been right .* navigation check navigation 1 \+0.19\b", text)
    capsys.readouterr()
    assert main(["score", str(guests / "barn/recording/world_42"), "--rules", "barn"]) == 0
    _, losses = capsys.readouterr().out.split("What cost points\n")
    assert losses.startswith("  navigation#1 ")
    assert losses.splitlines()[0].endswith("(-0.187492)")


def test_a_page_calls_the_work_what_the_competition_calls_it(guests: Path, tmp_path: Path) -> None:
    page = page_of(guests / "carla/recording/results_2_0.json", "carla.2_0", tmp_path)

    assert '<h2 id="work-h">Routes</h2>' in page


@pytest.mark.parametrize(
    ("recording", "rules", "absent"),
    [
        # One run through one world: nothing inside it, no human, nothing handed in.
        ("barn/recording/world_42", "barn", ("separation", "work")),
        # A file of numbers: no clock, no bodies.
        ("carla/recording/results_2_0.json", "carla.2_0", ("timeline", "separation", "plan")),
        # The sheet of a referee: times, but no bodies.
        ("robocup_work/recording/bmt_1", "robocup_work.bmt_2024", ("separation", "plan")),
    ],
)
def test_a_page_is_silent_about_what_the_competition_does_not_have(
    recording: str, rules: str, absent: tuple[str, ...], guests: Path, tmp_path: Path
) -> None:
    page = page_of(guests / recording, rules, tmp_path)
    text = seen(page.partition("Where it comes from")[0])  # below, rule set and facts stand as written

    for section in absent:
        assert f'id="{section}"' not in page
        assert f'href="#{section}"' not in page
    for word in ("order", "submission", "submitted", "announced", "robot and human", "cell", "part"):
        assert not re.search(rf"\b{word}s?\b", text), word


def test_a_page_names_a_trial_as_the_competition_does(guests: Path, tmp_path: Path) -> None:
    run = seen(page_of(guests / "robocup_work/recording/bmt_1", "robocup_work.bmt_2024", tmp_path))
    entry = seen(page_of(guests / "carla/recording/results_2_0.json", "carla.2_0", tmp_path))

    assert "Run report" in run
    assert "points the run would have earned" in run
    assert "Entry report" in entry


def test_the_points_of_an_item_say_what_was_earned_and_what_was_lost_there(
    guests: Path, tmp_path: Path
) -> None:
    text = seen(exact(page_of(guests / "robocup_work/recording/bmt_1", "robocup_work.bmt_2024", tmp_path)))

    # Grasped for 100; the loss, -95.137998, in the README of the guest.
    assert "4.862002 points (100 earned, 95.137998 lost)" in text


def test_text_and_messages_use_the_words_of_the_competition(
    guests: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["score", str(guests / "barn/recording/world_42"), "--rules", "barn"]) == 0
    assert "run from 0.000 s to 17.200 s" in capsys.readouterr().out

    for name in ("referee.csv",):
        (tmp_path / name).write_bytes((guests / "robocup_work/recording/bmt_1" / name).read_bytes())
    assert main(["score", str(tmp_path), "--rules", "robocup_work.bmt_2024"]) != 0
    refused = capsys.readouterr().err
    assert "no task was found" in refused
    assert "order" not in refused


@pytest.mark.parametrize(
    ("recording", "rules", "line"),
    [
        ("robocup_work/recording/bmt_1", "robocup_work.bmt_2024", "  run from 0.000 s to 258.000 s"),
        (
            "carla/recording/results_2_0.json",
            "carla.2_0",
            "  route RouteScenario_2_rep0, duration_s 92.1, length_m 655.3, status Perfect",
        ),
    ],
)
def test_info_uses_the_words_of_the_competition(
    recording: str, rules: str, line: str, guests: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(guests / recording), "--rules", rules]) == 0

    out = capsys.readouterr().out
    assert line in out.splitlines()
    assert "announced" not in out
    assert "submission" not in out


def test_a_panel_of_a_guest_shows_what_the_leaderboard_wrote(guests: Path, tmp_path: Path) -> None:
    text = seen(page_of(guests / "carla/recording/results_2_0.json", "carla.2_0", tmp_path))

    assert "As the leaderboard wrote it" in text
    # Route 1 of the recording: 62.5 % driven, a penalty of 0.92 * 0.85 = 0.782.
    assert "RouteScenario_1_rep0 62.500000 0.782000 48.875000" in text


def test_the_panel_of_one_guest_is_on_no_page_of_another(guests: Path, tmp_path: Path) -> None:
    text = page_of(guests / "barn/recording/world_42", "barn", tmp_path)

    assert "As the leaderboard wrote it" not in text


def test_an_export_of_a_guest_is_a_format_like_any_other(
    guests: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = guests / "robocup_work/recording/bmt_1"

    assert (
        main(
            ["score", str(path), "--rules", "robocup_work.bmt_2024", "--output-format", "robocup_work_sheet"]
        )
        == 0
    )

    rows = list(csv.reader(io.StringIO(capsys.readouterr().out)))
    assert rows[0] == ["check", "about", "verdict", "seen"]
    assert ["lost", "transport/nut", "violated", "loss, at 131 s"] in rows
    assert rows[-1] == ["score", "", "", "577.800000"]


def test_a_run_whose_facts_are_none_of_the_competition_is_refused_with_the_fact(
    guests: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in (guests / "robocup_work/recording/bmt_1").iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    from robocup_work import readers  # noqa: PLC0415  # on the path for this test alone

    monkeypatch.setattr(readers, "_task", lambda _path, _place, task: readers.Item(task["id"], "task"))

    assert main(["score", str(tmp_path), "--rules", "robocup_work.bmt_2024"]) == 6
    assert "'source'" in capsys.readouterr().err
