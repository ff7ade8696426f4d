"""Links that a log map names of a body, and nobody recorded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from fnmatch import fnmatchcase

from ariac_score.logs.gather.message_fields import nearest
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch

__all__ = ["add_unrecorded_links"]


def add_unrecorded_links(builder: TrialBuilder, matches: Iterable[BodyMatch], names: Iterable[str]) -> None:
    """Say which links of recorded bodies were not recorded, and add those that are named one by one.

    A body without one of its links is another one: its nearest point may be further away, so what is asked of
    it is open. Which links a pattern stands for nobody knows where it matches none, so that is only said.

    Args:
        builder: Of the trial, with the bodies and links that were recorded.
        matches: Whom the log map names, of whom something was recorded.
        names: Of all recorded links, or frames.
    """
    known = sorted(names)
    for match in matches:
        bodies = [body for body in builder.bodies.values() if match.is_body(body)]
        recorded = {own.replace("/", "_") for body in bodies for own in body.links}
        for pattern in match.links:
            link = pattern.replace("/", "_")
            # The frame of a body may stand among its links; it is there as the body.
            if match.body_for(pattern) or any(fnmatchcase(own, link) for own in recorded):
                continue
            meant = f"; {nearest(pattern, known, what='recorded links')}" if known else ""
            whose = ", ".join(body.id for body in bodies)
            builder.unrecorded.append(f"link {pattern} of {whose}: no recorded link matches{meant}")
            if not set("*?[") & set(link):
                for body in bodies:
                    builder.add_body(replace(body, links=(link,)))
