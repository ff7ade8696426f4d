"""`ariac-score example [NAME]`: write an example to try things on, from the installed package."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score.errors import UsageError

PACKAGE = Path(__file__).resolve().parents[1]
FOLDER = "examples"


@dataclass(frozen=True)
class Example:
    """An example that the package brings.

    Attributes:
        about: What it is.
        paths: Its files and folders, relative to the folder of all examples.
        first: A command to begin with.
        log: The honest trial in it, relative as well; empty where it has none.
        log_maps: Those that read it.
    """

    about: str
    paths: tuple[str, ...]
    first: str
    log: str = ""
    log_maps: tuple[str, ...] = ()


def example_log(log_map: str) -> Path | None:
    """The honest trial among the examples that a log map reads; `None` where there is none."""
    for example in examples().values():
        if example.log and log_map in example.log_maps:
            return source() / example.log
    return None


def examples() -> dict[str, Example]:
    """The examples by name, as their folder describes them."""
    described = json.loads((source() / "examples.json").read_text(encoding="utf-8"))
    lists = {"paths": (), "log_maps": ()}
    return {
        name: Example(**{**e, **{key: tuple(e.get(key, none)) for key, none in lists.items()}})
        for name, e in described.items()
    }


def register(commands: Any) -> None:
    """Add the command."""
    known = examples()
    about = "; ".join(f"{name}: {example.about}" for name, example in known.items())
    parser = commands.add_parser(
        "example",
        description="Write an example into the folder 'examples', where the documentation has it, and print "
        f"a command to begin with. {about}.",
    )
    parser.add_argument(
        "name", nargs="?", default="trial", choices=tuple(known), metavar="NAME", help="default: trial"
    )
    parser.add_argument(
        "--into", type=Path, default=Path(), metavar="DIR", help="where to write; default: the current folder"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the files that are missing, and print what to do next.

    Raises:
        UsageError: Another file is in the place of one of them, or nothing can be written there.
    """
    example, root = examples()[arguments.name], source()
    files = [file for path in example.paths for file in _files_of(root / path)]
    target = arguments.into / FOLDER
    wanted = {target / file.relative_to(root): file.read_bytes() for file in files}
    _refuse_others(wanted)
    try:
        for place, content in wanted.items():
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
    except OSError as cause:
        raise UsageError(
            f"the example cannot be written: {cause.strerror}", file=target, hint="name a folder with --into"
        ) from cause
    for path in example.paths:
        print((target / path).as_posix())
    before = f"cd {arguments.into.as_posix()} && " if arguments.into != Path() else ""
    print(f"\nnext: {before}{example.first}")
    return 0


def source() -> Path:
    """The examples: in the package where it was installed from a wheel, else beside it in a checkout."""
    installed = PACKAGE / FOLDER
    return installed if installed.is_dir() else PACKAGE.parent / FOLDER


def _files_of(path: Path) -> list[Path]:
    """A file, or all files of a folder but those that a command made there."""
    if path.is_file():
        return [path]
    made = {"logs", "__pycache__"} if path.name == "motion" else {"__pycache__"}
    return sorted(
        file for file in path.rglob("*") if file.is_file() and not made & set(file.relative_to(path).parts)
    )


def _refuse_others(wanted: dict[Path, bytes]) -> None:
    """Keep what somebody else wrote; what is there already with the same bytes is no obstacle."""
    for place, content in wanted.items():
        if place.is_symlink() or (place.exists() and not (place.is_file() and _has(place, content))):
            raise UsageError(
                "something else has this name",
                file=place,
                hint="nothing was written; move it away, or name another folder with --into",
            )


def _has(place: Path, content: bytes) -> bool:
    return place.stat().st_size == len(content) and place.read_bytes() == content
