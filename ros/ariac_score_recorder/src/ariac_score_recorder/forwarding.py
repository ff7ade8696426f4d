"""Calls of a service that pass through the recorder, as events and submissions."""

from __future__ import unicode_literals

from ariac_score_recorder.attest import canonical
from ariac_score_recorder.watch import filled

__all__ = ["ANSWERED", "CALLED", "FAILED", "Forwarder", "plain"]

CALLED, ANSWERED, FAILED = "service_called", "service_answered", "service_failed"


def plain(message):
    """A message as what JSON can hold: numbers, texts, lists, objects.

    ROS 1 lists the fields in `__slots__`, ROS 2 in `get_fields_and_field_types`.
    """
    if hasattr(message, "get_fields_and_field_types"):
        return {name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if hasattr(message, "_slot_types"):
        return {name: plain(getattr(message, name)) for name in message.__slots__}
    if isinstance(message, bool) or message is None:
        return message
    if isinstance(message, (int, float)):
        return message if abs(message) < float("inf") else "{}".format(message)
    if isinstance(message, (list, tuple)):
        return [plain(each) for each in message]
    return "{}".format(message)


class Forwarder(object):
    """What one forwarded service tells; the node around it calls and answers.

    Args:
        forward: As the plan says.
        send: Called with `submission` or `event`, and its fields.
    """

    def __init__(self, forward, send):
        self._forward, self._send = forward, send

    def called(self, request):
        """A request came; it is to be forwarded after this."""
        self._event(CALLED, canonical(plain(request)))

    def answered(self, request, answer):
        """The simulator answered; what it accepted is a submission."""
        self._event(ANSWERED, canonical(plain(answer)))
        accepted = self._forward.accepted
        if self._forward.submission and (not accepted or getattr(answer, accepted, False) is True):
            self._send("submission", filled(self._forward.submission, plain(request)))

    def failed(self, words):
        """The simulator did not answer; the caller is told the same."""
        self._event(FAILED, "{}".format(words)[:500])

    def _event(self, kind, detail):
        self._send("event", {"kind": kind, "subject": self._forward.service, "detail": detail})
