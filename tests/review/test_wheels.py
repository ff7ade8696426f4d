"""Which wheel made a result: the hash of the code in it is the one that the result names."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from ariac_score.checks.registry import package_sha256
from ariac_score.errors import UsageError
from ariac_score.results.result import Code
from ariac_score.review import wheels
from ariac_score.review.wheels import check_wheels, packages_of_wheel

ROOT = Path(__file__).parents[2]
OF_RML = {
    f"ariac_score_rml/{path.relative_to(ROOT / 'plugins/ariac_score_rml').as_posix()}": path.read_bytes()
    for path in (ROOT / "plugins/ariac_score_rml").rglob("*.py")
}


def wheel(files: Mapping[str, bytes], *, record: bool = True) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as written:
        for name, content in reversed(list(files.items())):  # in another order than that of the hash
            written.writestr(name, content)
        if record:
            written.writestr("x-1.dist-info/RECORD", "")
    return out.getvalue()


def test_the_code_of_a_wheel_has_the_hash_of_the_installed_package() -> None:
    data = {"ariac_score_rml/grammar.txt": b"no code", "single.py": b"pass\r\n"}

    found = packages_of_wheel(wheel(OF_RML | data))

    assert found["ariac_score_rml"] == package_sha256("ariac_score_rml")
    assert found["single"] == hashlib.sha256(b"single.py\0005\0pass\n").hexdigest()


def steps(file: Path, *more: Code) -> list[tuple[str, str]]:
    stated = Code("ariac-score", "1", "ariac_score_rml", package_sha256("ariac_score_rml"))
    return [(step.outcome, step.words) for step in check_wheels([stated, *more], [file])]


def test_a_wheel_that_has_the_code_is_named_with_its_hash(tmp_path: Path) -> None:
    file = tmp_path / "x-1-py3-none-any.whl"
    file.write_bytes(wheel(OF_RML))
    known = f"x-1-py3-none-any.whl (SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()})"

    assert steps(file) == [("ok", f"{known} has the code of ariac_score_rml")]
    assert steps(file, Code("theirs", "2", "theirs", "0" * 64))[1:] == [
        ("failed", "theirs: in none of the wheels; name theirs too")
    ]
    beside = Code("local file", "0", "ours.py", "0" * 64)  # has no wheel
    assert steps(file, beside) == steps(file)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (OF_RML | {"ariac_score_rml/more.py": b""}, "has another code of ariac_score_rml"),
        (dict(list(OF_RML.items())[1:]), "has another code of ariac_score_rml"),
        ({"other.py": b""}, "has none of the code that made it"),
    ],
)
def test_a_wheel_with_other_code_fails(files: dict[str, bytes], words: str, tmp_path: Path) -> None:
    file = tmp_path / "x-1-py3-none-any.whl"
    file.write_bytes(wheel(files))
    assert steps(file)[0][0] == "failed"
    assert steps(file)[0][1].endswith(words)


@pytest.mark.parametrize("content", [b"", b"PK\3\4", wheel(OF_RML, record=False), wheel(OF_RML)[:-30]])
def test_what_is_no_wheel_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.whl").write_bytes(content)
    with pytest.raises(UsageError, match="it is no wheel"):
        list(check_wheels([], [tmp_path / "x.whl"]))


def test_a_bomb_is_read_up_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    content = wheel({"a/b.py": b"#" * 1000})
    monkeypatch.setattr(wheels, "LARGEST_CODE_BYTES", 1000)
    assert packages_of_wheel(content)
    monkeypatch.setattr(wheels, "LARGEST_CODE_BYTES", 999)
    with pytest.raises(ValueError, match="its code has more than"):
        packages_of_wheel(content)
