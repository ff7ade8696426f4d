"""What all tests share: the folder of official material, and how golden files are rewritten."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# The same examples on every machine, and no verdict about how fast a machine draws them.
settings.register_profile(
    "project", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("project")

ROOT = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    # Before pytest has loaded this file it takes the folder of `--rml-cases DIR` for one of tests, and looks
    # for its configuration there. So name the tests as well, `pytest tests/cases --rml-cases DIR`, or join
    # both with `=`.
    parser.addoption("--update-golden", action="store_true", help="rewrite golden files; read the diff")
    parser.addoption(
        "--official-cases",
        metavar="DIR",
        help="folder of official cases to run (default: ../shared/ariac/cases); it may not be empty",
    )
    parser.addoption(
        "--official-vectors",
        metavar="DIR",
        help="folder of official vectors to run (default: ../shared/ariac/vectors); it may not be empty",
    )
    parser.addoption(
        "--standards-cases",
        metavar="FILE",
        help="worked examples of the monitors to run (default: ../shared/standards/worked_examples.json)",
    )
    parser.addoption(
        "--rml-cases",
        metavar="DIR",
        help="folder of RML cases to run (default: ../shared/rml/cases/own); it may not be empty",
    )
    parser.addoption(
        "--bag-cases",
        metavar="DIR",
        help="folder of recordings with expectations to run (default: ../shared/bags); it may not be empty",
    )
    parser.addoption(
        "--aic-cases",
        metavar="DIR",
        help="folder of cases of the AI for Industry Challenge (default: ../shared/aic); it may not be empty",
    )


@pytest.fixture(scope="session", autouse=True)
def _interruptible() -> None:
    """Let commands that tests start be interrupted, which in the background of a script they could not be."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def update_golden(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update-golden"))


@pytest.fixture
def shared() -> Path:
    """The folder of official material beside the project; a user has none."""
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        pytest.skip("the folder of official material (../shared) is not here")
    return folder


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Put distributions on the path as an installer does: a module, METADATA, entry_points.txt.

    With `files`, by their path, the module is a package in which they lie; `also` gives the entry points
    of further groups.
    """
    from ariac_score.checks.registry import package_sha256  # noqa: PLC0415  # not for tests of other things

    before = set(sys.modules)

    def put(
        distribution: str,
        points: dict[str, str],
        *,
        source: str = "",
        version: str = "1.0",
        group: str = "ariac_score.rules",
        files: dict[str, str] | None = None,
        also: dict[str, dict[str, str]] | None = None,
    ) -> str:
        module = f"stranger_{distribution.replace('-', '_')}"
        place = tmp_path / f"{distribution}-{version}"
        place.mkdir()
        if files is None:
            (place / f"{module}.py").write_text(source, encoding="utf-8")
        for name, text in ({"__init__.py": source, **files} if files is not None else {}).items():
            (place / module / name).parent.mkdir(parents=True, exist_ok=True)
            (place / module / name).write_text(text, encoding="utf-8")
        folder = place / f"{distribution.replace('-', '_')}-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n", encoding="utf-8"
        )
        text = ""
        for each, named in {group: points, **(also or {})}.items():
            text += f"[{each}]\n"
            text += "".join(f"{name} = {module}:{attribute}\n" for name, attribute in named.items())
        (folder / "entry_points.txt").write_text(text, encoding="utf-8")
        monkeypatch.syspath_prepend(str(place))
        package_sha256.cache_clear()  # another test may have installed one of the same name
        return module

    yield put
    package_sha256.cache_clear()
    for name in set(sys.modules) - before:
        if name.startswith("stranger_"):
            del sys.modules[name]
