"""Runs in a bucket of S3, read by s3fs from the server of moto."""

from __future__ import annotations

import filecmp
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from ariac_score.batch import remote
from ariac_score.cli import main

RULES = "paper2020.published"
EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
pytestmark = [
    pytest.mark.slow,  # a server on this machine
    pytest.mark.timeout(300),
    pytest.mark.filterwarnings(
        "ignore::FutureWarning", "ignore::DeprecationWarning", "ignore::ResourceWarning"
    ),
]


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[str]:
    """An empty bucket of nobody in particular."""
    server = pytest.importorskip("moto.server", reason="moto is not here; it comes with the extra 'buckets'")
    pytest.importorskip("s3fs", reason="s3fs, which the extra 'remote' brings, is not installed")
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    running.start()
    host, port = running.get_host_and_port()
    for name, value in {
        "AWS_ACCESS_KEY_ID": "nobody",
        "AWS_SECRET_ACCESS_KEY": "nothing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_CONFIG_FILE": str(tmp_path / "none"),
        "AWS_SHARED_CREDENTIALS_FILE": str(tmp_path / "none"),
        "AWS_EC2_METADATA_DISABLED": "true",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(remote, "PAUSE_S", 0.0)
    import fsspec  # noqa: PLC0415  # an extra

    name = f"season-{uuid.uuid4().hex}"  # the server keeps what the test before has made
    fsspec.filesystem("s3", skip_instance_cache=True).mkdir(name)
    yield f"s3://{name}"
    running.stop()


def test_a_season_in_a_bucket_is_the_season_of_the_same_folder(bucket: str, tmp_path: Path) -> None:
    import fsspec  # noqa: PLC0415  # an extra

    storage = fsspec.filesystem("s3", skip_instance_cache=True)
    trials = tmp_path / "trials"
    trials.mkdir()
    for name in ("a.mcap", "b.mcap"):
        shutil.copyfile(EXAMPLE, trials / name)
        storage.put(str(trials / name), f"{bucket}/trials/{name}")
    (trials / "cut.mcap").write_bytes(EXAMPLE.read_bytes()[:100_000])
    storage.put(str(trials / "cut.mcap"), f"{bucket}/trials/cut.mcap")

    here = main(["-q", "batch", str(trials), "--rules", RULES, "-o", str(tmp_path / "here")])
    there = main(["-q", "batch", f"{bucket}/trials", "--rules", RULES, "-o", str(tmp_path / "there")])

    assert here == there == 6  # one is cut off
    files = sorted(p.relative_to(tmp_path / "here") for p in (tmp_path / "here").rglob("*") if p.is_file())
    files.remove(Path("index.sqlite"))  # an index: its rows are in the order in which runs ended
    assert len(files) > 5
    for file in files:
        assert filecmp.cmp(tmp_path / "here" / file, tmp_path / "there" / file, shallow=False), file


def test_a_bucket_that_is_not_there_is_told(
    bucket: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["batch", f"{bucket}_of_others/x", "--rules", RULES, "-o", str(tmp_path / "out")]) in (
        4,
        5,
        7,
    )
    assert "error: " in capsys.readouterr().err
