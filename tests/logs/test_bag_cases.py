"""Real recordings against what two independent readers found in them.

`pytest tests/logs --bag-cases DIR` runs another folder: each recording `FILE` with `FILE.expected.json`
beside it, which has of each topic its type, count, first and last stamp, and of each field
the number of its values with their exact sum, or a digest of its texts, in the order of the
file or of their stamps. A folder of the MCAP conformance suite has one `expected.json` for all
its files.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score.logs.columnar import Payloads
from ariac_score.logs.columnar.types import column_decoder_for
from ariac_score.logs.containers import chunked
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Batch, Connection, Message
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.logs.containers.sqlite import SqliteScan
from ariac_score.testing.bags import Recorded, write_bag

SCANS = {".bag": Ros1Scan, ".db3": SqliteScan, ".mcap": McapScan}
ROOT = Path(__file__).parents[2]


def folder_of(config: pytest.Config) -> Path:
    given = config.getoption("--bag-cases")
    return Path(given) if given else ROOT.parent / "shared" / "bags"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    given, folder = metafunc.config.getoption("--bag-cases"), folder_of(metafunc.config)
    cases = sorted(p for suffix in SCANS for p in folder.rglob(f"*{suffix}.expected.json"))
    if given and not cases and not list(folder.rglob("expected.json")):
        raise pytest.UsageError(f"--bag-cases {folder}: it holds no recording with an .expected.json")
    if "expected" in metafunc.fixturenames:
        ids = [str(p.relative_to(folder)).removesuffix(".expected.json") for p in cases]
        metafunc.parametrize("expected", cases or [None], ids=ids or ["none"])


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise pytest.UsageError(f"{path}: no expectations, for it is not JSON: {error}") from error
    return found if isinstance(found, dict) else {}


def _is_conformance(path: Path) -> bool:
    """Whether it speaks of files of the MCAP conformance suite."""
    of_files = _read(path).values()
    return all(
        isinstance(facts, dict) and "messages_topic_log_publish_seq_hex" in facts for facts in of_files
    )


def described(expected: Path | None) -> tuple[Path, dict[str, Any]]:
    if expected is None:
        pytest.skip("the folder of recordings (../shared/bags, or --bag-cases DIR) is not here")
    recording = expected.with_name(expected.name.removesuffix(".expected.json"))
    if not recording.is_file():
        pytest.fail(f"{expected} has no recording {recording.name} beside it")
    topics = _read(expected).get("first", {}).get("topics")
    if topics is None:
        pytest.skip("the reader that made the expectations could not read it")
    return recording, topics


def recorded(path: Path) -> dict[str, list[Message]]:
    found: dict[str, list[Message]] = defaultdict(list)
    for item in SCANS[path.suffix](path):
        if isinstance(item, Connection):
            found[item.topic] = found[item.topic]
            continue
        for message in item.messages() if isinstance(item, Batch) else (item,):
            found[message.connection.topic].append(message._replace(payload=bytes(message.payload)))
    return found


@pytest.mark.slow
def test_every_file_of_the_conformance_suite(pytestconfig: pytest.Config, subtests: pytest.Subtests) -> None:
    suites = sorted(p for p in folder_of(pytestconfig).rglob("expected.json") if _is_conformance(p))
    if not suites:
        pytest.skip("the MCAP conformance suite is not in the folder of recordings")
    for suite in suites:
        for name, facts in _read(suite).items():
            with subtests.test(name):
                found = sorted(
                    (m.connection.topic, m.stamp_ns, bytes(m.payload).hex())
                    for m in each_message(suite.parent / name)
                )
                expected = facts["messages_topic_log_publish_seq_hex"]
                assert found == sorted((topic, log_ns, payload) for topic, log_ns, _, _, payload in expected)


def each_message(path: Path) -> Iterator[Message]:
    for item in McapScan(path):
        if isinstance(item, Batch):
            yield from item.messages()
        elif isinstance(item, Message):
            yield item


def test_topics_counts_and_times(expected: Path | None) -> None:
    path, topics = described(expected)
    messages = recorded(path)

    for topic, facts in topics.items():
        stamps = [m.stamp_ns for m in messages[topic]]
        assert len(stamps) == facts["count"], topic
        if stamps:
            assert (min(stamps), max(stamps)) == (facts["first_ns"], facts["last_ns"]), topic


def test_every_field_of_every_message(expected: Path | None) -> None:
    path, topics = described(expected)
    messages = recorded(path)

    for topic, facts in topics.items():
        if "fields" in facts and "decode_error" not in facts:
            assert_fields(facts["fields"], messages[topic], topic)


def assert_fields(fields: dict[str, Any], messages: list[Message], topic: str) -> None:
    numbers: dict[str, list[np.ndarray[Any, Any]]] = defaultdict(list)
    texts: dict[str, dict[int, list[str]]] = defaultdict(dict)
    lengths: dict[str, dict[int, tuple[int, int]]] = defaultdict(dict)
    for number, connection in enumerate(dict.fromkeys(m.connection for m in messages)):
        numbered = [(i, m) for i, m in enumerate(messages) if m.connection is connection]
        columns = column_decoder_for(connection).decode(Payloads.joined(m.payload for _, m in numbered))
        assert (columns.defects, columns.fallback) == ((), ""), topic
        for name, column in columns.columns.items():
            for level, path in zip(column.offsets, column.levels, strict=True):
                lengths[path][number] = len(level) - 1, int(level[-1])
            if column.texts is None:
                numbers[name].append(column.values)
            else:
                each = np.split(np.array(column.text(), dtype=object), np.cumsum(column.per_message())[:-1])
                for (i, _), some in zip(numbered, each, strict=True):
                    texts[name][i] = some.tolist()
    for name, facts in fields.items():
        if name.endswith("[]"):
            arrays, elements = (sum(found) for found in zip(*lengths[name[:-2]].values(), strict=True))
            assert (arrays, elements) == (facts["n"], facts["fsum"]), f"{topic} {name}"
            continue
        if "fsum" in facts:
            values = np.concatenate(numbers[name]).astype(object) if numbers[name] else np.zeros(0)
            finite = [v for v in values.tolist() if math.isfinite(v)]
            assert (len(values), math.fsum(finite)) == (facts["n"], facts["fsum"]), f"{topic} {name}"
        elif "sha256_of_joined_nul" in facts:
            assert sum(map(len, texts[name].values())) == facts["n"], f"{topic} {name}"
            digests = digests_of(texts[name], [message.stamp_ns for message in messages])
            assert facts["sha256_of_joined_nul"] in digests, f"{topic} {name}"
        else:
            raise AssertionError(f"{topic} {name}: nothing is expected of it: {facts}")


def digests_of(texts: dict[int, list[str]], stamps_ns: list[int]) -> list[str]:
    """The digests of texts in the order of the file and in that of their stamps.

    Either is right: some readers give messages as they stand, others sorted by time, and a
    digest does not say which of them made it.
    """
    digests = []
    for order in (sorted(texts), sorted(texts, key=lambda i: (stamps_ns[i], i))):
        joined = "\0".join(text for i in order for text in texts[i])
        digests.append(hashlib.sha256(joined.encode()).hexdigest()[:16])
    return digests


@pytest.mark.slow
@pytest.mark.parametrize("large", [False, True])
def test_each_topic_alone_is_what_it_is_among_all(
    expected: Path | None, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where chunks and messages of others are left out however small they are."""
    path, _ = described(expected)
    everything, contradictions = messages_in(path, None, jobs=1)
    if not large:
        monkeypatch.setattr(McapScan, "smallest_left_out_bytes", 0)
        monkeypatch.setattr(chunked, "LARGE_MESSAGE_BYTES", 1)
    for topic in {topic for topic, _, _ in everything}:
        alone = [(t, stamp_ns, data if t == topic else b"") for t, stamp_ns, data in everything]
        for jobs in (1, 2):
            found, others = messages_in(path, {topic}, jobs=jobs)
            assert [(t, s, d if t == topic else b"") for t, s, d in found] == alone
            assert others == contradictions


def messages_in(
    path: Path, topics: set[str] | None, *, jobs: int
) -> tuple[list[tuple[str, int, bytes]], int]:
    """All messages of a recording, and how often its index contradicts it."""
    scan = open_scan(path, topics=topics, jobs=jobs)
    found: list[Message] = []
    for item in scan:
        if not isinstance(item, Connection):
            batch = item.messages() if isinstance(item, Batch) else (item,)
            found += [message._replace(payload=bytes(message.payload)) for message in batch]
    messages = [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in found]
    return messages, scan.index_contradictions


# The harness itself --------------------------------------------------------------------


def made(folder: Path, suffix: str, joined: str) -> Path:
    """A recording of `b` at 2 ns and then `a` at 1 ns, with the digest of texts joined as given."""
    storage = {".bag": "ros1", ".db3": "sqlite3", ".mcap": "mcap"}[suffix]
    texts = [
        Recorded("/state", "std_msgs/msg/String", t_ns, {"data": text}) for t_ns, text in ((2, "b"), (1, "a"))
    ]
    recording = write_bag(folder / f"made{suffix}", texts, storage=storage)  # type: ignore[arg-type]
    facts = {"n": 2, "sha256_of_joined_nul": hashlib.sha256(joined.encode()).hexdigest()[:16]}
    state = {"count": 2, "first_ns": 1, "last_ns": 2, "fields": {"data": facts}}
    expected = recording.with_name(f"{recording.name}.expected.json")
    expected.write_text(json.dumps({"first": {"topics": {"/state": state}}}), encoding="utf-8")
    return expected


@pytest.mark.parametrize("suffix", SCANS)
@pytest.mark.parametrize("joined", ["b\0a", "a\0b"], ids=["as in the file", "by time"])
def test_the_order_of_texts_in_a_file_does_not_matter(suffix: str, joined: str, tmp_path: Path) -> None:
    expected = made(tmp_path, suffix, joined)

    test_topics_counts_and_times(expected)
    test_every_field_of_every_message(expected)


@pytest.mark.parametrize("joined", ["a\0c", "a", "a\0b\0b"])
def test_other_texts_than_expected_fail(joined: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="/state data"):
        test_every_field_of_every_message(made(tmp_path, ".mcap", joined))


def test_expectations_without_their_recording_fail_and_say_so(tmp_path: Path) -> None:
    expected = made(tmp_path, ".mcap", "a\0b")
    (tmp_path / "made.mcap").unlink()

    with pytest.raises(pytest.fail.Exception, match=r"has no recording made\.mcap beside it"):
        described(expected)


def test_expectations_that_are_no_json_are_named(tmp_path: Path) -> None:
    (tmp_path / "expected.json").write_text("{", encoding="utf-8")

    with pytest.raises(pytest.UsageError, match=r"expected\.json: no expectations"):
        _is_conformance(tmp_path / "expected.json")


@pytest.mark.parametrize("text", ['{"speed": 1}', '{"made.mcap": {"topics": 1}}'])
def test_an_expected_json_of_something_else_is_not_of_the_conformance_suite(
    text: str, tmp_path: Path
) -> None:
    (tmp_path / "expected.json").write_text(text, encoding="utf-8")

    assert not _is_conformance(tmp_path / "expected.json")
