"""The way of a protest, as docs/protests.md goes it: every command of the page, in its order."""

from __future__ import annotations

import filecmp
import json
import re
import shlex
from pathlib import Path

import pytest

from ariac_score.cli import main

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/protests.md").read_text(encoding="utf-8")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with nothing but the examples."""
    pytest.importorskip("minisign")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_protest_goes_its_way(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for language, block in re.findall(r"^```(sh|yaml)\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE):
        if language == "yaml":
            assert main(["adjust", "published/results/borealis/kitting_1.json"]) == 0
            found = re.search(r"[0-9a-f]{64}", capsys.readouterr().out)
            assert found is not None
            Path("adjustments.yaml").write_text(block.replace("MEASURED", found[0]), encoding="utf-8")
            continue
        for line in block.splitlines():
            program, *words = shlex.split(line)
            code = main(words)
            assert (program, code) == ("ariac-score", 0), (line, capsys.readouterr().err)

    before, after = (
        json.loads(Path(f"published/{name}.json").read_text()) for name in ("ranking", "ranking_2")
    )
    automatic, amended = (
        next(team["execution"] for team in standings if team["team"] == "borealis")
        for standings in (after["standings"], after["adjusted"]["standings"])
    )
    assert round(amended - automatic, 9) == 4  # as ruled, and the dismissed complaint moves nothing
    assert after["standings"] == before["standings"]
    decided = {one["id"]: one for one in after["adjusted"]["adjustments"]}
    assert decided["protest_2"]["complaint"].startswith("Team Aurora, 12 May 2024")
    same = filecmp.cmpfiles(
        "published/results", "published/results_2", ["borealis/kitting_1.json"], shallow=False
    )
    assert same[0] == ["borealis/kitting_1.json"]
    pages = Path("site_2/index.html").read_text(encoding="utf-8")
    assert all(words in pages for words in ("a marshal stopped the conveyor", "the complaint is dismissed"))
    assert "Since the previous publication" in pages

    # Who amends without the stewards is found out.
    text = Path("adjustments.yaml").read_text(encoding="utf-8").replace("points: 4", "points: 40")
    Path("forged.yaml").write_text(text, encoding="utf-8")
    result = "published/results/borealis/kitting_1.json"
    assert main(["adjust", result, "forged.yaml", "-o", "forged.json"]) == 0
    proof = ["--log", "examples/competition/2024", "--adjustments", "adjustments.yaml"]
    assert main(["verify", "forged.json", *proof]) == 1
    assert main(["verify", "forged.json", *proof[:2]]) == 8
    assert main(["verify", "forged.json", "--public-key", "organiser.key.pub"]) == 1
