"""A recording held against what its recorder attests."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ariac_score.logs.attested.chain import (
    Beats,
    chained,
    listed_by,
    mapping_of,
    refuse_other_counts,
    refuse_other_recording,
)
from ariac_score.logs.attested.matched import (
    around,
    at_most,
    less_from,
    matched_with,
    refuse_joined_publishers,
    unlisted_in,
)
from ariac_score.logs.attested.meaning import refuse_other_meaning
from ariac_score.logs.attested.recorded import Found, UnfitError, scanned
from ariac_score.logs.attested.times import (
    late_by_ns,
    refuse_moved_heartbeats,
    refuse_other_clock,
    refuse_other_pace,
)
from ariac_score.logs.gather.clocks import CLOCK_TOPIC
from ariac_score.trial.attestation import Attestation, Lacking, Unheard
from ariac_score.trial.spans import Span

__all__ = ["attestation_of"]


def attestation_of(path: Path, origin_ns: int) -> Attestation:
    """What the recorder of a recording attests.

    Args:
        path: The recording.
        origin_ns: Log time at trial time 0.

    Raises:
        LogError: It cannot be read.
    """
    found = scanned(path)
    closed = [manifest for manifest in found.manifests if manifest.closed]
    manifest = closed[-1] if closed else None
    try:
        if found.unfit:
            raise UnfitError(found.unfit)
        if manifest is None:
            raise UnfitError("its recorder did not close its manifest: it, or the bag before it, was stopped")
        return _held_against(found, manifest, origin_ns)
    except UnfitError as unfit:
        return Attestation(
            str(unfit),
            body="" if manifest is None else manifest.body,
            signature="" if manifest is None else manifest.signature,
        )


def _held_against(found: Found, manifest: Any, origin_ns: int) -> Attestation:
    stated = mapping_of(manifest.body, "the manifest")
    refuse_other_recording(found, manifest, stated)
    beats = chained(found, manifest.recording, stated)
    listed, spans = listed_by(beats, stated, origin_ns)
    refuse_other_counts(listed, stated)
    late_ns = late_by_ns(beats)
    refuse_moved_heartbeats(beats, late_ns)
    refuse_other_pace(beats)
    if CLOCK_TOPIC not in listed:
        refuse_other_clock(found.clock, beats, late_ns)
    meaning = refuse_other_meaning(found, stated)
    matched = matched_with(found, spans, origin_ns, late_ns)
    began_ns = beats[0][0] if beats else 0
    early = {topic: [m for m in one.early() if m.t_ns >= began_ns] for topic, one in matched.items()}
    lacking, unheard = [], []
    for topic, digests in sorted(listed.items()):
        missing = digests - found.digests.get(topic, Counter())
        late = [one for one in matched[topic].late(origin_ns) if missing[one[1]]] if topic in matched else []
        late = at_most(late, missing)
        unheard += [Lacking(topic, len(late), around([span for span, _ in late]))] if late else []
        if missing := missing - Counter(digest for _, digest in late):
            span = around([span for digest in missing for span in spans[topic, digest]])
            logged = found.logged.get(topic, ())
            logged_s = min(((one.t_ns - origin_ns) / 1e9 for one in logged), default=math.inf)
            arrived = (sorted(spans[topic, digest])[:n] for digest, n in missing.items())
            lacking.append(
                Lacking(
                    topic,
                    missing.total(),
                    span,
                    all=topic not in found.digests,
                    publishers=less_from(matched.get(topic), stated["topics"][topic]),
                    within=sum(one.start_s >= logged_s for every in arrived for one in every),
                )
            )
    lost, unlisted = _lost(stated), dict(unlisted_in(found, listed, beats, early))
    for topic in sorted(matched.keys() & listed.keys()):
        refuse_joined_publishers(topic, found.logged[topic], listed[topic], stated["topics"][topic])
    if beats:  # what neither the recorder nor the log has was sent all the same
        whole = around([span for every in spans.values() for span in every] or [Span(0.0, 0.0)])
        gone = {topic: n - unlisted.get(topic, 0) - len(early.get(topic, ())) for topic, n in lost.items()}
        lacking += [Lacking(topic, n, whole, within=n) for topic, n in sorted(gone.items()) if n > 0]
    return Attestation(
        lacking=tuple(lacking),
        late=tuple(unheard),
        early=frozenset(Unheard(topic, *one[:3]) for topic in early for one in early[topic]),
        unlisted=tuple(unlisted.items()),
        put_in=tuple(unlisted_in(found, listed, beats, early, lost)),
        moved=tuple((topic, n) for topic, one in matched.items() if (n := one.moved().total())),
        moved_by_s=late_ns / 1e9,
        unattested=tuple(sorted(found.digests.keys() - listed.keys())),
        body=manifest.body,
        signature=manifest.signature,
        undefined=meaning.undefined,
        uncompared=meaning.uncompared,
        listened=_listened(beats, origin_ns),
        notes=_notes(stated),
        trial=_name(stated, "trial"),
        team=_name(stated, "team"),
    )


def _listened(beats: Beats, origin_ns: int) -> Span | None:
    at_s = [(stamp_ns - origin_ns) / 1e9 for stamp_ns, _ in beats]
    return Span(min(at_s), max(at_s)) if at_s else None


def _notes(stated: Mapping[str, Any]) -> tuple[str, ...]:
    notes = stated.get("notes", [])
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise UnfitError("what its manifest notes is no list of texts")
    return tuple(notes)


def _name(stated: Mapping[str, Any], key: str) -> str:
    name = stated.get(key, "")
    if not isinstance(name, str):
        raise UnfitError(f"what its manifest gives as {key!r} is no text")
    return name


def _lost(stated: Mapping[str, Any]) -> dict[str, int]:
    """How many messages of each topic never reached the recorder, by their numbers."""
    found = {}
    for topic, block in stated["topics"].items():
        publishers = block.get("publishers") or {}
        lost = [one.get("lost") or 0 if isinstance(one, dict) else None for one in _values(publishers)]
        counts = [n for n in lost if isinstance(n, int) and 0 <= n < 1 << 63]
        if not isinstance(publishers, dict) or len(counts) < len(lost):
            raise UnfitError(f"its manifest does not say how many messages were lost on {topic!r}")
        found[topic] = sum(counts)
    return found


def _values(mapping: object) -> list[Any]:
    return [*mapping.values()] if isinstance(mapping, dict) else []
