"""Message packages of others, broken or rival: each is missed only where its types are recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ariac_score.logs.columnar import types
from ariac_score.logs.columnar.types import UnknownTypeError, bundled_typestore, decoder_for
from ariac_score.logs.containers.items import Connection

Install = Callable[..., str]
MESSAGES = "ariac_score.messages"


@pytest.fixture(autouse=True)
def _fresh_stores() -> Iterator[None]:
    types._bundled.cache_clear()
    types._typestore_for.cache_clear()
    yield
    types._bundled.cache_clear()
    types._typestore_for.cache_clear()


def without_definition(name: str) -> Connection:
    return Connection("/topic", name, "cdr")


@pytest.fixture
def point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Install an entry point of messages that leads to a package."""

    def put(name: str, target: str) -> None:
        folder = tmp_path / "points" / "odd_msgs-1.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-msgs\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[{MESSAGES}]\n{name} = {target}\n")
        monkeypatch.syspath_prepend(str(folder.parent))

    return put


@pytest.mark.parametrize("target", ["json", "a_package_that_nobody_has", "sys"])
def test_messages_that_cannot_be_read_are_named_where_they_are_recorded(
    point: Callable[[str, str], None], target: str
) -> None:
    point("odd_msgs", target)

    with pytest.raises(UnknownTypeError, match=r"odd_msgs \(odd-msgs 1\.0\) cannot be used: \w+Error"):
        decoder_for(without_definition("odd_msgs/msg/Thing"))

    assert "ariac_msgs/msg/Part" in bundled_typestore(2).fielddefs
    assert decoder_for(without_definition("ariac_msgs/msg/Part"))


def test_messages_that_two_distributions_bring_are_used_of_neither(
    point: Callable[[str, str], None],
) -> None:
    point("ariac_msgs", "json")

    with pytest.raises(UnknownTypeError, match=r"'ariac_msgs' is provided by .* and odd-msgs 1\.0"):
        decoder_for(without_definition("ariac_msgs/msg/Part"))

    assert "nist_gear/msg/Order" in bundled_typestore(1).fielddefs


def test_a_definition_that_contradicts_a_known_one_is_not_used(
    point: Callable[[str, str], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "stranger_geometry" / "msg" / "geometry_msgs"
    folder.mkdir(parents=True)
    (folder.parents[1] / "__init__.py").write_text("")
    (folder / "Point.msg").write_text("int8 x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = bundled_typestore(2).fielddefs["geometry_msgs/msg/Point"]
    types._bundled.cache_clear()

    point("geometry_msgs", "stranger_geometry")

    assert bundled_typestore(2).fielddefs["geometry_msgs/msg/Point"] == before
