"""The monitor as a node of ROS 2. Written from the same source as the one of ROS 1; not run on ROS 2."""

import argparse
import signal
import sys
import threading
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from rosidl_runtime_py.utilities import get_message
from std_msgs.msg import String

from ariac_score_monitor.core import event_of
from ariac_score_monitor.node import EXIT_ENDED, EXIT_USAGE, Node, options_of
from ariac_score_monitor.plan import PlanError, load_plan

try:
    from rclpy.signals import SignalHandlerOptions
except ImportError:
    SignalHandlerOptions = None

__all__ = ["main"]


def main(argv=None):
    """Run the node until a signal comes; the exit code."""
    words = sys.argv if argv is None else argv
    options = options_of(argparse, remove_ros_args(words)[1:])
    try:
        plan = load_plan(options.plan)
        classes = {topic.name: _class_of(topic) for topic in plan.topics}
    except PlanError as fault:
        print("error: {}".format(fault), file=sys.stderr)
        return EXIT_USAGE
    reasons = []
    # Galactic has no such option; there the handlers that are set below replace those of rclpy.
    handlers = {} if SignalHandlerOptions is None else {"signal_handler_options": SignalHandlerOptions.NO}
    rclpy.init(args=words, **handlers)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: reasons.append(number))
    try:
        ros = rclpy.create_node(plan.name.replace(".", "_").replace("-", "_"))
        node = Node(plan, options.out)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        said = ros.create_publisher(String, "~/monitor_verdict", latched)
        for topic in plan.topics:
            _subscribe(ros, node, topic, classes[topic.name])
        threading.Thread(target=rclpy.spin, args=(ros,), daemon=True).start()
        print("watching {} topic(s)".format(len(plan.topics)), flush=True)
        verdict = ""
        while not reasons and rclpy.ok():
            if node.verdict != verdict:
                verdict = node.verdict
                said.publish(String(data=verdict))
            time.sleep(0.02)
        node.end()
    finally:
        rclpy.try_shutdown()
    return EXIT_ENDED


def _class_of(topic):
    try:
        return get_message(topic.type)
    except (ImportError, AttributeError, ValueError) as cause:
        raise PlanError("topic {}: the type {!r} is not installed: {}".format(topic.name, topic.type, cause))


def _subscribe(ros, node, topic, made):
    publisher = ros.create_publisher(made, topic.to, 100) if topic.to else None

    def arrived(message):
        forward = None if publisher is None else lambda: publisher.publish(message)
        node.put(event_of(topic.name, _fields(message), time.time()), forward)

    ros.create_subscription(made, topic.name, arrived, 1000)


def _fields(value):
    """A message as plain values: stamps with `sec` and `nanosec`, arrays of all kinds as lists."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: _fields(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_fields(one) for one in value]
    return value
