"""Real recordings against what two independent readers found in them.

`pytest --bag-cases DIR` runs another folder: each recording `FILE` with `FILE.expected.json`
beside it, which has of each topic its type, count, first and last stamp, and of each field
the number of its values with their exact sum, or a digest of its texts. A folder of the MCAP
conformance suite has one `expected.json` for all its files.
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

from ariac_score.logs import mcap, ros1bag
from ariac_score.logs.columnar import Payloads
from ariac_score.logs.mcap import McapScan
from ariac_score.logs.opening import open_scan
from ariac_score.logs.ros1bag import Ros1Scan
from ariac_score.logs.salvage import Batch, Connection, Message
from ariac_score.logs.sqlite_bag import SqliteScan
from ariac_score.logs.types import column_decoder_for

SCANS = {".bag": Ros1Scan, ".db3": SqliteScan, ".mcap": McapScan}
ROOT = Path(__file__).parents[2]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    given = metafunc.config.getoption("--bag-cases")
    folder = Path(given) if given else ROOT.parent / "shared" / "bags"
    cases = sorted(p for suffix in SCANS for p in folder.rglob(f"*{suffix}.expected.json"))
    if given and not cases and not list(folder.rglob("expected.json")):
        raise pytest.UsageError(f"--bag-cases {folder}: it holds no recording with an .expected.json")
    if "expected" in metafunc.fixturenames:
        ids = [str(p.relative_to(folder)).removesuffix(".expected.json") for p in cases]
        metafunc.parametrize("expected", cases or [None], ids=ids or ["none"])
    if "conformance" in metafunc.fixturenames:
        suites = sorted(p for p in folder.rglob("expected.json") if _is_conformance(p))
        files = [(p.parent / name, facts) for p in suites for name, facts in _read(p).items()]
        ids = [file.name for file, _ in files]
        metafunc.parametrize("conformance", files or [None], ids=ids or ["none"])


def _read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _is_conformance(path: Path) -> bool:
    """Whether it speaks of files of the MCAP conformance suite."""
    return all("messages_topic_log_publish_seq_hex" in facts for facts in _read(path).values())


def described(expected: Path | None) -> tuple[Path, dict[str, Any]]:
    if expected is None:
        pytest.skip("the folder of recordings (../shared/bags, or --bag-cases DIR) is not here")
    topics = json.loads(expected.read_text(encoding="utf-8"))["first"].get("topics")
    if topics is None:
        pytest.skip("the reader that made the expectations could not read it")
    return expected.with_name(expected.name.removesuffix(".expected.json")), topics


def recorded(path: Path) -> dict[str, list[Message]]:
    found: dict[str, list[Message]] = defaultdict(list)
    for item in SCANS[path.suffix](path):
        if isinstance(item, Connection):
            found[item.topic] = found[item.topic]
            continue
        for message in item.messages() if isinstance(item, Batch) else (item,):
            found[message.connection.topic].append(message._replace(payload=bytes(message.payload)))
    return found


def test_every_file_of_the_conformance_suite(conformance: tuple[Path, dict[str, Any]] | None) -> None:
    if conformance is None:
        pytest.skip("the MCAP conformance suite is not in the folder of recordings")
    path, facts = conformance
    found = sorted((m.connection.topic, m.stamp_ns, bytes(m.payload).hex()) for m in each_message(path))

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
            joined = [text for i in sorted(texts[name]) for text in texts[name][i]]
            digest = hashlib.sha256("\0".join(joined).encode()).hexdigest()[:16]
            assert (len(joined), digest) == (facts["n"], facts["sha256_of_joined_nul"]), f"{topic} {name}"
        else:
            raise AssertionError(f"{topic} {name}: nothing is expected of it: {facts}")


@pytest.mark.parametrize("large", [False, True])
def test_each_topic_alone_is_what_it_is_among_all(
    expected: Path | None, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where chunks and messages of others are left out however small they are."""
    path, _ = described(expected)
    everything, contradictions = told(path, None, jobs=1)
    if not large:
        monkeypatch.setattr(mcap, "_WORTH_LEAVING_OUT_BYTES", 0)
        monkeypatch.setattr(mcap, "_LARGE_MESSAGE_BYTES", 1)
        monkeypatch.setattr(ros1bag, "_LARGE_MESSAGE_BYTES", 1)
    for topic in {topic for topic, _, _ in everything}:
        alone = [(t, stamp_ns, data if t == topic else b"") for t, stamp_ns, data in everything]
        for jobs in (1, 2):
            found, others = told(path, {topic}, jobs=jobs)
            assert [(t, s, d if t == topic else b"") for t, s, d in found] == alone
            assert others == contradictions


def told(path: Path, topics: set[str] | None, *, jobs: int) -> tuple[list[tuple[str, int, bytes]], int]:
    """All messages of a recording, and how often its index contradicts it."""
    scan = open_scan(path, topics=topics, jobs=jobs)
    found: list[Message] = []
    for item in scan:
        if not isinstance(item, Connection):
            batch = item.messages() if isinstance(item, Batch) else (item,)
            found += [message._replace(payload=bytes(message.payload)) for message in batch]
    messages = [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in found]
    return messages, scan.index_contradictions
