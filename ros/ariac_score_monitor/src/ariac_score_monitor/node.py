"""What the nodes of ROS 1 and ROS 2 have in common."""

import os
import time

from ariac_score_monitor.core import Log, Monitor, Queue
from ariac_score_monitor.link import Link

__all__ = ["EXIT_ENDED", "EXIT_USAGE", "Node", "options_of"]

EXIT_ENDED, EXIT_USAGE = 0, 4


def options_of(argparse, argv):
    """The options of the command line."""
    parser = argparse.ArgumentParser(prog="monitor", description="Ask an oracle about every message.")
    parser.add_argument("--plan", required=True, metavar="FILE", help="what to watch, and whom to ask: JSON")
    parser.add_argument("--out", default=".", metavar="DIR", help="for both logs; default: here")
    return parser.parse_args(argv)


class Node(object):
    """The monitor at work: logs, link and queue.

    Args:
        plan: What to do.
        folder: For `NAME.jsonl`, the events, and `NAME.status.jsonl`.
    """

    def __init__(self, plan, folder):
        os.makedirs(folder, exist_ok=True)
        logs = [
            Log(os.path.join(folder, plan.name + ending), plan.log_bytes, plan.log_parts)
            for ending in (".jsonl", ".status.jsonl")
        ]
        self._logs, (events, status) = logs, logs
        self._timeout_s = plan.timeout_s
        self._link = Link(
            plan, lambda what, **more: status.write(dict(more, status=what, wall_time=time.time()))
        )
        self._link.wait(plan.timeout_s)
        self._monitor = Monitor(plan, self._link, events, status)
        self._queue = Queue(self._monitor, plan.queue, plan.without_oracle == "open", events)

    @property
    def verdict(self):
        """The last one."""
        return self._monitor.verdict

    def put(self, event, forward=None):
        """Take the event of a message; `forward` publishes it where it may pass."""
        return self._queue.put(event, forward)

    def end(self):
        """Ask about what waits, and end."""
        self._queue.end(2 * self._timeout_s)
        self._link.end()  # breaks off what is being asked
        self._queue.join(self._timeout_s)
        self._monitor.close()
        for log in self._logs:
            log.close()
