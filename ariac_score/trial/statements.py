"""Who states what of a trial: each fact has an owner, and two that contradict each other are refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

__all__ = [
    "BY_RULES",
    "NOBODY",
    "OF_THE_ORGANISER",
    "ORGANISER",
    "OWNERS",
    "RECORDER",
    "RUN",
    "TEAM",
    "FileOrigin",
    "Statement",
    "statement_of",
]

ORGANISER, RECORDER, TEAM, RUN, BY_RULES, NOBODY = "organiser", "recorder", "team", "run", "rules", "nobody"
OWNERS = {
    ORGANISER: "a file that the organiser gave",
    RECORDER: "a log or an official record of the trial",
    TEAM: "the team's own set-up",
    RUN: "a file that lies with the run; nobody else vouches for it",
    BY_RULES: "the rule set",
    NOBODY: "nothing states it",
}
"""Whose statement a fact can rest on, in words."""


OF_THE_ORGANISER = frozenset({"trial_config", "log_map"})
"""Roles of files that state what was to be done, or what a log means: the organiser's, whoever brings one."""


@dataclass(frozen=True)
class FileOrigin:
    """Where a part of a trial was read, and who gave it.

    Attributes:
        file: Its name, as results give it.
        role: Such as `log` or `trial_config`.
        given: Whether the caller gave it, as an organiser does; otherwise it lies with the run.

    >>> FileOrigin("trial.yaml", "trial_config").owner, FileOrigin("run.mcap").owner
    ('run', 'recorder')
    """

    file: str
    role: str = "log"
    given: bool = False

    @property
    def owner(self) -> str:
        """Whose statement it is, one of `OWNERS`."""
        if self.role == "team_config":
            return TEAM
        if self.role in OF_THE_ORGANISER:
            return ORGANISER if self.given else RUN
        return RECORDER

    def __str__(self) -> str:
        """The file with whose it is, for messages."""
        return f"{self.file!r} ({self.owner})"


@dataclass(frozen=True, order=True)
class Statement:
    """Whose statement one fact of a trial rests on.

    Attributes:
        fact: `work`, `window`, `set-up` or `completeness`.
        by: One of `OWNERS`.
        source: The files that state it; empty where none does.
        detail: What they state, or why it is open, in words.
    """

    fact: str
    by: str
    source: tuple[str, ...] = ()
    detail: str = ""


def statement_of(fact: str, origins: Iterable[FileOrigin], detail: str = "") -> Statement:
    """The statement of the files that state a fact; of several, the organiser's counts first."""
    found = list(origins)
    if not found:
        return Statement(fact, NOBODY, detail=detail)
    by = min((origin.owner for origin in found), key=list(OWNERS).index)
    return Statement(fact, by, tuple(sorted({o.file for o in found if o.owner == by})), detail)
