"""What a recorder's manifest proves: what is missing is known, and what does not fit attests nothing."""

from __future__ import annotations

import base64
import hashlib
import json
import stat
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer

from ariac_score import LogError, Result, score_trial
from ariac_score.errors import RuleSetError
from ariac_score.logs.attested import attestation_of
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.results.signing import make_keys
from ariac_score.testing import Recorded, write_bag
from ariac_score.testing.bags import _built
from ariac_score.trial.attestation import Attestation
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages
from ariac_score_ariac.work import KitSubmission

EVENTS = "/ariac_score/events"
RECORDING = "7f3c" * 8
HAPPENED = (
    (0.0, "watching", "arm_collision"),
    (1.0, "competition_started", ""),
    (5.0, "arm_collision", ""),
    (9.0, "competition_ended", ""),
)
HONEST = 0
"""An arm collision takes everything."""


def _json(content: Any) -> str:
    return json.dumps(content, sort_keys=True, separators=(",", ":"))


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def events() -> list[Recorded]:
    return [
        Recorded(
            EVENTS, "ariac_score_msgs/msg/TrialEvent", round(t_s * 1e9), {"kind": kind, "subject": subject}
        )
        for t_s, kind, subject in HAPPENED
    ]


def digest(message: Recorded, ros: Literal[1, 2] = 2) -> str:
    store = bundled_typestore(ros)
    built = _built(store, message.type, message.fields)
    payload = (
        store.serialize_ros1(built, message.type)
        if ros == 1
        else store.serialize_cdr(built, message.type, little_endian=True)
    )
    return base64.b64encode(hashlib.sha256(bytes(payload)).digest()[:12]).decode()


def attested(
    messages: Sequence[Recorded],
    sign: Callable[[str], str],
    notes: Sequence[str] = (),
    listened_s: tuple[int, int] = (0, 10),
    each_s: float = 1.0,
    pace: float | None = None,
    about: Mapping[str, Any] | None = None,
    of: str = "",
    ros: Literal[1, 2] = 2,
    **named: str,
) -> list[Recorded]:
    """The messages with a heartbeat for every second, and a closed manifest: docs/completeness.md.

    Further facts of the manifest are `named`; those `about` each topic, or `of` one, stand beside its count.
    """
    out, chain = list(messages), RECORDING
    counted = dict.fromkeys([m.topic for m in messages], 0)
    each_ns = round(each_s * 1e9)
    begins = range(listened_s[0] * 10**9, listened_s[1] * 10**9, each_ns)
    for number, begins_ns in enumerate(begins, start=1):
        now = [m for m in messages if begins_ns <= m.t_ns < begins_ns + each_ns]
        topics = {}
        for topic in dict.fromkeys(m.topic for m in now):
            came = [digest(m, ros) for m in now if m.topic == topic]
            topics[topic] = {"first": counted[topic] + 1, "digests": "".join(came)}
            counted[topic] += len(came)
        sent = begins_ns + each_ns - 1
        clocks = {"ros_ns": sent} if pace is None else {"ros_ns": round(pace * sent), "wall_ns": sent}
        body = _json({"recording": RECORDING, "sequence": number, **clocks, "topics": topics})
        chain = _sha256(chain + body)
        beat = {"recording": RECORDING, "sequence": number, "body": body, "chain": chain}
        out.append(recorder("heartbeat", "Heartbeat", sent, beat))
    manifest = _json(
        {
            "format": "ariac-score-manifest/1",
            "recording": RECORDING,
            "closed": True,
            "heartbeats": {"count": len(begins), "chain": chain},
            "topics": {
                topic: {"count": count, **((about or {}) if of in ("", topic) else {})}
                for topic, count in counted.items()
            },
            "notes": list(notes),
            **named,
        }
    )
    said = {"recording": RECORDING, "closed": True, "body": manifest, "signature": sign(manifest)}
    out.append(recorder("manifest", "Manifest", 10 * 10**9, said))
    return sorted(out, key=lambda m: m.t_ns)


def recorder(name: str, kind: str, t_ns: int, fields: dict[str, Any]) -> Recorded:
    return Recorded(f"/ariac_score/{name}", f"ariac_score_msgs/msg/{kind}", t_ns, fields)


Signing = tuple[str, Callable[[str], str]]


@pytest.fixture(scope="module")
def signing(tmp_path_factory: pytest.TempPathFactory) -> Signing:
    """A public key, and what signs with it: as minisign did before it hashed what it signs."""
    minisign = pytest.importorskip("minisign")
    secret, public = make_keys(tmp_path_factory.mktemp("keys") / "organiser.key")
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    key = minisign.SecretKey.from_bytes(secret.read_bytes())
    text = public.read_text().splitlines()[1]
    return text, lambda body: bytes(key.sign(body.encode(), prehash=False, trusted_comment="t")).decode()


def rules_in(folder: Path, more: str = "", log_map: str = "ariac2020") -> Path:
    rules = folder / "rules.yaml"
    rules.write_text(
        f"id: clean\ntitle: Clean\nsource: this test\nlog_map: {log_map}\nlevels: [trial]\n"
        "monitors: {clean: {use: ariac.no_event}}\nscore: 10 * holds(clean)\n" + more,
        encoding="utf-8",
    )
    return rules


def scored(folder: Path, messages: Sequence[Recorded], more: str = "") -> Result:
    return score_trial(write_bag(folder / "run.mcap", messages, storage="mcap"), rules_in(folder, more))


def completeness(result: Result) -> str:
    (found,) = (s for s in result.measured.statements if s.fact == "completeness")
    return f"{found.by}: {found.detail}"


def attesting(signing: Signing) -> str:
    return f"completeness: attested\nauthority: {{recorder_keys: ['{signing[0]}']}}\n"


def without(messages: Sequence[Recorded], topic: str, number: int) -> list[Recorded]:
    left_out = [m for m in messages if m.topic == topic][number]
    return [m for m in messages if m is not left_out]


def test_a_log_that_is_whole_is_attested(tmp_path: Path, signing: Signing) -> None:
    found = scored(tmp_path, attested(events(), signing[1]), attesting(signing))

    assert (found.score, found.is_open) == (HONEST, False)
    assert completeness(found) == "recorder: "


def test_an_event_that_is_left_out_is_known_to_be_missing(tmp_path: Path, signing: Signing) -> None:
    """Without a manifest, one event less is worth all points, and nothing shows it but that sentence."""
    bare = scored(tmp_path, without(events(), EVENTS, 2))
    assert (bare.score, completeness(bare)) == (10, "nobody: run.mcap: no recorder's manifest is in it")

    attacked = without(attested(events(), signing[1]), EVENTS, 2)
    open_ = scored(tmp_path, attacked)
    assert open_.is_open
    assert (open_.score or 0) <= HONEST
    with pytest.raises(LogError) as refused:
        scored(tmp_path, attacked, attesting(signing))
    assert "1 message on /ariac_score/events from 5.000 s to 6.000 s" in refused.value.cause


@pytest.mark.parametrize(("pace", "is_attested"), [(1.0, True), (2.0, False), (0.5, False)])
def test_a_log_by_the_wall_clock_of_a_simulation_at_another_pace_is_not_attested(
    tmp_path: Path, signing: Signing, pace: float, is_attested: bool
) -> None:
    """Who leaves out `/clock`, which no recorder attests, makes 27 s of 54 s in a simulation."""
    log = attested(events(), signing[1], pace=pace)

    if is_attested:
        assert completeness(scored(tmp_path, log, attesting(signing))) == "recorder: "
    else:
        with pytest.raises(LogError, match="its times are not those of the simulation") as refused:
            scored(tmp_path, log, attesting(signing))
        assert refused.value.hint
        assert completeness(scored(tmp_path, log)).startswith("nobody: ")


# What a team could leave out --------------------------------------------------------------

KIT = "order_0_shipment_0"


def order(t_s: float, name: str, wanted: str) -> Recorded:
    product = {"type": wanted, "pose": {"orientation": {"w": 1.0}}}
    shipment = {"shipment_type": KIT, "agv_id": "agv1", "products": [product]}
    fields = {"order_id": name, "shipments": [shipment]}
    return Recorded("/ariac/orders", "nist_gear/msg/Order", round(t_s * 1e9), fields)


def submission(t_s: float, *types: str) -> Recorded:
    products = [{"type": kind, "name": f"{kind}_1", "pose": {"orientation": {"w": 1.0}}} for kind in types]
    fields = {"shipment_type": KIT, "agv": "agv1", "products": products}
    return Recorded("/ariac_score/submissions", "ariac_score_msgs/msg/Submission", round(t_s * 1e9), fields)


RED, BLUE = "gear_part_red", "gear_part_blue"
CLEAN = (
    *(e for e in events() if e.fields["kind"] != "arm_collision"),
    order(2.0, "order_0", RED),
    submission(8.0, RED),
)
LEFT_OUT = {
    "an arm collision": events()[2],
    "the first submission, which was empty": submission(4.0),
    "the update of an order": order(5.5, "order_0_update_0", BLUE),
}


@pytest.mark.slow
@pytest.mark.parametrize("secret", LEFT_OUT.values(), ids=LEFT_OUT)
def test_no_message_that_is_left_out_raises_the_score(
    tmp_path: Path, signing: Signing, secret: Recorded
) -> None:
    """Each is worth the whole kit of 4 points to a team that leaves it out, and nothing with a manifest."""
    rules = tmp_path / "rules.yaml"
    text = "extends: ariac2020.as_coded\nid: ours\ntitle: Ours\nsource: this test\n"
    rules.write_text(f"{text}authority: {{recorder_keys: ['{signing[0]}']}}\n", encoding="utf-8")

    def score(*messages: Recorded) -> Result:
        in_order = sorted(messages, key=lambda m: m.t_ns)
        return score_trial(write_bag(tmp_path / "run.mcap", in_order, storage="mcap"), rules)

    honest = attested(sorted((*CLEAN, secret), key=lambda m: m.t_ns), signing[1])
    worth = score(*honest).score
    assert worth is not None
    assert (worth < 4, score(*CLEAN).score) == (True, 4)

    attacked = score(*(message for message in honest if message is not secret))

    assert attacked.is_open
    assert (attacked.score or 0) <= worth
    assert f"1 message on {secret.topic} from " in completeness(attacked)


@pytest.mark.slow
def test_what_does_not_fit_together_attests_nothing(tmp_path: Path, signing: Signing, subtests: Any) -> None:
    whole = attested(events(), signing[1])
    other = [
        replace(m, fields={**m.fields, "recording": "other"}) if m.topic.endswith("manifest") else m
        for m in whole
    ]
    beats = [m for m in whole if m.topic.endswith("heartbeat")]
    edited = [
        replace(m, fields={**m.fields, "body": m.fields["body"].replace(digest(events()[2]), "A" * 16)})
        for m in whole
        if "body" in m.fields
    ]
    elsewhere = [replace(m, fields={**m.fields, "detail": "another trial"}) for m in events()]
    of_that = [m for m in attested(elsewhere, signing[1]) if "body" in m.fields]
    put_in = [*whole, replace(events()[1], t_ns=6 * 10**9)]
    moved = [replace(m, t_ns=8_100_000_000) if m.fields.get("kind") == "arm_collision" else m for m in whole]
    stretched = [replace(m, t_ns=2 * m.t_ns) for m in whole]
    cases = {
        "no manifest": (events(), "no recorder's manifest is in it"),
        "never closed": (whole[:-1], "did not close its manifest"),
        "a heartbeat left out": (without(whole, beats[3].topic, 3), "heartbeat 4 of its recorder is missing"),
        "a heartbeat edited": ([*events(), *edited], "the chain of its recorder breaks at heartbeat 6"),
        "of another recording": (other, "recording '7f3c"),
        "heartbeats and manifest of another trial": (
            sorted([*events(), *of_that], key=lambda m: m.t_ns),
            "missing: 4 messages on /ariac_score/events",
        ),
        "not signed": (attested(events(), lambda _: ""), "it is not signed"),
        "signed by nobody known": (attested(events(), lambda _: "RW"), "its signature is none"),
        "a message moved": (sorted(moved, key=lambda m: m.t_ns), "moved: 1 message on /ariac_score/events"),
        "all messages moved, heartbeats too": (stretched, "its heartbeats were moved, by up to 9.0 s"),
        "a recorder that began late": (
            attested(events(), signing[1], listened_s=(4, 10)),
            "its recorder began at 5.000 s, and the competition at 1.000 s",
        ),
        "one that ended early": (
            attested(events(), signing[1], listened_s=(0, 6)),
            "its recorder ended at 6.000 s, and the competition at 9.000 s",
        ),
        "a message put in": (sorted(put_in, key=lambda m: m.t_ns), "that it did not receive"),
    }
    for name, (messages, words) in cases.items():
        with subtests.test(name), pytest.raises(LogError, match=words):
            scored(tmp_path, messages, attesting(signing))


def test_a_recording_that_is_attested_as_another_trial_or_teams_attests_nothing(
    tmp_path: Path, signing: Signing, subtests: Any
) -> None:
    """A good run of an earlier trial, handed in once more, is whole and signed."""
    messages = attested(events(), signing[1], trial="final_1", team="aurora")
    scored(tmp_path, messages, attesting(signing))  # the rules and the log
    rules, log = tmp_path / "rules.yaml", tmp_path / "run.mcap"
    for trial_id, team, words in (
        ("final_3", "aurora", "recorded trial 'final_1' of team 'aurora', and this is to be trial 'final_3'"),
        ("final_1", "borealis", "and this is to be trial 'final_1' of team 'borealis'"),
        ("final_1", "aurora", ""),
        ("final_1", "", ""),
        ("", "", ""),
    ):
        with subtests.test(trial=trial_id, team=team):
            if words:
                with pytest.raises(LogError, match=words):
                    score_trial(log, rules, trial_id=trial_id, team=team)
            else:
                found = completeness(score_trial(log, rules, trial_id=trial_id, team=team))
                assert found == "recorder: recorded as trial 'final_1' of team 'aurora'"


def test_a_message_that_reached_the_log_a_second_late_was_not_moved(tmp_path: Path, signing: Signing) -> None:
    late = [
        replace(m, t_ns=6_900_000_000) if m.fields.get("kind") == "arm_collision" else m
        for m in attested(events(), signing[1])
    ]

    found = scored(tmp_path, sorted(late, key=lambda m: m.t_ns), attesting(signing))

    assert completeness(found) == "recorder: "


@pytest.mark.parametrize(("late_ms", "is_moved"), [(340, False), (360, True), (-440, False), (-460, True)])
def test_a_message_may_be_as_late_as_the_recorder_pauses_and_a_quarter_of_a_second(
    tmp_path: Path, signing: Signing, late_ms: int, is_moved: bool
) -> None:
    """Heartbeats each 0.1 s: 0.35 s are let pass around the 0.1 s in which it arrived, from 5.0 to 5.1 s."""

    def with_collision_at(t_ns: int, messages: list[Recorded]) -> list[Recorded]:
        found = [replace(m, t_ns=t_ns) if m.fields.get("kind") == "arm_collision" else m for m in messages]
        return sorted(found, key=lambda m: m.t_ns)

    true = with_collision_at(5_095_000_000, events())
    log = with_collision_at(5_095_000_000 + late_ms * 10**6, attested(true, signing[1], each_s=0.1))

    if is_moved:
        with pytest.raises(LogError, match=r"moved: 1 message on /ariac_score/events, by more than 0.35 s"):
            scored(tmp_path, log, attesting(signing))
    else:
        assert completeness(scored(tmp_path, log, attesting(signing))) == "recorder: "


def test_what_the_recorder_noticed_stands_in_the_result(tmp_path: Path, signing: Signing) -> None:
    """As `ariac_score_recorder` words it: the clock stood still, another recorder runs."""
    notes = ["/clock stood still at 3.000 s for 1.0 s or longer", "another recorder publishes here: ffff"]

    found = scored(tmp_path, attested(events(), signing[1], notes), attesting(signing))

    assert completeness(found) == "recorder: " + "; ".join(f"its recorder noted: {note}" for note in notes)


def test_who_asks_for_attested_logs_names_a_key(tmp_path: Path) -> None:
    with pytest.raises(RuleSetError, match="needs the public key"):
        scored(tmp_path, events(), "completeness: attested\n")


# Two subscribers do not begin at once -------------------------------------------------------


def repeated(topic: str = "/ariac/agv1/state", word: str = "ready_to_deliver") -> list[Recorded]:
    """A state ten times a second; the competition starts at 1 s."""
    times_s = [0.15 + tenth / 10 for tenth in range(95)]
    return [Recorded(topic, "std_msgs/msg/String", round(t_s * 1e9), {"data": word}) for t_s in times_s]


def in_order(*messages: Recorded) -> list[Recorded]:
    return sorted(messages, key=lambda m: m.t_ns)


def test_what_the_log_heard_before_its_recorder_did_is_not_read(tmp_path: Path, signing: Signing) -> None:
    """Here the recorder hears the AGV half a second after the bag. What it did not hear is no evidence."""
    unheard, heard = repeated()[:5], repeated()[5:]
    log = attested(in_order(*events(), *heard), signing[1], each_s=0.1)

    found = scored(tmp_path, in_order(*log, *unheard), attesting(signing))
    assert (
        completeness(found) == "recorder: not read: 5 messages from before its recorder heard who sent them"
    )

    # So nobody gains by one that he puts there, such as that somebody watched.
    unwatched = [event for event in events() if event.fields["kind"].startswith("competition")]
    log = attested(unwatched, signing[1], each_s=0.1)
    planted = replace(events()[0], t_ns=500_000_000)
    assert scored(tmp_path, in_order(*log, planted), attesting(signing)).is_open


def test_a_state_that_its_recorder_heard_before_the_log_did_is_no_loss_before_the_start(
    tmp_path: Path, signing: Signing
) -> None:
    log = attested(in_order(*events(), *repeated()), signing[1], each_s=0.1)

    def less(count: int) -> list[Recorded]:
        gone = {id(m) for m in [m for m in log if m.topic == "/ariac/agv1/state"][:count]}
        return [m for m in log if id(m) not in gone]

    assert completeness(scored(tmp_path, less(5), attesting(signing))) == "recorder: "
    with pytest.raises(LogError, match=r"missing: 12 messages on /ariac/agv1/state"):
        scored(tmp_path, less(12), attesting(signing))  # the last of them came after the start


def test_equal_messages_may_not_be_moved_among_each_other(tmp_path: Path, signing: Signing) -> None:
    """A second of a state, said again at another time: as many as before, and a second of silence."""
    log = attested(in_order(*events(), *repeated()), signing[1], each_s=0.1)
    moved = [
        replace(m, t_ns=m.t_ns + 2 * 10**9)
        if m.topic == "/ariac/agv1/state" and 4 * 10**9 <= m.t_ns < 5 * 10**9
        else m
        for m in log
    ]

    with pytest.raises(LogError, match=r"moved: \d+ messages on /ariac/agv1/state"):
        scored(tmp_path, in_order(*moved), attesting(signing))


# The bytes stay, and what they mean or whose they are does not -----------------------------------


def hash_of(text: str) -> str:
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def definition_on(path: Path, topic: str) -> str:
    """The definition in a bag of ROS 1."""
    with Ros1Reader(path) as reader:
        (found,) = {one.msgdef.data for one in reader.connections if one.topic == topic}
        return found


def defined_as(path: Path, topic: str, definition: str) -> Path:
    """A bag of ROS 1 whose messages on a topic have another definition."""
    out = path.with_name("altered.bag")
    with Ros1Reader(path) as reader, Ros1Writer(out) as writer:
        to = {
            one.id: writer.add_connection(
                one.topic,
                one.msgtype,
                msgdef=definition if one.topic == topic else one.msgdef.data,
                md5sum=one.digest,
            )
            for one in reader.connections
        }
        for connection, stamp_ns, data in reader.messages():
            writer.write(to[connection.id], stamp_ns, data)
    return out


Change = Callable[[str, bytes, bytes], Iterable[tuple[str, bytes, bytes, int]]]
"""From topic, definition and bytes of a message to what is written for it: these, and which channel."""


def rewritten(path: Path, change: Change, encodings: Mapping[int, str] | None = None) -> Path:
    """A recording whose messages stand on other channels, some of another encoding."""
    out = path.with_name("altered.mcap")
    with path.open("rb") as source, out.open("wb") as sink:
        reader, writer, channels = make_reader(source), Writer(sink), dict[tuple[str, bytes, int], int]()
        writer.start(reader.get_header().profile, library="another")
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            for topic, definition, data, which in change(channel.topic, schema.data, message.data):
                key = topic, definition, which
                if key not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, definition)
                    encoding = (encodings or {}).get(which, channel.message_encoding)
                    channels[key] = writer.register_channel(topic, encoding, number)
                writer.add_message(channels[key], message.log_time, data, message.publish_time)
        writer.finish()
    return out


OTHERWISE = b"string subject\nstring kind\nstring detail\n"
"""The fields of an event in another order: a collision is then none."""


def is_collision(data: bytes) -> bool:
    return b"arm_collision" in data and b"watching" not in data


def redefined(definition: bytes | None, *, all_of_them: bool = False) -> Change:
    """The collision, or all events, by another definition."""

    def change(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        changes = topic == EVENTS and definition is not None and (all_of_them or is_collision(data))
        yield topic, definition if changes and definition is not None else text, data, 0

    return change


@pytest.mark.parametrize(
    ("about", "change", "cause"),
    [
        (
            {},
            redefined(OTHERWISE),
            "it defines the messages on '/ariac_score/events' in two ways",
        ),
        (
            {"type": "std_msgs/String"},
            redefined(None),
            "on '/ariac_score/events' it has messages of 'ariac_score_msgs/msg/TrialEvent', and its recorder "
            "'std_msgs/String'",
        ),
        (
            {"definitions": "all"},
            redefined(None),
            "its manifest does not say of what type the messages on '/ariac_score/events' are",
        ),
        (
            {"definitions": ["bfb40a01d75c686818f60b7f140470e0"]},
            redefined(None),
            "it defines the messages on '/ariac_score/events' otherwise than who published them",
        ),
    ],
    ids=["two definitions", "another type", "no list", "no hash that is known"],
)
def test_a_log_that_gives_the_bytes_another_meaning_is_not_attested(
    about: Mapping[str, Any], change: Change, cause: str, tmp_path: Path, signing: Signing
) -> None:
    whole = attested(events(), signing[1], about=about)
    path = write_bag(tmp_path / "run.mcap", whole, storage="mcap")

    assert attestation_of(rewritten(path, change), 0).problem == cause


def test_the_definitions_of_its_publishers_attest_a_log(tmp_path: Path, signing: Signing) -> None:
    text = definition_on(write_bag(tmp_path / "plain.bag", events(), storage="ros1"), EVENTS)
    about = {"type": "ariac_score_msgs/TrialEvent", "definitions": [hash_of(text), hash_of("of another")]}
    whole = attested(events(), signing[1], about=about, ros=1)
    log, rules = (
        write_bag(tmp_path / "run.bag", whole, storage="ros1"),
        rules_in(tmp_path, attesting(signing)),
    )
    assert completeness(score_trial(log, rules)) == "recorder: "
    altered = defined_as(log, EVENTS, OTHERWISE.decode())
    assert attestation_of(altered, 0).problem == (
        "it defines the messages on '/ariac_score/events' otherwise than who published them"
    )

    unknown = scored(tmp_path, attested(events(), signing[1], about={"definitions": []}), attesting(signing))
    assert completeness(unknown) == "recorder: definitions not attested: /ariac_score/events"


@pytest.mark.parametrize("array", ["TrialEvent[]", "TrialEvent", "TrialEvent[0]", "TrialEvent[2]"])
def test_a_list_of_messages_is_not_one_of_them_though_the_md5_sum_of_ros_is_the_same(
    array: str, tmp_path: Path, signing: Signing
) -> None:
    """Who makes no element of the list of all transforms has every body gone, by the sum of ROS 1 alone."""
    frames = Recorded("/tf", "tf2_msgs/msg/TFMessage", 3 * 10**9, {"transforms": []})
    text = definition_on(write_bag(tmp_path / "plain.bag", [frames], storage="ros1"), "/tf")
    about = {"type": "tf2_msgs/TFMessage", "definitions": [hash_of(text)]}
    whole = attested(in_order(*events(), frames), signing[1], about=about, of="/tf", ros=1)
    log = write_bag(tmp_path / "run.bag", whole, storage="ros1")

    kind = array.replace("TrialEvent", "geometry_msgs/TransformStamped")
    altered = text.replace("geometry_msgs/TransformStamped[] transforms", f"{kind} transforms")
    problem = attestation_of(defined_as(log, "/tf", altered), 0).problem
    assert problem == (
        "" if altered == text else "it defines the messages on '/tf' otherwise than who published them"
    )


@pytest.mark.parametrize("encoding", ["json", "ros1", "", "cbor"])
def test_a_topic_that_was_made_unreadable_is_as_one_that_was_left_out(
    encoding: str, tmp_path: Path, signing: Signing
) -> None:
    about = {"type": "ariac_score_msgs/TrialEvent"}
    path = write_bag(tmp_path / "run.mcap", attested(events(), signing[1], about=about), storage="mcap")

    def all_of_it(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        yield topic, text, data, int(topic == EVENTS)

    log = rewritten(path, all_of_it, {1: encoding})
    rules = rules_in(tmp_path, attesting(signing))
    with pytest.raises(LogError, match=r"cannot be told on /ariac_score/events: "):
        score_trial(log, rules)


@pytest.mark.parametrize("comment", ["# <wstring\n", "/* wstring A = */ "])
def test_a_definition_that_two_readers_would_read_otherwise_attests_nothing(
    comment: str, tmp_path: Path, signing: Signing
) -> None:
    found = attestation_with(
        tmp_path, signing[1], "std_msgs/msg/String", f"{comment}string data", "ros2msg", STRING_HASH
    )
    assert (found.problem != "") or [topic for topic, _ in found.uncompared] == ["/other"]


@pytest.mark.parametrize(
    ("pace", "begins_s", "is_attested"),
    [(1.0, 0.0, True), (1.0, 0.1, True), (1.0, 5.0, False), (0.8, 0.0, False)],
)
def test_a_clock_that_the_heartbeats_do_not_tell_was_put_in(
    pace: float, begins_s: float, is_attested: bool, tmp_path: Path, signing: Signing
) -> None:
    """No recorder lists `/clock`, which comes too often; the time of its node is in every heartbeat."""
    whole = attested(events(), signing[1])
    ticks = [
        Recorded(
            "/clock",
            "rosgraph_msgs/msg/Clock",
            t_ns,
            {"clock": {"sec": int(now_ns // 10**9), "nanosec": int(now_ns % 10**9)}},
        )
        for t_ns in range(0, 10 * 10**9, 10**8)
        if (now_ns := round(begins_s * 1e9 + pace * t_ns)) >= 0
    ]
    problem = attestation_of(
        write_bag(tmp_path / "run.mcap", in_order(*whole, *ticks), storage="mcap"), 0
    ).problem

    assert problem.startswith(
        "" if is_attested else "its '/clock' says otherwise than its heartbeats, by up to"
    )
    assert bool(problem) is not is_attested


def test_a_clock_that_nobody_can_read_is_no_reason_to_refuse_a_log(tmp_path: Path, signing: Signing) -> None:
    tick = Recorded("/clock", "rosgraph_msgs/msg/Clock", 3 * 10**9, {"clock": {"sec": 9, "nanosec": 0}})
    log = write_bag(tmp_path / "run.mcap", in_order(*attested(events(), signing[1]), tick), storage="mcap")

    def broken(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        yield topic, b"garbage !!" if topic == "/clock" else text, data, 0

    assert attestation_of(log, 0).problem.startswith("its '/clock' says otherwise")
    assert score_trial(rewritten(log, broken), rules_in(tmp_path)).score == HONEST


STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
EMPTY_HASH = "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312"
"""The type hashes that ROS 2 publishes for `std_msgs/msg/String` and `std_msgs/msg/Empty`."""


def attestation_with(
    folder: Path, sign: Callable[[str], str], type_: str, definition: str, form: str, stated: str
) -> Attestation:
    """Of a log with a topic `/other` of some definition, whose recorder states a hash of it."""
    other = Recorded("/other", "std_msgs/msg/String", 3 * 10**9, {"data": ""})
    about = {"type": type_.replace("/msg/", "/"), "definitions": [stated]}
    whole = attested(in_order(*events(), other), sign, about=about, of="/other")
    path, out = write_bag(folder / "run.mcap", whole, storage="mcap"), folder / "other.mcap"
    with path.open("rb") as source, out.open("wb") as sink:
        reader, writer, channels = make_reader(source), Writer(sink), dict[str, int]()
        writer.start("ros2", library="another")
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            own = channel.topic == "/other"
            if channel.topic not in channels:
                number = writer.register_schema(
                    type_ if own else schema.name,
                    form if own else schema.encoding,
                    definition.encode() if own else schema.data,
                )
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    return attestation_of(out, 0)


@pytest.mark.parametrize(
    ("type_", "definition", "stated"),
    [
        ("std_msgs/msg/String", "string data\n", STRING_HASH),
        ("std_msgs/msg/String", "# a comment\nint32 A=0x3\nstring data", STRING_HASH),
        ("std_msgs/msg/Empty", "", EMPTY_HASH),
        ("std_msgs/msg/Empty", "\n", EMPTY_HASH),
    ],
    ids=["as defined", "comments and constants", "no fields", "an empty line"],
)
def test_the_type_hashes_of_ros_attest_a_log(
    type_: str, definition: str, stated: str, tmp_path: Path, signing: Signing
) -> None:
    found = attestation_with(tmp_path, signing[1], type_, definition, "ros2msg", stated)
    assert (found.problem, found.undefined, found.uncompared) == ("", (), ())


@pytest.mark.parametrize(
    "definition", ["string[] data", "string<=9 data", "string date", "string data\nbyte b"]
)
def test_another_definition_of_the_type_has_another_hash(
    definition: str, tmp_path: Path, signing: Signing
) -> None:
    found = attestation_with(tmp_path, signing[1], "std_msgs/msg/String", definition, "ros2msg", STRING_HASH)
    assert found.problem == "it defines the messages on '/other' otherwise than who published them"


@pytest.mark.parametrize(
    ("type_", "definition", "form", "why"),
    [
        ("a/msg/Wide", "wstring data", "ros2msg", "names wide texts"),
        ("a/msg/Unknown", "", "unknown", "neither the recording nor ariac-score has a definition"),
        ("a/action/Turn_FeedbackMessage", "int32 a\n---\nint32 b", "ros2msg", "cannot be used"),
        ("a/msg/Loop", "Loop data", "ros2msg", "cannot be used"),
        ("a/msg/Long", "int8 A=1\n" * 10_001, "ros2msg", "10001 lines, 10000 are allowed"),
    ],
    ids=["wide text", "no definition", "an action", "of itself", "too long"],
)
def test_a_definition_without_a_hash_matters_where_it_is_read_alone(
    type_: str, definition: str, form: str, why: str, tmp_path: Path, signing: Signing
) -> None:
    found = attestation_with(tmp_path, signing[1], type_, definition, form, f"RIHS01_{'ab' * 32}")
    ((topic, reason),) = found.uncompared
    assert (found.problem, topic) == ("", "/other")
    assert why in reason

    log, rules = tmp_path / "other.mcap", rules_in(tmp_path, attesting(signing))
    assert score_trial(log, rules).score == HONEST
    (tmp_path / "ours.yaml").write_text(
        "id: ours\ntitle: Ours\nsource: this test\nextends: ariac2020\n"
        "channels: [{topic: /other, event: {kind: another}}]\n"
    )
    rules = rules_in(tmp_path, attesting(signing), "./ours.yaml")
    with pytest.raises(LogError, match=r"cannot be told on /other: "):
        score_trial(log, rules)


def test_a_loss_that_the_manifest_states_is_missing_whatever_the_numbers_of_the_log_say(
    tmp_path: Path, signing: Signing
) -> None:
    quiet = without(events(), EVENTS, 2)

    def lost(count: int) -> list[Recorded]:
        about = {"publishers": {"": {"count": len(quiet), "lost": count}}}
        return attested(quiet, signing[1], about=about)

    assert completeness(scored(tmp_path, lost(0), attesting(signing))) == "recorder: "
    with pytest.raises(LogError, match=r"missing: 1 message on /ariac_score/events"):
        scored(tmp_path, lost(1), attesting(signing))
    assert scored(tmp_path, lost(1)).is_open


@pytest.mark.parametrize(
    ("counts", "problem"),
    [
        ({"/cell": 4}, ""),
        ({"/cell": 3, "/other": 1}, "it has messages of others as those of /cell"),
        ({"/other": 4}, "it has messages of others as those of /cell"),
    ],
)
def test_messages_of_several_publishers_may_not_stand_as_those_of_one(
    counts: Mapping[str, int], problem: str, tmp_path: Path, signing: Signing
) -> None:
    about = {"publishers": {name: {"count": n, "lost": 0} for name, n in counts.items()}}
    said = [replace(one, publisher="/cell") for one in events()]
    whole = attested(said, signing[1], about=about, ros=1)

    assert problem in attestation_of(write_bag(tmp_path / "run.bag", whole, storage="ros1"), 0).problem
    joined = attestation_of(
        write_bag(tmp_path / "run.mcap", attested(said, signing[1], about=about), storage="mcap"), 0
    )
    assert bool(joined.problem) is (len(counts) > 1)


def test_an_unread_topic_without_a_definition_is_none_of_the_log(tmp_path: Path, signing: Signing) -> None:
    """The definition that is known here may be that of another edition of ROS."""
    found = attestation_with(tmp_path, signing[1], "sensor_msgs/msg/Range", "", "", STRING_HASH)

    assert (found.problem, [topic for topic, _ in found.uncompared]) == ("", ["/other"])


def test_a_message_on_a_topic_that_is_spelt_without_its_slash_was_put_in(
    tmp_path: Path, signing: Signing
) -> None:
    path = write_bag(tmp_path / "run.mcap", attested(events(), signing[1]), storage="mcap")

    def twice(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        yield topic, text, data, 0
        if topic == EVENTS and is_collision(data):
            yield topic.lstrip("/"), text, data, 0

    assert attestation_of(rewritten(path, twice), 0).put_in == ((EVENTS, 1),)


@pytest.mark.parametrize("encoding", ["json", "ros1", ""])
def test_a_message_under_another_encoding_is_no_message_of_its_recorder(
    encoding: str, tmp_path: Path, signing: Signing
) -> None:
    path = write_bag(tmp_path / "run.mcap", attested(events(), signing[1]), storage="mcap")

    def apart(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        yield topic, text, data, 1 if topic == EVENTS and is_collision(data) else 0

    assert attestation_of(rewritten(path, apart), 0).problem == ""
    found = attestation_of(rewritten(path, apart, {1: encoding}), 0)
    assert found.problem == "it encodes the messages on '/ariac_score/events' in two ways"


@pytest.mark.parametrize("damage", ["cut", "foreign", "mistyped", "gone"])
def test_who_watches_vouches_for_nothing_that_a_lost_message_may_have_told(
    damage: str, tmp_path: Path
) -> None:
    """Without a manifest: nobody says what the message that is cut, foreign or gone by its number was."""
    seen = [replace(events()[1], t_ns=n * 10**9, fields={"kind": "lamp", "subject": "on"}) for n in (2, 3, 4)]
    path = write_bag(tmp_path / "run.mcap", in_order(*events(), *seen), storage="mcap")

    def damaged(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        hit = is_collision(data)
        if not (hit and damage == "gone"):
            yield (
                topic,
                text,
                data[:9] if hit and damage == "cut" else data,
                int(hit and damage in ("foreign", "mistyped")),
            )

    log = rewritten(path, damaged, {1: "json"})
    with log.open("rb") as source, (tmp_path / "numbered.mcap").open("wb") as sink:
        reader, writer, channels = make_reader(source), Writer(sink), dict[int, int]()
        writer.start("ros2", library="another")
        for number, (schema, channel, message) in enumerate(reader.iter_messages(), start=1):
            assert schema is not None
            if channel.id not in channels:
                other = damage == "mistyped" and channel.message_encoding == "json"
                name = "a/msg/Another" if other else schema.name
                known = writer.register_schema(name, schema.encoding, schema.data)
                encoding = "cdr" if other else channel.message_encoding
                channels[channel.id] = writer.register_channel(channel.topic, encoding, known)
            told = number + (damage == "gone" and number > 5)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, told
            )
        writer.finish()

    assert score_trial(path, rules_in(tmp_path)).score == HONEST
    found = score_trial(tmp_path / "numbered.mcap", rules_in(tmp_path))
    assert (found.score, found.is_open) == (HONEST, True)
    assert found.interval is not None
    assert (found.interval.least, found.interval.most) == (0, 10)
    assert {defect.kind: defect.where for defect in found.measured.log_defects}["doubted_watcher"] == (
        "arm_collision"
    )


@pytest.mark.parametrize("damage", ["cut", "foreign"])
def test_one_topic_vouches_for_nothing_that_another_one_may_have_told(damage: str, tmp_path: Path) -> None:
    """Contacts of the left and of the right arm come on topics of their own."""
    sides = [
        Recorded(f"/{side}_contact", "std_msgs/msg/String", t_ns * 10**9, {"data": "touched"})
        for side, t_ns in (("left", 9), ("right", 5))
    ]
    times = [one for one in events() if one.fields["kind"].startswith("competition")]
    path = write_bag(tmp_path / "run.mcap", in_order(*times, *sides), storage="mcap")
    (tmp_path / "ours.yaml").write_text(
        "id: ours\ntitle: Ours\nsource: this test\nextends: ariac2020\nchannels:\n"
        "  - {topic: /left_contact, event: {kind: another}, witnesses: [arm_collision]}\n"
        "  - {topic: /right_contact, event: {kind: arm_collision}, witnesses: [arm_collision]}\n"
    )
    rules = rules_in(tmp_path, log_map="./ours.yaml")

    def damaged(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        right = topic == "/right_contact"
        yield topic, text, data[:6] if right and damage == "cut" else data, int(right and damage == "foreign")

    assert score_trial(path, rules).score == HONEST
    found = score_trial(rewritten(path, damaged, {1: "json"}), rules)
    assert (found.score, found.is_open) == (HONEST, True)


def unread_of_a_kit(folder: Path, topic: str, number: int, damage: str) -> tuple[Path, Path]:
    """A recording of two orders and three submissions, of which the first is an empty one; and a damaged one.

    Args:
        folder: For both.
        topic: Where a message cannot be read.
        number: Which one of the topic, from 1.
        damage: `cut` or `foreign`.
    """
    trial, seen = kitting_trial(), 0
    empty = KitSubmission(trial.submissions[0].item_id, 12.0, (), "agv1")
    submitted = replace(trial, submissions=(empty, *trial.submissions))
    path = write_bag(folder / "run.mcap", [*recorded_messages(submitted, motion="snapshot")], storage="mcap")

    def damaged(name: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        nonlocal seen
        seen += name == topic
        hit = name == topic and seen == number
        yield name, text, data[:9] if hit and damage == "cut" else data, int(hit and damage == "foreign")

    return path, rewritten(path, damaged, {1: "json"})


@pytest.mark.parametrize("damage", ["cut", "foreign"])
def test_what_was_handed_in_is_open_where_a_submission_cannot_be_read(damage: str, tmp_path: Path) -> None:
    whole, part = unread_of_a_kit(tmp_path, "/ariac_score/submissions", 1, damage)
    honest, found = (score_trial(log, "paper2020.published") for log in (whole, part))

    assert honest.score is not None
    assert found.score is not None
    assert found.score <= honest.score
    assert found.interval is not None
    assert found.interval.least <= honest.score <= found.interval.most


@pytest.mark.parametrize("damage", ["cut", "foreign"])
@pytest.mark.parametrize("number", [1, 2])
def test_no_number_is_the_score_where_an_order_cannot_be_read(
    number: int, damage: str, tmp_path: Path
) -> None:
    _, part = unread_of_a_kit(tmp_path, "/ariac/orders", number, damage)
    found = score_trial(part, "paper2020.published")

    assert (found.score, found.status) == (None, "incomplete")
    assert found.missing.startswith(
        "not all messages on /ariac/orders can be read, so more may have been asked for"
    )


def test_a_message_that_is_there_twice_is_left_out_once(tmp_path: Path, signing: Signing) -> None:
    """The copy on a channel whose other messages are later ones looks like one from before it was heard."""
    rules = tmp_path / "rules.yaml"
    assert scored(tmp_path, attested(events(), signing[1]), attesting(signing)).score == HONEST
    later = False

    def doubled(topic: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        nonlocal later
        if topic == EVENTS and is_collision(data):
            later = True
            yield topic, text, data, 1  # the copy: of equal ones the last is taken for the one that was heard
            yield topic, text, data, 2
        else:
            yield topic, text, data, 1 if topic == EVENTS and later else 0

    altered = rewritten(tmp_path / "run.mcap", doubled)
    assert [one.t_ns for one in attestation_of(altered, 0).early] == [5 * 10**9]
    assert score_trial(altered, rules).score == HONEST


def printed(folder: Path, lines: Sequence[tuple[float, str, str]], received: Sequence[str]) -> Path:
    """A ROS 1 bag of printed lines: when, by which node, and on whose connection the log has it.

    The recorder received the first of each node in `received` as often as it is named there.
    """
    store, path = bundled_typestore(1), folder / "run.bag"
    path.unlink(missing_ok=True)
    kinds = {name: f"{package}/msg/{name}" for name, package in KINDS.items()}
    make = {name: store.types[kind] for name, kind in kinds.items()}
    stamp = store.types["builtin_interfaces/msg/Time"](0, 0)
    header = store.types["std_msgs/msg/Header"](0, stamp, "")

    def line(node: str, number: int) -> bytes:
        said = make["Log"](header, 2, node, f"line {number} of {node}", "", "", 0, [])
        return bytes(store.serialize_ros1(said, kinds["Log"]))

    def own(name: str, fields: Mapping[str, Any]) -> bytes:
        return bytes(store.serialize_ros1(make[name](header, **fields), kinds[name]))

    listed = [line(node, number) for number, node in enumerate(received)]
    words = "".join(base64.b64encode(hashlib.sha256(one).digest()[:12]).decode() for one in listed)
    body = _json({"recording": RECORDING, "sequence": 1, "topics": {ROSOUT: {"first": 1, "digests": words}}})
    chain = _sha256(RECORDING + body)
    publishers = {node: {"count": received.count(node), "lost": 0} for node in dict.fromkeys(received)}
    manifest = {
        "format": "ariac-score-manifest/1",
        "recording": RECORDING,
        "heartbeats": {"count": 1, "chain": chain},
        "topics": {ROSOUT: {"count": len(listed), "publishers": publishers}},
    }
    with Ros1Writer(path) as writer:
        connections = {
            sender: writer.add_connection(ROSOUT, kinds["Log"], typestore=store, callerid=sender)
            for sender in dict.fromkeys(sender for _, _, sender in lines)
        }
        for t_s, name, sender in lines:
            node, _, number = name.partition("#")
            writer.write(connections[sender], round(t_s * 1e9), line(node, int(number)))
        for topic, name, fields in (
            ("heartbeat", "Heartbeat", {"recording": RECORDING, "sequence": 1, "body": body, "chain": chain}),
            (
                "manifest",
                "Manifest",
                {"recording": RECORDING, "closed": True, "body": _json(manifest), "signature": ""},
            ),
        ):
            connection = writer.add_connection(f"/ariac_score/{topic}", kinds[name], typestore=store)
            writer.write(connection, 10**10, own(name, fields))
    return path


ROSOUT = "/rosout"
KINDS = {"Log": "rosgraph_msgs", "Heartbeat": "ariac_score_msgs", "Manifest": "ariac_score_msgs"}


def test_whose_printed_line_is_missing_is_told_by_the_lines_themselves(tmp_path: Path) -> None:
    """Who leaves out a line of the simulator, and writes its name over the connection of another node's."""
    received = ["/gazebo", "/gazebo", "/team", "/team"]
    kept = [(2.0, "/gazebo#1", "/gazebo"), (3.0, "/team#2", "/team"), (4.0, "/team#3", "/team")]
    relabelled = [(t_s, name, "/gazebo" if name == "/team#2" else sender) for t_s, name, sender in kept]

    (missing,) = attestation_of(printed(tmp_path, kept, received), 0).lacking
    assert missing.publishers == ("/gazebo",)
    (missing,) = attestation_of(printed(tmp_path, relabelled, received), 0).lacking
    assert missing.publishers == ("/gazebo", "/team")


# What a recorder cannot have written ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("about", "cause"),
    [
        ({"publishers": ["/a"]}, "its manifest does not say how many messages were lost on"),
        ({"publishers": {"/a": 5}}, "its manifest does not say how many messages were lost on"),
        ({"publishers": {"/a": {"lost": "x"}}}, "its manifest does not say how many messages were lost on"),
        ({"publishers": {"/a": {"lost": -1}}}, "its manifest does not say how many messages were lost on"),
    ],
)
def test_a_manifest_that_makes_no_sense_attests_nothing(
    about: Mapping[str, Any], cause: str, tmp_path: Path, signing: Signing
) -> None:
    messages = attested(events(), signing[1], about=about)

    assert cause in completeness(scored(tmp_path, messages))
    with pytest.raises(LogError, match="completeness is not attested"):
        scored(tmp_path, messages, attesting(signing))


@pytest.mark.parametrize("pace", [-1.0, 1e30])
def test_a_heartbeat_that_was_sent_at_no_time_attests_nothing(
    pace: float, tmp_path: Path, signing: Signing
) -> None:
    result = scored(tmp_path, attested(events(), signing[1], pace=pace))

    assert "was sent at no time, by its 'ros_ns'" in completeness(result)


@pytest.mark.parametrize("topic", ["heartbeat", "manifest"])
def test_a_message_of_the_recorder_that_cannot_be_read_attests_nothing(
    topic: str, tmp_path: Path, signing: Signing
) -> None:
    """One byte of its text was changed, so that it is none; or the log defines it as something else."""
    path = write_bag(tmp_path / "run.mcap", attested(events(), signing[1]), storage="mcap")

    def damaged(at: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        yield at, text, data.replace(b"7f3c", b"\xff\xff\xff\xff") if at.endswith(topic) else data, 0

    def another(at: str, text: bytes, data: bytes) -> Iterable[tuple[str, bytes, bytes, int]]:
        yield at, b"uint32 sequence\n" if at.endswith(topic) else text, data, 0

    for change in (damaged, another):
        problem = attestation_of(rewritten(path, change), 0).problem
        assert f"a {topic} of its recorder cannot be read" in problem
