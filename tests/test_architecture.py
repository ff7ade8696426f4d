"""The import table of `docs/architecture.md`, kept true."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CORE = ROOT / "ariac_score"
PLUGINS = sorted(p.name for p in (ROOT / "plugins").iterdir() if (p / "__init__.py").is_file())

# What any part may import: it stands in for a part of the standard library.
EVERYWHERE = {"records"}

# What each part may import besides the standard library, that, and itself.
MAY_IMPORT: dict[str, set[str]] = {
    "errors": set(),
    "datafiles": {"errors", "jsonschema", "plain_schema", "yaml"},
    "plain_schema": set(),
    "records": set(),
    "plain_json": set(),
    "later": set(),
    "installed": set(),
    "expression": {"errors", "later", "numpy"},
    "trial": {"errors", "later", "numpy"},
    "findings": {"trial"},
    "contracts": {"findings", "trial"},
    "parameters": set(),
    "quiet": set(),
    "registry": {"contracts", "errors", "installed", "parameters", "quiet"},
    "scoring": {"errors", "expression", "findings"},
    "penalties": {"datafiles", "errors"},
    "ruleset": {"datafiles", "errors", "expression", "penalties", "registry", "scoring", "yaml"},
    "logmap": {"datafiles", "errors", "trial"},
    "result": {"errors", "findings", "scoring", "trial"},
    "sketch_json": {"trial"},
    "adjustments": {"datafiles", "errors", "findings", "result", "ruleset", "scoring"},
    "result_json": {
        "adjustments",
        "datafiles",
        "errors",
        "expression",
        "findings",
        "plain_json",
        "result",
        "ruleset",
        "scoring",
        "sketch_json",
        "trial",
    },
    "cohort": {"datafiles", "errors", "expression", "result", "ruleset", "scoring"},
    "guard": {"contracts", "errors", "quiet", "registry", "trial"},
    "needs": {"contracts", "errors", "guard", "quiet", "registry", "ruleset", "trial"},
    "settings": {"contracts", "guard", "parameters", "quiet", "registry", "result", "ruleset"},
    "asking": {"contracts", "errors", "findings", "guard", "needs", "quiet", "registry", "result", "trial"},
    "engine": {
        "installed",
        "needs",
        "asking",
        "guard",
        "contracts",
        "errors",
        "findings",
        "logmap",
        "logs",
        "registry",
        "result",
        "ruleset",
        "scoring",
        "settings",
        "trial",
    },
    "certain": {"errors", "expression", "findings", "result", "ruleset", "scoring"},
    "comparison": {"certain", "expression", "ruleset", "scoring"},
    "audit": {
        "certain",
        "contracts",
        "comparison",
        "engine",
        "errors",
        "expression",
        "logmap",
        "logs",
        "registry",
        "ruleset",
        "scoring",
        "trial",
    },
    "audit_json": {"audit", "comparison", "expression", "result"},
    "logs": {"backports", "contracts", "datafiles", "errors", "later", "lz4", "numpy", "rosbags", "trial"},
    "oracle": {
        "contracts",
        "engine",
        "errors",
        "findings",
        "guard",
        "logmap",
        "logs",
        "registry",
        "result",
        "result_json",
        "ruleset",
        "trial",
        "websockets",
    },
    "ranking": {
        "adjustments",
        "cohort",
        "contracts",
        "datafiles",
        "engine",
        "errors",
        "expression",
        "findings",
        "logs",
        "numpy",
        "registry",
        "result",
        "result_json",
        "ruleset",
        "scoring",
        "trial",
    },
    "batch": {
        "contracts",
        "datafiles",
        "distributed",
        "engine",
        "errors",
        "fsspec",
        "logmap",
        "logs",
        "pyarrow",
        "ranking",
        "ray",
        "registry",
        "result",
        "result_json",
        "ruleset",
    },
    "platforms": {
        "batch",
        "datafiles",
        "engine",
        "errors",
        "findings",
        "ranking",
        "report",
        "result",
        "result_json",
        "ruleset",
        "yaml",
    },
    "recoverable": {"errors", "expression", "findings", "result", "ruleset", "scoring"},
    "laws": {
        "contracts",
        "errors",
        "expression",
        "findings",
        "numpy",
        "penalties",
        "registry",
        "ruleset",
        "scoring",
        "trial",
    },
    "signing": {"errors", "minisign", "result_json"},
    "sensitivity": {
        "contracts",
        "engine",
        "errors",
        "logmap",
        "logs",
        "ranking",
        "registry",
        "result",
        "ruleset",
        "scoring",
        "trial",
    },
    "margins": {
        "asking",
        "contracts",
        "engine",
        "errors",
        "findings",
        "guard",
        "later",
        "logmap",
        "needs",
        "numpy",
        "quiet",
        "registry",
        "result",
        "ruleset",
        "trial",
    },
    "annotations_mcap": {"errors", "later", "logs", "numpy", "rosbags", "trial"},
    "annotations": {
        "annotations_mcap",
        "errors",
        "findings",
        "later",
        "margins",
        "numpy",
        "result",
        "scoring",
        "trial",
    },
    "readiness": {
        "asking",
        "engine",
        "findings",
        "logmap",
        "needs",
        "registry",
        "result",
        "ruleset",
        "trial",
    },
    "verify": {
        "adjustments",
        "datafiles",
        "engine",
        "errors",
        "ranking",
        "registry",
        "result",
        "result_json",
        "ruleset",
        "settings",
    },
    "report": {
        "adjustments",
        "audit",
        "comparison",
        "errors",
        "expression",
        "findings",
        "jinja2",
        "markupsafe",
        "ranking",
        "recoverable",
        "result",
        "result_json",
        "ruleset",
        "scoring",
        "sensitivity",
        "trial",
    },
    "testing": {
        "asking",
        "contracts",
        "cramjam",
        "errors",
        "findings",
        "guard",
        "installed",
        "logmap",
        "logs",
        "needs",
        "numpy",
        "quiet",
        "registry",
        "result",
        "rosbags",
        "ruleset",
        "trial",
        "yaml",
    },
}
ANYTHING = {"cli", "__init__"}
SLOW = {"rosbags", "jsonschema", "rich", "jinja2", "markupsafe", "websockets", "minisign"}


def _part(path: Path) -> str:
    relative = path.relative_to(CORE)
    return relative.parts[0].removesuffix(".py")


def _imports(path: Path, *, at_top: bool = False) -> set[str]:
    """Every module a file imports, both as `import x` and as `from x import y`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = tree.body if at_top else list(ast.walk(tree))
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            module = node.module or ""
            found |= (
                {f"{module}.{alias.name}" for alias in node.names} if module == "ariac_score" else {module}
            )
    return found


def _names(modules: set[str]) -> set[str]:
    """Parts of ours by their name, other packages by their top one; the standard library left out."""
    names: set[str] = set()
    for module in modules:
        top, _, rest = module.partition(".")
        if top == "ariac_score":
            names.add(rest.partition(".")[0] or "__init__")
        elif top not in sys.stdlib_module_names:
            names.add(top)
    return names


CORE_FILES = sorted(CORE.rglob("*.py"))


@pytest.mark.parametrize("path", CORE_FILES, ids=lambda p: str(p.relative_to(CORE)))
def test_a_part_imports_only_what_the_architecture_allows(path: Path) -> None:
    part = _part(path)
    if part in ANYTHING:
        return
    assert part in MAY_IMPORT, f"{part} is not in the architecture: add it there first"

    assert _names(_imports(path)) - {part} - EVERYWHERE <= MAY_IMPORT[part]


def test_every_part_of_the_table_exists() -> None:
    assert set(MAY_IMPORT) | ANYTHING == {_part(path) for path in CORE_FILES}


@pytest.mark.parametrize("package", PLUGINS)
def test_first_party_plugins_use_only_what_is_public(package: str) -> None:
    for path in sorted((ROOT / "plugins" / package).rglob("*.py")):
        modules = _imports(path)
        ours = {m for m in modules if m.split(".")[0] == "ariac_score"}
        import ariac_score  # noqa: PLC0415  # the list of public names is what is tested

        assert {m.removeprefix("ariac_score.") for m in ours} <= {
            *ariac_score.__all__,
            "later",
            *EVERYWHERE,
        }, path
        assert _names(modules - ours) <= {"numpy", package}, path


@pytest.mark.parametrize("path", CORE_FILES, ids=lambda p: str(p.relative_to(CORE)))
def test_slow_libraries_are_imported_only_where_they_are_used(path: Path) -> None:
    assert not _names(_imports(path, at_top=True)) & SLOW


def test_a_price_cannot_depend_on_a_log() -> None:
    for path in (CORE / "scoring").rglob("*.py"):
        assert not _names(_imports(path)) & {"trial", "logs", "contracts", "engine"}


def test_every_public_name_can_be_had() -> None:
    import ariac_score  # noqa: PLC0415  # the package is what is tested

    for name in ariac_score.__all__:
        assert getattr(ariac_score, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ariac_score.nothing  # type: ignore[attr-defined]
