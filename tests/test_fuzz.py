"""Each target of `fuzz/` over its seeds, some hundred mutations, and every finding so far."""

from __future__ import annotations

import random
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
    for raw in islice(mutations(corpus, target(name).words, seed=20, name=name), MUTATIONS):
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


def test_a_change_in_the_format_changes_it_and_leaves_it_in_form() -> None:
    from fuzz.structures import WAYS, mcap_records, structured  # noqa: PLC0415  # found at the root

    assert set(WAYS) == set(NAMES) - {"columnar", "wide_text"}  # those two are programs: whole in any form
    for name in sorted(WAYS):
        chance = random.Random(5)  # noqa: S311  # made to be repeated
        made = [(raw, structured(name, raw, chance)) for raw in seeds(name) * 20]
        changed = [after for before, after in made if after is not None and after != before]
        assert len(changed) > len(made) / 4, name
    whole = [seed for seed in seeds("mcap_scan") for _ in range(20)]
    chance = random.Random(6)  # noqa: S311  # likewise
    for raw in filter(None, (structured("mcap_scan", seed, chance) for seed in whole)):
        records = mcap_records(raw[8:])
        read = 8 + sum(9 + len(body) for _, body in records)
        assert len(raw) - read in (0, 8)  # every length is right; the closing magic may be gone


def test_a_file_that_a_library_reads_otherwise_is_a_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fuzz import peers  # noqa: PLC0415  # found at the root

    whole = seeds("mcap_peer")[0]
    peers.mcap_with_peer(tmp_path, whole)
    theirs = peers._of_mcap(whole)
    assert theirs
    assert peers._ours(peers.McapScan(tmp_path / "log.mcap")) == theirs
    monkeypatch.setattr(peers, "_of_mcap", lambda _: [*theirs[:-1], ("/small", 1, b"")])
    with pytest.raises(AssertionError):
        peers.mcap_with_peer(tmp_path, whole)
