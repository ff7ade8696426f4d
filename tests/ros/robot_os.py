"""A ROS 1 master of our own and what runs on it: a free port, waits that end, processes that are ended."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from ariac_score.installed.system import await_session

REPOSITORY = Path(__file__).parents[2]
HERE = Path(__file__).parent
PYTHON = "/usr/bin/python3"
"""The interpreter that Debian's ROS is installed for."""
NEEDED = (
    "rospy",
    "rosbag",
    "rosservice",
    "geometry_msgs.msg",
    "tf2_msgs.msg",
    "std_srvs.srv",
    "rosgraph_msgs.msg",
)
_GENERATOR = Path("/usr/lib/genpy/genmsg_py.py")
_CONTROL = "string shipment_type\n---\nbool success\nstring message\n"
"""The service of ARIAC 2020 that takes a shipment."""


def need_ros1() -> None:
    """Skip, or fail where ROS is required, if ROS 1 is not installed."""
    lacking = [program for program in ("roscore", "rosbag", "rosrun") if shutil.which(program) is None]
    if (
        not lacking
        and subprocess.run(
            [PYTHON, "-c", f"import {', '.join(NEEDED)}"], capture_output=True, check=False
        ).returncode
    ):
        lacking = ["its Python packages"]
    if not _GENERATOR.exists():
        lacking.append("genpy")
    if lacking and os.environ.get("ARIAC_SCORE_REQUIRE_ROS1"):
        pytest.fail(f"ROS 1 is required here, and lacks {', '.join(lacking)}")
    if lacking:
        pytest.skip(f"ROS 1 is not installed: {', '.join(lacking)}")


def generate_messages(folder: Path) -> None:
    """Python modules of the message packages that the nodes use, as a catkin build makes them."""
    packages = {
        "ariac_score_msgs": REPOSITORY / "ros/ariac_score_msgs/msg",
        "nist_gear": REPOSITORY / "plugins/ariac_score_ariac/msg/nist_gear",
    }
    known = {name: Path("/usr/share", name, "msg") for name in ("std_msgs", "geometry_msgs")} | packages
    includes = [f"-I{name}:{path}" for name, path in known.items()]
    for name, path in packages.items():
        out = folder / name / "msg"
        out.mkdir(parents=True)
        (folder / name / "__init__.py").touch()
        command = [PYTHON, str(_GENERATOR), "-p", name, "-o", str(out)]
        messages = sorted(map(str, path.glob("*.msg")))
        subprocess.run([*command, *includes, *messages], check=True, capture_output=True, timeout=60)
        subprocess.run([*command, "--initpy"], check=True, capture_output=True, timeout=60)
    service, out = folder / "AGVControl.srv", folder / "nist_gear" / "srv"
    service.write_text(_CONTROL)
    command = [PYTHON, str(_GENERATOR.with_name("gensrv_py.py")), "-p", "nist_gear", "-o", str(out)]
    subprocess.run([*command, *includes, str(service)], check=True, capture_output=True, timeout=60)
    subprocess.run([*command, "--initpy"], check=True, capture_output=True, timeout=60)


class RobotOs:
    """A master, and the processes on it.

    Args:
        folder: For messages, logs and everything that is written.
        messages: Where `generate_messages` put the modules.
    """

    def __init__(self, folder: Path, messages: Path) -> None:
        self.folder = folder
        programs = folder / "bin"
        programs.mkdir()
        (programs / "python").symlink_to(PYTHON)  # by which catkin installs a script, Debian has none
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.environment = {
            "PATH": f"{programs}:/usr/bin:/bin",
            "ROS_PACKAGE_PATH": f"{REPOSITORY / 'ros'}:/usr/share",
            "HOME": str(folder),
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}",
            "ROS_HOSTNAME": "127.0.0.1",
            "ROS_HOME": str(folder / "ros"),
            "PYTHONPATH": f"{messages}:{REPOSITORY / 'ros/ariac_score_recorder/src'}",
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONUNBUFFERED": "1",
        }
        self._processes: list[subprocess.Popen[bytes]] = []
        self._said: dict[int, Path] = {}

    def start(self, *command: str | Path) -> subprocess.Popen[bytes]:
        """Start a process in a group of its own; what it says goes to a file."""
        said = self.folder / f"{len(self._processes)}_{Path(command[0]).name}.txt"
        with said.open("wb") as out:
            process = subprocess.Popen(
                list(map(str, command)),
                cwd=self.folder,
                env=self.environment,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._processes.append(process)
        self._said[process.pid] = said
        return process

    def said(self, process: subprocess.Popen[bytes]) -> str:
        """What a process said so far."""
        return self._said[process.pid].read_text(errors="replace")

    def python(self, *command: str | Path) -> subprocess.Popen[bytes]:
        """Start a script with the interpreter of ROS."""
        return self.start(PYTHON, *command)

    def recorder(self, plan: Path, *options: str | Path) -> subprocess.Popen[bytes]:
        """Start the recorder that is shipped."""
        script = REPOSITORY / "ros/ariac_score_recorder/scripts/recorder"
        return self.python(script, "--plan", plan, *options)

    def wait(self, process: subprocess.Popen[bytes], limit_s: float) -> int:
        """The exit code; a process that is not done in time fails the test with what it said."""
        try:
            return process.wait(limit_s)
        except subprocess.TimeoutExpired:
            pytest.fail(f"not done after {limit_s} s: {process.args}\n{self.said(process)}")

    def close(self, bag: subprocess.Popen[bytes], limit_s: float = 20.0) -> None:
        """Ctrl-C for `rosbag record`, which ends before the program that it started has closed the bag."""
        send(bag, signal.SIGINT)
        if not await_session(bag, limit_s):
            pytest.fail(f"not closed after {limit_s} s: {bag.args}\n{self.said(bag)}")

    def run(self, *command: str, limit_s: float = 10.0) -> str:
        """What a short command says; it must succeed."""
        process = self.start(*command)
        assert self.wait(process, limit_s) == 0, self.said(process)
        return self.said(process)

    def until(self, process: subprocess.Popen[bytes], words: str, limit_s: float = 15.0) -> None:
        """Wait until a process says something."""
        end = time.monotonic() + limit_s
        while words not in self.said(process):
            if time.monotonic() > end or process.poll() is not None:
                pytest.fail(f"never said {words!r}: {process.args}\n{self.said(process)}")
            time.sleep(0.05)

    def end_all(self) -> None:
        """End every process that was started here, last one first."""
        for process in reversed(self._processes):
            for what, limit_s in ((signal.SIGINT, 3.0), (signal.SIGKILL, 3.0)):
                if process.poll() is not None:
                    break
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, what)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(limit_s)
            # Children that outlived their parent, such as those of roscore.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def robot_os(folder: Path, messages: Path) -> Iterator[RobotOs]:
    """A running master."""
    ros = RobotOs(folder, messages)
    try:
        core = ros.start("/usr/bin/roscore", "-p", str(ros.port))
        ros.until(core, "started core service", 90.0)
        yield ros
    finally:
        ros.end_all()


def send(process: subprocess.Popen[bytes], what: signal.Signals) -> None:
    """A signal for a process and its children: `rosbag` starts the program that records."""
    os.killpg(process.pid, what)


def bag_command(name: str, topics: Sequence[str]) -> list[str]:
    """Without a recorder of ours: what is recorded, and where."""
    return ["/usr/bin/rosbag", "record", "-O", name, "--lz4", *topics]
