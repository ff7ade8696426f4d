"""What the site has beyond the pages of the folder: references made of the code, files that are linked to."""

from __future__ import annotations

import argparse
import inspect
import json
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

import ariac_score
from ariac_score.cli import _GROUPS, _parser
from ariac_score.cli.parser import leaves

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WORKER = "assets/worker.js"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the pages of plugins and rulebooks, which are as many as there are."""
    assert config.nav is not None
    (reference,) = [part["Reference"] for part in config.nav if "Reference" in part]
    for title, folder in (("Plugins", "plugins"), ("Rulebooks", "rulebooks")):
        pages = _pages(DOCS / folder)
        if pages:
            reference.append({title: pages})
    return config


def _pages(folder: Path) -> list[Any]:
    """The pages of a folder and those below, its own index first."""
    files = sorted(folder.glob("*.md"), key=lambda file: (file.name != "README.md", file.name))
    entries: list[Any] = [
        _name(file) if file.name == "README.md" else {file.stem: _name(file)} for file in files
    ]
    for below in sorted(path for path in folder.glob("*") if path.is_dir()):
        entries.append({below.name.replace("_", " ").capitalize(): _pages(below)})
    return entries


def _name(file: Path) -> str:
    return file.relative_to(DOCS).as_posix()


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is made of the code, and what lies beside the folder and is linked to."""
    for name, text in (
        ("reference/commands.md", _commands_page()),
        ("reference/schemas.md", _schemas_page()),
        ("reference/python.md", _python_page()),
    ):
        files.append(File.generated(config, name, content=text))
    for file in [*sorted((ROOT / "schemas").glob("*.json")), *sorted(ROOT.glob("examples/**/README.md"))]:
        if not _is_built(file):
            name = file.relative_to(ROOT).as_posix()
            copied = File.generated(config, name, abs_src_path=str(file), inclusion=InclusionLevel.NOT_IN_NAV)
            files.append(copied)
    files.append(File.generated(config, WORKER, abs_src_path=str(Path(__file__).with_name("worker.js"))))
    return files


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:  # noqa: ARG001
    """Leave nothing in a page that is fetched from the network."""
    return _from_here(output, page.file.url)


def on_post_template(output_content: str, template_name: str, config: MkDocsConfig) -> str:  # noqa: ARG001
    """The same for the page that says that there is none."""
    return _from_here(output_content, template_name) if template_name == "404.html" else output_content


def _from_here(html: str, url: str) -> str:
    """A page with our script in the place of the one that the theme would fetch."""
    html = html.replace("https://unpkg.com/iframe-worker/shim", url.count("/") * "../" + WORKER)
    fetched = re.findall(
        r"<(?:script|img|iframe|link rel=\"?stylesheet)[^>]*(?:src|href)=\"?(https?:[^\s\">]+)", html
    )
    if fetched:
        raise PluginError(f"{url} would be fetching {fetched[0]}: see docs/site/hooks.py")
    return html


def _is_built(file: Path) -> bool:
    return any(part in ("build", "node_modules") or part.endswith(".egg-info") for part in file.parts)


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Lead links out of the folder to the copies in the site; of a link to other files the words stay."""
    here = posixpath.dirname(page.file.src_uri)
    outside = here.startswith("examples")

    def led(link: re.Match[str]) -> str:
        target, hash_, anchor = link[2].partition("#")
        if re.match(r"[a-z]+:", target) or not target:
            return link[0]
        base = here if outside else posixpath.join("docs", here)
        place = posixpath.normpath(posixpath.join(base, target))  # in the repository
        inside = place.removeprefix("docs/")
        for name in (inside, f"{inside}/README.md"):
            if files.get_file_from_path(name) is not None:
                return f"{link[1]}({posixpath.relpath(name, here or '.')}{hash_}{anchor})"
        return link[1].removeprefix("!").strip("[]") if (ROOT / place).exists() else link[0]

    return re.sub(r"(!?\[[^\]\n]*\])\(([^)\s]+)\)", led, markdown)


# Generated pages -----------------------------------------------------------------------


def _commands_page() -> str:
    lines = ["# Every option", "", "As `ariac-score COMMAND --help` prints them."]
    for heading, names in _GROUPS.items():
        lines += ["", f"## {heading[:1].upper()}{heading[1:]}"]
        for name in names:
            lines += [line for leaf in leaves(_parser(name)) for line in _command(leaf)]
    lines += ["", "## From plugins", *(line for leaf in leaves(_parser("rml")) for line in _command(leaf))]
    return "\n".join(lines) + "\n"


def _command(parser: argparse.ArgumentParser) -> Iterator[str]:
    formatter = parser._get_formatter()
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups, prefix="")
    if parser.prog == "ariac-score":  # the top, which has commands alone
        return
    name = parser.prog.removeprefix("ariac-score ")
    yield from ("", f"### `{name}`", "", _text(parser.description or ""), "")
    yield from ("```text", *formatter.format_help().rstrip().splitlines(), "```", "")
    yield from ("| argument or option | what it says |", "|---|---|")
    for action in parser._actions:
        if argparse.SUPPRESS not in (action.help, action.default):
            name = ", ".join(action.option_strings) or str(action.metavar or action.dest)
            takes = f" {action.metavar}" if action.option_strings and action.metavar else ""
            choices = f" ({', '.join(map(str, action.choices))})" if action.choices else ""
            about = _cell(_text((action.help or "").replace("%%", "%")))
            yield f"| `{_cell(f'{name}{takes}')}` | {about}{choices} |"


def _text(text: str) -> str:
    return re.sub(r"([<>*_\[\]])", r"\\\1", text)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _schemas_page() -> str:
    lines = ["# Stored documents", "", "The files that are read and written, and their JSON schemas.", ""]
    lines += ["| schema | what it is |", "|---|---|"]
    schemas = sorted((ROOT / "schemas").glob("*.json"))
    loaded = {file.name: json.loads(file.read_text(encoding="utf-8")) for file in schemas}
    for name, schema in loaded.items():
        about = schema.get("description") or schema.get("title") or ""
        lines.append(f"| [{name.removesuffix('.schema.json')}](../schemas/{name}) | {_cell(_text(about))} |")
    for name, schema in loaded.items():
        properties = _properties(schema)
        if not properties:
            continue
        required = set(_object(schema).get("required", ()))
        lines += ["", f"## {name.removesuffix('.schema.json')}", ""]
        lines += ["| key | required | what it says |", "|---|---|---|"]
        for key, value in properties.items():
            about = value.get("description", "") if isinstance(value, dict) else ""
            lines.append(f"| `{key}` | {'yes' if key in required else ''} | {_cell(_text(about))} |")
    return "\n".join(lines) + "\n"


def _object(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of the document itself, where it is one that others are beside."""
    reference = schema.get("$ref", "")
    if reference.startswith("#/$defs/"):
        found: dict[str, Any] = schema["$defs"][reference.removeprefix("#/$defs/")]
        return found
    return schema


def _properties(schema: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = _object(schema).get("properties", {})
    return found


def _python_page() -> str:
    lines = ["# Python", "", "The names of `ariac_score`; [by example](../public_names.md)."]
    for name in sorted(ariac_score.__all__):
        value = getattr(ariac_score, name)
        lines += ["", f"## `{name}`", ""]
        if inspect.isclass(value) or inspect.isfunction(value):
            try:
                signature = str(inspect.signature(value)).replace("'", "")
            except ValueError:
                signature = "(…)"
            kind = "class" if inspect.isclass(value) else "def"
            lines += ["```python", f"{kind} {name}{signature}", "```", ""]
        lines += ["```text", inspect.getdoc(value) or "", "```"]
    return "\n".join(lines) + "\n"
