"""What stands in for the workers of platforms: a clean Python with the wheel alone, and Codabench's steps.

Source: notes on Codabench (commit c7dbc75), section 2.1. The container is a folder here: `/app` in the
command is replaced by it, and `python3` is the Python that has the wheel.
"""

from __future__ import annotations

import decimal
import json
import shutil
import subprocess
import sys
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import yaml

__all__ = ["Image", "Judged", "image_with", "judge"]

_MOST_DIGITS, _DECIMALS = 20, 10


@dataclass(frozen=True)
class Image:
    """A Python environment that has the wheel and what it needs, and nothing of the checkout.

    Attributes:
        programs: Its folder of programs.
    """

    programs: Path

    @property
    def python(self) -> str:
        """The interpreter."""
        return str(self.programs / "python3")

    def environment(self, **more: str) -> dict[str, str]:
        """All that a container of the platform has, and no more: not even a home."""
        proxies = {"http_proxy": "", "https_proxy": ""}
        return {"PATH": f"{self.programs}:/usr/bin:/bin", "PYTHONUNBUFFERED": "1", **proxies, **more}


def image_with(wheel: Path, folder: Path) -> Image:
    """Make such an environment. Libraries are those of the running Python, found behind the wheel."""
    venv.create(folder, with_pip=False)
    (site,) = folder.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as unpacked:
        unpacked.extractall(site)
    # Lines of such a file add folders, and no file of this kind in these is followed: no editable install.
    libraries = [path for path in sys.path if path.endswith(("site-packages", "dist-packages"))]
    (site / "libraries.pth").write_text("\n".join(libraries), encoding="utf-8")
    (folder / "bin/ariac-score").write_text(
        f"#!{folder}/bin/python3\nimport sys\nfrom ariac_score.cli import program\n"
        "if __name__ == '__main__':\n    sys.exit(program())\n"  # as pip writes it
    )
    (folder / "bin/ariac-score").chmod(0o755)
    return Image(folder / "bin")


@dataclass(frozen=True)
class Judged:
    """What the platform keeps of a submission.

    Attributes:
        status: `Finished` or `Failed`.
        columns: What the leaderboard has, for the columns that the competition declares.
        output: The folder that is offered as a download; with status `Failed` the page alone survives.
        said: What the program printed.
    """

    status: str
    columns: dict[str, decimal.Decimal]
    output: Path
    said: str


def judge(bundle: Path, submission: Path, folder: Path, image: Image) -> Judged:
    """Unpack a bundle, run its program on a submission, and store what it says, as the platform does."""
    app = folder / "app"
    with zipfile.ZipFile(bundle) as files:
        files.extractall(folder / "bundle")
    competition = yaml.safe_load((folder / "bundle/competition.yaml").read_text(encoding="utf-8"))
    (task,) = competition["tasks"]
    for name, place in ((task["scoring_program"], "program"), (task["reference_data"], "input/ref")):
        with zipfile.ZipFile(folder / "bundle" / name) as files:
            files.extractall(app / place)
    _predict(submission, app, folder / "submission")
    (app / "output").mkdir()
    command = yaml.safe_load((app / "program/metadata.yaml").read_text(encoding="utf-8"))["command"]
    limit_s = min(competition["phases"][0]["execution_time_limit"], 600)
    ended = subprocess.run(
        [
            image.python if word == "python3" else word.replace("/app", str(app), 1)
            for word in command.split()
        ],
        cwd=app / "program",
        env=image.environment(),
        capture_output=True,
        text=True,
        timeout=limit_s,
        check=False,
    )
    said = ended.stdout + ended.stderr
    if (app / "output/metadata").exists() or ended.returncode:
        return Judged("Failed", {}, app / "output", said)
    (app / "output/metadata").write_text("exitCode: 0\n", encoding="utf-8")
    scores = json.loads((app / "output/scores.json").read_text(encoding="utf-8"))
    keys = {column["key"] for column in competition["leaderboards"][0]["columns"]}
    return Judged(
        "Finished", {key: _stored(scores[key]) for key in scores if key in keys}, app / "output", said
    )


def _predict(submission: Path, app: Path, unpacked: Path) -> None:
    """The first step: what has `metadata` at its root is run as a program, all else is a result."""
    with zipfile.ZipFile(submission) as files:
        files.extractall(unpacked)  # links become files with the name of their target; no limit of size
    result = app / "input/res"
    result.mkdir(parents=True)
    if not any((unpacked / name).exists() for name in ("metadata.yaml", "metadata")):
        shutil.copytree(unpacked, result, dirs_exist_ok=True)
    (result / "metadata").write_text("exitCode: 0\nelapsedTime: 0.1\n", encoding="utf-8")


def _stored(value: object) -> decimal.Decimal:
    """A column of the database: 20 digits, 10 of them behind the point; raises for what it cannot hold."""
    number = decimal.Decimal(str(value))
    whole = decimal.Decimal(10) ** (_MOST_DIGITS - _DECIMALS)
    if isinstance(value, bool) or not number.is_finite() or abs(number) >= whole:
        raise ValueError(f"{value!r} cannot be stored")
    return number.quantize(decimal.Decimal(1).scaleb(-_DECIMALS))
