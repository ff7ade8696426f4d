"""What ARIAC offers to tools that know no competition."""

from __future__ import annotations

from ariac_score import Trial
from ariac_score.testing.recordings import RecordsTrials
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import MOTIONS
from ariac_score_ariac.work import Order, Task, WantedProduct


def test_every_way_to_record_what_moves_is_offered() -> None:
    assert isinstance(Ariac(), RecordsTrials)
    assert Ariac().motions == tuple(MOTIONS)


def test_orders_and_states_are_messages_of_2020_and_the_rest_is_recorded_as_by_anyone() -> None:
    messages = Ariac().recorded_messages(kitting_trial(), motion="snapshot")

    assert {message.topic: message.type for message in messages} == {
        "/ariac/competition_state": "std_msgs/msg/String",
        "/ariac/orders": "nist_gear/msg/Order",
        "/ariac_score/events": "ariac_score_msgs/msg/TrialEvent",
        "/ariac_score/submissions": "ariac_score_msgs/msg/Submission",
        "/snapshot": "nist_gear/msg/Snapshot",
    }
    states = [m.fields["data"] for m in messages if m.topic == "/ariac/competition_state"]
    assert states == ["go", "end_game"]


def test_a_recording_without_the_human_has_no_snapshot() -> None:
    messages = Ariac().recorded_messages(kitting_trial(human=False), motion="snapshot")

    assert "/snapshot" not in {message.topic for message in messages}


def test_only_editions_with_known_product_types_are_checked_for_them() -> None:
    order = Order("order_0", (Task("kit", "kitting", (WantedProduct("part_0", "teapot_red", None),)),))

    trial = Trial("t", work=(order,))
    assert [defect.kind for defect in Ariac(2020).defects(trial)] == ["unknown_product_type"]
    assert [defect.kind for defect in Ariac(2024).defects(trial)] == ["unknown_product_type"]
    assert Ariac(2025).defects(trial) == []
    assert Ariac().defects(trial) == []
