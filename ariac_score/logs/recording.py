"""What to record of a competition, and how: the topics of its log map, and what stands beside it as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.documents.schema import validate
from ariac_score.documents.yaml import YamlDocument, load_yaml
from ariac_score.errors import DataFileError, UsageError, did_you_mean
from ariac_score.trial.channels import LogMap

__all__ = ["GROUP", "OWN_TOPICS", "PLAN_FORMAT", "Recording", "load_recording", "recording_names"]

GROUP = "ariac_score.recordings"
"""Entry points that name a file, or a folder of them, that says what to record of a competition."""

OWN_TOPICS = (
    "/ariac_score/submissions",
    "/ariac_score/events",
    "/ariac_score/heartbeat",
    "/ariac_score/manifest",
)
"""Published by our recorder."""

PLAN_FORMAT = "ariac-score-recording-plan/1"


@dataclass(frozen=True)
class Recording:
    """What to record, in one mode of the simulator.

    Attributes:
        ros: `1`, or the release of ROS 2.
        mode: The mode; empty where there is but one.
        topics: In order of their names, without our own.
        left_out: Topics that must not be subscribed to, and why.
        services: Whose events are recorded.
        latched: Topics whose messages are sent once, and kept for whoever comes later.
        hidden: Whether hidden topics are among them.
        simulated: Whether ROS time is that of a simulation.
        notes: What whoever records must know.
        recorder: What the recorder's plan has of it as it is written.
    """

    ros: str
    mode: str = ""
    topics: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    services: tuple[str, ...] = ()
    latched: tuple[str, ...] = ()
    hidden: bool = False
    simulated: bool = True
    notes: tuple[str, ...] = ()
    recorder: Mapping[str, Any] = field(default_factory=dict)

    def plan(self, *, trial: str = "", team: str = "", forward: bool = False) -> dict[str, Any]:
        """The plan that the recorder follows.

        Args:
            trial: The trial's name.
            team: The team's.
            forward: Whether the recorder stands between the team and the simulator.
        """
        state = self.recorder.get("state")
        plan: dict[str, Any] = {
            "format": PLAN_FORMAT,
            "trial": trial,
            "team": team,
            # Not the clock: it is a thousand messages a second, and every stamp of the others attests it.
            "topics": [topic for topic in self.topics if topic != "/clock"],
            "left_out": dict(self.left_out),
            "linger_s": self.recorder.get("linger_s", 5),
            "watching": list(self.recorder.get("watching", [])),
            "watches": [w for w in self.recorder.get("watches", []) if w["topic"] not in self.left_out],
            "forwards": list(self.recorder.get("forwards", [])) if forward else [],
        }
        if state:
            about = {"topic": state["topic"], "field": state["field"]}
            plan["starts"] = {**about, "values": state["before"]}
            plan["ends"] = {**about, "values": state["after"]}
        return plan


def recording_names(registry: Registry | None = None) -> list[str]:
    """The names of what is installed, which are those of log maps or the first words of rule sets."""
    return sorted({file.name for file in (registry or Registry()).files(GROUP)})


def load_recording(
    log_map: LogMap | None,
    names: Sequence[str] = (),
    *,
    mode: str = "",
    ros: str = "",
    registry: Registry | None = None,
) -> Recording:
    """What to record for a log map.

    Args:
        log_map: Whose topics are read; `None` where a rule set has none.
        names: Under which the competition's own data are looked for: the first that is installed counts.
        mode: Of the simulator; by default the competition's first one.
        ros: `1` or a release of ROS 2; by default as the competition's data say.
        registry: What is installed, where the caller has it already.

    Raises:
        UsageError: The mode does not exist, nothing says which ROS it is, or it is another than is asked for.
        DataFileError: The competition's data are malformed.
    """
    registry = registry or Registry()
    document = _document(names, registry)
    data = document.data if document else {}
    modes: dict[str, Any] = data.get("modes", {})
    if mode and mode not in modes:
        what = "modes of this competition"
        hint = did_you_mean(mode, sorted(modes), what=what) if modes else "leave out --mode: there is but one"
        raise UsageError(f"there is no mode {mode!r} of the simulator", hint=hint)
    mode = mode or next(iter(modes), "")
    about = modes.get(mode, {})
    stated = data.get("ros", "")
    if ros and stated and (ros == "1") is not (stated == "1"):
        own = "ROS 1" if stated == "1" else f"ROS 2 ({stated})"
        raise UsageError(f"the simulator of this competition is of {own}", hint=f"leave out --ros {ros}")
    ros = ros or stated
    if not ros:
        known = ", ".join(recording_names(registry))
        hint = f"say --ros 1 or the release of ROS 2, such as --ros jazzy; known without it: {known}"
        raise UsageError("nothing says which ROS records this", hint=hint)
    left_out = dict(about.get("left_out", {}))
    elsewhere = {t for name, other in modes.items() if name != mode for t in other.get("topics", [])}
    elsewhere -= set(about.get("topics", []))
    simulated = data.get("simulated_time", True)
    # A rule set may have the log map of another competition, for the logs that both can read.
    other = log_map is not None and log_map.id in recording_names(registry) and log_map.id != data.get("id")
    mapped = set() if log_map is None or other else {channel.topic for channel in log_map.channels}
    topics = mapped - elsewhere | set(data.get("topics", [])) | set(about.get("topics", []))
    topics |= {"/clock"} if simulated else set()
    return Recording(
        ros=ros,
        mode=mode,
        topics=tuple(sorted(topics - set(left_out) - set(OWN_TOPICS))),
        left_out=left_out,
        services=tuple(data.get("services", [])),
        latched=tuple(data.get("latched", [])),
        hidden=data.get("hidden", False),
        simulated=simulated,
        notes=tuple(data.get("notes", [])),
        recorder={k: data[k] for k in ("state", "linger_s", "watching", "watches", "forwards") if k in data},
    )


def _document(names: Sequence[str], registry: Registry) -> YamlDocument | None:
    """The first of the installed files of these names, checked."""
    installed = recording_names(registry)
    for name in names:
        if name in installed:
            return _checked(registry.file(GROUP, name).path)
    return None


def _checked(path: Path) -> YamlDocument:
    document = load_yaml(path, error=DataFileError)
    validate(document, "recording", error=DataFileError)
    return document
