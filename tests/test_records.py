"""Frozen dataclasses that are quicker to define do what those of the standard library do."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import sys
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.records import dataclass

quicker = pytest.mark.skipif(sys.version_info >= (3, 13), reason="the standard library is as quick there")


@dataclass(frozen=True)
class Pose:
    """A record."""

    x_m: float
    frame: str = "world"
    tags: tuple[str, ...] = ()
    notes: dict[str, int] = dataclasses.field(default_factory=dict)
    unit: ClassVar[str] = "m"

    def __post_init__(self) -> None:
        if self.x_m == 13.0:
            raise ValueError("unlucky")


@dataclasses.dataclass(frozen=True)
class StandardPose:
    """A record."""

    x_m: float
    frame: str = "world"
    tags: tuple[str, ...] = ()
    notes: dict[str, int] = dataclasses.field(default_factory=dict)
    unit: ClassVar[str] = "m"

    def __post_init__(self) -> None:
        if self.x_m == 13.0:
            raise ValueError("unlucky")


@dataclass(frozen=True)
class Key:
    name: str
    number: int


@dataclasses.dataclass(frozen=True)
class StandardKey:
    name: str
    number: int


@dataclass(frozen=True, eq=False)
class Thing:
    name: str


@dataclass(frozen=True)
class Single:
    only: tuple[int, ...]


@dataclass(frozen=True)
class Nothing:
    """No fields."""


ARGUMENTS = st.tuples(
    st.floats(allow_nan=False).filter(lambda x: x != 13.0),
    st.text(max_size=3),
    st.tuples(st.text(max_size=2)),
)


@given(ARGUMENTS, ARGUMENTS)
def test_it_compares_and_prints_as_the_standard_library_does(first: Any, second: Any) -> None:
    ours, theirs = [Pose(*a) for a in (first, second)], [StandardPose(*a) for a in (first, second)]

    assert (ours[0] == ours[1]) == (theirs[0] == theirs[1])
    assert repr(ours[0]) == repr(theirs[0]).removeprefix("Standard")
    assert dataclasses.asdict(ours[0]) == dataclasses.asdict(theirs[0])
    assert dataclasses.replace(ours[0], frame="tray") == Pose(first[0], "tray", first[2])


@given(st.text(max_size=3), st.integers())
def test_equal_ones_are_one_key(name: str, number: int) -> None:
    assert {Key(name, number): 1}[Key(name, number)] == 1
    assert Key(name, number) != StandardKey(name, number)
    assert Key(name, number) != (name, number)


@pytest.mark.parametrize("made", [Pose(1.0), Key("a", 2), Single((1,)), Nothing(), Pose(2.0, notes={"a": 1})])
def test_it_can_be_copied_and_sent(made: object) -> None:
    assert copy.copy(made) == made
    assert copy.deepcopy(made) == made
    assert pickle.loads(pickle.dumps(made)) == made  # noqa: S301  # our own


def test_what_is_no_value_is_compared_by_identity() -> None:
    one, other = Thing("a"), Thing("a")

    assert one != other
    assert len({one, other}) == 2


def test_it_is_as_wide_as_its_twin() -> None:
    assert str(inspect.signature(Pose)).replace("StandardPose", "Pose") == str(
        inspect.signature(StandardPose)
    )
    assert [f.name for f in dataclasses.fields(Pose)] == [f.name for f in dataclasses.fields(StandardPose)]
    assert Pose.__match_args__ == StandardPose.__match_args__
    assert Pose.__doc__ == "A record."
    assert Key.__doc__ == "Key(name: 'str', number: 'int')"


@pytest.mark.parametrize("made", [Pose(1.0), StandardPose(1.0)])
@pytest.mark.parametrize("name", ["x_m", "frame", "notes", "other"])
def test_nothing_of_it_can_be_set_or_deleted(made: Any, name: str) -> None:
    before = dict(vars(made))

    with pytest.raises(dataclasses.FrozenInstanceError, match=f"cannot assign to field '{name}'"):
        setattr(made, name, 2.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match=f"cannot delete field '{name}'"):
        delattr(made, name)

    assert vars(made) == before


@pytest.mark.parametrize("kind", [Pose, StandardPose])
def test_what_its_check_refuses_is_not_made(kind: Any) -> None:
    with pytest.raises(ValueError, match="unlucky"):
        kind(13.0)
    with pytest.raises(TypeError, match="x_m"):
        kind()
    with pytest.raises(TypeError, match="colour"):
        kind(1.0, colour="red")


def test_one_of_the_standard_library_may_be_made_of_it() -> None:
    @dataclasses.dataclass(frozen=True)
    class Extended(Pose):
        speed_m_s: float = 0.0

    @dataclass(frozen=True)
    class Further(Extended):
        accuracy: float = 0.0

    made = Further(1.0, speed_m_s=2.0)

    assert (made.x_m, made.frame, made.speed_m_s, made.accuracy) == (1.0, "world", 2.0, 0.0)
    assert made == Further(1.0, speed_m_s=2.0)
    assert made != Further(1.0, speed_m_s=3.0)
    for name in ("x_m", "speed_m_s", "accuracy", "other"):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(made, name, 3.0)


def test_a_subclass_without_fields_may_have_attributes_of_its_own() -> None:
    class Remembering(Pose):
        pass

    class StandardRemembering(StandardPose):
        pass

    for made in (Remembering(1.0), StandardRemembering(1.0)):
        made.last = 2.0  # type: ignore[union-attr]
        assert made.last == 2.0  # type: ignore[union-attr]
        del made.last  # type: ignore[union-attr]
        with pytest.raises(dataclasses.FrozenInstanceError):
            made.x_m = 2.0  # type: ignore[misc]


def test_the_unusual_is_left_to_the_standard_library() -> None:
    @dataclass(frozen=True, order=True)
    class Ordered:
        number: int

    @dataclass(frozen=True)
    class Partly:
        number: int
        seen: list[int] = dataclasses.field(default_factory=list, compare=False, repr=False)

    @dataclass(frozen=True)
    class Told:
        number: int

        def __repr__(self) -> str:
            return f"number {self.number}"

    @dataclass
    class Open:
        number: int

    assert Ordered(1) < Ordered(2)
    assert Partly(1, [1]) == Partly(1, [2])
    assert "seen" not in repr(Partly(1, [1]))
    assert repr(Told(1)) == "number 1"
    found = Open(1)
    found.number = 2
    assert found == Open(2)
    with pytest.raises(TypeError):
        hash(found)
    with pytest.raises(TypeError, match="cannot inherit non-frozen dataclass from a frozen one"):

        @dataclass
        class Loose(Pose):
            pass


def test_one_that_holds_itself_can_be_printed() -> None:
    held: dict[str, Any] = {}
    made = Pose(1.0, notes=held)
    held["self"] = made

    assert repr(made).endswith("Pose(x_m=1.0, frame='world', tags=(), notes={'self': ...})")


@quicker
def test_only_one_method_is_compiled_for_each(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[str] = []
    create = dataclasses._create_fn  # type: ignore[attr-defined]  # what takes the time

    def counted(name: str, *args: Any, **options: Any) -> Any:
        compiled.append(name)
        return create(name, *args, **options)

    monkeypatch.setattr(dataclasses, "_create_fn", counted)

    @dataclass(frozen=True)
    class Quick:
        number: int
        name: str = ""

    assert compiled == ["__init__"]
    assert Quick(1) == Quick(1, "")
