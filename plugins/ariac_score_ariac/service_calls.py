"""Submissions that clients of a service tell of: events of ROS 2 services, 2024 and later.

Only clients that switch introspection on publish them; no simulator does. So they show submissions that
were made, and never that there were none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ariac_score import LogDefect, Record, Trial
from ariac_score_ariac.work import KitSubmission

__all__ = [
    "KitCalls",
    "ModuleCalls",
    "ServiceCall",
    "ServiceCalls",
    "calls_without_content",
    "submissions_called",
]

_REQUESTS, _RESPONSES = (0, 1), (2, 3)
"""Sent and received, received first by the other side."""
_NAMES = ("order_id", "shipment_type", "id")
"""The field of a request that says what is handed in."""


@dataclass(frozen=True)
class ServiceCall(Record):
    """One message about a call.

    Attributes:
        t_s: When, s of trial time.
        call: Which call of which client.
        kind: 0 and 1: the request was sent, received; 2 and 3: the answer was.
        item_id: What was handed in, where the message has a request.
        accepted: What the answer says, where the message has one.
        told: Whether it has request or answer at all.
    """

    timed: ClassVar[bool] = True

    t_s: float
    call: tuple[bytes, int]
    kind: int
    item_id: str = ""
    accepted: bool = False
    told: bool = True

    def shifted(self, by_s: float) -> ServiceCall:
        """The same message on another clock."""
        return replace(self, t_s=self.t_s + by_s)


class ServiceCalls:
    """Decodes `SERVICE/_service_event` of services that take submissions."""

    what: ClassVar[str] = ""
    """What is handed in, where the request of the service is empty."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> ServiceCall | None:
        """What the message says of a call; `None` for anything else.

        Args:
            msgtype: `package/srv/Name_Event`.
            message: The message.
            t_s: Its stamp, s of trial time.
        """
        if not msgtype.endswith("_Event"):
            return None
        info, requests, responses = message.info, message.request, message.response
        named = next((n for n in _NAMES if len(requests) and hasattr(requests[0], n)), "")
        item_id = str(getattr(requests[0], named)) if named else self.what if len(requests) else ""
        return ServiceCall(
            t_s,
            (bytes(bytearray(info.client_gid)), int(info.sequence_number)),
            int(info.event_type),
            item_id=item_id,
            accepted=bool(len(responses) and getattr(responses[0], "success", False)),
            told=bool(len(requests) or len(responses)),
        )


class KitCalls(ServiceCalls):
    """Decodes the events of `/submit_kitting_order` of 2025, whose request is empty."""

    what = "kit"


class ModuleCalls(ServiceCalls):
    """Decodes the events of `/submit_module_order` of 2025, whose request is empty."""

    what = "module"


def submissions_called(parts: Sequence[Trial]) -> tuple[KitSubmission, ...]:
    """What was handed in by calls whose request and answer are both there, at the time of the request."""
    calls: dict[tuple[bytes, int], list[ServiceCall]] = {}
    for call in _calls(parts):
        calls.setdefault(call.call, []).append(call)
    found = []
    for messages in calls.values():
        asked = [m for m in messages if m.kind in _REQUESTS and m.item_id]
        if asked and any(m.kind in _RESPONSES and m.accepted for m in messages):
            first = min(asked, key=lambda m: m.t_s)
            found.append(KitSubmission(first.item_id, first.t_s))
    return tuple(sorted(found, key=lambda s: (s.submitted_s, s.item_id)))


def calls_without_content(parts: Sequence[Trial]) -> list[LogDefect]:
    """Calls of which neither request nor answer is told."""
    silent = {call.call for call in _calls(parts)} - {call.call for call in _calls(parts) if call.told}
    message = "calls of services come without request and answer: introspection is set to metadata"
    return [LogDefect("calls_without_content", "_service_event", len(silent), message)] if silent else []


def _calls(parts: Iterable[Trial]) -> list[ServiceCall]:
    return [record for part in parts for record in part.records if isinstance(record, ServiceCall)]
