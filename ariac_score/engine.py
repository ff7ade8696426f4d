"""From a path to a result: measure with plugins, price with the rule set.

Measuring needs the log and knows no points; pricing needs only what was measured.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from threading import Event

from ariac_score.asking import ask, courses_of
from ariac_score.contracts import Monitor, Reader, Rule, SignalNeed, Wanted
from ariac_score.errors import (
    DataFileError,
    FormulaError,
    LogError,
    LogMapError,
    NothingToScoreError,
    PluginError,
    RuleSetError,
    RunEndedError,
)
from ariac_score.findings import Finding, Verdict
from ariac_score.guard import GuardedDecoder, open_readers
from ariac_score.installed import version_of
from ariac_score.logmap import load_log_map
from ariac_score.logs.bundle import Bundle, Part, find_parts, name_from, with_parts
from ariac_score.logs.config_forms import form_in
from ariac_score.logs.product_types import unknown_products
from ariac_score.logs.ranged import ranged
from ariac_score.needs import check_needs, needs_of, needs_of_all, refuse_other_units
from ariac_score.registry import Registry, package_sha256
from ariac_score.result import (
    Coverage,
    Measured,
    Provenance,
    Result,
    Settings,
    Source,
    canonical,
    declared_units,
)
from ariac_score.ruleset import Check, RuleSet, expanded_yaml, load_rule_set
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.pricing import price
from ariac_score.scoring.scope import Scope
from ariac_score.settings import settings_of
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap
from ariac_score.trial.derive import Derivation, derive_signals, source_quantities
from ariac_score.trial.events import ORDER_ANNOUNCED
from ariac_score.trial.kits import with_contents
from ariac_score.trial.model import TeamSetup, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.sketch import Sketch, sketch_of
from ariac_score.trial.spans import Span, longest_silence_s
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

__all__ = [
    "check_configuration",
    "check_needs",
    "code_of",
    "decidable",
    "file_hashes",
    "find_trial",
    "measure_trial",
    "needs_alike",
    "price_trial",
    "read_trial",
    "refuse_other_years",
    "reprice",
    "score_trial",
    "sketch_trial",
    "topics_read",
]

Progress = Callable[[float], None]

ENDED_WITHOUT_SCORE: Mapping[str, str] = {
    "crashed": "the simulator died during this run, and no score was recorded",
    "cancelled": "the run was cancelled by its user, and no score was recorded",
}
"""The outcomes after which the official text holds no score."""

_WORTH_A_THREAD_BYTES = 1 << 23
_HASHED_BLOCK_BYTES = 1 << 18


def _no_progress(_done: float) -> None:
    """Show nothing."""


def score_trial(
    path: Path,
    rules: str | RuleSet,
    *,
    log_map: str = "",
    registry: Registry | None = None,
    progress: Progress = _no_progress,
    also: Sequence[Path] = (),
    binding: bool = False,
    root: Path | None = None,
    trial_id: str = "",
    team: str = "",
    jobs: int = 0,
    known: Result | None = None,
) -> Result:
    """Score the trial at a path; where its rules compare teams, `reprice` adds the cohort.

    Args:
        path: A log, a rosbag2 folder, a bundle folder, or a `bundle.yaml`.
        rules: A rule set or its name.
        log_map: Log map to use instead of the rule set's own.
        registry: The installed plugins, where the caller has them already.
        progress: Called with the share done, 0 to 1.
        also: Configurations of the trial or team that lie elsewhere; where the path has
            one of its own, that one counts.
        binding: Whether those of `also` count even then, as for whoever does not trust the path.
        root: Folder that file names in the result are relative to; needed with `also`.
        trial_id: Name of the trial, where the caller knows it better than the files.
        team: Name of the team, likewise.
        jobs: Threads that read a recording, one of which decodes; 0: as many as there are processors. The
            result does not depend on it.
        known: A result of the same files by the same code, whose checks ask for the same
            signals (`needs_alike`): what they found is taken from it, and only others are asked.

    Raises:
        ScoreError: For everything a user can act on; see `ariac_score.errors`.
    """
    registry = registry or Registry()
    rule_set = rules if isinstance(rules, RuleSet) else load_rule_set(rules)
    checks = rule_set.build(registry)
    mapping = load_log_map(log_map or rule_set.log_map, beside=Path(rule_set.file).parent)
    bundle, readers = find_trial(path, registry)
    bundle = with_parts(bundle, also, root or path, readers, binding=binding)
    refuse_other_years(bundle, rule_set)
    refuse_other_units(rule_set, checks, {**QUANTITIES, **mapping.quantities}, registry)
    needs = needs_of_all(checks, rule_set, registry)
    quantities = [need.quantity for need in needs]
    with _hashing(bundle, beside=jobs != 1) as hashes:
        trial = read_trial(
            bundle,
            readers,
            mapping,
            registry,
            quantities=quantities,
            progress=progress,
            jobs=jobs,
            orders=rule_set.about_orders,
        )
        trial = _with_unknown_products(_renamed(trial, trial_id, team), rule_set)
        wanted = [Derivation(need.quantity, need.max_gap_s) for need in needs]
        trial = derive_signals(trial, wanted, speed_window_s=mapping.speed_window_s)
        measured = measure_trial(trial, checks, registry=registry, rule_set=rule_set, known=known)
        sketch = sketch_trial(trial, checks, measured, registry=registry, rule_set=rule_set)
        inputs = hashes()
    _refuse_other_contents(bundle, inputs)
    provenance = _provenance(bundle, inputs, rule_set, mapping, registry)
    settings = settings_of(checks, registry=registry, rule_set=rule_set)
    return price_trial(replace(measured, sketch=sketch, settings=settings), rule_set, provenance)


def refuse_other_years(bundle: Bundle, rule_set: RuleSet) -> None:
    """Refuse a configuration of another edition: its words mean other things there.

    Raises:
        DataFileError: Saying what the configuration looks like.
    """
    for part in bundle.parts if rule_set.edition is not None else ():
        if part.role not in ("trial_config", "team_config"):
            continue
        form = form_in(part.path)
        if form.years and rule_set.edition not in form.years:
            raise DataFileError(
                f"it looks like {form}, and {rule_set.id} is for {rule_set.edition}",
                file=part.path,
                hint="score under the rules of its year ('rules list'), or give the right configuration",
            )


def check_configuration(path: Path, rule_set: RuleSet) -> None:
    """See that a file can be the configuration of trials under a rule set, before there is a log.

    Raises:
        LogError: No reader knows it, or it is damaged.
        DataFileError: It is of another edition.
    """
    readers, _ = open_readers(Registry())
    bundle = with_parts(Bundle(path.stem, path, ()), [path], path, readers)
    refuse_other_years(bundle, rule_set)
    (part,) = bundle.parts
    if part.role != "trial_config":
        raise LogError(
            "it is no trial configuration", file=path, hint="give the configuration that says the orders"
        )
    damage = readers[part.reader].describe(path).damage
    if damage:
        raise LogError(damage, file=path, hint="correct the configuration")


def _renamed(trial: Trial, trial_id: str, team: str) -> Trial:
    setup = replace(trial.team or TeamSetup(), name=team) if team else trial.team
    return replace(trial, id=trial_id or trial.id, team=setup)


def _with_unknown_products(trial: Trial, rule_set: RuleSet) -> Trial:
    """The trial with the product types nobody knows among its defects, unless its reader has named them."""
    named = any(defect.kind == "unknown_product_type" for defect in trial.log_defects)
    if named or rule_set.edition is None:
        return trial
    unknown = unknown_products(trial.orders, rule_set.edition)
    return replace(trial, log_defects=(*trial.log_defects, *unknown))


def topics_read(rule_set: RuleSet, registry: Registry) -> frozenset[str]:
    """The topics whose messages a rule set reads of a recording, with and without leading slash."""
    mapping = load_log_map(rule_set.log_map, beside=Path(rule_set.file).parent)
    needs = needs_of_all(rule_set.build(registry), rule_set, registry)
    channels = mapping.channels_for(source_quantities(need.quantity for need in needs))
    names = {channel.topic.lstrip("/") for channel in channels}
    return frozenset(name for plain in names for name in (plain, f"/{plain}"))


# Reading -------------------------------------------------------------------------------


def find_trial(path: Path, registry: Registry) -> tuple[Bundle, dict[str, Reader]]:
    """The parts of the trial at a path, and the readers that know them.

    Raises:
        NothingToScoreError: There is nothing, or no reader knows it; readers that
            could not be loaded are named.
        LogError: The parts contradict each other.
    """
    readers, problems = open_readers(registry)
    try:
        return find_parts(path, readers), readers
    except NothingToScoreError as error:
        if problems:
            words = "; ".join(problem.cause for problem in problems)
            error.hint = f"{error.hint}; these readers could not be asked: {words}"
        raise


def read_trial(
    bundle: Bundle,
    readers: Mapping[str, Reader],
    log_map: LogMap,
    registry: Registry,
    *,
    quantities: Iterable[str],
    progress: Progress = _no_progress,
    jobs: int = 0,
    orders: bool = True,
) -> Trial:
    """The one trial that the parts of a bundle tell of.

    Args:
        bundle: What to read.
        readers: By name.
        log_map: Which topic and field is which signal.
        registry: For the decoders that the log map names.
        quantities: The quantities checks ask for; what they derive from is read too.
        progress: Called with the share done.
        jobs: Threads that read a recording, one of which decodes; 0: as many as there are processors.
        orders: Whether a trial without any order is none.

    Raises:
        LogError: A part is damaged, or two parts contradict each other.
        NothingToScoreError: There is configuration but no record of a trial, or no order.
    """
    decoders = {}
    for name in sorted({channel.decoder for channel in log_map.channels if channel.decoder}):
        try:
            plugin = registry.find("ariac_score.decoders", name)
            decoders[name] = GuardedDecoder(plugin, plugin.build({}))
        except PluginError as error:
            raise LogMapError(error.cause, file=log_map.id, hint=error.hint) from error
    if not any(part.role in ("log", "official") for part in bundle.parts):
        ignored = f"; not read: {', '.join(bundle.ignored[:5])}" if bundle.ignored else ""
        raise NothingToScoreError(
            f"{bundle.id}: there is a configuration but no log of a trial{ignored}",
            file=bundle.root,
            hint="add the log the trial wrote: a bag, a state.log, a performance.log or a .jsonl",
        )
    sources = source_quantities(quantities)
    trials = []
    for number, part in enumerate(bundle.parts):

        def step(done: float, number: int = number) -> None:
            progress((number + done) / len(bundle.parts))

        wanted = Wanted(log_map, sources, decoders, step, part.run, jobs)
        trials.append(readers[part.reader].read(part.path, wanted))
    trial = merge_trials(trials[0].id if len(trials) == 1 else bundle.id, trials, file=bundle.root)
    if not trial.orders and trial.official is not None and trial.official.outcome in ENDED_WITHOUT_SCORE:
        raise RunEndedError(
            ENDED_WITHOUT_SCORE[trial.official.outcome],
            outcome=trial.official.outcome,
            file=bundle.root,
            hint="repeat the run; a ranking counts it as 0, by name",
        )
    trial = with_contents(trial, max_age_s=log_map.kits.max_age_s)
    if orders and not trial.orders:
        raise NothingToScoreError(
            "no order was found",
            file=bundle.root,
            hint=_no_orders_hint(bundle, trial),
        )
    progress(1.0)
    return trial


def _no_orders_hint(bundle: Bundle, trial: Trial) -> str:
    looked = f"; not in the log: {', '.join(trial.unrecorded)}" if trial.unrecorded else ""
    read = ", ".join(f"{part.path.name} ({part.role})" for part in bundle.parts)
    return f"read: {read}{looked}; add the trial configuration or record the orders topic"


# Measuring -----------------------------------------------------------------------------


def measure_trial(
    trial: Trial,
    checks: Mapping[str, Rule | Monitor],
    *,
    registry: Registry,
    rule_set: RuleSet,
    known: Result | None = None,
) -> Measured:
    """Ask every check about a trial.

    Args:
        trial: With the derived signals.
        checks: The built plugins by check name.
        registry: To name the plugin when one fails.
        rule_set: Where the checks come from.
        known: A result whose findings hold for this trial; checks that it has are not asked.

    Raises:
        PluginError: A plugin raised, said nothing, or yielded something else.
        LogError: A signal is recorded in another unit than a check reads it in.
    """
    findings: dict[str, Finding] = {}
    for name, check in checks.items():
        plugin = registry.find(rule_set.checks[name].group, rule_set.checks[name].use)
        _refuse_recorded_units(trial, name, needs_of(plugin, name, check))
        before = _asked_before(known, rule_set.checks[name]) if known else None
        if known and before is not None:
            said = _said(known, before, rule_set.checks[name])
        else:
            said = ask(plugin, name, check, trial)
        for number, finding in enumerate(said, start=1):
            findings[f"{name}#{number}"] = finding
    return Measured(
        trial=trial.id,
        findings=findings,
        scopes=_scopes(trial),
        window=trial.window,
        orders={order.id: order.announced_s for order in trial.orders},
        coverage=tuple(_coverage(signal, trial.window) for signal in trial.signals.values()),
        log_defects=trial.log_defects,
        unrecorded=trial.unrecorded,
        witnessed=tuple(sorted(trial.witnessed)),
        clock=trial.clock,
        official=trial.official,
        team=trial.team.name if trial.team else "",
        units=declared_units(findings.values()),
    )


def _asked_before(known: Result, check: Check) -> str | None:
    """What a check was called in a stored result; `None` when it was not asked there."""
    for name, stored in known.checks.items():
        if stored["use"] == check.use and stored["with"] == dict(check.parameters):
            return name
    return None


def _said(known: Result, name: str, check: Check) -> list[Finding]:
    """What a check of a stored result found, as findings of this one."""
    said = known.measured.of(name).values()
    return [f if f.check == check.name else replace(f, check=check.name) for f in said]


def needs_alike(first: RuleSet, second: RuleSet, registry: Registry) -> bool:
    """Whether two rule sets make the same trial of the same files: what one measured holds for the other."""
    if first.edition != second.edition:
        return False
    maps = [load_log_map(r.log_map, beside=Path(r.file).parent).sha256 for r in (first, second)]
    needs = [list(dict.fromkeys(needs_of_all(r.build(registry), r, registry))) for r in (first, second)]
    return maps[0] == maps[1] and needs[0] == needs[1]


def _refuse_recorded_units(trial: Trial, name: str, needs: Iterable[SignalNeed]) -> None:
    """Refuse a log of which a check would take numbers in one unit for numbers in another."""
    units = {need.quantity: need.unit for need in needs}
    for signal in trial.signals.values():
        unit = units.get(quantity_of(signal.name), signal.unit)
        if unit != signal.unit:
            raise LogError(
                f"signal {signal.name!r} is in {signal.unit!r}, but check {name!r} reads it in {unit!r}",
                file=trial.id,
                hint="name the unit of the log in the rule set, or record the signal in that of the check",
            )


def sketch_trial(
    trial: Trial,
    checks: Mapping[str, Rule | Monitor],
    measured: Measured,
    *,
    registry: Registry,
    rule_set: RuleSet,
) -> Sketch:
    """What a page draws of a trial, finest where something was found.

    Args:
        trial: With the derived signals.
        checks: The built plugins by check name.
        measured: What they found.
        registry: To name the plugin when one fails.
        rule_set: Where the checks come from.

    Raises:
        PluginError: A monitor cannot show what it saw.
    """
    courses = {}
    for name, check in checks.items():
        plugin = registry.find(rule_set.checks[name].group, rule_set.checks[name].use)
        courses[name] = courses_of(plugin, name, check, trial)
    found = sorted(
        (f for f in measured.findings.values() if f.robustness is not None and (f.span or f.evidence)),
        key=lambda f: f.robustness or 0.0,
    )
    moments: dict[tuple[str, str], list[Span]] = {}
    for finding in found:
        at_s = finding.evidence[0].t_s if finding.evidence else 0.0
        moments.setdefault((finding.check, finding.subject), []).append(finding.span or Span(at_s, at_s))
    return sketch_of(trial, courses, moments)


def _scopes(trial: Trial) -> Scope:
    orders, index = [], _announced_as(trial)
    for order in trial.orders:
        tasks = []
        for task in order.tasks:
            path = f"{order.id}/{task.id}"
            parts = tuple(Scope("part", f"{path}/{wanted.slot}") for wanted in task.products)
            tasks.append(Scope("submission", path, {"parts": len(parts)}, parts))
        facts: dict[str, float] = {
            "index": index[order.id],
            "parts": sum(len(task.products) for task in order.tasks),
        }
        if order.priority_said:
            facts["priority"] = order.priority
        orders.append(Scope("order", order.id, facts, tuple(tasks)))
    whole: dict[str, float] = {"duration_s": canonical(trial.duration_s), "orders": len(orders)}
    return Scope("trial", "", whole, tuple(orders))


def _announced_as(trial: Trial) -> dict[str, int]:
    """Which order came first, by id: 0 for the first one announced, whatever changed it afterwards.

    Those that were never announced come after the others; where no times are known, and
    among equals, they come as the log or the configuration lists them.
    """
    first_s: dict[str, float] = {}
    for event in trial.events_of(ORDER_ANNOUNCED):
        first_s.setdefault(event.subject, event.t_s)
    times = {order.id: first_s.get(order.id, order.announced_s) for order in trial.orders}
    announced = sorted((time_s, place) for place, time_s in enumerate(times.values()) if time_s is not None)
    never = [place for place, time_s in enumerate(times.values()) if time_s is None]
    names = list(times)
    return {names[place]: i for i, place in enumerate([*(place for _, place in announced), *never])}


def _coverage(signal: Signal, window: Span | None) -> Coverage:
    span = signal.span
    rate = (len(signal) - 1) / span.duration_s if span and span.duration_s > 0 else 0.0
    largest_gap_s = longest_silence_s(signal.t, window) if window else 0.0
    return Coverage(signal.name, len(signal), rate, largest_gap_s, signal.source)


# Pricing -------------------------------------------------------------------------------


def price_trial(
    measured: Measured, rule_set: RuleSet, provenance: Provenance, cohort: CohortValues | None = None
) -> Result:
    """Price what was measured.

    Args:
        measured: The findings.
        rule_set: What they are worth; its checks must be those that measured.
        provenance: Where the findings come from.
        cohort: Values across teams, where there are any.

    Raises:
        FormulaError: A formula has no value here, such as a division by zero.
    """
    cohort = cohort or CohortValues()
    try:
        priced = price(
            measured.findings,
            measured.scopes,
            rule_set.sheet,
            rule_set.policies,
            digits=rule_set.digits,
            cohort=cohort,
        )
    except FormulaError as error:
        error.file = error.file or rule_set.file
        raise
    ledger = priced.ledger
    return Result(
        measured=measured,
        rule_set_title=rule_set.title,
        checks={
            check.name: {
                "use": check.use,
                "with": dict(check.parameters),
                "on_inconclusive": check.on_inconclusive,
                "priced": check.name in rule_set.sheet.priced,
            }
            for check in rule_set.checks.values()
        },
        notes=rule_set.notes,
        rules=expanded_yaml(rule_set),
        status=priced.status,
        score=None if ledger is None else ledger.amount,
        possible=priced.possible,
        ledger=ledger,
        assumptions=priced.assumptions,
        digits=rule_set.digits,
        provenance=provenance,
        task=priced.task,
        cohort=cohort,
        missing=priced.missing,
    )


def reprice(result: Result, rule_set: RuleSet, cohort: CohortValues | None = None) -> Result:
    """Price a stored result under another rule set, or with a cohort, without its log.

    The checks of the rule set must be among those that were measured: same plugin,
    same parameters, whatever they are called.

    Raises:
        RuleSetError: A check was not measured; the message names it.
        FormulaError: A formula has no value here.
    """
    findings: dict[str, Finding] = {}
    known = result.measured.settings
    settings: dict[str, Settings] | None = None if known is None else {}
    for check in rule_set.checks.values():
        said = _asked_before(result, check)
        if said is None:
            raise RuleSetError(
                f"check {check.name!r} ({check.use} with these parameters) was not measured",
                file=rule_set.file,
                place=check.place.get("use", check.name),
                hint="score the log under this rule set instead; only prices can change without it",
            )
        for number, finding in enumerate(_said(result, said, check), start=1):
            findings[f"{check.name}#{number}"] = finding
        if settings is not None and known is not None and said in known:
            settings[check.name] = known[said]
    code = tuple(sorted({_engine(), *result.provenance.code}))
    provenance = replace(result.provenance, rule_set=(rule_set.id, rule_set.sha256), code=code)
    measured = replace(result.measured, findings=findings, settings=settings)
    return price_trial(measured, rule_set, provenance, cohort)


# Provenance ----------------------------------------------------------------------------


@contextmanager
def _hashing(bundle: Bundle, *, beside: bool) -> Iterator[Callable[[], tuple[Source, ...]]]:
    """The hashes of a bundle's files, computed on another thread where they are large and it may."""
    files = [file for part in bundle.parts for file in _files(part)]
    size = sum(file.stat().st_size for file in files)
    if not beside or size < _WORTH_A_THREAD_BYTES or any(ranged(file) for file in files):
        yield partial(file_hashes, bundle)
        return
    stopped = Event()
    with ThreadPoolExecutor(1) as pool:
        try:
            yield pool.submit(file_hashes, bundle, stopped).result
        finally:
            stopped.set()


def _provenance(
    bundle: Bundle, inputs: tuple[Source, ...], rule_set: RuleSet, log_map: LogMap, registry: Registry
) -> Provenance:
    plugins = [registry.find(check.group, check.use) for check in rule_set.checks.values()]
    plugins += [registry.find("ariac_score.readers", part.reader) for part in bundle.parts]
    plugins += [
        registry.find("ariac_score.decoders", channel.decoder)
        for channel in log_map.channels
        if channel.decoder
    ]
    packages = {(p.distribution, p.version, p.package) for p in plugins}
    return Provenance(
        inputs=inputs,
        ignored=tuple(sorted(bundle.ignored)),
        rule_set=(rule_set.id, rule_set.sha256),
        log_map=(log_map.id, log_map.sha256),
        code=tuple(sorted({_engine(), *((d, v, p, package_sha256(p)) for d, v, p in packages)})),
    )


def code_of(rule_set: RuleSet, registry: Registry) -> tuple[tuple[str, str, str, str], ...]:
    """All code a measurement may depend on: distribution, version, package, SHA-256.

    That is the engine, the plugins of the checks, and every reader and decoder, for each of them
    may take part in the reading.
    """
    plugins = [registry.find(check.group, check.use) for check in rule_set.checks.values()]
    plugins += [p for group in ("ariac_score.readers", "ariac_score.decoders") for p in registry.all(group)]
    packages = {(p.distribution, p.version, p.package) for p in plugins}
    return tuple(sorted({_engine(), *((d, v, p, package_sha256(p)) for d, v, p in packages)}))


def file_hashes(bundle: Bundle, stopped: Event | None = None) -> tuple[Source, ...]:
    """Every file of a bundle with its hash, sorted by role and name.

    Args:
        bundle: Whose files.
        stopped: Once it is set nobody wants the hashes any more, and they are not those of the files.
    """
    found = (s for part in bundle.parts for s in _sources(part, bundle.root, stopped))
    return tuple(sorted(found, key=_by_role))


def _refuse_other_contents(bundle: Bundle, inputs: Sequence[Source]) -> None:
    """Hold what was read against the checksums that `bundle.yaml` states.

    Raises:
        LogError: A file is another one, or none of this trial.
    """
    base = bundle.root if bundle.root.is_dir() else bundle.root.parent
    read = {base / source.name.partition("#run=")[0]: source for source in inputs}
    for path, stated in bundle.stated:
        source = read.get(path)
        if source is None:
            raise LogError(
                f"a checksum is stated of {path.name!r}, which is no file of this trial",
                file=bundle.file,
                hint="state those of logs, configurations and official results",
            )
        if source.read_bytes is None and source.sha256 != stated:
            raise LogError(
                f"its SHA-256 is {source.sha256}, and {stated} is stated",
                file=path,
                hint="send the file again, or correct bundle.yaml",
            )


@cache  # like the hash of the code, what is loaded does not change any more
def _engine() -> tuple[str, str, str, str]:
    """The code that prices, whoever measured."""
    name, package = "ariac-score", "ariac_score"
    return name, version_of(name), package, package_sha256(package)


def _by_role(source: Source) -> tuple[str, str]:
    return source.role, source.name


def _sources(part: Part, root: Path, stopped: Event | None) -> list[Source]:
    """The files of a part, hashed."""
    base = root if root.is_dir() else root.parent
    run = "" if part.run is None else f"#run={part.run}"
    return [
        Source(
            part.role,
            name_from(base, file) + run,
            file.stat().st_size,
            *_hashed(file, stopped),
        )
        for file in _files(part)
    ]


def _files(part: Part) -> list[Path]:
    """The files of a part; a rosbag2 folder is several."""
    return sorted(p for p in part.path.rglob("*") if p.is_file()) if part.path.is_dir() else [part.path]


def _hashed(file: Path, stopped: Event | None) -> tuple[str, int | None]:
    """Hash of a file, and how much of it was read where that is not everything."""
    parts = ranged(file)
    if parts is None or parts.whole:
        return _sha256(file, stopped), None
    return parts.sha256(), parts.read_bytes


def _sha256(file: Path, stopped: Event | None) -> str:
    digest, block = hashlib.sha256(), bytearray(_HASHED_BLOCK_BYTES)
    try:
        with file.open("rb", buffering=0) as stream:
            while (count := stream.readinto(block)) and not (stopped and stopped.is_set()):
                digest.update(memoryview(block)[:count])
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=file, hint="check the permissions"
        ) from cause
    return digest.hexdigest()


def decidable(trial: Trial, rule_set: RuleSet, log_map: LogMap, registry: Registry) -> list[tuple[str, str]]:
    """For each check of a rule set whether this trial can decide it, and if not, why.

    Args:
        trial: As read, with every quantity the log has.
        rule_set: Whose checks are asked.
        log_map: For how speeds are derived.
        registry: The installed plugins.
    """
    checks = rule_set.build(registry)
    wanted = [Derivation(n.quantity, n.max_gap_s) for n in needs_of_all(checks, rule_set, registry)]
    derived = derive_signals(trial, wanted, speed_window_s=log_map.speed_window_s)
    measured = measure_trial(derived, checks, registry=registry, rule_set=rule_set)
    answers = []
    for name in rule_set.checks:
        found = measured.of(name).values()
        undecided = [f for f in found if f.verdict is Verdict.INCONCLUSIVE]
        idle = [f for f in found if f.verdict is Verdict.NOT_APPLICABLE]
        if undecided:
            answers.append((name, f"undecided: {undecided[0].message}"))
        elif len(idle) == len(found):
            answers.append((name, f"not applicable: {idle[0].message}"))
        else:
            answers.append((name, "can be decided"))
    return answers
