"""The lines that simulators print: messages of `/rosout`, kept where their own nodes sent them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ariac_score import Record, Trial

__all__ = ["CONSOLE", "Console", "Said", "lines_said", "said_by"]

CONSOLE = "console"
"""What a log witnesses that has the topic of the console."""

GAZEBO, TASK_MANAGER, SCORE_LOGGER = "gazebo", "task_manager", "score_logger"
"""Nodes of the simulators: of 2017 to 2022; of 2023 and 2024; of 2025."""

_TYPES = ("rosgraph_msgs/msg/Log", "rcl_interfaces/msg/Log")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(frozen=True)
class Said(Record):
    """One message of the console.

    Attributes:
        t_s: When, s of trial time.
        node: Which node printed it, without its namespace.
        text: What it says, without colours; may have several lines.
    """

    timed: ClassVar[bool] = True

    t_s: float
    node: str
    text: str

    def shifted(self, by_s: float) -> Said:
        """The same message on another clock."""
        return replace(self, t_s=self.t_s + by_s)


class Console:
    """Keeps what the simulators' own nodes print; what others print is no evidence.

    Source: `rosgraph_msgs/Log` (ROS 1, stamped in simulated time) and `rcl_interfaces/Log` (ROS 2, stamped
    in wall time, so that the time of recording counts).
    """

    heeds: ClassVar = frozenset({GAZEBO, TASK_MANAGER, SCORE_LOGGER})

    def decode(self, msgtype: str, message: Any, t_s: float) -> Said | None:
        """A line of the simulator; `None` for those of other nodes.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.
        """
        if msgtype not in _TYPES:
            return None
        # ROS 1 names nodes by their path, ROS 2 loggers by words with dots.
        node = re.split(r"[./]", message.name)[-1]
        if node not in self.heeds:
            return None
        return Said(t_s, node, _COLOUR.sub("", message.msg))


def said_by(parts: Iterable[Trial], node: str) -> list[Said]:
    """What a node printed, in order of time."""
    said = [r for part in parts for r in part.records if isinstance(r, Said) and r.node == node]
    # Stable: messages of one instant stay in recorded order.
    return sorted(said, key=lambda message: message.t_s)


def lines_said(said: Iterable[Said]) -> list[tuple[float, str]]:
    """The lines of some messages, each with the time of its message."""
    return [(message.t_s, line) for message in said for line in message.text.splitlines()]
