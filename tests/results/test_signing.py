"""Signatures of results, in the format of minisign."""

from __future__ import annotations

import base64
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from minisign import PublicKey

from ariac_score import score_trial
from ariac_score.cli import main
from ariac_score.errors import ResultError, UsageError
from ariac_score.results.result_file import as_json
from ariac_score.results.signing import (
    _key_id,
    check_signature,
    make_keys,
    sign_result,
    signature_file,
    verify_signature,
)
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ALGORITHM, HASHED = b"Ed", b"ED"  # the page of minisign, "signature format"

# The key that minisign itself is signed with: as its README gives it, and as its key file names it.
MINISIGN_KEY = "RWQf6LRCGA9i53mlYecO4IzT51TGPpvWucNSCh1CBM0QTaLn73Y7GFO3"
MINISIGN_KEY_ID = "E7620F1842B4E81F"


@pytest.fixture(scope="module")
def result_text(tmp_path_factory: pytest.TempPathFactory) -> str:
    log = write_trial_log(
        tmp_path_factory.mktemp("log") / "t.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS
    )
    return as_json(score_trial(log, "paper2020.published"))


@pytest.fixture
def result(tmp_path: Path, result_text: str) -> Path:
    file = tmp_path / "team_a.json"
    file.write_text(result_text, encoding="utf-8")
    return file


@pytest.fixture
def keys(tmp_path: Path) -> tuple[Path, Path]:
    return make_keys(tmp_path / "organiser.key")


def signed(result: Path, key: Path) -> Path:
    file = signature_file(result)
    file.write_bytes(sign_result(result, key))
    return file


def test_a_signed_result_is_verified_with_what_the_signer_said(result: Path, keys: tuple[Path, Path]) -> None:
    secret, public = keys
    signed(result, secret)

    found = verify_signature(result, str(public))

    assert found.comment == "file:team_a.json"
    assert verify_signature(result, public.read_text().splitlines()[1]) == found  # as minisign -P takes it
    assert found.key_id in public.read_text()  # minisign names the key by it


def test_a_key_has_the_id_that_minisign_gives_it() -> None:
    assert _key_id(PublicKey.from_base64(MINISIGN_KEY)) == MINISIGN_KEY_ID


def test_the_id_of_a_key_has_no_leading_zero_as_minisign_prints_none() -> None:
    # Made by `minisign -G`, whose comment in the file of the key is "minisign public key C6633217BD76783".
    key = "RWSDZ9d7ITNmDA9bi+4LYO39zJvj/worPXmYr9U2mjXy1ssCaeqt6em9"

    assert _key_id(PublicKey.from_base64(key)) == "C6633217BD76783"


def test_the_layout_is_that_of_minisign(result: Path, keys: tuple[Path, Path]) -> None:
    untrusted, signature, trusted, whole = sign_result(result, keys[0]).decode().splitlines()
    public = base64.b64decode(keys[1].read_text().splitlines()[1])

    assert untrusted.startswith("untrusted comment: ")
    assert trusted == "trusted comment: file:team_a.json"
    raw = base64.b64decode(signature)
    assert (len(raw), raw[:2], raw[2:10]) == (2 + 8 + 64, HASHED, public[2:10])
    assert (len(public), public[:2]) == (2 + 8 + 32, ALGORITHM)
    assert len(base64.b64decode(whole)) == 64


def test_the_same_result_and_key_give_the_same_bytes_and_the_result_stays(
    result: Path, result_text: str, keys: tuple[Path, Path]
) -> None:
    assert sign_result(result, keys[0]) == sign_result(result, keys[0])
    assert result.read_text(encoding="utf-8") == result_text


def test_nothing_of_a_key_is_in_what_is_written(result: Path, keys: tuple[Path, Path]) -> None:
    signature = signed(result, keys[0])
    raw = base64.b64decode(keys[0].read_text().splitlines()[1])
    secret = raw[-32 - 64 : -32 - 32]  # key number, secret key, public key, checksum
    for file in (result, signature, keys[1]):
        content = file.read_bytes()
        assert keys[0].read_text().splitlines()[1].encode() not in content
        for word in content.split():
            assert secret not in word
            try:
                assert secret not in base64.b64decode(word, validate=True)
            except ValueError:
                continue


def _edited(result: Path) -> None:
    text = result.read_text(encoding="utf-8")
    result.write_text(text.replace('"score": 19.761677', '"score": 99.761677'), encoding="utf-8")
    assert result.read_text(encoding="utf-8") != text


def _one_space(result: Path) -> None:
    result.write_bytes(result.read_bytes() + b" ")


def _line(number: int, change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def apply(result: Path) -> None:
        file = signature_file(result)
        lines = file.read_bytes().splitlines()
        lines[number] = change(lines[number])
        file.write_bytes(b"\n".join(lines) + b"\n")

    return apply


def _kept(share: float) -> Callable[[Path], None]:
    def cut(result: Path) -> None:
        file = signature_file(result)
        raw = file.read_bytes()
        file.write_bytes(raw[: int(len(raw) * share)])

    return cut


def _flipped(line: bytes) -> bytes:
    raw = bytearray(base64.b64decode(line))
    raw[-1] ^= 1
    return base64.b64encode(bytes(raw))


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "the score is edited": (_edited, "the signature is not of these bytes"),
    "a space is added": (_one_space, "the signature is not of these bytes"),
    "the comment is edited": (_line(2, lambda line: line + b"!"), "the signature is not of these bytes"),
    "a bit of the signature": (_line(1, _flipped), "the signature is not of these bytes"),
    "a bit of the signature of the comment": (_line(3, _flipped), "the signature is not of these bytes"),
    "the signature is cut": (_kept(0.5), "not a whole signature"),
    "the signature is empty": (_kept(0.0), "not a whole signature"),
    "the signature is another text": (_line(1, lambda _: b"hello"), "not a whole signature"),
    "the signature is gone": (lambda result: signature_file(result).unlink(), "it is not signed"),
    "the signature is huge": (_line(0, lambda line: line + b"x" * 20_000), "too large for a signature"),
}


@pytest.mark.parametrize("how", BROKEN)
def test_what_is_not_vouched_for_is_refused(how: str, result: Path, keys: tuple[Path, Path]) -> None:
    signed(result, keys[0])
    change, cause = BROKEN[how]
    change(result)

    with pytest.raises(ResultError, match=cause) as caught:
        verify_signature(result, str(keys[1]))

    assert caught.value.hint
    holds, words = check_signature(result, str(keys[1]))
    assert not holds
    assert cause in words


def test_every_cut_of_a_signature_is_refused(result: Path, keys: tuple[Path, Path]) -> None:
    file = signed(result, keys[0])
    whole = file.read_bytes()
    for size in range(len(whole) - 1):  # without its last line end it is whole
        file.write_bytes(whole[:size])
        with pytest.raises(ResultError):
            verify_signature(result, str(keys[1]))


def test_another_key_is_told_apart(result: Path, keys: tuple[Path, Path], tmp_path: Path) -> None:
    _, other = make_keys(tmp_path / "other.key")
    signed(result, keys[0])

    with pytest.raises(ResultError, match="another key signed it"):
        verify_signature(result, str(other))


def test_what_is_not_whole_is_not_signed(result: Path, keys: tuple[Path, Path]) -> None:
    _edited(result)

    with pytest.raises(ResultError):
        sign_result(result, keys[0])


@pytest.mark.skipif(sys.platform == "win32", reason="rights are those of POSIX")
@pytest.mark.parametrize(("mode", "refused"), [(0o600, False), (0o400, False), (0o640, True), (0o604, True)])
def test_a_secret_key_that_others_may_read_is_refused(
    result: Path, keys: tuple[Path, Path], mode: int, refused: bool
) -> None:
    assert keys[0].stat().st_mode & 0o777 == 0o600  # as it was made
    keys[0].chmod(mode)
    if refused:
        with pytest.raises(UsageError, match=f"its rights are 0{mode:o}"):
            sign_result(result, keys[0])
    else:
        assert sign_result(result, keys[0])


def test_a_key_with_a_password_asks_for_it(result: Path, tmp_path: Path) -> None:
    secret, public = make_keys(tmp_path / "locked.key", "right")

    signature_file(result).write_bytes(sign_result(result, secret, password=lambda: "right"))

    assert verify_signature(result, str(public)).comment
    with pytest.raises(UsageError, match="wrong password"):
        sign_result(result, secret, password=lambda: "wrong")


@pytest.mark.parametrize("text", [b"", b"hello\n", b"untrusted comment: x\nAAAA\n", b"\xff\xfe\n" * 2])
def test_what_is_no_key_is_refused_without_being_shown(result: Path, tmp_path: Path, text: bytes) -> None:
    key = tmp_path / "no.key"
    key.write_bytes(text)
    key.chmod(0o600)

    with pytest.raises(UsageError, match="not a secret key"):
        sign_result(result, key)
    with pytest.raises(UsageError, match="not a public key"):
        verify_signature(result, str(key))


def test_a_key_is_never_written_over(tmp_path: Path) -> None:
    secret, public = make_keys(tmp_path / "a.key")
    before = secret.read_bytes()
    with pytest.raises(UsageError, match="the file exists"):
        make_keys(secret)
    secret.unlink()
    with pytest.raises(UsageError, match="the file exists"):
        make_keys(secret)
    assert public.is_file()
    assert before


@pytest.mark.parametrize("comment", ["two\nlines", "größe", "x" * 1001])
def test_a_comment_that_does_not_fit_is_refused(result: Path, keys: tuple[Path, Path], comment: str) -> None:
    with pytest.raises(UsageError, match="a comment has at most 1000"):
        sign_result(result, keys[0], comment=comment)
    assert sign_result(result, keys[0], comment="x" * 1000)


def test_the_command_signs_several_or_none(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key, broken = tmp_path / "k.key", tmp_path / "broken.json"
    broken.write_text("{}")

    assert main(["sign", "--new-key", str(key)]) == 0
    assert main(["sign", str(result), str(broken), "--key", str(key)]) == 6
    assert not signature_file(result).exists()
    assert main(["sign", str(result), "--key", str(key), "--comment", "final of the season"]) == 0

    assert str(signature_file(result)) in capsys.readouterr().out
    assert verify_signature(result, f"{key}.pub").comment == "final of the season"


@pytest.mark.parametrize("arguments", [[], ["r.json"], ["--new-key", "k", "r.json"]])
def test_a_senseless_call_is_a_usage_error(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sign", *arguments]) == 4
    assert "hint:" in capsys.readouterr().err


def test_without_its_library_it_says_what_to_install(
    result: Path, keys: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "minisign", None)
    with pytest.raises(UsageError, match="py-minisign") as caught:
        sign_result(result, keys[0])
    assert "ariac-score[sign]" in caught.value.hint


def test_verify_says_who_vouches_for_a_result(
    result: Path, keys: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["verify", str(result), "--signature", "--public-key", str(keys[1])]
    signed(result, keys[0])

    assert main(call) == 8  # whose it is, not whether it is true
    assert "file:team_a.json" in capsys.readouterr().out

    _one_space(result)
    assert main(call) == 1
    assert "the signature is not of these bytes" in capsys.readouterr().out

    assert main(call[:3]) == 4
    assert "--public-key" in capsys.readouterr().err


# The program itself ------------------------------------------------------------------------

MINISIGN = shutil.which("minisign")
needs_minisign = pytest.mark.skipif(MINISIGN is None, reason="the program minisign is not installed")


def minisign(*arguments: object) -> subprocess.CompletedProcess[str]:
    """What minisign makes of a call; it is never asked anything."""
    assert MINISIGN is not None
    return subprocess.run(
        [MINISIGN, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        input="\n\n",
        timeout=60,
    )


@needs_minisign
def test_the_program_minisign_verifies_what_we_sign(result: Path, keys: tuple[Path, Path]) -> None:
    signed(result, keys[0])

    by_file = minisign("-V", "-p", keys[1], "-m", result)
    by_key = minisign("-V", "-P", keys[1].read_text().splitlines()[1], "-m", result)

    for found in (by_file, by_key):
        assert found.returncode == 0, found.stderr
        assert "Signature and comment signature verified" in found.stdout
        assert "file:team_a.json" in found.stdout

    _one_space(result)
    assert minisign("-V", "-p", keys[1], "-m", result).returncode != 0


@needs_minisign
@pytest.mark.parametrize(
    "change", [_line(2, lambda line: line + b"!"), _line(1, _flipped), _line(3, _flipped)]
)
def test_the_program_minisign_refuses_what_we_refuse(
    result: Path, keys: tuple[Path, Path], change: Callable[[Path], None]
) -> None:
    signed(result, keys[0])
    change(result)

    assert minisign("-V", "-p", keys[1], "-m", result).returncode != 0
    assert not check_signature(result, str(keys[1]))[0]


@needs_minisign
@pytest.mark.parametrize("legacy", [False, True])
def test_we_verify_what_the_program_minisign_signs(result: Path, tmp_path: Path, legacy: bool) -> None:
    secret, public = tmp_path / "theirs.key", tmp_path / "theirs.pub"
    made = minisign("-G", "-W", "-s", secret, "-p", public)
    assert made.returncode == 0, made.stderr
    told = minisign("-S", *(["-l"] if legacy else []), "-s", secret, "-m", result, "-t", "by the program")
    assert told.returncode == 0, told.stderr

    found = verify_signature(result, str(public))

    assert found.comment == "by the program"
    assert found.key_id in public.read_text()
    _one_space(result)
    with pytest.raises(ResultError, match="the signature is not of these bytes"):
        verify_signature(result, str(public))


@needs_minisign
def test_we_sign_with_a_key_that_the_program_minisign_made(result: Path, tmp_path: Path) -> None:
    secret, public = tmp_path / "theirs.key", tmp_path / "theirs.pub"
    assert minisign("-G", "-W", "-s", secret, "-p", public).returncode == 0
    secret.chmod(0o600)

    signed(result, secret)

    assert minisign("-V", "-p", public, "-m", result).returncode == 0
