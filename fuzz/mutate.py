"""Mutations from a seed: what a fuzzer without coverage can do, the same on every machine."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence

from fuzz.structures import structured

__all__ = ["mutations"]

LARGEST = 1 << 18
_EDGES = (0, 1, 0x7F, 0x80, 0xFF)


def mutations(
    corpus: Sequence[bytes], words: Sequence[bytes], *, seed: int, name: str = ""
) -> Iterator[bytes]:
    """Inputs without end: each a seed of the corpus, changed in one to eight places, or in its format.

    Args:
        corpus: Whole inputs.
        words: Pieces of the format.
        seed: The same seed gives the same inputs.
        name: Of the target; every third input is changed as its format allows, if that is known.
    """
    chance = random.Random(seed)  # noqa: S311  # made to be repeated
    while True:
        whole = chance.choice(corpus)
        made = structured(name, whole, chance) if chance.random() < 1 / 3 else None
        if made is not None:
            yield made
            continue
        raw = bytearray(whole)
        for _ in range(chance.randint(1, 8)):
            _change(raw, corpus, words, chance)
        yield bytes(raw[:LARGEST])


def _change(raw: bytearray, corpus: Sequence[bytes], words: Sequence[bytes], chance: random.Random) -> None:
    at = chance.randint(0, len(raw))
    end = min(len(raw), at + chance.choice((1, 2, 4, 8, 64, 1024)))
    match chance.randrange(9):
        case 0 if at < len(raw):
            raw[at] ^= 1 << chance.randrange(8)
        case 1 if at < len(raw):
            raw[at] = chance.choice((*_EDGES, chance.randrange(256)))
        case 2:
            del raw[at:end]
        case 3:
            raw[at:at] = raw[at:end] * chance.choice((1, 2, 50))
        case 4:
            del raw[at:]
        case 5:
            other = chance.choice(corpus)
            begin = chance.randint(0, len(other))
            raw[at:end] = other[begin : begin + 256]
        case 6:
            width = chance.choice((1, 2, 4, 8))
            number = chance.choice((0, 1, (1 << 8 * width) - 1, 1 << (8 * width - 1), chance.randrange(64)))
            raw[at : at + width] = number.to_bytes(width, "little")
        case 7:
            # Not all: of a long input that would take longer than all else.
            digits = [place for place, byte in enumerate(raw[at : at + 256], at) if 48 <= byte <= 57]
            if digits:
                place = chance.choice(digits)
                raw[place : place + 1] = chance.choice((b"-1", b"1e999", b"0", b"9" * 25, b"nan", b"", b".5"))
        case _:
            if words:
                raw[at : chance.choice((at, end))] = chance.choice(words)
