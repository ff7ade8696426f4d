"""Whom a monitor is about: every body of a kind, or every combination of bodies of several kinds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import combinations, product

from ariac_score.checks.findings import Finding
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.vocabulary import subject_of

__all__ = ["WHOLE_TRIAL", "Subject", "Subjects", "bodies", "nobody", "pairs"]

OTHER = "other"
"""Stands in templates for the second body of a pair of one kind."""


@dataclass(frozen=True)
class Subject:
    """Whom one finding is about.

    Attributes:
        name: Subject of the findings, such as `arm/person_1`.
        bodies: What to fill into the templates: body id by placeholder.
    """

    name: str
    bodies: Mapping[str, str]

    def fill(self, template: str) -> str:
        """The signal name that a template stands for.

        >>> Subject("truck/ann", {"vehicle": "truck", "pedestrian": "ann"}).fill("speed/{vehicle}")
        'speed/truck'

        Raises:
            ValueError: It names somebody else.
        """
        try:
            return template.format(**self.bodies)
        except (KeyError, IndexError) as named:
            known = ", ".join(f"{{{place}}}" for place in self.bodies) or "nobody"
            raise ValueError(
                f"signal {template!r} names {{{named.args[0]}}}, but its subjects are {known}"
            ) from None


WHOLE_TRIAL = Subject("trial", {})
"""The subject of what is about no body."""


@dataclass(frozen=True)
class Subjects:
    """Every combination of one body of each kind; without a kind the trial itself.

    Attributes:
        kinds: Kinds of bodies, such as `robot` and `human`; a competition may have others.
    """

    kinds: tuple[str, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        """The placeholders of its templates: the kinds; `other` for the second body of one kind.

        >>> pairs("drone", "drone").places
        ('drone', 'other')
        """
        return (self.kinds[0], OTHER) if self.of_one_kind else self.kinds

    @property
    def of_one_kind(self) -> bool:
        """Whether they are pairs of bodies of the same kind, each two once."""
        return len(self.kinds) == 2 and self.kinds[0] == self.kinds[1]

    def pair(self, template: str) -> str:
        """Of whom the signal of a template is, by kinds, where it is of a pair; else empty.

        >>> pairs("vehicle", "pedestrian").pair("separation/{vehicle}/{pedestrian}")
        '{vehicle}/{pedestrian}'
        >>> pairs("drone", "drone").pair("separation/{drone}/{other}"), bodies("drone").pair("speed/{drone}")
        ('{drone}/{drone}', '')
        """
        subject = subject_of(template)
        if "/" not in subject:
            return ""
        return subject.replace(f"{{{OTHER}}}", f"{{{self.kinds[0]}}}") if self.of_one_kind else subject

    def of(self, known: Iterable[Body]) -> list[Subject]:
        """The subjects among some bodies, in order of their ids.

        >>> cars = Body("a", "vehicle"), Body("b", "vehicle"), Body("ann", "pedestrian")
        >>> [one.name for one in pairs("vehicle", "pedestrian").of(cars)]
        ['a/ann', 'b/ann']
        >>> [one.name for one in pairs("vehicle", "vehicle").of(cars)]
        ['a/b']
        """
        if not self.kinds:
            return [WHOLE_TRIAL]
        known = list(known)
        # Sorted: findings must not depend on the order in which a log lists bodies.
        ids = {kind: sorted(body.id for body in known if body.kind == kind) for kind in self.kinds}
        chosen = (
            combinations(ids[self.kinds[0]], 2)
            if self.of_one_kind
            else product(*(ids[kind] for kind in self.kinds))
        )
        return [Subject("/".join(ones), dict(zip(self.places, ones, strict=True))) for ones in chosen]


def bodies(kind: str) -> Subjects:
    """Every body of a kind, named `{kind}` in templates.

    >>> bodies("robot").of([Body("arm", "robot"), Body("ann", "human")])
    [Subject(name='arm', bodies={'robot': 'arm'})]
    """
    return Subjects((kind,))


def pairs(first: str, second: str) -> Subjects:
    """Every pair of a body of one kind and a body of another (or of the same kind: each two once)."""
    return Subjects((first, second))


def nobody(trial: Trial, kinds: tuple[str, ...], clause: str = "") -> Finding:
    """The finding when there is no subject to watch.

    Not applicable where the log records every body, or would have recorded one of the kind (it witnesses
    such as `human bodies`), else inconclusive; so is a log that has a kind of
    nearly the same name, for one of the two may be misspelt.

    Args:
        trial: The trial.
        kinds: Kinds of bodies that must be there for a subject to exist.
        clause: Where the standard asks for it.

    >>> nobody(Trial("t", bodies=(Body("ann", "pedestrain"),)), ("pedestrian",)).message
    "the log shows no pedestrian; did you mean 'pedestrain'?"
    """
    lacking = dict.fromkeys(kind for kind in kinds if not trial.bodies_of(kind))
    missing = " and no ".join(lacking) or f"second {kinds[0]}"
    near = _nearly_named(tuple(lacking) or kinds, {body.kind for body in trial.bodies} - {*kinds})
    if "bodies" in trial.witnessed and not near:
        message = f"the log records every body, and there is no {missing} among them"
        return Finding.not_applicable("trial", message, clause=clause)
    # Of a pair one kind is enough: without a human there is nobody to come near to.
    none = next((kind for kind in lacking if f"{kind} bodies" in trial.witnessed), "")
    if none and not near:
        return Finding.not_applicable("trial", f"there was no {none} in this trial", clause=clause)
    remark = f"; did you mean {' and '.join(map(repr, near))}?" if near else ""
    message = f"the log shows no {missing}{remark}"
    return Finding.inconclusive("trial", message, span=trial.window, clause=clause)


def _nearly_named(kinds: Iterable[str], others: Iterable[str]) -> list[str]:
    """The other kinds that a misspelt one of these may be."""
    by_name = {kind.casefold(): kind for kind in sorted(others)}
    near = (get_close_matches(kind.casefold(), by_name, n=1, cutoff=0.8) for kind in kinds)
    return list(dict.fromkeys(by_name[name] for found in near for name in found))
