"""The reader of Gazebo's `state.log`, against the real log of 2022 and hand-written ones."""

from __future__ import annotations

import base64
import bz2
import json
import math
import random
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs import gazebo_text
from ariac_score.logs.gazebo import GazeboStateReader
from ariac_score.logs.gazebo_models import Entity
from ariac_score.logs.gazebo_states import read_states
from ariac_score.trial.channels import BodyMatch, LogMap
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span

SHARED = Path(__file__).parents[2].parent / "shared"
REAL = SHARED / "bags/gazebo/ariac2022_kitting_state.log"
needs_real_log = pytest.mark.skipif(not REAL.is_file(), reason="the real state.log of 2022 is not here")

READER = GazeboStateReader()
BODIES = LogMap(
    "test",
    models=(
        BodyMatch("arm*", "robot", radius_m=0.2, links=("hand",)),
        BodyMatch("person_*", "human", radius_m=0.3),
    ),
)
POSITIONS = Wanted(BODIES, frozenset({"position"}))

WORLD = (
    "<sdf version ='1.6'>\n<world name='w'><model name='wall'><pose>9 9 9 0 0 0</pose></model>"
    "<state world_name='w'><sim_time>77 0</sim_time><model name='ghost'><pose>1 1 1 0 0 0</pose></model>"
    "</state></world></sdf>\n"
)
START = (
    "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<log_version>1.0</log_version>\n"
    "<gazebo_version>9.19.0</gazebo_version>\n<rand_seed>1</rand_seed>\n</header>\n"
)
END = "</gazebo_log>"


def model(name: str, pose: str, *, links: Mapping[str, str] | None = None, nested: str = "") -> str:
    inner = "".join(
        f"<link name='{k}'><pose>{v} </pose><velocity>1 2 3 4 5 6</velocity></link>"
        for k, v in (links or {}).items()
    )
    return f"<model name='{name}'><pose>{pose} </pose><scale>1 1 1</scale>{inner}{nested}</model>"


def frame(time: str, *contents: str) -> str:
    light = "<light name='sun'><pose>5 5 5 0 0 0 </pose></light>"
    return (
        f"<sdf version='1.6'><state world_name='w'><sim_time>{time}</sim_time><wall_time>9 9</wall_time>"
        f"<iterations>1</iterations>{''.join(contents)}{light}</state></sdf>"
    )


def wrapped_base64(packed: bytes) -> str:
    return base64.encodebytes(packed).decode()


def packed_zlib(text: str) -> str:
    return base64.b64encode(zlib.compress(text.encode())).decode()


ENCODERS: Mapping[str, tuple[str, Callable[[str], str]]] = {
    "txt": ("txt", str),
    "zlib": ("zlib", packed_zlib),
    "zlib with line breaks": ("zlib", lambda text: wrapped_base64(zlib.compress(text.encode()))),
    "bz2": ("bz2", lambda text: base64.b64encode(bz2.compress(text.encode())).decode()),
    "bz2 with line breaks": ("bz2", lambda text: wrapped_base64(bz2.compress(text.encode()))),
}


def chunk(text: str, how: str = "zlib") -> str:
    encoding, encode = ENCODERS[how]
    return f"<chunk encoding='{encoding}'>\n<![CDATA[{encode(text)}]]>\n</chunk>\n"


def log_of(*chunks: str) -> str:
    return START + "".join(chunks) + END


def written(folder: Path, text: str) -> Path:
    path = folder / "state.log"
    path.write_text(text, encoding="utf-8")
    return path


def read(folder: Path, *frames: str) -> Trial:
    return READER.read(written(folder, log_of(chunk(WORLD), chunk("".join(frames)))), POSITIONS)


def test_is_a_reader() -> None:
    assert isinstance(READER, Reader)


# The real log


@pytest.fixture(scope="module")
def expected() -> Mapping[str, object]:
    truth: Mapping[str, object] = json.loads(
        REAL.with_name(REAL.name + ".expected.json").read_text(encoding="utf-8")
    )
    return truth


@needs_real_log
def test_the_real_log_has_every_pose_an_xml_parser_finds(expected: Mapping[str, object]) -> None:
    states = read_states(REAL)

    sums = {key: [math.fsum(column) for column in poses.T] for key, (_, poses) in states.poses.items()}
    assert sums == expected["pose_fsum"]
    assert sum(len(frames) for frames, _ in states.poses.values()) == expected["poses"]


@needs_real_log
def test_the_real_log_has_every_frame_at_its_time(expected: Mapping[str, object]) -> None:
    t_ns = read_states(REAL, lambda _: False).t_ns

    steps = {str(step): count for step, count in Counter(np.diff(t_ns).tolist()).items()}
    assert steps == expected["dt_ns"]
    assert (t_ns[0], t_ns[-1]) == (expected["first_sim_ns"], expected["last_sim_ns"])


@needs_real_log
def test_the_real_log_is_described_by_its_models() -> None:
    description = READER.describe(REAL)

    assert description.facts == {"states": 1617, "models": 80, "links": 113, "gazebo_version": "9.19.0"}
    assert (description.damage, description.defects) == ("", ())
    gantry = next(topic for topic in description.topics if topic.name == "gantry")
    assert (gantry.type, gantry.count, gantry.first_s, gantry.last_s) == ("model", 1617, 0.002, 25.192)
    assert gantry.largest_gap_s == pytest.approx(8.08)


@needs_real_log
def test_the_real_log_gives_the_bodies_a_log_map_names() -> None:
    log_map = LogMap("x", models=(BodyMatch("gantry", "robot", links=("torso_*",)), BodyMatch("agv?", "agv")))

    trial = READER.read(REAL, Wanted(log_map, frozenset({"position"})))

    assert [body.id for body in trial.bodies] == ["agv1", "agv2", "agv3", "agv4", "gantry"]
    assert trial.bodies[-1].links == ("torso_base", "torso_main", "torso_tray")
    assert trial.signal("position/agv1", unit="m").values[0].tolist() == [-2.27, 4.68, 0.0]
    assert trial.witnessed == {"bodies"}
    assert trial.recorded == Span(0.002, 25.192)


def test_a_link_that_the_log_map_names_and_the_log_lacks_does_not_vanish(tmp_path: Path) -> None:
    arm = model("arm_1", "1 0 0 0 0 0", links={"elbow": "1 1 1 0 0 0"})
    path = written(tmp_path, log_of(chunk(frame("1 0", arm, model("person_1", "9 0 0 0 0 0")))))

    trial = READER.read(path, POSITIONS)

    assert [(body.id, body.links) for body in trial.bodies] == [("arm_1", ("hand",)), ("person_1", ())]
    assert list(trial.unrecorded) == [
        "link hand of arm_1: no recorded link matches; recorded links: elbow",
    ]


def test_each_of_several_bodies_has_the_links_that_the_log_map_names(tmp_path: Path) -> None:
    arms = (model("arm_1", "1 0 0 0 0 0", links={"hand": "1 1 1 0 0 0"}), model("arm_2", "2 0 0 0 0 0"))
    path = written(tmp_path, log_of(chunk(frame("1 0", *arms))))

    trial = READER.read(path, POSITIONS)

    assert [(body.id, body.links) for body in trial.bodies] == [("arm_1", ("hand",)), ("arm_2", ("hand",))]
    assert [line.partition(":")[0] for line in trial.unrecorded] == ["link hand of arm_2"]


# What frames mean


@pytest.mark.parametrize("how", ENCODERS)
def test_every_encoding_of_a_chunk_is_read(tmp_path: Path, how: str) -> None:
    frames = frame("0 5", model("arm", "1 2 3 0 0 0")) + "\n" + frame("1 0", model("arm", "4 5 6 0 0 0"))

    states = read_states(written(tmp_path, log_of(chunk(WORLD, how), chunk(frames, how))))

    assert states.t_ns.tolist() == [5, 1_000_000_000]
    assert states.poses["arm|"][1].tolist() == [[1, 2, 3, 0, 0, 0], [4, 5, 6, 0, 0, 0]]


def test_a_model_that_is_not_listed_has_not_moved(tmp_path: Path) -> None:
    trial = read(
        tmp_path,
        frame("1 0", model("arm", "1 0 0 0 0 0"), model("box", "0 0 0 0 0 0")),
        frame("2 0", model("box", "1 0 0 0 0 0")),
        frame("3 0", model("arm", "2 0 0 0 0 0")),
    )

    signal = trial.signal("position/arm", unit="m")
    assert signal.t.tolist() == [1, 2, 3]
    assert signal.values[:, 0].tolist() == [1, 1, 2]


def test_a_deleted_body_is_gone_until_it_is_inserted_again(tmp_path: Path) -> None:
    trial = read(
        tmp_path,
        frame("1 0", model("arm", "1 0 0 0 0 0", links={"hand": "1 1 1 0 0 0"})),
        frame("2 0", "<deletions><name>other</name><name>arm</name></deletions>"),
        frame("3 0"),
        frame("4 0", model("arm", "2 0 0 0 0 0")),
        frame("5 0"),
    )

    assert trial.signal("position/arm", unit="m").t.tolist() == [1, 4, 5]
    assert trial.signal("position/arm::hand", unit="m").t.tolist() == [1]


def test_inserted_models_worlds_and_lights_give_no_poses(tmp_path: Path) -> None:
    sdf = "<model name='new'><pose>7 7 7 0 0 0</pose><link name='l'><pose>8 8 8 0 0 0</pose></link></model>"

    states = read_states(
        written(
            tmp_path,
            log_of(
                chunk(WORLD),
                chunk(
                    frame(
                        "1 0",
                        f"<insertions>{sdf}<plugin></state></plugin></insertions>",
                        model("arm", "1 2 3 0 0 0"),
                    )
                ),
            ),
        )
    )

    assert set(states.entities) == {"arm|"}
    assert states.t_ns.tolist() == [1_000_000_000]


def test_nested_models_keep_their_names_and_know_their_top(tmp_path: Path) -> None:
    tray = model("kit_tray", "1 0 0 0 0 0", links={"kit_tray::tray": "2 0 0 0 0 0"})
    late_link = "<link name='late'><pose>3 0 0 0 0 0 </pose></link>"
    frames = frame("1 0", model("agv1", "0 0 0 0 0 0", nested=tray + late_link), model("box", "4 0 0 0 0 0"))

    states = read_states(written(tmp_path, log_of(chunk(frames))))

    assert states.models == ("agv1", "box", "kit_tray")
    assert states.entities["kit_tray|kit_tray::tray"] == Entity("agv1", "kit_tray", "kit_tray::tray")
    assert states.poses["agv1|late"][1][0, 0] == 3.0
    assert states.entities["box|"].top == "box"


def test_nested_models_of_one_name_are_told_apart_by_their_path(tmp_path: Path) -> None:
    frames = frame(
        "1 0",
        model("agv1", "0 0 0 0 0 0", nested=model("tray", "1 0 0 0 0 0")),
        model("agv2", "0 0 0 0 0 0", nested=model("tray", "2 0 0 0 0 0")),
    )

    states = read_states(written(tmp_path, log_of(chunk(frames))))

    assert states.poses["tray|"][1][0, 0] == 1.0
    assert states.poses["agv2::tray|"][1][0, 0] == 2.0


def test_names_may_hold_bars_quotes_and_entities(tmp_path: Path) -> None:
    odd = '<model name="it\'s"><pose>1 0 0 0 0 0</pose></model>'

    states = read_states(
        written(
            tmp_path,
            log_of(
                chunk(frame("1 0", model("bin2|pump_1", "0 0 0 0 0 0"), odd, model("a&amp;b", "0 0 0 0 0 0")))
            ),
        )
    )

    assert states.models == ("a&b", "bin2|pump_1", "it's")


def test_only_wanted_poses_are_converted_but_all_models_are_named(tmp_path: Path) -> None:
    path = written(
        tmp_path, log_of(chunk(frame("1 0", model("a", "1 0 0 0 0 0"), model("b", "2 0 0 0 0 0"))))
    )

    states = read_states(path, lambda entity: entity.model == "b")

    assert list(states.poses) == ["b|"]
    assert states.models == ("a", "b")


def test_bodies_are_there_even_when_no_positions_are_wanted(tmp_path: Path) -> None:
    path = written(tmp_path, log_of(chunk(frame("1 0", model("person_1", "1 0 0 0 0 0")))))

    trial = READER.read(path, Wanted(BODIES))

    assert [(body.id, body.kind, body.radius_m) for body in trial.bodies] == [("person_1", "human", 0.3)]
    assert not trial.signals


def test_chunks_with_frames_that_straddle_the_pieces_of_reading_are_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gazebo_text, "_PIECE_BYTES", 7)
    frames = "".join(frame(f"{i} 0", model("arm", f"{i} 0 0 0 0 0")) for i in range(20))

    states = read_states(written(tmp_path, log_of(chunk(WORLD), chunk(frames), chunk(WORLD, "bz2"))))

    assert states.poses["arm|"][1][:, 0].tolist() == list(range(20))


def test_progress_ends_at_one(tmp_path: Path) -> None:
    shares: list[float] = []
    path = written(tmp_path, log_of(chunk(WORLD), chunk(frame("1 0", model("arm", "0 0 0 0 0 0")))))

    read_states(path, progress=shares.append)

    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0, abs=0.2)


# What is survived


def test_of_a_repeated_time_the_last_frame_counts(tmp_path: Path) -> None:
    trial = read(
        tmp_path,
        frame("1 0", model("arm", "1 0 0 0 0 0")),
        frame("1 0", model("arm", "2 0 0 0 0 0")),
        frame("2 0", model("arm", "3 0 0 0 0 0")),
    )

    assert trial.signal("position/arm", unit="m").values[:, 0].tolist() == [2, 3]
    assert [(d.kind, d.where, d.count) for d in trial.log_defects] == [("repeated_stamps", "state.log", 1)]


def test_a_pose_that_is_not_finite_leaves_a_gap(tmp_path: Path) -> None:
    trial = read(
        tmp_path,
        frame("1 0", model("arm", "1 0 0 0 0 0")),
        frame("2 0", model("arm", "-nan inf 0 0 0 0")),
        frame("3 0", model("arm", "3 0 0 0 0 0")),
    )

    assert trial.signal("position/arm", unit="m").t.tolist() == [1, 3]
    assert [(d.kind, d.count) for d in trial.log_defects] == [("impossible_values", 1)]


@pytest.mark.parametrize("how", ENCODERS)
def test_a_log_cut_off_in_a_chunk_is_read_up_to_the_cut(tmp_path: Path, how: str) -> None:
    rows = np.random.default_rng(1).random((2000, 3))
    frames = [frame(f"{i} 500000000", model("arm", f"{x} {y} {z} 0 0 0")) for i, (x, y, z) in enumerate(rows)]
    whole = START + chunk("".join(frames[:1000]), how) + chunk("".join(frames[1000:]), how)
    path = written(tmp_path, whole[: len(whole) - 20])

    trial = READER.read(path, POSITIONS)

    (defect,) = trial.log_defects
    assert trial.recorded is not None
    last_s = trial.recorded.end_s
    assert defect.kind == "cut_off"
    assert f"read up to {last_s:.3f} s" in defect.message
    assert last_s >= 999.5  # bz2 can give back no part of a block


def test_a_log_without_its_end_is_whole_up_to_there(tmp_path: Path) -> None:
    path = written(tmp_path, START + chunk(frame("1 250000000", model("arm", "1 0 0 0 0 0"))))

    (defect,) = READER.describe(path).defects

    assert defect.message == (
        "the file ends after chunk 1 without </gazebo_log>; it was read up to 1.250 s of simulated time"
    )


@pytest.mark.parametrize("how", ENCODERS)
def test_a_cut_anywhere_is_a_shorter_log_or_an_error_that_says_so(tmp_path: Path, how: str) -> None:
    frames = "".join(frame(f"{i} 0", model("arm", f"{i} 0 0 0 0 0")) for i in range(8))
    whole = log_of(chunk(WORLD, how), chunk(frames, how)).encode()
    path = tmp_path / "state.log"
    for cut in range(1, len(whole), 47):
        path.write_bytes(whole[:cut])
        try:
            trial = READER.read(path, POSITIONS)
        except LogError:
            continue  # not one whole frame is left
        assert [defect.kind for defect in trial.log_defects] == ["cut_off"]
        values = trial.signal("position/arm", unit="m").values[:, 0].tolist()
        assert values == list(range(len(values)))


# What is refused


def test_a_missing_file_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="no such file"):
        READER.read(tmp_path / "state.log", POSITIONS)


def test_an_empty_file_is_nothing_to_score(tmp_path: Path) -> None:
    path = written(tmp_path, "")

    assert READER.can_read(path)
    assert "empty" in READER.describe(path).damage
    with pytest.raises(NothingToScoreError, match="empty"):
        READER.read(path, POSITIONS)


@pytest.mark.parametrize("text", [START, START + END, log_of(chunk(WORLD)), START + "<chunk", "<gazebo_log>"])
def test_a_log_without_a_frame_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(LogError, match="not one whole frame"):
        READER.read(written(tmp_path, text), POSITIONS)


GOOD = packed_zlib(frame("1 0", model("arm", "1 0 0 0 0 0")) * 50)
FLIPPED = GOOD[:60] + ("A" if GOOD[60] != "A" else "B") + GOOD[61:]


@pytest.mark.parametrize(
    ("encoding", "body", "cause"),
    [
        ("zlib", "*" + GOOD, "is not base64"),
        ("zlib", GOOD[:-3], "not base64"),
        ("zlib", FLIPPED, "cannot be decompressed"),
        ("zlib", GOOD[:40], "ends early"),
        ("zlib", "", "ends early"),
        ("zlib", base64.b64encode(base64.b64decode(GOOD) + b"more").decode(), "bytes follow"),
        ("bz2", GOOD, "cannot be decompressed"),
        ("lzma", GOOD, "'lzma' is not txt, zlib or bz2"),
        ("txt", frame("", model("arm", "1 0 0 0 0 0")), "no <sim_time>"),
        ("txt", frame("1.5", model("arm", "1 0 0 0 0 0")), "no <sim_time>"),
        ("txt", frame("99999999999 0"), "292 years"),
        ("txt", frame("1 0", model("arm", "1 0 0")), "'arm|' a pose that is not six numbers"),
        ("txt", frame("1 0", model("arm", "1 0 0 0 0 zero")), "not six numbers"),
        ("txt", frame("1 0", "<model name=arm><pose>1 0 0 0 0 0</pose></model>"), "without a quoted name"),
    ],
)
def test_a_corrupt_chunk_is_refused_with_its_number_and_place(
    tmp_path: Path, encoding: str, body: str, cause: str
) -> None:
    before = START + chunk(frame("0 1", model("arm", "0 0 0 0 0 0")))
    bad = f"<chunk encoding='{encoding}'><![CDATA[{body}]]></chunk>"
    path = written(tmp_path, before + bad + END)

    with pytest.raises(LogError) as caught:
        READER.read(path, POSITIONS)

    assert "chunk 2 is corrupt" in caught.value.cause
    assert cause in caught.value.cause
    assert caught.value.place == f"byte {len(before) + len('<chunk')}"
    assert caught.value.hint


def test_a_corrupt_log_is_described_by_what_comes_before(tmp_path: Path) -> None:
    good = chunk(frame("0 1", model("arm", "0 0 0 0 0 0")))
    path = written(tmp_path, log_of(good, "<chunk encoding='zlib'>!</chunk>"))

    description = READER.describe(path)

    assert description.facts["states"] == 1
    assert "chunk 2 is corrupt" in description.damage


@pytest.mark.parametrize("after", ["", chunk(frame("3 0", model("arm", "0 0 0 0 0 0")))])
def test_a_chunk_whose_tag_is_damaged_is_not_passed_over(tmp_path: Path, after: str) -> None:
    good, bad = (chunk(frame(f"{i} 0", model("arm", "0 0 0 0 0 0"))) for i in (1, 2))

    with pytest.raises(LogError, match="what follows chunk 1 is corrupt"):
        READER.read(written(tmp_path, log_of(good, bad.replace("<chunk", "<chunl"), after)), POSITIONS)


def test_a_log_corrupt_within_a_frame_is_described_by_the_frames_before(tmp_path: Path) -> None:
    good = frame("0 1", model("arm", "0 0 0 0 0 0"))
    bad = frame("1 1", model("arm", "0 0 0 0 0 0"), model("box", "0 0 0 0 0 0"), "<model name=x>")

    description = READER.describe(written(tmp_path, log_of(chunk(good + bad))))

    assert [(topic.name, topic.count) for topic in description.topics] == [("arm", 1)]
    assert "without a quoted name" in description.damage


@pytest.mark.parametrize("how", ["zlib", "bz2"])
def test_a_chunk_that_inflates_beyond_the_limit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr(gazebo_text, "MAX_CHUNK_BYTES", 3_000_000)
    path = written(tmp_path, log_of(chunk(" " * 4_000_000, how)))

    with pytest.raises(LogError, match="inflates to more than 3,000,000 bytes"):
        READER.read(path, POSITIONS)


def test_a_chunk_longer_than_the_limit_in_the_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gazebo_text, "MAX_CHUNK_BYTES", 3_000_000)

    with pytest.raises(LogError, match="more than 3,000,000 bytes without"):
        READER.read(written(tmp_path, START + chunk(" " * 4_000_000, "txt")), POSITIONS)


def test_a_frame_without_an_end_is_refused_before_it_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gazebo_text, "MAX_FRAME_BYTES", 1_500_000)

    with pytest.raises(LogError, match="without the end of a frame"):
        READER.read(written(tmp_path, log_of(chunk("<world " + "x" * 2_000_000))), POSITIONS)


def test_time_that_runs_far_back_is_two_recordings(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="runs backwards"):
        read(
            tmp_path,
            frame("9 0", model("arm", "1 0 0 0 0 0")),
            frame("1 0", model("arm", "1 0 0 0 0 0")),
        )


def test_two_models_for_one_body_are_refused(tmp_path: Path) -> None:
    log_map = LogMap("x", models=(BodyMatch("arm_*", "robot", body="arm"),))
    path = written(
        tmp_path, log_of(chunk(frame("1 0", model("arm_1", "1 0 0 0 0 0"), model("arm_2", "2 0 0 0 0 0"))))
    )

    with pytest.raises(LogError, match="recorded twice"):
        READER.read(path, Wanted(log_map, frozenset({"position"})))


@pytest.mark.parametrize("content", [b"", b"hello", b"\0" * 2000, b"<?xml version='1.0'?><sdf/>"])
def test_other_files_are_not_claimed(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.log"
    path.write_bytes(content)

    assert not READER.can_read(path)
    assert not READER.can_read(tmp_path)
    assert not READER.can_read(tmp_path / "missing.log")


def some_frames(seed: int) -> list[str]:
    """Models whose links come and go, whose parts are nested, of which some stand still; all by chance."""
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets

    def pose() -> str:
        return " ".join(dice.choice(["0", "-1.5", "2e-3", "0.25"]) for _ in range(6))

    def one(name: str, depth: int) -> str:
        links = {f"l{n}": pose() for n in range(3) if dice.random() < 0.7}
        inside = [one(f"{name}_{n}", depth + 1) for n in range(2) if depth < 2 and dice.random() < 0.3]
        return model(name, pose(), links=links, nested="".join(inside))

    kept = {name: one(name, 0) for name in ("a", "b", "c")}
    frames = []
    for number in range(dice.randint(1, 12)):
        for name in kept:
            if dice.random() < 0.4:
                kept[name] = one(name, 0)
        listed = [text for text in kept.values() if dice.random() < 0.8]
        if dice.random() < 0.2:
            listed.insert(0, "<insertions>" + model("new", pose()) + "</insertions>")
        if dice.random() < 0.2:
            listed.insert(0, "<deletions><name>c</name></deletions>")
        frames.append(frame(f"{number} 0", *listed))
    return frames


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([64, 700, 1 << 20]))
def test_random_frames_give_the_poses_an_xml_parser_finds(tmp_path: Path, seed: int, piece: int) -> None:
    frames = some_frames(seed)
    expected: dict[str, list[tuple[int, list[float]]]] = defaultdict(list)
    for number, text in enumerate(frames):
        (state,) = ET.fromstring(text)  # noqa: S314  # ours
        for found in state.iterfind(".//model"):
            if found in list(state.iterfind("insertions/model")):
                continue
            own = (found.attrib["name"], "", found)
            for name, link, place in [own, *((own[0], e.attrib["name"], e) for e in found.iterfind("link"))]:
                numbers = [float(word) for word in (place.findtext("pose") or "").split()]
                expected[f"{name}|{link}"].append((number, numbers))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gazebo_text, "_PIECE_BYTES", piece)
        states = read_states(written(tmp_path, log_of(chunk(WORLD + "".join(frames)))))

    assert {
        key: list(zip(at.tolist(), poses.tolist(), strict=True)) for key, (at, poses) in states.poses.items()
    } == expected
    assert states.deleted.get("c", np.zeros(0)).tolist() == [
        n for n, f in enumerate(frames) if "<deletions>" in f
    ]


@pytest.mark.parametrize("odd", ["<model\tname=", "<model  name =", "<model\nname="])
def test_a_model_that_is_written_otherwise_is_seen_wherever_it_comes(tmp_path: Path, odd: str) -> None:
    def listed(time: int, *, arm: str, more: str = "", first: str = "") -> str:
        return frame(f"{time} 0", first, model("arm", arm), model("box", "7 0 0 0 0 0"), more)

    other = model("late", "9 0 0 0 0 0").replace("<model name=", odd)
    frames = [
        listed(1, arm="1 0 0 0 0 0"),
        listed(2, arm="2 0 0 0 0 0", more=other),
        listed(3, arm="3 0 0 0 0 0"),
        listed(4, arm="4 0 0 0 0 0", first=other),
        listed(5, arm="5 0 0 0 0 0", more=other),
    ]
    states = read_states(written(tmp_path, log_of(chunk(WORLD + "".join(frames)))))

    assert states.poses["arm|"][1][:, 0].tolist() == [1, 2, 3, 4, 5]
    assert states.listed["late"].tolist() == [1, 3, 4]
    assert states.listed["box"].tolist() == [0, 1, 2, 3, 4]
    assert states.poses["late|"][1][:, 0].tolist() == [9, 9, 9]


def test_of_a_model_that_a_frame_lists_twice_the_last_text_counts(tmp_path: Path) -> None:
    bare = "<model name='arm_1'></model>"
    trial = read(
        tmp_path, frame("1 0", model("arm_1", "1 0 0 0 0 0"), bare, model("person_1", "0 0 0 0 0 0"))
    )

    assert "position/arm_1" not in trial.signals
    assert len(trial.signals["position/person_1"]) == 1


def test_a_body_that_a_frame_both_deletes_and_lists_is_there(tmp_path: Path) -> None:
    # A name that is deleted and inserted again between two frames stands in both parts of the next one.
    trial = read(
        tmp_path,
        frame("1 0", model("arm", "1 0 0 0 0 0")),
        frame("2 0", "<deletions><name>arm</name></deletions>", model("arm", "2 0 0 0 0 0")),
        frame("3 0"),
        frame("4 0", "<deletions><name>arm</name></deletions>"),
        frame("5 0"),
    )

    signal = trial.signal("position/arm", unit="m")
    assert signal.t.tolist() == [1, 2, 3]
    assert signal.values[:, 0].tolist() == [1, 2, 2]
