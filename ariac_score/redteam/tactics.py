"""All that is tried, in the order of the rounds."""

from __future__ import annotations

from ariac_score.redteam.attempt import Aim, Tactic
from ariac_score.redteam.behaviour import (
    added,
    calm_run_beside,
    deepened,
    joined,
    lengthened,
    rearranged,
    run_again,
    stopped,
    waited,
)
from ariac_score.redteam.forgeries import (
    clocked,
    jumped,
    moved,
    put_in,
    reparented,
    replayed,
    republished,
    rewritten,
    shifted,
)
from ariac_score.redteam.omissions import (
    messages_left_out,
    recording_cut,
    samples_left_out,
    thinned,
    topics_left_out,
)
from ariac_score.redteam.resting import said_slower, stood_still

__all__ = ["TACTICS"]

TACTICS = (
    Tactic("messages left out", Aim.LIE, messages_left_out, needs_proof=True),
    Tactic("topics left out", Aim.LIE, topics_left_out),
    Tactic("samples left out", Aim.LIE, samples_left_out),
    Tactic("recording cut", Aim.LIE, recording_cut),
    Tactic("samples thinned", Aim.LIE, thinned),
    Tactic("frames re-parented", Aim.LIE, reparented),
    Tactic("publishers added", Aim.LIE, republished),
    Tactic("samples put in", Aim.LIE, put_in, needs_proof=True),
    Tactic("motion shifted", Aim.LIE, shifted, needs_proof=True),
    Tactic("motion with jumps", Aim.LIE, jumped),
    Tactic("motion replayed", Aim.LIE, replayed),
    Tactic("motion rewritten", Aim.LIE, rewritten, needs_proof=True),
    Tactic("messages moved", Aim.LIE, moved, needs_proof=True),
    Tactic("speeds denied", Aim.LIE, said_slower),
    Tactic("a clock put in", Aim.LIE, clocked, needs_proof=True),
    Tactic("violations joined", Aim.HARM, joined, law="more_violations"),
    Tactic("violations broken in two", Aim.HARM, rearranged, law="short_pause"),
    Tactic("violations deepened", Aim.HARM, deepened, law="severity"),
    Tactic("violations lengthened", Aim.HARM, lengthened, law="more_violations"),
    Tactic("violations added", Aim.HARM, added, law="more_violations"),
    Tactic("standing still", Aim.REST, stood_still, law="standing_still"),
    Tactic("stopping early", Aim.LESS, stopped, law="stopping_early"),
    Tactic("waiting", Aim.LESS, waited, law="waiting"),
    Tactic("running again", Aim.AGAIN, run_again, law="running_again"),
    Tactic("a calm run beside", Aim.LESS, calm_run_beside, law="running_again"),
)
"""In this order a round tries one variant of each."""
