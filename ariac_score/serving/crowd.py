"""How many may be connected to a server of ours at a time, and who gives way when there is no room.

Nobody is turned away because others hold places that they do not use: whoever has been quiet for longest
gives way, first of all at the address that holds the most. So an address that opens connections without end
takes its own places, and one that is in a handshake for milliseconds outlives those that only wait.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from ipaddress import ip_address, ip_network

from ariac_score.serving.guard import is_loopback

__all__ = ["Crowd", "Guest", "neighbourhood"]


@dataclass(eq=False)
class Guest:
    """A connection.

    Attributes:
        address: Where it comes from.
        leave: Makes it end, soon and from another thread.
        spoken: Whether it has ever sent something that made sense.
        heard_s: When it last did, or when it came, on the clock of the crowd.
    """

    address: str
    leave: Callable[[], object]
    spoken: bool = False
    heard_s: float = field(default=0.0)


class Crowd:
    """Those who are connected. Not for several threads at once: whoever shares it holds a lock.

    Args:
        most: At a time.
        most_of_one: Of one address; this machine's own are one machine, and have no limit of their own.
        silent_s: Who has never spoken gives way when quiet for so long.
        idle_s: So does everybody else when quiet for so long.
        now: The time, s.
    """

    def __init__(
        self,
        most: int,
        most_of_one: int,
        *,
        silent_s: float,
        idle_s: float,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._most, self._most_of_one = most, most_of_one
        self._silent_s, self._idle_s, self._now = silent_s, idle_s, now
        self._guests: dict[Guest, None] = {}
        self.gave_way = 0

    def __len__(self) -> int:
        return len(self._guests)

    def admit(self, guest: Guest) -> bool:
        """Take somebody in, in the place of another one if need be; whether there was a place."""
        guest.heard_s = self._now()
        of_one = [one for one in self._guests if one.address == guest.address]
        if len(of_one) >= self._most_of_one and not is_loopback(guest.address):
            if not self._made_way(of_one):
                return False
        elif len(self._guests) >= self._most and not self._made_way(self._guests):
            return False
        self._guests[guest] = None
        return True

    def heard(self, guest: Guest) -> None:
        """Note that somebody sent something that made sense."""
        guest.spoken, guest.heard_s = True, self._now()

    def gone(self, guest: Guest) -> None:
        """Note that somebody has left."""
        self._guests.pop(guest, None)

    def _made_way(self, among: Iterable[Guest]) -> bool:
        now_s, held = self._now(), Counter(one.address for one in self._guests)
        quiet = [
            one for one in among if now_s - one.heard_s >= (self._idle_s if one.spoken else self._silent_s)
        ]
        if not quiet:
            return False
        first = max(quiet, key=lambda one: (not one.spoken, held[one.address], now_s - one.heard_s))
        self.gone(first)
        self.gave_way += 1
        first.leave()
        return True


def neighbourhood(address: str) -> str:
    """What counts as one address: of version 6 the network of 64 bits, all of which one machine can have.

    >>> neighbourhood("192.0.2.7"), neighbourhood("2001:db8::7"), neighbourhood("::ffff:192.0.2.7")
    ('192.0.2.7', '2001:db8::', '192.0.2.7')
    """
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if found.version == 4 or found.is_loopback:
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ip_network((int(found), 64), strict=False).network_address)
