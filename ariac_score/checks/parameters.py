"""Parameters of plugins with their unit, their range, and how sure their default is.

A number taken from a standard is only as good as its source, so it carries both:

    t1_s: float = parameter(0.1, unit="s", status="our choice", source="set per system", at_least=0)

The class calls `check_parameters(self)` when it is made; `parameter_facts` gives what
was declared, for whoever shows it.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, Literal

__all__ = [
    "MEANINGS",
    "ParameterFacts",
    "Status",
    "check_parameters",
    "parameter",
    "parameter_facts",
    "parameter_meanings",
    "sections_of",
]

Status = Literal["verified", "from memory", "our choice", ""]
"""verified: seen in the named public source. from memory: not confirmed. our choice: nobody prescribes it.
Empty: the plugin does not say, as where rule sets are expected to give the number themselves."""

_KEY = "ariac_score"


@dataclass(frozen=True)
class ParameterFacts:
    """What a plugin declares about a parameter besides its type and default.

    Attributes:
        unit: SI unit, or 1; empty when it is not a number.
        status: How sure its default is.
        source: Where the default comes from.
        above: It must be larger than this.
        at_least: It must not be smaller than this.
        at_most: It must not be larger; a larger value is a slip, most often of the unit.
    """

    unit: str = ""
    status: Status = ""
    source: str = ""
    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf

    def problem(self, value: float) -> str:
        """What is wrong with a value, in words; empty when nothing is.

        >>> ParameterFacts(unit="s", at_most=60.0).problem(320.0)
        'but must be at most 60 s (is it given in thousandths of s?)'
        """
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        # "not a > b" instead of "a <= b", so that NaN is refused as well.
        if not value > self.above:
            return (
                "but must be positive" if self.above == 0 else f"but must be more than {self.above:g}{unit}"
            )
        if not value >= self.at_least:
            return (
                "but cannot be negative"
                if self.at_least == 0
                else f"but must be at least {self.at_least:g}{unit}"
            )
        if not value <= self.at_most:
            slip = f" (is it given in thousandths of{unit}?)" if unit else ""
            return f"but must be at most {self.at_most:g}{unit}{slip}"
        return ""


def parameter(
    default: Any,
    *,
    unit: str = "",
    status: Status = "our choice",
    source: str = "",
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> Any:
    """A field of a plugin, with its default and what is known about it.

    Args:
        default: The default; immutable.
        unit: SI unit of the number, or 1 for a number without; empty for anything else.
        status: How sure the default is.
        source: Where it comes from, in words.
        above: It must be larger than this.
        at_least: It must not be smaller than this.
        at_most: It must not be larger than this.
    """
    facts = ParameterFacts(unit, status, source, above, at_least, at_most)
    return field(default=default, metadata={_KEY: facts})


def facts_of(declared: Field[Any]) -> ParameterFacts:
    """What a field was declared with; nothing for a plain one."""
    found: Mapping[str, Any] = declared.metadata
    facts = found.get(_KEY)
    return facts if isinstance(facts, ParameterFacts) else ParameterFacts()


def parameter_facts(kind: Any) -> dict[str, ParameterFacts]:
    """The facts about every parameter of a plugin class (or of a plugin), by name."""
    return {declared.name: facts_of(declared) for declared in fields(kind) if declared.init}


def check_parameters(plugin: Any) -> None:
    """Refuse numbers outside their range.

    Raises:
        ValueError: Naming the parameter, its value, and the range.
    """
    for name, facts in parameter_facts(type(plugin)).items():
        value = getattr(plugin, name)
        # A bool is an int to Python, and a parameter without a number has no range.
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value:g} but must be finite")
        problem = facts.problem(value)
        if problem:
            raise ValueError(f"{name} is {value:g} {problem}")


# In words ------------------------------------------------------------------------------

_SECTION = re.compile(r"^([A-Z][A-Za-z ]*):\n((?:(?:[ ]{4}.*)?\n)+)", re.MULTILINE)
_MEANING = re.compile(r"^(\w+): (.*(?:\n[ ]+.*)*)", re.MULTILINE)
MEANINGS = "Attributes"
"""The section of a docstring that says what each parameter is."""


def sections_of(kind: Any) -> dict[str, str]:
    """The sections of the docstring of a plugin, such as `Violated when`, by their headings."""
    text = inspect.cleandoc(vars(kind).get("__doc__") or "") + "\n"
    return {match[1]: inspect.cleandoc(match[2]) for match in _SECTION.finditer(text)}


def parameter_meanings(kind: Any) -> dict[str, str]:
    """What a plugin says of its parameters, by name; what it inherits from a base counts as well."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        stated = _MEANING.finditer(sections_of(base).get(MEANINGS, ""))
        found |= {match[1]: " ".join(match[2].split()).removesuffix(".") for match in stated}
    return found
