"""Only plain files within a limit are read: nothing waits for a pipe, or fills memory from a device."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.documents.plain_file import read_plain

ROOT = Path(__file__).parents[2]
LOG = str(ROOT / "examples/kitting_near_miss.mcap")
RESULT = str(ROOT / "examples/kitting_near_miss.result.json")


def test_a_file_as_large_as_allowed_is_read_and_a_larger_one_is_not(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"12345")

    assert read_plain(file, 5) == b"12345"
    with pytest.raises(OSError, match="it has 5 bytes"):
        read_plain(file, 4)
    with pytest.raises(OSError, match="it goes on"):  # it states a size of 0
        read_plain("/proc/self/status", 4)
    with pytest.raises(FileNotFoundError):
        read_plain(tmp_path / "none", 5)
    with pytest.raises(IsADirectoryError):
        read_plain(tmp_path, 5)


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    """A folder with a pipe, a device, and files of 3 GB that take no room on the disk."""
    for name in ("pipe.json", "pipe.yaml"):
        os.mkfifo(tmp_path / name)
    for name in ("device.json", "device.yaml"):
        (tmp_path / name).symlink_to("/dev/zero")
    for name in ("large.json", "large.yaml"):
        with (tmp_path / name).open("wb") as stream:
            stream.truncate(3 << 30)
    return tmp_path


TAKES_JSON = (
    "verify {}",
    f"verify {RESULT} --public-key {{}}",
    "report {}",
    "explain {} score",
    "price {} --rules paper2020.published",
    "adjust {}",
    "export {}",
    "sensitivity {}",
    f"annotate {LOG} {{}} -o out.mcap",
    "sign {} --key {}",
    f"score {LOG} --rules ariac2024.official --cohort {{}}",
    "merge whole {}",
    "verify {} --log competition.yaml",
    "report {} -o site",
    "export {} --table checks",
)
TAKES_YAML = (
    f"verify {RESULT} --rules {{}}",
    f"score {LOG} --rules {{}}",
    f"score {LOG} --rules paper2020.published --log-map {{}}",
    f"score {LOG} --rules paper2020.published --trial-config {{}}",
    f"score {LOG} --rules paper2020.published --config {{}}",
    f"adjust {RESULT} {{}}",
    "rules show {}",
    "rules prove {}",
    "rank {}",
    "batch {} --rules paper2020.published -o season",
    "rules check {}",
    "rules validate {}",
    "rules diff {} paper2020",
    f"redteam {LOG} --rules {{}}",
    f"check {LOG} --rules {{}}",
    f"info {LOG} --rules {{}}",
    "record --rules {}",
    f"watch {LOG} --rules {{}}",
    "oracle --rules {} --port 0",
    "rank {} --design 5",
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_what_is_no_plain_file_or_too_large_gets_one_message_from_every_command(
    kind: str, odd: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("minisign")
    monkeypatch.chdir(odd)
    for ending, calls in (("json", TAKES_JSON), ("yaml", TAKES_YAML)):
        for call in calls:
            code = main(call.replace("{}", f"{kind}.{ending}").split())

            err = capsys.readouterr().err
            assert code in (4, 5, 6), (call, code, err)
            assert err.count("error:") == 1, (call, err)
            assert "MemoryError" not in err


TAKES_A_LOG = (
    "score {} --rules paper2020",
    "check {} --rules paper2020",
    "info {}",
    "map {}",
    "redteam {} --rules paper2020",
    "rules prove paper2020 --cases 0 --tries 1 --log {}",
    "watch {} --rules paper2020 --patience-s 2",
    "watch replay:{} --rules paper2020",
    f"verify {RESULT} --log {{}}",
    "audit {}",
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_is_no_recording_holds_up_no_command(
    kind: str, odd: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(odd)
    os.mkfifo("pipe.mcap")
    Path("device.mcap").symlink_to("/dev/zero")
    for call in TAKES_A_LOG:
        code = main(call.replace("{}", f"{kind}.mcap").split())

        err = capsys.readouterr().err
        assert code in (4, 5, 6), (call, code, err)
        assert err.count("error:") == 1, (call, err)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("platform", "name"),
    [
        ("codabench", "pipe.yaml"),
        ("codabench", "device.yaml"),
        ("evalai", "pipe.yaml"),
        ("evalai", "device.yaml"),
        ("evalai", "large.yaml"),
    ],
)
def test_the_checks_of_platforms_name_what_is_no_plain_file(
    platform: str, name: str, odd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["platform", platform, "check", str(odd / name)]) != 0
    said = capsys.readouterr()
    assert name in said.out + said.err
