"""Messages about calls of services, as ROS 2 publishes them under `SERVICE/_service_event`.

A recording names their type `package/srv/Name_Event` and gives the definition of the service. Both ways of
writing it are read: the bare text, and one with a line `SRV: package/srv/Name` and a separator before it.

Source: rosidl, service introspection; rosbag2, `local_message_definition_source.cpp`.
"""

from __future__ import annotations

import re

__all__ = ["event_definition"]

_SEPARATOR = "=" * 80
_EVENT = re.compile(r"(?P<package>\w+)/srv/(?P<name>\w+)_Event", re.ASCII)
_BETWEEN = re.compile(r"^---[ \t]*$", re.MULTILINE)
_COMMENT = re.compile(r"#.*")
_NO_FIELDS = "uint8 structure_needs_at_least_one_member"
"""Of a request or an answer without fields one byte is sent."""
_INFO = {
    "service_msgs/ServiceEventInfo": (
        "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number"
    ),
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
}


def event_definition(name: str, definition: str) -> str:
    """The definition of the messages about a service's calls; any other definition as it is.

    Args:
        name: Of the type.
        definition: As the recording has it: for `package/srv/Name_Event` that of the service.
    """
    found = _EVENT.fullmatch(name)
    if found is None or not _BETWEEN.search(definition):
        return definition
    package, service = found["package"], found["name"]
    parts: dict[str, str] = {}
    for section in re.split(rf"^{_SEPARATOR}\n", definition, flags=re.MULTILINE):
        head, _, body = section.strip().partition("\n")
        if _BETWEEN.search(section):
            text = body if head.startswith("SRV: ") else section
            request, answer = _BETWEEN.split(text, maxsplit=1)
            parts[f"{package}/{service}_Request"] = request
            parts[f"{package}/{service}_Response"] = answer
        elif head.startswith("MSG: "):
            parts[head.removeprefix("MSG: ").replace("/msg/", "/")] = body
    for needed, text in _INFO.items():
        parts.setdefault(needed, text)
    lines = [
        "service_msgs/ServiceEventInfo info",
        f"{package}/{service}_Request[<=1] request",
        f"{package}/{service}_Response[<=1] response",
    ]
    for part, text in parts.items():
        lines += [_SEPARATOR, f"MSG: {part}", text if _COMMENT.sub("", text).strip() else _NO_FIELDS]
    return "\n".join(lines) + "\n"
