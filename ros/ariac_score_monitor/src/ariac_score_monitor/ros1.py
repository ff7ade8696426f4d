"""The monitor as a node of ROS 1 (Noetic, Debian)."""

import argparse
import signal
import sys
import time

import rosgraph
import roslib.message
import rospy
from std_msgs.msg import String

from ariac_score_monitor.core import event_of
from ariac_score_monitor.node import EXIT_ENDED, EXIT_USAGE, Node, options_of
from ariac_score_monitor.plan import PlanError, load_plan

__all__ = ["main"]


def main(argv=None):
    """Run the node until a signal comes; the exit code."""
    options = options_of(argparse, rospy.myargv(sys.argv)[1:] if argv is None else argv)
    try:
        plan = load_plan(options.plan)
        classes = {topic.name: _class_of(topic) for topic in plan.topics}
    except PlanError as fault:
        print("error: {}".format(fault), file=sys.stderr)
        return EXIT_USAGE
    if not rosgraph.is_master_online():
        print(
            "error: there is no ROS master at {}; start roscore, or set ROS_MASTER_URI".format(
                rosgraph.get_master_uri()
            ),
            file=sys.stderr,
        )
        return EXIT_USAGE
    reasons = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: reasons.append(number))
    rospy.init_node(plan.name.replace(".", "_").replace("-", "_"), disable_signals=True)
    node = Node(plan, options.out)
    said = rospy.Publisher("~monitor_verdict", String, queue_size=100, latch=True)
    for topic in plan.topics:
        _subscribe(node, topic, classes[topic.name])
    print("watching {} topic(s)".format(len(plan.topics)), flush=True)
    verdict = ""
    while not reasons and not rospy.is_shutdown():
        if node.verdict != verdict:
            verdict = node.verdict
            said.publish(String(data=verdict))
        time.sleep(0.02)
    node.end()
    rospy.signal_shutdown("ended")
    return EXIT_ENDED


def _class_of(topic):
    made = roslib.message.get_message_class(topic.type)
    if made is None:
        raise PlanError("topic {}: the type {!r} is not installed".format(topic.name, topic.type))
    return made


def _subscribe(node, topic, made):
    publisher = rospy.Publisher(topic.to, made, queue_size=100) if topic.to else None

    def arrived(message):
        forward = None if publisher is None else lambda: publisher.publish(message)
        node.put(event_of(topic.name, _fields(message), time.time()), forward)

    rospy.Subscriber(topic.name, made, arrived, queue_size=1000, tcp_nodelay=True)


def _fields(value):
    """A message as plain values, as ROSMonitoring writes them."""
    if hasattr(value, "__slots__") and hasattr(value, "_type"):
        return {name: _fields(getattr(value, name)) for name in value.__slots__}
    if hasattr(value, "secs") and hasattr(value, "nsecs"):
        return {"secs": value.secs, "nsecs": value.nsecs}
    if isinstance(value, (list, tuple)):
        return [_fields(one) for one in value]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value
