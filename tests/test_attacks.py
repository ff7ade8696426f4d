"""What a team could leave out, put in or state itself: by command, it never raises the score that counts.

The table of docs/authority.md is made of these; `--update-golden` rewrites it.
"""

from __future__ import annotations

import base64
import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from decimal import Decimal
from hashlib import sha256
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml

from ariac_score import Trial
from ariac_score.cli import main
from ariac_score.redteam.attempt import Aim
from ariac_score.redteam.honest import honest_log
from ariac_score.redteam.search import search
from ariac_score.redteam.tactics import TACTICS
from ariac_score.results.signing import make_keys
from ariac_score.testing import Recorded, write_bag
from ariac_score.testing.copies import Copy, changed, fields_of
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages
from ariac_score_ariac.work import KitSubmission

# Each attack is scored two or three times by command; a busy machine takes minutes for all of them.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/authority.md"
LOG_MAP = ROOT / "rules/ariac2020/log_map.yaml"
BEGIN, END = "<!-- attacks: written by tests/test_attacks.py -->\n", "<!-- end of attacks -->\n"

ORIGIN_NS = 1_700_000_000_000_000_000
SNAPSHOT, EVENTS, SUBMISSIONS = "/snapshot", "/ariac_score/events", "/ariac_score/submissions"
ORDERS, STATE = "/ariac/orders", "/ariac/competition_state"

RECORDING = "7f3c" * 8

Change = Callable[[Copy], Copy]


def ns(t_s: float) -> int:
    return ORIGIN_NS + round(t_s * 1e9)


def of(topic: str) -> Callable[[Any], bool]:
    return lambda m: bool(m.connection.topic == topic)


def at(topic: str, t_s: float) -> Callable[[Any], bool]:
    return lambda m: m.connection.topic == topic and m.stamp_ns == ns(t_s)


def between(topic: str, first_s: float, last_s: float) -> Callable[[Any], bool]:
    return lambda m: m.connection.topic == topic and ns(first_s) <= m.stamp_ns <= ns(last_s)


def same(copy: Copy) -> Copy:
    return copy


def left_out(which: Callable[[Any], bool]) -> Change:
    return lambda copy: copy.keeping(lambda m: not which(m))


def thinned(topic: str, keep: int, phase: int = 0) -> Change:
    def change(copy: Copy) -> Copy:
        number = count()
        return copy.keeping(lambda m: m.connection.topic != topic or next(number) % keep == phase)

    return change


def distances(value: Callable[[float, float], float], first_s: float = 0.0, last_s: float = 60.0) -> Change:
    """The distances of the snapshots between two times, by time and what they were."""

    def change(copy: Copy) -> Copy:
        def one(message: Any) -> Any:
            if not between(SNAPSHOT, first_s, last_s)(message):
                return message
            fields = fields_of(message)
            t_s = (message.stamp_ns - ORIGIN_NS) / 1e9
            fields.distance_robot_human_operator = value(t_s, fields.distance_robot_human_operator)
            return changed(message, fields)

        return copy.with_changed(one)

    return change


# Honest logs ------------------------------------------------------------------------------------


def recording(folder: Path, trial: Trial, motion: Any = "snapshot", storage: Any = "mcap") -> Copy:
    name = "made.bag" if storage == "ros1" else "made.mcap"
    return Copy.of(write_bag(folder / name, recorded_messages(trial, motion=motion), storage=storage))


def example(folder: Path) -> Copy:
    """The example of the README: 28 points over 1 + 0.4 for one near miss."""
    return recording(folder, kitting_trial())


def twice_seen(folder: Path) -> Copy:
    """The example with robot and human as frames as well, every other one of them."""
    frames = Copy.of(
        write_bag(folder / "frames.mcap", recorded_messages(kitting_trial(), motion="frames"), storage="mcap")
    )
    number = count()
    return example(folder).with_more(m for m in frames.of_topic("/tf") if next(number) % 4 < 2)


def of_two_publishers(folder: Path) -> Copy:
    return recording(folder, kitting_trial(), storage="ros1")


def emptied(folder: Path) -> Copy:
    """The first kit is handed in empty, and again when it is full: the first counts."""
    trial = kitting_trial()
    empty = KitSubmission("order_0_shipment_0", 12.0, (), "agv1")
    return recording(folder, replace(trial, submissions=(empty, *trial.submissions)))


def updated(folder: Path) -> Copy:
    """Before the first kit is handed in, its order is updated: it asks for what is not delivered."""
    made = recording(folder, kitting_trial())
    (first, *_) = made.of_topic(ORDERS)
    fields = fields_of(first)
    fields.order_id += "_update_0"
    for product in fields.shipments[0].products:
        product.type = "disk_part_green"
    return made.with_more([changed(first, fields)._replace(stamp_ns=ns(10.0))])


def collided(folder: Path) -> Copy:
    collision = Recorded(
        EVENTS, "ariac_score_msgs/msg/TrialEvent", ns(20.0), {"kind": "arm_collision", "subject": "arms"}
    )
    more = Copy.of(write_bag(folder / "more.mcap", [collision], storage="mcap"))
    return example(folder).with_more(more.messages)


def ended_early(folder: Path) -> Copy:
    """The competition ends at 25 s, before the second kit is handed in."""
    return example(folder).with_changed(lambda m: m._replace(stamp_ns=ns(25.0)) if at(STATE, 38.0)(m) else m)


REQUIRED_M = 0.9433981 * 2.5 + 0.5 + 2.6
"""What the paper's formula asks for: human 0.943 m/s, robot 0.5 m/s."""


def dashed(folder: Path) -> Copy:
    """Three samples are too near, at 20 s, by 12 mm at most; nothing else is."""
    return distances(lambda t_s, _: REQUIRED_M - 0.012 + 0.8 * min(abs(t_s - 20.0), 4.0))(example(folder))


def under_a_room(folder: Path) -> Copy:
    """Robot and human as frames at 100 Hz, the human's under a constant one, and a dash of 0.4 s."""
    made = recording(folder, kitting_trial(), "frames")
    room: list[Any] = []

    def one(message: Any) -> Any:
        if message.connection.topic != "/tf":
            return message
        fields = fields_of(message)
        (sent,) = fields.transforms
        if sent.child_frame_id != "human_base":
            return message
        t_s = (message.stamp_ns - ORIGIN_NS) / 1e9
        sent.transform.translation.y = 9.0 - max(0.0, 0.7 - 3.5 * abs(t_s - 20.25))
        sent.header.frame_id = "room"
        new = changed(message, fields)
        sent.header.frame_id, sent.child_frame_id = "world", "room"
        translation = sent.transform.translation
        translation.x = translation.y = translation.z = 0.0
        room.append(changed(message, fields))
        return new

    return made.with_changed(one).with_more(room)


def stated_often(folder: Path) -> Copy:
    """The example of a simulator that says ten times a second what is going on: `go` from 0.5 s on."""
    words = [(0.1 * k, "init" if k < 5 else "go" if k < 380 else "end_game") for k in range(400)]
    said = [Recorded(STATE, "std_msgs/msg/String", ns(t_s), {"data": word}) for t_s, word in words]
    more = Copy.of(write_bag(folder / "states.mcap", said, storage="mcap"))
    return left_out(of(STATE))(example(folder)).with_more(more.messages)


# Attacks ----------------------------------------------------------------------------------------


def of_human_at(rate_hz: float) -> Change:
    """The human's frame is kept that often, in the middle between two dashes."""

    def kept(message: Any) -> bool:
        if message.connection.topic != "/tf":
            return True
        (sent,) = fields_of(message).transforms
        others = sent.child_frame_id != "human_base"
        return bool(others or (message.stamp_ns - ns(0.0)) % round(1e9 / rate_hz) == 0)

    return lambda copy: copy.keeping(kept)


def ghost(copy: Copy) -> Copy:
    """A second node says for three seconds, 20 m away, that all is well."""
    original = next(m.connection for m in copy.messages if m.connection.topic == SNAPSHOT)
    other = replace(original, publisher="/ghost")
    more = []
    for message in copy.messages:
        if between(SNAPSHOT, 18.5, 21.5)(message):
            fields = fields_of(message)
            fields.distance_robot_human_operator = 20.0
            more.append(
                changed(message, fields)._replace(connection=other, stamp_ns=message.stamp_ns + 3_000_000)
            )
    return copy.with_more(more)


def reparented(copy: Copy) -> Copy:
    """The human's frame hangs under one that is far away, for the time of the dash."""

    def one(message: Any) -> Any:
        if message.connection.topic != "/tf" or not ns(20.0) <= message.stamp_ns <= ns(20.5):
            return message
        fields = fields_of(message)
        (sent,) = fields.transforms
        if sent.child_frame_id == "human_base":
            sent.header.frame_id = "far_away"
        return changed(message, fields)

    return copy.with_changed(one)


def lifted(copy: Copy) -> Copy:
    """The human is 50 m further away for the time of the dash."""

    def one(message: Any) -> Any:
        if message.connection.topic != "/tf" or not ns(20.0) <= message.stamp_ns <= ns(20.5):
            return message
        fields = fields_of(message)
        (sent,) = fields.transforms
        if sent.child_frame_id == "human_base":
            sent.transform.translation.y += 50.0
        return changed(message, fields)

    return copy.with_changed(one)


def replayed(first_s: float, last_s: float, lag_s: float) -> Change:
    """Over a stretch is played what all frames did so long before, stamped anew."""
    lag_ns = round(lag_s * 1e9)

    def change(copy: Copy) -> Copy:
        before = {}
        for message in copy.messages:
            if message.connection.topic == "/tf":
                (sent,) = fields_of(message).transforms
                before[message.stamp_ns, sent.child_frame_id] = sent.transform

        def one(message: Any) -> Any:
            if message.connection.topic != "/tf" or not ns(first_s) <= message.stamp_ns <= ns(last_s):
                return message
            fields = fields_of(message)
            (sent,) = fields.transforms
            sent.transform = before[message.stamp_ns - lag_ns, sent.child_frame_id]
            return changed(message, fields)

        return copy.with_changed(one)

    return change


def frames(folder: Path) -> Copy:
    """The example recorded as frames at 100 Hz, with a dash of the human of 0.1 s for its near miss."""
    made = recording(folder, kitting_trial(), motion="frames")

    def one(message: Any) -> Any:
        if message.connection.topic != "/tf":
            return message
        fields = fields_of(message)
        (sent,) = fields.transforms
        if sent.child_frame_id != "human_base":
            return message
        t_s = (message.stamp_ns - ORIGIN_NS) / 1e9
        sent.transform.translation.y = 9.0 - max(0.0, 0.2 - 3.5 * abs(t_s - 20.02))
        return changed(message, fields)

    return made.with_changed(one)


def frames_at(rate_hz: float) -> Change:
    """All frames are kept that often."""
    return lambda copy: copy.keeping(
        lambda m: m.connection.topic != "/tf" or (m.stamp_ns - ns(0.0)) % round(1e9 / rate_hz) == 0
    )


def another_clock(copy: Copy) -> Copy:
    """A simulated clock of half the pace is put in: all that was too near was so for half as long."""
    ticks = []
    for k in range(401):
        ran_ns = 10**11 + k * 5 * 10**7
        given = {"clock": {"sec": ran_ns // 10**9, "nanosec": ran_ns % 10**9}}
        ticks.append(Recorded("/clock", "rosgraph_msgs/msg/Clock", ns(0.1 * k), given))
    with TemporaryDirectory() as folder:
        return copy.with_more(Copy.of(write_bag(Path(folder) / "ticks.mcap", ticks, storage="mcap")).messages)


def shifted(copy: Copy) -> Copy:
    """The near miss is moved behind the end of the competition, all snapshots with it."""
    return copy.with_changed(
        lambda m: m._replace(stamp_ns=m.stamp_ns + 19_000_000_000) if m.connection.topic == SNAPSHOT else m
    )


def on_time(copy: Copy) -> Copy:
    """The second kit is said to have been handed in before the end."""
    return copy.with_changed(lambda m: m._replace(stamp_ns=ns(24.0)) if at(SUBMISSIONS, 31.0)(m) else m)


def unannounced(copy: Copy) -> Copy:
    return copy.keeping(lambda m: m.connection.topic != ORDERS)


def easier(copy: Copy) -> Copy:
    """The orders that the log announces ask for what was delivered."""

    def one(message: Any) -> Any:
        if message.connection.topic != ORDERS:
            return message
        fields = fields_of(message)
        for product in fields.shipments[0].products:
            product.type = product.type.replace("gear_part_blue", "gear_part_green")
        return changed(message, fields)

    return copy.with_changed(one)


def configuration(second_gear: str) -> str:
    def product(kind: str, x: float, y: float, yaw: float) -> dict[str, Any]:
        return {"type": kind, "pose": {"xyz": [x, y, 0.0], "rpy": [0.0, 0.0, yaw]}}

    kits = (
        {
            "part_0": product("gear_part_red", 0.1, 0.15, 0.0),
            "part_1": product(second_gear, -0.1, 0.15, 0.7853981633974483),
            "part_2": product("piston_rod_part_green", 0.0, -0.15, 0.0),
        },
        {
            "part_0": product("pulley_part_red", 0.12, 0.1, 0.0),
            "part_1": product("disk_part_blue", -0.12, -0.1, -1.5707963267948966),
        },
    )
    orders = {
        f"order_{k}": {"shipment_count": 1, "priority": 1, "products": kit, "destinations": [f"agv{k + 1}"]}
        for k, kit in enumerate(kits)
    }
    return yaml.safe_dump({"orders": orders})


@dataclass(frozen=True)
class Attack:
    """One row of the table.

    Attributes:
        name: What is done, in words of the page.
        log: The honest log.
        change: What is done to it.
        honest: The score of which counts what it is worth at worst.
        counts: The same of what is handed in, or words of the refusal.
        shows: What shows it, in words of the page.
        rules: What the rules say besides those of the paper; `KEY` is the recorder's.
        brought: A configuration that lies in the team's folder.
        given: The one that the organiser gives.
    """

    name: str
    log: Callable[[Path], Copy]
    change: Change
    honest: str
    counts: str
    shows: str
    rules: str = ""
    brought: str = ""
    given: str = ""


ATTESTED = "completeness: attested\nauthority: {recorder_keys: [KEY]}\n"
ORDERED = configuration("gear_part_blue")
HONEST = "19.761677"
WINDOW = "when it was is stated by nobody: open"
PAYS_FOR_TIME = "score: 20 / (1 + trial.duration_s / 100)\n"
MANIFEST = "the recorder's manifest, with `completeness: attested`"
MISSING, MOVED, PUT_IN = (
    f"it is not what its recorder received: {how}: " for how in ("missing", "moved", "put in")
)
JUMPS = "what jumps faster than anything moves is not believed"

ATTACKS = (
    # Left out: what says when it was, or what would have cost points.
    Attack(
        "start and end of the competition left out", ended_early, left_out(of(STATE)), "4.940419", "0", WINDOW
    ),
    Attack("its end left out", ended_early, left_out(at(STATE, 25.0)), "4.940419", "0", WINDOW),
    Attack(
        "the same, where rules pay for a short time",
        example,
        left_out(at(STATE, 38.0)),
        "14.492754",  # 38 s: nothing but the first message says that it started by 0.5 s
        "0",
        WINDOW,
        PAYS_FOR_TIME,
    ),
    Attack(
        "what says for 8 s that it runs left out, under the same rules",
        stated_often,
        left_out(between(STATE, 0.45, 8.45)),
        "14.534884",  # 37.6 s, from the last `init` on
        "14.534884",
        "it started at some moment of the silence: open",
        PAYS_FOR_TIME,
    ),
    Attack(
        "all events left out", collided, left_out(of(EVENTS)), "0", "0", "nobody watched for collisions: open"
    ),
    Attack(
        "one arm collision left out", collided, left_out(at(EVENTS, 20.0)), "0", MISSING, MANIFEST, ATTESTED
    ),
    Attack(
        "the first, empty submission left out",
        emptied,
        left_out(at(SUBMISSIONS, 12.0)),
        "14.821258",
        MISSING,
        MANIFEST,
        ATTESTED,
    ),
    Attack(
        "all submissions left out",
        emptied,
        left_out(of(SUBMISSIONS)),
        "14.821258",
        "0",
        "what was handed in is open",
    ),
    Attack(
        "a late submission moved before the end", ended_early, on_time, "4.940419", MOVED, MANIFEST, ATTESTED
    ),
    Attack(
        "the update of an order left out",
        updated,
        left_out(at(ORDERS, 10.0)),
        "14.821258",
        MISSING,
        MANIFEST,
        ATTESTED,
    ),
    # Left out: samples.
    Attack(
        "three samples of a near miss left out, 40 ms at 100 Hz",
        dashed,
        left_out(between(SNAPSHOT, 19.985, 20.015)),
        "19.999958",
        "19.967239",
        "it is longer than 1.5 times the usual interval: a gap, with bounds",
    ),
    Attack(
        "every second sample left out",
        example,
        thinned(SNAPSHOT, 2),
        HONEST,
        "1.520791",
        "the log map states the rate (`rate_hz`): each interval is a gap",
    ),
    Attack(
        "three of four samples left out, and with them a near miss of 30 ms",
        dashed,
        thinned(SNAPSHOT, 4, 2),
        "19.999958",
        "1.530852",
        "the same",
    ),
    Attack(
        "the same, where no log map states a rate",
        dashed,
        thinned(SNAPSHOT, 4, 2),
        "1.536393",
        "1.531496",
        "`between_samples: bounded`, for the honest log as well",
        "between_samples: bounded\nlog_map: NO_RATE\n",
    ),
    Attack(
        "three of four frames left out of an attested log, whose log map states no rate",
        frames,
        frames_at(25),
        "19.962815",
        "1.54556",
        "the recorder's manifest: each interval is a gap",
        ATTESTED,
    ),
    Attack(
        "the same of a log that nobody attests, whose log map states the rate of frames",
        frames,
        frames_at(25),
        "19.983044",
        "1.546225",
        "`rate_hz` of the frames: each interval is a gap",
        "log_map: RATED_FRAMES\n",
    ),
    Attack(
        "a human's frame at 2 Hz under a constant one at 100 Hz, and so a dash of 0.4 s left out",
        under_a_room,
        of_human_at(2),
        "19.865964",
        "1.582762",
        "a chain of frames is seen when its slowest is",
    ),
    Attack(
        "all snapshots left out, so that frames at 50 Hz stand in for them",
        twice_seen,
        left_out(of(SNAPSHOT)),
        HONEST,
        MISSING,
        MANIFEST,
        ATTESTED,
    ),
    # Put in, or changed.
    Attack(
        "a second publisher says that all is well",
        of_two_publishers,
        ghost,
        HONEST,
        "0",
        "what two publishers contradict each other in is not believed",
    ),
    Attack("the same, in a format without publishers", example, ghost, HONEST, "12.603639", JUMPS),
    Attack(
        "50 m more for three seconds",
        example,
        distances(lambda _, m: m + 50.0, 18.5, 21.5),
        HONEST,
        "0",
        JUMPS,
    ),
    Attack(
        "50 m more in one sample",
        example,
        distances(lambda _, m: m + 50.0, 20.0, 20.0),
        HONEST,
        "19.761036",
        JUMPS,
    ),
    Attack(
        "0.6 m more for a tenth of a second, and so a near miss of 30 ms left out",
        dashed,
        distances(lambda _, m: m + 0.6, 19.95, 20.05),
        "19.999958",
        "0",
        JUMPS,
    ),
    Attack(
        "50 m more in a human's frame during the dash",
        under_a_room,
        lifted,
        "19.865964",
        "0",
        JUMPS,
    ),
    Attack(
        "an earlier stretch of all frames played over the dash",
        under_a_room,
        replayed(18.5, 21.5, 4.0),
        "19.865964",
        "0",
        "what comes back to the last bit is not believed",
    ),
    Attack(
        "all frames of half a second before played over a dash of 0.1 s",
        frames,
        replayed(19.92, 20.12, 0.5),
        "19.962815",
        "0",
        JUMPS,
    ),
    Attack(
        "a simulated clock of half the pace put in",
        example,
        another_clock,
        HONEST,
        "nothing in its heartbeats shows that its '/clock' is that of the simulation",
        MANIFEST,
        ATTESTED,
    ),
    Attack("all motion stamped 19 s later", example, shifted, HONEST, "0", "what then lacks is a gap"),
    Attack(
        "another parent for the human's frame, during the dash",
        under_a_room,
        reparented,
        "19.865964",
        "has 2 parents: 'far_away', 'room'",
        "a frame has one parent",
    ),
    Attack(
        "the near miss written anew, smoothly, 3 m further away",
        example,
        distances(lambda t_s, m: m + 3.0 * max(0.0, 1.0 - abs(t_s - 20.0) / 6.0)),
        HONEST,
        PUT_IN,
        MANIFEST,
        ATTESTED,
    ),
    # Said by somebody else.
    Attack(
        "a `trial.yaml` in the team's folder orders what was delivered",
        lambda folder: unannounced(example(folder)),
        same,
        HONEST,
        "'organiser.yaml' (organiser) says 'gear_part_blue', 'trial.yaml' (run) says 'gear_part_green'",
        "the organiser's `--trial-config`",
        "",
        configuration("gear_part_green"),
        ORDERED,
    ),
    Attack(
        "the log announces orders of what was delivered",
        example,
        easier,
        HONEST,
        "gear_part_green",
        "the organiser's `--trial-config`",
        "",
        "",
        ORDERED,
    ),
)


# By command -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Desk:
    """Where logs are scored by command.

    Attributes:
        folder: For its files.
        sign: Signs a manifest as the organiser's recorder does.
        key: The public key for it.
        capsys: What the command prints.
    """

    folder: Path
    sign: Callable[[str], str]
    key: str
    capsys: pytest.CaptureFixture[str]

    def score(self, name: str, log: Copy, attack: Attack, *, brought: str = "") -> tuple[Decimal | None, str]:
        """The score that counts, or the error."""
        run = self.folder / name / "run"
        run.mkdir(parents=True)
        log.write(run / "run")
        more: list[str] = []
        if brought:
            (run / "trial.yaml").write_text(brought, encoding="utf-8")
        if attack.given:
            config = self.folder / name / "organiser.yaml"
            config.write_text(attack.given, encoding="utf-8")
            more = ["--trial-config", str(config)]
        out = self.folder / name / "result.json"
        code = main(["score", str(run), "--rules", self._rules(attack.rules), *more, "-o", str(out)])
        said = self.capsys.readouterr().err
        if not out.exists():
            assert code == 6, said
            return None, said
        result = json.loads(out.read_text(encoding="utf-8"))
        return Decimal(str(result["score"])), ""

    def _rules(self, more: str) -> str:
        if not more:
            return "paper2020.published"
        given = LOG_MAP.read_text("utf-8")
        log_maps = {
            "NO_RATE": given.replace("    rate_hz: 100", "    #"),
            "RATED_FRAMES": re.sub(r"(match: (?:torso|human)_base,)", r"\1 rate_hz: 100,", given),
        }
        rules = self.folder / "rules.yaml"
        text = more.replace("KEY", f"'{self.key}'")
        for name, content in log_maps.items():
            (self.folder / f"{name}.yaml").write_text(content, encoding="utf-8")
            text = text.replace(name, str(self.folder / f"{name}.yaml"))
        rules.write_text(
            f"extends: paper2020.published\nid: ours\ntitle: Ours\nsource: here\n{text}", encoding="utf-8"
        )
        return str(rules)

    def attested(self, copy: Copy) -> Copy:
        """The log with what the recorder of docs/completeness.md publishes."""
        beats, chain, counted = [], RECORDING, Counter[str]()
        for second in range(41):
            inside = [m for m in copy.messages if ns(second) <= m.stamp_ns < ns(second + 1)]
            topics = {
                topic: {"first": counted[topic] + 1, "digests": "".join(map(digest, came))}
                for topic in sorted({m.connection.topic for m in inside})
                if (came := [m for m in inside if m.connection.topic == topic])
            }
            counted.update(m.connection.topic for m in inside)
            body = compact({"recording": RECORDING, "sequence": second + 1, "topics": topics})
            chain = sha256((chain + body).encode()).hexdigest()
            fields = {"recording": RECORDING, "sequence": second + 1, "body": body, "chain": chain}
            beats.append(of_recorder("heartbeat", "Heartbeat", second + 1, fields))
        manifest = compact(
            {
                "format": "ariac-score-manifest/1",
                "recording": RECORDING,
                "closed": True,
                "heartbeats": {"count": len(beats), "chain": chain},
                "topics": {topic: {"count": counted[topic]} for topic in sorted(counted)},
            }
        )
        fields = {"recording": RECORDING, "closed": True, "body": manifest, "signature": self.sign(manifest)}
        beats.append(of_recorder("manifest", "Manifest", 41.5, fields))
        return copy.with_more(Copy.of(write_bag(self.folder / "m.mcap", beats, storage="mcap")).messages)


def compact(content: Any) -> str:
    return json.dumps(content, sort_keys=True, separators=(",", ":"))


def digest(message: Any) -> str:
    return base64.b64encode(sha256(message.payload).digest()[:12]).decode()


def of_recorder(name: str, kind: str, t_s: float, fields: dict[str, Any]) -> Recorded:
    return Recorded(f"/ariac_score/{name}", f"ariac_score_msgs/msg/{kind}", ns(t_s) - 1, fields)


def desk_with_key(folder: Path, capsys: pytest.CaptureFixture[str]) -> Desk:
    minisign = pytest.importorskip("minisign")
    secret, public = make_keys(folder / "organiser.key")
    key = minisign.SecretKey.from_bytes(secret.read_bytes())
    return Desk(
        folder,
        lambda body: bytes(key.sign(body.encode(), prehash=False, trusted_comment="t")).decode(),
        public.read_text(encoding="utf-8").splitlines()[1],
        capsys,
    )


@pytest.mark.parametrize("log", [collided, emptied], ids=lambda log: log.__name__)
def test_the_adversary_gains_nothing_from_an_attested_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], log: Callable[[Path], Copy]
) -> None:
    desk = desk_with_key(tmp_path, capsys)
    path = desk.attested(log(tmp_path)).write(tmp_path / "log")
    lies = [tactic.name for tactic in TACTICS if tactic.aim is Aim.LIE]

    found = search(honest_log(path, desk._rules(ATTESTED)), budget=40, tactics=lies)

    assert [(one.says, one.before, one.after) for one in found.exploits] == []
    assert sum(tally.refused for tally in found.tallies) > 20


def test_no_attack_brings_more_than_honesty(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    subtests: pytest.Subtests,
    update_golden: bool,
) -> None:
    minisign = pytest.importorskip("minisign")
    secret, public = make_keys(tmp_path / "organiser.key")
    key = minisign.SecretKey.from_bytes(secret.read_bytes())
    rows = []
    for number, attack in enumerate(ATTACKS):
        desk = Desk(
            tmp_path / str(number),
            lambda body: bytes(key.sign(body.encode(), prehash=False, trusted_comment="t")).decode(),
            public.read_text(encoding="utf-8").splitlines()[1],
            capsys,
        )
        desk.folder.mkdir()
        with subtests.test(attack.name):
            honest_log = attack.log(desk.folder)
            if attack.rules == ATTESTED:
                honest_log = desk.attested(honest_log)
            honest, said = desk.score("honest", honest_log, attack)
            assert honest == Decimal(attack.honest), said
            found, said = desk.score("attack", attack.change(honest_log), attack, brought=attack.brought)
            if found is None:
                assert attack.counts in said
            else:
                assert found <= honest
                assert found == Decimal(attack.counts)
        counts, believed = attack.counts if attack.counts[0].isdigit() else "refused", ""
        if attack.rules == ATTESTED:  # what the same brings where the rules do not ask who recorded it
            (desk.folder / "again").mkdir()
            unattested = attack.change(attack.log(desk.folder / "again"))
            score, said = desk.score("believed", unattested, replace(attack, rules=""))
            assert score is not None, said
            believed = f"{score.normalize():f}"
        rows.append(f"| {attack.name} | {attack.honest} | {counts} | {believed} | {attack.shows} |")
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    written, _, after = rest.partition(END)
    table = "\n".join(
        (
            "| what is done | honest | counts | if nobody asks | what shows it |",
            "|---|---:|---:|---:|---|",
            *rows,
            "",
        )
    )
    if update_golden:
        PAGE.write_text(f"{before}{BEGIN}{table}{END}{after}", encoding="utf-8")
    else:
        assert written == table
