"""Each target of `fuzz/` over its seeds, some hundred mutations, and every finding so far."""

from __future__ import annotations

import sys
import zipfile
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from fuzz.targets import Target

ROOT = Path(__file__).parents[1]
FINDINGS = Path(__file__).parent / "data/fuzz"
NAMES = sorted(path.name for path in (ROOT / "fuzz/corpus").iterdir())
MUTATIONS = 40
LARGEST_CORPUS_BYTES = 300_000


@pytest.fixture(scope="module", autouse=True)
def _at_the_root() -> object:
    sys.path.insert(0, str(ROOT))  # `fuzz` is of the repository and not of the package
    yield
    sys.path.remove(str(ROOT))


def target(name: str) -> Target:
    from fuzz.targets import TARGETS  # noqa: PLC0415  # found at the root

    return TARGETS[name]


def seeds(name: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / "fuzz/corpus" / name).iterdir())]


def test_every_target_has_seeds_and_all_of_them_are_small() -> None:
    from fuzz.targets import TARGETS  # noqa: PLC0415  # found at the root

    assert sorted(TARGETS) == NAMES
    assert all(seeds(name) for name in NAMES)
    assert sum(len(raw) for name in NAMES for raw in seeds(name)) < LARGEST_CORPUS_BYTES


@pytest.mark.parametrize("name", NAMES)
def test_a_target_keeps_its_word_on_seeds_and_mutations(name: str) -> None:
    from fuzz.mutate import mutations  # noqa: PLC0415  # found at the root

    corpus = seeds(name)
    for raw in (b"", b"\0", b"\xff" * 100, *corpus):
        target(name).once(raw)
    for raw in islice(mutations(corpus, target(name).words, seed=20), MUTATIONS):
        target(name).once(raw)


@pytest.mark.parametrize("file", sorted(FINDINGS.iterdir()), ids=lambda file: file.name)
def test_what_was_found_once_is_refused_or_read(file: Path) -> None:
    target(file.name.partition("-")[0]).once(file.read_bytes())


def test_a_member_of_an_archive_without_a_name_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.zip"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("x", b"log")
    raw = bytearray(file.read_bytes())
    at = raw.index(b"PK\x01\x02")
    raw[at + 28] = 0  # the length of the name
    del raw[at + 46]
    end = raw.index(b"PK\x05\x06")
    raw[end + 12] -= 1  # the size of the directory
    file.write_bytes(raw)
    target("archive").once(file.read_bytes())


def test_mutations_repeat_themselves_with_their_seed() -> None:
    from fuzz.mutate import mutations  # noqa: PLC0415  # found at the root

    first, again, other = (list(islice(mutations([b"abc" * 9], [b"zz"], seed=s), 50)) for s in (1, 1, 2))
    assert first == again != other
