"""What the monitor does with a message; it knows no ROS and no network.

Every message becomes an event, is written down, and the oracle is asked. While nobody answers, messages pass
or do not, as the plan declares, and are counted; before the next question the oracle is told what it missed.
"""

import io
import json
import os
import threading
import time
from collections import deque

from ariac_score_monitor.websocket import LostError

__all__ = ["UNSEEN", "Log", "Monitor", "Queue", "event_of"]

UNSEEN = "/ariac_score/unseen"
"""Topic of an event that says what the oracle did not see, between its `since` and its `time`."""

_POSITIVE = ("true", "currently_true")
_NEGATIVE = ("false", "currently_false", "violation", "violated")


class Log(object):
    """Objects as lines of JSON. A full file is set aside, and the oldest of those deleted.

    Args:
        file: Its name, ending in `.jsonl`; what it holds already is kept.
        largest_bytes: Of a file.
        most_parts: That are kept besides it.
    """

    def __init__(self, file, largest_bytes, most_parts):
        self._file, self._largest, self._most = file, largest_bytes, most_parts
        self._lock = threading.Lock()
        folder, stem = os.path.split(file[: -len(".jsonl")])
        begins, found = stem + ".part", os.listdir(folder or ".")
        numbers = [name[len(begins) : -len(".jsonl")] for name in found if name.startswith(begins)]
        self._parts = sorted(int(number) for number in numbers if number.isdigit())
        self.dropped = 0
        self._open()

    def write(self, row):
        """Add an object; it is in the file before this returns."""
        line = json.dumps(row, sort_keys=True) + "\n"
        with self._lock:
            if self._out.closed:
                return
            size = self._out.tell()
            if size and size + len(line) > self._largest:
                self._set_aside()
            self._out.write(line.encode("ascii"))

    def close(self):
        """Write nothing more."""
        with self._lock:
            self._out.close()

    def _open(self):
        self._out = io.open(self._file, "ab", buffering=0)  # noqa: SIM115  # open for as long as the node
        self._out.seek(0, os.SEEK_END)

    def _part(self, number):
        return "{}.part{:04}.jsonl".format(self._file[: -len(".jsonl")], number)

    def _set_aside(self):
        self._out.close()
        self._parts.append(self._parts[-1] + 1 if self._parts else 1)
        os.rename(self._file, self._part(self._parts[-1]))
        while len(self._parts) > self._most:
            os.remove(self._part(self._parts.pop(0)))
            self.dropped += 1
        self._open()


class Monitor(object):
    """Asks about events, one after the other.

    Args:
        plan: What to do when nobody answers.
        link: Whom to ask.
        events: Log of all events.
        status: Log of what happened to the monitor.

    Attributes:
        verdict: The last one, in lower case.
        counts: How many events were answered, unseen, blocked.
    """

    def __init__(self, plan, link, events, status):
        self._plan, self._link, self._events, self._status = plan, link, events, status
        self._unseen, self._why = 0, ""
        self._since_s = None
        self.verdict = "unknown"
        self.counts = {"answered": 0, "unseen": 0, "blocked": 0}

    def take(self, event, is_filtered=False):
        """Whether a message may pass.

        Args:
            event: Of the message.
            is_filtered: Whether it waits for the verdict; one that is only watched always passes.
        """
        self._events.write(event)
        try:
            self._tell_unseen(event)
            verdict, spec = self._asked(event)
        except LostError as cause:
            self.miss(str(cause))
            self.verdict = "unknown"
            passes = self._plan.without_oracle == "open"
        else:
            self.counts["answered"] += 1
            self._since_s = event.get("time", self._since_s)
            if verdict != self.verdict:
                self._status.write(_row("verdict", verdict=verdict, spec=spec, event_time=event.get("time")))
            self.verdict = verdict
            passes = verdict in _POSITIVE or (verdict == "unknown" and self._plan.unknown == "open")
        if is_filtered and not passes:
            self.counts["blocked"] += 1
        return passes or not is_filtered

    def miss(self, why):
        """Count an event that the oracle does not see."""
        self.counts["unseen"] += 1
        self._unseen += 1
        self._why = self._why or why

    def close(self):
        """Write down how it went."""
        self._status.write(_row("stopped", unseen_at_the_end=self._unseen, **self.counts))

    def _tell_unseen(self, event):
        if not self._unseen or not self._link.is_there:
            return
        told = {"topic": UNSEEN, "events": self._unseen, "why": self._why}
        if self._since_s is not None and "time" in event:
            told["since"], told["time"] = min(self._since_s, event["time"]), event["time"]
        self._asked(told)
        self._status.write(_row("unseen", **{key: told[key] for key in told if key not in ("topic", "time")}))
        self._unseen, self._why = 0, ""

    def _asked(self, event):
        """Verdict and reason, as the oracle gives them."""
        answer = self._link.ask(json.dumps(event))
        try:
            found = json.loads(answer)
            verdict, spec = str(found["verdict"]).lower(), str(found.get("spec", ""))
        except (ValueError, TypeError, KeyError, AttributeError):
            verdict, spec = "", ""
        if verdict not in _POSITIVE + _NEGATIVE + ("unknown",):
            return "unknown", "no verdict in {!r}".format(answer[:80])
        return verdict, spec


def _row(status, **fields):
    return dict(fields, status=status, wall_time=time.time())


class Queue(object):
    """Messages that wait for their verdict, in order; a thread of its own asks.

    What comes while it is full is dropped by name: it is not asked about, passes or not as the plan declares
    for when nobody answers, and the oracle is told.

    Args:
        monitor: That asks.
        most: How many may wait.
        passes: Whether what is dropped passes.
        written: Log for what is dropped, too.
    """

    def __init__(self, monitor, most, passes, written):
        self._monitor, self._most, self._passes, self._written = monitor, most, passes, written
        self._waiting, self._changed, self._ending = deque(), threading.Condition(), False
        self._over = False
        self.dropped = 0
        self._thread = threading.Thread(target=self._ask, daemon=True)
        self._thread.start()

    def put(self, event, forward=None):
        """Take an event; `forward` is called when its message may pass. Whether there was room."""
        with self._changed:
            if self._ending:
                # Whoever ends watches nothing more, and lets nothing pass that nobody asked about.
                return False
            if len(self._waiting) < self._most:
                self._waiting.append((event, forward))
                self._changed.notify()
                return True
            self.dropped += 1
            # In its place among the others: what is asked before it is not after the gap.
            if self._waiting and self._waiting[-1][0] is None:
                self._waiting[-1][1].append(event)
            else:
                self._waiting.append((None, [event]))
        if forward is not None and self._passes:
            forward()
        return False

    def end(self, limit_s):
        """Ask about what waits, for so long, and end; the rest is written down, and was not seen."""
        with self._changed:
            self._ending = True
            self._changed.notify()
        self._thread.join(limit_s)
        with self._changed:
            self._over = True
            left = list(self._waiting)
            self._waiting.clear()
        for event, forward in left:
            self._miss(
                [event] if event is not None else forward, "the monitor ended before it was asked about"
            )

    def join(self, limit_s):
        """Wait for the question that is being asked, for so long."""
        self._thread.join(limit_s)

    def _miss(self, events, why):
        for event in events:
            self._written.write(event)
            self._monitor.miss(why)

    def _ask(self):
        while True:
            with self._changed:
                while not self._waiting and not self._ending:
                    self._changed.wait()
                if not self._waiting:
                    return
                event, forward = self._waiting.popleft()
            if event is None:
                self._miss(forward, "more messages came than could be asked about")
            elif self._monitor.take(event, forward is not None) and forward is not None and not self._over:
                forward()


def event_of(topic, fields, wall_s):
    """The event of a message: its fields, its topic, and its own time, or else the wall clock's.

    As ROSMonitoring has it, so that its logs and ours are read alike.
    """
    event = dict(fields)
    event["topic"] = topic
    stamp = fields.get("header", {}).get("stamp") if isinstance(fields.get("header"), dict) else None
    event["time"] = next((t for t in map(_seconds, (stamp, fields.get("stamp"))) if t is not None), wall_s)
    return event


def _seconds(stamp):
    if isinstance(stamp, dict):
        whole = stamp.get("secs", stamp.get("sec"))
        parts = stamp.get("nsecs", stamp.get("nanosec"))
        if isinstance(whole, int) and isinstance(parts, int):
            return whole + parts / 1e9
    return None
