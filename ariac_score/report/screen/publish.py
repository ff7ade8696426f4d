"""Margins and verdicts as topics of a Foxglove server, for Foxglove and PlotJuggler."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from ariac_score.errors import UsageError
from ariac_score.serving.guard import is_loopback

__all__ = ["Publisher"]

_NUMBER, _TEXT = {"type": "number"}, {"type": "string"}
_MARGIN = {
    "type": "object",
    "properties": {"margin": _NUMBER, "actual": _NUMBER, "limit": _NUMBER, "unit": _TEXT},
}
_VERDICT = {
    "type": "object",
    "properties": {
        "verdict": _TEXT,
        "text": _TEXT,
        "least": _NUMBER,
        "most": _NUMBER,
        "so_far": _NUMBER,
        "task": _NUMBER,
        "elapsed_s": _NUMBER,
    },
}
_UNNAMED = str.maketrans(dict.fromkeys(" #.:", "_"))


class Publisher:
    """A Foxglove server: `/NAME/margin/CHECK/SUBJECT` and `/NAME/verdict` for each cell, as JSON.

    Its protocol knows no token and its clients are pages of elsewhere, so it listens on this machine alone.

    Args:
        host: Address of this machine.
        port: 0 takes any free one.

    Raises:
        UsageError: It would be reached from elsewhere, the port is taken, or `foxglove-sdk` is not installed.
    """

    def __init__(self, host: str, port: int) -> None:
        if host != "localhost" and not is_loopback(host):
            raise UsageError(
                f"--publish listens on this machine alone, not on {host!r}: its protocol knows no token",
                hint="give 127.0.0.1:PORT, and reach it from elsewhere through ssh -L",
            )
        try:
            import foxglove  # noqa: PLC0415  # an extra
        except ImportError as cause:
            raise UsageError(
                "--publish needs the library foxglove-sdk", hint="pip install 'ariac-score[publish]'"
            ) from cause
        try:
            self._server = foxglove.start_server(name="ariac-score", host=host, port=port)
        except (OSError, RuntimeError) as cause:
            raise UsageError(
                f"cannot listen on {host}:{port}: {cause}", hint="choose another port"
            ) from cause
        self.port = int(self._server.port)
        self._channel: Callable[..., Any] = foxglove.Channel
        self._schema: Callable[..., Any] = foxglove.Schema
        self._channels: dict[str, Any] = {}

    def show(self, state: Mapping[str, Any]) -> None:
        """Publish what is shown of a cell."""
        name = state["name"].translate(_UNNAMED)
        for one in state["now"]:
            topic = f"/{name}/margin/{one['check']}/{one['subject'].translate(_UNNAMED)}"
            values = {key: one[key] for key in ("margin", "actual", "limit", "unit")}
            self._log(topic, "ariac_score.Margin", _MARGIN, values)
        scores = {
            key: float(state["score"][key])
            for key in ("least", "most", "so_far", "task")
            if key in state["score"]
        }
        said = {
            "verdict": state["verdict"]["kind"],
            "text": state["verdict"]["text"],
            "elapsed_s": state["t"],
        }
        self._log(f"/{name}/verdict", "ariac_score.Verdict", _VERDICT, {**said, **scores})

    def close(self) -> None:
        """End."""
        self._server.stop()

    def _log(self, topic: str, kind: str, schema: Mapping[str, Any], values: Mapping[str, Any]) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            described = self._schema(name=kind, encoding="jsonschema", data=json.dumps(schema).encode())
            channel = self._channels[topic] = self._channel(topic, message_encoding="json", schema=described)
        channel.log(json.dumps(values).encode())
