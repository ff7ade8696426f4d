"""How much processor time the page of a ten-minute trial takes beyond reading its result, and its size.

python benchmarks/report.py [--rounds N]
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ariac_score import Body, Chart, Span, Trial, as_json, load_result
from ariac_score.report.html.trial import trial_page
from ariac_score.results.sketch import Sketch, sketch_of
from ariac_score.trial.signals import Signal

EXAMPLE = Path(__file__).parents[1] / "examples/kitting_near_miss.result.json"
SAMPLES, PEOPLE = 60_000, 4


def sketch() -> Sketch:
    """Ten minutes at 100 Hz of one robot and some people, with noise in every sample."""
    draw = np.random.default_rng(2020)
    t = np.arange(SAMPLES) / 100.0
    people = [f"person_{i}" for i in range(PEOPLE)]
    bodies = (Body("gantry", "robot"), *(Body(name, "human") for name in people))
    places = {
        f"position/{b.id}": Signal(
            f"position/{b.id}", "m", t, np.cumsum(draw.normal(0, 0.02, (SAMPLES, 3)), 0)
        )
        for b in bodies
    }
    charts = [
        Chart(
            f"gantry/{name}",
            "distance",
            "m",
            t,
            np.abs(draw.normal(9, 4, SAMPLES)),
            np.abs(draw.normal(3, 1, SAMPLES)),
        )
        for name in people
    ]
    moments = {("separation", c.subject): [Span(60.0 * k, 60.0 * k + 3) for k in range(9)] for c in charts}
    return sketch_of(Trial("ten minutes", bodies=bodies, signals=places), {"separation": charts}, moments)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    result = load_result(EXAMPLE)
    started = time.process_time()
    drawn = sketch()
    made_s = time.process_time() - started
    text = as_json(replace(result, measured=replace(result.measured, sketch=drawn)))
    with tempfile.TemporaryDirectory() as folder:
        stored = Path(folder) / "result.json"
        stored.write_text(text, encoding="utf-8")
        read, made, page = [], [], ""
        for _ in range(rounds):
            started = time.process_time()
            loaded = load_result(stored)
            between = time.process_time()
            page = trial_page(loaded, as_json(loaded))
            read.append(between - started)
            made.append(time.process_time() - between)
    first, *later = made
    print(f"sketch of {PEOPLE} curves and {PEOPLE + 1} routes of {SAMPLES} samples: {made_s:.2f} s")
    print(f"result {len(text.encode()) / 1e6:.2f} MB, page {len(page.encode()) / 1e6:.2f} MB")
    then = statistics.median(later)
    print(f"reading {statistics.median(read):.2f} s; page: first {first:.2f} s, then {then:.2f} s")


if __name__ == "__main__":
    main()
