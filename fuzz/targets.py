"""One target for each parser: bytes in, nothing out, and no exception but an expected one.

A target writes the bytes where its parser looks for them, and calls it as the commands do. Whatever
it raises is a finding, and so are an input that takes too long and one that takes too much memory.
"""

from __future__ import annotations

import atexit
import io
import os
import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from shutil import rmtree

import numpy as np

from ariac_score import Body, Signal, Span, Trial, load_rule_set
from ariac_score.batch.index import checked_rows, read_rows
from ariac_score.checks import registry
from ariac_score.checks.contracts import Monitor, Reader, Wanted
from ariac_score.checks.guarded import GuardedDecoder
from ariac_score.checks.registry import Registry
from ariac_score.engine.read import find_trial
from ariac_score.errors import PluginError, ScoreError
from ariac_score.installed.points import installed_points, unreadable_hint
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.types import UnknownTypeError, column_decoder_for
from ariac_score.logs.containers.items import Batch, Connection
from ariac_score.logs.containers.sqlite import SqliteScan
from ariac_score.logs.logmap import load_log_map
from ariac_score.oracle.conversation import Conversation
from ariac_score.oracle.judges import RulesBench
from ariac_score.platforms.archives import ArchiveLimits, is_archive, unpack
from ariac_score.platforms.evalai import check_challenge
from ariac_score.platforms.submission import RULES, load_phase
from ariac_score.ranking.competition import load_competition
from ariac_score.results.adjustments import load_adjustments
from ariac_score.results.cohort_file import load_cohort
from ariac_score.results.result_file import load_result
from ariac_score.results.signing import verify_signature
from ariac_score.scoring.expression import Expression, Traced
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.vocabulary import QUANTITIES
from ariac_score_rml import RmlError, compile_rml, format_rml, run_trace
from ariac_score_rml.tokens import Dialect
from ariac_score_rml.trace_columns import run_lines
from ariac_score_rml.traces import read_events
from ariac_score_stl import StlFormula
from fuzz.columns import decode_both_ways
from fuzz.containers import mcap_three_ways, ros1_three_ways
from fuzz.peers import mcap_with_peer, ros1_with_peer
from fuzz.wide import decode_wide_texts

__all__ = ["SMALL_RULES", "TARGETS", "Target", "look_up_once"]

_EVENTS = ({"x": 1, "name": "a"}, {"x": 2.5, "y": {"z": [1, 2]}}, {"x": "1"}, {"x": -1, "y": 3})
SMALL_RULES = """id: small
title: small rules
source: made for fuzzing
log_map: ariac2020
competition: {use: ariac}
rules: {pose: {use: kitting.pose, with: {max_distance_m: 0.03}}}
monitors:
  separation: {use: stl.formula, with: {formula: always d > 1, signals: {d: centre_distance in m}}}
parameters: {each: 2}
terms:
  submission: {right: each * points(pose)}
  order: {right: sum(submission.right)}
  trial: {lost: violated(separation)}
score: sum(order.right) - lost
"""
_SPEC = "a matches {x:1}; b(n) matches {y:n}; Main = (a \\/ {let n; b(n)})*;"
_SMALL = ArchiveLimits(members=100, bytes=1 << 22)


@dataclass(frozen=True)
class Target:
    """What is fuzzed.

    Attributes:
        run: Called with a folder it may write in, and the bytes.
        words: Pieces of the format that a mutation should know.
        in_memory: Whether it needs no folder.
    """

    run: Callable[[Path, bytes], None]
    words: tuple[bytes, ...] = ()
    in_memory: bool = False

    def once(self, raw: bytes) -> None:
        """Run it on one input."""
        if self.in_memory:
            self.run(_SHM, raw)
            return
        folder = _folder()
        try:
            self.run(folder, raw)
        finally:
            _empty(folder)


_SHM = Path("/dev/shm")  # noqa: S108  # a folder with a random name is made in it


@cache
def _folder() -> Path:
    """One folder of this process: making and removing one for each input takes longer than many a target."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=_SHM if _SHM.is_dir() else None))
    atexit.register(rmtree, folder, ignore_errors=True)
    return folder


def _empty(folder: Path) -> None:
    with os.scandir(folder) as inside:
        for entry in inside:
            if entry.is_dir(follow_symlinks=False):
                rmtree(entry.path)
            else:
                Path(entry.path).unlink()


@contextmanager
def _refusals() -> Iterator[None]:
    """Let pass what a parser says in words; a plugin that broke down is no refusal."""
    try:
        yield
    except ScoreError as error:
        if type(error) is PluginError:
            raise
        if not str(error):
            raise AssertionError("a refusal without words") from error


@cache
def _registry() -> Registry:
    return Registry()


def look_up_once() -> None:
    """Look up what is installed once, and not for each input: that takes ten times as long as most of them.

    For a process that does nothing but fuzz.
    """
    registry.installed_points = cache(installed_points)  # type: ignore[attr-defined]
    registry.unreadable_hint = cache(unreadable_hint)  # type: ignore[attr-defined]
    if _SHM.is_dir():
        tempfile.tempdir = str(_SHM)  # the parsers' own folders too: some disks take 4 ms to remove one


@cache
def _wanted(log_map: str) -> Wanted:
    mapping = load_log_map(log_map)
    names = sorted({channel.decoder for channel in mapping.channels if channel.decoder})
    plugins = [_registry().find("ariac_score.decoders", name) for name in names]
    decoders = {plugin.name: GuardedDecoder(plugin, plugin.build({})) for plugin in plugins}
    return Wanted(mapping, frozenset(QUANTITIES), decoders)


@cache
def _built_reader(use: str) -> Reader:
    reader = _registry().find("ariac_score.readers", use).build({})
    assert isinstance(reader, Reader)
    return reader


def _reader(use: str, file: str, log_map: str = "ariac2020") -> Callable[[Path, bytes], None]:
    def run(folder: Path, raw: bytes) -> None:
        reader = _built_reader(use)
        path = folder / file
        path.write_bytes(raw)
        reader.can_read(path)
        with _refusals():
            reader.describe(path)
        with _refusals():
            reader.read(path, _wanted(log_map))

    return run


def _rule_set(folder: Path, raw: bytes) -> None:
    (folder / "rules.yaml").write_bytes(raw)
    with _refusals():
        load_rule_set(str(folder / "rules.yaml")).build(_registry())


def _log_map(folder: Path, raw: bytes) -> None:
    (folder / "map.yaml").write_bytes(raw)
    with _refusals():
        load_log_map(str(folder / "map.yaml"))


def _competition(folder: Path, raw: bytes) -> None:
    (folder / "competition.yaml").write_bytes(raw)
    with _refusals():
        load_competition(folder)


def _rml(_: Path, raw: bytes) -> None:
    text = raw.decode("utf-8", "replace")
    dialects: tuple[Dialect, ...] = ("2024", "rosmonitoring")
    for dialect in dialects:
        try:
            program = compile_rml(text, dialect=dialect)
        except RmlError:
            continue
        compile_rml(format_rml(program.spec), dialect=dialect)  # what it writes, it reads
        run_trace(program.machine(max_state=1000), _EVENTS)


def _rml_events(_: Path, raw: bytes) -> None:
    program = compile_rml(_SPEC)
    with _refusals():
        run_trace(program.machine(max_state=1000), read_events(raw.decode("utf-8", "replace")))
    run_lines(program.machine(max_state=1000), io.BytesIO(raw))


@cache
def _trial() -> Trial:
    t = np.linspace(0.0, 4.0, 21)
    distance = Signal("centre_distance/robot/human", "m", t, 2.0 + np.sin(3.0 * t))
    speed = Signal("speed/robot", "m/s", t, np.abs(np.cos(t)))
    return Trial(
        id="fuzz",
        bodies=(Body("robot", "robot", 0.0), Body("human", "human", 0.0)),
        signals={signal.name: signal for signal in (distance, speed)},
        recorded=Span(0.0, 4.0),
    )


def _stl(_: Path, raw: bytes) -> None:
    try:
        monitor = StlFormula(
            formula=raw.decode("utf-8", "replace"),
            signals={"d": "centre_distance in m", "v": "speed of robot in m/s"},
        )
    except ValueError:  # what the contract of plugins asks for
        return
    assert isinstance(monitor, Monitor)
    with _refusals():
        for finding in monitor.watch(_trial()):
            assert finding.message


class _Names:
    """Values of a few names."""

    def name(self, dotted: str) -> Traced:
        values: Mapping[str, float] = {"a": 2.0, "b.c": -1.5, "z": 0.0}
        if dotted not in values:
            raise ScoreError(f"no name {dotted!r}")
        return Traced(dotted, values[dotted], "fact")

    def call(self, *_: object) -> None:
        """Know no function but those of every formula."""


def _expression(_: Path, raw: bytes) -> None:
    with _refusals():
        expression = Expression.parse(raw.decode("utf-8", "replace"))
        with _refusals():
            expression.evaluate(_Names())  # type: ignore[arg-type]
        columns = {"a": np.array([1.0, 0.0, -2.0]), "z": np.zeros(3)}
        assert np.isfinite(expression.columns(columns)).all()


def _result(folder: Path, raw: bytes) -> None:
    (folder / "result.json").write_bytes(raw)
    with _refusals():
        load_result(folder / "result.json")


def _bundle(folder: Path, raw: bytes) -> None:
    (folder / "bundle.yaml").write_bytes(raw)
    (folder / "log.jsonl").write_bytes(b"{}")
    with _refusals():
        find_trial(folder, _registry())


@cache
def _compared() -> RuleSet:
    return load_rule_set("ariac2024.release_5")


def _cohort(folder: Path, raw: bytes) -> None:
    (folder / "cohort.json").write_bytes(raw)
    with _refusals():
        load_cohort(folder / "cohort.json", _compared())


def _adjustments(folder: Path, raw: bytes) -> None:
    (folder / "adjustments.yaml").write_bytes(raw)
    with _refusals():
        load_adjustments(folder / "adjustments.yaml")


_KEY = "RWQf6LRCGA9i53mlYecO4IzT51TGPpvWucNSCh1CBM0QTaLn73Y7GFO3"


def _signature(folder: Path, raw: bytes) -> None:
    (folder / "r.json").write_bytes(b"Hello")
    (folder / "r.json.minisig").write_bytes(raw)
    (folder / "key.pub").write_bytes(raw)
    with _refusals():
        verify_signature(folder / "r.json", _KEY)
    with _refusals():
        verify_signature(folder / "r.json", str(folder / "key.pub"))


def _phase(folder: Path, raw: bytes) -> None:
    (folder / "phase.json").write_bytes(raw)
    (folder / RULES).write_text(SMALL_RULES, encoding="utf-8")
    with _refusals():
        load_phase(folder)


def _evalai_challenge(folder: Path, raw: bytes) -> None:
    (folder / "challenge_config.yaml").write_bytes(raw)
    check_challenge(folder / "challenge_config.yaml")


def _batch_rows(folder: Path, raw: bytes) -> None:
    (folder / "runs.jsonl").write_bytes(raw)
    for _ in read_rows(folder / "runs.jsonl"):
        pass
    with _refusals():
        for _ in checked_rows(folder):
            pass


def _archive(folder: Path, raw: bytes) -> None:
    (folder / "a").write_bytes(raw)
    is_archive(folder / "a")
    with _refusals():
        inside = (folder / "in").resolve()
        for file in unpack(folder / "a", inside, _SMALL):
            assert file.is_relative_to(inside)
            assert not file.is_symlink()
    assert {path.name for path in folder.iterdir()} <= {"a", "in"}


@cache
def _bench() -> RulesBench:
    return RulesBench(load_rule_set("paper2020"), _registry())


def _oracle(folder: Path, raw: bytes) -> None:
    conversation = Conversation(_bench().judge(), folder / "log.jsonl")
    for frame in raw.split(b"\n"):
        assert conversation.answer(frame)
    conversation.close("the end of the input")


def _columnar(_: Path, raw: bytes) -> None:
    decode_both_ways(raw)


def _wide_text(_: Path, raw: bytes) -> None:
    decode_wide_texts(raw)


class _Everything:
    """Topics, of which each is wanted."""

    def __contains__(self, _: object) -> bool:
        return True


def _rows(path: Path) -> list[tuple[str, int, bytes]] | None:
    """Topic, time and payload of each message of a SQLite file; nothing where it is refused."""
    found: list[tuple[str, int, bytes]] = []
    try:
        for item in SqliteScan(path, topics=_Everything()):
            if isinstance(item, Connection):
                continue
            messages = item.messages() if isinstance(item, Batch) else (item,)
            found += [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in messages]
    except (ScoreError, MemoryError):  # SQLite says the latter of some damage, and readers say it on
        return None
    return found


def _selected(path: Path) -> list[tuple[str, int, bytes]] | None:
    """The same as SQLite selects it, without a check of the whole file."""
    try:
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)) as bag:
            bag.execute("PRAGMA writable_schema=ON")
            topics = {key: str(name) for key, name in bag.execute("SELECT id, name FROM topics")}
            rows = bag.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY rowid")
            return [(topics[topic], stamp, data) for topic, stamp, data in rows]
    except (sqlite3.Error, KeyError):
        return None


def _sqlite_scan(folder: Path, raw: bytes) -> None:
    """Rows in portions, compared with a plain `SELECT`."""
    path = folder / "log.db3"
    path.write_bytes(raw)
    found = _rows(path)
    assert found is None or found == _selected(path)


def _definition(_: Path, raw: bytes) -> None:
    """A definition becomes a plan or is refused, and nothing else."""
    text = raw.decode("utf-8", "replace")
    with suppress(UnknownTypeError, PlanError):
        column_decoder_for(Connection("/top", "fuzz/msg/Top", "cdr", text, "ros2msg"))


_JSON = (b'{"', b'": ', b"[[[[", b"1e400", b"NaN", b"-Infinity", b"null", b"9" * 30, b'"\\ud800"', b'"t_s"')
_YAML = (b"&a ", b"*a", b"\n- ", b": ", b"!!python/name:os.system ", b"<<: ", b"0x10", b"1e999", b".nan")
_TEXT = (b"N/A", b"-1", b"1e308", b"\n\n", b"\t", b"yes", b"[", b"]", b"\x1b[31m", b"9" * 30)
_MCAP = (b"\x89MCAP0\r\n", *(bytes([op]) for op in range(1, 16)))
_ROS1 = (b"op=", b"size=", b"conn=", b"chunk_pos=", b"ver=", b"count=")
_SQL = (b"CREATE VIEW ", b"CREATE TRIGGER ", b"WITH RECURSIVE ", b"GENERATED ALWAYS AS ", b"VIRTUAL ")
_MSG = (
    b"=" * 80 + b"\n",
    b"MSG: a/B\n",
    b"float64",
    b"string",
    b"[]",
    b"[3]",
    b"[<=4]",
    b" x=1",
    b"Header h\n",
    b"#",
    b"uint8",
)
_RML = (
    b" matches ",
    b"{let x; ",
    b"/\\",
    b"\\/",
    b"empty",
    b"all",
    b"none",
    b"not ",
    b">>",
    b"...",
    b" with ",
)
_STL = (b"always", b"eventually", b"until", b"since", b"[0:1]", b"->", b"<->", b" xor ", b"rise", b"d", b"v")
_SUMS = (b"sum(", b" if ", b" else ", b"**", b"//", b"max(", b"a.b.c", b"__class__", b"lambda: ", b"1e308")

TARGETS: Mapping[str, Target] = {
    "archive": Target(_archive, (b"PK\x01\x02", b"PK\x03\x04", b"PK\x05\x06", b"../", b"ustar")),
    "ariac_database": Target(_reader("ariac_database", "ariac.db"), _SQL),
    "adjustments": Target(_adjustments, (*_YAML, b"2024-05-12T14:30:00Z", b"effect: {", b"target: {")),
    "batch_rows": Target(_batch_rows, (*_JSON, b"objects/", b"../")),
    "bundle": Target(_bundle, (*_YAML, b"logs: [", b"sha256:", b"../", b"log.jsonl")),
    "cohort": Target(_cohort, _JSON),
    "columnar": Target(
        _columnar,
        (b"\0\1\0\0", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\1\0\0\0", b"\xc3\xa4", b"\3\5", b"\1\0\3\5"),
        in_memory=True,
    ),
    "competition": Target(_competition, (*_YAML, b"{team}", b"../", b"runs")),
    "definition": Target(_definition, _MSG, in_memory=True),
    "evalai_challenge": Target(_evalai_challenge, (*_YAML, b"challenge_phases:", b"!!python/object")),
    "expression": Target(_expression, _SUMS),
    "jsonl": Target(_reader("jsonl", "log.jsonl"), _JSON),
    "log_map": Target(_log_map, _YAML),
    "mcap_peer": Target(mcap_with_peer, _MCAP),
    "mcap_scan": Target(mcap_three_ways, _MCAP),
    "mcap": Target(_reader("rosbag", "log.mcap"), _MCAP),
    "oracle": Target(_oracle, (*_JSON, b'"topic"', b'"time"')),
    "performance_log": Target(_reader("gazebo_text", "performance.log", "ariac2022"), _TEXT),
    "phase": Target(_phase, (*_JSON, b"../", b'"limits"')),
    "result": Target(_result, _JSON),
    "rml": Target(_rml, _RML),
    "rml_events": Target(_rml_events, _JSON),
    "ros1_peer": Target(ros1_with_peer, _ROS1),
    "ros1_scan": Target(ros1_three_ways, _ROS1),
    "ros1_bag": Target(_reader("rosbag", "log.bag"), (b"#ROSBAG V2.0\n", b"op=", b"size=", b"conn=", b"bz2")),
    "ros_monitoring": Target(_reader("ros_monitoring", "log.json"), (*_JSON, b"array('d', [", b"'topic'")),
    "rule_set": Target(_rule_set, (*_YAML, *_SUMS)),
    "sensor_cost": Target(_reader("sensor_cost", "sensor_cost.txt", "ariac2024"), _TEXT),
    "signature": Target(_signature, (b"untrusted comment: ", b"trusted comment: ", b"RWQ", b"\n", b"=")),
    "sqlite_bag": Target(_reader("rosbag", "log.db3"), _SQL),
    "sqlite_scan": Target(_sqlite_scan, (b"\x0d\0\0\0", b"\x05\0\0\0", b"\0\0\0\3", b"\x81\1")),
    "state_log": Target(
        _reader("gazebo", "state.log", "ariac2022"),
        (b"<chunk encoding='txt'>", b"<![CDATA[", b"]]>", b"<sim_time>", b"<pose>", b"<model name='"),
    ),
    "stl": Target(_stl, (*_STL, *_SUMS)),
    "team_config": Target(_reader("ariac_team", "team.yaml"), (*_YAML, b"sensors:", b"pi/2")),
    "trial_config": Target(_reader("ariac_config", "trial.yaml"), (*_YAML, b"orders:", b"'pi/2'")),
    "trial_log": Target(_reader("trial_log", "trial_log.txt", "ariac2024"), _TEXT),
    "wide_text": Target(_wide_text, (b"\4\0\0\xd8", b"\4\4\0\0", b"\0\1\0\0", b"\3\2\1\0"), in_memory=True),
}
