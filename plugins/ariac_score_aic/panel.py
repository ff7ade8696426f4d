"""The panel of a page: the plug against its port, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ariac_score import Finding, ReportPanel, Result

__all__ = ["INSERTION"]

_ROWS = (
    ("placed", "plug_height_m", "height of the plug above the port at the end", "m"),
    ("placed", "entrance_height_m", "height of the entrance above the port", "m"),
    ("placed", "distance_m", "from plug to port at the end", "m"),
)


def _data(result: Result) -> dict[str, Any] | None:
    """Where the plug was; nothing of a trial without one."""
    findings = list(result.measured.findings.values())
    plugs = [one for one in findings if "plug_height_m" in one.quantities]
    return {"plugs": [_plug(one, findings) for one in plugs]} if plugs else None


def _plug(found: Finding, findings: Sequence[Finding]) -> dict[str, Any]:
    known = found.quantities
    rows = [[label, f"{known[name]:.4f} {unit}"] for flag, name, label, unit in _ROWS if known.get(flag)]
    if known.get("placed"):
        depth_m = known["entrance_height_m"] - known["plug_height_m"]
        rows.append(["how deep it is in the port", f"{max(depth_m, 0.0):.4f} m"])
    starts = [
        one for one in findings if one.subject == found.subject and "start_distance_m" in one.quantities
    ]
    rows += [["from plug to port at the start", f"{s.quantities['start_distance_m']:.4f} m"] for s in starts]
    return {"name": found.subject, "words": found.message, "rows": rows}


_TEMPLATE = """\
{% for plug in data.plugs %}
<p><b><bdi>{{ plug.name }}</bdi></b> <bdi>{{ plug.words }}</bdi></p>
{% if plug.rows %}<table><tbody>
{% for row in plug.rows %}<tr><th scope="row">{{ row[0] }}</th><td>{{ row[1] }}</td></tr>{% endfor %}
</tbody></table>{% endif %}
{% endfor %}
"""

INSERTION = ReportPanel("Plug and port", _data, _TEMPLATE)
