"""The laws of `docs/architecture.md`, kept true file by file.

Every import counts: at the top, inside functions, and for type checkers alone. One that is hidden in
a function ties two rooms together as firmly as one at the top of its file.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

import ariac_score

ROOT = Path(__file__).parents[1]
CORE = ROOT / "ariac_score"
PLUGINS = sorted(p.name for p in (ROOT / "plugins").iterdir() if (p / "__init__.py").is_file())

FLOORS: tuple[tuple[str, ...], ...] = (
    ("errors",),
    ("documents", "terminal", "installed"),
    ("trial", "serving"),
    ("checks",),
    ("scoring", "logs", "monitors"),
    ("results",),
    ("engine",),
    ("ranking", "oracle", "live"),
    ("testing",),
    ("review", "batch"),
    ("redteam",),
    ("report",),
    ("platforms",),
    ("cli",),
    ("__main__",),
)
"""Rooms from the ground up. One imports only from floors below its own; those of one floor never meet."""

FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}

A_BYTE_GOES = ("containers", "columnar", "gather", "")
"""Inside `logs`: what reads bytes, what decodes them, what collects columns, the readers themselves."""

LIBRARIES = {  # of others, by room; all else is the standard library
    "errors": set[str](),
    "documents": {"jsonschema", "yaml"},
    "terminal": {"rich"},
    "installed": set[str](),
    "trial": {"numpy", "pandas"},
    "serving": set[str](),
    "checks": {"numpy"},
    "scoring": {"msgspec", "numpy", "yaml"},
    "logs": {"backports", "cramjam", "lz4", "numpy", "rosbags", "yaml"},
    "results": {"minisign", "msgspec", "numpy"},
    "monitors": {"numpy"},
    "engine": {"numpy"},
    "ranking": {"msgspec", "numpy"},
    "oracle": {"websockets"},
    "live": {"cbor2", "cyclonedds", "numpy", "websockets", "zenoh"},
    "testing": {"cramjam", "numpy", "rosbags", "yaml"},
    "redteam": {"numpy"},
    "review": {"msgspec", "numpy", "rosbags"},
    "batch": {"distributed", "fsspec", "msgspec", "numpy", "pyarrow", "ray"},
    "report": {"foxglove", "jinja2", "markupsafe", "msgspec"},
    "platforms": {"msgspec", "yaml"},
    "cli": {"rich", "tomli"},
    "__main__": set[str](),
}

FOR_PLUGINS = ("monitors", "testing")
"""Rooms whose names plugins may use besides those of the face: what stands in their `__all__`."""


@cache  # every law looks at nearly every file
def _imports(path: Path) -> tuple[str, ...]:
    """Every name that a file imports anywhere, dotted: of a module, or of something in one."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _room(module: str) -> str:
    """The room a dotted name of ours is in; empty for names of the package itself, and for others'."""
    parts = module.split(".")
    return parts[1] if parts[0] == "ariac_score" and len(parts) > 1 and parts[1] in FLOOR else ""


def _files() -> list[Path]:
    return [path for path in sorted(CORE.rglob("*.py")) if "templates" not in path.parts]


def _of(path: Path) -> str:
    return path.relative_to(CORE).parts[0].removesuffix(".py")


def test_no_module_stands_loose_but_the_face_and_the_errors() -> None:
    assert sorted(path.name for path in CORE.glob("*.py")) == ["__init__.py", "__main__.py", "errors.py"]
    rooms = {path.name for path in CORE.iterdir() if path.is_dir() and any(path.glob("*.py"))}

    assert rooms | {"errors", "__main__"} == set(FLOOR)


@pytest.mark.slow
def test_every_file_imports_only_from_floors_below_its_room() -> None:
    up = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in _files()
        if path != CORE / "__init__.py"
        for module in _imports(path)
        if _room(module) and _room(module) != _of(path) and FLOOR[_room(module)] >= FLOOR[_of(path)]
    ]

    assert up == []


def test_files_import_rooms_and_not_the_face_of_the_package() -> None:
    """The public names are for others; inside, an arrow says where it leads."""
    faces = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in _files()
        if path != CORE / "__init__.py" and "testing" not in path.parts
        for module in _imports(path)
        if module.startswith("ariac_score.") and not _room(module) and module.split(".")[1] not in FLOOR
    ]

    assert faces == []


def test_inside_logs_bytes_go_one_way() -> None:
    def place(parts: tuple[str, ...]) -> int:
        return A_BYTE_GOES.index(parts[0] if parts and parts[0] in A_BYTE_GOES else "")

    back = []
    for path in sorted((CORE / "logs").rglob("*.py")):
        own = place(path.relative_to(CORE / "logs").parts)
        for module in _imports(path):
            parts = tuple(module.split("."))
            if parts[:2] == ("ariac_score", "logs") and place(parts[2:]) > own:
                back.append(f"{path.relative_to(ROOT)} imports {module}")

    assert back == []


def test_the_core_imports_no_plugin() -> None:
    assert [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in _files()
        for module in _imports(path)
        if module.split(".")[0] in PLUGINS
    ] == []


def test_rooms_use_only_their_libraries() -> None:
    strangers = [
        f"{path.relative_to(ROOT)} imports {top}"
        for path in _files()
        if path != CORE / "__init__.py"
        for top in {module.split(".")[0] for module in _imports(path)}
        if top not in sys.stdlib_module_names and top != "ariac_score" and top not in LIBRARIES[_of(path)]
    ]

    assert strangers == []


@pytest.mark.parametrize("package", PLUGINS)
def test_first_party_plugins_use_only_what_is_public(package: str) -> None:
    public = {"ariac_score"} | {f"ariac_score.{name}" for name in ariac_score.__all__}
    for room in FOR_PLUGINS:
        listed = import_module(f"ariac_score.{room}").__all__
        public |= {f"ariac_score.{room}", *(f"ariac_score.{room}.{name}" for name in listed)}
    below = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in sorted((ROOT / "plugins" / package).rglob("*.py"))
        for module in _imports(path)
        if module.split(".")[0] == "ariac_score"
        and module not in public
        and not module.startswith("ariac_score.testing.")
    ]
    others = [
        f"{path.relative_to(ROOT)} imports {top}"
        for path in sorted((ROOT / "plugins" / package).rglob("*.py"))
        for top in {module.split(".")[0] for module in _imports(path)}
        if top in set(PLUGINS) - {package}
    ]

    assert below + others == []


def _circles(root: Path, files: Iterable[Path]) -> list[str]:
    """The modules that are in a circle of imports, or between two; `root` holds their packages."""
    modules = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in files
    }
    # The face of the core loads its names when they are first used, and no room imports it (see above).
    arrows = {
        name: {m if m in modules else m.rpartition(".")[0] for m in _imports(path)}
        & modules.keys() - {name, "ariac_score"}
        for name, path in modules.items()
        if name != "ariac_score"
    }
    while ends := {n for n, reached in arrows.items() if not reached & arrows.keys()} | (
        arrows.keys() - {m for reached in arrows.values() for m in reached}
    ):
        arrows = {name: reached for name, reached in arrows.items() if name not in ends}
    return sorted(arrows)


def test_no_file_of_the_core_is_in_a_circle_of_imports() -> None:
    assert _circles(ROOT, _files()) == []


@pytest.mark.parametrize("package", PLUGINS)
def test_no_file_of_a_plugin_is_in_a_circle_of_imports(package: str) -> None:
    assert _circles(ROOT / "plugins", sorted((ROOT / "plugins" / package).rglob("*.py"))) == []


def test_a_circle_is_found_however_its_imports_are_hidden(tmp_path: Path) -> None:
    """Else the laws above would hold of anything."""
    (tmp_path / "p").mkdir()
    texts = {
        "__init__": "from p.a import f",
        "a": "def f():\n    from p.b import g",
        "b": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import p.c",
        "c": "from p import a",
        "d": "from p.e import x",
        "e": "import math",
    }
    for name, text in texts.items():
        (tmp_path / "p" / f"{name}.py").write_text(text, encoding="utf-8")

    assert _circles(tmp_path, sorted(tmp_path.rglob("*.py"))) == ["p.a", "p.b", "p.c"]


def test_the_public_names_stand_alike_where_they_are_typed_loaded_and_listed() -> None:
    tree = ast.parse((ROOT / "ariac_score/__init__.py").read_text(encoding="utf-8"))
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    (table,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_MODULE_OF"
    )

    assert table == {
        alias.name: node.module
        for node in typed.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(table) == sorted(ariac_score.__all__)


def test_every_public_name_can_be_had() -> None:
    for name in ariac_score.__all__:
        assert getattr(ariac_score, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ariac_score.nothing  # type: ignore[attr-defined]
