"""What a rule set says about who may state what: work, the window of the competition, completeness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Authority"]


@dataclass(frozen=True)
class Authority:
    """Who may state what of a trial.

    Attributes:
        work: Whose configuration may state the work where the organiser gives none: `organiser` (nobody
            else's) or `run` (one that lies with the run); empty where the rules leave it to who scores.
        window: What bounds the competition: `events` (its start and end, as recorded), or `recording`
            where a log shows neither.
        completeness: `attested` where only logs count whose recorder proves that nothing is missing;
            `believed` where others count as well; empty where the rules do not say, which is the latter for
            whoever has the logs recorded himself.
        recorder_keys: The public keys of the recorders whose signature counts, as minisign writes them.
        signed_by: The public keys of the organiser, one of which must have signed what is stored.

    >>> Authority.of({"window": "recording"}).window
    'recording'
    """

    work: str = ""
    window: str = "events"
    completeness: str = ""
    recorder_keys: tuple[str, ...] = ()
    signed_by: tuple[str, ...] = ()

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Authority:
        """As a rule set, or a competition, states it."""
        return cls(
            work=document.get("authority", {}).get("work", ""),
            window=document.get("window", "events"),
            completeness=document.get("completeness", ""),
            recorder_keys=tuple(document.get("authority", {}).get("recorder_keys", ())),
            signed_by=tuple(document.get("authority", {}).get("signed_by", ())),
        )
