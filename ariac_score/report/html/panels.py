"""Panels that distributions bring: plain data of a result and a block of a template, escaped like all pages.

A panel belongs to the results that its distribution took part in: pages of other results are the same
bytes whatever else is installed. One that fails says so in its place, and all others stand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from html.parser import HTMLParser
from typing import Any

from jinja2 import nodes
from markupsafe import Markup

from ariac_score.checks.contracts import ReportPanel
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import PluginError
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.report.html.page import panel_environment
from ariac_score.results.result import Result

__all__ = ["GROUP", "PanelShown", "panel_shown", "panels_of"]

GROUP = "ariac_score.report_panels"

MOST_CHARACTERS = 500_000
"""A longer panel is refused: a page is sent by mail, and opened on telephones."""

_VOID = frozenset(("br", "col", "hr", "wbr"))
_TAGS = _VOID | frozenset(
    (
        *("div", "span", "p", "bdi", "b", "i", "em", "strong", "small", "sub", "sup", "abbr", "code"),
        *("pre", "ul", "ol", "li", "dl", "dt", "dd", "h3", "h4", "a", "details", "summary", "figure"),
        *("figcaption", "table", "caption", "colgroup", "thead", "tbody", "tfoot", "tr", "th", "td"),
        *("svg", "g", "path", "line", "polyline", "polygon", "rect", "circle", "ellipse", "text"),
        *("tspan"),
    )
)
"""What a panel is written with. Named one by one, for browsers read raw and unknown elements (`noscript`,
`plaintext`) otherwise than any checker: what swallows, runs, loads or covers the page is not among them."""
_ATTRIBUTES = frozenset(
    (
        *("class", "title", "lang", "dir", "colspan", "rowspan", "scope", "span", "open", "role"),
        *("href", "viewbox", "width", "height", "preserveaspectratio", "d", "points", "transform"),
        *("x", "y", "dx", "dy", "x1", "y1", "x2", "y2", "cx", "cy", "r", "rx", "ry", "text-anchor"),
        *("dominant-baseline", "fill", "stroke", "stroke-width", "stroke-dasharray"),
        *("stroke-linecap", "opacity", "font-size"),
    )
)
"""Without `style`, which can lay a panel over the page, and whatever loads or runs."""


@dataclass(frozen=True)
class PanelShown:
    """One panel of a page.

    Attributes:
        name: Entry-point name.
        title: Its heading.
        block: Its HTML; `None` where it failed.
        fault: Why it cannot be shown; empty where it can.
    """

    name: str
    title: str
    block: Markup | None = None
    fault: str = ""


def panels_of(result: Result, registry: Registry | None = None) -> tuple[PanelShown, ...]:
    """The panels of the distributions that took part in a result, sorted by name."""
    took_part = {code.distribution for code in result.provenance.code}
    registry = registry or Registry()
    plugins = {p.name: p for p in registry.all(GROUP) if p.distribution in took_part}
    shown = (panel_shown(plugin, result, registry) for plugin in plugins.values())
    return tuple(panel for panel in shown if panel is not None)


def panel_shown(plugin: Plugin, result: Result, registry: Registry) -> PanelShown | None:
    """A panel for a result; `None` where it has nothing to say about it."""
    title = plugin.name
    try:
        panel: ReportPanel = registry.find(GROUP, plugin.name).value()
        title = str(panel.title)
        with quiet(plugin.origin, deep=True):
            data = panel.data(result)
            if data is None:
                return None
            block = _rendered(panel.template, _plain(data))
    except PluginError as error:
        return PanelShown(plugin.name, title, fault=str(error))
    except Exception as cause:  # noqa: BLE001  # a stranger's code may raise anything
        words = f"plugin {plugin.origin} raised {fault_of(cause)}"
        return PanelShown(plugin.name, title, fault=words)
    return PanelShown(plugin.name, title, Markup(block))  # noqa: S704  # escaped, and checked


def _rendered(template: str, data: Any) -> str:
    environment = panel_environment()
    tree = environment.parse(template)
    if any(tree.find_all((nodes.EvalContextModifier, nodes.ScopedEvalContextModifier))):
        raise ValueError("a panel is escaped like all pages: take 'autoescape' out of its template")
    pieces, characters = [], 0
    for piece in environment.from_string(template).generate(data=data):  # a template may write without end
        pieces.append(piece)
        characters += len(piece)
        if characters > MOST_CHARACTERS:
            raise ValueError(f"it has more than {MOST_CHARACTERS} characters")
    block = "".join(pieces)
    _Checked().check(block)
    return block


def _plain(data: Any) -> Any:
    """The data as plain values, so that nothing in them brings HTML of its own.

    Raises:
        TypeError: Something in them is no plain value.
    """
    if isinstance(data, str):
        return str.__str__(data)  # of a string that declares itself safe, the text
    if data is None or isinstance(data, bool):
        return data
    if isinstance(data, int):  # of a number of a class of its own, too, the plain one
        return int.__int__(data)
    if isinstance(data, float):
        return float.__float__(data)
    if isinstance(data, Decimal):
        return Decimal(data)
    if isinstance(data, Mapping):
        return {_plain(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    raise TypeError(f"its data hold a {type(data).__name__}; give numbers, texts, lists and maps of them")


class _Checked(HTMLParser):
    """Refuses a block that would not end where it began, or that a page cannot allow."""

    def check(self, block: str) -> None:
        """Read the whole block.

        Raises:
            ValueError: It may not stand in a page.
        """
        self.open: list[str] = []
        self.feed(block)
        self.close()
        if self.open or self.rawdata:
            raise ValueError(f"<{self.open[-1] if self.open else '…'}> is not closed")

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Refuse what the page cannot allow; remember what has to be closed."""
        if tag not in _TAGS:
            raise ValueError(f"<{tag}> may not stand in a panel")
        for name, value in attrs:
            if name.startswith("on"):
                raise ValueError(f"{name!r} would be a script, and a panel has none of its own")
            if name not in _ATTRIBUTES and not name.startswith("aria-"):
                raise ValueError(f"the attribute {name!r} may not stand in a panel")
            if "url(" in (value or "").lower():
                raise ValueError(f"{name!r} would load something, and a page loads nothing")
            if name == "href" and not (value or "").startswith("#"):
                raise ValueError("a link of a panel leads to a place on the page, such as '#ledger'")
        if tag not in _VOID:
            self.open.append(tag)

    def handle_comment(self, data: str) -> None:
        """Refuse comments, whose end browsers see elsewhere."""
        raise ValueError(f"a panel has no comments of HTML: {data[:20]!r}")

    def handle_decl(self, decl: str) -> None:
        """Refuse declarations, as comments."""
        self.handle_comment(decl)

    def handle_pi(self, data: str) -> None:
        """Refuse instructions, as comments."""
        self.handle_comment(data)

    def unknown_decl(self, data: str) -> None:
        """Refuse declarations of other languages, as comments."""
        self.handle_comment(data)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """In drawings a tag may end itself."""
        self.handle_starttag(tag, attrs)
        if tag not in _VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        """Refuse an end without its beginning."""
        if not self.open or self.open.pop() != tag:
            raise ValueError(f"</{tag}> closes nothing that it opened")
