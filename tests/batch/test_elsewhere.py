"""Runs that lie elsewhere: planned from a URI, read where they are scored, whole or in parts."""

from __future__ import annotations

import filecmp
import json
import random
import shutil
import struct
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_rule_set, score_trial
from ariac_score.batch import fetched as near
from ariac_score.batch import remote
from ariac_score.batch.index import Row
from ariac_score.batch.isolated import measure_isolated
from ariac_score.batch.local import LocalExecutor
from ariac_score.batch.merge import merge_batches
from ariac_score.batch.remote import Storage, Stored, shown, signature_of_stored
from ariac_score.batch.remote_plans import plan_elsewhere, plan_list
from ariac_score.batch.store import Store
from ariac_score.batch.supervise import Report, run_batch
from ariac_score.batch.tasks import BatchPlan, BatchSetting, Limits, RunTask, plan_batch
from ariac_score.batch.worker import Done, perform
from ariac_score.cli import main
from ariac_score.errors import DataFileError, LogError, NothingToScoreError, UsageError
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.ranged import RangedFile, open_log, reading
from ariac_score.logs.containers.source import Source
from ariac_score.report.text import score_text
from ariac_score.results.result_file import as_json, load_result
from ariac_score.review.verify import verify_result
from ariac_score.testing import Recorded, write_bag
from ariac_score_ariac.testing.recordings import recorded_messages

# What fresh processes do is named by a module that they can import, too.
sys.path.insert(0, str(Path(__file__).parent))
import batch_hands as hands
from batch_web import Web, serving

from ariac_score_ariac.testing import kitting_trial

pytest.importorskip("aiohttp", reason="the extra 'remote' is not installed")

pytestmark = pytest.mark.slow  # servers on this machine

RULES = "paper2020.published"
EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
COMPETITION = EXAMPLE.parent / "competition" / "2024"
LIMITS = Limits(wall_s=120.0)


class Inline:
    """Scores in this process, one run after the other."""

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        for task in tasks:
            yield perform(task, setting)


@pytest.fixture(autouse=True)
def _own_cache_and_no_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(remote, "PAUSE_S", 0.0)


@pytest.fixture
def web(tmp_path: Path) -> Iterator[Web]:
    (tmp_path / "www").mkdir()
    with serving(tmp_path / "www") as web:
        yield web


@pytest.fixture
def trials(web: Web) -> Path:
    """Two trials, a bundle, one cut off, one that is no log; two of the names want quoting."""
    folder = web.root / "trials"
    (folder / "bundle #1").mkdir(parents=True)
    for name in ("a.mcap", "b c.mcap", "bundle #1/log.mcap"):
        shutil.copyfile(EXAMPLE, folder / name)
    (folder / "cut.mcap").write_bytes(EXAMPLE.read_bytes()[:100_000])
    (folder / "note.txt").write_text("hello\n", encoding="utf-8")
    return folder


def score(
    plan: BatchPlan, out: Path, *, ranges: bool = False, executor: Callable[[Path], Any] | None = None
) -> Report:
    rule_set = load_rule_set(plan.rules)
    store = Store(out)
    setting = BatchSetting.of(rule_set, LIMITS, ranges=ranges)
    with store.working() as work:
        chosen = executor(work) if executor else Inline()
        return run_batch(plan.tasks, rule_set, setting, store, work, chosen, name=plan.id)


def elsewhere(uri: str, tmp_path: Path, rules: str = RULES, *, ranges: bool = False) -> BatchPlan:
    work = tmp_path / f"laid_out_{len(list(tmp_path.glob('laid_out_*')))}"
    work.mkdir()
    return plan_elsewhere(uri, rules, work, ranges=ranges)


def same(first: Path, second: Path) -> bool:
    """Whether two folders hold the same files with the same bytes; hidden ones count."""
    names = [
        sorted(p.relative_to(f).as_posix() for p in f.rglob("*") if p.is_file()) for f in (first, second)
    ]
    assert names[0] == names[1]
    _, differing, errors = filecmp.cmpfiles(first, second, names[0], shallow=False)
    assert (differing, errors) == ([], [])
    return True


def rows(out: Path) -> dict[str, Row]:
    lines = (out / "runs.jsonl").read_text(encoding="ascii").splitlines()
    return {row.key[1]: row for row in map(Row.from_line, lines)}


def outcomes(out: Path) -> dict[str, str]:
    return {name: row.summary.outcome for name, row in rows(out).items()}


def one(uri: str, *, ranges: bool = False) -> Done:
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS, ranges=ranges)
    return perform(RunTask("", uri.rpartition("/")[2], 1, uri), setting)


def document(done: Done) -> dict[str, Any]:
    assert done.document is not None
    found: dict[str, Any] = json.loads(done.document)
    return found


# The same as here ------------------------------------------------------------------------


@pytest.mark.parametrize("by", ["http", "file"])
def test_a_folder_elsewhere_gives_the_bytes_of_the_same_folder_here(
    trials: Path, web: Web, tmp_path: Path, by: str
) -> None:
    score(plan_batch(trials, RULES), tmp_path / "here")
    uri = f"{web.url}/trials/" if by == "http" else f"file://{trials}"

    score(elsewhere(uri, tmp_path), tmp_path / "there", executor=lambda work: LocalExecutor(2, None, work))

    assert same(tmp_path / "here", tmp_path / "there")
    assert outcomes(tmp_path / "there") == {
        "a.mcap": "scored",
        "b c.mcap": "scored",
        "bundle #1": "scored",
        "cut.mcap": "unreadable",
        "note.txt": "nothing_to_score",
    }


def test_a_competition_elsewhere_gives_the_bytes_of_the_same_competition_here(
    web: Web, tmp_path: Path
) -> None:
    here = web.root / "season"
    shutil.copytree(COMPETITION, here)
    plan = plan_batch(here)
    there = elsewhere(f"{web.url}/season/", tmp_path, rules="")

    assert [task.key for task in there.tasks] == [task.key for task in plan.tasks]
    assert (there.id, len(there.tasks)) == (plan.id, 45)
    few = slice(0, 45, 9)
    score(replace(plan, tasks=plan.tasks[few]), tmp_path / "here")
    score(replace(there, tasks=there.tasks[few]), tmp_path / "there")
    assert same(tmp_path / "here", tmp_path / "there")


def test_a_second_call_asks_what_changed_and_fetches_nothing(trials: Path, web: Web, tmp_path: Path) -> None:
    first = score(elsewhere(f"{web.url}/trials/", tmp_path), tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "before")
    web.sent.clear()

    again = score(elsewhere(f"{web.url}/trials/", tmp_path), tmp_path / "out")

    assert (first.scored_now, again.scored_now, web.sent_bytes) == (5, 0, 0)
    assert same(tmp_path / "before", tmp_path / "out")

    (trials / "a.mcap").write_bytes((trials / "cut.mcap").read_bytes())
    assert score(elsewhere(f"{web.url}/trials/", tmp_path), tmp_path / "out").scored_now == 1
    assert outcomes(tmp_path / "out")["a.mcap"] == "unreadable"


def test_what_says_nothing_of_its_content_is_fetched_again(trials: Path, tmp_path: Path) -> None:
    with serving(trials.parent, etags=False) as web:
        for _ in range(2):
            report = score(elsewhere(f"{web.url}/trials/", tmp_path), tmp_path / "out")
            assert report.scored_now == 5
        score(plan_batch(trials, RULES), tmp_path / "here")
    assert same(tmp_path / "here", tmp_path / "out")


def test_a_list_names_runs_wherever_they_lie(trials: Path, web: Web, tmp_path: Path) -> None:
    listed = trials.parent / "list.txt"
    listed.write_text(
        f"# two of one name\n{web.url}/trials/a.mcap\n\nsecond {web.url}/trials/a.mcap\n"
        f"third {web.url}/trials/bundle%20%231/\ntrials/note.txt\n{web.url}/gone.mcap\n",
        encoding="utf-8",
    )
    for plan in (plan_list(listed, RULES), elsewhere(f"file://{listed}", tmp_path / "www")):
        assert [task.trial for task in plan.tasks] == ["a.mcap", "gone.mcap", "note.txt", "second", "third"]

    score(plan_list(listed, RULES), tmp_path / "out")

    assert outcomes(tmp_path / "out") == {
        "a.mcap": "scored",
        "gone.mcap": "unreachable",
        "note.txt": "nothing_to_score",
        "second": "scored",
        "third": "scored",
    }
    assert rows(tmp_path / "out")["gone.mcap"].object == ""  # so that the next call asks again


LISTED = "# of this folder, unless an address is given\na.mcap\nb c.mcap\nbundle #1/\ncut.mcap\nnote.txt\n"


def test_shards_of_a_list_that_lies_elsewhere_join_to_the_bytes_of_the_whole(
    trials: Path, web: Web, tmp_path: Path
) -> None:
    (trials / "list.txt").write_text(f"{LISTED}again {web.url}/trials/a.mcap?x=1\n", encoding="utf-8")
    here = tmp_path / "here.txt"
    shutil.copyfile(trials / "a.mcap", trials / "again")
    here.write_text("".join(f"www/trials/{n}\n" for n in [*LISTED.splitlines()[1:], "again"]), "utf-8")
    uri, parts = f"{web.url}/trials/list.txt?signature=secret", []
    for number in (1, 2, 3):
        web.requests.clear()
        parts.append(str(tmp_path / f"part_{number}"))
        code = command(uri, "-o", parts[-1], "--shard", f"{number}/3", "-j", "1")
        found = set(outcomes(Path(parts[-1])).values())
        assert code == (0 if found == {"scored"} else 6)
        asked = {name.rpartition("/")[2] for _, name in web.requests if name.endswith(".mcap")}
        assert len(asked) < 3  # of the runs of other shards nothing is asked

    assert main(["merge", str(tmp_path / "joined"), *parts]) in (0, 6)

    plan = replace(plan_list(here, RULES), id="list")
    score(plan, tmp_path / "local")
    assert {name: row.summary for name, row in rows(tmp_path / "local").items()} == {
        name: row.summary for name, row in rows(tmp_path / "joined").items()
    }
    assert command(uri, "-o", str(tmp_path / "whole"), "-j", "2") == 6
    assert same(tmp_path / "whole", tmp_path / "joined")
    texts = b"".join(f.read_bytes() for f in (tmp_path / "joined").rglob("*") if f.is_file())
    assert b"secret" not in texts


@pytest.mark.parametrize("line", ["../a.mcap", "a/../../x", "/etc/passwd", "a\\b"])
def test_a_list_that_lies_elsewhere_names_nothing_outside_its_folder(
    trials: Path, web: Web, tmp_path: Path, line: str
) -> None:
    (trials / "list.txt").write_text(f"{line}\n", encoding="utf-8")
    with pytest.raises(UsageError, match="which cannot be the name of a file"):
        elsewhere(f"{web.url}/trials/list.txt", tmp_path)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("https://h/a.mcap\nhttps://g/a.mcap\n", "two runs are named 'a.mcap': here and in line 1"),
        ("https://h/a b.mcap\n", "is no address of a run"),
        ("https://h/?secret=1 x y\n", "'https://h/' is no address of a run"),
        ("# nothing\n", "it lists no run"),
        ("\udcff", "cannot be read"),
    ],
)
def test_a_list_that_is_none_is_refused_with_its_line(tmp_path: Path, text: str, cause: str) -> None:
    listed = tmp_path / "list.txt"
    listed.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises((DataFileError, NothingToScoreError), match=cause.replace("?", r"\?")):
        plan_list(listed, RULES)
    with pytest.raises(UsageError, match="no rule set is given"):
        plan_list(listed, "")


# Parts of a recording --------------------------------------------------------------------


def with_camera(into: Path, compression: str) -> Path:
    """The example with a camera of some MB: between the poses, or in chunks of its own where it is packed."""
    writing = pytest.importorskip("mcap.writer", reason="mcap, which comes with mcap-ros2-support")
    from mcap.reader import make_reader  # noqa: PLC0415

    dice, pictures = random.Random(1), 0  # noqa: S311  # pictures need not be secret
    with EXAMPLE.open("rb") as source, into.open("wb") as target:
        reader = make_reader(source)
        packed = writing.CompressionType[compression or "NONE"]
        writer = writing.Writer(target, chunk_size=100_000, compression=packed)
        writer.start(profile="ros2", library="test")
        image = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data\n")
        camera = writer.register_channel("/camera", "cdr", image)
        channels = {}
        for number, (schema, channel, message) in enumerate(reader.iter_messages(log_time_order=False)):
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", known)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
            if number % 1000 == 999:
                for _ in range(10):
                    picture = b"\0\1\0\0" + struct.pack("<I", 150_000) + dice.randbytes(150_000)
                    writer.add_message(camera, message.log_time, picture, message.publish_time)
                    pictures += 1
        writer.finish()
    assert pictures * 150_000 > 0.8 * into.stat().st_size
    return into


def bag_with_camera(into: Path, compression: Any) -> Path:
    """The same trial as a ROS 1 bag, with pictures of which most have a chunk of their own."""
    dice = random.Random(1)  # noqa: S311  # pictures need not be secret
    messages = recorded_messages(kitting_trial(duration_s=40.0))
    for place in (3000, 1600):  # when every topic has been heard of
        pictures = [{"data": dice.randbytes(550_000).hex()} for _ in range(4)]
        t_ns = messages[place].t_ns
        messages[place:place] = [Recorded("/camera", "std_msgs/msg/String", t_ns, data) for data in pictures]
    write_bag(into, messages, storage="ros1", compression=compression)
    return into


def recording(into: Path, compression: str = "") -> Path:
    """A recording with a camera, in the format of its name."""
    write = bag_with_camera if into.suffix == ".bag" else with_camera
    return write(into, compression)


@pytest.mark.parametrize(
    ("name", "compression"),
    [("run.mcap", ""), ("run.mcap", "ZSTD"), ("run.bag", ""), ("run.bag", "lz4")],
)
def test_of_a_recording_with_a_camera_only_what_is_wanted_is_fetched(
    web: Web, name: str, compression: str
) -> None:
    log = recording(web.root / name, compression)
    here = json.loads(as_json(score_trial(log, RULES)))

    there = document(one(f"{web.url}/{name}", ranges=True))

    assert web.sent_bytes < (0.2 if name == "run.mcap" else 0.35) * log.stat().st_size  # 41 and 9 chunks
    assert len([1 for how, _ in web.requests if how == "GET"]) < 60  # one for each of 41 chunks, many at once
    (part,), (whole,) = there["provenance"]["inputs"], here["provenance"]["inputs"]
    assert part["bytes"] == whole["bytes"] == log.stat().st_size
    assert part["sha256"] != whole["sha256"]
    assert 0 < part["read_bytes"] <= web.sent_bytes
    for result in (there, here):
        del result["provenance"]["inputs"]
    assert there == here


def test_a_result_from_parts_is_read_again_shown_and_verified_for_what_it_is(
    web: Web, tmp_path: Path
) -> None:
    log = with_camera(web.root / "run.mcap", "")
    done = one(f"{web.url}/run.mcap", ranges=True)
    file = tmp_path / "run.json"
    file.write_bytes(done.document or b"")

    assert as_json(load_result(file)).encode() == done.document
    found = verify_result(file, log=log)
    steps = {step.name: step for step in found.steps}
    assert found.holds
    assert "bytes were read" in steps["parts"].words
    assert steps["recomputed"].outcome == "ok"
    assert "bytes that were read" in score_text(load_result(file))

    shutil.copyfile(EXAMPLE, log)  # another recording
    assert not verify_result(file, log=log).holds


def test_parts_and_wholes_are_kept_apart_and_do_not_join(web: Web, tmp_path: Path) -> None:
    (web.root / "t").mkdir()
    with_camera(web.root / "t" / "run.mcap", "")
    whole, parts = (
        rows(_scored(web, tmp_path / name, tmp_path, ranges=ranges))["run.mcap"]
        for name, ranges in (("whole", False), ("parts", True))
    )

    assert whole.summary == parts.summary
    assert whole.object.split("/")[2] != parts.object.split("/")[2]
    with Store(tmp_path / "joined").working() as work, pytest.raises(UsageError, match="way of reading"):
        merge_batches([tmp_path / "whole", tmp_path / "parts"], Store(tmp_path / "joined"), work)


def _scored(web: Web, out: Path, tmp_path: Path, *, ranges: bool) -> Path:
    plan = elsewhere(f"{web.url}/t/", tmp_path, ranges=ranges)
    rule_set, store = load_rule_set(RULES), Store(out)
    with store.working() as work:
        setting = BatchSetting.of(rule_set, LIMITS, ranges=ranges)
        run_batch(plan.tasks, rule_set, setting, store, work, Inline(), name=plan.id)
    return out


@pytest.mark.parametrize("name", ["run.mcap", "run.bag"])
def test_a_server_that_gives_no_parts_gives_the_whole_and_the_result_of_it(web: Web, name: str) -> None:
    log = recording(web.root / name)
    web.ranges = False

    done = one(f"{web.url}/{name}", ranges=True)

    assert done.document == as_json(score_trial(log, RULES)).encode()
    assert "read_bytes" not in document(done)["provenance"]["inputs"][0]


def damaged_bag(content: bytearray, damage: str) -> None:
    """Make one thing wrong with a bag, by the places of its records."""
    (index_pos,) = struct.unpack_from("<Q", content, content.index(b"index_pos=") + 10)
    chunk_pos = content.rindex(b"chunk_pos=") + 10
    last_index = content.rindex(b"conn=", 0, index_pos)
    if damage == "no index":
        struct.pack_into("<Q", content, content.index(b"index_pos=") + 10, 0)
    elif damage == "index leads out":
        struct.pack_into("<Q", content, chunk_pos, 1 << 62)
    elif damage == "index leads astray":
        struct.pack_into("<Q", content, chunk_pos, 5000)
    elif damage == "end of the index":
        struct.pack_into("<I", content, index_pos, 1 << 31)
    elif damage == "another connection":
        content[last_index + 5] ^= 1
    elif damage == "another number of messages":
        content[-4] += 1
    elif damage == "no magic":
        content[:8] = b"no magic"
    else:
        del content[-100_000:]


@pytest.mark.parametrize(
    "damage",
    [
        "no index",
        "index leads out",
        "index leads astray",
        "end of the index",
        "another connection",
        "another number of messages",
        "no magic",
        "cut off",
    ],
)
def test_a_bag_whose_index_is_wrong_ends_as_it_does_here(bag: bytes, web: Web, damage: str) -> None:
    content = bytearray(bag)
    damaged_bag(content, damage)
    (web.root / "run.bag").write_bytes(content)
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS)

    expected = document(perform(RunTask("", "run.bag", 1, str(web.root / "run.bag")), setting))
    in_parts = document(one(f"{web.url}/run.bag", ranges=True))

    for result in (in_parts, expected):
        result.get("provenance", {}).pop("inputs", None)
    assert in_parts == expected


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A bag with a camera."""
    return bag_with_camera(tmp_path_factory.mktemp("bag") / "run.bag", "").read_bytes()


@pytest.mark.parametrize("damage", ["no index", "index leads out", "not an MCAP file", "cut off"])
def test_what_has_no_good_index_ends_as_it_does_here(web: Web, damage: str) -> None:
    content = bytearray(with_camera(web.root / "run.mcap", "").read_bytes())
    if damage == "no index":
        content[-28:-20] = bytes(8)
    elif damage == "index leads out":
        summary = int.from_bytes(content[-28:-20], "little")
        place = content.index(b"\x08", summary)
        while int.from_bytes(content[place + 1 : place + 9], "little") > 400:
            place = content.index(b"\x08", place + 1)
        content[place + 25 : place + 33] = (1 << 62).to_bytes(8, "little")
    elif damage == "not an MCAP file":
        content[:8] = b"no magic"
    else:
        del content[-100_000:]
    (web.root / "run.mcap").write_bytes(content)
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS)
    here = perform(RunTask("", "run.mcap", 1, str(web.root / "run.mcap")), setting)

    there = one(f"{web.url}/run.mcap", ranges=True)

    fetched, expected = document(there), document(here)
    assert fetched.get("outcome") == expected.get("outcome")
    assert fetched.get("reason") == expected.get("reason")
    assert fetched.get("score") == expected.get("score")


@pytest.mark.parametrize("cuts", [[], [(10, 20)], [(0, 1), (1, 2), (99_999, 100_000)]])
def test_a_file_with_holes_reads_as_the_whole(tmp_path: Path, cuts: list[tuple[int, int]]) -> None:
    whole = bytes(range(256)) * 400
    (tmp_path / "whole").write_bytes(whole)
    asked: list[tuple[int, int]] = []

    def fetch(ranges: Any) -> list[bytes]:
        asked.extend(ranges)
        return [whole[start:end] for start, end in ranges]

    file = RangedFile(tmp_path / "holes", len(whole), fetch)
    file.have(cuts)
    before = file.read_bytes
    with reading([file]), Source(file.path) as source:
        assert source.take(100, "x") == whole[:100]
        assert source.at(90_000, 5000) == whole[90_000:95_000]
        source.skip(1000)
        assert source.peek(10) == whole[1100:1110]
        room = bytearray(len(whole) - 1100)
        source.take_into(memoryview(room), "x")
        assert bytes(room) == whole[1100:]
    assert before <= file.read_bytes == len(whole)
    assert len(asked) == len(set(asked))
    assert not file.missing([(0, len(whole))])


def test_at_its_end_a_file_with_holes_has_no_more_bytes(tmp_path: Path) -> None:
    whole = bytes(range(100))
    file = RangedFile(tmp_path / "holes", len(whole), lambda ranges: [whole[a:b] for a, b in ranges])

    with reading([file]), open_log(file.path, 0) as log:
        log.seek(98)
        assert [log.read(5), log.read(5), log.read()] == [whole[98:], b"", b""]
        log.seek(1000)
        assert log.read(5) == b""


def test_bytes_that_do_not_come_end_the_reading_and_are_remembered(tmp_path: Path) -> None:
    def fetch(_ranges: Any) -> list[bytes]:
        raise OSError("the network is down")

    file = RangedFile(tmp_path / "run.mcap", 1000, fetch)
    with reading([file]), pytest.raises((LogError, OSError)):
        list(open_scan(file.path, topics=frozenset()))
    assert isinstance(file.failure, OSError) or file.read_bytes == 0


def test_a_fetch_that_gives_too_little_is_refused(tmp_path: Path) -> None:
    file = RangedFile(tmp_path / "run.mcap", 1000, lambda _ranges: [b"x"])
    with pytest.raises(OSError, match="1 bytes came instead of 10"):
        file.have([(0, 10)])


# What goes wrong on the way ----------------------------------------------------------------


def test_a_moment_of_trouble_is_got_over(web: Web) -> None:
    shutil.copyfile(EXAMPLE, web.root / "run.mcap")
    web.busy = 3  # a look and the reading again are two requests each to a library that tries GET after HEAD
    assert document(one(f"{web.url}/run.mcap"))["status"] == "scored"


@pytest.mark.parametrize(
    ("option", "value", "cause"),
    [
        ("status", {".mcap": 403}, "it may not be read: HTTP 403"),
        ("status", {".mcap": 404}, "no such file or folder"),
        ("status", {".mcap": 500}, "cannot be fetched: HTTP 500"),
        ("cut", ".mcap", "cannot be fetched: ClientPayloadError"),
    ],
)
@pytest.mark.parametrize("ranges", [False, True])
def test_a_run_that_does_not_come_is_unreachable_and_asked_for_again(
    web: Web, option: str, value: Any, cause: str, ranges: bool
) -> None:
    shutil.copyfile(EXAMPLE, web.root / "run.mcap")
    setattr(web, option, value)

    done = one(f"{web.url}/run.mcap?token=secret", ranges=ranges)

    outcome = document(done)
    assert outcome["outcome"] == "unreachable"
    assert cause in outcome["reason"]
    assert "secret" not in outcome["reason"]
    assert (done.address, done.contents, done.signature) == ("", "", "")
    setattr(web, option, {} if option == "status" else "")
    assert document(one(f"{web.url}/run.mcap", ranges=ranges))["status"] == "scored"


def test_a_connection_that_breaks_in_the_middle_of_parts_is_no_damaged_log(web: Web) -> None:
    with_camera(web.root / "run.mcap", "")
    seen = []
    whole = Storage._parts

    def breaks(self: Storage, file: Stored, ranges: Any) -> Any:
        seen.append(len(ranges))
        if len(seen) > 1:
            raise remote.UnreachableError("cannot be fetched: the network is down")
        return whole(self, file, ranges)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Storage, "_parts", breaks)
        patch.setattr(remote.Storage, "fetch", lambda *_: pytest.fail("it is not fetched whole"))
        patch.setattr(near, "foresee", lambda file, _topics: file.have([(0, 64)]) is None)
        done = one(f"{web.url}/run.mcap", ranges=True)

    assert document(done)["outcome"] == "unreachable"
    assert "the network is down" in document(done)["reason"]


@pytest.mark.parametrize("ranges", [False, True])
def test_a_file_that_changes_while_it_is_fetched_is_looked_at_again(web: Web, ranges: bool) -> None:
    with_camera(web.root / "run.mcap", "")
    web.changed = ".mcap"

    done = one(f"{web.url}/run.mcap", ranges=ranges)

    assert document(done)["outcome"] == "changing"
    assert done.address == ""


def test_more_than_was_announced_is_not_fetched_to_its_end(web: Web, tmp_path: Path) -> None:
    (web.root / "run.bin").write_bytes(bytes(50_000_000))
    storage = Storage(f"{web.url}/run.bin")

    with pytest.raises(remote.UnreachableError, match="more than the announced 1000 bytes came"):
        storage.fetch(replace(storage.file(), size=1000), tmp_path / "into")
    assert (tmp_path / "into").stat().st_size < 25_000_000


@pytest.mark.parametrize("silent", ["/", "competition.yaml"])
def test_a_storage_that_never_answers_is_not_waited_for_without_end(
    web: Web, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, silent: str
) -> None:
    (web.root / "competition.yaml").write_text("id: x\n")
    web.silent = silent
    monkeypatch.setattr(remote, "ANSWER_S", 0.5)
    monkeypatch.setattr("ariac_score.batch.remote_plans.LISTING_S", 0.5)

    with pytest.raises(remote.UnreachableError, match=r"no answer within 0\.5 s") as caught:
        elsewhere(f"{web.url}/", tmp_path)

    assert caught.value.exit_code == 7


def test_a_server_that_makes_up_folders_without_end_is_left(
    web: Web, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    web.endless = True
    monkeypatch.setattr(remote, "LISTING_S", 0.5)

    with pytest.raises(remote.UnreachableError, match=r"is not listed to its end after 0\.5 s"):
        elsewhere(f"{web.url}/", tmp_path)


def test_a_run_of_a_list_whose_storage_never_answers_is_unreachable_and_the_others_are_scored(
    trials: Path, web: Web, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (trials / "silent.mcap").touch()
    web.silent = "silent.mcap"
    names = ["a.mcap", "silent.mcap"]
    (tmp_path / "runs.txt").write_text("".join(f"{web.url}/{trials.name}/{name}\n" for name in names))
    monkeypatch.setattr(remote, "ANSWER_S", 0.5)

    plan = plan_list(tmp_path / "runs.txt", RULES)

    assert [bool(task.signature) for task in plan.tasks] == [True, False]
    found = document(perform(plan.tasks[1], BatchSetting.of(load_rule_set(RULES), LIMITS)))
    assert (found["outcome"], "no answer within 0.5 s" in found["reason"]) == ("unreachable", True)


@pytest.mark.parametrize("ranges", [False, True])
@pytest.mark.parametrize("spare_bytes", [0, -1])
def test_a_run_with_more_bytes_than_a_run_may_have_is_not_fetched(
    web: Web, spare_bytes: int, ranges: bool
) -> None:
    (web.root / "run").mkdir()
    shutil.copyfile(EXAMPLE, web.root / "run/log.mcap")
    (web.root / "run/notes.txt").write_bytes(bytes(1000))
    size = EXAMPLE.stat().st_size + 1000
    limits = Limits(120.0, 0, input_bytes=size + spare_bytes)
    setting = BatchSetting.of(load_rule_set(RULES), limits, ranges=ranges)

    done = perform(RunTask("", "run", 1, f"{web.url}/run/"), setting)

    if spare_bytes == 0:
        assert document(done)["schema"] == "ariac-score/result/3"
    else:
        found = document(done)
        assert (found["outcome"], done.address) == ("too_large", "")
        assert f"{size}; all files of a run may have {size - 1}; remove" in found["reason"]


def test_a_process_that_dies_leaves_the_hash_of_what_it_read(web: Web, tmp_path: Path) -> None:
    (web.root / "t").mkdir()
    shutil.copyfile(EXAMPLE, web.root / "t" / "bad.mcap")

    def executor(work: Path) -> LocalExecutor:
        return LocalExecutor(1, None, work, hands.dies_when_asked)

    score(elsewhere(f"{web.url}/t/", tmp_path), tmp_path / "there", executor=executor)
    score(plan_batch(web.root / "t", RULES), tmp_path / "here", executor=executor)

    assert outcomes(tmp_path / "there") == {"bad.mcap": "killed"}
    assert same(tmp_path / "here", tmp_path / "there")
    again = score(elsewhere(f"{web.url}/t/", tmp_path), tmp_path / "there", executor=executor)
    assert again.scored_now == 0  # it is not tried for ever


def test_a_keeper_on_a_worker_fetches_as_everybody_does(web: Web) -> None:
    shutil.copyfile(EXAMPLE, web.root / "run.mcap")
    setting = BatchSetting.of(load_rule_set(RULES), LIMITS)

    done = measure_isolated(RunTask("", "run.mcap", 1, f"{web.url}/run.mcap"), setting)

    assert done.document == as_json(score_trial(web.root / "run.mcap", RULES)).encode()


# What the command says ---------------------------------------------------------------------


def command(*arguments: str) -> int:
    return main(["batch", *arguments, "--rules", RULES])


@pytest.mark.parametrize(
    ("status", "code", "said"),
    [
        (404, 5, "no such file or folder"),
        (401, 4, "it may not be read: HTTP 401"),
        (403, 4, "credentials"),
        (500, 7, "cannot be fetched: HTTP 500"),
    ],
)
def test_a_folder_that_cannot_be_listed_has_an_exit_code(
    trials: Path,
    web: Web,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    status: int,
    code: int,
    said: str,
) -> None:
    del trials
    web.status["trials/"] = status
    assert command(f"{web.url.replace('//', '//me:secret@')}/trials/", "-o", str(tmp_path / "out")) == code
    err = capsys.readouterr().err
    assert said in err
    assert "secret" not in err
    assert not (tmp_path / "out").exists()


def test_a_host_that_is_not_there_and_a_library_that_is_not_installed_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = str(tmp_path / "out")
    assert command("http://127.0.0.1:9/trials/", "-o", out) == 7
    assert "cannot be fetched" in capsys.readouterr().err
    assert command("nosuch://bucket/trials", "-o", out) == 4
    assert "write s3://BUCKET/FOLDER" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "fsspec", None)
    assert command("s3://bucket/trials", "-o", out) == 4
    assert "pip install 'ariac-score[remote]'" in capsys.readouterr().err


def test_an_empty_folder_is_refused(web: Web, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (web.root / "empty").mkdir()
    assert command(f"{web.url}/empty/", "-o", str(tmp_path / "out")) == 5
    assert "there is no file below it" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["../x", "a/../../x", "/etc/passwd", "a//b", "a\\b", "a\0b", "."])
def test_a_listing_that_leads_out_of_its_folder_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="which cannot be the name of a file"):
        remote.check_inside(name, "s3://bucket/x")


def test_a_name_that_is_a_file_and_a_folder_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = [Stored("a", "a", 1, "x"), Stored("a/b", "a/b", 1, "y")]
    monkeypatch.setattr(Storage, "files", lambda _self: listed)
    with pytest.raises(UsageError, match="cannot be a file here"):
        elsewhere(f"file://{tmp_path}", tmp_path)


def test_a_signature_changes_with_what_the_storage_says_and_only_then() -> None:
    file = Stored("b/a", "a", 10, "ETag=1")
    first = signature_of_stored([file, replace(file, path="b/c")], "whole")

    assert first == signature_of_stored([replace(file, path="b/c"), file], "whole") != ""
    for other in (replace(file, size=11), replace(file, identity="ETag=2"), replace(file, path="b/d")):
        assert signature_of_stored([other, replace(file, path="b/c")], "whole") != first
    assert signature_of_stored([file, replace(file, path="b/c")], "parts") != first
    assert signature_of_stored([file, replace(file, path="b/c", identity="")], "whole") == ""
    assert signature_of_stored([], "whole") == ""


def test_nothing_secret_of_an_address_is_shown() -> None:
    assert shown("https://me:secret@h/a?X-Amz-Signature=abc#x") == "https://h/a"
    assert shown("s3://bucket/a #1.mcap") == "s3://bucket/a #1.mcap"


def test_a_worker_is_bound_to_the_size_of_a_result_only_when_all_is_fetched(web: Web, tmp_path: Path) -> None:
    (web.root / "t").mkdir()
    shutil.copyfile(EXAMPLE, web.root / "t" / "run.mcap")
    with (web.root / "t" / "run.mcap").open("ab") as log:
        log.write(bytes(5 << 20))  # longer than a result may be
    plan = elsewhere(f"{web.url}/t/", tmp_path)
    store, rule_set = Store(tmp_path / "out"), load_rule_set(RULES)
    setting = BatchSetting.of(rule_set, Limits(wall_s=120.0, output_bytes=1 << 20))
    with store.working() as work:
        executor = LocalExecutor(1, None, work)
        run_batch(plan.tasks, rule_set, setting, store, work, executor, name=plan.id)
        assert not list(work.glob("*.fetched"))

    assert outcomes(tmp_path / "out") == {"run.mcap": "unreadable"}  # bytes follow the end
