"""What a recorder is to do, as `ariac-score record -o NAME` writes it: `NAME.plan.json`."""

from __future__ import unicode_literals

import io
import json
import re

__all__ = ["FORMAT", "Forward", "Plan", "PlanError", "Watch", "load_plan"]

FORMAT = "ariac-score-recording-plan/1"

try:
    _TEXT = (str, unicode)
except NameError:
    _TEXT = (str,)


class PlanError(Exception):
    """A plan that cannot be followed; names the file and the place."""


class Watch(object):
    """What a message of a topic says: a submission or an event.

    Attributes:
        topic, field: Whose texts, or numbers, are looked at.
        where: Values that other fields must have.
        text: Searched in the field; its named groups fill what follows.
        then_text: The submission or event counts only, and then, when this is found in a later message.
        becomes: The value counts when it was another one before.
        publish: `submission` or `event`, and its fields, with `{group}` for what was found.
    """

    def __init__(self, data, place):
        self.topic = _get(data, "topic", _TEXT, place)
        self.field = _get(data, "field", _TEXT, place)
        self.where = _get(data, "where", (dict,), place, {})
        self.text = _pattern(data, "text", place)
        self.then_text = _pattern(data, "then_text", place)
        self.becomes = data.get("becomes")
        if (self.text is None) == (self.becomes is None):
            raise PlanError("{}: give one of 'text' and 'becomes'".format(place))
        self.submission = _get(data, "submission", (dict,), place, None)
        self.event = _get(data, "event", (dict,), place, None)
        if (self.submission is None) == (self.event is None):
            raise PlanError("{}: give one of 'submission' and 'event'".format(place))


class Forward(object):
    """A service that is offered under another name, so that each call of it is seen.

    Attributes:
        offered: The name that the team's nodes call.
        service: The simulator's own.
        submission: Fields of the submission, with `{field}` for one of the request.
        accepted: Field of the answer that must be true, or empty.
    """

    def __init__(self, data, place):
        self.offered = _get(data, "offered", _TEXT, place)
        self.service = _get(data, "service", _TEXT, place)
        self.submission = _get(data, "submission", (dict,), place, {})
        self.accepted = _get(data, "accepted", _TEXT, place, "")
        if self.offered == self.service:
            raise PlanError("{}: 'offered' is the service itself; it would call itself".format(place))


class Plan(object):
    """The plan of one recording.

    Attributes:
        topics: All that are listened to.
        left_out: Reason by topic that must not be listened to.
        watches, forwards: Where submissions and events come from.
        watching: Kinds of events that this recorder would see.
        starts, ends: Topic, field and values of the state in which a trial has not begun, and has ended.
        linger_s: How long it listens on after the end, s.
    """

    def __init__(self, data, name="plan"):
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise PlanError(
                "{}: not a plan of this recorder; write one: ariac-score record --rules NAME -o NAME".format(
                    name
                )
            )
        self.topics = _get(data, "topics", (list,), name)
        self.left_out = _get(data, "left_out", (dict,), name, {})
        self.trial = _get(data, "trial", _TEXT, name, "")
        self.team = _get(data, "team", _TEXT, name, "")
        self.watching = _get(data, "watching", (list,), name, [])
        self.linger_s = _get(data, "linger_s", (int, float), name, 2.0)
        self.starts = _state(data, "starts", name)
        self.ends = _state(data, "ends", name)
        self.watches = [Watch(w, "{}: watch {}".format(name, i)) for i, w in _each(data, "watches", name)]
        self.forwards = [
            Forward(f, "{}: forward {}".format(name, i)) for i, f in _each(data, "forwards", name)
        ]
        for topic in list(self.topics) + [w.topic for w in self.watches]:
            if not isinstance(topic, _TEXT) or not topic.startswith("/"):
                raise PlanError("{}: not the full name of a topic: {!r}".format(name, topic))
            if topic in self.left_out:
                raise PlanError(
                    "{}: {} is left out and listened to at once: {}".format(name, topic, self.left_out[topic])
                )

    def watched_topics(self):
        """Topics whose messages are decoded."""
        states = [state["topic"] for state in (self.starts, self.ends) if state]
        return sorted({watch.topic for watch in self.watches} | set(states))

    def all_topics(self):
        """Topics that are listened to, each once."""
        return sorted(set(self.topics) | set(self.watched_topics()))


def load_plan(path):
    """The plan in a file.

    Raises:
        PlanError: It cannot be read, or followed.
    """
    try:
        with io.open(path, encoding="utf-8") as file:
            data = json.load(file)
    except (IOError, OSError, ValueError) as cause:
        raise PlanError(
            "{}: cannot be read: {}; write it: ariac-score record --rules NAME -o NAME".format(path, cause)
        )
    return Plan(data, path)


_REQUIRED = object()


def _get(data, key, kinds, place, default=_REQUIRED):
    if not isinstance(data, dict):
        raise PlanError("{}: not an object".format(place))
    value = data.get(key, default)
    if value is _REQUIRED:
        raise PlanError("{}: {!r} is missing".format(place, str(key)))
    if value is not default and not isinstance(value, kinds):
        raise PlanError("{}: {!r} is not {}".format(place, str(key), " or ".join(k.__name__ for k in kinds)))
    return value


def _each(data, key, place):
    return list(enumerate(_get(data, key, (list,), place, []), 1))


def _pattern(data, key, place):
    text = _get(data, key, _TEXT, place, None)
    if text is None:
        return None
    try:
        return re.compile(text)
    except re.error as cause:
        raise PlanError("{}: {!r} is no pattern: {}".format(place, str(key), cause))


def _state(data, key, place):
    state = _get(data, key, (dict,), place, None)
    if state is None:
        return None
    place = "{}: {}".format(place, key)
    (
        _get(state, "topic", _TEXT, place),
        _get(state, "field", _TEXT, place),
        _get(state, "values", (list,), place),
    )
    return state
