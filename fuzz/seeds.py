"""Make the corpus: `python -m fuzz.seeds [FOLDER]`. Small, whole inputs for each target, always the same."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import shutil
import sqlite3
import struct
import sys
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from ariac_score import score_trial
from ariac_score.batch.index import Row
from ariac_score.batch.outcomes import CheckCounts, Summary
from ariac_score.batch.tasks import BatchSetting, Limits
from ariac_score.platforms.evalai import Challenge, challenge_config
from ariac_score.platforms.submission import phase_text
from ariac_score.results.cohort_file import Cohort, CohortMean, cohort_text
from ariac_score.results.result import Pinned
from ariac_score.results.result_file import as_json
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.testing import SNAPSHOT_SIGNALS, Recorded, write_bag, write_event_log, write_trial_log
from ariac_score.testing.repacked import McapForm, repacked
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.official_database import write_database_competition as write_database
from ariac_score_ariac.testing.official_texts import Outcome, PlannedOrder, sensor_cost_text, trial_log_text
from ariac_score_ariac.testing.recordings import recorded_messages
from fuzz.targets import SMALL_RULES

__all__ = ["CORPUS", "write_corpus"]

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
_DATA = HERE.parent / "tests/data"
_STAMP = (1980, 1, 1, 0, 0, 0)

Seeds = Iterator[tuple[str, bytes]]


def write_corpus(folder: Path) -> None:
    """Write every seed below a folder, one folder for each target."""
    for name, made in _MAKERS.items():
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir(parents=True)
        with tempfile.TemporaryDirectory() as work:
            for file, raw in made(Path(work)):
                (folder / name / file).write_bytes(raw)


def _messages(*, all_kinds: bool = True) -> list[Recorded]:
    """A few messages of each kind, or of what moves alone: definitions are long."""
    count: dict[str, int] = {}
    few = []
    for message in recorded_messages(kitting_trial(duration_s=33.0)):
        count[message.topic] = count.get(message.topic, 0) + 1
        if count[message.topic] <= 3 and (all_kinds or "snapshot" in message.topic):
            few.append(message)
    return few


def _mcap(work: Path) -> Seeds:
    yield "moves", write_bag(work / "s.mcap", _messages(all_kinds=False), storage="mcap").read_bytes()
    yield "zstd", write_bag(work / "z.mcap", _messages(), storage="mcap", compression="zstd").read_bytes()


def _ros1(work: Path) -> Seeds:
    small = _messages(all_kinds=False)
    yield "moves", write_bag(work / "s.bag", small, storage="ros1").read_bytes()
    yield "bz2", write_bag(work / "b.bag", _messages(), storage="ros1", compression="bz2").read_bytes()
    yield "lz4", write_bag(work / "l.bag", small, storage="ros1", compression="lz4").read_bytes()


def _sizes() -> list[Recorded]:
    """Messages of two topics, small ones and large ones, in stretches in which there is only one of them."""
    wanted = "ssslslllslsllssl"
    return [
        Recorded(
            "/small" if kind == "s" else "/large",
            "std_msgs/msg/UInt8" if kind == "s" else "std_msgs/msg/String",
            10**9 + 10**6 * number,
            {"data": number} if kind == "s" else {"data": chr(97 + number) * 240},
        )
        for number, kind in enumerate(wanted)
    ]


def _mcap_scan(work: Path) -> Seeds:
    whole = write_bag(work / "s.mcap", _sizes(), storage="mcap").read_bytes()
    plain = McapForm(chunk_bytes=400, chunk_checksums=False)
    yield "plain", repacked(whole, plain)
    yield "checked", repacked(whole, McapForm("lz4", chunk_bytes=600, data_checksum=True))
    yield "lz4", repacked(whole, replace(plain, compression="lz4"))
    yield "zstd", repacked(whole, replace(plain, compression="zstd", chunk_bytes=700))
    yield "no_indexes", repacked(whole, replace(plain, indexed=False))
    yield "no_chunks", repacked(whole, replace(plain, chunk_bytes=0))


def _ros1_scan(work: Path) -> Seeds:
    yield "plain", write_bag(work / "p.bag", _sizes(), storage="ros1", chunk_bytes=400).read_bytes()
    for packing in ("lz4", "bz2"):
        bag = write_bag(
            work / f"{packing}.bag", _sizes(), storage="ros1", compression=packing, chunk_bytes=900
        )
        yield packing, bag.read_bytes()


def _sqlite(work: Path) -> Seeds:
    yield "moves", write_bag(work / "s.db3", _messages(all_kinds=False), storage="sqlite3").read_bytes()


def _sqlite_scan(work: Path) -> Seeds:
    rows = [(i, 1 + i % 2, 10**18 + i, b"%03d" % i * (i % 6)) for i in range(1, 31)]
    for name, more in (("leaves", []), ("chains", [(40, 1, 5, b"z" * 900), (900, 2, 0, b"y" * 1500)])):
        with closing(sqlite3.connect(work / name)) as bag:
            bag.execute("PRAGMA page_size=512")
            bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
            columns = "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB"
            bag.execute(f"CREATE TABLE messages({columns})")
            bag.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
            bag.execute("INSERT INTO topics VALUES (1, '/a', 'a/msg/A'), (2, '/b', 'a/msg/A')")
            bag.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", [*rows, *more])
            bag.commit()
        raw = bytearray((work / name).read_bytes())
        raw[96:100] = bytes(4)  # which version of SQLite wrote it
        yield name, bytes(raw)


def _jsonl(work: Path) -> Seeds:
    text = write_trial_log(work / "t.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS).read_text()
    records = [json.loads(line) for line in text.splitlines()]
    samples = [record for record in records if record["record"] == "sample"][:6]
    few = [record for record in records if record["record"] != "sample" or record in samples]
    few[-1]["records"] = len(few)
    yield "kitting", "".join(json.dumps(record) + "\n" for record in few).encode()


def _monitored(work: Path) -> Seeds:
    yield "events", write_event_log(work / "e.json", _messages()).read_bytes()
    event = {"topic": "scan", "time": 1.5, "verdict": "currently_true", "ranges": "array('d', [1.0, 2.0])"}
    yield "array", json.dumps(event).encode()


_WORLD = (
    "<sdf version ='1.6'><world name='w'><state world_name='w'><sim_time>0 0</sim_time></state></world></sdf>"
)


def _frame(second: int) -> str:
    models = "".join(
        f"<model name='{name}'><pose>{second} 0 1 0 0 0.5</pose>"
        f"<link name='base'><pose>0 {second} 1 0 0 0</pose>"
        "<velocity>1 2 3 4 5 6</velocity></link></model>"
        for name in ("ariac_human", "agv1", "part_red_1")
    )
    return (
        f"<sdf version='1.6'><state world_name='w'><sim_time>{second} 5</sim_time><wall_time>9 9</wall_time>"
        f"<iterations>1</iterations><deletions><name>part_{second}</name></deletions>{models}</state></sdf>"
    )


def _chunk(text: str, encoding: str) -> str:
    inside = text if encoding == "txt" else base64.b64encode(zlib.compress(text.encode())).decode()
    return f"<chunk encoding='{encoding}'>\n<![CDATA[{inside}]]>\n</chunk>\n"


def _states(_: Path) -> Seeds:
    head = "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<log_version>1.0</log_version>\n"
    head += "<gazebo_version>9.19.0</gazebo_version>\n<rand_seed>1</rand_seed>\n</header>\n"
    frames = "".join(_frame(second) for second in (1, 2, 3))
    for encoding in ("txt", "zlib"):
        log = head + _chunk(_WORLD, encoding) + _chunk(frames, encoding) + "</gazebo_log>"
        yield encoding, log.encode()


_KIT = PlannedOrder("AAAA0001", "kitting", True, (("pump", "red"), ("battery", "blue")))
_INSERT = PlannedOrder("BBBB0002", "assembly", False, (("sensor", "green"),))


def _trial_text() -> str:
    return trial_log_text(
        "kitting", (_KIT, _INSERT), [Outcome(("", "color"), 50.0), Outcome(("pose",), None)]
    )


def _trial_log(_: Path) -> Seeds:
    yield "2024", _trial_text().encode()
    yield "crashed", b"Gazebo Crashed score not recorded\n"


def _sensor_cost(_: Path) -> Seeds:
    yield "2024", sensor_cost_text({"basic_logical_camera": 2, "break_beam": 3}).encode()


def _performance(_: Path) -> Seeds:
    for year in ("2020", "2022"):
        yield year, (_DATA / f"performance_{year}.log").read_bytes()


def _database(work: Path) -> Seeds:
    write_database(work / "ariac.db")
    connection = sqlite3.connect(work / "ariac.db")
    for table in ("Penalty", "OrderSubmission"):
        connection.execute(f"DELETE FROM {table} WHERE run_id > 1")  # noqa: S608  # one of two constants
    connection.execute("DELETE FROM Run WHERE id > 1")
    connection.commit()
    connection.execute("VACUUM")
    connection.close()
    yield "2025", (work / "ariac.db").read_bytes()


_TEAM = b"""team_name: aurora
sensors:
  cam_1: {type: logical_camera, pose: {xyz: [-2.2, 2.9, 'pi/2'], rpy: ['pi', 0, -0.5]}}
  beam_1: {type: break_beam, pose: {xyz: [0, 0, 1], rpy: [0, 0, 0]}}
"""
_TRIAL_2024 = b"""time_limit: 600
kitting_trays: {tray_ids: [1, 2], slots: [1, 4]}
assembly_inserts: {as1: 0.0, as2: 10}
parts: {bins: {bin1: [{type: pump, color: red, slots: [1, 2], rotation: pi/4, flipped: false}]}}
orders:
- id: 'AAAA0001'
  type: 'kitting'
  announcement: {time_condition: 0}
  priority: false
  kitting_task:
    agv_number: 2
    tray_id: 1
    destination: 'warehouse'
    products: [{type: 'pump', color: 'red', quadrant: 1}]
challenges: [{dropped_part: {robot: floor_robot, type: pump, color: red, drop_after: 1, delay: 15}}]
"""
_TRIAL_2025 = b"ID: LHAF9835\nSEED: 7\nDEFECT_RATE: 0.2\nTIME_LIMIT: 600\nNUM_KITS: 2\nNUM_MODULES: 1\n"


def _trials(_: Path) -> Seeds:
    yield "2022", (_DATA / "trial_2022.yaml").read_bytes()
    yield "2024", _TRIAL_2024
    yield "2025", _TRIAL_2025


def _teams(_: Path) -> Seeds:
    yield "2022", _TEAM


def _rule_sets(_: Path) -> Seeds:
    yield "extends", b"id: mine\nextends: paper2020\ntitle: mine\nsource: mine\n"
    yield "small", SMALL_RULES.encode()


def _log_maps(_: Path) -> Seeds:
    shipped = (HERE.parent / "rules/ariac2018/log_map.yaml").read_bytes()
    yield "2018", shipped
    bodies = b"bodies: {robot: {kind: robot, radius_m: 0.2}}\nmodels: [{match: 'arm*', kind: robot}]\n"
    yield "small", b"id: x\ntitle: x\nsource: x\n" + bodies


_PLAIN = (
    b"id: x\ntitle: x\nrules: paper2020\nteams: [{id: a}]\ntrials: [{id: t}]\nruns: '{team}*{trial}.yaml'\n"
)


def _columnar(_: Path) -> Seeds:
    """Programs of `fuzz.columns`: definition, packing and slabs, then whole messages and changed ones."""
    again, damaged = b"\3\5", b"\4\5\0\xff\6\4\0\xff\xff\xff\xff\5\11\0\7\2ab"
    for number, packing in enumerate((0, 1, 2, 0xD0, 0xE2)):
        yield f"by_hand_{number}", bytes((number, packing)) + b"\1\0" + again + b"\1\1\1\2\1\3" + damaged
        made = b"".join(b"\1%c\4\12\0\1" % i for i in range(8))
        yield f"by_dice_{number}", bytes((9 + 11 * number, packing | 4 * number)) + made + again + damaged
    text = struct.pack("<I4s", 4, b"abc\0") + struct.pack("<I4x2dB", 2, 1.0, 2.0, 7)
    yield "own_bytes", b"\1\0\0" + struct.pack("<H", 4 + len(text)) + b"\0\1\0\0" + text + again


def _wide_texts(_: Path) -> Seeds:
    """Programs of `fuzz.wide`: definition, way and slabs, then messages, some in another way or damaged."""
    damaged = b"\3\7\1\0\4\3\0\xff\5\11\0\0\6\2ab"
    for number in range(6):
        whole = b"".join(b"\0%c\0\0" % (10 * number + i) for i in range(4))
        way, order, bound = number % 3, 4 * (number & 1), 0x80 * (number // 3)
        yield f"whole_{number}", bytes((number, way | order | bound)) + whole
        yield f"damaged_{number}", bytes((number, way)) + whole[:8] + damaged


def _definitions(_: Path) -> Seeds:
    yield "plain", b"float64 x\nuint8 LAST=3\nstring[<=2] names  # why\nint8[3] z\n"
    yield (
        "nested",
        b"std_msgs/Header header\nB[] bs\n"
        + b"=" * 80
        + b"\nMSG: fuzz/B\ntime t\n"
        + b"=" * 80
        + b"\nMSG: std_msgs/Header\nuint32 seq\n",
    )


def _competitions(_: Path) -> Seeds:
    yield "plain", _PLAIN
    yield "2024", (HERE.parent / "examples/competition/2024/competition.yaml").read_bytes()


def _rml(_: Path) -> Seeds:
    yield "separation", (HERE.parent / "examples/rml/separation.rml").read_bytes()
    yield "let", b"a(n) matches {x:n}; b matches {name:'a'} with x > 0; Main = {let n; a(n) b*} /\\ all;\n"
    yield (
        "generic",
        b"a(x) matches {y:x}; F<n> = if (n > 0) a(n) F<n-1> else empty; Main = F<3> | b>>all; b matches _;\n",
    )


def _rml_events(_: Path) -> Seeds:
    yield "lines", b'{"x": 1, "y": 2.5}\n{"x": 2, "y": -1e3}\n{"x": 1, "y": 0}\n'
    yield "mixed", b'{"a": [1, {"b": null}], "x": "1",}  {"x": true}'


def _stl(_: Path) -> Seeds:
    texts = ("always (d > 1 -> eventually[0:2] v < 0.5)", "d >= 2 until[0.5:1.5] abs(v) < 1 xor once d < 3")
    for number, text in enumerate((*texts, "historically[0:1] (d - 2*v > 0 <-> rise (d > 2)) or next v > 1")):
        yield str(number), text.encode()


def _expressions(_: Path) -> Seeds:
    texts = ("1 + max(a, 2) ** 2", "a / z if b.c < 0 else clip(a, -1, 1)", "not (a and z) == abs(-a)")
    for number, text in enumerate(texts):
        yield str(number), text.encode()


def _results(work: Path) -> Seeds:
    (work / "trial_log.txt").write_text(_trial_text())
    text = as_json(score_trial(work / "trial_log.txt", "ariac2024.release_5"))
    yield "2024", text.encode()
    log = work / "t.jsonl"
    log.write_bytes(next(_jsonl(work))[1])
    yield "small", as_json(score_trial(log, rule_set_from_text(SMALL_RULES, file="small.yaml"))).encode()


def _archives(_: Path) -> Seeds:
    for name, method in (("stored", zipfile.ZIP_STORED), ("deflated", zipfile.ZIP_DEFLATED)):
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", method) as zipped:
            for member in ("kit_1/log.jsonl", "kit_1/trial.yaml"):
                zipped.writestr(zipfile.ZipInfo(member, _STAMP), b"0123456789" * 5, method)
        yield f"{name}.zip", out.getvalue()
    for name, mode in (("plain.tar", "w"), ("packed.tar.xz", "w:xz")):
        out = io.BytesIO()
        with tarfile.open(fileobj=out, mode=mode) as taped:  # type: ignore[call-overload]  # of two constants
            entry = tarfile.TarInfo("kit_1/log.jsonl")
            entry.size = 10
            taped.addfile(entry, io.BytesIO(b"0123456789"))
        yield name, out.getvalue()


def _bundles(_: Path) -> Seeds:
    yield "one_log", b"logs: [log.jsonl]\n"
    checksums = f"sha256:\n  log.jsonl: {hashlib.sha256(b'{}').hexdigest()}\n".encode()
    yield "named", b"id: kit_1\nlogs:\n  - log.jsonl\ntrial_config: log.jsonl\n" + checksums


def _cohorts(_: Path) -> Seeds:
    means = {"mean_cost": {"": CohortMean(12.5, 3, 1)}, "mean_time": {"order_1": CohortMean(None, 0, 0)}}
    yield "made", cohort_text(Cohort.of(Pinned("ariac2024.release_5", "0" * 64), {"kit_1": means})).encode()


def _decisions(_: Path) -> Seeds:
    yield (
        "two",
        b"adjustments:\n"
        b"  - id: protest_3\n    author: A. Example\n    reason: a marshal was in the way\n"
        b"    time: 2024-05-12T14:30:00Z\n"
        b"    target: {trial: kit_1, measured: '" + b"0" * 64 + b"', finding: 'separation#1'}\n"
        b"    effect: {verdict: satisfied}\n"
        b"  - id: penalty_1\n    author: A. Example\n    reason: left early\n"
        b"    time: 2024-05-12T15:10:00+02:00\n"
        b"    target: {trial: kit_1, measured: '" + b"0" * 64 + b"'}\n"
        b"    effect: {points: -2}\n",
    )


def _signatures(_: Path) -> Seeds:
    signed, told = (base64.b64encode(b"ED" + bytes(8) + bytes(64)), base64.b64encode(bytes(64)))
    lines = (b"untrusted comment: made", signed, b"trusted comment: of nothing", told)
    yield "signature", b"\n".join(lines) + b"\n"
    yield "key", b"untrusted comment: made\n" + base64.b64encode(b"Ed" + bytes(8) + bytes(range(32))) + b"\n"


def _phases(_: Path) -> Seeds:
    limits = Limits(wall_s=60.0, memory_bytes=1 << 30, output_bytes=1 << 20)
    setting = BatchSetting(SMALL_RULES, "small", "small.yaml", limits)
    text = phase_text("finals", setting, {"kit_1": "", "kit_2": ""})
    yield "made", text.encode()
    named = json.loads(text) | {"trials": {"kit_1": "kit_1.yaml"}}
    yield "earlier", json.dumps(named | {"schema": "ariac-score/phase/1"}).encode()


def _challenges(_: Path) -> Seeds:
    yield "made", challenge_config(Challenge("Example", "finals")).encode()


def _batch_rows(_: Path) -> Seeds:
    checks = (CheckCounts("separation", -0.25, satisfied=2, violated=1, inconclusive=0, not_applicable=0),)
    rows = [
        Row.of(
            ("a", "kit_1", 1), Summary("scored", "", 19.5, 20.0, checks), "objects/00/00/0.json", "0" * 64
        ),
        Row.of(("b", "kit_1", 1), Summary("crashed", "signal 11", None, None)),
    ]
    yield "two", "".join(row.as_line() for row in rows).encode()


def _frames(_: Path) -> Seeds:
    event = {"topic": "snapshot", "human_operator_speed": 0.0, "robot_speed": 0.5, "time": 1.0}
    frames = [
        {**event, "distance_robot_human_operator": distance, "time": t} for t, distance in enumerate((9, 1))
    ]
    yield "snapshots", "\n".join(json.dumps(frame) for frame in frames).encode()


_MAKERS: dict[str, Callable[[Path], Seeds]] = {
    "adjustments": _decisions,
    "archive": _archives,
    "ariac_database": _database,
    "batch_rows": _batch_rows,
    "bundle": _bundles,
    "cohort": _cohorts,
    "columnar": _columnar,
    "competition": _competitions,
    "definition": _definitions,
    "evalai_challenge": _challenges,
    "expression": _expressions,
    "jsonl": _jsonl,
    "log_map": _log_maps,
    "mcap": _mcap,
    "mcap_peer": _mcap_scan,
    "mcap_scan": _mcap_scan,
    "oracle": _frames,
    "performance_log": _performance,
    "phase": _phases,
    "result": _results,
    "rml": _rml,
    "rml_events": _rml_events,
    "ros1_bag": _ros1,
    "ros1_peer": _ros1_scan,
    "ros1_scan": _ros1_scan,
    "ros_monitoring": _monitored,
    "rule_set": _rule_sets,
    "sensor_cost": _sensor_cost,
    "signature": _signatures,
    "sqlite_bag": _sqlite,
    "sqlite_scan": _sqlite_scan,
    "state_log": _states,
    "stl": _stl,
    "team_config": _teams,
    "trial_config": _trials,
    "trial_log": _trial_log,
    "wide_text": _wide_texts,
}


if __name__ == "__main__":
    write_corpus(Path(sys.argv[1]) if len(sys.argv) > 1 else CORPUS)
