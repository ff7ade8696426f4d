"""What `sensitivity` found, as a stored document: written for both kinds, read back for rankings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec import UNSET, Struct, UnsetType

from ariac_score.documents.plain_file import read_plain
from ariac_score.documents.schema import strict_json
from ariac_score.errors import DataFileError
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.result import Pinned
from ariac_score.review.sensitivity import Knob, RankSensitivity, RankShift, ScoreSensitivity
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["load_rank_sensitivity", "sensitivity_json"]

_FORMAT, _VERSION = "ariac-score sensitivity", 1
_HINT = "give what 'sensitivity COMPETITION -o FILE.json' wrote for this competition"


class _Header(Struct, frozen=True):
    """What every such document begins with.

    Attributes:
        format: Always `ariac-score sensitivity`.
        version: Of the format.
        of: The trial or the competition.
        rule_set: By which it was priced or ranked.
    """

    format: str
    version: int
    of: str
    rule_set: Pinned


class _Number(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One number that was varied; left out are the findings where it was skipped.

    Attributes:
        name: A parameter of the formulas, or `check.parameter`.
        value: In the rule set.
        low: Lowest value it was given.
        high: Highest value it was given.
        declared: Whether the rule set states the range.
        skipped: Why it was not varied.
    """

    name: str
    value: float
    low: float
    high: float
    declared: bool
    skipped: str = ""


class _ScoreRange(Struct, frozen=True):
    low: float | None
    base: float | None
    high: float | None


# UNSET and not None as defaults: None is a finding ("no such value") and must be written.
class _ScoreNumber(_Number, frozen=True):
    score: _ScoreRange | UnsetType = UNSET
    elasticity: float | UnsetType | None = UNSET
    changes_below: float | UnsetType | None = UNSET
    changes_above: float | UnsetType | None = UNSET


class _Shift(Struct, frozen=True, forbid_unknown_fields=True):
    value: float
    before: Mapping[str, int | None]
    after: Mapping[str, int | None]


class _RankNumber(_Number, frozen=True):
    shifts: tuple[_Shift, ...] | UnsetType = UNSET


class _Scores(_Header, frozen=True, forbid_unknown_fields=True):
    numbers: tuple[_ScoreNumber, ...]


class _Ranks(_Header, frozen=True, forbid_unknown_fields=True):
    numbers: tuple[_RankNumber, ...]


# Writing -------------------------------------------------------------------------------


def sensitivity_json(
    found: list[ScoreSensitivity] | list[RankSensitivity], rule_set: RuleSet, of: str
) -> str:
    """The findings as JSON.

    Args:
        found: One entry for each number, all of one kind.
        rule_set: By which the score or the ranking was made.
        of: The trial or the competition.
    """
    rules = Pinned(rule_set.id, rule_set.sha256)
    scores = tuple(_score_number(each) for each in found if isinstance(each, ScoreSensitivity))
    ranks = tuple(_rank_number(each) for each in found if isinstance(each, RankSensitivity))
    of_scores = _Scores(_FORMAT, _VERSION, of, rules, scores)
    of_ranks = _Ranks(_FORMAT, _VERSION, of, rules, ranks)
    document = of_scores if scores else of_ranks
    # Not the canonical text of `Format`: this document is older, and files of it are published.
    return json.dumps(msgspec.to_builtins(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _score_number(each: ScoreSensitivity) -> _ScoreNumber:
    knob = each.knob
    number = _ScoreNumber(knob.name, knob.base, knob.low, knob.high, knob.declared, each.skipped)
    if each.skipped:
        return number
    return msgspec.structs.replace(
        number,
        score=_ScoreRange(each.low, each.base, each.high),
        elasticity=each.elasticity,
        changes_below=each.changes_below,
        changes_above=each.changes_above,
    )


def _rank_number(each: RankSensitivity) -> _RankNumber:
    knob = each.knob
    number = _RankNumber(knob.name, knob.base, knob.low, knob.high, knob.declared, each.skipped)
    if each.skipped:
        return number
    shifts = tuple(_Shift(shift.value, shift.before, shift.after) for shift in each.shifts)
    return msgspec.structs.replace(number, shifts=shifts)


# Reading -------------------------------------------------------------------------------


def load_rank_sensitivity(path: Path, of: str, rule_set: Pinned) -> list[RankSensitivity]:
    """Read back what `sensitivity_json` wrote about a ranking.

    Args:
        path: The file.
        of: The competition it must be of.
        rule_set: Id and SHA-256 of the rules it must be of.

    Raises:
        DataFileError: Missing, something else, or of another competition or other rules.
    """
    try:
        data = strict_json(read_plain(path, MAX_BYTES).decode("utf-8"))
    except OSError as cause:
        raise DataFileError(f"cannot be read: {cause.strerror}", file=path, hint="check the path") from None
    except (ValueError, RecursionError) as cause:
        raise DataFileError(f"not a sensitivity: {cause}", file=path, hint=_HINT) from None
    try:
        _check_header(msgspec.convert(data, _Header), path, of, rule_set)
        return [_rank_sensitivity(number) for number in msgspec.convert(data, _Ranks).numbers]
    except msgspec.ValidationError as cause:
        words = f"not the sensitivity of a ranking: {cause}"
        raise DataFileError(words, file=path, hint=_HINT) from None


def _check_header(header: _Header, path: Path, of: str, rule_set: Pinned) -> None:
    if (header.format, header.version) != (_FORMAT, _VERSION):
        raise DataFileError("not a sensitivity of this version", file=path, hint=_HINT)
    if header.of != of or header.rule_set != rule_set:
        raise DataFileError(
            f"it is of {header.of!r} under {header.rule_set.id} ({header.rule_set.sha256[:12]}…), "
            f"not of {of!r} under {rule_set.id} ({rule_set.sha256[:12]}…)",
            file=path,
            hint=_HINT,
        )


def _rank_sensitivity(number: _RankNumber) -> RankSensitivity:
    check = number.name.rpartition(".")[0]
    knob = Knob(number.name, number.value, number.low, number.high, number.declared, check)
    shifts = () if isinstance(number.shifts, UnsetType) else number.shifts
    return RankSensitivity(
        knob, tuple(RankShift(s.value, s.before, s.after) for s in shifts), skipped=number.skipped
    )
