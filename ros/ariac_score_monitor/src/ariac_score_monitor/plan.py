"""What to watch, whom to ask, and what to do when nobody answers: a file of JSON."""

import io
import json
import re
from urllib.parse import urlsplit

__all__ = ["Plan", "PlanError", "Topic", "load_plan"]

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
_CHOICE = ("open", "closed")
_KNOWN = {
    "name": None,
    "topics": None,
    "oracle": "ws://127.0.0.1:8080",
    "token_file": "",
    "timeout_s": 2.0,
    "retry_s": 0.5,
    "without_oracle": None,
    "unknown": "open",
    "queue": 1000,
    "log_bytes": 100000000,
    "log_parts": 9,
}
_LIMITS = {
    "timeout_s": (0.01, 60.0),
    "retry_s": (0.01, 60.0),
    "queue": (1, 1000000),
    "log_bytes": (1, 1 << 40),
    "log_parts": (0, 9999),
}


class PlanError(ValueError):
    """A plan that cannot be followed; its text says where and why."""


class Topic(object):
    """A topic that is watched.

    Attributes:
        name: Of the topic.
        type: Of its messages, such as `std_msgs/String`.
        to: Where messages go that are let through; empty: it is only watched.
    """

    def __init__(self, given, where):
        _check(isinstance(given, dict), where, "a topic is an object")
        _known(given, ("name", "type", "to"), where)
        self.name, self.type, self.to = (given.get(key, "") for key in ("name", "type", "to"))
        _check(
            all(isinstance(one, str) for one in (self.name, self.type, self.to)), where, "texts are wanted"
        )
        _check(self.name.strip("/"), where, "'name' is missing")
        _check(self.type, where, "'type' is missing")
        _check(self.to != self.name, where, "'to' is the topic itself: every message would come back")


class Plan(object):
    """A plan as it is followed.

    Attributes:
        name: Of the monitor; the oracle keeps its state by it.
        topics: That are watched.
        host, port: Of the oracle.
        token: For it; empty: none.
        timeout_s: How long to wait for a reply, s.
        retry_s: How long between two tries to reach the oracle, s.
        without_oracle: Whether messages pass (`open`) or not (`closed`) while no oracle answers.
        unknown: The same for a verdict that is `unknown`.
        queue: How many messages may wait for their verdict.
        log_bytes, log_parts: Of each log: the size of a file, and how many full ones are kept.
    """

    def __init__(self, given, file="plan"):
        _check(isinstance(given, dict), file, "it is no object")
        _known(given, _KNOWN, file)
        values = dict(_KNOWN, **given)
        for key in ("name", "topics", "without_oracle"):
            _check(values[key] is not None, file, "{!r} is missing".format(key))
        for key in ("without_oracle", "unknown"):
            _check(
                values[key] in _CHOICE, file, "{!r} is {}, not 'open' or 'closed'".format(key, values[key])
            )
        for key, (least, most) in _LIMITS.items():
            number = values[key]
            _check(
                isinstance(number, (int, float)) and not isinstance(number, bool) and least <= number <= most,
                file,
                "{!r} is {}, not from {} to {}".format(key, number, least, most),
            )
            setattr(self, key, number)
        self.name, self.without_oracle, self.unknown = (
            values[key] for key in ("name", "without_oracle", "unknown")
        )
        _check(
            isinstance(self.name, str) and _NAME.fullmatch(self.name),
            file,
            "'name' has letters, digits, '_', '.' and '-'",
        )
        topics = values["topics"]
        _check(isinstance(topics, list) and topics, file, "'topics' lists no topic")
        self.topics = [Topic(one, "{}, topic {}".format(file, n)) for n, one in enumerate(topics, 1)]
        self.host, self.port = _address(values["oracle"], file)
        self.token = _token(values["token_file"], file)


def load_plan(file):
    """The plan in a file.

    Raises:
        PlanError: It cannot be read or followed.
    """
    try:
        with io.open(file, encoding="utf-8") as stream:
            given = json.load(stream)
    except (IOError, OSError) as cause:
        raise PlanError("{}: cannot be read: {}".format(file, cause.strerror))
    except ValueError as cause:
        raise PlanError("{}: it is no JSON: {}".format(file, cause))
    return Plan(given, file)


def _check(holds, where, words):
    if not holds:
        raise PlanError("{}: {}".format(where, words))


def _known(given, known, where):
    for key in given:
        _check(key in known, where, "{!r} is unknown; known: {}".format(key, ", ".join(sorted(known))))


def _address(url, file):
    try:
        parts = urlsplit(url)
        port = parts.port or 80
    except (ValueError, AttributeError):
        raise PlanError("{}: 'oracle' is no address such as ws://127.0.0.1:8080".format(file))
    _check(
        parts.scheme == "ws" and parts.hostname and parts.path in ("", "/") and not parts.query,
        file,
        "'oracle' is no address such as ws://127.0.0.1:8080; the name of the monitor is added to it",
    )
    return parts.hostname, port


def _token(token_file, file):
    if not token_file:
        return ""
    try:
        with io.open(token_file, encoding="ascii") as stream:
            token = stream.read(4096).strip()
    except (IOError, OSError, ValueError) as cause:
        raise PlanError("{}: the token in {} cannot be read: {}".format(file, token_file, cause))
    _check(re.fullmatch(r"[A-Za-z0-9._~-]+", token), file, "there is no token in {}".format(token_file))
    return token
