"""Kits that left by the states of AGVs alone, where the console was not recorded."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from ariac_score import Verdict, score_trial
from ariac_score.testing.bags import Recorded
from ariac_score_ariac.stock.agv_states import AGVS, AgvState, deliveries_shown
from ariac_score_ariac.stock.deliveries import Delivery

from .stock_bags import at, stock_bag, words_of_state
from .test_stock_steps import SHARED, current_score, recorded_2019, recorded_2021

ENDS_S = 40.0


def states(
    agv: str, *changes: tuple[float, str], until_s: float = ENDS_S, every_s: float = 0.05
) -> list[AgvState]:
    """What an AGV publishes: a state holds until the next one, first of all `ready_to_deliver`."""
    course = [(-5.0, "ready_to_deliver"), *changes]
    times = [-5 + i * every_s for i in range(round((until_s + 5) / every_s))]
    return [AgvState(t_s, agv, [s for from_s, s in course if from_s <= t_s][-1]) for t_s in times]


def trip_2019(t_s: float) -> list[tuple[float, str]]:
    words = ("preparing_to_deliver", "delivering", "delivered", "returning", "ready_to_deliver")
    return [(t_s + later, word) for later, word in zip((0.0, 0.75, 4.0, 5.0, 8.0), words, strict=True)]


def trip_2021(t_s: float, way: str) -> list[tuple[float, str]]:
    words = ("go_to_assembly_station", way, "docked_to_assembly_station", "ready_to_deliver")
    return [(t_s + later, word) for later, word in zip((0.0, 0.75, 7.0, 7.05), words, strict=True)]


def trip_2022(t_s: float, to: str, way: str) -> list[tuple[float, str]]:
    words = (to, way, "DOCKED_TO_AS", "READY_TO_DELIVER")
    return [(t_s + later, word) for later, word in zip((0.0, 1.0, 7.0, 7.05), words, strict=True)]


def shown(*messages: Sequence[AgvState], agvs: Sequence[str]) -> list[Delivery] | None:
    return deliveries_shown([one for some in messages for one in some], agvs, 0.0, ENDS_S - 1)


def test_a_kit_is_handed_in_before_the_message_that_shows_its_agv_sent_off() -> None:
    found = shown(states("agv1", *trip_2019(20.02)), states("agv2"), agvs=AGVS[:2])
    assert found == [Delivery(pytest.approx(20.0), "agv1")]


def test_stations_follow_from_the_way_on_which_an_agv_then_is(subtests: pytest.Subtests) -> None:
    for agv, course, station in (
        ("agv2", trip_2021(10.02, "KS_AS1AS3"), "as1"),
        ("agv3", trip_2021(10.02, "KS_AS1AS3"), "as3"),
        ("agv4", trip_2021(10.02, "KS_AS2AS4"), "as4"),
        ("agv1", trip_2022(10.02, "GOTO_AS2", "AGV1_KS1_AS2"), "as2"),
    ):
        with subtests.test(agv, station=station):
            assert shown(states(agv, *course), agvs=[agv]) == [
                Delivery(pytest.approx(10.0), agv, "", station)
            ]


def test_an_agv_that_goes_from_station_to_station_or_back_hands_in_nothing() -> None:
    back = trip_2022(20.02, "GOTO_KS", "AGV1_AS2_KS")
    on = trip_2022(10.02, "GOTO_AS2", "AGV1_AS1_AS2")
    assert shown(states("agv1", *on, *back), agvs=["agv1"]) == []


def test_what_may_have_left_unseen_is_not_told(subtests: pytest.Subtests) -> None:
    left = states("agv1", *trip_2019(20.02))
    for why, messages in (
        ("one AGV is not recorded", [m for m in left if m.agv == "agv2"]),
        ("begins late", [m for m in left if m.t_s > 1.1]),
        ("ends early", [m for m in left if m.t_s < ENDS_S - 2.1]),
        ("a pause", [m for m in left if not 30 < m.t_s < 31.1]),
        ("a pause as it leaves", [m for m in left if not 19.9 < m.t_s < 20.1]),
        (
            "two nodes publish it",
            [*left, *(AgvState(m.t_s + 0.01, "agv1", "ready_to_deliver") for m in left)],
        ),
        ("where to is not seen", states("agv1", (38.9, "go_to_assembly_station"))),
    ):
        with subtests.test(why):
            assert shown(messages, agvs=["agv1"]) is None
    assert shown(left, agvs=["agv1"]) is not None


# Whole recordings


def published(messages: Sequence[AgvState]) -> list[Recorded]:
    return [at(m.t_s, f"/ariac/{m.agv}/state", "std_msgs/msg/String", data=m.state) for m in messages]


def without_console(messages: Sequence[Recorded]) -> list[Recorded]:
    return [message for message in messages if message.topic != "/rosout"]


def recorded(name: str, is_open: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = SHARED / "cases" / "rostest2019-perfect-shipment.json"
    if not path.is_file():
        pytest.skip("the official cases (../shared/ariac/cases) are not here")
    given = json.loads(path.read_text(encoding="utf-8"))
    (leaving,) = (command["submit_agv"] for command in given["commands"] if "submit_agv" in command)
    stock = recorded_2019(given, announced={o["id"]: 0.001 for o in given["orders"]}, course=[(10.0, 15.0)])
    seen = [states(agv, *(trip_2019(10.001) if agv == leaving else [])) for agv in AGVS[:2]]
    both = [*stock, *published([*seen[0], *seen[1]])]
    messages = {
        "console and states": both,
        "states": without_console(both),
        "states without the score": [m for m in without_console(both) if m.topic != "/ariac/current_score"],
        "neither": without_console(stock),
    }[name]
    result = score_trial(
        stock_bag(tmp_path / "run", "2019", messages, monkeypatch), rules="ariac2019.as_coded"
    )
    right = given["expected"]["game_total"]
    assert result.is_open is is_open
    if is_open:
        assert result.interval is not None
        assert result.interval.least < right <= result.interval.most
    else:
        assert result.score == right


def test_a_shipment_of_2019_is_scored_by_states_of_agvs_and_steps_of_the_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded("states", False, tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "is_open"),
    [("console and states", False), ("states without the score", True), ("neither", True)],
)
def test_with_the_console_states_agree_and_without_steps_they_name_no_shipment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, is_open: bool
) -> None:
    recorded(name, is_open, tmp_path, monkeypatch)


@pytest.mark.slow
def test_a_kit_of_2021_that_left_is_named_without_the_console_and_drops_stay_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what fell to the floor the console alone says how much it costs."""
    stock = [
        m for m in recorded_2021() if m.topic not in ("/ariac/current_score", "/ariac/competition_state")
    ]
    for message in stock:
        message.fields.pop("assembly_shipments", None)
    seen = [
        states(agv, *(trip_2021(20.02, "KS_AS1AS3") if agv == "agv1" else []), until_s=60) for agv in AGVS
    ]
    messages = [
        *without_console(stock),
        *published([message for some in seen for message in some]),
        *current_score((20.03, 4.0), until_s=60.0),
        *words_of_state((-5, "init"), (0.0, "go"), (59.0, "done"), until_s=60.0),
    ]
    log = stock_bag(tmp_path / "run", "2021", messages, monkeypatch)
    found = score_trial(log, rules="ariac2021.finals_as_coded").measured.findings.values()
    verdicts = {f.check: f.verdict.value for f in found if f.verdict is not Verdict.NOT_APPLICABLE}
    open_ones = {check for check, verdict in verdicts.items() if verdict == "inconclusive"}
    assert (verdicts["submitted"], verdicts["right_destination"]) == ("satisfied", "satisfied")
    assert open_ones == {"dropped_parts"}
