"""What recorders do to a recording, and what a command says of it: the table of docs/recording.md.

Each recording is the honest example with one thing wrong. `--update-golden` rewrites the table.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.testing import Recorded, write_bag
from ariac_score.testing.bags import Storage
from ariac_score.testing.copies import Copy, changed, fields_of
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "logs")]
from test_attacks import ATTESTED, desk_with_key, recording  # noqa: E402
from test_service_events import trial_of  # noqa: E402

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parents[1] / "docs/recording.md"
BEGIN = "<!-- recordings: written by tests/test_recordings_as_made.py -->\n"
END = "<!-- end of recordings -->\n"
ORIGIN_NS = 1_700_000_000_000_000_000
S = 10**9
SNAPSHOT, STATE, TF = "/snapshot", "/ariac/competition_state", "/tf"

Messages = list[Recorded]


def by_snapshots() -> Messages:
    return recorded_messages(kitting_trial())


def by_frames() -> Messages:
    return recorded_messages(kitting_trial(), motion="frames")


def in_order(messages: Sequence[Recorded]) -> Messages:
    return sorted(messages, key=lambda m: m.t_ns)


def since_s(message: Recorded) -> float:
    return (message.t_ns - ORIGIN_NS) / S


def later(messages: Messages, topic: str, arrives_s: Callable[[float], float]) -> Messages:
    """The messages of a topic reach the recorder later; what their headers say stays."""
    return in_order(
        [
            replace(m, t_ns=ORIGIN_NS + round(arrives_s(since_s(m)) * S)) if m.topic == topic else m
            for m in messages
        ]
    )


def in_bursts(t_s: float) -> float:
    """Nothing for 0.3 s, then all of it."""
    return -(-t_s // 0.3) * 0.3


def stalled(t_s: float) -> float:
    """Each two seconds nothing arrives for 45 ms."""
    return max(t_s, t_s // 2.0 * 2.0 + 0.045)


def slowed(messages: Messages, rate: float = 0.85) -> Messages:
    """By the wall clock of a simulation that runs slower."""
    return [replace(m, t_ns=ORIGIN_NS + round(since_s(m) / rate * S)) for m in messages]


def ticks(seconds: Sequence[float], rate: float = 0.85) -> Messages:
    """What `/clock` said, as the wall clock has it."""
    return [
        Recorded(
            "/clock",
            "rosgraph_msgs/msg/Clock",
            ORIGIN_NS + round(t_s / rate * S),
            {"clock": stamp(100.0 + t_s)},
        )
        for t_s in seconds
    ]


def stamp(t_s: float) -> dict[str, int]:
    return {"sec": int(t_s), "nanosec": round(t_s % 1 * S)}


def joints(rate: float = 0.85) -> Messages:
    return [
        Recorded(
            "/joint_states",
            "sensor_msgs/msg/JointState",
            ORIGIN_NS + round(k / rate * S),
            {"header": {"stamp": stamp(100.0 + k), "frame_id": ""}},
        )
        for k in range(40)
    ]


def numbered(messages: Messages) -> Messages:
    """Snapshots as their publisher numbers them, of which three are lost."""
    numbers = count(1)
    found = [replace(m, sequence=next(numbers)) if m.topic == SNAPSHOT else m for m in messages]
    return [m for m in found if not 1200 <= m.sequence < 1203]


def seq_in_header(messages: Messages) -> Messages:
    """Frames with `header.seq`, each frame by its own publisher, and three of them are lost."""
    numbers = {"torso_base": count(1), "human_base": count(1)}

    def one(message: Recorded) -> Recorded:
        if message.topic != TF:
            return message
        (sent,) = message.fields["transforms"]
        name = sent["child_frame_id"]
        header = {**sent["header"], "seq": next(numbers[name])}
        return replace(message, fields={"transforms": [{**sent, "header": header}]}, publisher=f"/{name}")

    def is_lost(message: Recorded) -> bool:
        (sent,) = message.fields.get("transforms", [{"child_frame_id": ""}])
        return sent["child_frame_id"] == "human_base" and 1200 <= sent["header"]["seq"] < 1203

    return [m for m in map(one, messages) if not is_lost(m)]


def of_two_nodes(messages: Messages) -> Messages:
    """A second node says for a second, from 15 s on, that somebody is 20 m away."""
    own = [replace(m, publisher="/cell") if m.topic == SNAPSHOT else m for m in messages]
    others = [
        replace(
            m,
            publisher="/ghost",
            t_ns=m.t_ns + 3_000_000,
            fields={**m.fields, "distance_robot_human_operator": 20.0},
        )
        for m in own
        if m.topic == SNAPSHOT and 15.0 <= since_s(m) < 16.0
    ]
    return in_order([*own, *others])


def jumping(messages: Messages) -> Messages:
    """One distance is 50 m more."""
    return [
        replace(m, fields={**m.fields, "distance_robot_human_operator": 60.0})
        if m.topic == SNAPSHOT and abs(since_s(m) - 10.0) < 0.004
        else m
        for m in messages
    ]


def announced_twice(messages: Messages) -> Messages:
    """The first order is announced again, and asks for something else."""
    first = next(m for m in messages if m.topic == "/ariac/orders")
    (shipment,) = first.fields["shipments"]
    products = [{**p, "type": "disk_part_green"} for p in shipment["products"]]
    fields = {**first.fields, "shipments": [{**shipment, "products": products}]}
    return in_order([*messages, replace(first, t_ns=ORIGIN_NS + 9 * S, fields=fields)])


def begun_late(messages: Messages) -> Messages:
    """The state is published each second, and the recording begins at 5 s."""
    go = next(m for m in messages if m.topic == STATE)
    words = [replace(go, t_ns=ORIGIN_NS + k * S) for k in range(1, 38)]
    return in_order([m for m in (*messages, *words) if since_s(m) >= 5.0])


def watched_late(messages: Messages) -> Messages:
    """That collisions are watched for is said at 15 s."""
    return in_order(
        [replace(m, t_ns=ORIGIN_NS + 15 * S) if m.fields.get("kind") == "watching" else m for m in messages]
    )


def silent(messages: Messages) -> Messages:
    """That the competition runs is said at 13 s, and since 0.5 s nothing."""
    go = next(m for m in messages if m.topic == STATE)
    others = [m for m in messages if m is not go]
    return in_order([replace(go, fields={"data": "init"}), *others, replace(go, t_ns=ORIGIN_NS + 13 * S)])


def denied(messages: Messages) -> Messages:
    """The human is said to stand from 17 to 23 s, while her frame moves on."""
    stands = [
        replace(m, fields={**m.fields, "human_operator_speed": 0.0})
        if m.topic == SNAPSHOT and 17.0 <= since_s(m) < 23.0
        else m
        for m in messages
    ]
    return in_order([*stands, *(m for m in by_frames() if m.topic.startswith(TF))])


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Attributes:
        name: What is wrong, in words of the page.
        made: Its messages.
        says: A pattern of what the command prints.
        means: The same in words of the page.
        code: Exit code: 0, or 6 where it is refused.
        rules: What the rules say besides those of the paper.
        storage: The format.
        like: A recording with the same score.
    """

    name: str
    made: Callable[[], Messages]
    says: str
    means: str
    code: int = 0
    rules: str = ""
    storage: Storage = "mcap"
    like: Callable[[], Messages] | None = None


NO_SNAPSHOTS = "log_map: ariac2020\n"
"""Of recordings that have frames alone."""

ROWS = (
    Row(
        "frames with stamps reach the recorder in bursts, up to 0.3 s late",
        lambda: later(by_frames(), TF, in_bursts),
        r"log time$",
        "the score that they have when they are on time",
        rules=NO_SNAPSHOTS,
        like=by_frames,
    ),
    Row(
        "snapshots without stamps are held up for 45 ms every two seconds",
        lambda: later(by_snapshots(), SNAPSHOT, stalled),
        r"^undecided: 24 gaps of 10 to 60 ms on /snapshot, stamped on arrival up to 60 ms late: at most ",
        "24 gaps of 10 to 60 ms on /snapshot, stamped on arrival up to 60 ms late: at most … points",
        6,
    ),
    Row(
        "30 s of a simulation took 35 s of the recorder's clock, with `/clock`",
        lambda: in_order([*slowed(by_snapshots()), *ticks([k / 10 for k in range(401)])]),
        r"simulated time$",
        "the score of the simulation's own times",
        like=by_snapshots,
    ),
    Row(
        "the same without `/clock`, beside `/joint_states`",
        lambda: in_order([*slowed(by_snapshots()), *joints()]),
        r"on topic /joint_states its headers say 100000000000 ns where .*\n.*record /clock too",
        "refused: wall time is not that of the nodes; record `/clock`",
        6,
    ),
    Row(
        "the same without `/clock`, beside nothing that has a stamp",
        lambda: slowed(by_snapshots()),
        r"log time \(of recording: .* so a slower or faster simulation would not show\)$",
        "the score of the recorder's times, and that nothing shows whether the nodes were on them",
    ),
    Row(
        "frames are stamped in simulated time, which falls 5 s behind the recorder's, without `/clock`",
        lambda: slowed(by_frames()),
        r"on topic /tf its headers and the recorder drift \+\d\.\d+ s apart.*\n.*record /clock too",
        "refused: events have no stamp of that clock; record `/clock`",
        6,
    ),
    Row(
        "`/clock` stops for 5 s",
        lambda: in_order(
            [*slowed(by_snapshots()), *ticks([k / 10 for k in range(401) if not 200 <= k < 250]), *joints()]
        ),
        r"nobody knows the simulated time of a message on topic /snapshot: .* from the nearest",
        "refused: when things happened in that time is unknown",
        6,
    ),
    Row(
        "three numbered messages are not there (MCAP `sequence`)",
        lambda: numbered(by_snapshots()),
        r"a gap of 40 ms on /snapshot, stamped on arrival up to 40 ms late: "
        r"[^$]*numbers of channel 2 leave out messages in 1 place\(s\).* \(3\)",
        "a gap of 40 ms, and where numbers are left out; an interval",
        6,
    ),
    Row(
        "the same of a frame (`header.seq` of ROS 1)",
        lambda: seq_in_header(by_frames()),
        r"a gap of 40 ms on tf frames: ",
        "likewise",
        6,
        rules=NO_SNAPSHOTS,
        storage="ros1",
    ),
    Row(
        "a second node publishes on `/snapshot` for a second",
        lambda: of_two_nodes(by_snapshots()),
        r"two publishers at a time, /cell \(4001\) and /ghost \(100\), from 15\.003 to 15\.993 s",
        "both by name, with counts; that second is unknown, and an interval",
        6,
        storage="ros1",
    ),
    Row(
        "a distance jumps 50 m in 10 ms",
        lambda: jumping(by_snapshots()),
        r"samples jump faster than anything moves, first at 10\.000 s",
        "not believed, and unknown there; the same score, for nobody can come near in so short a time",
        like=by_snapshots,
    ),
    Row(
        "an order is announced again, with other contents",
        lambda: announced_twice(by_snapshots()),
        r"order 'order_0' is announced twice, with different contents",
        "refused",
        6,
    ),
    Row(
        "the recording starts when the competition already runs",
        lambda: begun_late(by_snapshots()),
        r"its first message already says that the competition runs",
        "an interval: when it started is not shown",
        6,
    ),
    Row(
        "for 12.5 s nothing says whether the competition runs, and then it does",
        lambda: silent(by_snapshots()),
        r"says nothing for 12\.500 s, and then that the competition runs",
        "an interval: when it started is not shown",
        6,
    ),
    Row(
        "that collisions are watched for is said at 15 s",
        lambda: watched_late(by_snapshots()),
        r"watched for from 15\.000 s on only: nobody knows what happened before",
        "an interval: whether there was one is not shown",
        6,
    ),
    Row(
        "the human is said to stand while her frame moves on",
        lambda: denied(by_snapshots()),
        r"says from 16\.\d+ s on that it is less than two thirds as fast as its positions show",
        "how fast she was is unknown; an interval",
        6,
    ),
    Row(
        "the human is faster than the `bounds:` that the rules state",
        by_snapshots,
        r"'human' would need 0\.943 m/s at 16\.010 s, and 'bounds:' of .* states at most 0\.5 m/s",
        "refused, with body, time and bound",
        6,
        "bounds: {human: {max_speed_m_s: 0.5, source: here}, robot: {max_speed_m_s: 1.0, source: here}}\n",
    ),
)


@dataclass(frozen=True)
class Attested:
    """A row about what a recorder attests, under rules that ask for it.

    Attributes:
        name: What is wrong, in words of the page.
        change: Of the messages of the attested log.
        says: What the command prints.
        means: The same in words of the page.
        signed: Whether the manifest is signed.
    """

    name: str
    change: Callable[[Copy], Copy]
    says: str
    means: str
    signed: bool = True


HEARTBEAT, MANIFEST = "/ariac_score/heartbeat", "/ariac_score/manifest"


def edited(copy: Copy) -> Copy:
    """The sixth heartbeat says something else."""
    sixth = copy.of_topic(HEARTBEAT)[5]
    fields = fields_of(sixth)
    fields.body = fields.body.replace('"sequence":6', '"sequence":6,"x":1')
    return copy.with_changed(lambda m: changed(sixth, fields) if m is sixth else m)


def of_another(topic: str, number: int) -> Callable[[Copy], Copy]:
    """One message says that it is of another recording."""

    def change(copy: Copy) -> Copy:
        other = copy.of_topic(topic)[number]
        fields = fields_of(other)
        fields.recording = "beef" * 8
        more = changed(other, fields)
        if topic == MANIFEST:
            return copy.with_changed(lambda m: more if m is other else m)
        return copy.with_more([more._replace(stamp_ns=more.stamp_ns + 5)])

    return change


RECORDERS = (
    Attested(
        "a heartbeat of its recorder was changed",
        edited,
        "completeness is not attested: the chain of its recorder breaks at heartbeat 6",
        "refused: the chain breaks there",
    ),
    Attested(
        "the manifest of another recording",
        of_another(MANIFEST, 0),
        f"its manifest is of recording '{'beef' * 8}', and recording '{'7f3c' * 8}' is in it as well",
        "refused, with both",
    ),
    Attested(
        "two recorders published",
        of_another(HEARTBEAT, 3),
        f"its manifest is of recording '{'7f3c' * 8}', and recording '{'beef' * 8}' is in it as well",
        "refused, with both",
    ),
    Attested(
        "a manifest that nobody signed",
        lambda copy: copy,
        "of its manifest, it is not signed",
        "refused",
        signed=False,
    ),
    Attested(
        "no manifest",
        lambda copy: copy.keeping(lambda m: m.connection.topic not in (HEARTBEAT, MANIFEST)),
        "completeness is not attested: no recorder's manifest is in it",
        "refused",
    ),
)


def said_of(
    folder: Path, log: Path, rules: str, capsys: pytest.CaptureFixture[str], *more: str
) -> tuple[int, str]:
    """What the command prints of a log."""
    if "\n" in rules:
        own = folder / "rules.yaml"
        own.write_text(f"extends: paper2020\nid: ours\ntitle: Ours\nsource: here\n{rules}", encoding="utf-8")
        rules = str(own)
    code = main(["score", str(log), "--rules", rules, *more])
    found = capsys.readouterr()
    return code, found.out + found.err


def test_what_is_wrong_with_a_recording_is_said_by_the_command(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    subtests: pytest.Subtests,
    update_golden: bool,
) -> None:
    rows = []
    for number, row in enumerate(ROWS):
        folder = tmp_path / str(number)
        folder.mkdir()
        with subtests.test(row.name):
            name = "run.bag" if row.storage == "ros1" else "run.mcap"
            log = write_bag(folder / name, row.made(), storage=row.storage)
            code, said = said_of(folder, log, row.rules or "paper2020", capsys)
            assert code == row.code, said
            assert re.search(row.says, said, re.MULTILINE), said
            if row.like is not None:
                other = write_bag(folder / f"like_{name}", row.like(), storage=row.storage)
                _, on_time = said_of(folder, other, row.rules or "paper2020", capsys)
                assert on_time.split()[0] == said.split()[0]
        rows.append(f"| {row.name} | {row.means} |")
    calls = tmp_path / "trial.mcap"
    trial_of(calls, told=False)
    with subtests.test("service events without content"):
        _, said = said_of(tmp_path, calls, "safety", capsys, "--log-map", "ariac2024")
        assert "introspection is set to metadata" in said
    rows.append("| service events without content | that introspection is set to `metadata`; no submission |")
    for number, one in enumerate(RECORDERS, start=len(ROWS)):
        folder = tmp_path / str(number)
        folder.mkdir()
        desk = desk_with_key(folder, capsys)
        with subtests.test(one.name):
            signed = desk if one.signed else replace(desk, sign=lambda _: "")
            log = one.change(signed.attested(recording(folder, kitting_trial()))).write(folder / "log")
            code, said = said_of(folder, log, ATTESTED.replace("KEY", f"'{desk.key}'"), capsys)
            assert code == 6, said
            assert one.says in said
        rows.append(f"| {one.name}, where `completeness: attested` is asked for | {one.means} |")
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    written, _, after = rest.partition(END)
    table = "\n".join(("| in the recording | what the command says |", "|---|---|", *rows, ""))
    if update_golden:
        PAGE.write_text(f"{before}{BEGIN}{table}{END}{after}", encoding="utf-8")
    else:
        assert written == table
