"""The search: rounds over all tactics within a budget, each try scored like any log, the cheapest kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, get_args

from ariac_score.errors import PluginError, ScoreError, UsageError, did_you_mean
from ariac_score.logs.containers.items import Message
from ariac_score.ranking.competition import Competition, Run, Team, TrialPlan
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.spec import ranking_spec
from ariac_score.redteam.attempt import Aim, Attempt, Tactic
from ariac_score.redteam.honest import Harm, Honest, harm_of, is_covered
from ariac_score.redteam.tactics import TACTICS
from ariac_score.results.result import Result
from ariac_score.review.task_and_safety import task_points
from ariac_score.testing.copies import Copy

Standing = Literal["exploit", "declared", "inherent", "believed"]
"""Whether a try that worked is the rules' fault: not known of, known of, unavoidable, or nothing shows it."""

__all__ = ["DEFAULT_BUDGET", "Exploit", "Found", "Standing", "Tally", "search"]

DEFAULT_BUDGET = 150
_SMALLER = 12
"""So many tries at most go into making an exploit cheaper."""

_SAME = 1e-9
"""Relative: smaller differences are of rounding."""


@dataclass(frozen=True)
class Exploit:
    """A try that worked.

    Attributes:
        tactic: The way.
        says: What is done.
        before: The score that counts of the honest log; of several runs, what the team has in the trial.
        after: The same of what is handed in.
        touched: How many messages were left out, changed or put in.
        law: The law of penalties that it breaks; empty where it is about the log.
        standing: Whether the rules declare it, cannot avoid it, or believe what no log can show.
        because: Why it is one of these; empty for an `exploit`.
        logs: What is handed in.
    """

    tactic: Tactic
    says: str
    before: Decimal
    after: Decimal
    touched: int
    law: str
    standing: Standing
    because: str
    logs: tuple[Copy, ...]

    @property
    def is_free(self) -> bool:
        """Whether something worse brings no points, but costs none either."""
        return self.before == self.after


@dataclass(frozen=True)
class Tally:
    """How often a tactic was tried, and how that ended.

    Attributes:
        tactic: Its name.
        tried: How often.
        refused: How often the log was refused.
        worse: How often it scored less.
        same: How often it scored the same, or nothing that could be compared was done.
        worked: How often it was an exploit.
    """

    tactic: str
    tried: int = 0
    refused: int = 0
    worse: int = 0
    same: int = 0
    worked: int = 0


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes:
        honest: The honest log.
        exploits: One for each tactic that worked, in the order of `Standing`, the cheapest first.
        tallies: What was tried, by tactic.
        budget: How often it was allowed to try.
        seed: Of what was tried by chance.
    """

    honest: Honest
    exploits: tuple[Exploit, ...]
    tallies: tuple[Tally, ...]
    budget: int
    seed: int

    @property
    def tried(self) -> int:
        """How often it was tried."""
        return sum(tally.tried for tally in self.tallies)

    @property
    def undeclared(self) -> tuple[Exploit, ...]:
        """Those that the rules could avoid, and do not declare."""
        return self.of("exploit")

    def of(self, standing: Standing) -> tuple[Exploit, ...]:
        """Those of one standing."""
        return tuple(one for one in self.exploits if one.standing == standing)


def search(
    honest: Honest,
    *,
    budget: int = DEFAULT_BUDGET,
    seed: int = 0,
    tactics: Sequence[str] = (),
    progress: Callable[[int, str], None] = lambda _done, _what: None,
) -> Found:
    """Search what scores more than an honest log.

    The same log, rules, budget and seed give the same exploits.

    Args:
        honest: The log, read and scored by `honest_log`.
        budget: How often to try; each try is a log that is written and scored.
        seed: Of what is tried by chance.
        tactics: The names of those to try; all where none is given.
        progress: Called before each try with how many are done, and the tactic.

    Raises:
        UsageError: There is no such tactic.
        PluginError: A plugin of the rules failed.
    """
    chosen = [tactic for tactic in TACTICS if not tactics or tactic.name in tactics]
    if unknown := sorted(set(tactics) - {tactic.name for tactic in chosen}):
        names = [tactic.name for tactic in TACTICS]
        raise UsageError(
            f"there is no tactic {unknown[0]!r}", hint=did_you_mean(unknown[0], names, what="tactics")
        )
    return _Search(honest, budget, seed, progress).over(chosen)


@dataclass(frozen=True)
class _HandedIn:
    """What is handed in: what counts, how much is violated, and of one run its result."""

    score: Decimal | None
    harm: Harm
    result: Result | None = None


class _Search:
    """One search: what is left of its budget, and what it found."""

    def __init__(self, honest: Honest, budget: int, seed: int, progress: Callable[[int, str], None]) -> None:
        self._honest, self._budget, self._seed, self._progress = honest, budget, seed, progress
        self._harm = harm_of(honest.result, honest.rule_set.monitors)
        self._spec = ranking_spec(honest.rule_set, {}, file=honest.rule_set.file)
        self._done = 0
        self._tallies: dict[str, Counter[str]] = {}

    def over(self, tactics: Sequence[Tactic]) -> Found:
        """Round after round one variant of each tactic, until the budget is spent or nothing is left."""
        left = {tactic: tactic.attempts(self._honest, self._seed) for tactic in tactics}
        self._tallies = {tactic.name: Counter() for tactic in tactics}
        found: list[Exploit] = []
        inherent: dict[Tactic, Exploit] = {}
        while left:
            for tactic in tuple(left):
                attempt = next(left[tactic], None) if self._done < self._budget else None
                if attempt is None:
                    del left[tactic]
                elif exploit := self._tried(tactic, attempt):
                    if exploit.standing == "inherent":
                        inherent.setdefault(tactic, exploit)  # there may be one that is none
                        continue
                    found.append(self._cheaper(exploit, attempt))
                    del left[tactic]  # the cheapest of a kind is enough; the budget is for other kinds
        known = {exploit.tactic for exploit in found}
        found += (exploit for tactic, exploit in inherent.items() if tactic not in known)
        order = get_args(Standing)
        found.sort(key=lambda one: (order.index(one.standing), one.touched))
        tallies = tuple(Tally(name, **counts) for name, counts in self._tallies.items())
        return Found(self._honest, tuple(found), tallies, self._budget, self._seed)

    def _cheaper(self, exploit: Exploit, attempt: Attempt) -> Exploit:
        """The same with less done, as long as it works and the tries last."""
        tries = 0
        smaller = iter(attempt.smaller())
        while tries < _SMALLER and self._done < self._budget:
            attempt_ = next(smaller, None)
            if attempt_ is None:
                break
            tries += 1
            found = self._tried(exploit.tactic, attempt_)
            if found and found.touched < exploit.touched:
                exploit, smaller = found, iter(attempt_.smaller())
        return exploit

    def _tried(self, tactic: Tactic, attempt: Attempt) -> Exploit | None:
        """Whether it works: the log written, read and scored as any other."""
        self._progress(self._done, tactic.name)
        self._done += 1
        tally = self._tallies[tactic.name]
        tally["tried"] += 1
        logs = attempt.logs()
        try:
            before, handed_in = self._scores(logs, tactic.aim)
        except PluginError:
            raise  # what a log can do to a plugin is a fault, and no refusal
        except ScoreError:
            tally["refused"] += 1
            return None
        after = handed_in.score
        if after is None or not self._works(tactic.aim, before, after, handed_in):
            worse = after is None or self._gain(before, after) < 0
            tally["worse" if worse else "same"] += 1
            return None
        tally["worked"] += 1
        law = self._law(tactic, before, after)
        standing, because = self._standing(tactic, law, handed_in)
        touched = self._touched(logs)
        return Exploit(tactic, attempt.says, before, after, touched, law, standing, because, logs)

    def _scores(self, logs: tuple[Copy, ...], aim: Aim) -> tuple[Decimal, _HandedIn]:
        """What honesty counts, and what is handed in.

        Raises:
            ScoreError: A log is refused.
        """
        honest = self._honest
        if len(logs) == 1:
            result = honest.score(logs[0])
            # What is open is no harm that was measured.
            is_known = honest.result.is_open or not result.is_open
            harm = harm_of(result, honest.rule_set.monitors) if is_known else {}
            return honest.counts, _HandedIn(result.score, harm, result)
        # As many runs as the rules count belong to an honest team; the tries are about one more.
        alone = [honest.result] * (self._spec.keep if self._spec.fill else 1)
        more = [honest.result if log is honest.copy else honest.score(log) for log in logs[1:]]
        before = self._ranked(alone)
        if aim is not Aim.AGAIN:  # a better run may well bring more, but no more than it does by itself
            before = max(before, self._ranked(more), key=self._worth)
        return before, _HandedIn(self._ranked([*alone, *more]), {})

    def _ranked(self, results: Sequence[Result]) -> Decimal:
        """What a team has in the trial with these runs, as `rank` has it."""
        return self._ranking([results]).standings[0].trials["trial"].score

    def _ranking(self, teams: Sequence[Sequence[Result]]) -> Ranking:
        """The ranking of teams, each with its runs of the trial."""
        honest = self._honest
        runs = {
            Run(f"team_{number}", "trial", k, honest.path): result
            for number, results in enumerate(teams)
            for k, result in enumerate(results, start=1)
        }
        competition = Competition(
            "redteam",
            "",
            "",
            honest.path.parent,
            honest.path,
            tuple(Team(f"team_{number}", f"team_{number}") for number, _ in enumerate(teams)),
            (TrialPlan("trial"),),
            tuple(runs),
        )
        scored = {run.key: result for run, result in runs.items()}
        return rank_results(competition, self._spec, honest.rule_set, scored)

    def _is_behind(self, result: Result) -> bool:
        """Whether a ranking puts who handed this in behind who was honest, where both have the same score."""
        ranks = [each.rank for each in self._ranking([[self._honest.result], [result]]).standings]
        return len(set(ranks)) > 1

    def _worth(self, score: Decimal) -> Decimal:
        """A score as points, of which more are better; where rules count mistakes, the fewer the better."""
        return score if self._spec.more_is_better else -score

    def _gain(self, before: Decimal, after: Decimal) -> Decimal:
        """How many points better it is."""
        return self._worth(after) - self._worth(before)

    def _works(self, aim: Aim, before: Decimal, after: Decimal, handed_in: _HandedIn) -> bool:
        gain = self._gain(before, after)
        if aim is Aim.AGAIN:
            return gain != 0
        if aim is Aim.REST:
            return gain < 0
        if aim is Aim.HARM:
            if gain < 0 or not _is_more(handed_in.harm, self._harm):
                return False
            assert handed_in.result is not None
            if not is_covered(self._honest.result, handed_in.result, self._honest.rule_set.monitors):
                return False
            # Once nothing is left, nothing can be taken; but a ranking may tell.
            return gain > 0 or before != 0 or not self._is_behind(handed_in.result)
        return gain > 0

    def _touched(self, logs: tuple[Copy, ...]) -> int:
        honest = Counter(map(_identity, self._honest.copy.messages))
        total = 0
        for log in logs:
            own = Counter(map(_identity, log.messages))
            total += max((honest - own).total(), (own - honest).total())
        return total

    def _law(self, tactic: Tactic, before: Decimal, after: Decimal) -> str:
        if tactic.aim is Aim.HARM and before == after == 0:
            return "nothing_left"
        return "always_costs" if before == after and tactic.law == "more_violations" else tactic.law

    def _standing(self, tactic: Tactic, law: str, handed_in: _HandedIn) -> tuple[Standing, str]:
        """Whether the rules declare that this works, cannot avoid it, or believe what no log can show."""
        honest, rule_set = self._honest, self._honest.rule_set
        if tactic.name == "recording cut" and rule_set.authority.window == "recording":
            return "declared", "window: recording, so that what was recorded is the competition"
        if law in rule_set.breaks:
            return "declared", f"breaks {law}: {rule_set.breaks[law]}"
        if law == "stopping_early" and self._costs_more_than_it_brings(handed_in):
            return "inherent", "what comes after violates more for each point than what comes before"
        if rule_set.authority.completeness == "attested":
            return "exploit", ""
        if tactic.needs_proof:
            return "believed", "a recorder's manifest would show it, and the rules ask for none"
        if tactic.name == "samples thinned" and not honest.has_rates:
            return "believed", "'rate_hz' in the log map would show it, or a recorder's manifest"
        if tactic.name == "speeds denied" and not honest.has_positions:
            return "believed", "positions of the same bodies would show it, or a recorder's manifest"
        return "exploit", ""

    def _points(self, result: Result) -> Decimal:
        """What the work was worth, had nothing been violated."""
        return task_points(result.measured, self._honest.rule_set, result.cohort) or Decimal(0)

    def _costs_more_than_it_brings(self, handed_in: _HandedIn) -> bool:
        """Whether a smaller share of something violated is left than of the points for the task."""
        assert handed_in.result is not None  # one run
        whole, part = self._points(self._honest.result), self._points(handed_in.result)
        points = part / whole if whole > 0 else Decimal(1)
        shares = [handed_in.harm.get(name, 0.0) / much for name, much in self._harm.items() if much > 0]
        return any(share < float(points) * (1 - _SAME) for share in shares)


def _identity(message: Message) -> tuple[str, str, int, bytes]:
    connection = message.connection
    return connection.topic, connection.publisher, message.stamp_ns, bytes(message.payload)


def _is_more(harm: Harm, than: Harm) -> bool:
    """Whether nowhere less was violated, and somewhere more."""
    names = {*harm, *than}
    pairs = [(harm.get(name, 0.0), than.get(name, 0.0)) for name in names]
    return all(new >= old * (1 - _SAME) for new, old in pairs) and any(
        new > old * (1 + 1e-3) + 1e-6 for new, old in pairs
    )
