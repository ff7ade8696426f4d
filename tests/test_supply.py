"""What is installed with the package: pinned for the container, and listed."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
LOCK = (ROOT / ".ci/container.txt").read_text(encoding="utf-8")
PINNED = {
    re.sub("[-_.]+", "-", name): (version, re.findall(r"--hash=sha256:([0-9a-f]{64})", hashes))
    for name, version, hashes in re.findall(r"^(\S+)==(\S+) \\\n((?:    --hash=\S+(?: \\)?\n)+)", LOCK, re.M)
}


def program(name: str) -> ModuleType:
    """A program of CI as a module: such files have no suffix."""
    loader = importlib.machinery.SourceFileLoader(name, str(ROOT / ".ci" / name))
    specification = importlib.util.spec_from_loader(name, loader)
    assert specification
    module = importlib.util.module_from_spec(specification)
    loader.exec_module(module)
    return module


def test_the_container_installs_what_is_pinned_by_hash_and_nothing_else() -> None:
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    installs = re.findall(r"pip install ([^&\n]+)", dockerfile)

    assert len(installs) == 2
    assert all("--no-deps" in words for words in installs)
    assert "--require-hashes -r .ci/container.txt" in installs[0]
    assert "--no-build-isolation" in installs[1]  # else setuptools would come from the network, unpinned


def test_every_requirement_is_pinned_at_a_version_that_it_allows() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = [Requirement(one) for one in project["project"]["dependencies"]]
    wanted += [Requirement(one) for one in project["build-system"]["requires"]]

    of_the_image = {"python_version": "3.12", "python_full_version": "3.12.0"}
    needed = [one for one in wanted if one.marker is None or one.marker.evaluate(of_the_image)]
    assert len(needed) >= 10
    for one in needed:
        version, hashes = PINNED[re.sub("[-_.]+", "-", one.name)]
        assert one.specifier.contains(version), one.name
        assert hashes, one.name


def test_no_line_of_the_lock_is_without_a_hash() -> None:
    assert len(PINNED) == len(re.findall(r"^[a-z]\S*==", LOCK, re.M))


def test_the_list_of_components_is_whole_and_the_same_twice() -> None:
    sbom = program("sbom")

    first, again = (json.dumps(sbom.document()) for _ in range(2))
    listed = json.loads(first)

    assert first == again
    assert (listed["bomFormat"], listed["specVersion"]) == ("CycloneDX", "1.6")
    names = {one["name"] for one in listed["components"]}
    assert {"numpy", "rosbags", "pyyaml"} <= names
    assert "pytest" not in names  # an extra
    references = {one["bom-ref"] for one in (*listed["components"], listed["metadata"]["component"])}
    assert {one["ref"] for one in listed["dependencies"]} == references
    assert {ref for one in listed["dependencies"] for ref in one["dependsOn"]} <= references
    assert all(one["purl"].startswith("pkg:pypi/") for one in listed["components"])


def test_the_list_keeps_the_schema_of_its_format() -> None:
    validation = pytest.importorskip(
        "cyclonedx.validation.json", reason="the library of the format is not here"
    )
    schema = pytest.importorskip("cyclonedx.schema")

    found = validation.JsonStrictValidator(schema.SchemaVersion.V1_6).validate_str(
        json.dumps(program("sbom").document())
    )

    assert found is None
