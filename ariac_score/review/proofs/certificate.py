"""The certificate of a rule set: what is proven of it, so that anybody can prove it again.

A certificate is checked by proving everything again, from the rule set of the stated hash: nothing in the
file is believed. What only a solver proved is not checked where none is installed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import msgspec
from msgspec import Struct

from ariac_score.documents.plain_file import read_plain
from ariac_score.documents.schema import strict_json
from ariac_score.errors import ResultError
from ariac_score.review.proofs.borders import borders
from ariac_score.review.proofs.proving import Judged, Search, pointed_search, prove
from ariac_score.review.proofs.solver import Solver, find_solver, solver_version
from ariac_score.review.proofs.subject import Subject

__all__ = [
    "MOST_TRIES",
    "Adversary",
    "Certificate",
    "Difference",
    "Law",
    "TriedLog",
    "certificate",
    "certificate_in",
    "certificate_json",
    "compare",
]

_VERSION = version("ariac-score")
_SCHEMA = "ariac-score/certificate/1"
_KIND = _SCHEMA.rpartition("/")[0]
_MOST_CASES = 10_000
MOST_TRIES = 1_000
"""Each is a log that is written and scored."""

_LARGEST_BYTES = 1_000_000
"""A certificate has some thousand characters; what is larger is none."""


class Exploit(Struct, frozen=True, forbid_unknown_fields=True):
    """A counter-example: two ways it can go, and what the engine scores for each."""

    trial: str
    first: str
    first_score: float
    second: str
    second_score: float


class Law(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What is known of one law."""

    law: str
    says: str
    verdict: str
    by: str = ""
    because: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    declared: str = ""
    exploit: Exploit | None = None


class TriedLog(Struct, frozen=True, forbid_unknown_fields=True):
    """The honest log that an adversary began with.

    Attributes:
        name: Its name.
        sha256: Of its bytes; of a folder, of the names and bytes of all files in it.
        tries: How many doctored copies of it were scored at most, for each law that was open.
    """

    name: str
    sha256: str
    tries: int


@dataclass(frozen=True)
class Adversary:
    """Who searches a log for exploits.

    Attributes:
        log: What it begins with.
        search: The search.
    """

    log: TriedLog
    search: Search


class Certificate(Struct, frozen=True, forbid_unknown_fields=True, tag_field="schema", tag=_SCHEMA):
    """What is proven of a rule set.

    Attributes:
        program: Version of this program.
        name: Of the rule set, or of the penalty on the made competition.
        sha256: Of the rule set.
        cases: Random trials that were searched for each law that is not proven.
        seed: Where their random numbers start.
        solver: Name and version of the solver; empty where none was installed.
        laws: Every law.
        borders: Up to where laws that exclude each other hold, each in a sentence.
        log: The log that an adversary doctored for each law that was left open; `None`: none.
    """

    program: str
    name: str
    sha256: str
    cases: int
    seed: int
    solver: str
    laws: tuple[Law, ...]
    borders: tuple[str, ...] = ()
    log: TriedLog | None = None


@dataclass(frozen=True)
class Difference:
    """One point in which a certificate is not what is proven here.

    Attributes:
        what: A law, or a part of the head.
        words: What the certificate says, and what holds.
        is_fault: Whether the certificate is wrong.
        is_unchecked: Whether it could not be checked here.
    """

    what: str
    words: str
    is_fault: bool = True
    is_unchecked: bool = False


def certificate(
    subject: Subject, *, cases: int, seed: int, solver: Solver | None, adversary: Adversary | None = None
) -> Certificate:
    """Prove every law, search what is open, and certify what was found.

    Args:
        subject: A rule set or a penalty.
        cases: Random trials, and as many at the numbers of its formulas, for each law that is not proven.
        seed: Where the random numbers start.
        solver: What is asked where types do not suffice; `None` where none is installed.
        adversary: Who searches a log for exploits of what is still open.
    """
    searches = [pointed_search(cases=cases, seed=seed), *([adversary.search] if adversary else [])]
    judged = prove(subject, cases=cases, seed=seed, solver=solver, searches=searches)
    return Certificate(
        _VERSION,
        _id(subject),
        subject.rule_set.sha256,
        cases,
        seed,
        solver_version() if solver else "",
        tuple(_law(subject, one) for one in judged),
        borders(subject, solver),
        adversary.log if adversary else None,
    )


def _id(subject: Subject) -> str:
    return subject.name if subject.is_penalty else subject.rule_set.id


def _law(subject: Subject, one: Judged) -> Law:
    exploit = None
    if one.exploit and one.exploit.broken:
        broken = one.exploit.broken
        trial = one.exploit.trial(subject.rule_set.sheet.levels)
        exploit = Exploit(
            trial, broken.first, _rounded(broken.first_score), broken.second, _rounded(broken.second_score)
        )
    return Law(
        one.law.name, one.law.says, one.verdict, one.by, one.because, one.searched, one.declared, exploit
    )


def _rounded(score: float) -> float:
    """With 12 significant digits, in which machines do not differ."""
    return float(f"{score:.12g}")


def certificate_json(made: Certificate) -> str:
    """As JSON, which is the same for the same certificate."""
    return json.dumps(msgspec.to_builtins(made), indent=1, ensure_ascii=False) + "\n"


def certificate_in(file: Path) -> Certificate | None:
    """The certificate that a file holds; `None` where it is meant to be something else.

    Raises:
        ResultError: It is meant to be a certificate, and is none.
    """
    if not file.is_file() or file.stat().st_size > _LARGEST_BYTES:
        return None
    try:
        data = strict_json(read_plain(file, _LARGEST_BYTES).decode("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(data, dict) or not str(data.get("schema", "")).startswith(_KIND):
        return None
    try:
        found = msgspec.convert(data, Certificate)
    except msgspec.ValidationError as error:
        hint = "make it again with 'ariac-score rules prove NAME -o FILE'"
        raise ResultError(f"it is no sound certificate: {error}", file=file, hint=hint) from None
    tries = found.log.tries if found.log else 0
    for number, what, most in ((found.cases, "cases", _MOST_CASES), (tries, "tries", MOST_TRIES)):
        if not 0 <= number <= most:
            hint = "make it again with fewer"
            raise ResultError(f"its {number} {what} are not from 0 to {most}", file=file, hint=hint)
    return found


def compare(found: Certificate, subject: Subject, adversary: Adversary | None = None) -> Iterator[Difference]:
    """Prove everything again, and say in what the certificate differs.

    Args:
        found: The certificate.
        subject: The rule set that it should be of.
        adversary: Who searches the log that the certificate names; `None` where that log is not here.
    """
    if _id(subject) != found.name or subject.rule_set.sha256 != found.sha256:
        yield Difference("rule set", _another(found, subject))
        return
    if found.program != _VERSION:
        yield Difference("program", f"made by version {found.program}, checked by {_VERSION}", is_fault=False)
    solver = find_solver()
    if adversary and found.log != adversary.log:
        yield Difference("log", _another_log(found.log, adversary.log))
        return
    here = certificate(subject, cases=found.cases, seed=found.seed, solver=solver, adversary=adversary)
    proven = {law.law: law for law in here.laws}
    for law in found.laws:
        other = proven.pop(law.law, None)
        if other is None:
            yield Difference(law.law, "there is no such law")
        elif "solver" in (law.by, other.by) and here.solver != found.solver and law.verdict != other.verdict:
            words = _unlike_solvers(found.solver, here.solver)
            yield Difference(law.law, words, is_fault=False, is_unchecked=True)
        elif law.verdict == "open" == other.verdict and here.solver != found.solver:
            continue  # another solver knows other numbers
        elif found.log and not adversary and _rests_on_log(law, other):
            words = f"not checked: searched on {found.log.name}, which is not here (--log)"
            yield Difference(law.law, words, is_fault=False, is_unchecked=True)
        elif law != other:
            yield Difference(law.law, _differing(law, other))
    for name in proven:
        yield Difference(name, "the certificate leaves it out")
    if here.solver == found.solver and here.borders != found.borders:
        yield Difference("borders", f"they are: {'; '.join(here.borders) or 'none'}")


def _rests_on_log(law: Law, other: Law) -> bool:
    """Whether all else is open here, so that what the certificate says may have been found on its log."""
    alike = (law.because, law.searched[: len(other.searched)]) == (other.because, other.searched)
    return other.verdict == "open" and law.verdict in ("open", "refuted") and alike


def _another_log(stated: TriedLog | None, here: TriedLog) -> str:
    if stated is None:
        return f"the certificate names no log, and {here.name} is given"
    if stated.sha256 != here.sha256:
        return f"the certificate is of {stated.name} of other bytes than {here.name}"
    return f"the certificate names {stated.name}, and {here.name} is given"


def _unlike_solvers(stated: str, here: str) -> str:
    return f"not checked: decided by {stated or 'no solver'}, and here is {here or 'none'}"


def _another(found: Certificate, subject: Subject) -> str:
    if _id(subject) != found.name:
        return f"the certificate is of {found.name!r}, not of {_id(subject)!r}"
    return (
        f"the certificate is of another text of {found.name!r}: "
        f"SHA-256 {found.sha256[:12]}…, and the one here has {subject.rule_set.sha256[:12]}…"
    )


def _differing(law: Law, other: Law) -> str:
    if law.verdict != other.verdict:
        return f"the certificate says {law.verdict}; proven again it is {other.verdict}"
    named = [name for name, value in msgspec.structs.asdict(law).items() if value != getattr(other, name)]
    return f"{law.verdict}, but for another reason: {', '.join(named)} differ"
