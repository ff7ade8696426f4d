"""Submissions and events that messages tell of, as a plan says."""

from __future__ import unicode_literals

import re

__all__ = ["Watcher", "filled", "value_of"]

_NAME = re.compile(r"\{(\w+)\}")
_MISSING = object()


def value_of(message, field):
    """The value of a field such as `header.stamp`; `None` where the message has none."""
    for name in field.split("."):
        message = getattr(message, name, None)
    return message


def filled(fields, values):
    """Texts with `{name}` replaced by the value of that name; other values as they are."""

    def text(found):
        return "{}".format(values.get(found.group(1), ""))

    return {k: _NAME.sub(text, v) if hasattr(v, "split") else v for k, v in fields.items()}


class Watcher(object):
    """One watch of a plan, with what it remembers."""

    def __init__(self, watch):
        self._watch = watch
        self._waiting = None
        self._last = _MISSING

    def saw(self, message):
        """What a message of the topic tells: `submission` or `event` with its fields, or `None`."""
        watch = self._watch
        for field, wanted in watch.where.items():
            if value_of(message, field) != wanted:
                return None
        value = value_of(message, watch.field)
        if watch.becomes is not None:
            # The first value that is seen may have been there for long.
            changed = self._last is not _MISSING and value != self._last
            self._last = value
            return self._told({}) if changed and value == watch.becomes else None
        text = "{}".format(value)
        found = watch.text.search(text)
        if watch.then_text is None:
            return self._told(found.groupdict()) if found else None
        if found:
            self._waiting = found.groupdict()
        elif self._waiting is not None and watch.then_text.search(text):
            values, self._waiting = self._waiting, None
            return self._told(values)
        return None

    def _told(self, values):
        watch = self._watch
        if watch.submission is not None:
            return "submission", filled(watch.submission, values)
        return "event", filled(watch.event, values)
