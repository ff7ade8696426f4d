"""How much memory do monitors need beyond the trial they judge, and how does it grow?

The peak of what Python and numpy allocate while monitors judge a trial of a robot with 30 links and
3 humans at 100 Hz, with everything that is derived for them: each alone, and one after the other.

    python benchmarks/memory.py [--samples 60000]
"""

from __future__ import annotations

import argparse
import gc
import platform
import time
import tracemalloc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from separation import tracks, trial_of

from ariac_score import Trial
from ariac_score.checks.registry import Registry
from ariac_score.trial.derive import Derivation, derive_signals

SQUARE = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]]
PAIR = {"v": "speed/{robot}", "d": "separation/{robot}/{human}"}
MONITORS: Sequence[tuple[str, Mapping[str, Any]]] = [
    ("iso_ts_15066.ssm_separation", {}),
    ("iso_ts_15066.ssm_separation", {"profile": "standard"}),
    ("iso_ts_15066.ssm_speed_cap", {"profile": "standard"}),
    ("iso_ts_15066.ssm_response", {"profile": "standard"}),
    ("ariac.human_contact", {}),
    ("iso_10218_1.reduced_speed", {}),
    ("iso_10218_1.space_limit", {"area": SQUARE}),
    ("iso_10218_2.pfl_speed", {"region": "chest", "when": "near", "near_m": 1.0}),
    ("iso_10218_2.monitored_standstill", {"workspace": SQUARE}),
    ("iso_13855.safeguard_distance", {"line": [[-9.0, -4.0], [9.0, -4.0]], "hazard": SQUARE}),
    ("proxemics.proximity_comfort", {}),
    ("log.signal_coverage", {"quantities": ["position", "speed"]}),
    ("formula.always", {"holds": "d >= 0.5 * v + 0.3", "signals": PAIR, "unit": "m"}),
    (
        "stl.formula",
        {
            "formula": "always (d < 1 -> eventually[0,0.1] v < 0.5)",
            "signals": {"d": "separation in m", "v": "speed of robot in m/s"},
        },
    ),
    (
        "rml.spec",
        {
            "spec": "apart matches {topic: 'gap', d: d} with d >= 0.8; Main = apart*;",
            "events": {"gap": {"d": "separation/{robot}/{human} [m]"}},
        },
    ),
]


def judged(monitors: Sequence[Any], trial: Trial) -> tuple[float, float]:
    """The peak beyond the trial, MB, and the processor time, s."""
    gc.collect()
    tracemalloc.start()
    begun = time.process_time()
    wanted = [Derivation(need.quantity, need.max_gap_s) for one in monitors for need in one.needs()]
    derived = derive_signals(trial, wanted)
    for monitor in monitors:
        list(monitor.watch(derived))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6, time.process_time() - begun


def main() -> None:
    """Print the peaks, and the bytes that each further sample of time takes."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=60_000)
    samples = parser.parse_args().samples
    trials = [trial_of(tracks(n, seed=15066), n) for n in (samples, 2 * samples)]
    print(f"{samples} and {2 * samples} samples; Python {platform.python_version()}, numpy {np.__version__}")
    monitors = [Registry().find("ariac_score.monitors", use).build(given) for use, given in MONITORS]
    judged(monitors, trials[0])  # what is loaded once is no matter
    names = [f"{use} {' '.join(given.get(key, '') for key in ('profile',))}" for use, given in MONITORS]
    for name, some in (*zip(names, ([one] for one in monitors), strict=True), ("all of them", monitors)):
        (peak_mb, spent_s), (longer_mb, _) = (judged(some, trial) for trial in trials)
        growth = (longer_mb - peak_mb) * 1e6 / samples
        print(f"{name:42} {peak_mb:6.1f} MB  {growth:5.0f} bytes for each further sample  {spent_s:5.2f} s")


if __name__ == "__main__":
    main()
