"""What messages of competitions mean."""

from __future__ import annotations

import math
from types import SimpleNamespace as Fields

import pytest

from ariac_score.contracts import Decoder
from ariac_score.logs.decoders import AriacScoreRecords, NistGear2020
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Order, Pose, Product, Submission, Task, WantedProduct

GEAR, RECORDS = NistGear2020(), AriacScoreRecords()
STRING = "std_msgs/msg/String"


def pose(x: float = 0.1, w: float = 1.0) -> Fields:
    return Fields(position=Fields(x=x, y=0.2, z=0.3), orientation=Fields(x=0.0, y=0.0, z=0.0, w=w))


def order(name: str, **of_pose: float) -> Fields:
    products = [
        Fields(type="gear_part_red", pose=pose(**of_pose)),
        Fields(type="gasket_part_blue", pose=pose()),
    ]
    return Fields(
        order_id=name, shipments=[Fields(shipment_type=f"{name}_shipment_0", agv_id="", products=products)]
    )


def submission(**of_pose: float) -> Fields:
    product = Fields(type="gear_part_red", name="gear_7", is_faulty=True, pose=pose(**of_pose))
    return Fields(shipment_type="order_0_shipment_0", agv="agv1", station="as2", products=[product])


@pytest.mark.parametrize("decoder", [GEAR, RECORDS])
def test_is_a_decoder(decoder: object) -> None:
    assert isinstance(decoder, Decoder)


def test_an_order_becomes_kitting_tasks_with_numbered_slots() -> None:
    wanted = Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
    products = (
        WantedProduct("part_0", "gear_part_red", wanted),
        WantedProduct("part_1", "gasket_part_blue", wanted),
    )

    found = GEAR.decode("nist_gear/msg/Order", order("order_0"), 7.5)

    assert found == Order(
        "order_0", (Task("order_0_shipment_0", "kitting", products, agv="any"),), announced_s=7.5
    )


def test_an_update_names_the_order_it_replaces() -> None:
    found = GEAR.decode("nist_gear/msg/Order", order("order_1_update_0"), 0.0)

    assert isinstance(found, Order)
    assert (found.id, found.updates) == ("order_1_update_0", "order_1")


@pytest.mark.parametrize(
    ("state", "event"),
    [
        ("go", Event(3.0, COMPETITION_STARTED)),
        ("end_game", Event(3.0, COMPETITION_ENDED)),
        ("done", None),
        ("init", None),
        ("", None),
    ],
)
def test_the_competition_starts_with_go_and_ends_with_end_game(state: str, event: Event | None) -> None:
    assert GEAR.decode(STRING, Fields(data=state), 3.0) == event


def test_messages_of_other_types_mean_nothing() -> None:
    assert GEAR.decode("std_msgs/msg/Bool", Fields(data="go"), 0.0) is None
    assert RECORDS.decode(STRING, Fields(data="go"), 0.0) is None


@pytest.mark.parametrize("broken", [{"x": math.nan}, {"x": math.inf}, {"w": 0.0}])
def test_an_order_with_an_impossible_pose_is_refused(broken: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"finite|orientation"):
        GEAR.decode("nist_gear/msg/Order", order("order_0", **broken), 0.0)


@pytest.mark.parametrize("broken", [{"x": math.nan}, {"x": math.inf}, {"w": 0.0}])
def test_a_submitted_product_with_an_impossible_pose_stays_without_it(broken: dict[str, float]) -> None:
    found = RECORDS.decode("ariac_score_msgs/msg/Submission", submission(**broken), 1.0)

    assert isinstance(found, Submission)
    assert found.contents == (Product("gear_part_red", None, faulty=True, name="gear_7"),)


def test_a_submission_tells_what_came_where_and_when() -> None:
    found = RECORDS.decode("ariac_score_msgs/msg/Submission", submission(), 12.0)

    product = Product("gear_part_red", Pose((0.1, 0.2, 0.3)), faulty=True, name="gear_7")
    assert found == Submission("order_0_shipment_0", 12.0, (product,), agv="agv1", station="as2")


def test_a_trial_event_is_taken_over() -> None:
    message = Fields(kind="arm_collision", subject="gantry", detail="with person_1")

    found = RECORDS.decode("ariac_score_msgs/msg/TrialEvent", message, 4.0)

    assert found == Event(4.0, "arm_collision", "gantry", "with person_1")
