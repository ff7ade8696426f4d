"""The adversary finds again, within its budget, what was once found by hand, and nothing else.

Rules that were mended are written down here as they were.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Trial, load_rule_set, score_trial
from ariac_score.cli import main
from ariac_score.errors import UsageError
from ariac_score.logs.containers.items import Message
from ariac_score.redteam.honest import Honest, honest_log
from ariac_score.redteam.search import Found, search
from ariac_score.redteam.tactics import TACTICS
from ariac_score.results.cohort_file import cohort_text, contributed, make_cohort
from ariac_score.testing import Recorded, write_bag
from ariac_score.testing.copies import Copy, changed, fields_of
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ORIGIN_S = 1_700_000_000
RATE_HZ = 20
FAR_M, NEAR_M, RAMP_S = 10.0, 3.0, 3.0

LOG_MAP = """\
id: test
title: A robot and a human, and what happened
source: this test
bodies: {robot: {kind: robot}, human: {kind: human}}
channels:
  - topic: /snapshot
    type: nist_gear/msg/Snapshot
    signals:
      speed/human: human_operator_speed
      speed/robot: robot_speed
      centre_distance/robot/human: distance_robot_human_operator
  - {topic: /ariac_score/events, type: ariac_score_msgs/msg/TrialEvent, decoder: ariac_score.records}
"""
RULES = """\
id: %s
title: Rules of this test
source: this test
log_map: ./map.yaml
levels: [trial]
monitors:
  separation:
    use: iso_ts_15066.ssm_separation
    with: {profile: seed, t1_s: 1.0, t2_s: 1.5, stopping_distance_m: 0.0, delta_m: 2.6}
  collision: {use: ariac.no_event, with: {kind: arm_collision}}
  contact: {use: ariac.human_contact, with: {distance: centre_distance, contact_distance_m: 3.5}}
"""


def ns(t_s: float) -> int:
    return ORIGIN_S * 10**9 + round(t_s * 1e9)


def distance_m(t_s: float) -> float:
    """Far away but for two near misses, at 8 s to 9 s and 16 s to 17 s."""
    outside_s = min(max(first_s - t_s, t_s - first_s - 1.0, 0.0) for first_s in (8.0, 16.0))
    near = (1 + cos(pi * min(outside_s / RAMP_S, 1.0))) / 2
    return FAR_M - (FAR_M - NEAR_M) * near + 0.01 * sin(7 * t_s)


def happened(t_s: float, kind: str, subject: str = "") -> Recorded:
    fields = {"kind": kind, "subject": subject}
    return Recorded("/ariac_score/events", "ariac_score_msgs/msg/TrialEvent", ns(t_s), fields)


EVENTS = (
    happened(0.05, "watching", "arm_collision"),
    happened(0.1, "competition_started"),
    happened(29.0, "competition_ended"),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with two near misses, the same with an arm collision or without any event, and a log map."""
    place = tmp_path_factory.mktemp("redteam")
    (place / "map.yaml").write_text(LOG_MAP, encoding="utf-8")
    samples = []
    for number in range(30 * RATE_HZ + 1):
        t_s = number / RATE_HZ
        fields = {
            "distance_robot_human_operator": distance_m(t_s),
            "robot_speed": 0.5 + 0.01 * sin(3 * t_s),
            "human_operator_speed": 0.5,
        }
        samples.append(Recorded("/snapshot", "nist_gear/msg/Snapshot", ns(t_s), fields))
    for name, events in (
        ("bare", ()),
        ("near", EVENTS),
        ("crash", (*EVENTS, happened(20.0, "arm_collision"))),
    ):
        messages = sorted((*samples, *events), key=lambda m: m.t_ns)
        write_bag(place / f"{name}.mcap", messages, storage="mcap")
    for name, log in kits(place):
        log.write(place / name)
    return place


EXAMPLE = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"


def kits(place: Path) -> Iterator[tuple[str, Copy]]:
    """Two kits with four near misses; the first kit handed in empty before; its order updated; a dash."""
    made = Copy.of(EXAMPLE)
    yield "four", made.with_changed(four_near_misses)
    empty = replace(kitting_trial().submissions[0], submitted_s=12.0, contents=())
    again = replace(kitting_trial(), submissions=(empty, *kitting_trial().submissions))
    yield "emptied", recorded(place, again)
    (first, *_) = made.of_topic("/ariac/orders")
    fields = fields_of(first)
    fields.order_id += "_update_0"
    for product in fields.shipments[0].products:
        product.type = "disk_part_green"  # which is not delivered
    yield "updated", made.with_more([changed(first, fields)._replace(stamp_ns=ns(10.0))])
    yield "dash", recorded(place, kitting_trial(), "frames").with_changed(dash)


def recorded(place: Path, trial: Trial, motion: Any = "snapshot") -> Copy:
    return Copy.of(write_bag(place / "made.mcap", recorded_messages(trial, motion=motion), storage="mcap"))


def dash(message: Message) -> Message:
    """The human stands 9 m away, but for 0.4 s at 20.25 s, between two samples of 2 Hz."""
    if message.connection.topic != "/tf":
        return message
    fields, t_s = fields_of(message), (message.stamp_ns - ORIGIN_S * 10**9) / 1e9
    (sent,) = fields.transforms
    if sent.child_frame_id != "human_base":
        return message
    sent.transform.translation.y = 9.0 - max(0.0, 0.7 - 3.5 * abs(t_s - 20.25))
    return changed(message, fields)


def honest(folder: Path, rules: str, log: str = "near.mcap") -> Honest:
    file = folder / "rules.yaml"
    whole = rules if rules.startswith("extends") else RULES % "test" + rules
    if (said := re.match("ON_UNKNOWN (.*)\n", rules)) is not None:
        whole = RULES.replace("delta_m: 2.6}", f"delta_m: 2.6}}\n    on_inconclusive: {said[1]}") % "test"
        whole += rules[said.end() :]
    file.write_text(whole, encoding="utf-8")
    return honest_log(folder / log, load_rule_set(str(file)))


def exploit_of(found: Found, tactic: str) -> tuple[Decimal, Decimal, str]:
    (one,) = [exploit for exploit in found.exploits if exploit.tactic.name == tactic]
    return one.before, one.after, one.law


EPISODES = "score: 28 / (1 + 0.4 * demerits(separation, tau_s=5))\n"
"""What each episode costs: 1, and its integral of relative depth over 5 s."""

CHARGED = "score: 100 / (1 + 0.4 * seconds(separation))\n"
"""The time in violation, however deep."""

CRASH = "score: 100 * holds(collision)\n"

KITS = "extends: ariac2020.as_coded\nid: test\ntitle: Kits\nsource: this test\n"
"""The task rules of 2020: the first submission of a shipment counts, and the last update of an order."""

PIECES = f"""{KITS}log_map: ariac2020
monitors:
  separation:
    use: iso_ts_15066.ssm_separation
    with: {{profile: seed, t1_s: 1.0, t2_s: 1.5, stopping_distance_m: 0.0, delta_m: 2.6}}
"""
"""Kits, and near misses beside them."""


@dataclass(frozen=True)
class Known:
    """An exploit that was found by hand.

    Attributes:
        tactic: The one that finds it.
        rules: The rules as they were.
        law: The law that they break; empty where it is about the log.
        log: The honest log.
        budget: Within how many tries it is found.
        standing: What the adversary calls it.
    """

    tactic: str
    rules: str
    law: str = ""
    log: str = "near.mcap"
    budget: int = 12
    standing: str = "exploit"


FORMER = {
    # A violation that brings points, or costs none.
    "two near misses merged into one": Known("violations joined", EPISODES, "more_violations"),
    "episodes counted": Known(
        "violations joined", "score: 100 - 20 * count(separation)\n", "more_violations"
    ),
    "depth costs nothing": Known("violations deepened", CHARGED, "severity"),
    "depth earns": Known(
        "violations deepened",
        "score: 50 - 4 * seconds(separation) + 20 * demerits(separation, tau_s=5)\n",
        "severity",
    ),
    "only the first violation counts: `holds`": Known(
        "violations added", "score: 10 + 100 * holds(separation)\n", "always_costs"
    ),
    "only the first violation counts: `min(1, demerits)`": Known(
        "violations lengthened", "score: 100 * (1 - 0.5 * min(1, seconds(separation)))\n", "always_costs"
    ),
    "a floor at half": Known(
        "violations lengthened", "score: 100 * max(0.5, 1 - 0.2 * seconds(separation))\n", "always_costs"
    ),
    "a floor at 0, and no tie-break behind it": Known(
        "violations lengthened", "score: 100 * max(0, 1 - seconds(separation))\n", "nothing_left"
    ),
    "everything free behind a closed gate": Known(
        "violations added", "score: 100 * gate(contact)\n", "nothing_left"
    ),
    "a step down at 2 s, and nothing behind it": Known(
        "violations lengthened", "score: 100 if seconds(separation) <= 2 else 40\n", "always_costs"
    ),
    "a negative price": Known(
        "violations lengthened", "score: 50 + 4 * seconds(separation)\n", "more_violations"
    ),
    "violations counted in points": Known(
        "violations added",
        "score: 50 + 10 * count(separation) - seconds(separation) / 10\n",
        "more_violations",
    ),
    "one check compared with another": Known(
        "violations joined",
        "score: 100 if count(separation) <= count(collision) else 20\n",
        "more_violations",
        "crash.mcap",
    ),
    # Less, or again.
    "a share of the time, diluted by idling": Known(
        "waiting", "score: 100 * (1 - seconds(separation) / trial.duration_s)\n", "waiting"
    ),
    "waiting earns": Known(
        "waiting", "score: 100 - 10 * seconds(separation) + trial.duration_s / 10\n", "waiting"
    ),
    "each near miss halves all points, so stopping early pays": Known(
        "stopping early", f"{PIECES}score: task * product(separation, p=0.5)\n", "stopping_early", "four.mcap"
    ),
    "only the best order counts, and violations of all": Known(
        "stopping early",
        f"{PIECES}score: max(order.completion) / (1 + count(separation))\n",
        "stopping_early",
        "four.mcap",
        standing="inherent",
    ),
    # The robot stood still.
    "a robot at rest is charged for the human who comes": Known("standing still", CHARGED, "standing_still"),
    # Left out of the log.
    "start or end left out": Known(
        "messages left out", f"open: best\n{CRASH}", "", "crash.mcap", standing="believed"
    ),
    "an arm collision left out": Known("messages left out", CRASH, "", "crash.mcap", standing="believed"),
    "all events left out": Known("topics left out", f"open: best\n{CRASH}", "", "crash.mcap"),
    "the first, empty submission left out": Known(
        "messages left out", KITS, "", "emptied.mcap", standing="believed"
    ),
    "the update of an order left out": Known(
        "messages left out", KITS, "", "updated.mcap", standing="believed"
    ),
    "samples of a near miss left out": Known("samples left out", f"open: best\n{CHARGED}"),
    "unknown left out of the price": Known("topics left out", f"ON_UNKNOWN exclude\n{CHARGED}"),
    "unknown priced 0, where the known is negative": Known(
        "topics left out", "ON_UNKNOWN zero\nscore: -5 * seconds(separation)\n"
    ),
    "every other sample left out": Known(
        "samples thinned", f"open: best\n{CHARGED}", standing="believed", budget=20
    ),
    "the human's frame left out but twice a second, and a dash with it": Known(
        "samples thinned",
        f"{PIECES}open: best\nscore: 100 - 50 * seconds(separation)\n",
        "",
        "dash.mcap",
        standing="believed",
    ),
    "the recording begun late": Known(
        "recording cut", f"window: recording\n{CHARGED}", "", "bare.mcap", standing="declared"
    ),
}
"""What an organiser, a team or this project once found by hand, on the rules as they were."""


@pytest.mark.slow
@pytest.mark.parametrize("known", FORMER.values(), ids=FORMER)
def test_what_was_found_by_hand_is_found_again(folder: Path, known: Known) -> None:
    found = search(honest(folder, known.rules, known.log), budget=known.budget, tactics=[known.tactic])

    (one,) = found.exploits
    assert (one.law, one.standing) == (known.law, known.standing)
    if known.tactic == "standing still":
        assert one.after < one.before
    else:
        assert one.after >= one.before
    assert found.tried <= known.budget


PAGE = Path(__file__).parents[2] / "docs/redteam.md"
BEGIN, END = "<!-- written by tests/redteam/test_redteam.py -->\n", "<!-- end of what was known -->\n"


def test_the_page_names_what_is_found_again(update_golden: bool) -> None:
    """Written anew by `--update-golden`."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    written, _, after = rest.partition(END)
    rows = ["| what was found by hand | tactic | within | called | law |", "|---|---|---:|---|---|"]
    for name, known in FORMER.items():
        law = f"`{known.law}`" if known.law else ""
        rows.append(f"| {name} | {known.tactic} | {known.budget} | {known.standing.upper()} | {law} |")
    table = "\n".join((*rows, ""))

    if update_golden:
        PAGE.write_text(f"{before}{BEGIN}{table}{END}{after}", encoding="utf-8")
    else:
        assert written == table


HALVED = """\
extends: paper2020.published
id: pieces
title: Half of the points for each near miss
source: this test
score: task * product(separation, p=0.5)
"""


def four_near_misses(message: Message) -> Message:
    """One before the first kit, at 12 s, and three before the second, worth three times as much, at 31 s."""
    if message.connection.topic != "/snapshot":
        return message
    fields, t_s = fields_of(message), (message.stamp_ns - ORIGIN_S * 10**9) / 1e9
    outside_s = min(max(first_s - t_s, t_s - last_s, 0.0) for first_s, last_s in NEAR_MISSES_S)
    near = (1 + cos(pi * min(outside_s / 1.5, 1.0))) / 2
    fields.distance_robot_human_operator = FAR_M - (FAR_M - NEAR_M) * near + 0.01 * sin(7 * t_s)
    return changed(message, fields)


NEAR_MISSES_S = ((4.0, 7.0), (15.0, 16.0), (20.5, 21.5), (26.0, 27.0))


@pytest.mark.slow
def test_stopping_early_is_found_again_where_going_on_is_no_worse(tmp_path: Path) -> None:
    """7 points halved once are 3.5; all 28, halved four times, 1.75; both at no lesser rate."""
    log = Copy.of(EXAMPLE).with_changed(four_near_misses).write(tmp_path / "four")
    rules = tmp_path / "pieces.yaml"
    rules.write_text(HALVED, encoding="utf-8")

    found = search(honest_log(log, str(rules)), budget=12, tactics=["stopping early"])

    (one,) = found.exploits
    assert (one.before, one.after, one.standing) == (Decimal("1.75"), Decimal("3.5"), "exploit")


@pytest.mark.slow
def test_no_rules_can_make_a_team_go_on_where_it_costs_more_than_it_brings(folder: Path) -> None:
    found = search(honest(folder, CHARGED), budget=3, tactics=["stopping early"])

    (one,) = found.exploits
    assert (one.standing, one.after > one.before) == ("inherent", True)
    assert found.undeclared == ()


KNOWN_OF_TIME = ("violations deepened", "standing still", "stopping early", "speeds denied")
"""What any price of time alone, read literally, on a log without positions, cannot keep."""


@pytest.mark.slow
def test_nothing_is_found_where_more_violation_costs_more_and_nothing_is_believed(folder: Path) -> None:
    """The time in violation, each second the same, on a log whose recorder is believed."""
    fair = honest(folder, "score: 100 - 10 * seconds(separation) - 50 * violated(collision)\n")
    names = [tactic.name for tactic in TACTICS if not tactic.needs_proof and tactic.name not in KNOWN_OF_TIME]

    found = search(fair, budget=120, tactics=names)

    assert [(one.says, one.before, one.after) for one in found.exploits] == []
    assert found.tried == 120
    assert sum(tally.worse for tally in found.tallies) > 60


@pytest.mark.slow
def test_of_the_rules_on_the_first_page_nothing_is_found_that_they_do_not_declare(tmp_path: Path) -> None:
    log = Copy.of(EXAMPLE).with_changed(four_near_misses).write(tmp_path / "four")

    found = search(honest_log(log, "paper2020"), budget=44)

    assert [(one.says, one.before, one.after) for one in found.undeclared] == []
    assert "motion rewritten" in {one.tactic.name for one in found.of("believed")}


@pytest.mark.slow
def test_the_smallest_of_what_works_is_printed(folder: Path) -> None:
    """A gap of the best world needs few samples: halves of a stretch are tried as long as they work."""
    found = search(honest(folder, f"open: best\n{CHARGED}"), budget=15, tactics=["samples left out"])

    (one,) = found.exploits
    assert one.touched < 15  # of the 56 samples of the first near miss, which were left out at first


@pytest.mark.slow
def test_the_score_of_a_doctored_log_is_that_of_the_command(folder: Path, tmp_path: Path) -> None:
    found = search(
        honest(folder, CRASH, "crash.mcap"),
        budget=4,
        tactics=["messages left out"],
    )
    (one,) = found.exploits
    written = one.logs[0].write(tmp_path / "crash")

    assert (one.before, one.after, one.touched) == (0, 100, 1)
    assert one.standing == "believed"
    assert score_trial(written, str(folder / "rules.yaml")).score == one.after


@pytest.mark.slow
def test_rules_that_compare_teams_are_tried_with_what_the_others_have(tmp_path: Path) -> None:
    """Three teams and what they paid: nothing that one leaves out of its log changes the others' means."""
    run, cohort = tmp_path / "run", tmp_path / "cohort.json"
    Copy.of(EXAMPLE).write(run.parent / "log")
    run.mkdir()
    (tmp_path / "log.mcap").rename(run / "log.mcap")
    (run / "team.yaml").write_text("sensors: {camera: {type: logical_camera}}\n", encoding="utf-8")
    rules = load_rule_set("ariac2017.as_documented")
    measured = score_trial(run, rules).measured
    cohort.write_text(cohort_text(make_cohort(rules, {measured.trial: [contributed(measured, rules)]})))
    with pytest.raises(UsageError, match="it has no score"):
        honest_log(run, rules)

    compared = honest_log(run, rules, cohort=cohort)
    found = search(compared, budget=6, tactics=["messages left out", "topics left out"])

    assert compared.counts > 0
    assert found.undeclared == ()
    assert sum(tally.worse for tally in found.tallies) > 0


@pytest.mark.slow
def test_where_no_log_map_says_what_a_topic_is_about_the_frequent_ones_are_motion() -> None:
    """A competition may read its recordings itself; of its forces come many, of its insertions one."""
    run = honest_log(Path(__file__).parents[2] / "examples/aic/run", "aic2026.qualification")

    assert "/fts_broadcaster/wrench" in run.motion
    assert "/scoring/insertion_event" in run.telling
    assert search(run, budget=8).tried == 8


# By command -----------------------------------------------------------------------------


def run(folder: Path, *more: str, rules: str = EPISODES, log: str = "near.mcap") -> int:
    file = folder / "rules.yaml"
    file.write_text(RULES % "test" + rules, encoding="utf-8")
    return main(["redteam", str(folder / log), "--rules", str(file), *more])


@pytest.mark.slow
def test_the_command_tells_the_story_and_writes_the_log(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    doctored = tmp_path / "doctored.mcap"
    words = ["--budget", "10", "--tactic", "violations joined", "-o", str(doctored)]

    assert run(folder, *words) == 1

    said = capsys.readouterr()
    assert "EXPLOIT: stay as near from 9." in said.out
    assert "against the law 'more_violations', and the rules do not say that they break it" in said.out
    assert f"wrote {doctored}: stay as near" in said.err
    first = doctored.read_bytes()
    assert run(folder, *words) == 1
    assert (capsys.readouterr().out, doctored.read_bytes()) == (said.out, first)


def test_what_the_rules_declare_is_told_and_fails_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    declared = f"{EPISODES}breaks: {{more_violations: two that are joined are one}}\n"

    assert run(folder, "--budget", "1", "--tactic", "violations joined", rules=declared) == 0

    said = capsys.readouterr().out
    assert "DECLARED: stay as near" in said
    assert "    breaks more_violations: two that are joined are one" in said
    assert "nothing found that the rules do not declare, in 1 try (budget 1, seed 0)" in said


def test_what_cannot_be_tried_is_refused_with_a_remedy(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = tmp_path / "trial.jsonl"
    trial.write_text("{}\n", encoding="utf-8")
    for words, code, says in (
        (["redteam", str(trial), "--rules", "paper2020"], 5, "only ROS recordings"),
        (["redteam", str(tmp_path / "gone.mcap"), "--rules", "paper2020"], 5, "no such file"),
        (["redteam", str(tmp_path), "--rules", "paper2020"], 5, "there are 0 recordings in it"),
        (["redteam", str(folder / "near.mcap"), "--rules", "paper2020", "--tactic", "magic"], 4, "'magic'"),
        (["redteam", str(folder / "near.mcap"), "--rules", "paper2020", "--budget", "-1"], 4, "no number"),
    ):
        try:
            found = main(words)
        except SystemExit as left:
            found = int(left.code or 0)
        said = capsys.readouterr().err
        assert (found, says in said) == (code, True), said
        assert "hint: " in said or "help: " in said
    assert run(folder, "-o", str(tmp_path / "x.bag")) == 4
    assert "the doctored log is of the format of the honest one, .mcap" in capsys.readouterr().err
    with pytest.raises(UsageError, match="no tactic 'magic'"):
        search(honest(folder, EPISODES), tactics=["magic"])
