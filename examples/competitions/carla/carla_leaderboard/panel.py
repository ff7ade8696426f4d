"""A panel of the page of an entry: the scores as the leaderboard wrote them, route by route."""

from __future__ import annotations

from typing import Any

from ariac_score import ReportPanel, Result

__all__ = ["AS_WRITTEN"]


def _scores(result: Result) -> list[dict[str, Any]] | None:
    """The three scores of each route; nothing where the results file is not there any more."""
    official = result.measured.official
    if official is None:
        return None
    routes: dict[str, dict[str, Any]] = {}
    for label, value in official.items.items():
        route, _, score = label.partition("/")
        if score:
            routes.setdefault(route, {"route": route})[score] = value
    return list(routes.values())


AS_WRITTEN = ReportPanel(
    "As the leaderboard wrote it",
    _scores,
    """\
<table><thead><tr><th scope="col">Route</th><th scope="col">Route completion</th>
<th scope="col">Infraction penalty</th><th scope="col">Driving score</th></tr></thead><tbody>
{% for row in data %}<tr><th scope="row"><bdi>{{ row.route }}</bdi></th><td>{{ row.score_route }}</td>
<td>{{ row.score_penalty }}</td><td>{{ row.score_composed }}</td></tr>
{% endfor %}</tbody></table>""",
)
