"""Runs in a bucket of Google Cloud Storage, read by gcsfs from a stand-in of its JSON API."""

from __future__ import annotations

import filecmp
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_rule_set, score_trial
from ariac_score.batch import remote
from ariac_score.batch.remote import Storage
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.batch.worker import Done, perform
from ariac_score.cli import main
from ariac_score.results.result_file import as_json
from ariac_score.testing import Recorded, write_bag
from ariac_score_ariac.testing.recordings import recorded_messages

sys.path.insert(0, str(Path(__file__).parent))
from batch_gcs import Bucket, emulating

from ariac_score_ariac.testing import kitting_trial

os.environ.setdefault("GCSFS_EXPERIMENTAL_ZB_HNS_SUPPORT", "false")

RULES = "paper2020.published"
EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
# Libraries of the storage's owner tell of Python versions that they will leave behind.
pytestmark = [
    pytest.mark.slow,  # a server on this machine
    pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning"),
]


@pytest.fixture(scope="module", autouse=True)
def _library_of_the_storage() -> None:
    # Not at the top: it takes seconds to import, also where these tests are not run.
    pytest.importorskip("gcsfs", reason="gcsfs, which the extra 'remote' brings, is not installed")


@pytest.fixture(autouse=True)
def _nobody_in_particular(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No credentials of this machine, no asking for any, and no pauses."""
    for name in ("GOOGLE_APPLICATION_CREDENTIALS", "GOOGLE_CLOUD_PROJECT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("CLOUDSDK_CONFIG", str(tmp_path / "no_configuration"))
    monkeypatch.setenv("NO_GCE_CHECK", "true")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(remote, "PAUSE_S", 0.0)


@pytest.fixture
def season(tmp_path: Path) -> Path:
    """Two trials, a bundle, one cut off, one that is no log; two of the names want quoting."""
    folder = tmp_path / "season"
    (folder / "bundle #1").mkdir(parents=True)
    for name in ("a.mcap", "b c.mcap", "bundle #1/log.mcap"):
        shutil.copyfile(EXAMPLE, folder / name)
    (folder / "cut.mcap").write_bytes(EXAMPLE.read_bytes()[:100_000])
    (folder / "note.txt").write_text("hello\n", encoding="utf-8")
    return folder


@pytest.fixture
def bucket(season: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    with emulating(Bucket.of("ariac", "year/season", season)) as bucket:
        monkeypatch.setenv("STORAGE_EMULATOR_HOST", bucket.url)
        yield bucket


def batch(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The command, as somebody calls it, with workers of its own."""
    command = [sys.executable, "-W", "ignore", "-m", "ariac_score.cli", "batch", *map(str, arguments)]
    return subprocess.run([*command, "--rules", RULES], capture_output=True, text=True, check=False)


def one(uri: str, *, ranges: bool = False) -> Done:
    setting = BatchSetting.of(load_rule_set(RULES), Limits(wall_s=120.0), ranges=ranges)
    return perform(RunTask("", uri.rpartition("/")[2], 1, uri), setting)


def document(done: Done) -> dict[str, Any]:
    assert done.document is not None
    found: dict[str, Any] = json.loads(done.document)
    return found


def same(first: Path, second: Path) -> bool:
    """Whether two folders hold the same files with the same bytes."""
    names = [
        sorted(p.relative_to(f).as_posix() for p in f.rglob("*") if p.is_file()) for f in (first, second)
    ]
    assert names[0] == names[1]
    _, differing, errors = filecmp.cmpfiles(first, second, names[0], shallow=False)
    return not differing and not errors


def test_a_bucket_gives_the_bytes_of_the_same_folder_here_and_is_not_fetched_twice(
    season: Path, bucket: Bucket, tmp_path: Path
) -> None:
    bucket.page = 2
    here = batch(season, "-o", tmp_path / "here")
    there = batch("gs://ariac/year/season", "-o", tmp_path / "there", "-j", 2)

    assert (here.returncode, there.returncode) == (6, 6), there.stderr  # one is cut off
    assert same(tmp_path / "here", tmp_path / "there")
    whole = {name: size for name, size in bucket.sent.items() if size}
    assert whole == {name: len(content) for name, content in bucket.objects.items() if content}

    bucket.sent.clear()
    again = batch("gs://ariac/year/season", "-o", tmp_path / "there")
    assert (again.returncode, bucket.sent_bytes) == (6, 0)
    assert same(tmp_path / "here", tmp_path / "there")


def test_a_folder_of_the_console_is_no_run(bucket: Bucket) -> None:
    bucket.objects["year/season/empty/"] = b""
    names = [file.name for file in Storage("gs://ariac/year/season").files()]
    assert names == ["a.mcap", "b c.mcap", "bundle #1/log.mcap", "cut.mcap", "note.txt"]


def test_with_ranges_only_what_is_wanted_is_asked_for(
    bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dice = random.Random(1)  # noqa: S311  # pictures need not be secret
    messages = recorded_messages(kitting_trial(duration_s=40.0))
    pictures = [{"data": dice.randbytes(550_000).hex()} for _ in range(4)]
    t_ns = messages[2000].t_ns
    messages[2000:2000] = [Recorded("/camera", "std_msgs/msg/String", t_ns, data) for data in pictures]
    log = write_bag(tmp_path / "run.bag", messages, storage="ros1")
    bucket.objects["run.bag"] = log.read_bytes()

    there = document(one("gs://ariac/run.bag", ranges=True))

    here = json.loads(as_json(score_trial(log, RULES)))
    (source,) = there["provenance"].pop("inputs")
    here["provenance"].pop("inputs")
    assert there == here
    assert source["read_bytes"] <= bucket.sent_bytes < 0.5 * log.stat().st_size


def test_an_object_that_changes_while_it_is_fetched_is_looked_at_again(bucket: Bucket) -> None:
    bucket.changing = "a.mcap"
    assert document(one("gs://ariac/year/season/a.mcap"))["outcome"] == "changing"


@pytest.mark.parametrize(
    ("uri", "code", "said"),
    [
        ("gs://ariac/year/nothing", 5, "no such file or folder"),
        ("gs://elsewhere/season", 5, "no such file or folder"),
    ],
)
def test_what_is_not_there_has_an_exit_code(
    bucket: Bucket, tmp_path: Path, capsys: pytest.CaptureFixture[str], uri: str, code: int, said: str
) -> None:
    assert main(["batch", uri, "--rules", RULES, "-o", str(tmp_path / "out")]) == code
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("token", "forbidden", "said"),
    [("wanted", False, "it may not be read: HTTP 401"), ("", True, "it may not be read: HTTP 403")],
)
def test_without_credentials_or_with_others_it_is_said_what_to_give(
    bucket: Bucket, tmp_path: Path, capsys: pytest.CaptureFixture[str], token: str, forbidden: bool, said: str
) -> None:
    bucket.token, bucket.forbidden = token, forbidden

    assert main(["batch", "gs://ariac/year/season", "--rules", RULES, "-o", str(tmp_path / "out")]) == 4
    err = capsys.readouterr().err
    assert said in err
    assert "GOOGLE_APPLICATION_CREDENTIALS" in err
    assert not (tmp_path / "out").exists()

    reason = document(one("gs://ariac/year/season/a.mcap"))["reason"]
    assert said in reason
    assert "scorer@example" not in reason


def test_credentials_of_the_configuration_of_fsspec_are_used_and_never_shown(
    bucket: Bucket, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bucket.token = "ya29.secret"  # noqa: S105  # of a stand-in
    monkeypatch.setenv("FSSPEC_GCS_TOKEN", bucket.token)
    monkeypatch.setenv("FETCH_RAW_TOKEN_EXPIRY", "false")  # nobody else is asked what it is worth

    done = batch("gs://ariac/year/season/", "-o", tmp_path / "out")

    assert done.returncode == 6, done.stderr
    assert "3 scored" in done.stdout
    texts = [path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert b"ya29.secret" not in b"".join([*texts, done.stdout.encode(), done.stderr.encode()])


def test_whoever_cannot_be_asked_about_a_token_is_named_without_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import gcsfs.core  # noqa: PLC0415  # comes with the extra
    from requests.exceptions import ConnectionError as NotConnectedError  # noqa: PLC0415

    def refuses(*_: object, **__: object) -> None:
        raise NotConnectedError(
            "HTTPSConnectionPool(host='oauth2.example', port=443): Max retries exceeded with url: "
            "/tokeninfo?access_token=ya29.secret (Caused by NameResolutionError('no such host'))"
        )

    monkeypatch.setattr(gcsfs.core, "GoogleCredentials", refuses)
    gcsfs.core.GCSFileSystem.clear_instance_cache()
    with pytest.raises(remote.UnreachableError, match=r"url: /tokeninfo \(Caused by") as refused:
        Storage("gs://ariac/season")
    assert "ya29" not in f"{refused.value} {refused.value.hint}"


def test_credentials_that_are_none_any_more_are_said_to_be_so(monkeypatch: pytest.MonkeyPatch) -> None:
    from google.auth.exceptions import RefreshError  # noqa: PLC0415  # comes with gcsfs

    found = remote._as_score_error(RefreshError("('invalid_grant: Bad Request', {})"), "gs://ariac/season")
    assert "it may not be read" in str(found)
