"""One monitor's conversation with the oracle: every frame gets one reply, in order.

Replies are what the strictest nodes accept: the event exactly as it came, `verdict` in lower
case, `spec` exactly when the verdict is negative, and nothing else. A frame that is no event
gets a reply, too: a client that waits in vain would match every later reply with the wrong event.

Source: ROSMonitoring 3.0.0 and its older branches, as their nodes read replies.
"""

from __future__ import annotations

import json
import threading
from collections import Counter
from pathlib import Path
from typing import Any

from ariac_score.errors import PluginError
from ariac_score.logs.rosmonitoring import UNSEEN, channel_of, clock_of, parse_object, stamp_s
from ariac_score.oracle.event_log import EventLog
from ariac_score.oracle.judges import UNKNOWN, Judge, Opinion

__all__ = ["Conversation"]

_NO_MESSAGE = "violated"
"""The reason of a negative verdict without a message: older nodes read `spec` without a check."""


class Conversation:
    """Answers the frames of one connection, and keeps its events as a log.

    One that has a name goes on when a connection of that name comes again, also with another oracle: its
    log is its state. What was not seen in between is unknown, and stands in the log (`UNSEEN`).

    Args:
        judge: The state of the trace, at its beginning.
        log: File for the events; what it holds already is judged again.
        largest_log_bytes: A larger file is set aside.
        log_parts: How many of those are kept.

    Attributes:
        verdicts: How often each verdict was given.
        bad_frames: Frames that were no JSON object.
        unjudged: Events that could not be judged.
        gaps: Events before which something was not seen for longer than its monitor accepts.
        interruptions: How often it was interrupted.
        first_fault: What was wrong with the first of either; empty when there was none.
        ended: How it ended.
        lock: For whoever answers, and whoever ends it from another thread.

    Raises:
        OSError: The log cannot be written.
    """

    def __init__(
        self, judge: Judge, log: Path, *, largest_log_bytes: int = 1_000_000_000, log_parts: int = 9
    ) -> None:
        self.log = log
        self.verdicts: Counter[str] = Counter()
        self.bad_frames = self.unjudged = self.events = self.gaps = self.interruptions = 0
        self.first_fault = ""
        self.ended = ""
        self.lock = threading.Lock()
        self._judge = judge
        self._latest_s: float | None = None
        self._limits = {"largest_bytes": largest_log_bytes, "most_parts": log_parts}
        self.kept = EventLog(log, **self._limits)
        self._interrupted = ""
        if self.kept.parts or log.stat().st_size:
            self._recall()

    def answer(self, frame: str | bytes) -> str:
        """The reply to a frame.

        Raises:
            OSError: The log cannot be written.
            ValueError: The conversation is closed.
        """
        try:
            text = frame.decode("utf-8") if isinstance(frame, bytes) else frame
            event = parse_object(text)
        except ValueError as fault:
            self.bad_frames += 1
            return self._answered(Opinion(UNKNOWN), '{"verdict": "unknown"}', f"no event: {fault}")
        if self._interrupted:
            self._note_interruption(event)
        self._keep(frame)
        opinion, fault_text = self._opinion(event)
        return self._answered(opinion, _reply(text, event, opinion), fault_text)

    def interrupt(self, why: str) -> None:
        """Whatever comes next comes after something that was not seen."""
        self._interrupted, self.ended = why, ""

    def reopen(self) -> None:
        """Go on after `close`.

        Raises:
            OSError: The log cannot be written.
        """
        dropped = self.kept.dropped
        self.kept = EventLog(self.log, **self._limits)
        self.kept.dropped = dropped
        self.interrupt("the connection was lost")

    def close(self, ended: str) -> None:
        """End the conversation; the log is complete from now on."""
        self.ended = self.ended or ended
        self.kept.close()

    def _opinion(self, event: dict[str, Any]) -> tuple[Opinion, str]:
        """What is to be said of an event, and what was wrong with it."""
        fault_text = ""
        try:
            channel = channel_of(event)
            if not channel:
                raise ValueError("the event names no topic or service")
            if channel == UNSEEN:
                self.interruptions += 1
                self._judge.unseen()
                opinion = Opinion(UNKNOWN)
            else:
                opinion = self._judge.take(event)
        except (ValueError, PluginError) as fault:
            self.unjudged += 1
            opinion, fault_text = Opinion(UNKNOWN), str(fault)
        time_s = stamp_s(event)
        self._latest_s = self._latest_s if time_s is None else time_s
        self.gaps += opinion.gap
        return opinion, fault_text

    def _note_interruption(self, event: dict[str, Any]) -> None:
        """Write down what was not seen before an event, unless it is the event that says so."""
        why, self._interrupted = self._interrupted, ""
        if channel_of(event) == UNSEEN or not self.events:
            return
        mark: dict[str, Any] = {"topic": UNSEEN, "why": why}
        until_s, since_s = stamp_s(event), self._latest_s
        if until_s is not None and since_s is not None and clock_of(until_s) == clock_of(since_s):
            mark |= {"since": min(since_s, until_s), "time": until_s}
        self._keep(json.dumps(mark))
        self._opinion(mark)

    def _recall(self) -> None:
        """Judge what the log holds, as when it came."""
        for line in self.kept.lines():
            try:
                event = parse_object(line.decode("utf-8"))
            except ValueError:
                continue  # nothing of ours
            self.events += 1
            opinion, fault_text = self._opinion(event)
            if channel_of(event) != UNSEEN or "events" in event:
                self._answered(opinion, "", fault_text)
        self.interrupt("the oracle was started again")

    def _answered(self, opinion: Opinion, reply: str, fault: str) -> str:
        self.verdicts[opinion.verdict] += 1
        self.first_fault = self.first_fault or fault
        return reply

    def _keep(self, frame: str | bytes) -> None:
        line = frame if isinstance(frame, bytes) else frame.encode("utf-8")
        # Every event is one line: in JSON, a line end is white space or, within a string, an escape.
        self.kept.write(line.replace(b"\n", b" ").replace(b"\r", b" "))
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
