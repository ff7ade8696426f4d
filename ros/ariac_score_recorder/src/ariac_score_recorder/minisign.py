"""Signatures as minisign makes them without a hash before, so that no library is needed on any Python.

Ed25519 is written out in plain arithmetic: a recording is signed once, on the organiser's own machine, where
nobody measures how long that takes.

Source: RFC 8032, section 5.1; https://jedisct1.github.io/minisign.
"""

from __future__ import unicode_literals

import base64
import binascii
import collections
import hashlib
import os
import stat

__all__ = ["Key", "KeyUnusableError", "public_of", "read_key", "sign", "signature_text"]

_P = 2**255 - 19
_L = 2**252 + 27742317777372353535851937790883648493
_D = -121665 * pow(121666, _P - 2, _P) % _P
_BASE_X = 15112221349535400772501151409588531511454012693041857206046113283949847762202
_BASE_Y = 46316835694926478169428394003475163141307993866256225615783033603165251855960
_BASE = (_BASE_X, _BASE_Y, 1, _BASE_X * _BASE_Y % _P)
_SECRET_KEY_BYTES = 158
_PLAIN, _ED = b"\x00\x00", b"Ed"

Key = collections.namedtuple("Key", "id seed public")
"""A secret key: the 8 bytes of its id, its 32 secret bytes, and the public key that follows from them."""


class KeyUnusableError(Exception):
    """A key that cannot be used; says why, and what to do."""


def _number(data):
    return int(binascii.hexlify(data[::-1]), 16)


def _bytes(number):
    return binascii.unhexlify("{:064x}".format(number))[::-1]


def _added(a, b):
    x1, y1, z1, t1 = a
    x2, y2, z2, t2 = b
    m, n = (y1 - x1) * (y2 - x2) % _P, (y1 + x1) * (y2 + x2) % _P
    c, d = 2 * t1 * t2 * _D % _P, 2 * z1 * z2 % _P
    e, f, g, h = n - m, d - c, d + c, n + m
    return e * f % _P, g * h % _P, f * g % _P, e * h % _P


def _times_base(scalar):
    """A multiple of the base point, as 32 bytes."""
    sum_, power = (0, 1, 1, 0), _BASE
    while scalar:
        if scalar & 1:
            sum_ = _added(sum_, power)
        power = _added(power, power)
        scalar >>= 1
    x, y, z, _ = sum_
    inverse = pow(z, _P - 2, _P)
    x, y = x * inverse % _P, y * inverse % _P
    return _bytes(y | (x & 1) << 255)


def _expanded(seed):
    both = hashlib.sha512(seed).digest()
    return (_number(both[:32]) & (1 << 254) - 8) | 1 << 254, both[32:]


def public_of(seed):
    """The public key of 32 secret bytes."""
    return _times_base(_expanded(seed)[0])


def sign(seed, message):
    """The 64 bytes of a signature; the same key and message give the same."""
    scalar, prefix = _expanded(seed)
    public = _times_base(scalar)
    nonce = _number(hashlib.sha512(prefix + message).digest()) % _L
    point = _times_base(nonce)
    challenge = _number(hashlib.sha512(point + public + message).digest()) % _L
    return point + _bytes((nonce + challenge * scalar) % _L)


def read_key(path):
    """The secret key in a file of minisign that has no password.

    Raises:
        KeyUnusableError: There is no such key, others may read it, or it has a password.
    """
    make = "make one: ariac-score sign --new-key FILE, without a password"
    try:
        mode = stat.S_IMODE(os.stat(path).st_mode)
        with open(path, "rb") as file:
            lines = file.read(4096).split(b"\n")
    except (IOError, OSError) as cause:
        raise KeyUnusableError("{}: cannot be read: {}; {}".format(path, cause.strerror, make))
    if os.name == "posix" and mode & 0o077:
        raise KeyUnusableError("{}: others may read this secret key; chmod 600 it".format(path))
    try:
        raw = base64.b64decode(lines[1])
    except (IndexError, TypeError, binascii.Error):
        raw = b""
    if len(raw) != _SECRET_KEY_BYTES or raw[:2] != _ED:
        raise KeyUnusableError("{}: not a secret key of minisign; {}".format(path, make))
    if raw[2:4] != _PLAIN:
        raise KeyUnusableError("{}: has a password, which a node cannot ask for; {}".format(path, make))
    key = Key(raw[54:62], raw[62:94], raw[94:126])
    if public_of(key.seed) != key.public:
        raise KeyUnusableError("{}: damaged: its two halves do not belong together; {}".format(path, make))
    return key


def signature_text(key, message, comment):
    """The text of a signature file.

    Args:
        key: As `read_key` gives it.
        message: The bytes that are signed.
        comment: One line of printable ASCII, which is signed too.
    """
    signature, words = sign(key.seed, message), comment.encode("ascii")
    lines = [
        b"untrusted comment: signature from the recorder's key",
        base64.b64encode(_ED + key.id + signature),
        b"trusted comment: " + words,
        base64.b64encode(sign(key.seed, signature + words)),
    ]
    return b"\n".join(lines).decode("ascii") + "\n"
