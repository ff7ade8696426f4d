"""All files of the MCAP conformance suite, those with padded records as well, and the page about them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SUITE = ROOT.parent / "shared/bags/mcap_conformance"


@pytest.fixture(autouse=True)
def _beside_the_benchmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    sys.modules.pop("conformance", None)


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_every_file_is_read_and_the_page_says_so() -> None:
    if not SUITE.is_dir():
        pytest.skip("the suite is not in ../shared/bags/mcap_conformance")
    import conformance  # noqa: PLC0415  # beside the tests

    told = list(conformance.rows(SUITE))

    assert len(told) == 416 / 2
    assert {row[2] for row in told} | {row[4] for row in told} == {"read"}
    assert (ROOT / "docs/conformance.md").read_text(encoding="utf-8") == conformance.page(told)


def test_a_padded_file_has_its_numbers_right(tmp_path: Path) -> None:
    import conformance  # noqa: PLC0415  # beside the tests

    from ariac_score.testing import write_bag  # noqa: PLC0415  # needs no suite
    from ariac_score.testing.bags import Recorded  # noqa: PLC0415  # likewise

    sent = [Recorded("/x", "std_msgs/msg/UInt8", 10**9 + i, {"data": i}) for i in range(3)]
    whole = write_bag(tmp_path / "a.mcap", sent, storage="mcap").read_bytes()
    (tmp_path / "b.mcap").write_bytes(conformance.padded(whole))

    assert len(conformance.padded(whole)) > len(whole)
    assert conformance.ours(tmp_path / "b.mcap") == conformance.ours(tmp_path / "a.mcap")
    assert len(conformance.of_mcap(tmp_path / "b.mcap")) == 3


def test_a_file_that_is_read_otherwise_is_told(tmp_path: Path) -> None:
    import conformance  # noqa: PLC0415  # beside the tests

    (tmp_path / "a").write_bytes(b"nothing")
    assert conformance.verdict(conformance.ours, tmp_path / "a", []) == "LogError"
    assert conformance.verdict(lambda _: [("/x", 1, "00")], tmp_path / "a", []) == "1 of 0"
