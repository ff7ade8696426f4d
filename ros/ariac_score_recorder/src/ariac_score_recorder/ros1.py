"""The recorder as a node of ROS 1: Python 2.7 (Melodic) and 3 (Noetic, Debian)."""

from __future__ import print_function, unicode_literals

import argparse
import hashlib
import io
import re
import signal
import struct
import sys
import threading
import time

import genpy
import rosgraph
import roslib.message
import rospy
import rosservice
from ariac_score_msgs.msg import Heartbeat, Manifest, Submission, TrialEvent

from ariac_score_recorder.attest import Instant
from ariac_score_recorder.forwarding import Forwarder
from ariac_score_recorder.minisign import KeyUnusableError, read_key
from ariac_score_recorder.plan import PlanError, load_plan
from ariac_score_recorder.session import EVENTS, HEARTBEAT, MANIFEST, PERIOD_S, SUBMISSIONS, Session

__all__ = ["main"]

EXIT_ENDED, EXIT_USAGE, EXIT_OTHER_RECORDER = 0, 4, 5
_STAMPED = re.compile(
    r"\A(?:\s*(?:#[^\n]*)?\n)*\s*(?:std_msgs/)?Header\s+\w+", re.ASCII if hasattr(re, "ASCII") else 0
)
_steady_s = getattr(time, "monotonic", time.time)


def main(argv=None):
    """Run the node until the trial ends or a signal comes; the exit code."""
    options = _options(rospy.myargv(sys.argv)[1:] if argv is None else argv)
    try:
        plan = load_plan(options.plan)
        key = read_key(options.key) if options.key else None
    except (PlanError, KeyUnusableError) as fault:
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
        signal.signal(number, lambda number, _: reasons.append("signal {}".format(number)))
    # Another node of the same name would end this one: its name is its own.
    rospy.init_node("ariac_score_recorder", anonymous=True, disable_signals=True)
    return _Node(plan, key, options).run(reasons)


def _options(argv):
    parser = argparse.ArgumentParser(
        prog="recorder", description="Publish submissions, events and a signed manifest."
    )
    parser.add_argument(
        "--plan", required=True, metavar="FILE", help="as 'ariac-score record -o NAME' writes it"
    )
    parser.add_argument("--out", metavar="NAME", help="also write NAME.manifest.json and its signature")
    parser.add_argument(
        "--key", metavar="FILE", help="the organiser's secret key, of minisign, without a password"
    )
    parser.add_argument("--wait-s", type=float, default=10.0, help="for rosbag to subscribe; default: 10 s")
    return parser.parse_args(argv)


class _Node(object):
    def __init__(self, plan, key, options):
        self._plan, self._options = plan, options
        self._simulated = bool(rospy.get_param("/use_sim_time", False))
        self._publishers = {
            "submission": (rospy.Publisher(SUBMISSIONS, Submission, queue_size=100), Submission),
            "event": (rospy.Publisher(EVENTS, TrialEvent, queue_size=100), TrialEvent),
            "heartbeat": (rospy.Publisher(HEARTBEAT, Heartbeat, queue_size=100), Heartbeat),
            "manifest": (rospy.Publisher(MANIFEST, Manifest, queue_size=2, latch=True), Manifest),
        }
        self._key = key
        self._session = None
        self._others = set()
        self._classes = {}
        self._definitions = {}
        self._publish_lock = threading.Lock()

    def run(self, reasons):
        rospy.Subscriber(HEARTBEAT, Heartbeat, self._heard)
        self._wait_for_bag(reasons)
        if self._others:
            print(
                "error: another recorder is running here: {}; end it, or let it record".format(
                    ", ".join(sorted(self._others))
                ),
                file=sys.stderr,
            )
            return EXIT_OTHER_RECORDER
        session = self._session = Session(self._plan, self._send, self._now, self._key, self._simulated)
        for topic in session.topics:
            rospy.Subscriber(topic, rospy.AnyMsg, self._arrived, callback_args=topic, tcp_nodelay=True)
        forwarders = [_Forwarding(each, self._send) for each in self._plan.forwards]
        if not self._is_recorded():
            session.note("nothing recorded the heartbeats when this recorder began")
        session.begin()
        print("recording {}: {} topics".format(session.recording, len(session.topics)))
        reason = self._beat(session, reasons)
        for each in forwarders:
            each.end()
        body, signature = session.close(reason)
        self._write(body, signature)
        # The manifest is latched, and whoever records takes it from here: it needs a moment.
        time.sleep(1.0)
        print("closed: {}".format(reason))
        rospy.signal_shutdown(reason)
        return EXIT_ENDED

    def _beat(self, session, reasons):
        due = _steady_s()
        while True:
            if rospy.is_shutdown():
                return "the ROS master asked the node to end"
            if reasons:
                return reasons[0]
            ended = session.beat()
            if ended:
                return ended
            due = max(due + PERIOD_S, _steady_s())
            time.sleep(max(0.0, due - _steady_s()))

    def _wait_for_bag(self, reasons):
        # Somebody else's heartbeat comes within this time, too.
        begun = _steady_s()
        while _steady_s() - begun < self._options.wait_s and not reasons:
            if _steady_s() - begun > 10 * PERIOD_S and (self._others or self._is_recorded()):
                return
            time.sleep(0.02)

    def _is_recorded(self):
        # This node itself listens for the heartbeats of others.
        return self._publishers["heartbeat"][0].get_num_connections() > 1

    def _heard(self, message):
        if self._session is None:
            self._others.add(message.recording)
        else:
            self._session.other_heartbeat(message.recording)

    def _now(self):
        ros = rospy.get_rostime().to_nsec()
        return Instant(None if self._simulated and not ros else ros, int(time.time() * 1e9), _steady_s())

    def _send(self, name, fields):
        publisher, made = self._publishers[name]
        message = made(**fields)
        if name in ("heartbeat", "manifest"):
            message.header.stamp = rospy.get_rostime()
        with self._publish_lock:
            publisher.publish(message)

    def _arrived(self, message, topic):
        about = message._connection_header
        payload = message._buff
        number = None
        if _STAMPED.match(about.get("message_definition", "")) and len(payload) >= 4:
            number = struct.unpack_from(str("<I"), payload)[0]
        kind = about["type"]
        self._session.arrived(
            topic,
            kind,
            payload,
            lambda: self._decoded(kind, payload),
            about.get("callerid", ""),
            number,
            self._definition(about.get("message_definition")),
        )

    def _definition(self, text):
        # The MD5 sum of ROS does not tell a list of messages from one.
        if text is None:
            return ""
        if text not in self._definitions:
            content = text if isinstance(text, bytes) else text.encode("utf-8")
            self._definitions[text] = "sha256:" + hashlib.sha256(content).hexdigest()
        return self._definitions[text]

    def _decoded(self, kind, payload):
        if kind not in self._classes:
            self._classes[kind] = roslib.message.get_message_class(kind)
        if self._classes[kind] is None:
            raise genpy.MessageException("{} is not installed".format(kind))
        return self._classes[kind]().deserialize(payload)

    def _write(self, body, signature):
        if not self._options.out:
            return
        for ending, text in ((".manifest.json", body), (".manifest.json.minisig", signature)):
            if text:
                with io.open(self._options.out + ending, "w", encoding="ascii", newline="\n") as file:
                    file.write(text)


class _Forwarding(object):
    """One service, offered under another name from when the simulator offers its own."""

    def __init__(self, forward, send):
        self._name, self._service = forward.offered, forward.service
        self._forwarder = Forwarder(forward, send)
        self._offered = self._proxy = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._offer)
        self._thread.daemon = True
        self._thread.start()

    def _offer(self):
        # A team waits for the name to appear, so it must not appear before the simulator's.
        while not self._ending.is_set():
            try:
                rospy.wait_for_service(self._service, timeout=1.0)
                kind = rosservice.get_service_class_by_name(self._service)
            except (rospy.ROSException, rosservice.ROSServiceException):
                self._ending.wait(PERIOD_S)
                continue
            if kind is None:
                rospy.logerr("%s: its type is not installed: calls of it cannot be forwarded", self._service)
                return
            self._proxy = rospy.ServiceProxy(self._service, kind)
            self._offered = rospy.Service(self._name, kind, self._forwarded)
            return

    def _forwarded(self, request):
        self._forwarder.called(request)
        try:
            answer = self._proxy(request)
        except rospy.ServiceException as cause:
            self._forwarder.failed(cause)
            raise  # the caller sees a call that failed, as it would have without us
        self._forwarder.answered(request, answer)
        return answer

    def end(self):
        self._ending.set()
        if self._offered:
            self._offered.shutdown("the recorder ends")
