"""The contracts of plugins as checks that any test, and any referee, can run.

    @pytest.mark.parametrize("check", contract_checks(MONITOR, made_trial()))
    def test_keeps_the_monitor_contract(check: ContractCheck) -> None:
        check()

A check that fails names the plugin with its distribution and version, and says what it did.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from ariac_score.checks.contracts import GROUPS, Monitor, Reader, Rule, SignalNeed
from ariac_score.checks.depth import DepthProfile
from ariac_score.checks.finding_contract import margin_breach
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.in_gaps import IN_GAPS, in_gaps_of
from ariac_score.checks.local import GivenPlugin
from ariac_score.checks.registry import Registry
from ariac_score.checks.when_cut import WHEN_CUT, when_cut_of
from ariac_score.engine.ask import BUDGET_S, ask, ask_worlds, budget_of, margins_of
from ariac_score.engine.signal_needs import needs_of, with_derived
from ariac_score.errors import LogError, PluginError
from ariac_score.installed.captured_output import fault_of
from ariac_score.monitors.subjects import Subjects
from ariac_score.testing.contract_check import (
    HINT,
    ContractCheck,
    ContractError,
    built_by_name,
    origin_of,
    snapshot,
    undocumented,
)
from ariac_score.testing.cut_contract import does_not_stay
from ariac_score.testing.forced import forced_trials
from ariac_score.testing.made import inhabited
from ariac_score.testing.online_contract import OnlineChecks
from ariac_score.testing.reader_contract import reader_checks
from ariac_score.testing.stopwatch import OutOfTime, Stopwatch
from ariac_score.testing.variants import HOLLOW, SIGNAL_VARIANTS, bare, only, reordered, shifted, without
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial

__all__ = ["BUDGET_S", "contract_checks"]


SHIFT_S = 64.0
"""How much later the shifted trial starts, s."""

OURS = "ariac-score"
"""The distribution whose monitors have to say what gaps leave open."""

_LISTED = ", ".join(IN_GAPS)
_GAP_S = 2.0
"""How long each of the two gaps of `SIGNAL_VARIANTS` is, s."""
_DECIDED = (Verdict.SATISFIED, Verdict.VIOLATED)


def contract_checks(
    plugin: Any, trial: Trial | Path, *, budget_s: float = BUDGET_S, log_map: str = ""
) -> list[ContractCheck]:
    """Everything the contract of a plugin requires.

    Args:
        plugin: A rule, a monitor or a reader, with the parameters it is to be checked with.
        trial: A trial that gives it something to say, such as `made_trial()`; for a
            reader, the path of a log that it reads.
        budget_s: Processor time it may take for a million samples, s.
        log_map: Name of the log map that a reader is given; by default an empty one.

    Raises:
        TypeError: It is none of these, or the second argument does not fit it.
    """
    if isinstance(plugin, Reader):
        if isinstance(trial, Trial):
            raise TypeError("a reader is checked with the path of a log, not with a trial")
        return reader_checks(plugin, origin_of(plugin), Path(trial), budget_s=budget_s, log_map=log_map)
    if not isinstance(plugin, Rule | Monitor):
        raise TypeError(f"{type(plugin).__name__} is no rule, monitor or reader; is it built?")
    if not isinstance(trial, Trial):
        raise TypeError("a rule or monitor is checked with a trial, such as made_trial()")
    return _Checked(plugin, trial, budget_s).checks()


class _Checked:
    """A rule or monitor under examination."""

    def __init__(self, check: Any, trial: Trial, budget_s: float) -> None:
        self.check, self.budget_s = check, budget_s
        self.plugin = origin_of(check)
        self.printed: list[str] = []
        self.taken_s = 0.0
        self._given = trial
        self._derived: Trial | None = None
        self._findings: list[Finding] | None = None

    def checks(self) -> list[ContractCheck]:
        """In the order in which one failing explains the next."""
        plain: list[tuple[str, str, Callable[[], None]]] = [
            ("docstring_sections", "its docstring has the sections of a help page", self.docstring_sections),
            ("built_by_name", "a rule set can build it, with parameters by name", self.built_by_name),
            ("possible_findings", "times, units, numbers and subjects are possible", self.possible),
            ("time_budget", "it keeps its budget of processor time", self.time_budget),
            ("prints_nothing", "it prints nothing", self.prints_nothing),
            ("at_least_one_finding", "silence is not a verdict, whatever the trial", self.finds_something),
            ("same_trial_same_findings", "the same trial gives the same findings", self.repeats),
            ("trial_unchanged", "it leaves the trial as it was", self.trial_unchanged),
            ("order_of_signals", "the order of signals and bodies is irrelevant", self.order_of_signals),
            ("time_shift", "a later start moves spans and nothing else", self.time_shift),
        ]
        named: list[tuple[str, str, Callable[[], str | None]]] = [*plain]
        if isinstance(self.check, Monitor):
            named += [
                ("needs_declared", "it uses no signal that it does not declare", self.needs_declared),
                ("missing_signals", "missing signals are inconclusive, not assumed", self.missing_signals),
                ("in_gaps", "it says what a gap leaves open, and leaves it open", self.in_gaps),
            ]
            named += [
                (variant, f"signals with a fault ({variant.replace('_', ' ')}) are no reason to guess", run)
                for variant, run in self._variants()
            ]
        else:
            named.append(("missing_submissions", "what is not recorded is not assumed", self.submissions))
        named.append(("when_cut", "what it says of a log that is cut off is so", self.when_cut))
        named.append(("decides", "it was seen to decide, and to decide alike", self.decides))
        # By the name alone: a class with `begin` means to be online, and must keep all of that contract.
        if hasattr(self.check, "begin"):
            named += [
                ("one_by_one", "one sample at a time equals the whole log", self.one_by_one),
                ("instant_by_instant", "samples that come together are as samples alone", self.instants),
                ("standings", "verdicts of instants fit the findings", self.standings),
                ("nothing_stepped", "a trial in which nothing comes ends like an empty log", self.unstepped),
                ("repeated_time", "a time that does not increase is refused", self.repeated_time),
            ]
        if hasattr(self.check, "resolved"):
            named.append(("resolved", "it resolves parameters that it has, always alike", self.resolved))
        if hasattr(self.check, "margins"):
            named.append(("margins", "the margins over time are those of the findings", self.margins))
        return [ContractCheck(*each) for each in named]

    # What the checks below share

    @cached_property
    def _trial(self) -> Trial:
        """The given trial; with whom the monitor is about, where it has nobody such."""
        try:
            subjects = getattr(self.check, "subjects", None)
        except Exception:  # noqa: BLE001  # the checks below say what is wrong with it
            return self._given
        return inhabited(self._given, subjects) if isinstance(subjects, Subjects) else self._given

    @property
    def trial(self) -> Trial:
        """The trial with what the monitor needs, as the engine would hand it over."""
        if self._derived is None:
            self._derived = self._derive(self._trial)
        return self._derived

    def _derive(self, trial: Trial) -> Trial:
        needs = needs_of(self.plugin, "contract", self.check)
        return with_derived(trial, needs, Registry()) if needs else trial

    @property
    def findings(self) -> list[Finding]:
        """Its findings on the trial as it is; what variants of the trial are compared with."""
        if self._findings is None:
            self._findings = self.ask(self.trial)
        return self._findings

    def ask(self, trial: Trial, check: Any = None) -> list[Finding]:
        """Its findings on a trial, within its time budget."""
        watch = Stopwatch(budget_of(trial, self.budget_s))
        try:
            with watch.running():
                return ask(
                    self.plugin,
                    "contract",
                    self.check if check is None else check,
                    trial,
                    notice=lambda _origin, fault: self.printed.append(fault),
                )
        except LogError as wrong:
            raise self.broken(f"cannot take the trial it is tried with: {wrong.cause}") from wrong
        except OutOfTime:
            raise self.broken(
                f"ran longer than its budget of {watch.limit_s:g} s of processor time "
                f"({self.budget_s:g} s for a million samples)"
            ) from None

    def broken(self, what: str) -> ContractError:
        """The error that names the plugin."""
        return ContractError(what, origin=self.plugin.origin, hint=HINT)

    def needed(self) -> list[str]:
        """The quantities it declares."""
        return sorted({need.quantity for need in needs_of(self.plugin, "contract", self.check)})

    # One for each requirement

    def docstring_sections(self) -> None:
        missing = undocumented(self.plugin, type(self.check))
        if missing:
            raise self.broken(f"has no section {', '.join(map(repr, missing))} in its docstring")

    def built_by_name(self) -> None:
        problem = built_by_name(type(self.check))
        if problem:
            raise self.broken(problem)
        made = getattr(type(self.check), "__dataclass_params__", None)
        if made is not None and not made.frozen:
            raise self.broken("is a dataclass that is not frozen, so it may change between two trials")
        self._rebuilt()

    def _rebuilt(self) -> Any:
        """Another instance with the same parameters."""
        fields = dataclasses.fields(self.check) if dataclasses.is_dataclass(self.check) else ()
        values = {f.name: getattr(self.check, f.name) for f in fields if f.init}
        try:
            made = type(self.check)(**values)
        except (Exception, SystemExit) as cause:
            raise self.broken(f"cannot be built: {fault_of(cause)}") from cause
        if not isinstance(made, GROUPS[self.plugin.group]):
            raise self.broken(f"makes a {type(made).__name__} when it is built")
        return made

    def possible(self) -> None:
        assert self.findings  # each was held against the contract of findings when it was given

    def time_budget(self) -> None:
        self.ask(self.trial)

    def prints_nothing(self) -> None:
        self._rebuilt()  # a constructor may print, too
        self.ask(self.trial)
        if self.printed:
            raise self.broken(self.printed[0])

    def finds_something(self) -> None:
        # Loops over bodies or events end without a finding where there are none.
        for trial in (
            self.trial,
            bare(self.trial),
            replace(self.trial, bodies=()),
            replace(self.trial, events=()),
        ):
            self.ask(trial)

    def repeats(self) -> None:
        assert self.findings  # made before the others, so that these are second answers
        for check in (self.check, self._rebuilt()):
            self._same(self.ask(self.trial, check), "gives other findings the second time")

    def _same(self, found: list[Finding], what: str) -> None:
        difference = _difference(self.findings, found)
        if difference:
            raise self.broken(f"{what}: {difference}")

    def trial_unchanged(self) -> None:
        # Down to the last number; `ask`, which runs for every score, compares arrays by identity alone.
        trial = replace(self.trial)
        before = snapshot(trial)
        self.ask(trial)
        if snapshot(trial) != before:
            raise self.broken("changed the trial it was given")

    def order_of_signals(self) -> None:
        self._same(self.ask(reordered(self.trial)), "depends on the order of signals")

    def time_shift(self) -> None:
        later = self.ask(shifted(self.trial, SHIFT_S))
        difference = _difference([_moved(f, SHIFT_S) for f in self.findings], later, moved=True)
        if difference:
            raise self.broken(f"gives other findings on a clock {SHIFT_S:g} s ahead: {difference}")

    def needs_declared(self) -> None:
        for need in needs_of(self.plugin, "contract", self.check):
            recorded = (s for s in self.trial.sampled if s.name.startswith(f"{need.quantity}/"))
            for signal in recorded:
                if signal.unit != need.unit:
                    raise self.broken(
                        f"needs {need.quantity!r} in {need.unit!r}, recorded in {signal.unit!r}"
                    )
            if not need.max_gap_s > 0:
                raise self.broken(
                    f"accepts no gap at all in {need.quantity!r}, and between any two samples there is one"
                )
        self._same(self.ask(only(self.trial, self.needed())), "reads signals that it does not say it needs")

    def missing_signals(self) -> None:
        """Without any signal nothing may be decided that was decided with them."""
        if not self.needed():
            return
        blind = self.ask(without(self.trial, self.needed()))
        inconclusive = any(finding.verdict is Verdict.INCONCLUSIVE for finding in blind)
        for finding in blind:
            # What rests on parameters alone, such as where a line is drawn, needs no signal.
            drawn = inconclusive and finding.span is None and finding in self.findings
            if finding.verdict is Verdict.SATISFIED and not drawn:
                raise self.broken(
                    f"is satisfied although every signal it needs is missing: {finding.message!r}"
                )
        if _decided(self.findings) and not inconclusive:
            raise self.broken("is never inconclusive although every signal it needs is missing")
        # One at a time, for a plugin may trip over the second signal once it has the first.
        for quantity in self.needed():
            self.ask(without(self.trial, [quantity]))

    def in_gaps(self) -> None:
        """First-party monitors say what gaps leave open; whoever says it keeps it."""
        said = in_gaps_of(self.check)
        if said is None:
            if self.plugin.distribution == OURS:
                raise self.broken(f"does not say what a gap leaves open: 'in_gaps' is one of {_LISTED}")
            return
        if said not in IN_GAPS:
            raise self.broken(f"says that a gap leaves {said!r} open; 'in_gaps' is one of {_LISTED}")
        if said == "unsampled" and self.needed():
            raise self.broken(f"says that it reads no samples, and needs {self.needed()[0]!r}")
        if said in ("tight", "outer") and not hasattr(self.check, "watch_worlds"):
            raise self.broken("says that gaps are bounded, and has no 'watch_worlds' that bounds them")
        # Bounded by nothing but how fast bodies are by default, in all of two gaps of two seconds.
        gappy = replace(SIGNAL_VARIANTS["gaps"](self.trial), between=between_samples({}, {}))
        found, opened = ask_worlds(self.plugin, "contract", self.check, gappy, notice=lambda _o, _f: None)
        silent = not opened and all(f.verdict is not Verdict.INCONCLUSIVE for f in found)
        longer = getattr(self.check, "max_gap_s", 0.0) < _GAP_S  # than what it accepts
        if said == "blunt" and longer and silent and any(f.verdict is Verdict.SATISFIED for f in found):
            raise self.broken("says that a gap may hide anything, and is satisfied across two of 2 s")

    def when_cut(self) -> None:
        """What it says of a cut is so: in the given trial, and in one in which it is violated."""
        says = when_cut_of(self.check)
        if says not in WHEN_CUT:
            raise self.broken(f"says that a cut leaves {says!r}; 'when_cut' is one of {', '.join(WHEN_CUT)}")
        if says == "open":
            return
        violated = self._seen[0].get(Verdict.VIOLATED)
        for trial in (self.trial, *([] if violated is None else [violated])):
            lost = does_not_stay(
                says,
                self.ask(trial),
                trial,
                not isinstance(self.check, Monitor),
                lambda part: self.ask(self._derive(part)),
            )
            if lost:
                raise self.broken(f"says {says!r} of a cut ({WHEN_CUT[says]}), but {lost}")

    def _variants(self) -> Iterator[tuple[str, Callable[[], None]]]:
        for name in SIGNAL_VARIANTS:
            # Bound as a default: all lambdas of the loop share its variable.
            yield name, lambda name=name: self._variant(name)  # type: ignore[misc]

    def _variant(self, name: str) -> None:
        """A fault of the recorder makes no numbers out of nothing, and no good verdict."""
        trial = SIGNAL_VARIANTS[name](self.trial)
        found = self.ask(trial)
        satisfied = any(f.verdict is Verdict.SATISFIED for f in found)
        inconclusive = any(f.verdict is Verdict.INCONCLUSIVE for f in found)
        if name in HOLLOW and self.needed() and satisfied and not inconclusive:
            raise self.broken(f"is satisfied with signals that show nothing ({name.replace('_', ' ')})")

    def submissions(self) -> None:
        """A rule decides nothing new when it is not known what was handed in."""
        # Such a rule repeats an official score, which stands whether or not submissions were recorded.
        if getattr(self.check, "reads_official", False):
            return
        # Not witnessed, too: else no submission would mean that nothing was handed in.
        unseen = replace(self.trial, submissions=(), records=(), witnessed=frozenset())
        for finding in self.ask(unseen):
            if finding.verdict in _DECIDED and finding not in self.findings:
                raise self.broken(
                    f"decides {finding.subject!r} although no submission is recorded: {finding.message!r}"
                )

    def decides(self) -> str:
        """It reaches both verdicts in trials made for it, and keeps the contract there too.

        Returns:
            Which verdict was never seen; empty when both were.
        """
        needs = needs_of(self.plugin, "contract", self.check)
        seen, tried = self._seen
        for verdict, made in seen.items():
            if made is not None:
                self._alike_in(made, verdict)
        unseen = [verdict.value for verdict in _DECIDED if verdict not in seen]
        if not seen and (example := self._as_example()) is not None:
            # What must be told its limits decides nothing without them, and says so.
            rest = example.decides()
            return f"as it is built it decides nothing; as its 'example' {rest or 'it decides both ways'}"
        if not seen and needs:
            raise self.broken(
                f"was neither satisfied nor violated in {tried} trials, with what it needs low, high, "
                "sweeping, noisy and with a gap: nothing shows that it decides anything; bring trials in "
                "which it does, as 'example_trials'"
            )
        return f"it was never {' nor '.join(unseen)} in {_trials(tried)}" if unseen else ""

    @cached_property
    def _seen(self) -> tuple[dict[Verdict, Trial | None], int]:
        """In which trial each verdict was seen (`None`: the given one), and in how many it was looked for."""
        seen: dict[Verdict, Trial | None] = {
            verdict: None for verdict in _DECIDED if any(f.verdict is verdict for f in self.findings)
        }
        tried = 1
        for trial in self._decisive_trials(needs_of(self.plugin, "contract", self.check)):
            if len(seen) == len(_DECIDED):
                break
            tried += 1
            for verdict in {finding.verdict for finding in self.ask(trial)} - seen.keys():
                if verdict in _DECIDED:
                    seen[verdict] = trial
        return seen, tried

    def _decisive_trials(self, needs: Sequence[SignalNeed]) -> Iterator[Trial]:
        """Trials in which it may decide: those that it brings, then those made for any monitor."""
        bring = getattr(self.check, "example_trials", None)
        if bring is not None:
            try:
                brought = list(bring(self._given))
            except (Exception, SystemExit) as cause:
                raise self.broken(
                    f"raised {fault_of(cause).name} in 'example_trials': {fault_of(cause).text}"
                ) from cause
            for trial in brought:
                if not isinstance(trial, Trial):
                    raise self.broken(f"brings a {type(trial).__name__} as an example instead of a Trial")
                yield self._derive(trial)
        # A rule that repeats an official score needs no trial made for it.
        if not getattr(self.check, "reads_official", False):
            yield from map(self._derive, forced_trials(self.check, needs, self._trial))

    def _as_example(self) -> _Checked | None:
        """The plugin with the parameters that its class names as its example, if these are others."""
        kind = type(self.check)
        declared = getattr(kind, "example", None)
        if not isinstance(declared, Mapping):
            return None
        example = GivenPlugin.of(kind, self.plugin.group).build(declared)
        return None if example == self.check else _Checked(example, self._given, self.budget_s)

    def _alike_in(self, trial: Trial, verdict: Verdict) -> None:
        """The checks of pure calls, on a trial in which it decides."""
        other = _Checked(self.check, trial, self.budget_s)
        required = [other.repeats, other.trial_unchanged, other.order_of_signals]
        if hasattr(self.check, "margins"):
            required.append(other.margins)
        for check in required:
            try:
                check()
            except PluginError as error:
                raise self.broken(f"{error.fault} (in a trial in which it is {verdict.value})") from error

    def resolved(self) -> None:
        try:
            first, second = (snapshot(dict(check.resolved())) for check in (self.check, self._rebuilt()))
        except (Exception, SystemExit) as cause:
            fault = fault_of(cause)
            raise self.broken(
                f"raised {fault.name} when asked what its parameters come to: {fault.text}"
            ) from cause
        if first != second:
            raise self.broken("says that its parameters come to something else when asked again")
        strange = {name for name, _ in first} - {f.name for f in dataclasses.fields(self.check) if f.init}
        if strange:
            raise self.broken(f"says what {min(strange)!r} comes to, which is no parameter of it")

    def margins(self) -> None:
        first, second = (
            margins_of(self.plugin, "contract", check, self.trial) for check in (self.check, self._rebuilt())
        )
        if list(map(_chart_marks, first)) != list(map(_chart_marks, second)):
            raise self.broken("gives other margins the second time")
        fault = margin_breach(self.trial, self.needed(), self.findings, first)
        if fault:
            raise self.broken(fault)

    @property
    def online(self) -> OnlineChecks:
        """The monitor stepped through the trial."""
        return OnlineChecks(self.check, self.trial, self.needed(), self.broken)

    def one_by_one(self) -> None:
        found = self._checked(self.online.one_by_one())
        self._same(found, "gives other findings when given one sample at a time")

    def instants(self) -> None:
        found = self._checked(self.online.instant_by_instant())
        self._same(found, "gives other findings when given one instant at a time")

    def standings(self) -> None:
        self.online.standings(self.findings)

    def unstepped(self) -> None:
        blind = self.ask(replace(self.trial, signals={}))
        difference = _difference(blind, self._checked(self.online.nothing_stepped()))
        if difference:
            raise self.broken(f"gives other findings when nothing comes than of an empty log: {difference}")

    def repeated_time(self) -> None:
        self.online.repeated_time()

    def _checked(self, findings: list[Finding]) -> list[Finding]:
        """Findings of a watch after the same checks, order and rounding as those of any monitor."""
        return self.ask(self.trial, _Replayed(findings, self.check))


def _trials(number: int) -> str:
    return "the one trial it was tried on" if number == 1 else f"{number} trials"


def _chart_marks(chart: Chart) -> tuple[object, ...]:
    """Everything in which two charts can differ, to the last bit."""
    arrays = (chart.t, chart.actual, chart.limit)
    return chart.subject, chart.what, chart.unit, chart.at_most, *(array.tobytes() for array in arrays)


class _Replayed:
    """A monitor that gives the findings of a watch, and declares what the watched one declares."""

    def __init__(self, findings: Iterable[Finding], check: Any) -> None:
        self._findings = findings
        for name in ("measures", "also_about", "t_on_s"):
            if hasattr(check, name):
                setattr(self, name, getattr(check, name))

    def needs(self) -> Iterator[Any]:
        """Nothing more."""
        return iter(())

    def watch(self, _trial: Trial) -> Iterable[Finding]:
        """What was found."""
        return self._findings


def _decided(findings: Iterable[Finding]) -> bool:
    return any(finding.verdict in _DECIDED for finding in findings)


def _moved(finding: Finding, by_s: float) -> Finding:
    """The finding, later."""
    span = finding.span
    return replace(
        finding,
        span=None if span is None else replace(span, start_s=span.start_s + by_s, end_s=span.end_s + by_s),
        evidence=tuple(replace(sample, t_s=sample.t_s + by_s) for sample in finding.evidence),
        profile=finding.profile
        and replace(finding.profile, t_s=tuple(t + by_s for t in finding.profile.t_s)),
    )


_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


def _words(finding: Finding) -> str:
    """The message without its numbers: some are times, which a shift of the clock changes."""
    return _NUMBER.sub("#", finding.message)


def _key(finding: Finding) -> tuple[str, float, str, str]:
    return (
        finding.subject,
        finding.span.start_s if finding.span else -1.0,
        finding.verdict.value,
        _words(finding),
    )


def _difference(before: list[Finding], after: list[Finding], *, moved: bool = False) -> str:
    """What differs between two lists of findings, in words; empty when nothing does."""
    if len(before) != len(after):
        return f"{len(before)} findings, then {len(after)}"
    # Sorted anew: a message that names a time can change the order in which `ask` gives findings.
    for first, second in zip(sorted(before, key=_key), sorted(after, key=_key), strict=True):
        if first == second or (moved and _alike(first, second)):
            continue
        return f"{_shown(first)}, then {_shown(second)}"
    return ""


def _shown(finding: Finding) -> str:
    span = f" from {finding.span.start_s:g} s to {finding.span.end_s:g} s" if finding.span else ""
    return f"{finding.verdict.value} {finding.subject}{span} {finding.message!r}"


def _alike(first: Finding, second: Finding) -> bool:
    """Whether two findings differ only in last digits and in the times within their messages."""
    blank: dict[str, Any] = {
        "message": "",
        "span": None,
        "robustness": None,
        "quantities": {},
        "units": {},
        "evidence": (),
        "profile": None,
    }
    return (
        first.units == second.units
        and _apart(first.profile, second.profile) < 1e-6
        and replace(first, **blank) == replace(second, **blank)
        and _words(first) == _words(second)
        and [name for name, _ in _numbers(first)] == [name for name, _ in _numbers(second)]
        and all(
            # A later clock rounds stamps to other bits, and speeds are differences of stamps.
            math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-6)
            for (_, a), (_, b) in zip(_numbers(first), _numbers(second), strict=True)
        )
    )


def _apart(first: DepthProfile | None, second: DepthProfile | None) -> float:
    """How far two profiles are apart: the integral of the difference of their depths, s."""
    if first is None or second is None:
        return 0.0 if first is second else math.inf
    marks = sorted({*first.t_s, *second.t_s})
    return sum(
        (to_s - from_s) * abs(first.at(from_s) - second.at(from_s)) for from_s, to_s in pairwise(marks)
    )


def _numbers(finding: Finding) -> list[tuple[str, float]]:
    numbers = [] if finding.robustness is None else [("robustness", finding.robustness)]
    if finding.span is not None:
        numbers += [("start", finding.span.start_s), ("end", finding.span.end_s)]
    numbers += sorted(finding.quantities.items())
    for sample in finding.evidence:
        values = sample.value if isinstance(sample.value, tuple) else (sample.value,)
        numbers += [(sample.signal, value) for value in (sample.t_s, *values)]
    return numbers
