"""From a template to a page: everything escaped, nothing loaded from elsewhere, no script but ours run."""

from __future__ import annotations

import base64
import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.sandbox import ImmutableSandboxedEnvironment, safe_range
from markupsafe import Markup

from ariac_score.report.html import wording
from ariac_score.report.statements import left_out, rests_on

__all__ = ["embedded_json", "page", "panel_environment", "part", "policy_of", "shipped"]

_REPORT = Path(__file__).parents[1]
_TEMPLATES = (_REPORT / "html/templates", _REPORT / "site/templates")


def page(template: str, **values: Any) -> str:
    """A page from a template.

    Args:
        template: Its name, such as `trial.html.j2`.
        values: The values of its names; a name without a value is an error.
    """
    return _environment().get_template(template).render(**values)


def part(template: str, **values: Any) -> Markup:
    """A part of a page from a template, to stand in another one as it is."""
    return Markup(page(template, **values))  # noqa: S704  # the template has escaped what it was given


@lru_cache(maxsize=1)
def panel_environment() -> Environment:
    """In which the blocks of panels are rendered: as pages are, with no way around escaping or out."""
    environment = _made(None, ImmutableSandboxedEnvironment)
    del environment.filters["safe"]
    # Without `lipsum`, which is random, so that the same result gives the same bytes.
    environment.globals = {"range": safe_range}
    return environment


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = _made(FileSystemLoader(_TEMPLATES))
    environment.globals.update(embedded_json=embedded_json, policy_of=policy_of, shipped=shipped)
    return environment


def _made(loader: FileSystemLoader | None, kind: type[Environment] = Environment) -> Environment:
    environment = kind(
        autoescape=True,
        undefined=StrictUndefined,  # a misspelt name would else be an empty place on a published page
        loader=loader,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        auto_reload=False,
    )
    environment.filters.update(
        amount=wording.amount,
        brief=wording.brief,
        file_name=wording.file_name,
        number=wording.number,
        points=wording.points,
        round_to=wording.round_to,
        seconds=wording.seconds,
        spoken=wording.spoken,
        untrusted=wording.untrusted,
        left_out=left_out,
        rests_on=rests_on,
    )
    return environment


@lru_cache(maxsize=8)
def shipped(name: str) -> Markup:
    """The text of one of our own style sheets or scripts, to stand in a page as it is."""
    for folder in _TEMPLATES:
        if (folder / name).is_file():
            return Markup((folder / name).read_text(encoding="utf-8"))  # noqa: S704  # ours
    raise FileNotFoundError(name)


def policy_of(*scripts: str, connects: bool = False) -> str:
    """The content security policy of a page: our scripts by their hash, nothing else, no network.

    Args:
        scripts: The texts of its inline scripts, exactly as they stand in the page.
        connects: Whether it may ask the server that it came from.
    """
    hashes = [base64.b64encode(hashlib.sha256(s.encode("utf-8")).digest()).decode("ascii") for s in scripts]
    # Bars and marks are placed by style attributes, which differ from page to page: hashes cannot list them.
    allowed = " ".join(f"'sha256-{digest}'" for digest in hashes) or "'none'"
    connect = "connect-src 'self'; " if connects else ""
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data:; "
        f"{connect}base-uri 'none'; form-action 'none'"
    )


def embedded_json(text: str) -> Markup:
    r"""JSON to stand in a `<script type="application/json">`: the same value, and no tag can end it.

    >>> print(embedded_json('"</script>"'))
    "\u003c/script>"

    Raises:
        ValueError: It is not JSON.
    """
    json.loads(text)
    # JSON has no '<' outside of strings, so every one of them may be written as an escape.
    return Markup(text.replace("<", "\\u003c"))  # noqa: S704  # no tag left
