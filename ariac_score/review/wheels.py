"""Whether the code that a result names is that of a wheel, which is then known by its hash."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from ariac_score.checks.local import GIVEN_DISTRIBUTION
from ariac_score.checks.registry import LOCAL_DISTRIBUTION, code_sha256, is_code
from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import UsageError
from ariac_score.results.result import Code
from ariac_score.review.steps import FAILED, OK, Step

__all__ = ["check_wheels", "packages_of_wheel"]

_OF_NO_WHEEL = (LOCAL_DISTRIBUTION, GIVEN_DISTRIBUTION)
LARGEST_WHEEL_BYTES = 256 << 20
LARGEST_CODE_BYTES = 256 << 20
"""What all Python files of a wheel may have, unpacked."""


def packages_of_wheel(content: bytes) -> dict[str, str]:
    """The hash of each import package of a wheel, as results name them; see `package_sha256`.

    Args:
        content: The bytes of the wheel.

    Raises:
        ValueError: It is no wheel, or unpacks to too much.
    """
    files: dict[str, list[tuple[PurePosixPath, bytes]]] = {}
    left = LARGEST_CODE_BYTES
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as wheel:
            if not any(name.endswith(".dist-info/RECORD") for name in wheel.namelist()):
                raise ValueError("it has no RECORD")
            for member in wheel.infolist():
                package, _, name = member.filename.partition("/")
                if not is_code(name or package):
                    continue
                with wheel.open(member) as opened:
                    code = opened.read(left + 1)
                left -= len(code)
                if left < 0:
                    raise ValueError(f"its code has more than {LARGEST_CODE_BYTES >> 20} MiB")
                # A module that is no package has its file alone.
                key = package if name else package.removesuffix(".py")
                files.setdefault(key, []).append((PurePosixPath(name or package), code))
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, OSError, EOFError) as cause:
        raise ValueError(str(cause)) from cause
    return {
        package: code_sha256((path.as_posix(), code) for path, code in sorted(found))
        for package, found in files.items()
    }


def check_wheels(code: Sequence[Code], wheels: Sequence[Path]) -> Iterator[Step]:
    """A step for each wheel, and one for code that is in none.

    Raises:
        UsageError: A file cannot be read, or is no wheel.
    """
    # A file beside a rule set, or a class of a notebook, has a hash of its own, and no wheel.
    named = {one.package: one for one in code if one.distribution not in _OF_NO_WHEEL}
    found: set[str] = set()
    for wheel in wheels:
        try:
            content = read_plain(wheel, LARGEST_WHEEL_BYTES)
            packages = packages_of_wheel(content)
        except OSError as cause:
            raise UsageError(
                f"cannot be read: {cause.strerror}", file=wheel, hint="name the file of a wheel"
            ) from cause
        except ValueError as cause:
            raise UsageError(
                f"it is no wheel: {cause}", file=wheel, hint="name a file NAME-VERSION-….whl"
            ) from cause
        known = f"{wheel.name} (SHA-256 {hashlib.sha256(content).hexdigest()})"
        ours = sorted(packages.keys() & named.keys())
        others = [name for name in ours if packages[name] != named[name].sha256]
        found.update(ours)
        if others:
            yield Step("wheel", FAILED, f"{known} has another code of {', '.join(others)}")
        elif ours:
            yield Step("wheel", OK, f"{known} has the code of {', '.join(ours)}")
        else:
            yield Step("wheel", FAILED, f"{known} has none of the code that made it")
    if missing := sorted(named.keys() - found):
        yield Step("wheel", FAILED, f"{', '.join(missing)}: in none of the wheels; name theirs too")
