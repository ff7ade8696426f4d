"""Which runs a competition has: `competition.yaml` and the official folders."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.errors import DataFileError, NothingToScoreError, UsageError
from ariac_score.ranking.competition import load_competition

HEAD = "id: test\nrules: paper2020.published\nruns: logs/{team}/{trial}_{run}\n"


def lay_out(root: Path, *names: str) -> None:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x", encoding="utf-8") if path.suffix else path.mkdir(exist_ok=True)


def write(root: Path, text: str = HEAD) -> Path:
    (root / "competition.yaml").write_text(text, encoding="utf-8")
    return root / "competition.yaml"


def test_runs_are_found_by_the_pattern_with_the_number_after_the_last_underscore(tmp_path: Path) -> None:
    lay_out(tmp_path, "logs/alpha/kit_easy_1", "logs/alpha/kit_easy_10", "logs/beta/kit_easy_2")

    found = load_competition(write(tmp_path))

    assert [run.key for run in found.runs] == [
        ("alpha", "kit_easy", 1),
        ("alpha", "kit_easy", 10),
        ("beta", "kit_easy", 2),
    ]
    assert [team.id for team in found.teams] == ["alpha", "beta"]
    assert [trial.id for trial in found.trials] == ["kit_easy"]


def test_listed_teams_and_trials_keep_their_order_and_strangers_are_named(tmp_path: Path) -> None:
    lay_out(tmp_path, "logs/beta/kit_1", "logs/alpha/kitt_1", "logs/gamma/kit_1", "logs/beta/notes")
    text = HEAD + "teams: [{id: beta, name: The Betas}, {id: alpha}]\ntrials: [{id: kit}]\n"

    found = load_competition(write(tmp_path, text))

    assert [team.name for team in found.teams] == ["The Betas", "alpha"]
    assert [run.key for run in found.runs] == [("beta", "kit", 1)]
    assert len(found.strangers) == 3
    assert any("'kitt' is not listed; did you mean 'kit'?" in stranger for stranger in found.strangers)


def test_two_runs_with_one_number_are_both_refused_by_name(tmp_path: Path) -> None:
    lay_out(tmp_path, "logs/alpha/kit_1", "logs/alpha/kit_01", "logs/alpha/kit_2")

    found = load_competition(write(tmp_path))

    assert [run.number for run in found.runs] == [2]
    assert found.refused == {("alpha", "kit", 1): "2 runs have the number 1: kit_01, kit_1"}


def test_configurations_are_found_by_pattern_or_named(tmp_path: Path) -> None:
    lay_out(tmp_path, "logs/alpha/kit_1", "cars/alpha.yaml", "trials/kit.yaml", "other.yaml")
    text = HEAD + "team_configs: cars/{team}.yaml\ntrial_configs: trials/{trial}.yaml\n"
    named = text + "trials: [{id: kit, config: other.yaml}]\n"

    plain, own = load_competition(write(tmp_path, text)), load_competition(write(tmp_path, named))

    assert plain.teams[0].config == tmp_path / "cars/alpha.yaml"
    assert plain.trials[0].config == tmp_path / "trials/kit.yaml"
    assert own.trials[0].config == tmp_path / "other.yaml"


def test_runs_may_be_listed_one_by_one(tmp_path: Path) -> None:
    lay_out(tmp_path, "a.mcap", "b.mcap")
    text = (
        "id: test\nrules: paper2020.published\nruns:\n"
        "- {team: alpha, trial: kit, run: 3, path: a.mcap}\n"
        "- {team: beta, trial: kit, run: 1, path: b.mcap}\n"
    )

    assert [run.path.name for run in load_competition(write(tmp_path, text)).runs] == ["a.mcap", "b.mcap"]


def test_the_evaluation_folders_of_2024_need_no_file(tmp_path: Path) -> None:
    lay_out(
        tmp_path,
        "logs/alpha/kit_1",
        "logs/beta/readme.txt",
        "trials/kit.yaml",
        "competitor_configs/alpha.yaml",
    )

    found = load_competition(tmp_path, "paper2020.published")

    assert [team.id for team in found.teams] == ["alpha", "beta"]
    assert found.teams[0].config == tmp_path / "competitor_configs/alpha.yaml"
    assert found.trials[0].config == tmp_path / "trials/kit.yaml"


def test_the_docker_folders_of_2017_to_2022_have_one_run_for_each_trial(tmp_path: Path) -> None:
    lay_out(tmp_path, "logs/alpha/qual_1", "trial_config/qual_1.yaml", "team_config/alpha/team_config.yaml")

    found = load_competition(tmp_path, "paper2020.published")

    assert [run.key for run in found.runs] == [("alpha", "qual_1", 1)]
    assert found.teams[0].config == tmp_path / "team_config/alpha/team_config.yaml"


def test_nothing_says_by_which_rules(tmp_path: Path) -> None:
    lay_out(tmp_path, "logs/alpha/kit_1")

    with pytest.raises(UsageError, match="nothing says by which rules"):
        load_competition(tmp_path)


@pytest.mark.parametrize("names", [(), ("logs/readme.txt",), ("logs/alpha/nothing",)])
def test_a_folder_without_teams_or_trials_is_no_competition(tmp_path: Path, names: tuple[str, ...]) -> None:
    lay_out(tmp_path, *names)

    with pytest.raises(NothingToScoreError):
        load_competition(tmp_path, "paper2020.published")


def test_a_path_that_is_not_there_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="no such file or folder"):
        load_competition(tmp_path / "gone", "paper2020.published")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (HEAD.replace("logs/", "../logs/"), "leads out of the competition's folder"),
        (HEAD.replace("logs/", "/logs/"), "leads out of the competition's folder"),
        (HEAD.replace("{team}", "team"), "must name {team} once"),
        (HEAD + "teams: [{id: a}, {id: a}]\n", "'a' is listed twice"),
        (HEAD + "teams: [{id: a, config: gone.yaml}]\n", "'gone.yaml' does not exist"),
        (HEAD + "teams: [{id: a/b}]\n", "does not match"),
        (HEAD + "teams: [{id: a, judges: [[five]]}]\n", "'five' is not of type 'number'"),
        (HEAD + "team: []\n", "unknown key 'team'"),
        (
            "id: test\nrules: paper2020.published\nruns: [{team: a, trial: t, run: 1, path: gone}]\n",
            "does not exist",
        ),
        (
            "id: test\nrules: paper2020\nteams: [{id: b}]\nruns: [{team: a, trial: t, run: 1, path: x}]\n",
            "team 'a' is not listed",
        ),
        (
            "id: test\nrules: ../mine.yaml\nruns: logs/{team}/{trial}\n",
            "leads out of the competition's folder",
        ),
    ],
)
def test_a_malformed_competition_is_refused_with_file_and_place(
    tmp_path: Path, text: str, cause: str
) -> None:
    with pytest.raises(DataFileError) as caught:
        load_competition(write(tmp_path, text))
    assert cause in caught.value.cause
    assert caught.value.place


def test_a_link_out_of_the_folder_is_no_run(tmp_path: Path) -> None:
    inside, outside = tmp_path / "competition", tmp_path / "elsewhere"
    lay_out(inside, "logs/alpha/kit_1")
    outside.mkdir()
    (inside / "logs/alpha/kit_2").symlink_to(outside)

    assert [run.number for run in load_competition(write(inside)).runs] == [1]


def test_an_empty_competition_file_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match="the file is empty"):
        load_competition(write(tmp_path, ""))
