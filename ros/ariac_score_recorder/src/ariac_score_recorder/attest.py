"""What arrived, as heartbeats with a chain of hashes, and as the manifest of a whole recording."""

from __future__ import unicode_literals

import base64
import binascii
import collections
import hashlib
import json
import os
import threading

__all__ = ["FORMAT", "Attestation", "Instant", "canonical", "digest", "new_id"]

FORMAT = "ariac-score-manifest/1"
_DIGEST_BYTES = 12
"""96 bits: nobody finds a second message of the same digest, and a thousand of them take 16 kB."""

Instant = collections.namedtuple("Instant", "ros_ns wall_ns steady_s")
"""One moment on three clocks: ROS time (`None` before the first `/clock`), wall time, a steady clock."""


def new_id():
    """The id of a recording: 32 hexadecimal digits, drawn anew."""
    return binascii.hexlify(os.urandom(16)).decode("ascii")


def canonical(value):
    """JSON in ASCII, keys sorted, no spaces."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def digest(payload):
    """16 characters that stand for the bytes of a message.

    >>> print(digest(b""))
    47DEQpj8HBSa+/TI
    """
    return base64.b64encode(hashlib.sha256(payload).digest()[:_DIGEST_BYTES]).decode("ascii")


def _sha256(text):
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _times(instant):
    return {"ros_ns": instant.ros_ns, "wall_ns": instant.wall_ns}


class _Publisher(object):
    """How many messages came from one publisher, and which of its numbers did not."""

    def __init__(self):
        self.count = self.lost = 0
        self.first = self.last = None

    def sent(self, number):
        self.count += 1
        if number is None:
            return
        if self.first is None:
            self.first = number
        elif number > self.last + 1:
            self.lost += number - self.last - 1
        # A number that is not greater: the publisher was started anew, or does not count.
        self.last = number

    def counts(self):
        return {"count": self.count, "lost": self.lost, "first_seq": self.first, "last_seq": self.last}


class _Topic(object):
    def __init__(self):
        self.type = ""
        self.definitions = set()
        self.count = 0
        self.waiting = []
        self.publishers = {}
        self.first = self.last = None
        self.hash = hashlib.sha256()

    def counts(self):
        return {
            "type": self.type,
            "definitions": sorted(self.definitions),
            "count": self.count,
            "digest": self.hash.hexdigest(),
            "first": _times(self.first) if self.first else None,
            "last": _times(self.last) if self.last else None,
            "publishers": {name: each.counts() for name, each in self.publishers.items()},
        }


class Attestation(object):
    """The books of one recording. Messages may arrive on any thread.

    Args:
        topics: Names of all topics that are listened to.
        now: The `Instant` at which listening begins.
        trial, team: As the organiser names them.
        left_out: Reason by topic that is deliberately not listened to.
        period_s: Between heartbeats, s.
        recording: Its id; by default a new one.
    """

    def __init__(self, topics, now, trial="", team="", left_out=None, period_s=0.1, recording=None):
        self.recording = recording or new_id()
        self._topics = {topic: _Topic() for topic in topics}
        self._start = self._beat = now
        self._names = {"trial": trial, "team": team}
        self._left_out = dict(left_out or {})
        self._period_s = period_s
        self._sequence, self._chain, self._pause_s = 0, self.recording, 0.0
        self._notes = []
        self._lock = threading.Lock()
        self._is_closed = False

    def arrived(self, topic, type_name, payload, now, sender="", number=None, definition=""):
        """Take in one message.

        Args:
            topic: One of the topics that are listened to.
            type_name: As ROS names it.
            payload: Its bytes.
            now: The `Instant` of its arrival.
            sender: Who published it, where that is known.
            number: The sender's own number of it, where it has one.
            definition: A hash of how the sender defines the message: in ROS 1 `sha256:` and that of its
                text, in ROS 2 the type hash `RIHS01_...`; empty where there is none.
        """
        words = digest(payload)
        with self._lock:
            if self._is_closed:
                return
            about = self._topics[topic]
            about.type = about.type or type_name
            if definition:
                about.definitions.add(definition)
            about.count += 1
            about.waiting.append(words)
            about.first = about.first or now
            about.last = now
            about.publishers.setdefault(sender, _Publisher()).sent(number)

    def note(self, words):
        """Say something in the manifest; once, however often it is noticed."""
        with self._lock:
            if words not in self._notes:
                self._notes.append(words)

    def heartbeat(self, now):
        """What arrived since the last one: its number, its body and the chain up to it."""
        with self._lock:
            self._sequence += 1
            arrived = {}
            for name, about in self._topics.items():
                if about.waiting:
                    words = "".join(about.waiting)
                    about.hash.update(words.encode("ascii"))
                    arrived[name] = {"first": about.count - len(about.waiting) + 1, "digests": words}
                    about.waiting = []
            body = canonical(
                dict(_times(now), recording=self.recording, sequence=self._sequence, topics=arrived)
            )
            self._chain = _sha256(self._chain + body)
            self._pause_s = max(self._pause_s, now.steady_s - self._beat.steady_s)
            self._beat = now
            return self._sequence, body, self._chain

    def opening(self):
        """The body of the manifest that says that a recording has begun."""
        return canonical(dict(self._head(False), topics=sorted(self._topics)))

    def closing(self, now, reason):
        """The last heartbeat, and the body of the manifest; nothing is taken in any more."""
        with self._lock:
            self._is_closed = True
        last = self.heartbeat(now)
        body = dict(
            self._head(True),
            end=_times(now),
            reason=reason,
            heartbeats={
                "count": self._sequence,
                "period_s": self._period_s,
                "chain": self._chain,
                "longest_pause_s": round(self._pause_s, 3),
            },
            topics={name: about.counts() for name, about in self._topics.items()},
        )
        return last, canonical(body)

    def _head(self, is_closed):
        return dict(
            self._names,
            format=FORMAT,
            recording=self.recording,
            closed=is_closed,
            start=_times(self._start),
            left_out=self._left_out,
            notes=list(self._notes),
        )
