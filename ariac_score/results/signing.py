"""Signed results: who vouches for the bytes of a file, in the format of minisign.

A result can be recomputed by anyone who has its log. A signature is for those who do not: it says
whose result it is. Keys and signatures are those of `minisign`, so that its own program verifies them
too. A signature is a file next to its result; nothing of a key is ever written into a result.

Source: https://jedisct1.github.io/minisign, version 0.12; signatures of BLAKE2b hashes.
"""

from __future__ import annotations

import base64
import os
import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import ResultError, ScoreError, UsageError
from ariac_score.results.adjustments import load_adjustments
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.result_file import load_result

__all__ = [
    "ENDING",
    "Signed",
    "check_signature",
    "keys_asked_for",
    "make_keys",
    "refuse_unsigned",
    "sign_file",
    "sign_result",
    "signature_file",
    "signed_text",
    "verify_signature",
]

ENDING = ".minisig"
_LARGEST_KEY_BYTES = 4096
_LARGEST_SIGNATURE_BYTES = 16_384
LARGEST_SIGNED_BYTES = 1 << 30
"""The tables of a batch are larger than any result."""
_MOST_COMMENT_CHARS = 1000
_FOR = "competition:"
"""How the comment begins of what is signed for one competition; the comment is signed, too."""
_PRIVATE = 0o600


@dataclass(frozen=True)
class Signed:
    """A signature that holds.

    Attributes:
        key_id: Of the key that signed, as minisign prints it: hexadecimal, without leading zeros.
        comment: The signer's comment, which is signed too.
    """

    key_id: str
    comment: str

    @property
    def competition(self) -> str:
        """For which competition it is signed, which the comment states; empty for none.

        >>> Signed("1A", "competition:cup_2026 file:kit_1.json").competition
        'cup_2026'
        """
        first = self.comment.partition(" ")[0]
        return first.removeprefix(_FOR) if first.startswith(_FOR) else ""


def signature_file(result: Path) -> Path:
    """The default path of the signature of a result.

    >>> signature_file(Path("results/team_a.json")).name
    'team_a.json.minisig'
    """
    return result.with_name(result.name + ENDING)


def make_keys(file: Path, password: str = "") -> tuple[Path, Path]:
    """Make a pair of keys: the secret one at the path, for nobody else to read; the public one next to it.

    Args:
        file: Of the secret key; the public one has `.pub` after its name.
        password: That the secret key is encrypted with; empty for none.

    Raises:
        UsageError: One of the files exists, or cannot be written.
    """
    library = _library()
    public = file.with_name(file.name + ".pub")
    for taken in (file, public):
        if taken.exists():
            raise UsageError(
                "the file exists", file=taken, hint="a key is never written over; name another file"
            )
    # Checked here for a plain message; `_write` refuses an existing file even if one appears meanwhile.
    pair = library.KeyPair.generate()
    # The library would write the id the other way round than minisign does.
    pair.public_key.untrusted_comment = f"minisign public key {_key_id(pair.public_key)}"
    words = bytes(pair.public_key) + b"\n"
    if password:
        pair.secret_key.encrypt(password)
    try:
        _write(file, bytes(pair.secret_key) + b"\n", _PRIVATE)
        _write(public, words, 0o644)
    except OSError as cause:
        raise UsageError(
            f"cannot be written: {cause.strerror}", file=file, hint="check the folder"
        ) from cause
    return file, public


def _write(file: Path, content: bytes, mode: int) -> None:
    # Created with its rights: a key made private afterwards would be readable for a moment.
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as out:
        out.write(content)


def sign_result(
    result: Path,
    key: Path,
    *,
    comment: str = "",
    competition: str = "",
    password: Callable[[], str] = str,
) -> bytes:
    """The signature of a result; the same result, key and comment give the same bytes.

    Args:
        result: As `score -o FILE.json` wrote it, checked to be whole first; or the ranking, or the stewards'
            file of decisions.
        key: The secret key.
        comment: The signer's comment; by default the name of the file. It is signed too.
        competition: The id of the competition that it is signed for, which the comment then states; one
            that names its keys takes no result that is signed for another, or for none.
        password: Called for the password of an encrypted key.

    Raises:
        ResultError: The result is not whole.
        UsageError: The key cannot be used, or others may read it.
    """
    _refuse_damaged(result)
    return sign_file(result, key, comment=comment, competition=competition, password=password)


def sign_file(
    file: Path,
    key: Path,
    *,
    comment: str = "",
    competition: str = "",
    password: Callable[[], str] = str,
) -> bytes:
    """The signature of a file whose content the caller has checked; otherwise as `sign_result`.

    Raises:
        UsageError: The key cannot be used, or others may read it.
    """
    library = _library()
    words = comment or f"file:{file.name}"
    if comment.startswith(_FOR):
        raise UsageError(f"a comment that begins with {_FOR!r} names one", hint="sign --competition ID")
    if competition and (not competition.isascii() or not competition.isprintable() or " " in competition):
        raise UsageError(f"{competition!r} is no id of a competition", hint="'id:' of competition.yaml")
    if not words.isascii() or not words.isprintable() or len(words) > _MOST_COMMENT_CHARS:
        if comment:
            raise UsageError(
                f"a comment has at most {_MOST_COMMENT_CHARS} printable ASCII characters, in one line",
                hint="shorten it, or leave it out",
            )
        words = "file: a name that is not plain"
    words = f"{_FOR}{competition} {words}" if competition else words
    secret = _secret_key(library, key)
    try:
        if secret.is_encrypted():
            secret.decrypt(password())
        signature = secret.sign(read_plain(file, LARGEST_SIGNED_BYTES), prehash=True, trusted_comment=words)
    except library.Error as cause:
        raise UsageError(f"the key cannot be used: {cause}", file=key, hint="check the password") from None
    finally:
        secret.wipe()
    return bytes(signature) + b"\n"


def _refuse_damaged(file: Path) -> None:
    """Refuse to vouch for what is not whole.

    Raises:
        ScoreError: It is not.
    """
    if file.suffix in (".yaml", ".yml"):
        load_adjustments(file)
    elif not _states_ranking(file):
        load_result(file)


def _states_ranking(file: Path) -> bool:
    try:
        head = read_plain(file, MAX_BYTES)[:64]
    except OSError:
        return False  # which `load_result` says better
    return head.replace(b" ", b"").startswith(b'{\n"schema":"ariac-score/ranking/')


def _secret_key(library: Any, key: Path) -> Any:
    raw = _key_bytes(key)
    mode = stat.S_IMODE(key.stat().st_mode)
    if os.name == "posix" and mode & 0o077:
        raise UsageError(
            f"others may read this secret key: its rights are {mode:04o}",
            file=key,
            hint="chmod 600 it; if others use this machine, make a new key",
        )
    try:
        secret = library.SecretKey.from_bytes(raw)
        secret.is_encrypted()
        return secret
    except ValueError:
        # Nothing of the cause, which might quote the key.
        raise UsageError(
            "not a secret key of minisign", file=key, hint="make one: ariac-score sign --new-key FILE"
        ) from None


def _key_bytes(key: Path) -> bytes:
    try:
        if not key.is_file():
            raise UsageError("no such key file", file=key, hint="make one: ariac-score sign --new-key FILE")
        if key.stat().st_size > _LARGEST_KEY_BYTES:
            raise UsageError("too large for a key", file=key, hint="a key of minisign has two lines")
        return read_plain(key, _LARGEST_KEY_BYTES)
    except OSError as cause:
        raise UsageError(
            f"cannot be read: {cause.strerror}", file=key, hint="check the permissions"
        ) from cause


def signed_text(text: str, signature: str, public_key: str) -> str:
    """Why a signature does not vouch for a text; empty where it does.

    Args:
        text: What should be signed, such as the manifest of a recorder.
        signature: As minisign writes it, of either kind.
        public_key: The key itself, or its file.

    Raises:
        UsageError: The public key cannot be used.
    """
    library = _library()
    public = _public_key(library, public_key)
    if not signature:
        return "it is not signed"
    try:
        public.verify(text.encode("utf-8"), library.Signature.from_bytes(signature.encode("utf-8")))
    except ValueError as cause:
        return f"its signature is none: {cause}"
    except library.VerifyError:
        return f"it is not signed with the key {_key_id(public)}"
    return ""


def verify_signature(result: Path, public_key: str, signature: Path | None = None) -> Signed:
    """Check that the owner of a key vouches for the bytes of a result.

    Args:
        result: Any file.
        public_key: The file of a public key, or the key itself, as `minisign -P` takes it.
        signature: Its file; by default next to the result.

    Raises:
        ResultError: The signature is missing or damaged, made by another key, or of other bytes.
        UsageError: The public key cannot be used.
    """
    library = _library()
    public = _public_key(library, public_key)
    file = signature or signature_file(result)
    try:
        if file.stat().st_size > _LARGEST_SIGNATURE_BYTES:
            raise ResultError("too large for a signature", file=file, hint=_SIGN_AGAIN)
        raw, signed = read_plain(file, _LARGEST_SIGNATURE_BYTES), read_plain(result, LARGEST_SIGNED_BYTES)
    except OSError as cause:
        missing = Path(cause.filename or file)
        unsigned = isinstance(cause, FileNotFoundError) and missing == file
        raise ResultError(
            f"it is not signed: there is no {file.name}" if unsigned else f"cannot be read: {cause.strerror}",
            file=result if unsigned else missing,
            hint="ask for the signature; 'ariac-score sign' makes one, and 'verify --signature FILE' takes "
            "one that lies elsewhere",
        ) from cause
    try:
        read = library.Signature.from_bytes(raw)
    except ValueError as cause:
        raise ResultError(f"not a whole signature: {cause}", file=file, hint=_SIGN_AGAIN) from None
    try:
        public.verify(signed, read)
    except library.VerifyError:
        same_key = _id_of(raw.splitlines()[1]) == _key_id(public)
        what = "the signature is not of these bytes" if same_key else "another key signed it"
        raise ResultError(
            what, file=result, hint="do not trust it: get result and signature from their source again"
        ) from None
    return Signed(_key_id(public), read.trusted_comment)


_SIGN_AGAIN = "ask for the signature again"


def _public_key(library: Any, key: str) -> Any:
    """A public key from its file, or from its text."""
    file = Path(key)
    try:
        if len(key) < 256 and file.is_file():
            return library.PublicKey.from_bytes(_key_bytes(file))
        return library.PublicKey.from_base64(key)
    except ScoreError:
        raise
    except (ValueError, OSError):
        raise UsageError(
            "not a public key of minisign: neither such a file nor the key itself",
            file=key[:80],
            hint="name the file that ends in .pub",
        ) from None


def _key_id(public: Any) -> str:
    return _id_of(public.to_base64())


def _id_of(encoded: bytes) -> str:
    """The id of a key, from the base64 line of the key itself or of a signature made by it."""
    # Two bytes of algorithm, eight of the id, which minisign prints as a little-endian number, so without
    # leading zeros: one key in sixteen has fewer than 16 digits.
    return f"{int.from_bytes(base64.b64decode(encoded)[2:10], 'little'):X}"


def check_signature(
    result: Path,
    public_key: str | Sequence[str],
    signature: Path | None = None,
    *,
    competition: str = "",
) -> tuple[bool, str]:
    """Whether a result is signed by the owner of a key, or of one of several, and in words what was found.

    Where a competition is given, it must be signed for that one.

    Raises:
        UsageError: A public key cannot be used.
    """
    try:
        signed = refuse_unsigned(
            result,
            [public_key] if isinstance(public_key, str) else public_key,
            signature,
            competition=competition,
        )
    except ResultError as error:
        return False, str(error)
    return True, "" if signed is None else f"by key {signed.key_id}: {signed.comment}"


def keys_asked_for(configured: Sequence[str], given: str) -> tuple[str, ...]:
    """The keys one of which must have signed: those that are configured, of which the given one may be one.

    Args:
        configured: As the competition, or its rules, name them; text, for a file could be replaced.
        given: What the command line or a setting says: a key or its file; empty for nothing.

    Raises:
        UsageError: The given one is not among those that are configured, or is none.
    """
    if not given:
        return tuple(configured)
    key = _public_key(_library(), given).to_base64().decode("ascii")
    if configured and key not in configured:
        raise UsageError(
            f"the organiser's key is {' or '.join(configured)}, not {key}",
            hint="leave out --public-key, or change 'authority: {signed_by: …}' where the organiser did",
        )
    return (key,)


def refuse_unsigned(
    file: Path, keys: Sequence[str], signature: Path | None = None, *, competition: str = ""
) -> Signed | None:
    """Refuse a file that no owner of one of the keys vouches for.

    Args:
        file: Any file.
        keys: The keys; without any, everything passes.
        signature: Its signature; by default next to it.
        competition: For which competition it must be signed; empty where none is asked for.

    Returns:
        The signature that holds; `None` where no key is asked for.

    Raises:
        ResultError: Nobody vouches for it.
        UsageError: A key cannot be used.
    """
    refused: ResultError | None = None
    for key in keys:
        try:
            signed = verify_signature(file, key, signature)
        except ResultError as error:
            refused = refused or error
            continue
        _refuse_other_competition(signed, file, competition)
        return signed
    if refused is not None:
        raise refused
    return None


def _refuse_other_competition(signed: Signed, file: Path, competition: str) -> None:
    """A key that is used for several cups vouches for each result in one of them alone.

    Raises:
        ResultError: It is signed for another competition, or for none.
    """
    if not competition or signed.competition == competition:
        return
    whose = f"for the competition {signed.competition}" if signed.competition else "for no competition"
    raise ResultError(
        f"it is signed {whose}, and this is {competition}",
        file=file,
        hint=f"the organiser signs it with 'sign --competition {competition}', if it is of this one",
    )


def _library() -> Any:
    try:
        import minisign  # noqa: PLC0415  # only those who sign need it
    except ImportError as cause:
        raise UsageError(
            "the library `py-minisign` is not installed", hint="pip install 'ariac-score[sign]'"
        ) from cause
    return minisign
