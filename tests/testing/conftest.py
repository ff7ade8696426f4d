"""A fresh environment to install strangers' distributions into, without network."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from dataclasses import dataclass
from pathlib import Path

import pytest

COMMAND = """#!{python}
import sys
from ariac_score.cli import program
program()
"""


@dataclass(frozen=True)
class Environment:
    """A virtual environment of its own, which sees the packages of the one that runs the tests."""

    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin/python"

    def run(self, command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
        """Run a command of a shell as somebody would who activated the environment."""
        settings = {
            "PATH": f"{self.folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
            "VIRTUAL_ENV": str(self.folder),
            "PIP_NO_INDEX": "1",
            "PIP_NO_BUILD_ISOLATION": "0",  # to pip this 0 means: do not isolate
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "NO_COLOR": "1",
        }
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "PIP_"))}
        return subprocess.run(
            ["bash", "-c", command],  # noqa: S607  # the shell of the documentation
            cwd=cwd,
            env={**kept, **settings},
            capture_output=True,
            text=True,
            check=False,
        )


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    folder = tmp_path_factory.mktemp("fresh") / "venv"
    venv.create(folder, with_pip=True)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    packages = folder / f"lib/{version}/site-packages"
    # Up to Python 3.11 it comes with a setuptools of its own, too old to build with.
    for old in [*packages.glob("setuptools*"), packages / "_distutils_hack", packages / "pkg_resources"]:
        shutil.rmtree(old, ignore_errors=True)
    (packages / "distutils-precedence.pth").unlink(missing_ok=True)
    site = sysconfig.get_path("purelib")
    # As a site folder, not on PYTHONPATH, so that an editable install of ours is seen too.
    line = f"import site; site.addsitedir({site!r})\n"
    (packages / "tests.pth").write_text(line, encoding="utf-8")
    script = folder / "bin/ariac-score"
    script.write_text(COMMAND.format(python=folder / "bin/python"), encoding="utf-8")
    script.chmod(0o755)
    return Environment(folder)
