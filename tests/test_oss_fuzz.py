"""The build file for OSS-Fuzz, with a stand-in for what turns a program into one file."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "fuzz/oss-fuzz"


def test_the_project_is_described_as_the_service_asks() -> None:
    described = yaml.safe_load((BUILD / "project.yaml").read_text(encoding="utf-8"))

    assert described["language"] == "python"
    assert described["fuzzing_engines"] == ["libfuzzer"]  # the only one that atheris works with
    assert (BUILD / "Dockerfile").read_text().startswith("FROM gcr.io/oss-fuzz-base/base-builder-python\n")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_each_target_is_built_with_its_seeds_and_words(tmp_path: Path) -> None:
    programs, out, work = (tmp_path / name for name in ("bin", "out", "work"))
    for folder in (programs, out, work):
        folder.mkdir()
    (work / "fuzz").symlink_to(ROOT / "fuzz")
    (programs / "compile_python_fuzzer").write_text('#!/bin/sh\ncp "$1" "$OUT/${1%.py}"\n')
    (programs / "zip").write_text('#!/bin/sh\nshift 2\nexec python3 -m zipfile -c "$@"\n')  # not everywhere
    (programs / "pip3").write_text("#!/bin/sh\n")
    (programs / "python3").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    for program in programs.iterdir():
        program.chmod(0o755)
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "OUT": str(out)}

    subprocess.run(["bash", str(BUILD / "build.sh")], cwd=work, env=environment, check=True, timeout=280)  # noqa: S607  # the first in the path

    names = sorted(path.name for path in (ROOT / "fuzz/corpus").iterdir())
    assert sorted(path.name for path in out.iterdir() if not path.suffix) == [
        f"fuzz_{name}" for name in names
    ]
    for name in names:
        program = (out / f"fuzz_{name}").read_text(encoding="utf-8")
        compile(program, name, "exec")
        assert f'TARGETS["{name}"]' in program
        with zipfile.ZipFile(out / f"fuzz_{name}_seed_corpus.zip") as seeds:
            assert seeds.namelist()
    assert '"\\x6f\\x70\\x3d"\n' in (out / "fuzz_ros1_bag.dict").read_text()  # "op="
