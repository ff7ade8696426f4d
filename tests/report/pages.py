"""Results that the tests make pages of: the committed example, one with routes, one with hostile names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ariac_score import (
    Body,
    Chart,
    Provenance,
    Result,
    Trial,
    as_json,
    load_result,
    measure_trial,
    price_trial,
    score_trial,
)
from ariac_score.engine.measure import sketch_trial
from ariac_score.engine.prepared import prepare
from ariac_score.report.html.trial import trial_page
from ariac_score.results.result import Pinned, Setting, Settings, Source
from ariac_score.testing import write_trial_log
from ariac_score.trial.spans import FloatArray
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, WantedProduct

EXAMPLE = Path(__file__).parents[2] / "tests/data/as_published/kitting_near_miss.result.json"

SCRIPT = "<script>alert('script')</script>"
IMAGE = '"><img src=x onerror=alert("image")>'
RIGHT_TO_LEFT = "\u202egnp.exe\u202c \u05e9\u05dc\u05d5\u05dd"
LONG = "x" * 10_000
FORMULA = "=cmd('calc')!A0"
LINES = "one\ntwo\r\nthree\x1b[31m"
HOSTILE = (SCRIPT, IMAGE, RIGHT_TO_LEFT, LONG, FORMULA, LINES, "</script><!--", "../../etc/passwd")


def example() -> Result:
    return load_result(EXAMPLE)


def with_routes(folder: Path) -> Result:
    """The example with every signal it has, so that there is a plan as well."""
    return score_trial(write_trial_log(folder / "routes.jsonl", kitting_trial()), "paper2020.published")


def hostile() -> Result:
    """The example with hostile text wherever a log can put any."""
    trial, prepared = _renamed(kitting_trial()), prepare("paper2020.published")
    measured = measure_trial(trial, prepared)
    sketch = sketch_trial(trial, prepared, measured)
    result = price_trial(replace(measured, sketch=sketch), prepared.rule_set, _provenance())
    measured = result.measured
    findings = {
        key: replace(finding, message=HOSTILE[i % len(HOSTILE)], clause=IMAGE, labels={"by": SCRIPT})
        for i, (key, finding) in enumerate(measured.findings.items())
    }
    return replace(
        result,
        rule_set_title=IMAGE,
        notes=HOSTILE,
        measured=replace(
            measured,
            team=SCRIPT,
            trial=IMAGE,
            clock=LONG,
            unrecorded=HOSTILE,
            findings=findings,
            settings=dict.fromkeys(result.checks, _settings()),
        ),
    )


def _settings() -> Settings:
    return Settings(LONG, tuple(Setting(text, [text], "m", "default", IMAGE, text) for text in HOSTILE))


def _provenance() -> Provenance:
    return Provenance(
        (Source("log", SCRIPT, 1, "0" * 64),), HOSTILE, Pinned(IMAGE, "1" * 64), Pinned(LONG, "2" * 64), ()
    )


def _renamed(trial: Trial) -> Trial:
    bodies = {"robot": "rob<b>ot", "human": "hum&quot;an"}
    signals = {}
    for name, signal in trial.signals.items():
        new = name
        for old, other in bodies.items():
            new = new.replace(old, other)
        signals[new] = replace(signal, name=new)
    orders, submissions = [], []
    for i, order in enumerate(trial.work):
        (task,) = order.tasks
        name = f"{HOSTILE[i]}".replace("/", "|")
        products = tuple(
            WantedProduct(p.slot, HOSTILE[(i + j) % len(HOSTILE)], p.pose)
            for j, p in enumerate(task.products)
        )
        orders.append(Order(name, (Task(f"{name}_0", products=products, agv=task.agv),), order.announced_s))
        submissions.append(
            KitSubmission(
                f"{name}_0", 14.0 + i, tuple(Product(word, products[0].pose) for word in HOSTILE), "agv1"
            )
        )
    return replace(
        trial,
        id=SCRIPT,
        bodies=tuple(Body(bodies[b.id], b.kind, b.radius_m) for b in trial.bodies),
        signals=signals,
        work=tuple(orders),
        submissions=tuple(submissions),
    )


def write_page(folder: Path, result: Result) -> Path:
    file = folder / "trial.html"
    file.write_text(trial_page(result, as_json(result)), encoding="utf-8")
    return file


def noisy_charts(draw: np.random.Generator, t: FloatArray, people: int) -> list[Chart]:
    """Charts that nothing can be left out of: noise, of a gantry and some people."""
    return [
        Chart(
            f"gantry/person_{i}",
            "distance",
            "m",
            t,
            np.abs(draw.normal(9, 4, len(t))),
            np.abs(draw.normal(3, 1, len(t))),
        )
        for i in range(people)
    ]
