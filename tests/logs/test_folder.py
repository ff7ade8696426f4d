"""rosbag2 folders whose storage files are compressed as a whole."""

from __future__ import annotations

import io
import random
import struct
from pathlib import Path
from typing import Any

import pytest
from backports import zstd
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers import inflating
from ariac_score.logs.containers.folder import FolderScan
from ariac_score.logs.containers.inflating import inflate
from ariac_score.logs.gather.wanted_fields import read_tables

TYPE = "std_msgs/msg/Float64"
every_storage = pytest.mark.parametrize("storage", list(StoragePlugin))


def recording(folder: Path, storage: Any, mode: Any = CompressionMode.FILE) -> Path:
    """Written by rosbags, twenty numbers."""
    store = bundled_typestore(2)
    writer = Writer(folder, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/x", TYPE, typestore=store)
        for i in range(20):
            message = store.types[TYPE](i / 8)
            writer.write(connection, 10**18 + i, bytes(store.serialize_cdr(message, TYPE)))
    return folder


def packed_file(folder: Path) -> Path:
    (file,) = folder.glob("*.zstd") if any(folder.glob("*.zstd")) else folder.glob("*.zst")
    return file


@every_storage
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_recordings_are_read(tmp_path: Path, storage: Any, mode: Any) -> None:
    (table,) = read_tables(recording(tmp_path / "r", storage, mode), {"/x": None})

    assert table.columns["data"].values.tolist() == [i / 8 for i in range(20)]


@every_storage
def test_nothing_is_left_beside_the_recording(tmp_path: Path, storage: Any) -> None:
    folder = recording(tmp_path / "r", storage)
    before = sorted(p.name for p in folder.iterdir())
    read_tables(folder, {"/x": None})

    assert sorted(p.name for p in folder.iterdir()) == before


@every_storage
def test_cut_at_every_byte_it_is_refused(tmp_path: Path, storage: Any) -> None:
    folder = recording(tmp_path / "r", storage)
    file = packed_file(folder)
    whole = file.read_bytes()
    for size in range(0, len(whole), 7):
        file.write_bytes(whole[:size])
        with pytest.raises(LogError) as caught:
            read_tables(folder, {"/x": None})
        assert caught.value.file == str(file)


def test_damage_inside_names_the_file_that_is_there(tmp_path: Path) -> None:
    folder = recording(tmp_path / "r", StoragePlugin.MCAP)
    file = packed_file(folder)
    file.write_bytes(zstd.compress(inflate(file.read_bytes(), "zstd")[:-30]))

    with pytest.raises(LogError, match=r"cut off|wrong magic") as caught:
        list(FolderScan(folder))
    assert caught.value.file == str(file)


def test_what_follows_the_compressed_data_is_damage(tmp_path: Path) -> None:
    folder = recording(tmp_path / "r", StoragePlugin.MCAP)
    file = packed_file(folder)
    file.write_bytes(file.read_bytes() + b"x")

    with pytest.raises(LogError, match="follow"):
        list(FolderScan(folder))


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = recording(tmp_path / "r", StoragePlugin.MCAP)
    packed_file(folder).write_bytes(zstd.compress(b"\0" * (80 << 20)))

    with pytest.raises(LogError, match="more than 67108864 bytes"):
        list(FolderScan(folder))
    monkeypatch.setattr(inflating, "MOST_INFLATION", 1 << 20)
    with pytest.raises(LogError, match="wrong magic"):
        list(FolderScan(folder))


def test_the_ratio_counts_only_where_much_is_announced() -> None:
    inflating.check_announced(1 << 26, 10)
    inflating.check_announced((1 << 26) + 1, (1 << 17))
    with pytest.raises(ValueError, match="1000 times"):
        inflating.check_announced((1 << 26) + 1, (1 << 26) // 1000)


@pytest.mark.parametrize(
    "data",
    [random.Random(1).randbytes(300_000), bytes(300_000), b"text" * 100_000],  # noqa: S311  # no secrets
    ids=["raw", "repeated", "packed"],
)
def test_a_frame_of_several_blocks_ends_where_its_blocks_do(data: bytes) -> None:
    # A block of zstd holds at most 128 KiB.
    frame = zstd.compress(data)

    assert inflating._end_of_zstd(frame + b"more") == len(frame)
    assert inflating._end_of_zstd(frame[:-1]) != len(frame) - 1


def test_a_limit_of_the_environment_must_be_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARIAC_SCORE_MOST_INFLATION", "many")
    with pytest.raises(LogError, match="'many'"):
        inflating._limit("ARIAC_SCORE_MOST_INFLATION", 5)
    monkeypatch.setenv("ARIAC_SCORE_MOST_INFLATION", "7")
    assert inflating._limit("ARIAC_SCORE_MOST_INFLATION", 5) == 7


def test_messages_are_counted_over_all_files(tmp_path: Path) -> None:
    folder = recording(tmp_path / "r", StoragePlugin.MCAP)
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 20", "message_count: 21"))
    scan = FolderScan(folder)

    with pytest.raises(LogError, match="announces 21 messages, the files hold 20"):
        list(scan)
    assert scan.share == 1.0


@pytest.mark.parametrize("announced", [19, 20, 21])
def test_messages_that_lie_in_no_chunk_are_counted_too(tmp_path: Path, announced: int) -> None:
    folder = recording(tmp_path / "r", StoragePlugin.MCAP)
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 20", f"message_count: {announced}"))
    packed_file(folder).write_bytes(zstd.compress(without_chunks()))

    if announced == 20:
        assert len(list(FolderScan(folder))) == 1 + 20
    else:
        with pytest.raises(LogError, match=f"announces {announced} messages, the files hold 20"):
            list(FolderScan(folder))


def without_chunks() -> bytes:
    """Twenty numbers as the writer of the format's authors leaves them with `use_chunking=False`."""
    content = io.BytesIO()
    writer = McapWriter(content, use_chunking=False, compression=CompressionType.NONE)
    writer.start("ros2")
    schema = writer.register_schema(TYPE, "ros2msg", b"float64 data")
    channel = writer.register_channel("/x", "cdr", schema)
    for i in range(20):
        writer.add_message(channel, 10**18 + i, b"\0\1\0\0" + struct.pack("<d", i / 8), 10**18 + i)
    writer.finish()
    return content.getvalue()


@every_storage
@pytest.mark.parametrize("linked", ["metadata.yaml", "storage"])
def test_a_link_out_of_the_recording_is_refused_by_name(tmp_path: Path, storage: Any, linked: str) -> None:
    folder = recording(tmp_path / "r", storage)
    file = folder / "metadata.yaml" if linked == "metadata.yaml" else packed_file(folder)
    elsewhere = file.rename(tmp_path / file.name)
    file.symlink_to(elsewhere)

    with pytest.raises(LogError, match="leads out of the folder") as refused:
        read_tables(folder, {"/x": None})

    assert file.name in str(refused.value)


@every_storage
def test_a_link_to_the_whole_recording_or_within_it_is_followed(tmp_path: Path, storage: Any) -> None:
    folder = recording(tmp_path / "r", storage)
    file = packed_file(folder)
    file.rename(folder / "kept")
    file.symlink_to("kept")
    (tmp_path / "link").symlink_to(folder)

    (table,) = read_tables(tmp_path / "link", {"/x": None})

    assert len(table.columns["data"].values) == 20
