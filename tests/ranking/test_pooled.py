"""Penalties that count what a team did in all of its runs, whichever run is kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import Signal, Trial, Verdict, load_rule_set, reprice, score_trial
from ariac_score.errors import DataFileError, FormulaError
from ariac_score.ranking.adjusting import adjusted_ranking
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.report.figures import amount_text
from ariac_score.report.openness import open_sentence
from ariac_score.report.ranking import ranking_text
from ariac_score.results.adjustments import Adjustments, adjust, interval_that_counts
from ariac_score.results.result_file import as_json, load_result, measured_sha256
from ariac_score.review.verify import verify_result
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.scoring.steward import Adjustment
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

RULES = (
    "id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\nscore: task\n"
    "include: [penalty.gated_hyperbolic]\n"
    "safety:\n  separation: {class: separation}\n  human_contact: {class: contact}\n"
)
NEAR_MISS = 0.4 * (0.175139841739 + 0.211047173309 / 5)
"""One breach of the class separation: its greatest relative depth, and the integral of that over 5 s."""
TASK = 28


def calm() -> Trial:
    """The made trial, with the human 5 m further away at every moment."""
    return moved(5.0)


def moved(by_m: float) -> Trial:
    """The made trial, with the human further away at every moment, or nearer, but no nearer than 0.3 m."""
    trial = kitting_trial()
    name = "centre_distance/robot/human"
    values = np.maximum(trial.signals[name].values + by_m, 0.3)
    return replace(trial, signals={**trial.signals, name: Signal(name, "m", trial.signals[name].t, values)})


def unseen(until_s: float = 20.5) -> Trial:
    """The made trial with nothing of a part of its near miss, which may have been nearer still."""
    trial = kitting_trial()
    signals = {}
    for name, signal in trial.signals.items():
        seen = (signal.t <= 20.0) | (signal.t >= until_s)
        signals[name] = replace(signal, t=signal.t[seen], values=signal.values[seen])
    return replace(trial, signals=signals)


def ranking(
    root: Path, *decisions: tuple[str, int, dict[str, Any]], rules: str = RULES, **runs: list[Trial | str]
) -> Ranking:
    """The ranking of some runs, with decisions of stewards: each about a team and a run, with its effect."""
    for team, trials in runs.items():
        for number, trial in enumerate(trials, start=1):
            path = root / team / f"kit_{number}.jsonl"
            path.parent.mkdir(exist_ok=True)
            if isinstance(trial, str):
                path.write_text(trial, encoding="utf-8")
            else:
                write_trial_log(path, trial, signals=SNAPSHOT_SIGNALS)
    (root / "mine.yaml").write_text(rules, encoding="utf-8")
    (root / "competition.yaml").write_text(
        "id: test\nrules: ./mine.yaml\nruns: '{team}/{trial}_{run}.jsonl'\n", encoding="utf-8"
    )
    competition = load_competition(root)
    loaded = load_rule_set(competition.rules)
    spec = ranking_spec(loaded, competition.ranking, file="competition.yaml")
    found = rank_results(competition, spec, loaded, score_runs(competition, loaded, sketches=True))
    if not decisions:
        return found
    of = {run.key: run.result for run in found.runs if run.result}
    decided = tuple(
        Adjustment(
            f"d{number}",
            "jury",
            "seen on film",
            "2026-05-12T14:30:00Z",
            team=team,
            trial="kit",
            run=run,
            measured=measured_sha256(of[team, "kit", run]),
            **effect,
        )
        for number, (team, run, effect) in enumerate(decisions)
    )
    return adjusted_ranking(competition, spec, loaded, found, Adjustments("d.yaml", "0" * 64, decided))


def satisfied(finding: str) -> dict[str, Any]:
    return {"finding": finding, "verdict": "satisfied"}


def violated(finding: str) -> dict[str, Any]:
    return {"finding": finding, "verdict": "violated"}


def after(found: Ranking) -> dict[int, tuple[str, Decimal | None, Ends | None]]:
    """How each run of the one team stands after the decisions."""
    assert found.stewarded is not None
    return {run.number: (run.outcome, run.score, run.open) for run in found.stewarded.ranking.runs}


def scores(found: Ranking) -> dict[str, float]:
    return {standing.team: float(standing.execution) for standing in found.standings}


@pytest.mark.slow
def test_a_calm_run_does_not_make_the_near_miss_of_another_one_undone(tmp_path: Path) -> None:
    found = ranking(tmp_path, once=[kitting_trial()], calm=[calm()], lucky=[kitting_trial(), calm()])

    assert scores(found) == {
        "calm": TASK,
        "once": pytest.approx(TASK / (1 + NEAR_MISS), abs=1e-6),
        "lucky": pytest.approx(TASK / (1 + NEAR_MISS), abs=1e-6),
    }
    assert [run.number for run in found.runs if run.team == "lucky" and run.kept] == [2]


def touched(from_s: float, to_s: float) -> Trial:
    """The made trial, with the human at the robot for a while."""
    trial = kitting_trial()
    name = "centre_distance/robot/human"
    t = trial.signals[name].t
    near = Signal(name, "m", t, np.where((t >= from_s) & (t < to_s), 0.3, trial.signals[name].values))
    return replace(trial, signals={**trial.signals, name: near})


@pytest.mark.slow
def test_those_that_a_gate_made_0_are_separated_by_their_demerits(tmp_path: Path) -> None:
    found = ranking(tmp_path, long=[touched(19, 29)], short=[touched(19, 19.2)], calm=[calm()])

    assert scores(found) == {"calm": TASK, "short": 0, "long": 0}
    assert [(one.rank, one.team) for one in found.standings] == [(1, "calm"), (2, "short"), (3, "long")]


@pytest.mark.parametrize("times", [1, 2, 3])
def test_the_same_run_again_changes_nothing(tmp_path: Path, times: int) -> None:
    found = ranking(tmp_path, again=[kitting_trial()] * times)

    assert scores(found) == {"again": pytest.approx(TASK / (1 + NEAR_MISS), abs=1e-6)}


def test_a_lost_log_costs_nobody_and_is_shown_and_nobody_is_taken_for_calm(tmp_path: Path) -> None:
    found = ranking(tmp_path, hidden=[calm(), "not a log\n"], open=[calm()])

    assert scores(found) == {"hidden": TASK, "open": TASK}
    (run,) = [run for run in found.runs if run.team == "hidden" and run.number == 1]
    assert (run.outcome, run.reason) == (
        "scored",
        "run 2 is unreadable, and the rules count what all runs did: scored by those that are known, and "
        "possibly from 0.000000 to 28.000000",
    )
    assert run.open == Ends(Decimal(0), Decimal(TASK))
    (hidden,) = [standing.open for standing in found.standings if standing.team == "hidden"]
    assert hidden is not None
    assert (hidden.execution, hidden.best_rank, hidden.worst_rank) == (Ends(Decimal(0), Decimal(TASK)), 1, 2)
    assert run.reason in ranking_text(found)


def test_the_result_of_a_run_beside_a_lost_log_says_so_and_adds_up(tmp_path: Path) -> None:
    found = ranking(tmp_path, team=[unseen(), "not a log\n"], alone=[unseen()])
    run, alone = (next(run for run in found.runs if run.team == team) for team in ("team", "alone"))
    assert run.result is not None
    (tmp_path / "result.json").write_text(as_json(run.result), encoding="utf-8")
    again = load_result(tmp_path / "result.json")

    assert run.score == alone.score
    assert again.interval is not None
    assert Ends(again.interval.least, again.interval.most) == run.open
    assert again.interval.narrowing[0].cause == "run 2 is unreadable, and the rules count what all runs did"
    assert alone.open is not None
    assert open_sentence(again) == (
        f"the score lies somewhere between 0 and {amount_text(alone.open.most)}; "
        "what is known counts, for a lost log costs nobody"
    )


@pytest.mark.slow
@pytest.mark.parametrize("beside", [[kitting_trial()], ["not a log\n"], [unseen()]], ids=["", "lost", "open"])
@pytest.mark.parametrize("counts", ["worst", "withhold"])
def test_the_result_of_a_run_beside_others_holds_against_its_log_and_its_competition(
    tmp_path: Path, beside: list[Trial | str], counts: str
) -> None:
    found = ranking(tmp_path, rules=f"{RULES}open: {counts}\n", team=[calm(), *beside])
    run = next(run for run in found.runs if run.number == 1)
    assert run.result is not None
    (tmp_path / "result.json").write_text(as_json(run.result), encoding="utf-8")
    log, rules = tmp_path / "team/kit_1.jsonl", str(tmp_path / "mine.yaml")

    alone = verify_result(tmp_path / "result.json", log=log, rules=rules)
    assert (alone.steps_that_are("failed"), "cohort" in alone.steps_that_are("open")) == ((), True)
    all_of_them = verify_result(tmp_path / "result.json", log=tmp_path)
    assert (all_of_them.steps_that_are("failed"), all_of_them.steps_that_are("open")) == ((), ())


def test_a_lost_log_beside_a_near_miss_does_not_undo_the_near_miss(tmp_path: Path) -> None:
    found = ranking(tmp_path, team=[calm(), kitting_trial(), "not a log\n"])

    assert scores(found) == {"team": pytest.approx(TASK / (1 + NEAR_MISS), abs=1e-6)}
    (calm_run,) = [run for run in found.runs if run.kept]
    assert calm_run.open is not None
    assert (calm_run.open.least, calm_run.open.most) == (0, calm_run.score)


def test_where_nothing_bounds_what_a_lost_log_makes_of_a_score_it_is_undecided(tmp_path: Path) -> None:
    rules = (
        "id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\n"
        "terms: {trial: {near: seconds(separation)}}\nscore: task - runs.near\n"
    )
    found = ranking(tmp_path, rules=rules, team=[calm(), "not a log\n"])

    (run,) = [run for run in found.runs if run.number == 1]
    assert (run.outcome, run.open, run.reason) == (
        "undecided",
        None,
        "run 2 is unreadable, and the rules count what all runs did; "
        "nothing bounds what that makes of the score",
    )


def test_the_result_of_a_ranked_run_can_be_read_and_adds_up(tmp_path: Path) -> None:
    found = ranking(tmp_path, lucky=[kitting_trial(), calm()])
    (kept,) = [run.result for run in found.runs if run.kept]
    assert kept is not None
    (tmp_path / "result.json").write_text(as_json(kept), encoding="utf-8")

    assert load_result(tmp_path / "result.json").score == kept.score
    assert kept.cohort.values["runs.safety_demerits"][""] == pytest.approx(NEAR_MISS)


def test_a_run_without_others_is_worth_what_it_is_alone(tmp_path: Path) -> None:
    (run,) = ranking(tmp_path, team=[unseen()]).runs
    alone = score_trial(tmp_path / "team/kit_1.jsonl", tmp_path / "mine.yaml")

    assert run.result is not None
    assert alone.interval is not None
    assert (run.result.score, run.result.possible, run.result.interval, run.result.cohort) == (
        alone.score,
        alone.possible,
        alone.interval,
        CohortValues(),
    )
    assert run.open == Ends(alone.interval.least, alone.interval.most)


@pytest.mark.slow
def test_a_run_beside_an_open_one_is_open_and_its_result_says_why(tmp_path: Path) -> None:
    """The calm run is worth what the other makes of its own points: both have all of the task."""
    found = ranking(tmp_path, beside=[unseen(), calm()], alone=[unseen()])
    (single,) = [run.open for run in found.runs if run.team == "alone"]
    kept = next(run for run in found.runs if run.team == "beside" and run.kept)

    assert single is not None
    assert kept.number == 2
    assert kept.open == single
    assert kept.score == single.least
    assert kept.result is not None
    assert kept.result.interval is not None
    assert Ends(kept.result.interval.least, kept.result.interval.most) == single
    (cause,) = kept.result.interval.narrowing
    assert (
        cause.cause == "another run of the team, which is open itself, and the rules count what all runs did"
    )
    (tmp_path / "result.json").write_text(as_json(kept.result), encoding="utf-8")
    again = load_result(tmp_path / "result.json")
    assert reprice(again, load_rule_set(tmp_path / "mine.yaml"), again.cohort).interval == again.interval
    assert "kit, run 2: another run of the team" in ranking_text(found)


def test_an_open_run_beside_one_that_certainly_did_more_leaves_nothing_open(tmp_path: Path) -> None:
    found = ranking(tmp_path, team=[unseen(20.1), calm(), moved(-2.0)], worst=[calm(), moved(-2.0)])

    calm_runs = {run.team: (run.score, run.open) for run in found.runs if run.kept}
    assert calm_runs["team"] == calm_runs["worst"]
    assert calm_runs["team"][1] is None


def test_what_a_run_behind_a_gate_leaves_open_is_open_in_the_others(tmp_path: Path) -> None:
    """Its contact makes it 0 in every world; how deep it was beside that counts in the other run."""
    worst, best = (
        ranking(tmp_path / counts, rules=f"{RULES}open: {counts}\n", team=[calm(), touched(19, 20)])
        for counts in ("worst", "best")
        if (tmp_path / counts).mkdir() is None
    )

    ((least, ends), (most, same)) = (
        next((run.score, run.open) for run in found.runs if run.number == 1) for found in (worst, best)
    )
    assert ends is not None
    assert ends == same == Ends(least or Decimal(0), most or Decimal(0))
    assert ends.least < ends.most


def test_a_verdict_about_one_run_counts_in_all_runs_of_the_team(tmp_path: Path) -> None:
    found = ranking(
        tmp_path,
        ("lucky", 1, satisfied("separation#1")),
        lucky=[kitting_trial(), calm()],
        twice=[kitting_trial(), kitting_trial(), calm()],
    )

    near = pytest.approx(TASK / (1 + NEAR_MISS), abs=1e-6)
    assert scores(found) == {"lucky": near, "twice": near}
    assert found.stewarded is not None
    assert scores(found.stewarded.ranking) == {"lucky": TASK, "twice": near}
    ties = {one.team: one.ties for one in found.stewarded.ranking.standings}
    assert ties["lucky"] == {"safety_demerits": 0}


def test_what_another_run_did_as_well_is_undone_with_both_verdicts_alone(tmp_path: Path) -> None:
    runs: list[Trial | str] = [kitting_trial(), kitting_trial(), calm()]
    decisions = [("team", 1, satisfied("separation#1")), ("team", 2, satisfied("separation#1"))]
    for name in ("one", "both"):
        (tmp_path / name).mkdir()
    one = ranking(tmp_path / "one", decisions[0], team=runs)
    both = ranking(tmp_path / "both", *decisions, team=runs)

    assert one.stewarded is not None
    assert both.stewarded is not None
    assert scores(one.stewarded.ranking) == {"team": pytest.approx(TASK / (1 + NEAR_MISS), abs=1e-6)}
    assert scores(both.stewarded.ranking) == {"team": TASK}


def test_a_verdict_about_a_run_without_others_is_worth_what_it_is_alone(tmp_path: Path) -> None:
    found = ranking(tmp_path, ("team", 1, satisfied("separation#1")), team=[kitting_trial()])

    assert found.stewarded is not None
    assert scores(found.stewarded.ranking) == {"team": TASK}


@pytest.mark.parametrize(
    ("effect", "moved"),
    [
        ({"points": Decimal(4)}, lambda least, most: Ends(least + 4, most + 4)),
        ({"dismissed": True, "complaint": "too slow"}, Ends),
        ({"score": Decimal(9)}, lambda *_: None),
    ],
    ids=["points move both ends", "a dismissed complaint moves nothing", "a score settles it"],
)
def test_what_stewards_do_to_an_open_score_they_do_to_its_ends(
    tmp_path: Path, effect: dict[str, Any], moved: Any
) -> None:
    found = ranking(tmp_path, ("team", 1, effect), team=[unseen()])
    (run,) = found.runs

    assert run.open is not None
    assert after(found)[1][2] == moved(run.open.least, run.open.most)


def test_a_verdict_about_a_run_decides_nothing_of_what_a_lost_log_beside_it_may_hold(tmp_path: Path) -> None:
    found = ranking(tmp_path, ("team", 1, satisfied("separation#1")), team=[kitting_trial(), "not a log\n"])

    assert after(found)[1] == ("scored", TASK, Ends(Decimal(0), Decimal(TASK)))
    assert found.stewarded is not None
    assert "possibly from 0.000000 to 28.000000" in ranking_text(found.stewarded.ranking)


def test_points_for_a_run_beside_a_lost_log_move_what_the_lost_log_leaves(tmp_path: Path) -> None:
    found = ranking(tmp_path, ("team", 1, {"points": Decimal(-3)}), team=[calm(), "not a log\n"])

    assert after(found)[1] == ("scored", TASK - 3, Ends(Decimal(-3), Decimal(TASK - 3)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("run", "effect"),
    [
        (1, violated("human_contact#1")),
        (1, satisfied("separation#1")),
        (2, violated("separation#2")),
    ],
    ids=["against a run beside it", "for a run beside it", "one of several gaps"],
)
def test_what_the_rules_withhold_stays_withheld_in_all_runs_until_all_of_it_is_decided(
    tmp_path: Path, run: int, effect: dict[str, Any]
) -> None:
    rules = f"{RULES}open: withhold\n"
    found = ranking(tmp_path, ("team", run, effect), rules=rules, team=[kitting_trial(), unseen()])

    assert [(outcome, score) for outcome, score, _ in after(found).values()] == [("undecided", None)] * 2
    assert found.stewarded is not None
    beside = next(run for run in found.stewarded.ranking.runs if run.number == 1)
    assert "run 2 is undecided, and the rules count what all runs did" in beside.cause


@pytest.mark.slow
@pytest.mark.parametrize("verdicts", [(violated, violated), (satisfied, violated), (satisfied, satisfied)])
def test_of_two_runs_that_are_withheld_each_says_what_the_other_leaves_of_its_score(
    tmp_path: Path, verdicts: tuple[Callable[[str], dict[str, Any]], ...]
) -> None:
    """However the stewards decide all that is open, what comes of it was said to be possible before."""
    rules, runs = f"{RULES}open: withhold\n", [unseen(20.1), unseen(21.0)]
    before = {run.number: run for run in ranking(tmp_path, rules=rules, team=runs).runs}
    decided = [
        ("team", number, verdict(name))
        for (number, run), verdict in zip(before.items(), verdicts, strict=True)
        for name, finding in (run.result.measured.findings if run.result else {}).items()
        if finding.verdict is Verdict.INCONCLUSIVE and finding.check in ("separation", "human_contact")
    ]
    found = ranking(tmp_path, *decided, rules=rules, team=runs)

    for number, (_, score, left) in after(found).items():
        ends, result = before[number].open, before[number].result
        assert before[number].outcome == "undecided"
        assert ends is not None
        assert result is not None
        assert result.interval is not None
        assert Ends(result.interval.least, result.interval.most) == ends
        for end in (left.least, left.most) if left else (score,) if score is not None else ():
            assert ends.least <= end <= ends.most
    assert (verdicts != (satisfied, satisfied)) or {one[0] for one in after(found).values()} == {"scored"}


@pytest.mark.parametrize("extended", ["paper2020", "paper2020.published"])
@pytest.mark.parametrize("until_s", [20.1, 20.5])
def test_a_gap_in_which_nothing_was_violated_is_worth_what_its_best_world_is(
    extended: str, until_s: float, tmp_path: Path
) -> None:
    """What was seen at the sample at which it begins, 0.956 m too near, stays seen."""
    rules = f"id: mine\ntitle: Mine\nsource: a test\nextends: {extended}\n"
    cleared = "team", 1, satisfied("separation#2")
    found = ranking(tmp_path, cleared, rules=rules, team=[unseen(until_s)])

    ends = found.runs[0].open
    assert ends is not None
    assert after(found) == {1: ("scored", ends.most, None)}


def test_points_are_refused_where_another_run_withholds_the_score(tmp_path: Path) -> None:
    with pytest.raises(DataFileError) as caught:
        ranking(
            tmp_path,
            ("team", 1, {"points": Decimal(-1)}),
            rules=f"{RULES}open: withhold\n",
            team=[calm(), unseen()],
        )
    assert caught.value.cause == (
        "adjustment 'd0': there is no score to add points to: run 2 is undecided, and the rules count "
        "what all runs did"
    )


@pytest.mark.slow
def test_what_the_rules_withhold_counts_in_all_runs_once_it_is_decided(tmp_path: Path) -> None:
    rules = f"{RULES}open: withhold\n"
    found = ranking(tmp_path, ("team", 2, satisfied("separation#2")), rules=rules, team=[calm(), unseen()])
    in_view = ranking(tmp_path, ("team", 2, satisfied("separation#2")), team=[calm(), unseen()])

    assert after(found) == after(in_view)
    assert {outcome for outcome, _, _ in after(found).values()} == {"scored"}


@pytest.mark.slow
@pytest.mark.parametrize("counts", ["worst", "best", "withhold"])
@pytest.mark.parametrize(
    "effect",
    [{"dismissed": True, "complaint": "ours"}, {"finding": "human_contact#1", "verdict": "violated"}],
    ids=["a complaint that is dismissed", "a verdict against the team"],
)
def test_where_teams_are_compared_an_open_run_counts_at_its_end_for_what_it_brings_is_known(
    tmp_path: Path, effect: dict[str, Any], counts: str
) -> None:
    compared = "task: task\ncohort: {mean_task: {of: trial, mean: task}}\n"
    rules = f"{RULES.replace('score: task', 'score: task + cohort.mean_task')}{compared}open: {counts}\n"
    found = ranking(tmp_path, ("open", 1, effect), rules=rules, open=[unseen()], seen=[kitting_trial()])
    assert found.stewarded is not None

    (run,) = (run for run in found.stewarded.ranking.runs if run.team == "open")
    before = {run.team: run for run in found.runs}
    outcome = "undecided" if counts == "withhold" else "scored"
    assert (run.outcome, before["open"].outcome, before["seen"].outcome) == (outcome, outcome, "scored")
    if counts == "withhold":
        assert run.score is before["open"].score is None
    else:
        ends = before["open"].open
        assert ends is not None
        assert run.score is not None
        assert before["open"].score == (ends.least if counts == "worst" else ends.most)
        assert run.score <= before["open"].score  # a verdict against a team, or none, makes nobody better


@pytest.mark.slow
@pytest.mark.parametrize("beside", [[kitting_trial()], ["not a log\n"]], ids=["seen", "lost"])
def test_what_a_result_of_a_ranked_run_is_adjusted_to_is_what_the_ranking_says(
    tmp_path: Path, beside: list[Trial | str]
) -> None:
    rules = f"{RULES}open: withhold\n"
    team: list[Trial | str] = [unseen(), *beside]
    found = ranking(tmp_path, ("team", 1, satisfied("separation#2")), rules=rules, team=team)
    automatic = next(run.result for run in found.runs if run.number == 1)
    assert automatic is not None
    assert found.stewarded is not None
    ranked = next(run for run in found.stewarded.ranking.runs if run.number == 1)

    decision = Adjustment(
        "d0",
        "jury",
        "film",
        "2026-05-12T14:30:00Z",
        trial="kit",
        measured=measured_sha256(automatic),
        **satisfied("separation#2"),
    )
    adjusted, _ = adjust(automatic, Adjustments("d.yaml", "0" * 64, (decision,)), measured=decision.measured)
    left = interval_that_counts(adjusted)
    assert adjusted.final == ranked.score
    assert (None if left is None else Ends(left.least, left.most)) == ranked.open


@pytest.mark.slow
def test_the_order_of_decisions_in_their_file_decides_nothing(tmp_path: Path) -> None:
    rules = f"{RULES}open: withhold\n"
    both = [
        ("team", 1, {"finding": "separation#2", "verdict": "not_applicable"}),
        ("team", 1, violated("human_contact#1")),
    ]
    found = []
    for name, decisions in (("one", both), ("other", both[::-1])):
        (tmp_path / name).mkdir()
        found.append(after(ranking(tmp_path / name, *decisions, rules=rules, team=[unseen()])))

    assert found[0] == found[1]


def test_a_score_that_stewards_give_stands_beside_what_is_withheld(tmp_path: Path) -> None:
    rules = f"{RULES}open: withhold\n"
    ruled = ("team", 1, {"score": Decimal(9)})
    found = ranking(tmp_path, ruled, rules=rules, team=[calm(), unseen()])

    (_, open_) = found.runs
    assert after(found) == {1: ("scored", 9, None), 2: ("undecided", None, open_.open)}
    assert open_.open is not None


def test_a_run_beside_one_that_is_open_behind_a_gate_is_withheld_with_its_reason(tmp_path: Path) -> None:
    """The other run is 0 in every world, so nothing withholds it; what it did beside its contact is open."""
    found = ranking(tmp_path, rules=f"{RULES}open: withhold\n", team=[calm(), touched(19, 20)])
    as_counted = ranking(tmp_path, team=[calm(), touched(19, 20)])
    ((run, gated), (shown, _)) = (found.runs, as_counted.runs)

    assert (gated.outcome, gated.score) == ("scored", 0)
    assert (run.outcome, run.score, run.open) == ("undecided", None, shown.open)
    assert run.cause == (
        "another run of the team, which is open itself, and the rules count what all runs did"
    )


@pytest.mark.parametrize(
    ("formula", "cause"),
    [("runs.demerit", "unknown name 'runs.demerit'"), ("runs.score", "unknown name 'runs.score'")],
)
def test_only_terms_of_the_trial_are_taken_over_runs(formula: str, cause: str) -> None:
    terms = {"trial": {"demerits": Expression.parse("1", where="$.terms.trial.demerits")}}
    with pytest.raises(FormulaError) as caught:
        ScoreSheet(terms, Expression.parse(formula, where="$.score"), frozenset())
    assert caught.value.cause == cause
