"""Penalties: presets that turn the score of a rule set into its penalised final score.

A rule set says `include: [penalty.<name>]` and which of its checks are charged
(`safety:`). What comes out is a plain rule set: its own score becomes the term
`earned`, the terms of the penalty follow, and its `penalised_score` is the score. A term or
parameter that the rule set has itself stays its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ariac_score.checks.origins import note_origin
from ariac_score.checks.registry import Registry
from ariac_score.documents.schema import shipped_data, validate
from ariac_score.documents.yaml import YamlDocument, load_yaml
from ariac_score.errors import PluginNotFoundError, RuleSetError, did_you_mean
from ariac_score.scoring.named import NamedParameter, merged_parameters, named_parameters

__all__ = ["EARNED", "Penalty", "load_penalty", "penalty_names", "with_penalty"]

GROUP = "ariac_score.penalties"
EARNED = "earned"
"""The term that holds what the rule set itself gives, before any penalty."""

_FINAL = "penalised_score"
_SCALE = "safety_scale"
_SCALE_MEANING = "turns what all violations weigh up or down"
_CLASSES = "penalty/classes.yaml"


@dataclass(frozen=True)
class Penalty:
    """One preset.

    Attributes:
        id: Such as `penalty.gate`.
        title: One line for people.
        source: Where it comes from.
        in_words: Its formula in words.
        terms: Formulas, or templates that are written for each safety check.
        parameters: Named numbers, as its file states them.
        classes: By class what a violation weighs, and what the class is.
        ties: What separates teams of equal value in a ranking.
    """

    id: str
    title: str
    source: str
    in_words: str
    terms: Mapping[str, Any]
    parameters: Mapping[str, Any]
    classes: Mapping[str, NamedParameter] = field(default_factory=dict)
    ties: Sequence[Mapping[str, str]] = ()


def penalty_names() -> list[str]:
    """The installed penalties."""
    return sorted({file.name for file in Registry().files(GROUP)})


def load_penalty(name: str, *, folder: Path) -> Penalty:
    """A penalty by name, or from a file.

    Args:
        name: Of an installed penalty, or the path of a `.yaml` file.
        folder: What a path is relative to.

    Raises:
        RuleSetError: There is none of that name, or it breaks the schema.
        PluginError: Two distributions bring it, or its entry point leads nowhere.
    """
    if name.endswith((".yaml", ".yml")) or "/" in name:
        path = folder / name
    else:
        try:
            path = Registry().file(GROUP, name).path
        except PluginNotFoundError:
            raise RuleSetError(
                f"there is no penalty {name!r}",
                hint=did_you_mean(name, penalty_names(), what="installed penalties"),
            ) from None
    document = load_yaml(path, error=RuleSetError)
    validate(document, "penalty", error=RuleSetError)
    classes = load_yaml(shipped_data(_CLASSES), error=RuleSetError)
    data = document.data
    return Penalty(
        id=data["id"],
        title=data["title"],
        source=data["source"],
        in_words=data["in_words"],
        terms=data["terms"],
        parameters=data.get("parameters", {}),
        classes=named_parameters(classes.data["weights"]),
        ties=data.get("ties", ()),
    )


@dataclass(frozen=True)
class _Charged:
    """One safety check as a penalty sees it."""

    check: str
    weight: float
    critical: bool
    of_class: str

    @property
    def parameter(self) -> str:
        return f"weight_of_{self.check}"

    @property
    def stated(self) -> dict[str, Any]:
        """Its weight, as a rule set states a parameter."""
        meaning = f"what a violation of {self.check} weighs, of class {self.of_class}"
        return {"value": self.weight, "meaning": meaning}


def with_penalty(document: YamlDocument) -> YamlDocument:
    """The rule set with its penalty written out; unchanged when it includes none.

    Raises:
        RuleSetError: The penalty is unknown, `safety` names what is no check or has no
            weight, or a name would mean two things.
    """
    data = dict(document.data)
    included, safety = data.pop("include", None), data.pop("safety", None)
    if included is None and safety is None:
        return document
    if included is None or not _checks_of(safety):
        key, other = ("safety", "include") if included is None else ("include", "safety")
        raise RuleSetError(
            f"{key!r} needs {other!r} as well",
            file=document.file,
            place=document.place([key]),
            hint="include one penalty, and name under 'safety' the checks it charges",
        )
    try:
        penalty = load_penalty(included[0], folder=Path(document.file).parent)
    except RuleSetError as error:
        error.file, error.place = error.file or document.file, error.place or document.place(["include", 0])
        raise
    note_origin(data, GROUP, included[0], Registry())
    charged = [_charged(document, penalty, name, body) for name, body in _checks_of(safety).items()]
    data["parameters"] = _parameters(document, penalty, charged, safety.get("scale", 1))
    data["terms"] = {**data.get("terms", {}), "trial": _terms(document, penalty, charged)}
    data["score"] = _FINAL
    ranking = data.get("ranking", {})
    if penalty.ties:
        own = list(ranking.get("ties", []))
        data["ranking"] = {**ranking, "ties": own + [tie for tie in penalty.ties if tie not in own]}
    return replace(document, data=data)


def _checks_of(safety: Mapping[str, Any] | None) -> dict[str, Any]:
    return {name: body for name, body in (safety or {}).items() if name != "scale"}


def _charged(document: YamlDocument, penalty: Penalty, name: str, body: Mapping[str, Any]) -> _Charged:
    checks = [*document.data.get("rules", {}), *document.data.get("monitors", {})]
    place = document.place(["safety", name])
    if name not in checks:
        raise RuleSetError(
            f"safety names {name!r}, which is no check",
            file=document.file,
            place=place,
            hint=did_you_mean(name, checks, what="checks of this rule set"),
        )
    name_of_class = body["class"]
    known = penalty.classes.get(name_of_class)
    weight = body.get("weight", known.value if known else None)
    if weight is None:
        raise RuleSetError(
            f"class {name_of_class!r} has no weight",
            file=document.file,
            place=place,
            hint=did_you_mean(name_of_class, penalty.classes, what="classes with a weight")
            + "; a class of your own needs 'weight:'",
        )
    told = f"{name_of_class} ({known.meaning})" if known else name_of_class
    return _Charged(name, weight, body.get("critical", True), told)


def _parameters(
    document: YamlDocument, penalty: Penalty, charged: list[_Charged], scale: float
) -> dict[str, Any]:
    own = document.data.get("parameters", {})
    # Weights and scale are set under `safety` alone; other parameters of the penalty are only defaults.
    from_safety = {each.parameter: each.stated for each in charged}
    from_safety[_SCALE] = {"value": scale, "meaning": _SCALE_MEANING}
    for name in from_safety:
        if name in own:
            raise _clash(document, ["parameters", name], f"parameter {name!r} is set by 'safety' as well")
    # A `null` stays, to be refused: it takes away what a base states, and a penalty is none.
    left = {name: body for name, body in penalty.parameters.items() if own.get(name, body) is not None}
    changed = {name: own[name] for name in left if name in own}
    return {**own, **from_safety, **merged_parameters(left, changed)}


def _terms(document: YamlDocument, penalty: Penalty, charged: list[_Charged]) -> dict[str, Any]:
    """The terms of the trial: its own, what was earned, those of the penalty unless overridden."""
    own = document.data.get("terms", {}).get("trial", {})
    if EARNED in own:
        raise _clash(
            document, ["terms", "trial", EARNED], f"term {EARNED!r} is the penalty's name for the score"
        )
    for name in penalty.terms:
        if name in document.data.get("parameters", {}):
            raise _clash(document, ["parameters", name], f"parameter {name!r} is also a term of {penalty.id}")
    # Formulas may name only terms above them: `earned` rests on the rule set's own, the penalty on `earned`.
    before = {name: formula for name, formula in own.items() if name not in penalty.terms}
    after = {name: own.get(name, _written(template, charged)) for name, template in penalty.terms.items()}
    return {**before, EARNED: document.data["score"], **after}


def _written(template: Any, charged: list[_Charged]) -> Any:
    """A formula of a penalty for these checks."""
    if not isinstance(template, Mapping):
        return template
    kept = [each for each in charged if _concerns(template.get("of", "all"), each)]
    if not kept:  # of nothing a product is 1 and a sum 0; so is what a function of no checks charges
        return 1 if template["join"].strip() == "*" else 0
    each = template["join"].join(
        template["each"].replace("CHECK", one.check).replace("WEIGHT", one.parameter) for one in kept
    )
    return str(template.get("in", "EACH")).replace("EACH", each)


def _concerns(of: str, each: _Charged) -> bool:
    return of == "all" or (each.critical if of == "critical" else each.weight > 0)


def _clash(document: YamlDocument, path: list[str], cause: str) -> RuleSetError:
    return RuleSetError(
        cause,
        file=document.file,
        place=document.place(path),
        hint="each name must be one thing: rename yours",
    )
