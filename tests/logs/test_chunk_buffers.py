"""Chunks inflated by other threads come in their order, and none behind one that failed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.errors import LogError
from ariac_score.logs.containers import chunk_buffers as module
from ariac_score.logs.containers.chunk_buffers import Slabs, nothing_to_do
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.source import Source

JOBS = [1, 2, 3]


def _looked_at(
    sizes: list[int], jobs: int, broken: int | None = None, error: type[Exception] = ValueError
) -> tuple[list[list[int]], str]:
    """The first byte of each chunk that can be had, slab by slab, and why no more can."""
    found: list[list[int]] = []

    def fill(number: int) -> Callable[[memoryview], Callable[[], None]]:
        def job(room: memoryview) -> None:
            if number == broken:
                raise error(f"chunk {number} is broken")
            room[:] = bytes([number]) * len(room)

        return lambda room: (lambda: job(room)) if len(room) != 3 else nothing_to_do

    with Slabs(jobs) as slabs:

        def look(several: object) -> str:
            for slab in several:  # type: ignore[attr-defined]
                chunks, failure = slab.finished()
                found.append([int(slab.buffer[chunk.first]) for chunk in chunks])
                if failure is not None:
                    return str(failure)
            return ""

        for number, size in enumerate(sizes):
            if why := look(slabs.turn(size, 0)):
                return found, why
            slabs.add(size, 0, number, fill(number))
        return found, look(slabs.rest())


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SLAB_BYTES", 64)
    monkeypatch.setattr(module, "_TOGETHER_BYTES", 16)


@settings(max_examples=60, deadline=None)
@given(sizes=st.lists(st.integers(4, 80), min_size=1, max_size=30), jobs=st.sampled_from(JOBS))
def test_all_chunks_come_in_their_order(sizes: list[int], jobs: int) -> None:
    found, why = _looked_at(sizes, jobs)

    assert [number for slab in found for number in slab] == list(range(len(sizes)))
    assert why == ""


@settings(max_examples=60, deadline=None)
@given(data=st.data(), jobs=st.sampled_from(JOBS))
def test_what_is_before_a_broken_chunk_can_be_had_and_nothing_behind_it(
    data: st.DataObject, jobs: int
) -> None:
    sizes = data.draw(st.lists(st.integers(4, 80), min_size=1, max_size=30))
    broken = data.draw(st.integers(0, len(sizes) - 1))

    found, why = _looked_at(sizes, jobs, broken)

    assert [number for slab in found for number in slab] == list(range(broken))
    assert why == f"chunk {broken} is broken"


@pytest.mark.parametrize("jobs", JOBS)
def test_what_is_no_damage_is_raised(jobs: int) -> None:
    with pytest.raises(MemoryError, match="chunk 2 is broken"):
        _looked_at([10] * 8, jobs, 2, MemoryError)


@pytest.mark.parametrize("jobs", JOBS)
def test_so_many_threads_take_part(jobs: int) -> None:
    seen: set[int] = set()

    def fill(room: memoryview) -> Callable[[], None]:
        return lambda: seen.add(threading.get_ident())

    with Slabs(jobs) as slabs:
        for number in range(40):
            for slab in slabs.turn(20, 0):
                slab.finished()
            slabs.add(20, 0, number, fill)
        for slab in slabs.rest():
            slab.finished()

    assert seen
    assert len(seen - {threading.get_ident()}) <= jobs - 1


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_source_gives_the_bytes_of_the_file_however_it_is_asked(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    raw = np.random.default_rng(5).integers(0, 256, 90_000, dtype=np.uint8).tobytes()
    path: Path = tmp_path_factory.getbasetemp() / "source.bin"
    if not path.exists():
        path.write_bytes(raw)
    small, any_size = st.integers(0, 40), st.integers(0, 40_000)

    with Source(path) as source:
        for _ in range(data.draw(st.integers(1, 12))):
            at = source.offset
            count = min(data.draw(st.one_of(small, any_size)), source.left)
            way = data.draw(st.sampled_from(["take", "into", "skip", "peek", "at", "read_at", "later"]))
            place = data.draw(st.integers(0, len(raw) - 1))
            if way == "take":
                assert source.take(count, "it") == raw[at : at + count]
            elif way == "into":
                room = bytearray(count)
                source.take_into(memoryview(room), "it")
                assert room == raw[at : at + count]
            elif way == "skip":
                source.skip(count)
            elif way == "peek":
                assert source.peek(count) == raw[at : at + count]
            elif way == "at":
                assert source.at(place, count) == raw[place : place + count]
            elif way == "read_at":
                room = bytearray(min(count, len(raw) - place))
                source.read_at(place, memoryview(room), "it")
                assert room == raw[place : place + len(room)]
            else:
                room = bytearray(count)
                source.later(count, "it")(memoryview(room))
                assert room == raw[at : at + count]
            assert source.offset == at + (count if way in ("take", "into", "skip", "later") else 0)


@pytest.mark.parametrize("count", [11, 20_000, 1 << 40])
def test_a_source_gives_nothing_beyond_the_end_of_the_file(tmp_path: Path, count: int) -> None:
    path = tmp_path / "short.bin"
    path.write_bytes(b"0123456789")

    with Source(path) as source:
        with pytest.raises(LogError, match=rf"the file is cut off: it needs {count} bytes, 10 are there"):
            source.take(count, "it")
        assert source.take(10, "it") == b"0123456789"
        assert source.at(10, 5) == b""
        assert source.at(8, 5) == b"89"
        assert source.peek(5) == b""


def test_a_file_that_gets_shorter_while_it_is_read_ends_early(tmp_path: Path) -> None:
    path = tmp_path / "shrinking.bin"
    path.write_bytes(bytes(100_000))

    with Source(path) as source:
        source.take(10, "it")
        with path.open("r+b") as file:
            file.truncate(50_000)
        source.skip(30_000)
        with pytest.raises(LogError, match="the file ends early"):
            source.take(40_000, "it")
        with pytest.raises(LogError, match="the file ends early"):
            source.take_into(memoryview(bytearray(40_000)), "it")


def test_a_recording_is_read_where_memory_for_more_is_not_to_be_had(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_left(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("ariac_score.logs.containers.detect.np.empty", none_left)
    path = tmp_path / "t.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")

    assert open_scan(path).format == "ROS 2 bag (MCAP)"
