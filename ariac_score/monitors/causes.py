"""Why something is open, in words: the gaps of each source that make a difference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ariac_score.checks.open_findings import MOST_SPANS, Cause, gaps_in_words, standing_for
from ariac_score.monitors.cells import TOLERANCE_S, Stream
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, Span, merged
from ariac_score.trial.vocabulary import signal_in_words

__all__ = ["causes_of_cells", "causes_of_spans"]


def causes_of_cells(
    opened: Sequence[Stream],
    window: Span,
    remarks: tuple[str, ...],
    differing: Sequence[tuple[FloatArray, FloatArray]] = (),
) -> tuple[Cause, ...]:
    """Why something is open: for each source its open intervals in which the worlds differ, or all."""
    sources: dict[str, list[FloatArray]] = {}
    places = {_source(stream.signal): _place(stream.signal) for stream in opened}
    for stream in opened:
        sources.setdefault(_source(stream.signal), []).append(stream.edges(window))
    found, late = [], _late(opened)
    for source, several in sorted(sources.items()):
        # Signals of one message have the same intervals.
        starts, ends = np.unique(np.concatenate(several, axis=1), axis=1)
        own = [stream for stream in opened if _source(stream.signal) == source]
        if not len(starts):  # nothing lacks, but it shows less than what it stands for
            found.append(Cause(f"every interval {places[source]}{_instead(own)}", source))
            continue
        matters = np.zeros(len(starts), dtype=bool)
        for begins, until in differing:
            row = np.searchsorted(until, starts, side="right")
            matters |= (row < len(begins)) & (np.append(begins, np.inf)[row] < ends)
        if matters.any() or not any(len(begins) for begins, _ in differing):
            kept = matters if matters.any() else np.ones(len(starts), dtype=bool)
            spans = [Span(float(a), float(b)) for a, b in zip(starts[kept], ends[kept], strict=True)]
            stored = spans if len(spans) <= MOST_SPANS else merged(spans, within_s=TOLERANCE_S)[:MOST_SPANS]
            remarks_of = (late.get(source, ""), _thinned(own), _outermost(own, spans), _instead(own))
            words = f"{gaps_in_words(spans)} {places[source]}{''.join(remarks_of)}"
            found.append(Cause(words, source, tuple(stored)))
    return (*found, *(Cause(remark) for remark in remarks))


def causes_of_spans(opened: Sequence[Stream], spans: Sequence[Span]) -> tuple[Cause, ...]:
    """Why the same spans are open of all streams."""
    places = dict(sorted((_source(stream.signal), _place(stream.signal)) for stream in opened))
    source = next(iter(places)) if len(places) == 1 else ""
    whole = Span(spans[0].start_s, spans[-1].end_s)
    # Where each interval is open they are one stretch, and no gap: nothing lacks.
    each = sorted({one for stream in opened if not stream.held_s for one in stream.spans(whole)})
    words = gaps_in_words(each if len(each) > len(spans) else spans)
    return (Cause(f"{words} {' and '.join(places.values())}", source, tuple(spans[:MOST_SPANS])),)


def _source(signal: Signal) -> str:
    return signal.source or signal.name


def _place(signal: Signal) -> str:
    """Where samples lack: on the topic, which whoever records can act on, or in what was measured."""
    return f"on {signal.source}" if signal.source else f"in the {signal_in_words(signal.name)}"


def _late(opened: Sequence[Stream]) -> dict[str, str]:
    """Of sources that nobody stamped, how late their messages came: bounds are as much wider."""
    found: dict[str, float] = {}
    for stream in opened:
        source = _source(stream.signal)
        found[source] = max(found.get(source, 0.0), stream.signal.stamp_jitter_s)
    return {
        source: f", stamped on arrival up to {1000.0 * late_s:.0f} ms late"
        for source, late_s in found.items()
        if late_s >= 0.0005
    }


def _outermost(own: Sequence[Stream], spans: Sequence[Span]) -> str:
    """That a gap of a source is before all that was recorded of it, or after it; empty where none is."""
    first_s = min((float(one.t[0]) for one in own if len(one.t)), default=-math.inf)
    last_s = max((float(one.t[-1]) for one in own if len(one.t)), default=math.inf)
    before = ", one before its first message" if spans[0].end_s <= first_s else ""
    return before + (", one after its last message" if spans[-1].start_s >= last_s else "")


def _thinned(own: Sequence[Stream]) -> str:
    """That a source is recorded less often than it is published, in words; empty where it is not."""
    published_s = max((one.published_s for one in own), default=0.0)
    return f", which is published every {1000.0 * published_s:g} ms" if published_s else ""


def _instead(own: Sequence[Stream]) -> str:
    """That a source stands for a topic that was not recorded, in words; empty where it does not."""
    topics = sorted({one.stands_for for one in own} - {""})
    return f" {standing_for(topics)}" if topics else ""
