"""The recorder as a node of ROS 2: Galactic and later. Run on a stand-in of rclpy alone, not on ROS 2."""

import argparse
import io
import signal
import sys
import threading
import time

import rclpy
from ariac_score_msgs.msg import Heartbeat, Manifest, Submission, TrialEvent
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.utilities import remove_ros_args
from rosidl_runtime_py.utilities import get_message, get_service

from ariac_score_recorder.attest import Instant
from ariac_score_recorder.forwarding import Forwarder
from ariac_score_recorder.minisign import KeyUnusableError, read_key
from ariac_score_recorder.plan import PlanError, load_plan
from ariac_score_recorder.session import EVENTS, HEARTBEAT, MANIFEST, PERIOD_S, SUBMISSIONS, Session

try:
    from rclpy.signals import SignalHandlerOptions
except ImportError:
    SignalHandlerOptions = None

__all__ = ["main"]

EXIT_ENDED, EXIT_USAGE, EXIT_OTHER_RECORDER = 0, 4, 5
_LOOK_S = 0.5
"""Between two looks at which topics there are, s."""
_EVENT = "_Event"


def main(argv=None):
    """Run the node until the trial ends or a signal comes; the exit code."""
    words = sys.argv if argv is None else argv
    options = _options(remove_ros_args(words)[1:])
    try:
        plan = load_plan(options.plan)
        key = read_key(options.key) if options.key else None
    except (PlanError, KeyUnusableError) as fault:
        print("error: {}".format(fault), file=sys.stderr)
        return EXIT_USAGE
    reasons = []
    # Galactic has no such option; there the handlers that are set below replace those of rclpy.
    handlers = {} if SignalHandlerOptions is None else {"signal_handler_options": SignalHandlerOptions.NO}
    rclpy.init(args=words, **handlers)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: reasons.append("signal {}".format(number)))
    try:
        return _Recorder(plan, key, options).run(reasons)
    finally:
        rclpy.try_shutdown()


def _options(argv):
    parser = argparse.ArgumentParser(
        prog="recorder", description="Publish submissions, events and a signed manifest."
    )
    parser.add_argument("--plan", required=True, metavar="FILE", help="of 'ariac-score record -o NAME'")
    parser.add_argument("--out", metavar="NAME", help="also write NAME.manifest.json and its signature")
    parser.add_argument("--key", metavar="FILE", help="the organiser's secret key, without a password")
    parser.add_argument("--wait-s", type=float, default=10.0, help="for ros2 bag to subscribe; default: 10")
    return parser.parse_args(argv)


class _Recorder:
    def __init__(self, plan, key, options):
        self._plan, self._key, self._options = plan, key, options
        self._node = rclpy.create_node("ariac_score_recorder")
        self._group = ReentrantCallbackGroup()
        self._simulated = self._node.get_parameter("use_sim_time").value
        latched = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._publishers = {
            "submission": (self._node.create_publisher(Submission, SUBMISSIONS, 100), Submission),
            "event": (self._node.create_publisher(TrialEvent, EVENTS, 100), TrialEvent),
            "heartbeat": (self._node.create_publisher(Heartbeat, HEARTBEAT, 100), Heartbeat),
            "manifest": (self._node.create_publisher(Manifest, MANIFEST, latched), Manifest),
        }
        self._session = None
        self._others = set()
        self._subscribed = set()
        self._classes = {}
        self._executor = MultiThreadedExecutor()
        self._executor.add_node(self._node)

    def run(self, reasons):
        spinning = threading.Thread(target=self._executor.spin, daemon=True)
        spinning.start()
        self._node.create_subscription(Heartbeat, HEARTBEAT, self._heard, 100, callback_group=self._group)
        self._wait_for_bag(reasons)
        if self._others:
            others = ", ".join(sorted(self._others))
            print("error: another recorder is running here: {}; end it first".format(others), file=sys.stderr)
            return EXIT_OTHER_RECORDER
        session = self._session = Session(self._plan, self._send, self._now, self._key, self._simulated)
        forwarders = [_Forwarding(self._node, self._group, each, self._send) for each in self._plan.forwards]
        if not self._is_recorded():
            session.note("nothing recorded the heartbeats when this recorder began")
        self._look()
        session.begin()
        print("recording {}: {} topics".format(session.recording, len(session.topics)))
        reason = self._beat(session, forwarders, reasons)
        body, signature = session.close(reason)
        self._write(body, signature)
        # The manifest is latched, and whoever records takes it from here: it needs a moment.
        time.sleep(1.0)
        print("closed: {}".format(reason))
        self._executor.shutdown(timeout_sec=1.0)
        return EXIT_ENDED

    def _beat(self, session, forwarders, reasons):
        due = looked = time.monotonic()
        while True:
            if reasons:
                return reasons[0]
            ended = session.beat()
            if ended:
                return ended
            if time.monotonic() - looked >= _LOOK_S:
                looked = time.monotonic()
                self._look()
                for each in forwarders:
                    each.offer()
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))

    def _wait_for_bag(self, reasons):
        begun = time.monotonic()
        while time.monotonic() - begun < self._options.wait_s and not reasons:
            if time.monotonic() - begun > 10 * PERIOD_S and (self._others or self._is_recorded()):
                return
            time.sleep(0.02)

    def _is_recorded(self):
        return self._publishers["heartbeat"][0].get_subscription_count() > 1

    def _look(self):
        """Subscribe to topics of the plan that have appeared: their types are known from then on."""
        there = dict(self._node.get_topic_names_and_types())
        for topic in self._session.topics:
            if topic not in self._subscribed and there.get(topic):
                self._subscribe(topic, there[topic][0])

    def _subscribe(self, topic, kind):
        try:
            made = _class_of(kind)
        except (ImportError, AttributeError, ValueError) as cause:
            self._subscribed.add(topic)
            self._session.note("{}: {} is not installed: {}".format(topic, kind, cause))
            return
        publishers = self._node.get_publishers_info_by_topic(topic)
        if not publishers:
            return
        # As `ros2 bag record` adapts: a subscriber may ask for no more than every publisher offers.
        latched = all(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in publishers)
        reliable = all(each.qos_profile.reliability == ReliabilityPolicy.RELIABLE for each in publishers)
        profile = QoSProfile(
            depth=1000,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        )
        self._subscribed.add(topic)
        definition = _definition(publishers)
        self._node.create_subscription(
            made,
            topic,
            lambda payload: self._session.arrived(
                topic,
                kind,
                bytes(payload),
                lambda: deserialize_message(bytes(payload), made),
                definition=definition,
            ),
            profile,
            callback_group=self._group,
            raw=True,
        )

    def _heard(self, message):
        if self._session is None:
            self._others.add(message.recording)
        else:
            self._session.other_heartbeat(message.recording)

    def _now(self):
        ros = self._node.get_clock().now().nanoseconds
        return Instant(None if self._simulated and not ros else ros, time.time_ns(), time.monotonic())

    def _send(self, name, fields):
        publisher, made = self._publishers[name]
        message = made(**fields)
        if name in ("heartbeat", "manifest"):
            message.header.stamp = self._node.get_clock().now().to_msg()
        publisher.publish(message)

    def _write(self, body, signature):
        if not self._options.out:
            return
        for ending, text in ((".manifest.json", body), (".manifest.json.minisig", signature)):
            if text:
                with io.open(self._options.out + ending, "w", encoding="ascii", newline="\n") as file:
                    file.write(text)


def _definition(publishers):
    """The hash of the type that all publishers of a topic have; empty before Iron, which has the first."""
    found = {str(getattr(each, "topic_type_hash", "")) for each in publishers}
    words = found.pop() if len(found) == 1 else ""
    return words if words.startswith("RIHS01_") else ""


def _class_of(kind):
    if kind.endswith(_EVENT) and "/srv/" in kind:
        return get_service(kind[: -len(_EVENT)]).Event
    return get_message(kind)


class _Forwarding:
    """One service, offered under another name from when the simulator offers its own."""

    def __init__(self, node, group, forward, send):
        self._node, self._group, self._forward = node, group, forward
        self._forwarder = Forwarder(forward, send)
        self._client = self._offered = None

    def offer(self):
        """Look for the simulator's service; a team waits for our name, so it must not appear before."""
        if self._offered:
            return
        kinds = dict(self._node.get_service_names_and_types()).get(self._forward.service)
        if not kinds:
            return
        kind = get_service(kinds[0])
        self._client = self._node.create_client(kind, self._forward.service, callback_group=self._group)
        self._offered = self._node.create_service(
            kind, self._forward.offered, self._forwarded, callback_group=self._group
        )

    async def _forwarded(self, request, _):
        self._forwarder.called(request)
        answer = await self._client.call_async(request)
        self._forwarder.answered(request, answer)
        return answer
