"""The example competitions that CI builds, run as the platforms' workers do, in a clean environment."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tarfile
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from evalai_server import LABELS, Platform
from platform_cases import without_orders
from platform_worker import Image, image_with, judge

from ariac_score.testing.bags import Storage, write_bag
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ROOT = Path(__file__).parents[2]
SCORE = 28.0
"""Of the trial that the example submits, under the rules of 2020 as coded; the log says so, see `explain`."""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    for number in (1, 2):
        command = [sys.executable, str(ROOT / ".ci/platform-bundles"), str(folder / str(number))]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
    first, again = ({p.name: p.read_bytes() for p in (folder / n).iterdir()} for n in ("1", "2"))
    assert set(first) == {"codabench.zip", "evalai.zip", "reference_data.zip", "submission.zip"}
    assert first == again  # the same bytes twice
    return folder / "1"


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Image:
    files = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],  # noqa: S607  # git is what made the checkout
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if files.returncode:
        pytest.skip("not a git checkout, so which files belong to it is not known")
    copy, out = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("wheel")
    for name in files.stdout.splitlines():
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            (copy / name).write_bytes((ROOT / name).read_bytes())
    build = "import sys, setuptools.build_meta as b; b.build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, str(out)], cwd=copy, check=True, capture_output=True)
    (wheel,) = out.glob("*.whl")
    return image_with(wheel, tmp_path_factory.mktemp("image") / "venv")


@pytest.fixture(scope="module")
def log_text(made: Path) -> str:
    with zipfile.ZipFile(made / "submission.zip") as packed:
        return packed.read("kitting_1/trial.jsonl").decode()


def submitted(folder: Path, members: dict[str, str | bytes]) -> Path:
    """A submission as a team packs it that knows of no pitfall."""
    file = folder / "theirs.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in members.items():
            packed.writestr(name, content)
    return file


# Codabench


def test_the_example_is_scored_by_the_wheel_alone(made: Path, image: Image, tmp_path: Path) -> None:
    judged = judge(made / "codabench.zip", made / "submission.zip", tmp_path, image)

    assert judged.status == "Finished", judged.said
    assert (float(judged.columns["final"]), float(judged.columns["status_code"])) == (SCORE, 0)
    names = {path.name for path in judged.output.iterdir()}
    assert {"scores.json", "detailed_results.html", "results"} <= names
    assert "scores.txt" not in names  # which the platform would read with a loader that runs what it names
    result = json.loads((judged.output / "results/kitting_1.json").read_text(encoding="utf-8"))
    assert [one["name"] for one in result["provenance"]["inputs"]] == [
        "kitting_1/trial.jsonl",
        "kitting.yaml",
    ]


def bag(storage: Storage, place: str) -> Callable[[Path, str], dict[str, str | bytes]]:
    def kind(folder: Path, _: str) -> dict[str, str | bytes]:
        whole = write_bag(
            folder / place, list(recorded_messages(kitting_trial(duration_s=40.0))), storage=storage
        )
        files = [whole] if whole.is_file() else sorted(whole.iterdir())
        inside = "" if whole.is_file() else f"{whole.name}/"
        return {f"{inside}{file.name}": file.read_bytes() for file in files}

    return kind


def nested(folder: Path, log: str) -> dict[str, str | bytes]:
    inner = submitted(folder, {"kitting_1/trial.jsonl": log})
    return {"all_of_ours.zip": inner.read_bytes()}


def taped(folder: Path, log: str) -> dict[str, str | bytes]:
    (folder / "kitting_1").mkdir()
    (folder / "kitting_1/trial.jsonl").write_text(log, encoding="utf-8")
    with tarfile.open(folder / "a.tar.gz", "w:gz") as packed:
        packed.add(folder / "kitting_1", "kitting_1")
    return {"kitting.tar.gz": (folder / "a.tar.gz").read_bytes()}


KINDS: dict[str, Callable[[Path, str], dict[str, str | bytes]]] = {
    "one file": lambda _, log: {"kitting.jsonl": log},
    "a folder": lambda _, log: {"kitting/trial.jsonl": log},
    "no orders, the organiser says them": lambda _, log: {"kitting_1.jsonl": without_orders(log)},
    "two runs": lambda _, log: {"kitting_1.jsonl": log, "kitting_2.jsonl": log},
    "an archive in the archive": nested,
    "a tape": taped,
    "MCAP": bag("mcap", "kitting_1.mcap"),
    "ROS 1": bag("ros1", "kitting_1.bag"),
    "SQLite, in its folder": bag("sqlite3", "kitting_1"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_submission_has_its_score(
    kind: str, made: Path, image: Image, tmp_path: Path, log_text: str
) -> None:
    zipped = submitted(tmp_path, KINDS[kind](tmp_path, log_text))

    judged = judge(made / "codabench.zip", zipped, tmp_path / "run", image)

    assert (judged.status, float(judged.columns["status_code"])) == ("Finished", 0), judged.said
    expected = 7.0 if "no orders" in kind else SCORE
    assert float(judged.columns["final"]) == expected


def tape(name: str, kind: bytes = tarfile.REGTYPE, to: str = "") -> bytes:
    """A tape of one member of 5 bytes, such as no program of a team makes by itself."""
    entry = tarfile.TarInfo(name)
    entry.type, entry.linkname, entry.size = kind, to, 5 if kind == tarfile.REGTYPE else 0
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as packed:
        packed.addfile(entry, io.BytesIO(b"owned"))
    return out.getvalue()


def bomb() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("kitting_1/trial.jsonl", bytes(1 << 28))
    return out.getvalue()


def overlapping() -> bytes:
    """Two members of which the index says that they lie at one place."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as packed:
        packed.writestr("kitting_1/a", b"x" * 100)
        packed.writestr("kitting_1/b", b"x" * 100)
        packed.filelist[1].header_offset = packed.filelist[0].header_offset
    return out.getvalue()


SCRIPT = "<img src=x onerror=alert(1)>"

TRAPS: dict[str, tuple[dict[str, str | bytes], str]] = {
    "a bag zipped without its folder": (
        {"metadata.yaml": "rosbag2_bagfile_information: {}\n", "kitting_0.mcap": b"\x89MCAP0\r\n"},
        "the submission arrived empty",
    ),
    "a program": (
        {"metadata": "command: sh -c 'touch owned'\n", "run.sh": "true"},
        "the submission arrived empty",
    ),
    "nothing": ({"readme.txt": "see our paper"}, "belongs to no trial of this phase"),
    "no log": ({"kitting_1.jsonl": "{"}, "kitting"),
    "a stored result": (
        {"kitting_1.json": (ROOT / "examples/kitting_near_miss.result.json").read_text(encoding="utf-8")},
        "kitting",
    ),
    "two of one name": ({"kitting.jsonl": "{}", "kitting_1.jsonl": "{}"}, "two entries are run 1"),
    "an archive of nothing": ({"kitting.tar": b""}, "belongs to no trial|kitting"),
    "an archive that leads out": ({"a.tar.gz": tape("../../output/owned")}, "leads out of the archive"),
    "an archive with an absolute name": ({"a.tar.gz": tape("/owned")}, "leads out of the archive"),
    "an archive with a link": (
        {"a.tar.gz": tape("kitting_1/trial.jsonl", tarfile.SYMTYPE, "/app/input/ref/hashes.json")},
        "it is a link or a device",
    ),
    "an archive with a device": (
        {"a.tar.gz": tape("kitting_1/trial.jsonl", tarfile.CHRTYPE)},
        "it is a link or a device",
    ),
    "an archive of members in one another": ({"a.zip": overlapping()}, "lies within"),
    "an archive that is a bomb": ({"a.zip": bomb()}, "it holds more than"),
    "a log that is a bomb": ({"kitting_1.mcap": b"\x89MCAP0\r\n" + b"\x06" + b"\xff" * 40}, "kitting"),
    "a script in a name": ({f"{SCRIPT}/trial.jsonl": "{}"}, "belongs to no trial"),
}


@pytest.mark.parametrize("trap", TRAPS)
def test_a_trap_ends_as_a_scored_outcome_that_says_why(
    trap: str, made: Path, image: Image, tmp_path: Path
) -> None:
    members, words = TRAPS[trap]

    judged = judge(made / "codabench.zip", submitted(tmp_path, members), tmp_path / "run", image)

    assert judged.status == "Finished", judged.said
    assert float(judged.columns["final"]) == -1e6
    assert set(judged.columns) == set(LABELS)  # a column without a value would be sorted first
    message = json.loads((judged.output / "platform_scores.json").read_text(encoding="utf-8"))["message"]
    assert any(part in message for part in words.split("|")), message
    assert not (judged.output / "owned").exists()
    assert SCRIPT not in (judged.output / "detailed_results.html").read_text(encoding="utf-8")


# What is never loaded


def booby_trapped(mark: Path) -> dict[str, str | bytes]:
    """Files that Python, pytest or the engine would run, were they to be found where these look."""
    bang = f"open({str(mark)!r}, 'a').write(__file__ if '__file__' in dir() else 'pth')\n"
    point = "[ariac_score.readers]\nevil = evil:Reader\n[ariac_score.monitors]\nevil = evil:Monitor\n"
    names = (
        "sitecustomize",
        "usercustomize",
        "conftest",
        "evil",
        "json",
        "numpy",
        "yaml",
        "ariac_score",
        "setup",
    )
    files: dict[str, str | bytes] = {f"{name}.py": bang for name in names}
    files |= {"evil.pth": f"import sys; open({str(mark)!r}, 'a').write('pth')\n", "numpy/__init__.py": bang}
    files |= {
        "evil-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n",
        "evil-1.0.dist-info/entry_points.txt": point,
        "pyproject.toml": "[tool.ariac-score]\nlocal_plugins = true\n",
        "ariac-score.toml": "local_plugins = true\n",
        "rules.yaml": "id: theirs\nextends: ariac2020.as_coded\ntitle: x\nsource: x\n",
        "plugin.py": bang,
    }
    return files


@pytest.mark.parametrize("where", ["", "kitting_1/"])
def test_nothing_that_a_submission_brings_is_run(
    where: str, made: Path, image: Image, tmp_path: Path, log_text: str
) -> None:
    mark = tmp_path / "it_ran"
    hostile = {f"{where}{name}": content for name, content in booby_trapped(mark).items()}
    members = hostile | {"kitting_1/trial.jsonl": log_text}

    judged = judge(made / "codabench.zip", submitted(tmp_path, members), tmp_path / "run", image)

    assert not mark.exists(), mark.read_text()
    assert judged.status == "Finished", judged.said
    assert set(judged.columns) == set(LABELS)


def test_the_command_runs_nothing_of_the_folder_it_is_called_in(
    image: Image, tmp_path: Path, log_text: str
) -> None:
    mark = tmp_path / "it_ran"
    folder = tmp_path / "theirs"
    for name, content in booby_trapped(mark).items():
        if name.endswith(".toml"):
            continue  # settings: those that allow code are refused in words (tests/cli/test_settings.py)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "trial.jsonl").write_text(log_text, encoding="utf-8")

    def called(*words: str) -> subprocess.CompletedProcess[str]:
        command = [str(image.programs / "ariac-score"), *words]
        environment = image.environment(HOME=str(tmp_path))
        return subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
        )

    listed = called("plugins", "list")
    scored = called("score", "trial.jsonl", "--rules", "ariac2020.as_coded")

    assert not mark.exists(), mark.read_text()
    assert listed.returncode == 0
    assert "evil" not in listed.stdout
    assert "28" in scored.stdout + scored.stderr


# EvalAI


@pytest.fixture
def platform() -> Iterator[Platform]:
    server = Platform()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


def evaluate(
    platform: Platform, made: Path, image: Image, folder: Path, name: str, raw: bytes
) -> SimpleNamespace:
    """One submission, by the worker as an organiser starts it."""
    with zipfile.ZipFile(made / "reference_data.zip") as packed:
        packed.extractall(folder / "reference")  # noqa: S202  # of our own making
    body = {"submission_pk": 11, "challenge_pk": 7, "phase_pk": 3}
    platform.queue.append({"body": body, "receipt_handle": "r11"})
    platform.files = {f"/media/{name}": raw}
    told = {
        "API_SERVER": f"http://127.0.0.1:{platform.server_address[1]}",
        "AUTH_TOKEN": "secret",
        "QUEUE_NAME": "queue",
        "CHALLENGE_PK": "7",
        "no_proxy": "*",
    }
    command = [str(image.programs / "ariac-score"), "platform", "evalai", "worker", str(folder / "reference")]
    ended = subprocess.run(
        [*command, "--store", str(folder / "store"), "--once"],
        cwd=folder,
        env=image.environment(**told),
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert platform.acknowledged == ["r11"]
    (answer,) = platform.taken
    (row,) = json.loads(answer["result"])
    return SimpleNamespace(
        status=answer["submission_status"], columns=row["accuracies"], said=answer["stdout"]
    )


@pytest.mark.parametrize("name", ["a71.zip", "kitting_1.jsonl"])
def test_the_example_is_evaluated_by_the_wheel_alone(
    name: str, platform: Platform, made: Path, image: Image, tmp_path: Path, log_text: str
) -> None:
    raw = (made / "submission.zip").read_bytes() if name.endswith("zip") else log_text.encode()

    judged = evaluate(platform, made, image, tmp_path, name, raw)

    assert (judged.status, judged.columns["final"]) == ("FINISHED", SCORE), judged.said
    assert set(judged.columns) == set(LABELS)


def test_a_worker_runs_nothing_that_a_submission_brings(
    platform: Platform, made: Path, image: Image, tmp_path: Path, log_text: str
) -> None:
    mark = tmp_path / "it_ran"
    members = booby_trapped(mark) | {"kitting_1/trial.jsonl": log_text}

    judged = evaluate(platform, made, image, tmp_path, "x.zip", submitted(tmp_path, members).read_bytes())

    assert not mark.exists(), mark.read_text()
    assert judged.status == "FINISHED"


def test_what_an_importer_is_given_is_whole(made: Path) -> None:
    with zipfile.ZipFile(made / "evalai.zip") as packed:
        assert "challenge_config.yaml" in packed.namelist()
        assert "evaluation_script.zip" in packed.namelist()
        assert packed.testzip() is None
