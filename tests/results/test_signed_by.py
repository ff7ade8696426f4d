"""Where an organiser's key is configured, only what it signed counts: results, rankings, tables, shards."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from ariac_score import load_result, score_trial
from ariac_score.cli import main
from ariac_score.errors import DataFileError, ResultError, UsageError
from ariac_score.ranking.competition import load_competition, signers_of
from ariac_score.results.result_file import as_json, measured_sha256
from ariac_score.results.signing import keys_asked_for, refuse_unsigned, sign_file, signature_file
from ariac_score.scoring.authority import Authority
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

pytest.importorskip("minisign")

RULES = "id: {}\ntitle: Cup\nsource: a test\nextends: paper2020\n{}"
OTHER_KEY = "RWQf6LRCGA9i53mlYecO4IzT51TGPpvWucNSCh1CBM0QTaLn73Y7GFO3"  # of minisign itself, from its README


@pytest.fixture(scope="module")
def log_text(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("log") / "kit_1.jsonl"
    return write_trial_log(file, kitting_trial(), signals=SNAPSHOT_SIGNALS).read_text(encoding="utf-8")


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The organiser's public key as text; the secret one is organiser.key in the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert main(["sign", "--new-key", "organiser.key"]) == 0
    return Path("organiser.key.pub").read_text(encoding="ascii").splitlines()[1]


def sign(*files: str, key: str = "organiser.key") -> None:
    assert main(["sign", *files, "--key", key, "--competition", "cup"]) == 0


def competition(runs: str, more: str = "") -> None:
    text = f"id: cup\nrules: paper2020\nruns: '{runs}'\n{more}\n"
    Path("competition.yaml").write_text(text, encoding="utf-8")


def stored(log_text: str, *names: str) -> None:
    """Results of that log as runs of teams, such as a/kit_1.json."""
    for name in names:
        team, _, file = name.partition("/")
        log = Path(f"{team}.jsonl")
        log.write_text(log_text, encoding="utf-8")
        Path(team).mkdir(exist_ok=True)
        result = score_trial(log, "paper2020", trial_id=file.partition("_")[0], team=team)
        Path(name).write_text(as_json(result), encoding="utf-8")


def test_one_of_the_keys_must_have_signed_and_without_a_key_nothing_is_asked(key: str) -> None:
    Path("table").write_text("x", encoding="utf-8")
    refuse_unsigned(Path("table"), ())
    with pytest.raises(ResultError, match="it is not signed"):
        refuse_unsigned(Path("table"), (key,))

    signature_file(Path("table")).write_bytes(sign_file(Path("table"), Path("organiser.key")))

    refuse_unsigned(Path("table"), (OTHER_KEY, key))
    with pytest.raises(ResultError, match="another key signed it"):
        refuse_unsigned(Path("table"), (OTHER_KEY,))


def test_a_key_that_is_given_must_be_one_of_those_that_are_configured(key: str) -> None:
    assert keys_asked_for((), "") == ()
    assert keys_asked_for((), "organiser.key.pub") == (key,)
    assert keys_asked_for((OTHER_KEY, key), "organiser.key.pub") == (key,)
    assert keys_asked_for((OTHER_KEY,), "") == (OTHER_KEY,)
    with pytest.raises(UsageError, match=r"the organiser's key is RWQf6.*, not RW"):
        keys_asked_for((OTHER_KEY,), key)


def test_a_key_is_text_in_the_organisers_file_and_that_of_the_competition_comes_first(key: str) -> None:
    Path("a/kit_1").mkdir(parents=True)
    rules = Authority.of({"authority": {"signed_by": [OTHER_KEY]}})
    competition("{team}/{trial}_{run}", f"authority: {{signed_by: [{key}]}}")
    assert signers_of(load_competition(Path()), rules) == (key,)
    competition("{team}/{trial}_{run}")
    assert signers_of(load_competition(Path()), rules) == (OTHER_KEY,)

    # A file of a key could be replaced by whoever may write there.
    competition("{team}/{trial}_{run}", "authority: {signed_by: [organiser.key.pub]}")
    with pytest.raises(DataFileError, match=r"organiser\.key\.pub"):
        load_competition(Path())


@pytest.mark.slow
def test_a_team_cannot_bring_a_key_of_its_own(key: str, log_text: str) -> None:
    stored(log_text, "a/kit_1.json")
    competition("{team}/{trial}_{run}.json", f"authority: {{signed_by: [{key}]}}")
    assert main(["sign", "--new-key", "a/team.key"]) == 0
    own = Path("a/team.key.pub").read_text(encoding="ascii").splitlines()[1]
    text = "id: cup\nrules: paper2020\nruns: '{team}/{trial}_{run}.json'\nauthority: "
    text += f"{{signed_by: [{own}]}}\n"
    Path("a/competition.yaml").write_text(text, encoding="utf-8")
    Path("a/ariac-score.toml").write_text('public-key = "team.key.pub"\n', encoding="utf-8")
    sign("a/kit_1.json", key="a/team.key")

    assert main(["rank", "."]) == 6
    assert main(["rank", ".", "--public-key", "a/team.key.pub"]) == 4

    sign("a/kit_1.json")
    assert main(["rank", "."]) == 0


@pytest.mark.slow
def test_rank_names_stored_results_that_are_not_signed_and_ranks_the_others(
    key: str, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stored(log_text, "a/kit_1.json", "b/kit_1.json", "c/kit_1.json")
    competition("{team}/{trial}_{run}.json")
    assert main(["rank", "."]) == 0  # no key, nothing asked

    competition("{team}/{trial}_{run}.json", f"authority: {{signed_by: [{key}]}}")
    sign("a/kit_1.json", "b/kit_1.json")
    shutil.copy("a/kit_1.json.minisig", "c/kit_1.json.minisig")  # of another file
    capsys.readouterr()
    assert main(["rank", ".", "--output-format", "json"]) == 6

    found = capsys.readouterr()
    runs = {run["team"]: run for run in json.loads(found.out)["runs"]}
    assert (runs["a"]["outcome"], runs["b"]["outcome"]) == ("scored", "scored")
    assert runs["c"]["score"] is None
    assert "the signature is not of these bytes" in runs["c"]["reason"]
    assert not [name for name in json.loads(found.out)["strangers"] if "minisig" in name]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["competition", "rules"])
def test_verify_asks_for_the_signature_that_the_organiser_names(
    where: str, key: str, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    authority = f"authority: {{signed_by: [{key}]}}"
    Path("cup.yaml").write_text(RULES.format("cup", authority if where == "rules" else ""), encoding="utf-8")
    Path("a").mkdir()
    Path("a/kit_1.jsonl").write_text(log_text, encoding="utf-8")
    competition("{team}/{trial}_{run}.jsonl", authority if where == "competition" else "")
    text = Path("competition.yaml").read_text(encoding="utf-8").replace("paper2020", "cup.yaml")
    Path("competition.yaml").write_text(text, encoding="utf-8")
    assert main(["rank", ".", "-o", "ranking.json", "--results", "results"]) == 0
    result = ["results/a/kit_1.json", "--log", "."]

    assert main(["verify", *result]) == 1
    assert "it is not signed: there is no kit_1.json.minisig" in capsys.readouterr().out

    sign("results/a/kit_1.json")
    assert main(["verify", *result]) == 0


@pytest.mark.slow
def test_rules_in_the_result_itself_name_nobody_whose_signature_counts(key: str, log_text: str) -> None:
    assert main(["sign", "--new-key", "forger.key"]) == 0
    forger = Path("forger.key.pub").read_text(encoding="ascii").splitlines()[1]
    for name, one in (("own", forger), ("cup", key)):
        text = RULES.format("cup", f"authority: {{signed_by: [{one}]}}")
        Path(f"{name}.yaml").write_text(text, encoding="utf-8")
    Path("kit_1.jsonl").write_text(log_text, encoding="utf-8")
    assert main(["score", "kit_1.jsonl", "--rules", "own.yaml", "-o", "own.json"]) == 0
    sign("own.json", key="forger.key")

    assert main(["verify", "own.json", "--log", "kit_1.jsonl"]) == 8  # no rules that are known here
    assert main(["verify", "own.json", "--log", "kit_1.jsonl", "--rules", "cup.yaml"]) == 1


def test_decisions_of_stewards_must_be_signed_as_well(key: str, log_text: str) -> None:
    stored(log_text, "a/kit_1.json")
    competition("{team}/{trial}_{run}.json", f"authority: {{signed_by: [{key}]}}")
    sign("a/kit_1.json")
    measured = measured_sha256(load_result(Path("a/kit_1.json")))
    Path("adjustments.yaml").write_text(
        f"""adjustments:
  - {{id: p, author: me, reason: so, time: 2024-05-12T14:30:00Z, effect: {{points: 4}},
     target: {{team: a, trial: kit, run: 1, measured: {measured}}}}}
""",
        encoding="utf-8",
    )
    command = ["rank", ".", "--adjustments", "adjustments.yaml"]

    assert main(command) == 6
    sign("adjustments.yaml")
    assert main(command) == 0


@pytest.mark.slow
def test_a_batch_and_its_shards_count_where_their_tables_are_signed(
    key: str, log_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for team in "ab":
        Path(team).mkdir()
        Path(f"{team}/kit_1.jsonl").write_text(log_text, encoding="utf-8")
    authority = f"authority: {{signed_by: [{key}]}}"
    competition("{team}/{trial}_{run}.jsonl", authority)
    batch = ["batch", ".", "-j", "1", "-o"]
    assert main([*batch, "out"]) == 0

    assert main(["rank", ".", "--batch", "out"]) == 6
    assert "it is not signed" in capsys.readouterr().err
    assert main([*batch, "out"]) == 0
    found = capsys.readouterr()
    assert "scored again, not taken from there" in found.err
    assert "scored before" not in found.out

    sign("out")
    minisign = shutil.which("minisign")
    if minisign is not None:  # any other implementation
        check = [minisign, "-V", "-q", "-P", key, "-m", "out/runs.jsonl"]
        assert subprocess.run(check, check=False, timeout=30).returncode == 0
    assert main(["rank", ".", "--batch", "out"]) == 0
    capsys.readouterr()
    assert main([*batch, "out"]) == 0
    assert "2 scored before" in capsys.readouterr().out

    for number in (1, 2):
        assert main([*batch, f"part{number}", "--shard", f"{number}/2"]) == 0
    sign("part1")
    merge = ["merge", "whole", "part1", "part2", "--public-key", key]
    assert main(merge) == 6
    sign("part2")
    assert main(merge) == 0
    sign("whole")
    assert main(["rank", ".", "--batch", "whole"]) == 0

    table = Path("whole/runs.jsonl")
    table.write_text(table.read_text(encoding="ascii").replace('"score": ', '"score": 1'), encoding="ascii")
    assert main(["rank", ".", "--batch", "whole"]) == 6


@pytest.mark.slow
def test_shards_are_asked_for_the_signature_that_their_rules_name(key: str, log_text: str) -> None:
    Path("cup.yaml").write_text(RULES.format("cup", f"authority: {{signed_by: [{key}]}}"), encoding="utf-8")
    Path("logs").mkdir()
    for name in "ab":
        Path(f"logs/{name}.jsonl").write_text(log_text, encoding="utf-8")
    for number in (1, 2):
        part = ["-o", f"part{number}", "--shard", f"{number}/2"]
        assert main(["batch", "logs", "--rules", "cup.yaml", "-j", "1", *part]) == 0

    assert main(["merge", "whole", "part1", "part2"]) == 6
    sign("part1", "part2")
    assert main(["merge", "whole", "part1", "part2"]) == 0


@pytest.mark.slow
def test_what_minisign_signed_counts_and_what_it_refuses_does_not(
    tmp_path: Path, key: str, log_text: str
) -> None:
    minisign = shutil.which("minisign")
    if minisign is None:
        pytest.skip("minisign is not installed")

    def run(*words: str) -> int:
        return subprocess.run(
            [minisign, *words], check=False, timeout=60, capture_output=True, stdin=subprocess.DEVNULL
        ).returncode

    assert run("-G", "-W", "-p", "their.pub", "-s", "their.key") == 0
    theirs = Path("their.pub").read_text(encoding="ascii").splitlines()[1]
    stored(log_text, "a/kit_1.json")
    competition("{team}/{trial}_{run}.json", f"authority: {{signed_by: [{theirs}]}}")
    words = "competition:cup file:kit_1.json"
    assert run("-S", "-s", "their.key", "-m", "a/kit_1.json", "-t", words) == 0
    assert main(["rank", "."]) == 0

    result, signature = Path("a/kit_1.json"), Path("a/kit_1.json.minisig")
    whole, signed = result.read_bytes(), signature.read_bytes()
    tampered = {
        "a byte more": (whole + b"\n", signed),
        "another comment": (whole, signed.replace(b"file:kit_1.json", b"file:kit_2.json")),
        "no global signature": (whole, b"\n".join(signed.splitlines()[:3]) + b"\n"),
    }
    for what, (text, vouched) in tampered.items():
        result.write_bytes(text)
        signature.write_bytes(vouched)
        assert run("-V", "-P", theirs, "-m", "a/kit_1.json") != 0, what
        assert main(["rank", "."]) == 6, what


def test_a_signed_result_that_names_no_team_counts_for_none(key: str, log_text: str) -> None:
    Path("kit.jsonl").write_text(log_text, encoding="utf-8")
    Path("a").mkdir()
    nobodys = as_json(score_trial(Path("kit.jsonl"), "paper2020", trial_id="kit"))
    Path("a/kit_1.json").write_text(nobodys, encoding="utf-8")
    competition("{team}/{trial}_{run}.json", f"authority: {{signed_by: [{key}]}}")
    sign("a/kit_1.json")

    assert main(["rank", "."]) == 6


@pytest.mark.parametrize(("of", "code"), [("cup", 0), ("cup_2025", 6), ("", 6)])
def test_a_result_that_is_signed_for_another_cup_is_not_ranked_in_this_one(
    key: str, log_text: str, of: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    stored(log_text, "a/kit_1.json")
    competition("{team}/{trial}_{run}.json", f"authority: {{signed_by: [{key}]}}")
    named = ["--competition", of] if of else []
    assert main(["sign", "a/kit_1.json", "--key", "organiser.key", *named]) == 0
    capsys.readouterr()

    assert main(["rank", "."]) == code
    whose = f"for the competition {of}" if of else "for no competition"
    assert (f"it is signed {whose}, and this is cup" in "".join(capsys.readouterr())) is (code == 6)


def test_a_comment_cannot_say_for_which_competition_a_result_is_signed(key: str) -> None:
    Path("table").write_text("x", encoding="utf-8")
    with pytest.raises(UsageError, match="names one") as refused:
        sign_file(Path("table"), Path("organiser.key"), comment="competition:cup")
    assert "--competition" in refused.value.hint
    with pytest.raises(UsageError, match="no id of a competition"):
        sign_file(Path("table"), Path("organiser.key"), competition="two words")
