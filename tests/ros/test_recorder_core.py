"""The recorder's core, which knows no ROS: what it attests, signs, notices and refuses."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

REPOSITORY = Path(__file__).parents[2]
SOURCE = REPOSITORY / "ros/ariac_score_recorder/src"
sys.path.insert(0, str(SOURCE))

from ariac_score_recorder import minisign  # noqa: E402
from ariac_score_recorder.attest import Instant  # noqa: E402
from ariac_score_recorder.forwarding import Forwarder  # noqa: E402
from ariac_score_recorder.plan import FORMAT, Forward, Plan, PlanError  # noqa: E402
from ariac_score_recorder.session import Session  # noqa: E402

STATE = "/competition_state"
ID = "00112233445566778899aabbccddeeff"


def text(words: str) -> SimpleNamespace:
    return SimpleNamespace(data=words)


class Cell:
    """A session with a clock that is set by hand, and what it sent."""

    def __init__(self, key: Any = None, **plan: Any) -> None:
        self.t_s, self.wall_s = 10.0, 0.0
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.session = Session(
            Plan({"format": FORMAT, "topics": ["/tf", STATE], **plan}),
            lambda name, fields: self.sent.append((name, fields)),
            lambda: Instant(round(self.t_s * 1e9), round((1000 + self.wall_s) * 1e9), self.wall_s),
            key,
            recording=ID,
        )

    def pass_s(self, seconds: float, *, is_clock_running: bool = True) -> str:
        self.wall_s += seconds
        self.t_s += seconds if is_clock_running else 0.0
        return str(self.session.beat())

    def message(self, topic: str, payload: bytes, decoded: Any = None, **more: Any) -> None:
        self.session.arrived(topic, "std_msgs/String", payload, lambda: decoded, **more)

    def of(self, name: str) -> list[dict[str, Any]]:
        return [fields for sent, fields in self.sent if sent == name]

    def manifest(self) -> dict[str, Any]:
        body, _ = self.session.close("signal 2")
        return json.loads(body)  # type: ignore[no-any-return]


def test_each_message_is_in_one_heartbeat_by_the_hash_of_its_bytes() -> None:
    cell = Cell()
    cell.message("/tf", b"one")
    cell.message("/tf", b"two")
    cell.pass_s(0.1)
    cell.message("/tf", b"three")
    manifest = cell.manifest()
    first, second = (json.loads(beat["body"])["topics"]["/tf"] for beat in cell.of("heartbeat"))
    words = [base64.b64encode(hashlib.sha256(m).digest())[:16].decode() for m in (b"one", b"two", b"three")]
    assert (first["first"], first["digests"]) == (1, words[0] + words[1])
    assert (second["first"], second["digests"]) == (3, words[2])
    of_tf = manifest["topics"]["/tf"]
    assert of_tf["count"] == 3
    assert of_tf["digest"] == hashlib.sha256("".join(words).encode()).hexdigest()


def test_the_chain_goes_from_the_id_to_the_manifest_and_breaks_where_a_heartbeat_is_changed() -> None:
    cell = Cell()
    for _ in range(3):
        cell.pass_s(0.1)
    manifest = cell.manifest()

    def end_of(bodies: list[str]) -> str:
        chain = ID
        for body in bodies:
            chain = hashlib.sha256((chain + body).encode()).hexdigest()
        return chain

    bodies = [beat["body"] for beat in cell.of("heartbeat")]
    assert [beat["sequence"] for beat in cell.of("heartbeat")] == [1, 2, 3, 4]
    assert end_of(bodies) == cell.of("heartbeat")[-1]["chain"] == manifest["heartbeats"]["chain"]
    assert end_of([bodies[0], *bodies[2:]]) != manifest["heartbeats"]["chain"]


def test_numbers_that_never_came_are_lost_and_a_publisher_that_begins_anew_loses_nothing() -> None:
    cell = Cell()
    for sender, numbers in (("/a", [5, 6, 9, 10]), ("/b", [3, 4, 1, 2])):
        for number in numbers:
            cell.message("/tf", b"", sender=sender, number=number)
    cell.message("/tf", b"", sender="/c")
    publishers = cell.manifest()["topics"]["/tf"]["publishers"]
    assert publishers["/a"] == {"count": 4, "lost": 2, "first_seq": 5, "last_seq": 10}
    assert publishers["/b"]["lost"] == 0
    assert publishers["/c"] == {"count": 1, "lost": 0, "first_seq": None, "last_seq": None}


def test_the_manifest_says_how_messages_were_defined_by_whoever_published_them() -> None:
    cell = Cell()
    for definition in ("b0b0", "a1a1", "", "b0b0"):
        cell.message("/tf", b"", definition=definition)
    topics = cell.manifest()["topics"]
    assert topics["/tf"]["definitions"] == ["a1a1", "b0b0"]
    assert topics[STATE]["definitions"] == []


def test_what_is_wrong_with_a_recording_stands_in_its_manifest() -> None:
    cell = Cell(starts={"topic": STATE, "field": "data", "values": ["init"]})
    cell.message(STATE, b"", text("go"))
    cell.pass_s(0.1)
    for _ in range(11):
        cell.pass_s(0.1, is_clock_running=False)
    cell.session.other_heartbeat("ff" * 16)
    cell.session.other_heartbeat(ID)
    notes = cell.manifest()["notes"]
    assert len(notes) == 3
    assert notes[0] == f"began late: the first word of {STATE} was already go"
    assert notes[1].startswith("/clock stood still at 10.100 s")
    assert notes[2] == "another recorder publishes here: " + "ff" * 16


def test_a_clock_that_pauses_for_less_than_a_second_is_not_said_to_stand() -> None:
    cell = Cell()
    cell.pass_s(0.1)
    for _ in range(9):
        cell.pass_s(0.1, is_clock_running=False)
    assert cell.manifest()["notes"] == []


def test_it_listens_on_after_the_last_word_and_then_ends() -> None:
    cell = Cell(ends={"topic": STATE, "field": "data", "values": ["done"]}, linger_s=0.5)
    cell.message(STATE, b"", text("go"))
    assert cell.pass_s(0.1) == ""
    cell.message(STATE, b"", text("done"))
    assert cell.pass_s(0.4) == ""
    assert cell.pass_s(0.2) == f"{STATE}: done"


def test_a_text_names_what_is_submitted_and_another_says_when() -> None:
    watch = {
        "topic": "/rosout",
        "field": "msg",
        "where": {"name": "/gazebo"},
        "text": r"AGV '(?P<agv>agv\d)' delivery triggered for kit: (?P<kit>\S+)",
        "then_text": "successfully triggered",
        "submission": {"shipment_type": "{kit}", "agv": "{agv}", "contents_unknown": True},
    }
    cell = Cell(watches=[watch])

    def says(words: str, name: str = "/gazebo") -> int:
        cell.message("/rosout", b"", SimpleNamespace(name=name, msg=words))
        return len(cell.of("submission"))

    assert says("AGV successfully triggered.") == 0  # of nothing
    assert says("[INFO] AGV 'agv1' delivery triggered for kit: order_0_kit_0") == 0
    assert says("AGV successfully triggered.", name="/team") == 0  # a team may say anything
    assert says("AGV successfully triggered.") == 1
    assert says("AGV successfully triggered.") == 1
    wanted = {"shipment_type": "order_0_kit_0", "agv": "agv1", "contents_unknown": True}
    assert cell.of("submission") == [wanted]


def test_a_state_counts_when_it_is_entered_not_when_it_is_first_seen() -> None:
    event = {"kind": "agv_left", "subject": "agv1", "detail": ""}
    cell = Cell(watches=[{"topic": "/agv1", "field": "data", "becomes": "delivering", "event": event}])
    for word in ("delivering", "ready", "delivering", "delivering", "returning"):
        cell.message("/agv1", b"", text(word))
    assert cell.of("event") == [event]


def test_messages_that_cannot_be_understood_are_attested_all_the_same() -> None:
    cell = Cell(ends={"topic": STATE, "field": "data", "values": ["done"]})

    def fails() -> None:
        raise ValueError("too short")

    cell.session.arrived(STATE, "std_msgs/String", b"?", fails)
    manifest = cell.manifest()
    assert manifest["topics"][STATE]["count"] == 1
    assert manifest["notes"] == [f"{STATE}: messages are not understood: too short"]


def test_a_forwarded_call_is_a_submission_when_it_was_accepted() -> None:
    sent: list[tuple[str, dict[str, Any]]] = []
    fields = {"shipment_type": "{shipment_type}", "agv": "agv1", "contents_unknown": True}
    given = {"offered": "/a", "service": "/b", "accepted": "success", "submission": fields}
    forwarder = Forwarder(Forward(given, "plan"), lambda *told: sent.append(told))

    class Request:
        __slots__ = ("shipment_type",)
        _slot_types = ("string",)

    request = Request()
    request.shipment_type = "order_0_shipment_0"  # type: ignore[attr-defined]
    for success in (False, True):
        forwarder.called(request)
        forwarder.answered(request, SimpleNamespace(success=success))
    assert [told[0] for told in sent] == ["event", "event", "event", "event", "submission"]
    assert sent[0][1]["detail"] == '{"shipment_type":"order_0_shipment_0"}'
    assert sent[-1][1] == {"shipment_type": "order_0_shipment_0", "agv": "agv1", "contents_unknown": True}


def test_plans_that_cannot_be_followed_name_the_place(subtests: pytest.Subtests) -> None:
    event = {"kind": "k"}
    watch = {"topic": "/t", "field": "data", "text": "x", "event": event}
    for name, data, words in (
        ("another format", {"format": "2"}, "not a plan of this recorder"),
        ("no topics", {"topics": None}, "'topics' is not list"),
        ("left out and listened to", {"left_out": {"/tf": "harms"}}, "/tf is left out and listened to"),
        ("no full name", {"topics": ["tf"]}, "not the full name"),
        ("a pattern", {"watches": [{**watch, "text": "("}]}, "watch 1: 'text' is no pattern"),
        ("both", {"watches": [watch, {**watch, "becomes": "go"}]}, "watch 2: give one of 'text' and"),
        ("neither", {"watches": [{**watch, "event": None}]}, "one of 'submission' and 'event'"),
        ("itself", {"forwards": [{"offered": "/a", "service": "/a"}]}, "forward 1: 'offered' is the"),
    ):
        with subtests.test(name), pytest.raises(PlanError) as refused:
            Plan({"format": FORMAT, "topics": ["/tf"], **data}, "trial.plan.json")
        assert words in str(refused.value)
        assert "trial.plan.json" in str(refused.value)


# Signatures


def test_signatures_are_those_of_the_standard() -> None:
    """RFC 8032, section 7.1, tests 1 and 2."""
    for seed, public, message, signature in (
        (
            "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
            "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
            "",
            "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b46b"
            "d25bf5f0595bbe24655141438e7a100b",
        ),
        (
            "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
            "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
            "72",
            "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e458f3613d0f11d8c"
            "387b2eaeb4302aeeb00d291612bb0c00",
        ),
    ):
        assert minisign.public_of(bytes.fromhex(seed)).hex() == public
        assert minisign.sign(bytes.fromhex(seed), bytes.fromhex(message)).hex() == signature


def test_a_manifest_is_verified_by_the_library_of_minisign(tmp_path: Path) -> None:
    library = pytest.importorskip("minisign")
    pair = library.KeyPair.generate()
    file = tmp_path / "organiser"
    file.write_bytes(bytes(pair.secret_key))
    file.chmod(0o600)
    cell = Cell(minisign.read_key(str(file)))
    body, signature = cell.session.close("call")
    read = library.Signature.from_bytes(signature.encode())
    pair.public_key.verify(body.encode(), read)
    assert read.trusted_comment == f"ariac-score manifest of recording {ID}"
    with pytest.raises(library.VerifyError):
        pair.public_key.verify(body.replace("call", "done").encode(), read)


def test_keys_that_cannot_be_used_say_why(tmp_path: Path) -> None:
    library = pytest.importorskip("minisign")
    file = tmp_path / "organiser"

    def refused(content: bytes, mode: int = 0o600) -> str:
        file.write_bytes(content)
        file.chmod(mode)
        with pytest.raises(minisign.KeyUnusableError) as why:
            minisign.read_key(str(file))
        return str(why.value)

    secret = library.KeyPair.generate().secret_key
    whole = bytes(secret)
    raw = bytearray(base64.b64decode(whole.splitlines()[1]))
    raw[70] ^= 1
    assert "others may read" in refused(whole, 0o644)
    assert "not a secret key" in refused(b"untrusted comment: x\nabc")
    assert "do not belong together" in refused(b"untrusted comment: x\n" + base64.b64encode(bytes(raw)))
    secret.encrypt("secret")
    assert "has a password" in refused(bytes(secret))
    file.unlink()
    with pytest.raises(minisign.KeyUnusableError, match="cannot be read"):
        minisign.read_key(str(file))


# Python 2.7, on which the simulators of 2019 to 2022 run

_SAME = """
from __future__ import print_function, unicode_literals
import binascii, sys
from ariac_score_recorder import minisign
from ariac_score_recorder.attest import Instant
from ariac_score_recorder.plan import FORMAT, Plan
from ariac_score_recorder.session import Session

key = minisign.Key(b"12345678", b"s" * 32, minisign.public_of(b"s" * 32))
ends = {"topic": "/s", "field": "f", "values": ["done"]}
watch = {"topic": "/s", "field": "f", "text": "(?P<x>d.*)", "event": {"kind": "{x}"}}
plan = {"format": FORMAT, "topics": ["/tf"], "trial": "d\\u00e9j\\u00e0 vu", "ends": ends, "watches": [watch]}
sent = []
now = Instant(10**12, 7, 1.5)
send = lambda name, fields: sent.append((name, sorted(fields.items())))
session = Session(Plan(plan), send, lambda: now, key, recording="ab" * 16)

class Message(object):
    f = "done"

session.begin()
session.arrived("/tf", "tf/tfMessage", b"\\x00\\xff", None, "/robot", 4)
session.arrived("/s", "std_msgs/String", b"done", Message, "/cell")
session.beat()
session.close("signal 2")
for name, fields in sent:
    texts = ["{}={}".format(key, value) for key, value in fields]
    print(name, *[text.encode("ascii", "backslashreplace").decode() for text in texts])
"""


def python_27() -> str:
    """An interpreter of Python 2.7, or nothing."""
    for name in ("python2.7", "python2"):
        found = shutil.which(name)
        environment = {**os.environ, "PYENV_VERSION": "2.7.18"}
        if (
            found
            and not subprocess.run(
                [found, "-c", "import json"], env=environment, capture_output=True, check=False
            ).returncode
        ):
            return found
    return ""


@pytest.mark.slow
def test_python_27_publishes_the_same_bytes() -> None:
    old = python_27()
    if not old:
        pytest.skip("Python 2.7 is not installed")
    environment = {"PYTHONPATH": str(SOURCE), "PYENV_VERSION": "2.7.18", "PYTHONDONTWRITEBYTECODE": "1"}
    said = [
        subprocess.run(
            [python, "-c", _SAME],
            env={**os.environ, **environment} if python == old else {"PYTHONPATH": str(SOURCE)},
            capture_output=True,
            check=True,
            timeout=60,
        ).stdout
        for python in (old, sys.executable)
    ]
    assert said[0] == said[1]
    assert b"event kind=done" in said[0]
    assert b"signature=untrusted comment" in said[0]
    # The node as well, as far as one can say without its ROS.
    for file in sorted(SOURCE.rglob("*.py")):
        if file.name != "ros2.py":
            check = "import sys; compile(open(sys.argv[1]).read(), sys.argv[1], 'exec')"
            subprocess.run(
                [old, "-c", check, str(file)], env={**os.environ, **environment}, check=True, timeout=60
            )


def test_the_messages_of_the_package_are_those_that_are_read() -> None:
    packaged = {file.name: file.read_bytes() for file in (REPOSITORY / "ros/ariac_score_msgs/msg").iterdir()}
    read = {
        file.name: file.read_bytes()
        for folder in ("ariac_score/logs", "plugins/ariac_score_ariac")
        for file in (REPOSITORY / folder / "msg/ariac_score_msgs").iterdir()
    }
    assert packaged == read
