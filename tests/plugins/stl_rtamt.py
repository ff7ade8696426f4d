"""Run by a Python that has rtamt: formulas and traces in on stdin, robustness out on stdout, as JSON."""

from __future__ import annotations

import json
import sys


def robustness(formula: str, period_s: float, columns: dict[str, list[float]]) -> list[float]:
    import rtamt  # noqa: PLC0415  # the tests collect this file where there is none

    specification = rtamt.StlDiscreteTimeSpecification()
    for name in (*columns, "out"):
        specification.declare_var(name, "float")
    specification.set_sampling_period(round(period_s * 1000), "ms", 0.1)
    specification.spec = f"out = {formula}"
    specification.parse()
    n = len(next(iter(columns.values())))
    computed = specification.evaluate({"time": [k * period_s for k in range(n)], **columns})
    return [value for _, value in computed]


if __name__ == "__main__":
    cases = json.load(sys.stdin)
    json.dump([robustness(case["formula"], case["period_s"], case["columns"]) for case in cases], sys.stdout)
