"""What all tests share: the folder of official material, and how golden files are rewritten."""

from __future__ import annotations

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
    parser.addoption("--update-golden", action="store_true", help="rewrite golden files; read the diff")
    parser.addoption(
        "--official-cases",
        metavar="DIR",
        help="folder of official cases to run (default: ../shared/ariac/cases); it may not be empty",
    )
    parser.addoption(
        "--bag-cases",
        metavar="DIR",
        help="folder of recordings with expectations to run (default: ../shared/bags); it may not be empty",
    )


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
