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


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One server for all tests: the library keeps its connections, and with them the address."""
    moto = pytest.importorskip("moto.server", reason="moto is not here; it comes with the extra 'buckets'")
    pytest.importorskip("s3fs", reason="s3fs, which the extra 'remote' brings, is not installed")
    none = str(tmp_path_factory.mktemp("aws") / "none")
    running = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    running.start()
    host, port = running.get_host_and_port()
    with pytest.MonkeyPatch.context() as monkeypatch:
        for name, value in {
            "AWS_ACCESS_KEY_ID": "nobody",
            "AWS_SECRET_ACCESS_KEY": "nothing",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_CONFIG_FILE": none,
            "AWS_SHARED_CREDENTIALS_FILE": none,
            "AWS_EC2_METADATA_DISABLED": "true",
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        }.items():
            monkeypatch.setenv(name, value)
        yield
    running.stop()


@pytest.fixture
def bucket(server: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    """An empty bucket of nobody in particular."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(remote, "PAUSE_S", 0.0)
    import fsspec  # noqa: PLC0415  # an extra

    # One of an earlier test knows no credentials, or another server.
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    name = f"season-{uuid.uuid4().hex}"
    fsspec.filesystem("s3", skip_instance_cache=True).mkdir(name)
    return f"s3://{name}"


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


# The store in a bucket --------------------------------------------------------------------


def words(*more: str) -> list[str]:
    return ["-q", "batch", *more, "--rules", RULES, "--jobs", "1"]


def in_bucket(bucket: str) -> dict[str, bytes]:
    """Every file of a season there, by name."""
    import fsspec  # noqa: PLC0415  # an extra

    storage = fsspec.filesystem("s3", skip_instance_cache=True, use_listings_cache=False)
    base = bucket.removeprefix("s3://") + "/season/"
    return {path.removeprefix(base): storage.cat_file(path) for path in storage.find(base)}


def of_folder(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def another_machine(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))


def test_a_store_in_a_bucket_is_that_of_a_folder_and_another_machine_goes_on_there(
    bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    trials, season = tmp_path / "trials", f"{bucket}/season"
    trials.mkdir()
    shutil.copyfile(EXAMPLE, trials / "a.mcap")
    (trials / "cut.mcap").write_bytes(EXAMPLE.read_bytes()[:100_000])

    assert main(words(str(trials), "-o", str(tmp_path / "here"))) == 6
    assert main(words(str(trials), "-o", season)) == 6
    assert in_bucket(bucket) == of_folder(tmp_path / "here")

    another_machine(monkeypatch, tmp_path / "second")  # which has nothing but the bucket
    shutil.copyfile(EXAMPLE, trials / "b.mcap")
    capsys.readouterr()
    assert main(words(str(trials), "-o", season)) == 6
    assert f"results: {season} " in capsys.readouterr().out
    assert main(words(str(trials), "-o", str(tmp_path / "here"))) == 6
    assert in_bucket(bucket) == of_folder(tmp_path / "here")

    another_machine(monkeypatch, tmp_path / "third")
    assert main(["-q", "export", season]) == 0
    table = capsys.readouterr().out
    assert main(["-q", "export", str(tmp_path / "here")]) == 0
    assert table.endswith(capsys.readouterr().out)
    assert main(["-q", "merge", str(tmp_path / "joined"), season]) == 6
    assert of_folder(tmp_path / "joined") == of_folder(tmp_path / "here")


def test_who_wrote_there_meanwhile_is_not_overwritten_and_the_next_call_joins_both(
    bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from ariac_score.batch import bucket as module  # noqa: PLC0415  # the fixture has its name

    trials, season = tmp_path / "trials", f"{bucket}/season"
    trials.mkdir()
    shutil.copyfile(EXAMPLE, trials / "a.mcap")
    pushed = module.Bucket.push

    def late(ours: module.Bucket) -> int:
        monkeypatch.setattr(module.Bucket, "push", pushed)
        another_machine(monkeypatch, tmp_path / "quicker")
        assert main(words(str(trials), "-o", season)) == 0
        another_machine(monkeypatch, tmp_path / "slower")
        return pushed(ours)

    another_machine(monkeypatch, tmp_path / "slower")
    monkeypatch.setattr(module.Bucket, "push", late)
    assert main(words(str(trials), "-o", season)) == 7
    assert "another batch has written there meanwhile" in capsys.readouterr().err
    kept = in_bucket(bucket)
    assert main(words(str(trials), "-o", season)) == 0
    assert in_bucket(bucket) == kept


def test_a_document_that_was_changed_in_the_bucket_is_scored_again_and_refused_by_merge(
    bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import fsspec  # noqa: PLC0415  # an extra

    trials, season = tmp_path / "trials", f"{bucket}/season"
    trials.mkdir()
    shutil.copyfile(EXAMPLE, trials / "a.mcap")
    assert main(words(str(trials), "-o", season)) == 0
    sound = in_bucket(bucket)
    (name,) = (name for name in sound if name.startswith("objects/"))
    storage = fsspec.filesystem("s3", skip_instance_cache=True)
    forged = sound[name].replace(b'"score": ', b'"score": 1')
    assert forged != sound[name]
    storage.pipe_file(f"{season}/{name}", forged)

    another_machine(monkeypatch, tmp_path / "second")
    assert main(["-q", "merge", str(tmp_path / "joined"), season]) == 7
    assert "its hash is another one" in capsys.readouterr().err
    assert main(words(str(trials), "-o", season)) == 0
    assert "1 scored now" in capsys.readouterr().out
    assert in_bucket(bucket) == sound


def test_a_season_in_a_bucket_is_signed_there_and_ranked_from_there_where_its_signature_is_asked_for(
    bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    trials, season, key = tmp_path / "cup" / "logs", f"{bucket}/season", tmp_path / "key"
    for team in ("ours", "theirs"):
        (trials / team / "walk_1").mkdir(parents=True)
        shutil.copyfile(EXAMPLE, trials / team / "walk_1" / "log.mcap")
    cup = str(trials.parent)
    assert main(words(cup, "-o", season)) == 0
    assert main(["sign", "--new-key", str(key)]) == 0
    ranking = ["-q", "rank", cup, "--rules", RULES, "--batch", season, "--public-key", f"{key}.pub"]
    assert main(ranking) != 0  # as long as nobody has signed it
    capsys.readouterr()

    assert main(["sign", season, "--key", str(key)]) == 0
    assert capsys.readouterr().out == f"{season}/runs.jsonl.minisig\n"

    another_machine(monkeypatch, tmp_path / "second")
    assert main([*ranking, "--output-format", "csv"]) == 0
    assert {row.split(",")[1] for row in capsys.readouterr().out.splitlines()[1:]} == {"ours", "theirs"}
    assert main(["sign", "https://example.org/season", "--key", str(key)]) == 4
    assert main(["sign", f"{bucket}/nothing", "--key", str(key)]) == 4


def test_no_batch_and_a_web_server_are_refused(
    bucket: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", f"{bucket}/nothing"]) == 4
    assert "no finished batch lies there" in capsys.readouterr().err
    assert main(words(str(tmp_path), "-o", "https://example.org/season")) == 4
    assert "a web server takes no results" in capsys.readouterr().err
