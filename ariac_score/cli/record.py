"""`ariac-score record --rules NAME`: the commands that record a trial so that it can be scored."""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.documents.yaml import load_yaml
from ariac_score.errors import LogMapError, UsageError
from ariac_score.installed.system import await_session, end_session, signal_session
from ariac_score.logs.logmap import bases_of, is_log_map_file, load_log_map
from ariac_score.logs.recording import OWN_TOPICS, Recording, load_recording
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.trial.channels import LogMap

_RELEASES = ("1", "galactic", "humble", "iron", "jazzy", "kilted")
_WITH_SERVICES = ("jazzy", "kilted")
"""Releases whose `ros2 bag` records services by name, and asks for `--topics`."""
_CLOSING_S = 20.0
"""How long a bag may take to be closed; after that it is ended, and its file stays as it is."""
_LATE_S = 60.0
"""How long the recorder may take to close its manifest after it was told to."""


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "record",
        description="Print the exact commands that record a trial so that it can be scored: which topics, "
        "which clock, which must be left out and why. With -o, also write the plan that our recorder "
        "follows; with --run, run both until the trial ends.",
    )
    parser.add_argument(
        "--rules", required=True, metavar="NAME", help="rule set: a name ('rules list') or a .yaml file"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="name of the recording, without ending"
    )
    parser.add_argument(
        "--mode", default="", help="how the simulator runs, such as competition or development"
    )
    parser.add_argument("--ros", default="", choices=_RELEASES, help="ROS 1, or a release of ROS 2")
    parser.add_argument("--trial", default="", metavar="NAME", help="name of the trial, for the manifest")
    parser.add_argument("--team", default="", metavar="NAME", help="name of the team, for the manifest")
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="secret key that the manifest is signed with"
    )
    parser.add_argument(
        "--forward", action="store_true", help="let the recorder pass on the team's calls of services"
    )
    parser.add_argument(
        "--run", dest="runs", action="store_true", help="run the commands until the trial ends"
    )
    add_local_plugins(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the commands, or run them; 0 if both ended as they should."""
    registry = registry_of(arguments)
    rule_set = load_rule_set(arguments.rules, registry=registry)
    name = arguments.log_map or rule_set.log_map
    log_map = load_log_map(name, registry=registry) if name else None
    recording = load_recording(
        log_map,
        _names(rule_set, name, log_map, registry),
        mode=arguments.mode,
        ros=arguments.ros,
        registry=registry,
    )
    if not set(recording.topics) - {"/clock"}:
        raise UsageError(
            f"the log map of {rule_set.id} names no topic, so nothing would be recorded",
            hint="name one of your own: --log-map FILE; 'ariac-score map LOG' drafts one from a recording",
        )
    output = arguments.output or Path("trial")
    bag, recorder = bag_command(recording, output), recorder_command(recording, output, arguments.key)
    if arguments.output or arguments.runs:
        _write_plan(recording, output, arguments)
    if arguments.runs:
        return _run(bag, recorder)
    for line in _lines(recording, bag, recorder, is_planned=arguments.output is not None):
        print(line)
    return 0


def _names(rule_set: RuleSet, name: str, log_map: LogMap | None, registry: Registry) -> list[str]:
    """What the competition's own data may be called: as the rules, or as a log map or what that extends."""
    names = [rule_set.id.partition(".")[0], log_map.id if log_map else ""]
    with suppress(LogMapError):  # its file is relative to its rule set, perhaps
        if is_log_map_file(name):
            name = str(load_yaml(Path(name), error=LogMapError).data.get("extends", ""))
            names.append(name)
        names += bases_of(name, registry) if name else ()
    return names


def bag_command(recording: Recording, output: Path) -> list[str]:
    """The command of `rosbag` or `ros2 bag`.

    Args:
        recording: What to record.
        output: Path of the recording, without ending.
    """
    events = [f"{service}/_service_event" for service in recording.services]
    # Whoever records services by name must not name their events among the topics as well.
    topics = sorted({*recording.topics, *OWN_TOPICS} - set(events))
    if recording.ros == "1":
        # What a killed bag loses is its last chunk, and 768 KB, the default, can be a whole trial.
        small = ["--chunksize", "64"]
        return [
            "rosbag",
            "record",
            "-O",
            f"{output}.bag",
            "--lz4",
            "--tcpnodelay",
            "-b",
            "1024",
            *small,
            *topics,
        ]
    command = ["ros2", "bag", "record", "-o", str(output)]
    if recording.ros != "galactic":  # it knows neither MCAP nor simulated time
        command += ["-s", "mcap"]
    if recording.ros in ("iron", *_WITH_SERVICES):
        command += ["--storage-preset-profile", "zstd_fast"]
    if recording.simulated and recording.ros != "galactic":
        command.append("--use-sim-time")
    if recording.hidden or (events and recording.ros == "iron"):
        command.append("--include-hidden-topics")
    command += ["--qos-profile-overrides-path", f"{output}.qos.yaml"]
    if recording.ros in _WITH_SERVICES:
        command += ["--topics", *topics]
        return [*command, "--services", *recording.services] if recording.services else command
    return [*command, *topics, *(events if recording.ros == "iron" else [])]


def recorder_command(recording: Recording, output: Path, key: Path | None) -> list[str]:
    """The command of our recorder."""
    start = ["rosrun"] if recording.ros == "1" else ["ros2", "run"]
    command = [
        *start,
        "ariac_score_recorder",
        "recorder",
        "--plan",
        f"{output}.plan.json",
        "--out",
        str(output),
    ]
    command += ["--key", str(key)] if key else []
    simulated = ["--ros-args", "-p", "use_sim_time:=true"] if recording.simulated else []
    return [*command, *(simulated if recording.ros != "1" else [])]


def qos_overrides(recording: Recording) -> str:
    """What `ros2 bag` asks of publishers that send their messages once, also to whoever comes later.

    Such a publisher may come after the recorder, which would otherwise ask for less than it offers.

    Args:
        recording: What to record.
    """
    kept = dict.fromkeys(recording.latched, "keep_last, depth: 10")
    kept |= {"/tf_static": "keep_all", "/rosout": "keep_last, depth: 1000"}
    kept = {topic: how for topic, how in kept.items() if topic in recording.topics}
    kept |= {"/ariac_score/manifest": "keep_last, depth: 2"}
    return "".join(
        f"{topic}: {{history: {how}, reliability: reliable, durability: transient_local}}\n"
        for topic, how in sorted(kept.items())
    )


def _write_plan(recording: Recording, output: Path, arguments: argparse.Namespace) -> None:
    plan = recording.plan(trial=arguments.trial, team=arguments.team, forward=arguments.forward)
    files = {f"{output}.plan.json": json.dumps(plan, indent=1, sort_keys=True) + "\n"}
    if recording.ros != "1":
        files[f"{output}.qos.yaml"] = qos_overrides(recording)
    for name, text in files.items():
        try:
            Path(name).write_text(text, encoding="utf-8")
        except OSError as cause:
            raise UsageError(
                f"cannot be written: {cause.strerror}", file=name, hint="check the folder"
            ) from cause


def _lines(
    recording: Recording, bag: Sequence[str], recorder: Sequence[str], *, is_planned: bool
) -> Iterator[str]:
    if recording.mode:
        yield f"# the simulator in {recording.mode} mode"
    for note in recording.notes:
        yield f"# {note}"
    for topic, why in sorted(recording.left_out.items()):
        yield f"# left out: {topic}: {why}"
    files = "its plan" if recording.ros == "1" else "its plan, and the profiles that the bag asks for"
    if not is_planned:
        yield f"# say -o NAME first: it writes {files}, which these commands read"
    yield shlex.join(bag)
    yield "# beside it, our recorder: submissions, events, a signed manifest"
    yield shlex.join(recorder)
    # Its manifest is the last message, and a bag that lacks it attests nothing.
    yield "# stop the bag after the recorder has said 'closed', not before; --run does both"


def _run(bag: Sequence[str], recorder: Sequence[str]) -> int:
    """Run both until the recorder ends; nothing goes on afterwards."""
    for program in (bag[0], recorder[0]):
        if shutil.which(program) is None:
            raise UsageError(
                f"there is no program {program!r} here", hint="source the set-up of your ROS first"
            )
    running: list[subprocess.Popen[bytes]] = []
    try:
        # In sessions of their own: Ctrl-C reaches us alone, and the manifest is closed before the bag.
        running.append(subprocess.Popen(bag, start_new_session=True))  # noqa: S603
        running.append(subprocess.Popen(recorder, start_new_session=True))  # noqa: S603
        code = _watch(*running)
    finally:
        for process in reversed(running):
            _end(process)
    if code:
        raise UsageError(f"the recorder ended with code {code}", hint="see what it said above")
    return 0


def _watch(bag: subprocess.Popen[bytes], recorder: subprocess.Popen[bytes]) -> int:
    """The recorder's exit code; a bag that ends first is an error."""
    try:
        while recorder.poll() is None:
            if bag.poll() is not None:
                raise UsageError(f"the bag ended with code {bag.returncode}", hint="see what it said above")
            time.sleep(0.05)
    except KeyboardInterrupt:
        signal_session(recorder, signal.SIGINT)
        recorder.wait(_LATE_S)
    return recorder.returncode


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it started, politely first."""
    if process.poll() is None:
        signal_session(process, signal.SIGINT)
        await_session(process, _CLOSING_S)
    with suppress(subprocess.TimeoutExpired):
        end_session(process, _CLOSING_S)
