"""What a team leaves out of its runs: no place in a ranking is better for it.

Found by an outsider; each case raised one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from ariac_score import load_rule_set
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec

LASTS_S = 10.0
LIMIT_M_S = 0.25


def run(folder: Path, *, fast_s: float, gap: tuple[float, float] = (0.0, 0.0)) -> None:
    """A robot that is fast for a while from the start on, at 20 Hz, but for a gap; and two deliveries."""
    times = [k / 20 for k in range(round(20 * LASTS_S) + 1)]
    rows: list[tuple[float, dict[str, object]]] = [
        (0.0, {"record": "event", "kind": "competition_started"}),
        *(
            (t_s, {"record": "sample", "values": {"speed/robot": 2 * LIMIT_M_S if t_s < fast_s else 0.0}})
            for t_s in times
            if not gap[0] < t_s < gap[1]
        ),
        *((t_s, {"record": "event", "kind": "delivered", "subject": "robot"}) for t_s in (6.0, 7.0)),
        (LASTS_S, {"record": "event", "kind": "competition_ended"}),
    ]
    head = {
        "record": "trial",
        "format": "ariac-score-trial-log/1",
        "id": folder.name,
        "witnessed": ["bodies", "delivered"],
    }
    lines = [head, {"record": "body", "id": "robot", "kind": "robot"}]
    lines += [{**row, "t_s": t_s} for t_s, row in sorted(rows, key=lambda one: one[0])]
    lines.append({"record": "end", "records": len(lines) + 1})
    folder.mkdir(parents=True)
    (folder / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")


def places(
    folder: Path, rules: str, gaps: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[int | None, float]]:
    """Rank and score of each team: `calm` is fast for 1 s, `rash` for 2 s."""
    for team, fast_s in (("calm", 1.0), ("rash", 2.0)):
        run(folder / "logs" / team / "t_1", fast_s=fast_s, gap=gaps.get(team, (0.0, 0.0)))
    (folder / "map.yaml").write_text("{id: nothing, title: none, source: none}\n", encoding="utf-8")
    (folder / "rules.yaml").write_text(
        "id: season\ntitle: season\nsource: the test\nlog_map: ./map.yaml\nmonitors:\n"
        f"  slow: {{use: iso_10218_1.reduced_speed, with: {{max_speed_m_s: {LIMIT_M_S}}}}}\n"
        "  deliveries: {use: ariac.no_event, with: {kind: delivered}}\n"
        "terms: {trial: {secs: seconds(slow), n: count(deliveries)}}\n" + rules,
        encoding="utf-8",
    )
    (folder / "competition.yaml").write_text(
        "id: season\nrules: ./rules.yaml\nruns: logs/{team}/{trial}_{run}\n", encoding="utf-8"
    )
    competition = load_competition(folder)
    rule_set = load_rule_set(competition.rules)
    spec = ranking_spec(rule_set, competition.ranking, file="competition.yaml")
    found = rank_results(competition, spec, rule_set, dict(score_runs(competition, rule_set)))
    return {one.team: (one.rank, float(one.execution)) for one in found.standings}


@pytest.mark.parametrize(
    "rules",
    [
        # Compared by what is in no score.
        "score: 5 * holds(deliveries)\nranking: {ties: [{lowest: secs}]}\n",
        # Beside values across teams that nothing opens.
        "cohort: {mean_n: {of: trial, mean: n, where: 'n >= 0', empty: 1}}\n"
        "task: 5\nscore: max(-10, cohort.mean_n - 4 * secs)\n",
    ],
    ids=["ties", "across teams"],
)
@pytest.mark.parametrize("gap", [(0.5, 0.8), (0.9, 2.1)])
def test_nobody_is_placed_better_for_a_gap(tmp_path: Path, rules: str, gap: tuple[float, float]) -> None:
    honest = places(tmp_path / "honest", rules, {})
    robbed = places(tmp_path / "robbed", rules, {"rash": gap})

    assert [honest[team][0] for team in ("calm", "rash")] == [1, 2]
    assert [robbed[team][0] for team in ("calm", "rash")] == [1, 2]
    assert robbed["rash"][1] <= honest["rash"][1]
