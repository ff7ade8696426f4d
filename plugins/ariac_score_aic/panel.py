"""The panel of a page: the plug against its port, as numbers and from the side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ariac_score import Finding, ReportPanel, Result
from ariac_score_aic.charts import HEIGHT
from ariac_score_aic.signals import PLUG, PORT

__all__ = ["INSERTION"]

_WIDTH, _TALL, _EDGE = 560.0, 260.0, 40.0
_ROWS = (
    ("placed", "plug_height_m", "height of the plug above the port at the end", "m"),
    ("placed", "entrance_height_m", "height of the entrance above the port", "m"),
    ("placed", "distance_m", "from plug to port at the end", "m"),
)


def _data(result: Result) -> dict[str, Any] | None:
    """Where the plug was; nothing of a trial without one."""
    findings = list(result.measured.findings.values())
    plugs = [one for one in findings if "plug_height_m" in one.quantities]
    side = _side(result)
    if not plugs and side is None:
        return None
    return {"plugs": [_plug(one, findings) for one in plugs], "side": side}


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


def _side(result: Result) -> dict[str, Any] | None:
    """The way of the plug: across, the horizontal distance to the port; upwards, the height above it."""
    sketch = result.measured.sketch
    heights = [one for one in sketch.curves if one.what == HEIGHT] if sketch else []
    routes = {one.body: one for one in sketch.routes} if sketch else {}
    if not heights or PLUG not in routes or PORT not in routes:
        return None
    plug, port, up = routes[PLUG], routes[PORT], heights[0]
    t_s = np.asarray(up.t_s)
    x_m, y_m = (np.interp(t_s, plug.t_s, one) for one in (plug.x_m, plug.y_m))
    away_m = np.hypot(x_m - port.x_m[-1], y_m - port.y_m[-1])
    up_m = np.asarray(up.actual)
    scale = min(
        (_WIDTH - 2 * _EDGE) / max(float(away_m.max()), 1e-3),
        (_TALL - 2 * _EDGE) / max(float(up_m.max() - min(up_m.min(), 0.0)), 1e-3),
    )
    base = _TALL - _EDGE + scale * min(float(up_m.min()), 0.0)
    points = " ".join(_points(_EDGE + scale * away_m, base - scale * up_m))
    return {
        "points": points,
        "port": [_EDGE, round(base, 1)],
        "width": _WIDTH,
        "height": _TALL,
        "away": f"{float(away_m[0]):.3f} m",
        "up": f"{float(up_m[0]):.3f} m",
        "end": f"{float(up_m[-1]):.4f} m",
        "tick": round(_EDGE + scale * 0.1, 1),
    }


def _points(across: np.ndarray, down: np.ndarray) -> Iterator[str]:
    last = ""
    for x, y in zip(across.tolist(), down.tolist(), strict=True):
        now = f"{x:.1f},{y:.1f}"
        if now != last:
            yield now
        last = now


_TEMPLATE = """\
{% for plug in data.plugs %}
<p><b><bdi>{{ plug.name }}</bdi></b> <bdi>{{ plug.words }}</bdi></p>
{% if plug.rows %}<table><tbody>
{% for row in plug.rows %}<tr><th scope="row">{{ row[0] }}</th><td>{{ row[1] }}</td></tr>{% endfor %}
</tbody></table>{% endif %}
{% endfor %}
{% if data.side %}{% set side = data.side %}{% set x = side.port[0] %}{% set y = side.port[1] %}
<figure>
<svg viewBox="0 0 {{ side.width }} {{ side.height }}" width="{{ side.width }}" role="img">
<g fill="none" stroke="currentColor">
<line x1="20" y1="{{ y }}" x2="540" y2="{{ y }}" opacity="0.3"/>
<polyline points="{{ side.points }}" stroke-width="1.5"/>
<rect x="{{ x - 5 }}" y="{{ y - 5 }}" width="10" height="10"/>
<line x1="{{ x }}" y1="{{ side.height - 6 }}" x2="{{ side.tick }}" y2="{{ side.height - 6 }}"/>
</g>
<text x="{{ x - 5 }}" y="{{ y + 20 }}" font-size="12">port</text>
<text x="{{ side.tick + 6 }}" y="{{ side.height - 2 }}" font-size="12">0.1 m</text>
</svg>
<figcaption>The plug from the side: across, how far it is from the port horizontally; upwards, how high above
it, within a centimetre. It began {{ side.away }} away and {{ side.up }} above, and ended {{ side.end }}
above.</figcaption>
</figure>
{% endif %}
"""

INSERTION = ReportPanel("Plug and port", _data, _TEMPLATE)
