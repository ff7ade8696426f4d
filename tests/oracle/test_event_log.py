"""Event logs within limits: full ones are set aside, the oldest given up."""

from __future__ import annotations

from pathlib import Path

from ariac_score.oracle.event_log import EventLog


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def test_a_log_that_would_grow_beyond_its_limit_is_set_aside(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "cell.jsonl", largest_bytes=10, most_parts=9)
    for line in (b"1234", b"5678", b"9"):  # with their ends: 5 and 5 bytes fill a file
        log.write(line)
    log.close()

    assert names(tmp_path) == ["cell.jsonl", "cell.part0001.jsonl"]
    assert (tmp_path / "cell.part0001.jsonl").read_bytes() == b"1234\n5678\n"
    assert [*log.lines()] == [b"1234\n", b"5678\n", b"9\n"]
    assert log.dropped == 0


def test_no_more_parts_are_kept_than_asked_for_and_it_is_counted(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "cell.jsonl", largest_bytes=2, most_parts=2)
    for number in range(1, 7):
        log.write(str(number).encode())
    log.close()

    assert names(tmp_path) == ["cell.jsonl", "cell.part0004.jsonl", "cell.part0005.jsonl"]
    assert b"".join(log.lines()) == b"4\n5\n6\n"
    assert log.dropped == 3


def test_without_parts_a_full_log_begins_anew(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "cell.jsonl", largest_bytes=2, most_parts=0)
    for number in range(1, 4):
        log.write(str(number).encode())
    log.close()

    assert names(tmp_path) == ["cell.jsonl"]
    assert (log.dropped, [*log.lines()]) == (2, [b"3\n"])


def test_an_event_longer_than_a_file_has_a_file_of_its_own(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "cell.jsonl", largest_bytes=3, most_parts=9)
    for line in (b"1", b"much too long", b"2"):
        log.write(line)
    log.close()

    assert [file.read_bytes() for file in log.parts] == [b"1\n", b"much too long\n"]


def test_the_half_line_of_a_process_that_was_killed_is_cut_off(tmp_path: Path) -> None:
    file = tmp_path / "cell.jsonl"
    file.write_bytes(b'{"a": 1}\n{"b"' + b"x" * 200_000)
    log = EventLog(file)
    log.write(b"{}")
    log.close()

    assert file.read_bytes() == b'{"a": 1}\n{}\n'


def test_a_file_without_any_whole_line_is_empty(tmp_path: Path) -> None:
    file = tmp_path / "cell.jsonl"
    file.write_bytes(b'{"a": ')

    EventLog(file).close()

    assert file.read_bytes() == b""


def test_parts_of_another_connection_are_not_taken(tmp_path: Path) -> None:
    (tmp_path / "cell_2.part0001.jsonl").write_bytes(b"other\n")
    log = EventLog(tmp_path / "cell.jsonl")
    log.close()

    assert log.parts == []
