"""The manifest and the heartbeats of a recorder, each of which follows from the one before."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import Any, TypeAlias

from ariac_score.documents.schema import strict_json
from ariac_score.logs.attested.recorded import DIGEST_CHARS, Found, UnfitError
from ariac_score.trial.spans import Span

__all__ = ["Beats", "chained", "listed_by", "mapping_of", "refuse_other_counts", "refuse_other_recording"]

FORMAT = "ariac-score-manifest/1"

Beats: TypeAlias = "list[tuple[int, Mapping[str, Any]]]"
"""The heartbeats in order, each with its log time, ns."""


def mapping_of(body: str, what: str) -> Any:
    """The mapping that a body of JSON is."""
    try:
        content = strict_json(body)
    except (ValueError, RecursionError) as cause:
        raise UnfitError(f"{what} is no JSON: {cause}") from None
    if not isinstance(content, dict):
        raise UnfitError(f"{what} is no mapping")
    return content


def refuse_other_recording(found: Found, manifest: Any, stated: Mapping[str, Any]) -> None:
    """Refuse a manifest of another format or recording, and a log with the words of several recorders."""
    if stated.get("format") != FORMAT:
        raise UnfitError(f"its manifest has the format {stated.get('format')!r}, not {FORMAT!r}")
    names = {beat.recording for _, beat in found.heartbeats} | {m.recording for m in found.manifests}
    if stated.get("recording") != manifest.recording or names != {manifest.recording}:
        others = sorted(names - {manifest.recording})
        words = f"recording {others[0]!r} is in it as well" if others else "it states another recording"
        raise UnfitError(f"its manifest is of recording {manifest.recording!r}, and {words}")


def chained(found: Found, recording: str, stated: Mapping[str, Any]) -> Beats:
    """The heartbeats in order, with their log times; each chain follows from the one before."""
    beats, chain = [], recording
    for number, (stamp_ns, beat) in enumerate(sorted(found.heartbeats, key=lambda b: b[1].sequence), start=1):
        if beat.sequence != number:
            raise UnfitError(f"heartbeat {number} of its recorder is missing, or there twice")
        chain = hashlib.sha256((chain + beat.body).encode("utf-8")).hexdigest()
        content = mapping_of(beat.body, f"heartbeat {number}")
        if (beat.chain, content.get("sequence"), content.get("recording")) != (chain, number, recording):
            raise UnfitError(f"the chain of its recorder breaks at heartbeat {number}")
        beats.append((stamp_ns, content))
    last = stated.get("heartbeats")
    if not isinstance(last, dict) or (last.get("count"), last.get("chain")) != (len(beats), chain):
        raise UnfitError("the chain of its heartbeats does not end as its manifest says")
    return beats


def listed_by(
    beats: Beats, stated: Mapping[str, Any], origin_ns: int
) -> tuple[dict[str, Counter[str]], dict[tuple[str, str], list[Span]]]:
    """The digests of every topic that was listened to, and between which heartbeats each arrived."""
    topics = stated.get("topics")
    if not isinstance(topics, dict):
        raise UnfitError("its manifest lists no topics")
    listed: dict[str, Counter[str]] = {topic: Counter() for topic in topics}
    spans: dict[tuple[str, str], list[Span]] = defaultdict(list)
    before_s = None
    for number, (stamp_ns, content) in enumerate(beats, start=1):
        at_s = (stamp_ns - origin_ns) / 1e9
        span = Span(at_s if before_s is None else min(at_s, before_s), at_s)
        arrived = content.get("topics")
        if not isinstance(arrived, dict):
            raise UnfitError(f"heartbeat {number} of its recorder has no topics")
        for topic, block in arrived.items():
            if topic not in listed or not isinstance(block, dict):
                raise UnfitError(f"heartbeat {number} lists {topic!r}, and its manifest does not")
            text, first = block.get("digests"), block.get("first")
            if not isinstance(text, str) or len(text) % DIGEST_CHARS or first != listed[topic].total() + 1:
                raise UnfitError(f"heartbeat {number} does not count on from the one before on {topic!r}")
            for start in range(0, len(text), DIGEST_CHARS):
                digest = text[start : start + DIGEST_CHARS]
                listed[topic][digest] += 1
                spans[topic, digest].append(span)
        before_s = at_s
    return listed, spans


def refuse_other_counts(listed: Mapping[str, Counter[str]], stated: Mapping[str, Any]) -> None:
    """Refuse a manifest that counts other messages than its heartbeats."""
    for topic, block in stated["topics"].items():
        if not isinstance(block, dict) or block.get("count") != listed[topic].total():
            raise UnfitError(f"its manifest and its heartbeats count other messages on {topic!r}")
