"""The Dockerfile: linted, read line by line, and its steps done by this machine where that can be done."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import NoReturn

import pytest

from ariac_score import load_rule_set
from ariac_score.batch.tasks import BatchSetting, Limits
from ariac_score.cli import main
from ariac_score.platforms.codabench import Bundle, score, write_bundle

sys.path.insert(0, str(Path(__file__).parent))
from container_steps import Image, instructions, is_sent, missing, perform, sent, stages

ROOT = Path(__file__).parents[2]
DOCKERFILE = ROOT / "Dockerfile"
FOUND = instructions(DOCKERFILE)
REQUIRED = bool(os.environ.get("ARIAC_SCORE_REQUIRE_CONTAINER"))


def _absent(reason: str) -> NoReturn:
    """Skip, or fail where somebody asked for all of it."""
    if REQUIRED:
        pytest.fail(f"{reason}, and ARIAC_SCORE_REQUIRE_CONTAINER is set")
    pytest.skip(reason)


def of(instruction: str) -> list[str]:
    return [one.words for one in FOUND if one.name == instruction]


# What it says ----------------------------------------------------------------------------


def test_the_linter_of_dockerfiles_has_nothing_to_say() -> None:
    beside = Path(sys.executable).with_name("hadolint")
    program = str(beside) if beside.is_file() else shutil.which("hadolint")
    if program is None:
        _absent("hadolint is not here; it comes with the extra 'dev' where there is a wheel for it")
    command = [program, "--no-color", "--failure-threshold", "style", str(DOCKERFILE)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, ""), ended.stdout + ended.stderr


def test_it_ends_as_somebody_without_rights() -> None:
    """By number: an orchestrator that wants no root cannot tell from a name."""
    last = [one.name for one in FOUND]
    assert int(of("USER")[-1]) >= 10_000
    assert "USER" not in [one.name for one in stages(FOUND)[0]]
    assert max(i for i, name in enumerate(last) if name in ("RUN", "COPY")) < last.index("USER")
    assert re.search(rf"useradd .*--uid {of('USER')[-1]}\b.* --shell /usr/sbin/nologin", of("RUN")[-1])


def test_bases_have_a_version_and_a_supported_python() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    supported = re.findall(r'"Programming Language :: Python :: (3\.\d+)"', text)
    assert len(of("FROM")) == 2
    for base in of("FROM"):
        version = re.fullmatch(r"python:(3\.\d+)-slim( AS build)?", base)
        assert version, base
        assert version[1] in supported


def test_nothing_of_the_build_stays_but_what_was_built() -> None:
    first, last = stages(FOUND)
    assert [one.words for one in last if one.name == "COPY"] == [
        "--from=build /opt/ariac-score /opt/ariac-score"
    ]
    assert all("--no-cache-dir" in one.words for one in first if "pip install" in one.words)
    assert not re.search(r"pip|apt", " ".join(one.words for one in last if one.name == "RUN"))


def test_nothing_is_fetched_by_address_and_no_secret_is_named() -> None:
    text = "\n".join(f"{one.name} {one.words}" for one in FOUND)
    assert not re.search(r"curl|wget|http://|https://|ADD |ARG ", text)
    assert not re.search(r"(?i)token|password|secret", text)


def test_what_it_needs_to_write_is_below_tmp() -> None:
    """With a read-only root there is no other place, and no byte code is tried to be kept."""
    env = Image.of(stages(FOUND)[-1]).env
    assert env["XDG_CACHE_HOME"] == "/tmp"  # noqa: S108  # the one place that may be written
    assert env["PYTHONDONTWRITEBYTECODE"] == "1"
    assert env["PATH"].startswith("/opt/ariac-score/bin:/usr/local/bin:")
    assert of("VOLUME") == []


def test_the_command_of_a_platform_is_run_as_it_is() -> None:
    """Codabench gives `python3 /app/program/scoring.py …`; an entry point would take it for arguments."""
    assert of("ENTRYPOINT") == []


def test_what_it_does_of_itself_is_a_command_we_have(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(Image.of(stages(FOUND)[-1]).command) == ["ariac-score", "--help"]
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "platform" in capsys.readouterr().out


# What is sent to be built from ---------------------------------------------------------------


@pytest.mark.slow
def test_all_of_the_package_is_sent_and_nothing_else() -> None:
    names = sent(ROOT)
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    table = re.search(r"\[tool\.setuptools\.package-dir\]\n((?:.+\n)+)", text)
    assert table
    folders = set(re.findall(r'= "([^"]+)"', table[1]))
    assert len(folders) == 5
    assert {"pyproject.toml", "README.md", "LICENSE", ".ci/container.txt"} <= set(names)
    assert {name.partition("/")[0] for name in names} == {
        "pyproject.toml",
        ".ci",
        "README.md",
        "LICENSE",
        *folders,
    }
    assert not [name for name in names if "__pycache__" in name or ".egg-info" in name]


@pytest.mark.parametrize(
    "name", [".git/config", "tests/conftest.py", ".venv/bin/python", "organiser.key", ".env"]
)
def test_what_lies_about_is_not_sent(name: str) -> None:
    patterns = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert not is_sent(name, [p for p in patterns if p and not p.startswith("#")])


@pytest.mark.parametrize(
    ("patterns", "name", "is_part"),
    [  # of the reference of .dockerignore
        (["*/temp*"], "somedir/temporary.txt", False),
        (["*/temp*"], "somedir/subdir/temporary.txt", True),
        (["*/*/temp*"], "somedir/subdir/temporary.txt", False),
        (["temp?"], "tempa", False),
        (["temp?"], "temp", True),
        (["**/*.go"], "a/b/c.go", False),
        (["**/*.go"], "c.go", False),
        (["*.md", "!README.md"], "README.md", True),
        (["*.md", "!README*.md", "README-secret.md"], "README-secret.md", False),
        (["*.md", "README-secret.md", "!README*.md"], "README-secret.md", True),
        (["*", "!src"], "src/a/b.py", True),
        (["temp"], "temp/below/it", False),
    ],
)
def test_patterns_of_what_is_not_sent_mean_what_the_reference_says(
    patterns: list[str], name: str, is_part: bool
) -> None:
    assert is_sent(name, patterns) is is_part


# Its steps -------------------------------------------------------------------------------------


def _phase(folder: Path) -> Path:
    """What the worker of Codabench mounts: the program, the reference, and a submission."""
    rule_set = load_rule_set("ariac2020.as_coded")
    setting = BatchSetting.of(rule_set, Limits(120.0, 4 << 30))
    bundle = Bundle("Practice", f"example.org/scorer@sha256:{'a' * 64}", "2026-09-01", "2026-10-01")
    write_bundle(bundle, rule_set, setting, {"kitting": None}, folder / "bundle.zip")
    with zipfile.ZipFile(folder / "bundle.zip") as whole:
        for name, place in (("scoring_program", "program"), ("reference_data", "input/ref")):
            with zipfile.ZipFile(BytesIO(whole.read(f"{name}.zip"))) as archive:
                archive.extractall(folder / place)
    (folder / "input/res/kitting_1").mkdir(parents=True)
    shutil.copy(ROOT / "examples/kitting_near_miss.mcap", folder / "input/res/kitting_1")
    return folder


def _tree(folder: Path) -> dict[str, bytes]:
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def _probe(places: Iterable[str]) -> list[str]:
    """Says who runs it and where, what of some places it may write, and what networks there are."""
    tried = " ".join(f"(: > {place}) 2>/dev/null && rm {place} && echo writable {place};" for place in places)
    networks = "tail -n +3 /proc/net/dev | cut -d: -f1 | tr -d ' ' | sed 's/^/network /'"
    return ["sh", "-c", f"echo user $(id -u) $(id -g) in $(pwd); {tried} {networks}"]


@pytest.mark.slow
def test_what_the_steps_make_scores_without_rights_to_the_bytes_of_here(tmp_path: Path) -> None:
    if not REQUIRED:
        pytest.skip("packages are installed from their registry only with ARIAC_SCORE_REQUIRE_CONTAINER=1")
    if reason := missing():
        _absent(reason)
    folder = _phase(tmp_path)
    (user,) = of("USER")
    mounted = {"/app/input:ro": folder / "input", "/app/program:ro": folder / "program"}
    for number in (1, 2):
        (folder / f"output_{number}").mkdir()
        shutil.chown(folder / f"output_{number}", int(user))
        mounted[f"/app/output_{number}"] = folder / f"output_{number}"
    places = ["/x", "/app/x", "/app/input/x", "/opt/ariac-score/x", "/home/x", "/app/output_1/x", "/tmp/x"]  # noqa: S108  # it is looked for what may be written
    commands = [
        Image.of(stages(FOUND)[-1]).command,
        _probe(places),
        shlex.split("ariac-score platform codabench score /app/input /app/output_1"),
        shlex.split("python3 /app/program/scoring.py /app/input /app/output_2"),
    ]
    (folder / "work").mkdir()

    done = perform(DOCKERFILE, folder / "work", commands, mounted)

    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    said = done.stdout.splitlines()
    assert f"user {user} {user} in {of('WORKDIR')[-1]}" in said
    assert [line for line in said if line.startswith("writable")] == [
        "writable /app/output_1/x",
        "writable /tmp/x",
    ]
    assert [line for line in said if line.startswith("network")] == ["network lo"]
    assert score(folder / "input", folder / "output") == 0
    here = _tree(folder / "output")
    assert {"scores.json", "detailed_results.html", "results/kitting_1.json"} <= set(here)
    assert _tree(folder / "output_1") == here
    assert _tree(folder / "output_2") == here


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lines", "command", "fails"),
    [
        ("", "true", False),
        ("RUN false\n", "true", True),
        ("", ": > /x", True),
        ("RUN mkdir -m 777 /open\n", ": > /open/x", True),
        ("", ": > /tmp/x", False),
        ("ENV WHAT=a \\\n    MORE=c\nENV ELSE=$WHAT/b\n", 'test "$ELSE" = a/b', False),
        ("RUN mkdir -p /a && touch /a/x\nCOPY --from=0 /a /b\n", "test -e /b/x", False),
        ("COPY . .\n", "test -e /home/Dockerfile && ! test -e /home/left_out", False),
    ],
)
def test_steps_that_fail_and_places_that_may_not_be_written_are_noticed(
    tmp_path: Path, lines: str, command: str, fails: bool
) -> None:
    if reason := missing():
        pytest.skip(reason)
    text = f"FROM any\nWORKDIR /home\n{lines}USER 10001:10001\n"
    (tmp_path / "Dockerfile").write_text(text, encoding="utf-8")
    (tmp_path / ".dockerignore").write_text("left*\nwork*\n", encoding="utf-8")
    (tmp_path / "left_out").touch()
    (tmp_path / "work").mkdir()

    done = perform(tmp_path / "Dockerfile", tmp_path / "work", [["sh", "-c", command]], {})

    assert bool(done.returncode) is fails, done.stderr
