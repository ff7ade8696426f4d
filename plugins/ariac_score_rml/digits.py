"""Numbers that stand in a text, many at once.

Eight bytes are taken at a time; how many of them are digits, and what number they make,
comes from arithmetic on the 64 bits. Every value is what `float` makes of the same text,
to the bit; what that cannot be promised for is called odd and left to `float`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PADDING", "Numbers", "Text"]

_Words = NDArray[np.uint64]
_Places = NDArray[np.intp]

PADDING = 64
"""Reading goes on so far behind the last byte."""

_DIGITS_AT_ONCE = 8
_MAX_WORDS = 3
"""A fraction with more digits than these words hold is odd."""

_POWERS = np.array([10**k for k in range(_DIGITS_AT_ONCE + 1)], dtype=np.uint64)
_EXACT_IN_FLOAT = 2**53
_LARGEST_POWER_IN_FLOAT = 22
"""10^22 is the largest power of ten that a float64 is exactly."""

_SURE_PLACES = 19
_LARGEST = 1.8e19
"""Below 2^64 even when the estimate is off in its last bits."""

_EXTENDED = np.finfo(np.longdouble).nmant == 63 and sys.byteorder == "little"
"""Whether there are floats of 64 bits to divide in, of which those of 53 are then rounded."""


def _word(byte: int) -> np.uint64:
    return np.uint64(byte * 0x0101010101010101)


_ZEROS, _SIXES, _HIGH_HALVES = _word(0x30), _word(0x06), _word(0xF0)
_HIGH_BITS, _ONES = _word(0x80), _word(0x01)
_ONE, _SEVEN, _EIGHT, _SIXTEEN = np.uint64(1), np.uint64(7), np.uint64(8), np.uint64(16)
_THIRTY_TWO, _FIFTY_SIX, _SIXTY_FOUR = np.uint64(32), np.uint64(56), np.uint64(64)
_TENS_OF_PAIRS, _HUNDREDS, _TEN_THOUSANDS = np.uint64(2561), np.uint64(6553601), np.uint64(42949672960001)
_PAIRS, _QUADS = np.uint64(0x00FF00FF00FF00FF), np.uint64(0x0000FFFF0000FFFF)


class Text:
    """A block of text of which eight bytes can be had at any place.

    Args:
        padded: The text and at least `PADDING` bytes more, which nobody may change meanwhile;
            a whole number of words.
        length: Of the text.
    """

    def __init__(self, padded: bytes | bytearray, length: int) -> None:
        self.padded, self.length = padded, length
        self.bytes = np.frombuffer(self.padded, dtype=np.uint8)
        self.words: _Words = np.frombuffer(self.padded, dtype="<u8")

    @classmethod
    def of(cls, block: bytes) -> Text:
        """A text on its own."""
        return cls(block + bytes(PADDING + -len(block) % 8), len(block))

    def words_from(self, at: _Places) -> Iterator[_Words]:
        """Eight bytes from each place, the first of them lowest; then the next eight, and so on."""
        at = np.minimum(at, self.length)
        index = at >> 3
        shift = ((at & 7) << 3).view(np.uint64)
        # Shifted by all of its 64 bits nothing is left of the second word, which is what is wanted.
        rest = _SIXTY_FOUR - shift
        following = self.words[index]
        for step in range(1, _MAX_WORDS + 1):
            word, following = following, self.words[index + step]
            word >>= shift
            word |= following << rest
            yield word

    def byte(self, at: _Places) -> NDArray[np.uint8]:
        """The byte at each place."""
        return self.bytes[np.minimum(at, self.length)]

    def has(self, at: _Places, wanted: bytes) -> NDArray[np.bool_]:
        """Whether a text, of which no byte is 0, stands at each place."""
        size = len(wanted)
        if not size:
            return np.ones(len(at), dtype=bool)
        if size > self.length:
            return np.zeros(len(at), dtype=bool)
        places = np.ndarray((self.length - size + 1,), f"S{size}", self.padded, strides=(1,))
        last = self.length - size
        found: NDArray[np.bool_] = places[np.minimum(at, last)] == wanted
        return found & (at <= last)


@dataclass(frozen=True)
class Numbers:
    """What numbers stand at some places.

    Attributes:
        values: The numbers, shape (n,).
        whole: Which have neither point nor exponent, shape (n,).
        end: Where each ends, shape (n,).
        odd: For which of them none of that is certain, shape (n,).
    """

    values: NDArray[np.float64]
    whole: NDArray[np.bool_]
    end: _Places
    odd: NDArray[np.bool_]

    @classmethod
    def at(cls, text: Text, begin: _Places) -> Numbers:
        """The numbers of JSON that begin at some places."""
        negative = text.byte(begin) == ord("-")
        first = begin + negative
        before, parts, more = _run_of_digits(text, first, np.ones(len(begin), dtype=bool))
        point = first + before
        fractional = text.byte(point) == ord(".")
        leading_zero = (before > 1) & (text.byte(first) == ord("0"))
        odd = more | (before == 0) | leading_zero
        after, fraction, more = _run_of_digits(text, point + 1, fractional)
        parts += fraction
        mantissa = parts[0][1] if parts else np.zeros(0, dtype=np.uint64)
        for places, digits in parts[1:]:
            mantissa = mantissa * _POWERS[places] + digits
        odd |= more | (fractional & (after == 0)) | _too_large(parts, before + after)
        end = point + after + fractional
        odd |= (text.byte(end) | 0x20) == ord("e")
        odd |= negative & ~fractional & (mantissa == 0)  # the whole number -0 is 0
        values, unsure = _quotients(mantissa, after)
        if negative.any():
            values = np.where(negative, -values, values)
        return cls(values, ~fractional, end, odd | unsure)


_Parts = list[tuple[_Places, _Words]]


def _run_of_digits(
    text: Text, begin: _Places, wanted: NDArray[np.bool_]
) -> tuple[_Places, _Parts, NDArray[np.bool_]]:
    """How many digits stand at some places, what they make eight by eight, and where there are too many."""
    count, parts, more = np.zeros(len(begin), dtype=np.intp), _Parts(), wanted
    if not wanted.any():
        return count, parts, more
    # Where the digits go on they fill the word, so that the next ones begin with the next word.
    for word in text.words_from(begin):
        places, digits = _digits(word)
        if not more.all():
            places, digits = places * more, digits * more
        parts.append((places, digits))
        count = count + places
        more = places == _DIGITS_AT_ONCE
        if not more.any():
            break
    return count, parts, more


def _too_large(parts: _Parts, count: _Places) -> NDArray[np.bool_]:
    """Where digits taken together make a number that 64 bits may not hold."""
    too_large = np.zeros(len(count), dtype=bool)
    (long,) = np.nonzero(count > _SURE_PLACES)
    if len(long):
        estimate = np.zeros(len(long))
        for places, digits in parts:
            estimate = estimate * _POWERS[places[long]] + digits[long]
        too_large[long] = estimate > _LARGEST
    return too_large


def _digits(word: _Words) -> tuple[_Places, _Words]:
    """How many of eight bytes are digits until one is not, and the number these make.

    Source:
        Wojciech Mula 2014 and Johnny Lee, "SIMD within a register" parsing of decimal digits.
    """
    digits = word ^ _ZEROS
    # A byte is no digit when its high half is not 0, now or after 6 is added.
    others = digits + _SIXES
    others |= digits
    others &= _HIGH_HALVES
    below = others - _ONE
    below &= ~others
    below &= _HIGH_BITS
    below >>= _SEVEN
    below *= _ONES
    below >>= _FIFTY_SIX
    # Without any digit the shift is by all 64 bits, which leaves 0.
    digits <<= _SIXTY_FOUR - (below << np.uint64(3))
    digits *= _TENS_OF_PAIRS
    digits >>= _EIGHT
    digits &= _PAIRS
    digits *= _HUNDREDS
    digits >>= _SIXTEEN
    digits &= _QUADS
    digits *= _TEN_THOUSANDS
    digits >>= _THIRTY_TWO
    return below.view(np.intp), digits


def _quotients(mantissa: _Words, places: _Places) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """mantissa / 10^places, rounded once, and for which of them that is not certain.

    Both sides are floats exactly and division rounds once; or both are so in 64 bits, and
    rounding the quotient again to 53 errs only where it lies halfway between two floats.

    Source:
        Clinger, How to read floating point numbers accurately, 1990.
    """
    exact = (mantissa < _EXACT_IN_FLOAT) & (places <= _LARGEST_POWER_IN_FLOAT)
    values = mantissa.astype(np.float64) / _FLOAT_POWERS[np.minimum(places, _LARGEST_POWER_IN_FLOAT)]
    if exact.all():
        return values, ~exact
    if not _EXTENDED:
        return values, ~exact
    (rest,) = np.nonzero(~exact)
    wide = mantissa[rest].astype(np.longdouble) / _LONG_POWERS[places[rest]]
    values[rest] = wide.astype(np.float64)
    bits = np.ascontiguousarray(wide).view(np.uint64)[:: wide.itemsize // 8]
    unsure = np.zeros(len(values), dtype=bool)
    unsure[rest] = (bits & np.uint64(0x7FF)) == 0x400
    return values, unsure


def _powers(count: int, one: np.floating) -> NDArray[np.floating]:
    powers = [one]
    while len(powers) < count:
        powers.append(powers[-1] * type(one)(10))
    return np.array(powers, dtype=type(one))


_FLOAT_POWERS: NDArray[np.float64] = np.array([float(10**k) for k in range(_LARGEST_POWER_IN_FLOAT + 1)])
_LONG_POWERS = _powers(_MAX_WORDS * _DIGITS_AT_ONCE + 1, np.longdouble(1))
