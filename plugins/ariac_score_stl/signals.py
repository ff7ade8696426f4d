"""Which signals the names of a formula stand for: `centre_distance in m`, `speed of robot in m/s`."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ariac_score import Trial
from ariac_score_stl.syntax import FUNCTIONS, StlError, is_word

__all__ = ["Source", "Subject", "check_name", "parse_source", "subjects"]

MAX_SOURCE_LENGTH = 500
"""A longer text is no source; to refuse it the pattern would take time that grows with its square."""

_SOURCE = re.compile(
    r"(?P<quantity>[a-z][a-z0-9_]*)(?:\s+of\s+(?P<subject>[^\s]+))?\s+in\s+(?P<unit>[^\s].*?)\s*"
)
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Source:
    """Where the values of a name come from.

    Attributes:
        quantity: Such as `centre_distance`.
        subject: `robot`, `human`: every one of them; a body, or a pair by its name; empty:
            every robot and human.
        unit: The unit that the formula expects.
    """

    quantity: str
    subject: str
    unit: str

    @property
    def kinds(self) -> frozenset[str]:
        """Over which bodies it ranges: `robot`, `human`, both or none."""
        if not self.subject:
            return frozenset({"robot", "human"})
        return frozenset({self.subject} & {"robot", "human"})

    @property
    def pair(self) -> str:
        """The pair by its name, which may be of any kinds; else empty."""
        return self.subject if "/" in self.subject else ""

    def signal(self, subject: Subject) -> str:
        """The name of the signal for one robot, human or pair."""
        chosen = {"robot": subject.robot, "human": subject.human}.get(self.subject, self.subject)
        return f"{self.quantity}/{chosen or f'{subject.robot}/{subject.human}'}"


@dataclass(frozen=True)
class Subject:
    """Whom a formula is judged for; a name is empty where its signals are of no such body."""

    robot: str = ""
    human: str = ""

    def __str__(self) -> str:
        return "/".join(name for name in (self.robot, self.human) if name) or "trial"


def parse_source(name: str, text: str) -> Source:
    """Read `QUANTITY in UNIT` or `QUANTITY of SUBJECT in UNIT`.

    Raises:
        StlError: It is neither.

    >>> parse_source("v", "speed of robot in m/s")
    Source(quantity='speed', subject='robot', unit='m/s')
    """
    match = _SOURCE.fullmatch(text.strip()) if len(text) <= MAX_SOURCE_LENGTH else None
    if match is None:
        raise StlError(
            f"signal {name!r} is {text[:80]!r}; write 'QUANTITY in UNIT' for a robot and a human, such as "
            "'centre_distance in m', or 'QUANTITY of robot in UNIT', such as 'speed of robot in m/s'"
        )
    return Source(match["quantity"], match["subject"] or "", match["unit"])


def check_name(name: str) -> None:
    """Refuse a name that a formula would take for something else.

    Raises:
        StlError: It is no name, or a word of the language.
    """
    if not _NAME.fullmatch(name):
        raise StlError(f"{name!a} is not a name; names have letters, digits and _ and start with a letter")
    if is_word(name) or name in FUNCTIONS or keyword.iskeyword(name):
        raise StlError(f"{name!r} is a word of the language; give the signal another name")


def subjects(trial: Trial, sources: Mapping[str, Source]) -> Iterator[Subject]:
    """Everyone the formula is judged for: pairs, robots, humans, or the trial as a whole."""
    kinds = frozenset(kind for source in sources.values() for kind in source.kinds)
    robots = [body.id for body in trial.bodies_of("robot")] if "robot" in kinds else [""]
    humans = [body.id for body in trial.bodies_of("human")] if "human" in kinds else [""]
    for robot in robots:
        for human in humans:
            yield Subject(robot, human)
