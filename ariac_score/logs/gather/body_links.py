"""Links that a log map names of a body, and nobody recorded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from fnmatch import fnmatchcase

from ariac_score.logs.gather.message_fields import nearest
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch
from ariac_score.trial.model import Body

__all__ = ["add_unrecorded_links"]


def add_unrecorded_links(
    builder: TrialBuilder, matches: Iterable[BodyMatch], names: Iterable[str], *, of_each: bool
) -> None:
    """Say which links of recorded bodies were not recorded, and add those that are named one by one.

    A body without one of its links is another one: its nearest point may be further away, so what is asked of
    it is open. Which links a pattern stands for nobody knows where it matches none, so that is only said.

    Args:
        builder: Of the trial, with the bodies and links that were recorded.
        matches: Whom the log map names, of whom something was recorded.
        names: Of all recorded links, or frames.
        of_each: Whether each body has all links that are named, as the models of Gazebo; names of frames are
            those of one body each.
    """
    known = sorted(names)
    for match in matches:
        bodies = [body for body in builder.bodies.values() if match.is_body(body)]
        for pattern in match.links:
            lacking = [body for body in bodies if not _has(body, pattern)]
            if not of_each and (len(lacking) < len(bodies) or _is_body_itself(pattern, match, known)):
                continue
            if not lacking:
                continue
            meant = f"; {nearest(pattern, known, what='recorded links')}" if known else ""
            whose = ", ".join(body.id for body in lacking)
            builder.unrecorded.append(f"link {pattern} of {whose}: no recorded link matches{meant}")
            if not set("*?[") & set(pattern):
                for body in lacking:
                    builder.add_body(replace(body, links=(pattern.replace("/", "_"),)))


def _has(body: Body, pattern: str) -> bool:
    return any(fnmatchcase(own.replace("/", "_"), pattern.replace("/", "_")) for own in body.links)


def _is_body_itself(pattern: str, match: BodyMatch, frames: Iterable[str]) -> bool:
    """Whether a frame that stands among the links was recorded, and is there as the body."""
    return any(fnmatchcase(frame, pattern) and match.body_for(frame) is not None for frame in frames)
