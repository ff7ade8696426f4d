"""Who gives way when a server is full."""

from __future__ import annotations

from ariac_score.serving.crowd import Crowd, Guest


class Door:
    """A crowd whose clock the test turns."""

    def __init__(self, most: int, most_of_one: int, silent_s: float = 2.0, idle_s: float = 600.0) -> None:
        self.now_s = 100.0
        self.left: list[str] = []
        self.crowd = Crowd(most, most_of_one, silent_s=silent_s, idle_s=idle_s, now=lambda: self.now_s)

    def comes(self, name: str, address: str = "a", *, after_s: float = 0.0) -> Guest | None:
        self.now_s += after_s
        guest = Guest(address, lambda: self.left.append(name))
        return guest if self.crowd.admit(guest) else None


def test_there_is_room_up_to_the_limit_and_not_beyond() -> None:
    door = Door(2, 2)

    assert door.comes("one")
    assert door.comes("two")
    assert door.comes("three") is None
    assert (len(door.crowd), door.left, door.crowd.gave_way) == (2, [], 0)


def test_whoever_never_spoke_gives_way_after_a_moment_the_oldest_first() -> None:
    door = Door(2, 2)
    door.comes("one")
    door.comes("two", after_s=0.5)

    assert door.comes("early", after_s=1.4) is None
    assert door.comes("late", after_s=0.1)
    assert (door.left, len(door.crowd), door.crowd.gave_way) == (["one"], 2, 1)


def test_whoever_has_spoken_keeps_its_place_while_others_are_only_there() -> None:
    door = Door(2, 2)
    monitor = door.comes("monitor")
    assert monitor
    door.crowd.heard(monitor)
    for name in ("one", "two", "three"):
        assert door.comes(name, after_s=500.0)

    assert door.left == ["one", "two"]


def test_whoever_has_spoken_gives_way_at_last() -> None:
    door = Door(1, 1)
    monitor = door.comes("monitor")
    assert monitor
    door.crowd.heard(monitor)

    assert door.comes("early", after_s=599.0) is None
    assert door.comes("late", after_s=1.0)
    assert door.left == ["monitor"]


def test_an_address_that_takes_every_place_gives_way_to_another() -> None:
    door = Door(4, 3, silent_s=0.0)
    door.comes("other", "b")
    for number in range(20):
        door.comes(f"flood {number}", "a", after_s=0.001)

    assert door.comes("honest", "c")
    assert all(name.startswith("flood") for name in door.left)


def test_at_the_limit_of_an_address_it_takes_its_own_places_alone() -> None:
    door = Door(10, 2)
    door.comes("other", "b")
    door.comes("one", "a", after_s=5.0)
    door.comes("two", "a", after_s=5.0)

    assert door.comes("three", "a")
    assert door.left == ["one"]


def test_whoever_has_left_makes_room() -> None:
    door = Door(1, 1)
    first = door.comes("one")
    assert first
    door.crowd.gone(first)
    door.crowd.gone(first)  # twice does no harm

    assert door.comes("two")
    assert door.left == []
