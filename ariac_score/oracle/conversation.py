"""One monitor's conversation with the oracle: every frame gets one reply, in order.

Replies are what the strictest nodes accept: the event exactly as it came, `verdict` in lower
case, `spec` exactly when the verdict is negative, and nothing else. A frame that is no event
gets a reply, too: a client that waits in vain would match every later reply with the wrong event.

Source: ROSMonitoring 3.0.0 and its older branches, as their nodes read replies.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

from ariac_score.errors import PluginError
from ariac_score.logs.rosmonitoring import channel_of, parse_object
from ariac_score.oracle.judges import UNKNOWN, Judge, Opinion

__all__ = ["Conversation"]

_NO_MESSAGE = "violated"
"""The reason of a negative verdict without a message: older nodes read `spec` without a check."""


class Conversation:
    """Answers the frames of one connection, and keeps its events as a log.

    Args:
        judge: The state of the trace.
        log: File for the events.

    Attributes:
        verdicts: How often each verdict was given.
        bad_frames: Frames that were no JSON object.
        unjudged: Events that could not be judged.
        first_fault: What was wrong with the first of either; empty when there was none.
        ended: How it ended.
    """

    def __init__(self, judge: Judge, log: Path) -> None:
        self.log = log
        self.verdicts: Counter[str] = Counter()
        self.bad_frames = self.unjudged = self.events = 0
        self.first_fault = ""
        self.ended = ""
        self._judge = judge
        self._out = log.open("wb", buffering=0)  # each event is in the file before it is answered

    def answer(self, frame: str | bytes) -> str:
        """The reply to a frame."""
        try:
            text = frame.decode("utf-8") if isinstance(frame, bytes) else frame
            event = parse_object(text)
        except ValueError as fault:
            self.bad_frames += 1
            return self._answered(Opinion(UNKNOWN), '{"verdict": "unknown"}', f"no event: {fault}")
        self._keep(frame)
        fault_text = ""
        try:
            if not channel_of(event):
                raise ValueError("the event names no topic or service")
            opinion = self._judge.take(event)
        except (ValueError, PluginError) as fault:
            self.unjudged += 1
            opinion, fault_text = Opinion(UNKNOWN), str(fault)
        return self._answered(opinion, _reply(text, event, opinion), fault_text)

    def close(self, ended: str) -> None:
        """End the conversation; the log is complete from now on."""
        self.ended = self.ended or ended
        self._out.close()

    def _answered(self, opinion: Opinion, reply: str, fault: str) -> str:
        self.verdicts[opinion.verdict] += 1
        self.first_fault = self.first_fault or fault
        return reply

    def _keep(self, frame: str | bytes) -> None:
        line = frame if isinstance(frame, bytes) else frame.encode("utf-8")
        # Every event is one line: in JSON, a line end is white space or, within a string, an escape.
        self._out.write(line.replace(b"\n", b" ").replace(b"\r", b" ") + b"\n")
        self.events += 1


def _reply(text: str, event: dict[str, Any], opinion: Opinion) -> str:
    """The event as it came, to the character, with the verdict in place of any earlier one."""
    if "verdict" in event or "spec" in event:
        event = {name: value for name, value in event.items() if name not in ("verdict", "spec")}
        text = json.dumps(event)
    members = f'"verdict": "{opinion.verdict}"'
    if opinion.spec or opinion.verdict in ("false", "currently_false"):
        members += f', "spec": {json.dumps(opinion.spec or _NO_MESSAGE)}'
    return f"{text.rstrip()[:-1].rstrip()}{', ' if event else ''}{members}}}"
