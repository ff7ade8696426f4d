"""When AGVs left, by the states that the simulators of 2019 to 2022 publish of them at each step.

This is for recordings without the console, which prints the same with a name or a station. An AGV that
is sent off while it stands ready has been handed its kit in that step.

Source: `ROSAGVPlugin::OnUpdate` of 2019 to 2022; ARIAC notes on recording, sections 1.3 to 1.6.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar

from ariac_score import Record
from ariac_score_ariac.stock.deliveries import Delivery

__all__ = ["AGVS", "Agv1", "Agv2", "Agv3", "Agv4", "AgvState", "deliveries_shown"]

AGVS = ("agv1", "agv2", "agv3", "agv4")
"""The AGVs there are; a log with the topic of the state of one witnesses `agv1_state` and so on."""

_LONGEST_PAUSE_S = 1.0
"""Beyond it an AGV may have left unseen: its states last three quarters of a second and more."""
_LONGEST_STEP_S = 0.1
"""Beyond it the score may have been published in between, with the kit already counted."""
_LEAVES = re.compile(r"preparing_to_deliver|go_to_assembly_station|GOTO_AS\d")
_ON_ITS_WAY = re.compile(r"KS_(?P<one>AS\d)(?P<other>AS\d)|AGV\d_KS\d_(?P<station>AS\d)")
"""2021 names the stations of either pair of AGVs in one word."""
_BETWEEN_STATIONS = re.compile(r"AGV\d_AS\d_AS\d")
_FIRST_PAIR = ("agv1", "agv2")


@dataclass(frozen=True)
class AgvState(Record):
    """What an AGV did at one instant.

    Attributes:
        t_s: When it was received, s of trial time.
        agv: Which one.
        state: The word of its edition.
    """

    timed: ClassVar[bool] = True

    t_s: float
    agv: str
    state: str

    def shifted(self, by_s: float) -> AgvState:
        """The same message on another clock."""
        return replace(self, t_s=self.t_s + by_s)


class _Agv:
    """Decodes `/ariac/agvN/state`, a topic of a thousand messages a second, of which changes matter."""

    only_changes: ClassVar[bool] = True
    agv: ClassVar[str]

    def decode(self, msgtype: str, message: Any, t_s: float) -> AgvState | None:
        """The state; `None` for other types.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: When it was received, s of trial time.
        """
        return AgvState(t_s, self.agv, message.data) if msgtype == "std_msgs/msg/String" else None


class Agv1(_Agv):
    """The state of the first AGV, 2019 to 2022."""

    agv = "agv1"


class Agv2(_Agv):
    """The state of the second AGV, 2019 to 2022."""

    agv = "agv2"


class Agv3(_Agv):
    """The state of the third AGV, 2021 and 2022."""

    agv = "agv3"


class Agv4(_Agv):
    """The state of the fourth AGV, 2021 and 2022."""

    agv = "agv4"


def deliveries_shown(
    states: Iterable[AgvState], agvs: Sequence[str], start_s: float, end_s: float | None
) -> list[Delivery] | None:
    """The kits that left, in order of time; `None` where one may have left unseen.

    Args:
        states: The messages, without those that repeat others.
        agvs: Those there are.
        start_s, end_s: The messages must show all of this time, s of trial time; `None`: it has no known end.
    """
    left: list[Delivery] = []
    messages = sorted(states, key=lambda message: message.t_s)
    for agv in agvs:
        shown = [message for message in messages if message.agv == agv]
        found = _left(shown, end_s) if _covers(shown, start_s, end_s) else None
        if found is None:
            return None
        left += found
    return sorted(left, key=lambda delivery: delivery.t_s)


def _covers(shown: Sequence[AgvState], start_s: float, end_s: float | None) -> bool:
    if not shown or shown[0].t_s > start_s + _LONGEST_PAUSE_S:
        return False
    if end_s is not None and shown[-1].t_s < end_s - _LONGEST_PAUSE_S:
        return False
    return all(after.t_s - before.t_s <= _LONGEST_PAUSE_S for before, after in pairwise(shown))


def _left(shown: Sequence[AgvState], end_s: float | None) -> list[Delivery] | None:
    """The kits that left on one AGV; `None` where it is not seen when or where to."""
    left: list[Delivery] = []
    for i, (before, after) in enumerate(pairwise(shown)):
        if before.state == after.state or not _LEAVES.fullmatch(after.state):
            continue
        if end_s is not None and before.t_s > end_s:
            break
        at_once = left and before.t_s - left[-1].t_s < _LONGEST_PAUSE_S  # as where two nodes publish it
        if at_once or after.t_s - before.t_s > _LONGEST_STEP_S:
            return None
        station = ""
        if after.state != "preparing_to_deliver":
            on_its_way = next((s.state for s in shown[i + 2 :] if s.state != after.state), "")
            if _BETWEEN_STATIONS.fullmatch(on_its_way):
                continue  # the console says nothing of it either
            if not (way := _ON_ITS_WAY.fullmatch(on_its_way)):
                return None
            station = way["station"] or way["one" if after.agv in _FIRST_PAIR else "other"]
        # The scorer counted it in the step after this message, whose successor shows the AGV sent off.
        left.append(Delivery(before.t_s, after.agv, station=station.lower()))
    return left
