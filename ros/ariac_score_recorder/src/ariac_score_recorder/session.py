"""One recording from beginning to end, whatever ROS carries it."""

from __future__ import unicode_literals

from ariac_score_recorder import minisign
from ariac_score_recorder.attest import Attestation, canonical
from ariac_score_recorder.watch import Watcher, value_of

__all__ = ["EVENTS", "HEARTBEAT", "MANIFEST", "SUBMISSIONS", "Session"]

SUBMISSIONS = "/ariac_score/submissions"
EVENTS = "/ariac_score/events"
HEARTBEAT = "/ariac_score/heartbeat"
MANIFEST = "/ariac_score/manifest"

PERIOD_S = 0.1
_STILL_S = 1.0
"""The clock stands still when it shows one time for so long, s of a clock that never jumps."""


class Session(object):
    """What a recorder does with each message and each tenth of a second.

    Args:
        plan: What to do.
        send: Called as `send(name, fields)` with `submission`, `event`, `heartbeat` or `manifest`.
        now: Gives the `Instant` of now.
        key: The organiser's key; without one the manifest is not signed.
        simulated: Whether ROS time is that of a simulation, which may stand still.
        recording: The id of the recording; by default a new one.
    """

    def __init__(self, plan, send, now, key=None, simulated=True, recording=None):
        self._plan, self._send, self._now, self._key = plan, send, now, key
        self._simulated = simulated
        self._watchers = {}
        for watch in plan.watches:
            self._watchers.setdefault(watch.topic, []).append(Watcher(watch))
        self._decoded = set(plan.watched_topics())
        own = {SUBMISSIONS, EVENTS}
        self.topics = sorted(set(plan.all_topics()) | own)
        self._books = Attestation(
            self.topics, now(), plan.trial, plan.team, plan.left_out, PERIOD_S, recording
        )
        self._clock_since = None
        self._has_begun = False
        self._ended = None
        self._failed = set()
        self.is_closed = False

    @property
    def recording(self):
        """Its id."""
        return self._books.recording

    def begin(self):
        """Publish that the recording has begun, and which events would be seen."""
        self._send_manifest(self._books.opening(), False)
        for kind in self._plan.watching:
            self._send("event", {"kind": "watching", "subject": kind, "detail": ""})

    def arrived(self, topic, type_name, payload, decode, sender="", number=None, definition=""):
        """Take in one message.

        Args:
            topic, type_name, payload, sender, number, definition: As for `Attestation.arrived`.
            decode: Gives the message; called only where its fields are looked at.
        """
        self._books.arrived(topic, type_name, payload, self._now(), sender, number, definition)
        if topic not in self._decoded:
            return
        try:
            message = decode()
        except Exception as cause:  # the bytes may be of another version of the message
            if topic not in self._failed:
                self._failed.add(topic)
                self._books.note("{}: messages are not understood: {}".format(topic, _ascii(cause)))
            return
        for watcher in self._watchers.get(topic, ()):
            told = watcher.saw(message)
            if told:
                self._send(*told)
        self._state(topic, message)

    def _state(self, topic, message):
        starts, ends = self._plan.starts, self._plan.ends
        if starts and topic == starts["topic"] and not self._has_begun:
            value = value_of(message, starts["field"])
            self._has_begun = True
            if value not in starts["values"]:
                self._books.note(
                    "began late: the first word of {} was already {}".format(topic, _ascii(value))
                )
        if ends and topic == ends["topic"] and self._ended is None:
            value = value_of(message, ends["field"])
            if value in ends["values"]:
                self._ended = self._now().steady_s, "{}: {}".format(topic, _ascii(value))

    def submitted(self, fields):
        """A submission that a forwarder saw."""
        self._send("submission", fields)

    def other_heartbeat(self, recording):
        """A heartbeat was published; another recorder's is noted."""
        if recording != self.recording:
            self._books.note("another recorder publishes here: {}".format(_ascii(recording)))

    def note(self, words):
        """Say something in the manifest."""
        self._books.note(_ascii(words))

    def beat(self):
        """Send a heartbeat; returns why the recording ends now, or an empty text."""
        now = self._now()
        self._watch_clock(now)
        self._send_heartbeat(self._books.heartbeat(now))
        if self._ended and now.steady_s - self._ended[0] >= self._plan.linger_s:
            return self._ended[1]
        return ""

    def _watch_clock(self, now):
        if not self._simulated:
            return
        if self._clock_since is None or self._clock_since[0] != now.ros_ns:
            self._clock_since = now.ros_ns, now.steady_s
        elif now.steady_s - self._clock_since[1] >= _STILL_S:
            at = "before its first message" if now.ros_ns is None else "at {:.3f} s".format(now.ros_ns / 1e9)
            self._books.note("/clock stood still {} for {} s or longer".format(at, _STILL_S))

    def close(self, reason):
        """Send the last heartbeat and the manifest; returns its body and signature."""
        last, body = self._books.closing(self._now(), reason)
        self._send_heartbeat(last)
        self.is_closed = True
        signature = ""
        if self._key:
            signature = minisign.signature_text(
                self._key, body.encode("ascii"), "ariac-score manifest of recording " + self.recording
            )
        self._send_manifest(body, True, signature)
        return body, signature

    def _send_heartbeat(self, beat):
        sequence, body, chain = beat
        fields = {"recording": self.recording, "sequence": sequence, "body": body, "chain": chain}
        self._send("heartbeat", fields)

    def _send_manifest(self, body, closed, signature=""):
        fields = {"recording": self.recording, "closed": closed, "body": body, "signature": signature}
        self._send("manifest", fields)


def _ascii(value):
    """A text that JSON and comments can hold, at most 200 characters."""
    return canonical("{}".format(value))[1:-1][:200]
