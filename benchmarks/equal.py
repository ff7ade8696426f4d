"""Whether two checkouts say the same of every example, case, vector and recording.

    python benchmarks/equal.py BASE_CHECKOUT [NEW_CHECKOUT]

Each checkout wants a `.venv` with an editable install of itself. Everything goes through the command
line and the JSON that it prints, so a checkout may be built inside as it likes. What is scored is made
or taken once, from the base: its examples, its golden cases, the trials that its tests of cases and
vectors build, and the recordings of `../shared` beside it.

Run it with the Python of the new checkout, which reads documents of both. Left out are the version of
the form, the digits that it keeps, and which code made a result (names of packages, hashes). Numbers
must be equal as they are stored; what is absent, null or empty is one.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from decimal import Decimal
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

HARNESSES = ("official_vectors", "official_cases", "worked_cases")
"""The tests of the base whose trials are taken."""

LEFT_OUT = {"schema", "format", "rounding", "digits", "code", "sha256", "signature"}

Job = dict[str, Any]


def main() -> int:
    """Compare two checkouts, or do one part of it inside one of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("base", type=Path, metavar="BASE_CHECKOUT")
    parser.add_argument("new", type=Path, nargs="?", default=Path(), metavar="NEW_CHECKOUT")
    parser.add_argument("--work", type=Path, metavar="DIR", help="keep what is made here")
    parser.add_argument(
        "--allow",
        action="append",
        default=[],
        metavar="GLOB",
        help="fields that may differ, such as 'findings.*.message'; they are still counted",
    )
    parser.add_argument("--only", default="*", metavar="GLOB", help="groups to compare, such as 'bags'")
    parser.add_argument("--part", choices=["inputs", "run"], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.part:
        sys.path = [folder for folder in sys.path if Path(folder) != Path(__file__).parent]
        (make_inputs if arguments.part == "inputs" else run_jobs)(arguments.work, arguments.base)
        return 0
    with contextlib.ExitStack() as stack:
        work = arguments.work or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        return compared(arguments.base.resolve(), arguments.new.resolve(), work.resolve(), arguments)


def compared(base: Path, new: Path, work: Path, arguments: argparse.Namespace) -> int:
    """Run both and print what differs."""
    work.mkdir(parents=True, exist_ok=True)
    if not (work / "jobs.json").is_file() and inside(base, "inputs", work, work / "made.log").wait():
        return 2
    before, after = work / "base.jsonl", work / "new.jsonl"
    running = [inside(base, "run", work, before), inside(new, "run", work, after)]
    codes = [process.wait() for process in running]
    if any(codes):
        print("error: one of the versions did not get through", file=sys.stderr)
        return 2
    return told(json.loads((work / "jobs.json").read_text()), before, after, arguments)


def inside(checkout: Path, part: str, work: Path, out: Path) -> subprocess.Popen[bytes]:
    """Start one part with the interpreter of a checkout."""
    python = checkout / ".venv/bin/python"
    if not python.exists():
        sys.exit(f"error: {checkout} has no .venv with an editable install of itself")
    with out.open("wb") as file:
        command = [python, Path(__file__).resolve(), checkout, "--part", part, "--work", work]
        environment = {**os.environ, "COLUMNS": "100"}
        return subprocess.Popen(command, cwd=checkout, stdout=file, env=environment)


# What is scored ------------------------------------------------------------------------


def make_inputs(work: Path, base: Path) -> None:
    """Write what the base has to be scored, and the command lines."""
    shared = base.parent / "shared"
    jobs = [
        *of_examples(base),
        *of_recordings(shared),
        *of_official_texts(shared, base),
        *of_rml(shared),
        *of_golden_cases(base, work / "golden"),
        *of_harnesses(base, work / "cases"),
    ]
    (work / "jobs.json").write_text(json.dumps(jobs, indent=1), encoding="utf-8")


def job(group: str, name: str, argv: Iterable[object], folder: Path | None = None) -> Job:
    return {"group": group, "name": name, "argv": [str(word) for word in argv], "cwd": str(folder or "")}


def score(group: str, log: Path, rules: object) -> Job:
    argv = ["score", log, "--rules", rules, "--output-format", "json"]
    return job(group, f"{log.name} by {rules}", argv)


def shipped_rules(base: Path) -> list[str]:
    files = (base / "rules").rglob("*.yaml")
    names = {f.parent.name if f.stem == "ruleset" else f"{f.parent.name}.{f.stem}" for f in files}
    return sorted(n for n in names if not n.startswith("penalty.") and not n.endswith(".log_map"))


def of_examples(base: Path) -> Iterator[Job]:
    examples = base / "examples"
    own = [
        examples / "all_monitors.yaml",
        *(examples / "rml").glob("*.yaml"),
        examples / "live/four_ways.yaml",
    ]
    for rules in [*shipped_rules(base), *sorted(own)]:
        yield score("examples", examples / "kitting_near_miss.mcap", rules)
    for file in sorted(examples.rglob("competition.yaml")):
        for policy in ("robust", "strict"):
            argv = ["rank", file, "--policy", policy, "--output-format", "json"]
            yield job("examples", f"rank {file.parent.name} {policy}", argv)
        for log in sorted((file.parent / "logs").glob("*/*")):
            yield score("examples", log, f"ariac{file.parent.name}.official")


def of_recordings(shared: Path) -> Iterator[Job]:
    for log in sorted((shared / "real").glob("*.bag")):
        for rules in ("paper2020", "ariac2020.as_coded", "ariac2020.as_documented"):
            yield score("real", log, rules)
    for log in sorted((shared / "bags").rglob("*")):
        named = log.name.partition(".expected")[0]
        recording = log.name == named and log.suffix not in {".md", ".yaml"}
        if (log / "metadata.yaml").exists() or (log.is_file() and recording):
            yield score("bags", log, "paper2020")
            yield job("bags", f"info {log.name}", ["info", log])


def of_official_texts(shared: Path, base: Path) -> Iterator[Job]:
    team = shared / "ariac/data/nist_team_2022"
    texts = [*(shared / "ariac/data/found").glob("*.log"), *(base / "tests/data").glob("*.log"), team]
    for text in sorted(texts):
        yield job("texts", f"audit {text.name}", ["audit", text, "--output-format", "json"])
        for rules in shipped_rules(base):
            if rules.endswith(".official") or (text == team and rules.startswith("ariac2022")):
                yield score("texts", text, rules)


def of_rml(shared: Path) -> Iterator[Job]:
    for spec in sorted((shared / "rml/cases").rglob("*.rml")):
        yield job("rml", f"format {spec.name}", ["rml", "format", spec])
        for trace in sorted(spec.parent.glob(f"{spec.stem}.*.jsonl")):
            yield job("rml", f"run {trace.name}", ["rml", "run", spec, trace])


def of_golden_cases(base: Path, folder: Path) -> Iterator[Job]:
    import runpy  # noqa: PLC0415  # only inside the base

    for name, make in sorted(runpy.run_path(str(base / "tests/golden_cases.py"))["CASES"].items()):
        (folder / name).mkdir(parents=True)
        argv = make(folder / name)
        if argv[0] in {"score", "audit", "rank"} and "--output-format" not in argv:
            argv = [*argv, "--output-format", "json"]
        yield job("golden", name, argv, folder / name)


# Trials of tests -----------------------------------------------------------------------


def of_harnesses(base: Path, folder: Path) -> Iterator[Job]:
    """Run the base's tests and write each trial that they measure as a trial log."""
    import pytest  # noqa: PLC0415  # only inside the base

    for name in HARNESSES:
        taken = Taken()
        with contextlib.redirect_stdout(sys.stderr):
            pytest.main(
                ["-q", "-n0", "-pno:cacheprovider", f"{base}/tests/cases/test_{name}.py"], plugins=[taken]
            )
        (folder / name).mkdir(parents=True)
        for (digest, rules), lines in sorted(taken.logs.items()):
            log = folder / name / f"{digest}.jsonl"
            log.write_text(lines, encoding="utf-8")
            yield score(name, log, rules)


class Taken:
    """A plugin of pytest that keeps the trials that are measured under shipped rule sets."""

    def __init__(self) -> None:
        self.logs: dict[tuple[str, str], str] = {}

    def pytest_collection_finish(self, session: Any) -> None:
        for module in {item.module for item in session.items if hasattr(item, "module")}:
            if hasattr(module, "measure_trial"):
                module.measure_trial = self.keeping(module.measure_trial)

    def keeping(self, measure: Any) -> Any:
        def measured(trial: Any, checks: Any, *, rule_set: Any, **others: Any) -> Any:
            lines = trial_log(trial)
            digest = hashlib.sha256(lines.encode()).hexdigest()[:16]
            self.logs[digest, rule_set.id] = lines
            return measure(trial, checks, rule_set=rule_set, **others)

        return measured


def trial_log(trial: Any) -> str:
    """A trial without signals in the published format of trial logs."""
    head = {"record": "trial", "format": "ariac-score-trial-log/1", "id": "case", "clock": trial.clock}
    records: list[dict[str, Any]] = [{**head, "witnessed": sorted(trial.witnessed)}]
    records += sorted([*timed(trial)], key=lambda record: record["t_s"] or 0.0)
    records.append({"record": "end", "records": len(records) + 1})
    return "".join(f"{json.dumps(record)}\n" for record in records)


def timed(trial: Any) -> Iterator[dict[str, Any]]:
    for order in getattr(trial, "work", None) or trial.orders:
        fields = {"id": order.id, "priority": order.priority, "tasks": [*map(task_record, order.tasks)]}
        updates = {"updates": order.updates} if order.updates else {}
        yield {"record": "order", "t_s": order.announced_s, **fields, **updates}
    for event in trial.events:
        if event.kind != "order_announced":
            fields = {"kind": event.kind, "subject": event.subject, "detail": event.detail}
            yield {"record": "event", "t_s": event.t_s, **fields}
    for s in trial.submissions:
        fields = {"task_id": s.task_id, "agv": s.agv, "station": s.station, **tray_record(s.tray)}
        if s.contents is not None:
            fields["contents"] = [*map(product_record, s.contents)]
        yield {"record": "submission", "t_s": s.submitted_s, **fields}


def task_record(task: Any) -> dict[str, Any]:
    products = []
    for wanted in task.products:
        fields = {"slot": wanted.slot, "type": wanted.type, **pose_record(wanted.pose)}
        if wanted.quadrant:
            fields["quadrant"] = wanted.quadrant
        if wanted.challenged is not None:
            fields["challenged"] = wanted.challenged
        products.append(fields)
    place = {"agv": task.agv, "station": task.station, **tray_record(task.tray)}
    return {"id": task.id, "kind": task.kind, **place, "products": products}


def product_record(product: Any) -> dict[str, Any]:
    fields = {"type": product.type, "name": product.name, "faulty": product.faulty}
    return {**fields, **pose_record(product.pose)}


def tray_record(tray: Any) -> dict[str, Any]:
    return {} if tray is None else {"tray": {"type": tray.type, **pose_record(tray.pose)}}


def pose_record(pose: Any) -> dict[str, Any]:
    if pose is None:
        return {}
    return {"pose": {"position_m": [*pose.position_m], "orientation_wxyz": [*pose.orientation_wxyz]}}


# What a checkout says ------------------------------------------------------------------


def run_jobs(work: Path, checkout: Path) -> None:
    """Print of each command line the exit code and what it prints, one JSON object a line."""
    from ariac_score.cli import main as ariac_score  # noqa: PLC0415  # of the checkout

    for number, asked in enumerate(json.loads((work / "jobs.json").read_text())):
        os.chdir(asked["cwd"] or checkout)
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = ariac_score(asked["argv"])
            except SystemExit as left:  # argparse leaves this way
                code = left.code
        said = {"exit": code, "stdout": out.getvalue(), "stderr": err.getvalue()}
        print(json.dumps(said), flush=True)
        if number % 500 == 499:
            print(f"{checkout}: {number + 1} commands", file=sys.stderr)


# Comparing -----------------------------------------------------------------------------


def told(jobs: list[Job], base: Path, new: Path, arguments: argparse.Namespace) -> int:
    """Print what was compared and each kind of difference once, with where it was seen first."""
    seen: dict[str, list[str]] = defaultdict(list)
    groups: dict[str, Counter[str]] = defaultdict(Counter)
    with base.open() as one, new.open() as other:
        for asked, a, b in zip(jobs, one, other, strict=True):
            if not fnmatch(asked["group"], arguments.only):
                continue
            before, after = document(json.loads(a)), document(json.loads(b))
            groups[asked["group"]].update(counts(before))
            for path in sorted(before.keys() | after.keys()):
                if before.get(path) != after.get(path):
                    where = f"{asked['group']}, {asked['name']}: {path}"
                    seen[general(path)].append(f"{where}: {before.get(path)!r} -> {after.get(path)!r}")
    for group, counted in groups.items():
        print(f"{group}: " + ", ".join(f"{number} {what}" for what, number in counted.items()))
    allowed = {path for path in seen if any(fnmatch(path, pattern) for pattern in arguments.allow)}
    for path, places in seen.items():
        word = "allowed" if path in allowed else "DIFFERS"
        print(f"{word}: {path} ({len(places)}), as in {places[0][:600]}")
    refused = sum(len(places) for path, places in seen.items() if path not in allowed)
    print(f"{refused} differences in {sum(c['commands'] for c in groups.values())} commands")
    return 1 if refused else 0


def document(said: Mapping[str, Any]) -> dict[str, object]:
    """What was printed, one value for each path, read from either form of a stored document."""
    found: dict[str, object] = {"exit": said["exit"]}
    try:
        text = as_of_today(said["stdout"])
        stored = json.loads(text, parse_float=Decimal, parse_int=Decimal)
    except ValueError:
        found["stdout"] = said["stdout"]
    else:
        found.update(values_of(stored, ""))
    return {path: value for path, value in found.items() if value not in (None, "")}


def as_of_today(text: str) -> str:
    """A stored document in the form of this version, whichever wrote it; other texts as they are."""
    # Not at the top: this file is run inside the base as well, which has no such module.
    from ariac_score.schemas.__main__ import FORMATS  # noqa: PLC0415

    from ariac_score.errors import ScoreError  # noqa: PLC0415

    schema = str(json.loads(text).get("schema", "")) if text.startswith("{") else ""
    for stored in FORMATS:
        if schema.startswith(f"ariac-score/{stored.name}/"):
            with contextlib.suppress(ScoreError):  # a form that is not read any more is compared as it stands
                return stored.text(stored.decoded(text.encode("utf-8"), Path(schema)))
    return text


def values_of(stored: Any, path: str) -> Iterator[tuple[str, object]]:
    if isinstance(stored, dict):
        for key, value in stored.items():
            if key not in LEFT_OUT:
                yield from values_of(value, f"{path}.{key}" if path else key)
    elif isinstance(stored, list):
        for number, value in enumerate(stored):
            yield from values_of(value, f"{path}.{number}")
    else:
        yield path, stored


def general(path: str) -> str:
    """The path without numbers of places in lists and names of checks."""
    words = ["*" if word.isdigit() or "#" in word else word for word in path.split(".")]
    return ".".join(words)


def counts(document: Mapping[str, object]) -> Counter[str]:
    paths = document.keys()
    return Counter(
        {
            "commands": 1,
            "scores": "score" in paths,
            "findings": sum(".findings." in path and path.endswith(".verdict") for path in paths),
            "ledger lines": sum("ledger" in path and path.endswith(".kind") for path in paths),
            "values": len(paths),
        }
    )


if __name__ == "__main__":
    sys.exit(main())
