"""What is in the wheel: every package and data file; and that it works from there."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import package_sha256
from ariac_score.cli.example import examples
from ariac_score.logs.logmap import log_map_names
from ariac_score.review.wheels import packages_of_wheel
from ariac_score.scoring.ruleset import rule_set_names

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of a copy of the checkout, so that building leaves nothing behind in it."""
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
    command = [sys.executable, "-c", _BUILD, str(out)]
    subprocess.run(command, cwd=copy, check=True, capture_output=True)  # our own command
    (path,) = out.glob("*.whl")
    return zipfile.ZipFile(path)


# Built with the setuptools of this environment: the tests need no network.
_BUILD = "import sys, setuptools.build_meta as b; b.build_wheel(sys.argv[1])"


def _tree(folder: str, pattern: str) -> set[str]:
    return {
        p.relative_to(ROOT / folder).as_posix()
        for p in (ROOT / folder).rglob(pattern)
        if "egg-info" not in str(p)
    }


def _examples(path: str) -> set[str]:
    """Files of a path of the examples that belong to the checkout."""
    listed = subprocess.run(
        ["git", "ls-files", f"examples/{path}"],  # noqa: S607  # as above
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return {name.removeprefix("examples/") for name in listed.stdout.splitlines()}


@pytest.mark.slow
def test_the_wheel_holds_every_module_and_data_file(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    wanted = {
        f"ariac_score/{p}"
        for p in _tree("ariac_score", "*.py")
        | _tree("ariac_score", "*.msg")
        | _tree("ariac_score", "*.tmpl")
        | {name for kind in ("j2", "css", "js") for name in _tree("ariac_score", f"*.{kind}")}
        | {"py.typed"}
    }
    wanted |= {f"ariac_score/rules/{p}" for p in _tree("rules", "*.yaml") | {"__init__.py"}}
    wanted |= {f"ariac_score/schemas/{p}" for p in _tree("schemas", "*.json") | _tree("schemas", "*.py")}
    wanted |= {
        name for kind in ("*.py", "*.msg", "*.json", "*.yaml", "py.typed") for name in _tree("plugins", kind)
    }
    shipped = [file for example in examples().values() for path in example.paths for file in _examples(path)]
    wanted |= {f"ariac_score/examples/{name}" for name in (*shipped, "examples.json")}

    assert wanted - names == set()
    assert {n for n in names - wanted if ".dist-info/" not in n} == set()


def test_the_wheel_scores_a_trial_from_anywhere(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    site = tmp_path / "site"
    wheel.extractall(site)
    command = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); from ariac_score.cli import main; sys.exit(main())"
    )
    isolated = "-P" if sys.version_info >= (3, 11) else "-s"

    def installed(*arguments: str) -> str:
        done = subprocess.run(  # our own command
            [sys.executable, isolated, "-c", command, str(site), *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    *_, first = installed("example").splitlines()
    scored = installed(*first.removeprefix("next: ariac-score ").split(), "--output-format", "json")

    assert '"score": 25.760398' in scored
    written = tmp_path / "examples/kitting_near_miss.mcap"
    assert written.read_bytes() == (ROOT / "examples/kitting_near_miss.mcap").read_bytes()


def test_every_entry_point_of_ours_can_be_loaded() -> None:
    ours = [
        point
        for group in GROUPS
        for point in entry_points(group=group)
        if point.dist and point.dist.name == "ariac-score"
    ]

    assert len(ours) >= 20
    for point in ours:
        assert point.load().__doc__, point.name


def test_shipped_data_is_found_where_the_package_is_installed() -> None:
    assert {"paper2020", "ariac2022.as_coded"} <= set(rule_set_names())
    assert {"ariac2020", "ariac2022", "ariac2023"} <= set(log_map_names())


@pytest.mark.slow
def test_the_same_checkout_gives_the_same_wheel(tmp_path: Path) -> None:
    files = subprocess.run(
        ["git", "ls-files"],  # noqa: S607  # as above
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.splitlines()
    if not files:
        pytest.skip("not a git checkout, so which files belong to it is not known")
    hashes = []
    for number, names in enumerate((files, files[::-1])):  # made in another order, at another time
        copy, out = tmp_path / f"checkout_{number}", tmp_path / f"wheel_{number}"
        out.mkdir()
        for name in names:
            if (ROOT / name).is_file():
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                (copy / name).write_bytes((ROOT / name).read_bytes())
                os.utime(copy / name, (10**9 + number, 10**9 + number))
        environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "PYTHONHASHSEED": str(number)}
        command = [sys.executable, "-c", _BUILD, str(out)]
        subprocess.run(command, cwd=copy, check=True, capture_output=True, env=environment)  # our own command
        (path,) = out.glob("*.whl")
        hashes.append(hashlib.sha256(path.read_bytes()).hexdigest())

    assert hashes[0] == hashes[1]


def test_the_wheel_has_the_code_that_results_name(wheel: zipfile.ZipFile) -> None:
    assert wheel.filename
    found = packages_of_wheel(Path(wheel.filename).read_bytes())

    ours = {name for name in found if (ROOT / name).is_dir() or (ROOT / "plugins" / name).is_dir()}
    assert {"ariac_score", "ariac_score_ariac", "ariac_score_rml"} <= ours
    assert {name: found[name] for name in ours} == {name: package_sha256(name) for name in ours}
