"""What a screen shows of a cell at an instant, as plain values for its page."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.live.running import Instant, Running
from ariac_score.report.html.wording import brief, spoken
from ariac_score.report.words import capital, label_of
from ariac_score.results.result import Result
from ariac_score.scoring.ledger import Line, taken_by
from ariac_score.scoring.scope import Scope

__all__ = ["HISTORY_S", "Showing"]

HISTORY_S = 60.0
_STEP_S = 0.1
"""Of each so long stretch of history the least margin is shown."""
_MOST_LINES = 200
_JUDGED_LATE_S = 1.5
"""What was so short a time before a judgement may not count in it yet."""
_MOST_UNSEEN = 12
_GONE = ("lost", "disconnected", "log", "clock", "type")

State = dict[str, Any]


class Showing:
    """Turns the states of a cell into what is shown of it; what follows from a result is made once.

    Args:
        name: Of the cell.
        source: Its address.
    """

    def __init__(self, name: str, source: str) -> None:
        self.name, self._source = name, source
        self._strips: dict[tuple[str, str], deque[tuple[float, float, float]]] = {}
        self._known: tuple[Running, State] | None = None
        self._broken: tuple[float, Instant] | None = None

    def note(self, running: Running) -> None:
        """Keep the margins of a state for the moving strip."""
        for one in running.now:
            if one.margin < 0:
                self._keep_broken(one)
            if one.unit != "m" or one.at_most:
                continue
            strip = self._strips.setdefault((one.check, one.subject), deque())
            row = (round(one.at_s, 3), round(one.actual, 4), round(one.limit, 4))
            if strip and int(strip[-1][0] / _STEP_S) == int(row[0] / _STEP_S):
                last = strip[-1]
                strip[-1] = min(last, row, key=lambda each: each[1] - each[2])
            elif not strip or row[0] > strip[-1][0]:
                strip.append(row)
        for key, strip in list(self._strips.items()):  # also of pairs that are seen no more
            while strip and strip[0][0] < running.elapsed_s - HISTORY_S:
                strip.popleft()
            if not strip:
                del self._strips[key]

    def _keep_broken(self, one: Instant) -> None:
        """Keep until when something was violated last, and its worst instant."""
        last = self._broken
        goes_on = last is not None and one.at_s - last[0] < 1.0
        worst = min(last[1], one, key=lambda each: each.margin) if last is not None and goes_on else one
        self._broken = one.at_s, worst

    def of(self, running: Running) -> State:
        """Everything that is shown, for JSON."""
        if self._known is None or self._known[0].result is not running.result:
            self._known = running, _settled(running)
        known = self._known[1]
        strip = self._strip()
        return {
            "name": self.name,
            "source": self._source,
            "t": round(running.elapsed_s, 2),
            "messages": running.messages,
            "connected": running.connected,
            "ended": running.ended,
            "final": bool(
                running.ended and running.result is not None and running.result.measured.cut is None
            ),
            "judged_s": round(running.judged_until_s, 2),
            "score": _score(running),
            "verdict": _verdict(running, self._broken),
            "now": [_instant(one) for one in sorted(running.now, key=lambda one: one.margin)[:40]],
            "strip": strip,
            "places": [[one.body, one.kind, one.x_m, one.y_m] for one in running.places],
            "unseen": list(_unseen(running)),
            **known,
        }

    def _strip(self) -> State | None:
        """The pair that was nearest to its limit within the history."""
        least = {key: min(a - b for _, a, b in rows) for key, rows in self._strips.items() if rows}
        if not least:
            return None
        check, subject = min(least, key=lambda key: (least[key], key))
        rows = list(self._strips[check, subject])
        return {"check": spoken(check), "subject": spoken(subject), "rows": rows}


def _instant(one: Instant) -> State:
    return {
        "check": one.check,
        "subject": one.subject,
        "name": spoken(one.check),
        "actual": round(one.actual, 4),
        "limit": round(one.limit, 4),
        "margin": round(one.margin, 4),
        "unit": one.unit,
        "at_most": one.at_most,
    }


def _is_final(running: Running) -> bool:
    result = running.result
    return bool(running.ended) and result is not None and result.measured.cut is None


def _settled(running: Running) -> State:
    """What follows from the result alone."""
    result, so_far = running.result, running.so_far
    if result is None:
        return {"orders": [], "ledger": [], "undecided": []}
    return {
        "orders": list(_orders(so_far or result)),
        "ledger": list(_lines(so_far or result))[-_MOST_LINES:],
        "undecided": [spoken(name) for name in running.undecided],
    }


def _number(value: Decimal) -> str:
    """Two digits, as tables of scores have them."""
    return f"{value:.2f}"


def _score(running: Running) -> State:
    result, interval = running.result, running.interval
    so_far = running.so_far.score if running.so_far is not None else None
    if so_far is None and running.so_far is not None and running.so_far.interval is not None:
        so_far = running.so_far.interval.least
    if result is not None and interval is None and result.task is not None:
        return {
            "task": _number(result.task.amount),
            "why": "task score: the score compares teams, and needs all",
        }
    if interval is None:
        return {"why": running.open or (result.missing if result else "") or "no score yet"}
    least, most = interval
    found: State = {"least": _number(least), "most": _number(most)}
    if result is not None and result.possible is not None:
        found["possible"] = _number(result.possible)
    if so_far is not None:
        found["so_far"] = _number(min(max(so_far, least), most))
    return found


def _violations(running: Running) -> list[Finding]:
    if running.result is None:
        return []
    found = running.result.measured.findings.values()
    broken = [f for f in found if f.verdict is Verdict.VIOLATED and f.check in running.monitors]
    return sorted(broken, key=lambda f: f.span.start_s if f.span else 0.0)


def _verdict(running: Running, last: tuple[float, Instant] | None) -> State:
    """One sentence, and whether it is good."""
    if not running.connected and not running.ended:
        return {
            "kind": "open",
            "text": f"The source is gone; nothing is known since {_clock(running.elapsed_s)}.",
        }
    nearest = min(running.now, key=lambda one: one.margin, default=None)
    if nearest is not None and nearest.margin < 0 and not running.ended:
        return {"kind": "bad", "text": f"Violated now: {_by(nearest)}."}
    if last is not None and not running.ended and last[0] > running.judged_until_s - _JUDGED_LATE_S:
        # Seen, and not yet judged: what is settled of it comes with the next judgement.
        return {"kind": "bad", "text": f"Violated at {_clock(last[0])}: {_by(last[1])}."}
    broken = _violations(running)
    if broken:
        times = "once" if len(broken) == 1 else f"{len(broken)} times"
        worst = min(broken, key=lambda one: 0.0 if one.robustness is None else one.robustness)
        return {"kind": "bad", "text": f"Violated {times}: {_worst(worst, len(broken))}."}
    if _missed(running):
        near = "" if nearest is None else f"; {nearest.margin:.2f} {nearest.unit} to spare now"
        return {"kind": "open", "text": f"No violation was seen, but not everything was{near}."}
    if nearest is not None and not running.ended:
        near = f"nearest {nearest.margin:.2f} {nearest.unit} ({spoken(nearest.check)})"
        return {"kind": "good", "text": f"All limits kept so far; {near}."}
    if running.result is None:
        return {"kind": "open", "text": capital(running.open or "no message yet") + "."}
    if not running.monitors:
        return {"kind": "open", "text": "These rules watch the work alone."}
    if not running.ended:
        return {"kind": "open", "text": "Nothing can be said of distances at this moment."}
    return {"kind": "good", "text": "All limits were kept."}


def _missed(running: Running) -> bool:
    """Whether something was not seen that may have been a violation."""
    if any(note.kind in ("lost", "disconnected") for note in running.notes):
        return True
    findings = running.result.measured.findings.values() if running.result is not None else ()
    return any(
        one.verdict is Verdict.INCONCLUSIVE
        and one.check in running.monitors
        and (one.span is not None or bool(running.ended))
        for one in findings
    )


def _by(one: Instant) -> str:
    pair = " and ".join(spoken(name) for name in one.subject.split("/"))
    return f"{pair} by {abs(one.margin):.2f} {one.unit} ({spoken(one.check)})"


def _worst(finding: Finding, among: int) -> str:
    """The worst violation in a few words."""
    at = f" at {_clock(finding.span.start_s)}" if finding.span else ""
    if finding.robustness is None or not finding.unit:
        return f"{brief(finding.message, 80)}{at}"
    pair = " and ".join(spoken(name) for name in finding.subject.split("/"))
    worst = "at worst " if among > 1 else ""
    return f"{worst}{pair} by {-finding.robustness:.2f} {finding.unit} ({spoken(finding.check)}){at}"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02}"


def _orders(result: Result) -> Iterator[State]:
    """The outermost items of work: when they came, what was handed in of them, what they earned."""
    sketch = result.measured.sketch
    brought = sketch.brought if sketch else ()
    worth = {line.subject: line.amount for line in _all(result) if line.kind == "sum" and line.subject}
    for item in result.measured.scopes.inner:
        names = {scope.path.rpartition("/")[2] for scope in item.walk()}
        handed = [one for one in brought if one.item in names]
        parts = [scope for scope in item.walk() if not scope.inner]
        yield {
            "name": spoken(item.path),
            "level": spoken(item.level),
            "announced": result.measured.orders.get(item.path),
            "parts": len(parts),
            "tasks": sum(1 for scope in _tasks(item)),
            "handed": [
                {
                    "t": round(one.submitted_s, 2),
                    "words": one.words,
                    "contents": list(one.contents or ())[:20],
                }
                for one in handed
            ],
            "earned": _number(worth.get(item.path, Decimal(0))),
        }


def _tasks(item: Scope) -> list[Scope]:
    """What is handed in as one."""
    return [scope for scope in item.walk() if scope.inner and not any(one.inner for one in scope.inner)]


def _all(result: Result) -> Iterator[Line]:
    return iter(()) if result.ledger is None else iter(result.ledger.walk())


def _lines(result: Result) -> Iterator[State]:
    """The lines of the ledger that have an amount, in the order in which they happened."""
    findings = result.measured.findings
    sketch = result.measured.sketch
    handed = {one.item: one.submitted_s for one in (sketch.brought if sketch else ())}
    found = []
    taken = taken_by(result.ledger)
    for key, line in taken.items():
        finding = findings.get(key)
        if finding is None or line.amount == 0:
            continue
        t_s = finding.span.start_s if finding.span else _handed_s(finding.subject, handed)
        found.append((t_s, key, "taken", line.amount, finding.message))
    for scope in result.measured.scopes.inner:
        for task in _tasks(scope):
            line_of = next(
                (one for one in _all(result) if one.kind == "sum" and one.subject == task.path), None
            )
            t_s = _handed_s(task.path, handed)
            if line_of is not None and line_of.amount:
                words = f"{spoken(task.path.rpartition('/')[2])} handed in"
                found.append((t_s, task.path, "earned", line_of.amount, words))
    for line in result.ledger.children if result.ledger else ():
        if line.kind in ("cap", "factor") and line.amount:
            found.append((None, line.path, line.kind, line.amount, label_of(line)))
    for t_s, key, kind, amount, text in sorted(
        found, key=lambda one: (one[0] is None, one[0] or 0.0, one[1])
    ):
        yield {
            "id": key,
            "kind": kind,
            "t": None if t_s is None else round(t_s, 2),
            "amount": f"{amount:+.2f}".replace("-", "\u2212"),
            "text": capital(text),
        }


def _handed_s(subject: str, handed: dict[str, float]) -> float | None:
    times = [handed[name] for name in subject.split("/") if name in handed]
    return times[0] if times else None


def _unseen(running: Running) -> Iterator[str]:
    """What nobody sees: what was lost, what is not recorded, what this source cannot tell."""
    if not running.connected and not running.ended:
        yield "the source is gone: nothing is seen at this moment"
    if not running.sees_losses:
        yield "this source does not show when a message is lost: silence is no evidence"
    notes = [f"{_clock(note.at_s)} {note.text}" for note in running.notes if note.kind in _GONE]
    yield from notes[-_MOST_UNSEEN:]
    if len(notes) > _MOST_UNSEEN:
        yield f"and {len(notes) - _MOST_UNSEEN} gaps before"
    if running.result is not None:
        measured = running.result.measured
        never = "not recorded" if running.ended else "not there so far"
        yield from (f"{never}: {one}" for one in measured.unrecorded[:_MOST_UNSEEN])
        if running.ended:
            return
        yield from dict.fromkeys(
            finding.message
            for finding in measured.findings.values()
            if finding.verdict is Verdict.INCONCLUSIVE and finding.span is not None
        )
