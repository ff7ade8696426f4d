"""`plugins list`, `show` and `doctor` know every kind of thing that a distribution brings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.errors import PluginConflictError, PluginNotFoundError
from ariac_score.testing.doctor import ailments
from ariac_score.testing.inventory import ALL_GROUPS, brought, brought_named, page_of

Install = Callable[..., str]
ROOT = Path(__file__).parents[2]
SOURCE = """\
from ariac_score import DerivedSignal, FactSchemas, Quantity, ReportPanel

HEIGHT = Quantity("m", 1, "body", "height over ground")
RISE = DerivedSignal({"p": "position/{body}"}, lambda t, p: p[:, 2])
COURSE = ReportPanel("The course", lambda result: None, "<p>{{ data }}</p>")
FACTS = FactSchemas({"object": {"required": ["kind"]}})


def latex(result):
    "The score in LaTeX."
    return ""


def best_two(scores):
    '''The two best trials.

    All others count nothing.
    '''
    return sum(sorted(scores)[-2:])
"""
KINDS = {
    "quantities": (
        "hop_height",
        "HEIGHT",
        "m, of body: height over ground",
        "Values of shape (n,), in m",
    ),
    "derived_signals": ("hop_height", "RISE", "from position/{body}", "- `p`: `position/{body}`"),
    "report_panels": ("hop.course", "COURSE", "The course", "<p>{{ data }}</p>"),
    "fact_schemas": ("hop", "FACTS", "facts of object", "- kind"),
    "exports": ("hop_latex", "latex", "The score in LaTeX.", "The score in LaTeX."),
    "ranking_policies": ("hop_best", "best_two", "The two best trials.", "All others count nothing."),
}


@pytest.fixture
def hop(install: Install) -> str:
    first, *others = [(f"ariac_score.{kind}", {name: target}) for kind, (name, target, *_) in KINDS.items()]
    also = dict(others)
    also["ariac_score.penalties"] = {"hop.mild": "mild"}
    text = (ROOT / "rules/penalty/gate.yaml").read_text().replace("id: penalty.gate", "id: hop.mild")
    return install("hop-score", first[1], group=first[0], source=SOURCE, also=also, files={"mild.yaml": text})


def test_every_group_of_our_entry_points_is_known() -> None:
    assert set(Registry().groups()) <= set(ALL_GROUPS)
    assert len(ALL_GROUPS) == len(set(ALL_GROUPS))


@pytest.mark.slow
def test_each_kind_is_in_the_list_with_its_distribution_and_a_line_about_it(
    hop: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", "list"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if " hop-score 1.0 " in line]

    for kind, (name, _, about, _) in KINDS.items():
        assert any(line.split()[:2] == [kind, name] and line.endswith(about) for line in lines), kind
    assert len(lines) == len(KINDS) + 1


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_a_page(hop: str, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    name, _, _, words = KINDS[kind]

    assert main(["plugins", "show", name]) == 0
    out = capsys.readouterr().out
    assert f"of hop-score 1.0, {hop}:" in out
    assert words in out


def test_a_file_is_shown_with_its_text_and_its_hash(hop: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "show", "hop.mild"]) == 0
    assert "id: hop.mild" in capsys.readouterr().out
    assert main(["plugins", "show", "ariac2020.as_coded"]) == 0
    assert capsys.readouterr().out.startswith("rule_set of ariac-score ")


@pytest.mark.slow
def test_everything_that_is_shipped_can_be_shown() -> None:
    registry = Registry()
    for one in brought(registry):
        assert one.problem == ""
        if one.kind not in ("rules", "monitors"):  # their pages are made for the documentation
            assert page_of(one).startswith(f"# `{one.name}`"), one.name


@pytest.mark.slow
def test_the_doctor_finds_nothing_wrong_with_what_is_sound(hop: str) -> None:
    assert ailments() == []


def test_what_has_no_contract_to_try_is_said_so(hop: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "check", "hop_height"]) == 4
    assert "no contract to try" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["hop", "hop_heigt", "ariac2020.as_code"])
def test_a_name_of_nothing_is_refused_with_near_ones(install: Install, name: str) -> None:
    with pytest.raises(PluginNotFoundError, match=name) as refused:
        brought_named(name, Registry())
    assert refused.value.hint


@pytest.mark.slow
def test_what_two_bring_is_refused(hop: str, install: Install) -> None:
    install("foul-score", {"hop_best": "f"}, source="def f(s): ...", group="ariac_score.ranking_policies")

    with pytest.raises(PluginConflictError, match=r"foul-score 1\.0 and hop-score 1\.0"):
        brought_named("hop_best", Registry())
    assert {ill.problem for ill in ailments()} == {
        "'hop_best' is provided by foul-score 1.0 and hop-score 1.0"
    }


ILL = {
    "quantities": ("HEIGHT = 3", "is a int, not a Quantity"),
    "derived_signals": ("HEIGHT = 3", "is a int, not a DerivedSignal"),
    "report_panels": ("HEIGHT = 3", "is a int, not a ReportPanel"),
    "exports": ("HEIGHT = 3", "is a int, not a Callable"),
    "fact_schemas": ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
    "commands": ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
    "evaluations": ("1 / 0", "ZeroDivisionError"),
    "rule_sets": ("", "where no file lies"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ILL)
def test_what_is_wrong_with_each_kind_is_named(install: Install, kind: str) -> None:
    source, words = ILL[kind]
    install("odd-score", {"odd": "HEIGHT"}, source=source, group=f"ariac_score.{kind}")

    (ill,) = ailments()
    assert "odd-score 1.0" in ill.origin
    assert words in ill.problem
    (row,) = [one for one in brought(Registry()) if one.name == "odd"]
    assert (row.kind, row.summary) == (kind, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("id: other\ntitle: T\nsource: S\n", "has the id 'other', and is called 'odd'"),
        ("id: odd\n", "is missing"),
        ("id: [", "malformed YAML"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(install: Install, text: str, words: str) -> None:
    install("odd-score", {"odd": "m"}, group="ariac_score.log_maps", files={"m.yaml": text})

    (ill,) = ailments()
    assert words in ill.problem
    assert ill.hint
