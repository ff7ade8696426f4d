"""Messages of `ariac_score_msgs`, which recorder nodes publish for this engine in any competition."""

from __future__ import annotations

from typing import Any

from ariac_score.trial.events import Event

__all__ = ["TrialEvents"]


class TrialEvents:
    """Decodes the events of `ariac_score_msgs`, which recorder nodes publish for this engine."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> Event | None:
        """An event; `None` for anything else.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.
        """
        if msgtype != "ariac_score_msgs/msg/TrialEvent":
            return None
        return Event(t_s, message.kind, message.subject, message.detail)
