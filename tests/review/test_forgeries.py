"""A table of forgeries, each by a forger who has this program and prices again; each is refused by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from ariac_score import as_json, load_result, score_trial
from ariac_score.checks.findings import Verdict
from ariac_score.cli import main
from ariac_score.engine.price import price_trial
from ariac_score.results.result_file import RESULT, measured_sha256
from ariac_score.review import computed_again
from ariac_score.review.verify import verify_result
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.testing.stored import rewritten
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
LOG = ROOT / "examples/kitting_near_miss.mcap"
DOCS = (ROOT / "docs/fairness.md").read_text(encoding="utf-8")

INCONCLUSIVE = Verdict.INCONCLUSIVE

Forge = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Forgery:
    """One kind of forgery.

    Attributes:
        name: As docs/fairness.md lists it.
        edit: What the forger changes in the JSON.
        step: The step that fails, of those with the log.
        words: What it says.
        price: Price the findings again after the edit, by the edited rules, so that everything follows.
        alone: Whether it fails without the log as well.
        after: What is changed after pricing.
    """

    name: str
    edit: Forge
    step: str
    words: str
    price: bool = False
    alone: bool = True
    after: Forge | None = None


def put(path: str, value: Any) -> Forge:
    def edit(data: dict[str, Any]) -> None:
        *way, last = path.split("/")
        at: Any = data
        for step in way:
            at = at[int(step)] if step.isdigit() else at[step]
        at[int(last) if last.isdigit() else last] = value

    return edit


def no_violation(data: dict[str, Any]) -> None:
    data["measured"]["findings"]["separation#1"] |= {"verdict": "satisfied", "robustness": 0.1}


def one_finding_less(data: dict[str, Any]) -> None:
    del data["measured"]["findings"]["part_color#2"]


def cheaper(data: dict[str, Any]) -> None:
    assert "value: 0.4" in data["rules"]
    data["rules"] = data["rules"].replace("value: 0.4", "value: 0.04")


def best_end(data: dict[str, Any]) -> None:
    data["rules"] += "open: best\n"


def own_hash(data: dict[str, Any]) -> None:
    data["provenance"]["rule_set"]["sha256"] = rule_set_from_text(data["rules"], file="forged").sha256


def ledger_that_adds_up(data: dict[str, Any]) -> None:
    data["score"] = data["ledger"]["amount"] = data["score"] + 1
    taken = data["ledger"]["children"][1]
    for line in (taken, taken["children"][0]):
        line["amount"] = round(line["amount"] + 1.0, 6)


def former(data: dict[str, Any]) -> None:
    """Of a ledger of the former method only the sums can be compared, so a forger may claim to have one."""
    data["ledger_method"] = "sequence"
    for check in data["checks"].values():
        check["on_inconclusive"] = "withhold"
    data["ledger"]["children"][1]["label"] = "the organisers took"


FORGERIES = (
    Forgery("the score", put("score", 25.0), "sums", "the score is 25"),
    Forgery("score and ledger", ledger_that_adds_up, "automatic", "does not follow from its findings"),
    Forgery("a verdict", no_violation, "automatic", "does not follow from its findings"),
    Forgery(
        "a verdict, priced again",
        no_violation,
        "recomputed",
        "$.measured.findings.separation#1.verdict",
        price=True,
        alone=False,
    ),
    Forgery(
        "a finding left out, priced again",
        one_finding_less,
        "recomputed",
        "$.measured.findings.part_color#2",
        price=True,
        alone=False,
    ),
    Forgery(
        "how severe a violation was, priced again",
        put("measured/findings/separation#1/quantities/relative_depth_integral_s", 0.1),
        "recomputed",
        "$.measured.findings.separation#1.quantities.relative_depth_integral_s",
        price=True,
        alone=False,
    ),
    Forgery("the text of the rules", cheaper, "rules", "the rules in it have SHA-256", price=True),
    Forgery(
        "the text of the rules, with its own hash",
        cheaper,
        "rules",
        "paper2020.published is another rule set than paper2020.published as installed",
        price=True,
        after=own_hash,
    ),
    Forgery("the hash of the rules", put("provenance/rule_set/sha256", "0" * 64), "rules", "SHA-256 0000"),
    Forgery("the `open` policy", best_end, "rules", "the rules in it have SHA-256", price=True),
    Forgery("a setting of a check", put("checks/separation/with", {"t1_s": 9}), "rules", "not those of"),
    Forgery(
        "the version of a plugin",
        put("provenance/code/2/version", "9.9"),
        "recomputed",
        "another ariac_score_standards of ariac-score: version 9.9",
        alone=False,
    ),
    Forgery(
        "the hash of the code",
        put("provenance/code/0/sha256", "0" * 64),
        "recomputed",
        "another ariac_score of ariac-score",
        alone=False,
    ),
    Forgery("the hash of the log", put("provenance/inputs/0/sha256", "0" * 64), "log", "", alone=False),
    Forgery(
        "the hash of the log map",
        put("provenance/log_map/sha256", "0" * 64),
        "recomputed",
        "another log map",
        alone=False,
    ),
    Forgery(
        "the words of a finding",
        put("measured/findings/separation#1/message", "kept away"),
        "recomputed",
        "separation#1.message",
        price=True,
        alone=False,
    ),
    Forgery("what is drawn", put("measured/sketch/curves", []), "recomputed", "sketch.curves", alone=False),
    Forgery("why it has its points", former, "recomputed", "a method that the code", alone=False),
)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, scored by the code as it is."""
    file = tmp_path_factory.mktemp("stored") / "result.json"
    file.write_text(as_json(score_trial(LOG, "paper2020.published")), encoding="utf-8")
    return file


@pytest.fixture
def quick(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The log is the same each time, so it is scored once; tests/review/test_verify.py scores it again."""
    result = load_result(stored)
    monkeypatch.setattr(computed_again, "score_trial", lambda *_, **__: result)


def forged(stored: Path, folder: Path, forgery: Forgery) -> Path:
    data = json.loads(stored.read_text(encoding="utf-8"))
    forgery.edit(data)
    if forgery.price:
        data = priced(data)
    if forgery.after:
        forgery.after(data)
    file = folder / "forged.json"
    file.write_text(rewritten(data), encoding="utf-8")
    return file


def priced(data: dict[str, Any]) -> dict[str, Any]:
    """The findings priced by the rules in it, as this program would; hashes stay what they were."""
    rules: RuleSet = rule_set_from_text(data["rules"], file="forged")
    before = RESULT.decoded(json.dumps(data).encode(), Path("forged.json"))
    after = price_trial(before.measured, rules, before.provenance, before.cohort)
    again: dict[str, Any] = json.loads(as_json(after))
    return again


def test_the_page_lists_every_forgery_with_the_step_that_refuses_it() -> None:
    listed = {
        tuple(cell.strip(" `") for cell in line.split("|")[1:3])
        for line in DOCS.splitlines()
        if line.startswith("| ")
    }
    for forgery in FORGERIES:
        assert (forgery.name.replace("`", ""), forgery.step) in {(a.replace("`", ""), b) for a, b in listed}


@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda forgery: forgery.name)
def test_a_forgery_is_refused_by_name(forgery: Forgery, stored: Path, tmp_path: Path, quick: None) -> None:
    file = forged(stored, tmp_path, forgery)

    alone = verify_result(file)
    assert not alone.holds
    assert bool(alone.steps_that_are("failed")) is forgery.alone
    found = alone if forgery.alone else verify_result(file, log=LOG, rules="paper2020.published")
    (words,) = [step.words for step in found.steps if (step.name, step.outcome) == (forgery.step, "failed")]
    assert forgery.words in words


def test_forged_verdicts_priced_again_never_read_as_holding(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    priced_again = next(one for one in FORGERIES if one.name == "a verdict, priced again")
    file = forged(stored, tmp_path, priced_again)

    assert main(["verify", str(file)]) == 8
    out = capsys.readouterr().out
    assert out.endswith("consistent in itself; not compared with a log\n")
    assert "holds" not in out
    assert main(["verify", str(file), "--output-format", "json"]) == 8
    data = json.loads(capsys.readouterr().out)
    assert (data["holds"], data["consistent"]) == (False, True)


def test_whose_run_it_is_no_log_says_that_names_no_team(
    stored: Path, tmp_path: Path, quick: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """So its own log does not call an honest result of a competition false, and proves no forged one."""
    file = tmp_path / "ours.json"
    data = json.loads(stored.read_text(encoding="utf-8"))
    put("measured/team", "us")(data)
    file.write_text(rewritten(data), encoding="utf-8")

    assert main(["verify", str(file), "--log", str(LOG)]) == 8
    out = capsys.readouterr().out
    assert "that it is kitting_near_miss of us is the word of the file alone" in out
    assert out.endswith("consistent in itself; known from the file alone: run\n")


@pytest.mark.slow
def test_rules_that_nobody_else_knows_are_not_proven_even_with_the_log(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A forger may give edited rules a name of their own: then only who knows the rules can say."""
    rules = (
        load_result(stored)
        .rules.replace("id: paper2020.published", "id: ours", 1)
        .replace("value: 0.4", "value: 0.04")
    )
    file = tmp_path / "ours.json"
    file.write_text(as_json(score_trial(LOG, rule_set_from_text(rules, file="ours"))), encoding="utf-8")

    assert main(["verify", str(file), "--log", str(LOG)]) == 8
    assert "consistent in itself; known from the file alone: rules" in capsys.readouterr().out
    assert main(["verify", str(file), "--log", str(LOG), "--rules", "paper2020.published"]) == 1
    (tmp_path / "ours.yaml").write_text(rules, encoding="utf-8")
    assert main(["verify", str(file), "--log", str(LOG), "--rules", str(tmp_path / "ours.yaml")]) == 0


def test_the_ends_of_an_open_score_and_what_is_open_cannot_be_narrowed(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "t.jsonl", kitting_trial(human=False), signals=SNAPSHOT_SIGNALS)
    result = score_trial(log, "paper2020.published")
    assert result.interval is not None
    narrower = replace(result, interval=msgspec.structs.replace(result.interval, most=Decimal(27)))
    findings = result.measured.findings.items()
    decided = price_trial(
        replace(
            result.measured,
            open=(),
            findings={
                k: replace(f, verdict=Verdict.NOT_APPLICABLE) if f.verdict is INCONCLUSIVE else f
                for k, f in findings
            },
        ),
        rule_set_from_text(result.rules, file="forged"),
        result.provenance,
    )
    (tmp_path / "narrower.json").write_text(RESULT.text(narrower), encoding="utf-8")
    (tmp_path / "decided.json").write_text(as_json(decided), encoding="utf-8")

    assert verify_result(tmp_path / "narrower.json").steps_that_are("failed") == ("automatic",)
    assert not verify_result(tmp_path / "decided.json").holds
    assert verify_result(tmp_path / "decided.json", log=log).steps_that_are("failed") == ("recomputed",)


def test_decisions_put_in_by_somebody_else_are_not_those_of_the_stewards(
    stored: Path, tmp_path: Path, quick: None
) -> None:
    target = {"trial": "kitting_near_miss", "measured": measured_sha256(load_result(stored))}
    decision = {
        "id": "d1",
        "author": "Chief steward",
        "reason": "late",
        "time": "2024-05-12T14:30:00Z",
        "target": target,
        "effect": {"points": -2},
    }
    files = {}
    for name, points in (("stewards", -2), ("forger", 12)):
        files[name] = tmp_path / f"{name}.yaml"
        files[name].write_text(yaml.safe_dump({"adjustments": [{**decision, "effect": {"points": points}}]}))
        done = main(["adjust", str(stored), str(files[name]), "-o", str(tmp_path / f"{name}.json")])
        assert done == 0

    whole = {"log": LOG, "rules": "paper2020.published"}
    assert verify_result(tmp_path / "stewards.json", **whole, adjustments=files["stewards"]).holds
    alone = verify_result(tmp_path / "forger.json", **whole)
    assert (alone.holds, alone.steps_that_are("open")) == (False, ("adjustments",))
    found = verify_result(tmp_path / "forger.json", **whole, adjustments=files["stewards"])
    assert found.steps_that_are("failed") == ("adjustments",)


def test_a_signature_that_is_asked_for_and_missing_or_of_other_bytes_fails(
    stored: Path, tmp_path: Path, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("minisign")
    key, file = tmp_path / "key", tmp_path / "result.json"
    file.write_bytes(stored.read_bytes())
    assert main(["sign", "--new-key", str(key)]) == 0
    (tmp_path / "ariac-score.toml").write_text('public-key = "key.pub"', encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    call = ["verify", str(file), "--log", str(LOG)]
    assert main(call) == 1  # nobody signed it
    assert main(["sign", str(file), "--key", str(key)]) == 0
    assert main(call) == 0
    data = json.loads(file.read_text())
    data["measured"]["team"] = "us"
    file.write_text(rewritten(data), encoding="utf-8")
    assert verify_result(file, public_key=f"{key}.pub").steps_that_are("failed") == ("signature",)
