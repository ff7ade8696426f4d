"""Archives that strangers sent; what an archive may hold follows from the format, not from the code."""

from __future__ import annotations

import io
import os
import stat
import tarfile
import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.errors import LogError
from ariac_score.platforms.archives import ArchiveLimits, is_archive, unpack


def zipped(file: Path, members: dict[str, bytes], *, mode: int = 0o644) -> Path:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.external_attr = mode << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return file


def taped(file: Path, *entries: tarfile.TarInfo, content: bytes = b"log") -> Path:
    with tarfile.open(file, "w:gz") as archive:
        for entry in entries:
            entry.size = len(content) if entry.isreg() else 0
            archive.addfile(entry, io.BytesIO(content) if entry.isreg() else None)
    return file


def test_a_sound_archive_comes_out_as_it_went_in(tmp_path: Path) -> None:
    members = {"kit_1/log.mcap": b"\x89MCAP" * 100, "kit_1/metadata.yaml": b"a: 1\n", "b.jsonl": b""}
    for archive in (
        zipped(tmp_path / "a.zip", members),
        taped(tmp_path / "a.tgz", *(tarfile.TarInfo(name) for name in members), content=b"log"),
    ):
        into = tmp_path / f"out{archive.suffix}"
        files = unpack(archive, into)
        assert is_archive(archive)
        assert [f.relative_to(into).as_posix() for f in files] == sorted(members)
        for file in files:
            name = file.relative_to(into).as_posix()
            assert file.read_bytes() == (members[name] if archive.suffix == ".zip" else b"log")


@pytest.mark.parametrize(
    "name",
    ["../out.txt", "a/../../out.txt", "/etc/out.txt", "C:/out.txt", "a\\..\\out.txt", "a\nb", "x\x1b[31m"],
)
def test_a_name_that_leads_out_is_refused(tmp_path: Path, name: str) -> None:
    for archive in (
        zipped(tmp_path / "a.zip", {name: b"x"}),
        taped(tmp_path / "a.tar.gz", tarfile.TarInfo(name)),
    ):
        with pytest.raises(LogError, match="leads out of the archive") as caught:
            unpack(archive, tmp_path / "in" / archive.suffix)
        assert caught.value.place == repr(name)
    assert not (tmp_path / "out.txt").exists()


@pytest.mark.parametrize(
    "kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.BLKTYPE, tarfile.FIFOTYPE]
)
def test_links_and_devices_are_refused(tmp_path: Path, kind: bytes) -> None:
    entry = tarfile.TarInfo("log")
    entry.type, entry.linkname = kind, "/etc/passwd"
    with pytest.raises(LogError, match="it is a link or a device"):
        unpack(taped(tmp_path / "a.tar.gz", entry), tmp_path / "in")
    linked = zipped(tmp_path / "a.zip", {"log": b"/etc/passwd"}, mode=stat.S_IFLNK | 0o777)
    with pytest.raises(LogError, match="it is a link or a device"):
        unpack(linked, tmp_path / "in2")


@pytest.mark.parametrize(
    ("limits", "refused"),
    [
        (ArchiveLimits(members=3), False),
        (ArchiveLimits(members=2), True),
        (ArchiveLimits(bytes=30), False),
        (ArchiveLimits(bytes=29), True),
        (ArchiveLimits(name_bytes=3), False),
        (ArchiveLimits(name_bytes=2), True),
        (ArchiveLimits(depth=2), False),
        (ArchiveLimits(depth=1), True),
    ],
)
def test_each_limit_holds_from_both_sides(tmp_path: Path, limits: ArchiveLimits, refused: bool) -> None:
    archive = zipped(tmp_path / "a.zip", {"a/b": b"0123456789", "c/d": b"0123456789", "e": b"0123456789"})
    if refused:
        with pytest.raises(LogError):
            unpack(archive, tmp_path / "in", limits)
    else:
        assert len(unpack(archive, tmp_path / "in", limits)) == 3


def test_a_bomb_is_stopped_by_what_it_unpacks_to_whatever_it_declares(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip", {"zeros": bytes(50 << 20)})
    assert archive.stat().st_size < 100_000
    with pytest.raises(LogError, match="it unpacks to more than 200 times its size"):
        unpack(archive, tmp_path / "in")
    assert sum(f.stat().st_size for f in (tmp_path / "in").iterdir()) < 25 << 20
    text = archive.read_bytes()
    size = (50 << 20).to_bytes(4, "little")
    assert text.count(size) == 2
    archive.write_bytes(text.replace(size, (10).to_bytes(4, "little")))
    with pytest.raises(LogError):
        unpack(archive, tmp_path / "in2")


@pytest.mark.parametrize("kind", [stat.S_IFIFO, stat.S_IFCHR, stat.S_IFBLK, stat.S_IFSOCK])
def test_a_device_in_a_zip_is_refused(tmp_path: Path, kind: int) -> None:
    with pytest.raises(LogError, match="it is a link or a device"):
        unpack(zipped(tmp_path / "a.zip", {"log": b""}, mode=kind | 0o644), tmp_path / "in")
    assert list((tmp_path / "in").iterdir()) == []


def test_members_that_lie_within_one_another_are_refused(tmp_path: Path) -> None:
    inner, outer = io.BytesIO(), tmp_path / "a.zip"
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("b", b"0123456789")
    local = inner.getvalue()[: inner.getvalue().index(b"PK\x01\x02")]
    with zipfile.ZipFile(outer, "w") as archive:
        archive.writestr("a", local)  # stored: the head and the bytes of b are those of a, too
        archive.writestr("b", b"0123456789")
    raw = bytearray(outer.read_bytes())
    second = raw.rindex(b"PK\x01\x02")
    raw[second + 42 : second + 46] = (30 + len("a")).to_bytes(4, "little")  # where the directory has b begin
    outer.write_bytes(raw)
    with pytest.raises(LogError, match="lies within 'a'"):
        unpack(outer, tmp_path / "in")


def one_member(file: Path, entry: tarfile.TarInfo, size: int, body: bytes = b"") -> Path:
    """A tar archive of one member that announces another size than it has."""
    entry.size = size
    with tarfile.open(file, "w:gz", format=tarfile.GNU_FORMAT) as archive:
        assert archive.fileobj is not None
        archive.fileobj.write(entry.tobuf(tarfile.GNU_FORMAT) + body)
    return file


@pytest.mark.timeout(60)
@pytest.mark.parametrize("size", [1 << 40, 1 << 62])
def test_a_member_of_a_tape_that_announces_more_than_it_can_hold_is_refused_at_once(
    tmp_path: Path, size: int
) -> None:
    with pytest.raises(LogError, match=f"it announces {size} bytes"):
        unpack(one_member(tmp_path / "a.tar.gz", tarfile.TarInfo("log"), size, b"x" * 512), tmp_path / "in")


@pytest.mark.parametrize(
    "kind", [tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_LONGLINK, tarfile.XHDTYPE, tarfile.XGLTYPE]
)
def test_the_description_of_a_member_is_no_way_into_memory(tmp_path: Path, kind: bytes) -> None:
    entry = tarfile.TarInfo("x")
    entry.type = kind
    archive = one_member(tmp_path / "a.tar.gz", entry, 1 << 22, bytes(1 << 22))

    assert archive.stat().st_size < 10_000
    assert not is_archive(archive)  # its first member cannot be read
    with pytest.raises(LogError, match="it describes a member in 4194304 bytes"):
        unpack(archive, tmp_path / "in")


def test_files_with_holes_are_refused_in_each_way_to_write_them(tmp_path: Path) -> None:
    old = tarfile.TarInfo("log")
    old.type = tarfile.GNUTYPE_SPARSE
    holes = one_member(tmp_path / "old.tar.gz", old, 0)
    told = tarfile.TarInfo("log")
    told.pax_headers = {
        "GNU.sparse.major": "1",
        "GNU.sparse.minor": "0",
        "GNU.sparse.realsize": "1" + "0" * 15,
    }
    new = taped(tmp_path / "new.tar.gz", told, content=b"2000000000\n" * 1000)
    for archive in (holes, new):
        with pytest.raises(LogError, match="a member has holes"):
            unpack(archive, tmp_path / "in" / archive.name)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("names", [("a", "a"), ("a", "A"), ("a/b", "a"), ("a", "a/b"), ("a/", "a")])
def test_a_name_that_comes_twice_is_refused(tmp_path: Path, names: tuple[str, str]) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in names:
            archive.writestr(name, b"x")
    with pytest.raises(LogError):
        unpack(tmp_path / "a.zip", tmp_path / "in")


def test_an_encrypted_archive_says_so(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a.zip", {"log": b"x" * 100})
    text = bytearray(archive.read_bytes())
    for start, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        text[text.index(start) + at] |= 1
    archive.write_bytes(text)
    with pytest.raises(LogError, match="it is encrypted"):
        unpack(archive, tmp_path / "in")


def test_an_archive_cut_off_anywhere_is_refused_or_none(tmp_path: Path) -> None:
    whole = zipped(tmp_path / "a.zip", {"log": os.urandom(300)}).read_bytes()
    for size in range(len(whole)):
        (tmp_path / "cut.zip").write_bytes(whole[:size])
        with pytest.raises(LogError):
            unpack(tmp_path / "cut.zip", tmp_path / f"in{size}")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damage_anywhere_is_refused_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("zip")
    whole = bytearray(zipped(folder / "a.zip", {"log": b"0123456789" * 30, "more": b"x"}).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    (folder / "b.zip").write_bytes(whole)
    try:
        files = unpack(folder / "b.zip", folder / "in")
    except LogError:
        return
    assert all(file.resolve().is_relative_to((folder / "in").resolve()) for file in files)
