"""What the parameters of many monitors share: units, ranges and sources."""

from __future__ import annotations

from typing import Any

TIME: Any = {"unit": "s", "at_least": 0, "at_most": 60}
GAP: Any = {"unit": "s", "above": 0, "at_most": 60, "source": "catalogue, 1.4"}
SPEED: Any = {"unit": "m/s", "at_least": 0, "at_most": 20}
LENGTH: Any = {"unit": "m", "at_least": 0, "at_most": 100}
