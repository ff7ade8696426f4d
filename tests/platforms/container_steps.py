"""A Dockerfile without an engine: its instructions, what is sent to it, and its steps done by this machine.

The base image is this machine's own root under an overlay, with the Python of the tests where the image
has one. What is written goes into memory, in a mount namespace that ends with the process.

Source: Dockerfile reference and .dockerignore (docs.docker.com/reference/dockerfile).
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Image", "Instruction", "instructions", "is_sent", "missing", "perform", "sent", "stages"]

_PATH = "/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin"
"""Of the base image."""
_TOLD_TO_THE_BUILD = re.compile(r"(PIP_|SSL_CERT_|REQUESTS_CA_|https?_proxy|no_proxy).*", re.IGNORECASE)
_PROGRAMS = ("unshare", "mount", "chroot", "setpriv", "useradd")


@dataclass(frozen=True)
class Instruction:
    """One line of a Dockerfile, such as `RUN` and what is run."""

    name: str
    words: str


def instructions(dockerfile: Path) -> list[Instruction]:
    """All of them in order, without comments."""
    lines = dockerfile.read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    found = [line.split(maxsplit=1) for line in lines if line.strip() and not line.lstrip().startswith("#")]
    return [Instruction(name.upper(), words.strip()) for name, words in found]


def stages(found: Sequence[Instruction]) -> list[list[Instruction]]:
    """The instructions of each stage, `FROM` first."""
    starts = [place for place, one in enumerate(found) if one.name == "FROM"]
    return [list(found[a:b]) for a, b in zip(starts, [*starts[1:], len(found)], strict=True)]


# What is sent ----------------------------------------------------------------------------


def is_sent(name: str, patterns: Sequence[str]) -> bool:
    """Whether a file is part of the context: the last pattern that it or a folder above it fits decides."""
    left_out = False
    parts = name.split("/")
    above = ["/".join(parts[: end + 1]) for end in range(len(parts))]
    for pattern in patterns:
        plain = pattern.removeprefix("!").strip("/")
        if any(_expression(plain).fullmatch(one) for one in above):
            left_out = not pattern.startswith("!")
    return not left_out


def _expression(pattern: str) -> re.Pattern[str]:
    words = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*", "?": "[^/]"}
    found = re.split(r"(\*\*/|\*\*|\*|\?)", pattern)
    return re.compile("".join(words.get(part, re.escape(part)) for part in found))


def sent(root: Path) -> list[str]:
    """The names of the files below a folder that an engine would be sent, sorted."""
    lines = (root / ".dockerignore").read_text(encoding="utf-8").splitlines()
    patterns = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    return sorted(name for name in _files(root) if is_sent(name, patterns))


def _files(root: Path) -> Iterator[str]:
    for folder, folders, files in os.walk(root):
        folders[:] = [name for name in folders if name != ".git"]  # thousands, and it is tried by name
        for name in files:
            yield (Path(folder) / name).relative_to(root).as_posix()


# The steps -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Image:
    """What the last stage says of a container.

    Attributes:
        env: Its variables.
        user: Who runs the command.
        folder: Where it is run.
        command: What is run unless something else is said.
    """

    env: Mapping[str, str]
    user: str
    folder: str
    command: Sequence[str]

    @classmethod
    def of(cls, stage: Sequence[Instruction]) -> Image:
        """What a stage ends as."""
        env, folder, user, command = {"PATH": _PATH}, "/", "0", list[str]()
        for one in stage:
            if one.name == "ENV":
                env |= _variables(one.words, env)
            elif one.name == "WORKDIR":
                folder = one.words
            elif one.name == "USER":
                user = one.words
            elif one.name == "CMD":
                command = json.loads(one.words)
        return cls(env, user, folder, command)


def _variables(words: str, env: Mapping[str, str]) -> dict[str, str]:
    pairs = (word.partition("=") for word in shlex.split(words))
    return {name: re.sub(r"\$(\w+)", lambda found: env.get(found[1], ""), value) for name, _, value in pairs}


def missing() -> str:
    """Why the steps cannot be done here; empty when they can."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "an overlay over the root of the machine can be mounted by root of a Linux machine only"
    tried = subprocess.run(
        ["sh", "-c", f"command -v {' '.join(_PROGRAMS)} && {_MOUNTED.format(work='/mnt')}"],  # noqa: S607
        capture_output=True,
        text=True,
        check=False,
    )
    return f"the steps cannot be done here: {tried.stderr.strip()[-200:]}" if tried.returncode else ""


_MOUNTED = (
    "unshare --mount --net --propagation private sh -ec 'mount -t tmpfs tmpfs {work} && cd {work} && "
    "mkdir upper work root && mount -t overlay overlay -o lowerdir=/,upperdir=upper,workdir=work root'"
)


def perform(
    dockerfile: Path,
    work: Path,
    commands: Sequence[Sequence[str]],
    mounted: Mapping[str, Path],
) -> subprocess.CompletedProcess[str]:
    """Do the steps of a Dockerfile, then run commands in what comes of them.

    As `docker run --read-only --tmpfs /tmp --network none --cap-drop all --security-opt no-new-privileges`.

    Args:
        dockerfile: What it is sent lies beside it.
        work: An empty folder, for the steps alone.
        commands: Each is run by the user of the image; the first that fails ends the steps.
        mounted: Folders of this machine by their place in the container; with `:ro` behind it, read-only.
    """
    built = stages(instructions(dockerfile))
    lines = [f"mount -t tmpfs -o mode=755 tmpfs {work}", f"mkdir {work}/context", *_context(dockerfile, work)]
    names: dict[str, Path] = {}
    for number, stage in enumerate(built):
        root = work / str(number) / "root"
        names[_name(stage, number)] = root
        lines += [*_base(root), *_built(stage, root, work / "context", names)]
    lines += _run(root, Image.of(built[-1]), commands, mounted)
    script = "\n".join(["set -e", *lines, ""])
    return subprocess.run(
        ["unshare", "--mount", "--propagation", "private", "sh", "-c", script],  # noqa: S607
        capture_output=True,
        text=True,
        check=False,
    )


def _name(stage: Sequence[Instruction], number: int) -> str:
    _, _, name = stage[0].words.partition(" AS ")
    return name.strip() or str(number)


def _context(dockerfile: Path, work: Path) -> Iterator[str]:
    root = dockerfile.parent
    listed = work.with_suffix(".context")
    listed.write_text("\0".join(sent(root)), encoding="utf-8")
    yield f"tar -C {_quoted(root)} --null -T {_quoted(listed)} -cf - | tar -C {work}/context -xf -"


def _base(root: Path) -> Iterator[str]:
    """This machine as a base image: its own files, and its Python where that of the image is."""
    python = Path(sys.base_prefix).resolve() / "bin" / f"python3.{sys.version_info.minor}"
    above = root.parent
    yield f"mkdir -p {above}/upper {above}/work {root}"
    yield f"mount -t overlay overlay -o lowerdir=/,upperdir={above}/upper,workdir={above}/work {root}"
    yield f"mount --rbind /dev {root}/dev"
    yield f"mount -t proc proc {root}/proc"
    yield f"mkdir -p {root}/usr/local/bin"
    for name in ("python", "python3"):  # no links: by the place of a link Python looks for its library
        place = f"{root}/usr/local/bin/{name}"
        yield f"rm -f {place}"
        yield f"printf '#!/bin/sh\\nexec {python} \"$@\"\\n' > {place}"
        yield f"chmod 755 {place}"
    for folder in python.parents:  # root's own folder is nobody else's
        yield f"chmod o+rx {root}{folder}"


def _built(
    stage: Sequence[Instruction], root: Path, context: Path, names: Mapping[str, Path]
) -> Iterator[str]:
    env, folder = {"PATH": _PATH, "HOME": "/root"}, "/"
    env |= {name: value for name, value in os.environ.items() if _TOLD_TO_THE_BUILD.fullmatch(name)}
    for one in stage[1:]:
        if one.name == "WORKDIR":
            folder = one.words
            yield f"mkdir -p {root}{folder}"
        elif one.name == "ENV":
            env |= _variables(one.words, env)
        elif one.name == "COPY":
            yield _copied(one.words, root, folder, context, names)
        elif one.name == "RUN":
            inside = f"cd {folder} && {one.words}"
            yield f"chroot {root} {_environment(env)} sh -c {_quoted(inside)}"
        elif one.name not in ("USER", "CMD"):
            raise NotImplementedError(f"{one.name} {one.words}")


def _copied(words: str, root: Path, folder: str, context: Path, names: Mapping[str, Path]) -> str:
    *options, source, into = words.split()
    known = {option.partition("=")[0]: option.partition("=")[2] for option in options}
    below = names[known.pop("--from")] if "--from" in known else context
    if known:
        raise NotImplementedError(f"COPY {words}")
    place = f"{root}{into}" if into.startswith("/") else f"{root}{folder}/{into}"
    return f"mkdir -p {place} && cp -a {below}/{source.strip('/')}/. {place}/"


def _run(
    root: Path, image: Image, commands: Sequence[Sequence[str]], mounted: Mapping[str, Path]
) -> Iterator[str]:
    for place in mounted:
        yield f"mkdir -p {root}{place.removesuffix(':ro')}"
    user, _, group = image.user.partition(":")
    yield f"group={group or f'$(chroot {root} id -g {user})'}"
    yield f"mount -o remount,ro {root}"
    yield f"mount -t tmpfs -o mode=1777 tmpfs {root}/tmp"  # noqa: S108  # of the container
    for place, here in mounted.items():
        there = f"{root}{place.removesuffix(':ro')}"
        yield f"mount --bind {_quoted(here)} {there}"
        yield f"mount -o remount,bind,{'ro' if place.endswith(':ro') else 'rw'} {there}"
    bound = f"setpriv --reuid {user} --regid $group --clear-groups --no-new-privs"
    bound += " --bounding-set=-all --inh-caps=-all"
    for command in commands:
        inside = _quoted(f"cd {image.folder} && exec {shlex.join(command)}")
        yield f"unshare --net chroot {root} {bound} {_environment(image.env)} sh -c {inside}"


def _environment(env: Mapping[str, str]) -> str:
    return "env -i " + " ".join(_quoted(f"{name}={value}") for name, value in sorted(env.items()))


def _quoted(text: str | Path) -> str:
    return shlex.quote(str(text))
