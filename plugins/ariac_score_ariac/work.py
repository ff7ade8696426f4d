"""What ARIAC asks for and what teams bring: orders, tasks, products, trays, kits.

Orders are the work of a trial: their levels are `order`, `submission` (there is one for every task of an
order, handed in or not, so that what was never delivered is priced like what was delivered wrong), `part`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol

from ariac_score import Fact, FrozenMap, Pose, Record, Submission, Trial, WorkItem
from ariac_score_ariac.parts import spoken

__all__ = [
    "NO_HUMAN",
    "FaultMarks",
    "FaultyProducts",
    "Kit",
    "KitRecord",
    "KitSubmission",
    "OpenTasks",
    "Order",
    "Product",
    "SensorBill",
    "Task",
    "Tray",
    "WantedProduct",
    "faulty_products",
    "open_task",
    "orders_of",
    "sensor_cost",
    "submissions_of",
]


NO_HUMAN = "human bodies"
"""What is witnessed where the configuration of a trial has nobody walk about: a human would be known."""


@dataclass(frozen=True)
class WantedProduct:
    """One product of a kit as ordered.

    Attributes:
        slot: Its name within the kit, such as `part_0`.
        type: Full product type, such as `gear_part_red`.
        pose: Wanted pose in the frame of the tray, briefcase or insert; `None` when the order gives none.
        quadrant: Quadrant of the tray it is wanted in, 1 to 4, where orders name quadrants; 0 when not named.
        challenged: Whether a faulty-part challenge is set on its quadrant; `None` when no file says.
    """

    level: ClassVar[str] = "part"
    items: ClassVar[tuple[WorkItem, ...]] = ()
    facts: ClassVar[Mapping[str, Fact]] = FrozenMap({})

    slot: str
    type: str
    pose: Pose | None = None
    quadrant: int = 0
    challenged: bool | None = None

    @property
    def id(self) -> str:
        """The slot, which is its name within the task."""
        return self.slot

    @property
    def words(self) -> str:
        """What is wanted, for people."""
        return spoken(self.type)


@dataclass(frozen=True)
class Product:
    """One product as delivered.

    Attributes:
        type: Full product type, such as `gear_part_red`.
        pose: Pose in the tray frame; `None` when the log does not give a usable one.
        faulty: Whether it is a faulty product.
        name: Name of the individual, when the log gives one.
    """

    type: str
    pose: Pose | None = None
    faulty: bool = False
    name: str = ""


@dataclass(frozen=True)
class Tray:
    """The loose tray a kit is built on, or the insert parts are assembled in, where orders name one.

    Attributes:
        type: Its model, such as `movable_tray_metal_shiny`, `kit_tray_03` or `assembly_insert_2`;
            empty when the log shows that there was none.
        pose: Its pose on the AGV; `None` when unknown or not ordered.
    """

    type: str
    pose: Pose | None = None


@dataclass(frozen=True)
class Task:
    """One piece of work of an order, such as one shipment.

    Attributes:
        id: Shipment type, such as `order_0_shipment_0`.
        kind: `kitting`, `assembly` or `combined`.
        products: What is wanted.
        agv: Ordered AGV; `any` leaves it open.
        station: Ordered station; empty when none is ordered.
        tray: Ordered movable tray, where orders name one.
    """

    level: ClassVar[str] = "submission"

    id: str
    kind: str = "kitting"
    products: tuple[WantedProduct, ...] = ()
    agv: str = "any"
    station: str = ""
    tray: Tray | None = None

    @property
    def words(self) -> str:
        """What is wanted, for people."""
        on = f", on {self.agv}" if self.agv not in ("", "any") else ""
        return f"{self.kind}{on}" + (f", to {self.station}" if self.station else "")

    @property
    def items(self) -> tuple[WantedProduct, ...]:
        """What is wanted, one by one."""
        return self.products

    @property
    def facts(self) -> Mapping[str, Fact]:
        """How many parts are wanted."""
        return FrozenMap({"parts": len(self.products)})


@dataclass(frozen=True)
class Order:
    """An order as announced.

    Attributes:
        id: Such as `order_0`.
        tasks: Its tasks in order.
        announced_s: When it was announced, s of trial time; `None` when the log does not say.
        priority: As the competition defines it; 1 is regular.
        updates: Id of the order it replaces; empty for a new order.
        outline: Whether it is known from an official text alone, which names the order and
            its score, but not its contents.
        priority_said: Whether a record or configuration gives the priority; where not, no formula may use it.
    """

    level: ClassVar[str] = "order"

    id: str
    tasks: tuple[Task, ...] = ()
    announced_s: float | None = None
    priority: int = 1
    updates: str = ""
    outline: bool = False
    priority_said: bool = field(default=True, compare=False)

    @property
    def items(self) -> tuple[Task, ...]:
        """Its tasks."""
        return self.tasks

    @property
    def facts(self) -> Mapping[str, Fact]:
        """How many parts are wanted, and its priority where something says it."""
        facts: dict[str, Fact] = {"parts": sum(len(task.products) for task in self.tasks)}
        if self.priority_said:  # else unknown: a formula that names it then has no value, not a default
            facts["priority"] = self.priority
        return FrozenMap(facts)


class FaultMarks(Protocol):
    """How a competition says which products of a kit are faulty, where the record of the kit does not.

    It is given once all parts of a trial are together, for a configuration may be what says it. A
    function at the top of a module, so that a trial can be pickled.
    """

    def __call__(
        self, contents: tuple[Product, ...], trial: Trial, task: Task | None, /
    ) -> tuple[Product, ...] | None:
        """The products with `faulty` set; `None` where nothing says which of them are.

        Args:
            contents: As the record shows them.
            trial: With everything its parts tell.
            task: The task the kit was handed in for; `None` when no order has it.
        """
        ...


@dataclass(frozen=True)
class Kit(Record):
    """The contents of one tray, briefcase or insert at one instant.

    Attributes:
        place: The AGV or the station, such as `agv1` or `as2`.
        t_s: When, s of trial time.
        contents: The products, in the frame of the tray.
        tray: The movable tray, where kits are built on one.
        faults: How to find out which products are faulty; `None`: the products say it themselves.
    """

    timed: ClassVar[bool] = True

    place: str
    t_s: float
    contents: tuple[Product, ...] = ()
    tray: Tray | None = None
    faults: FaultMarks | None = None

    def shifted(self, by_s: float) -> Kit:
        """The same contents on another clock."""
        return replace(self, t_s=self.t_s + by_s)


class KitRecord(Record):
    """A record of what lay on trays over time."""

    timed: ClassVar[bool] = True

    def seen(self, place: str, t_s: float, *, max_age_s: float) -> Kit | None:
        """The contents at a place and a time; `None` when the log does not show them.

        Args:
            place: Such as `agv1` or `as2`.
            t_s: When, s of trial time.
            max_age_s: How old the last sighting may be in a log that goes on without pause, s.
        """
        raise NotImplementedError

    def shifted(self, by_s: float) -> KitRecord:
        """The same record on another clock."""
        return _Shifted(self, by_s)


@dataclass(frozen=True)
class _Shifted(KitRecord):
    """A record of kits on another clock."""

    record: KitRecord
    by_s: float

    def seen(self, place: str, t_s: float, *, max_age_s: float) -> Kit | None:
        """What the record shows at the same moment."""
        kit = self.record.seen(place, t_s - self.by_s, max_age_s=max_age_s)
        return None if kit is None else kit.shifted(self.by_s)


@dataclass(frozen=True)
class KitSubmission(Submission):
    """One kit as submitted; `item_id` is the type of shipment it was submitted as.

    Attributes:
        contents: The products; `None` when the log does not show them.
        agv: AGV it came on, such as `agv1`; empty when unknown.
        station: Where it was sent; empty when unknown or not needed.
        tray: Movable tray below it, where known.
    """

    contents: tuple[Product, ...] | None = None
    agv: str = ""
    station: str = ""
    tray: Tray | None = None

    @property
    def detailed(self) -> bool:
        """Whether its contents are known: those of its time."""
        return self.contents is not None

    @property
    def words(self) -> str:
        """Where it was brought, for people."""
        return " ".join(
            [*([f"on {self.agv}"] if self.agv else []), *([f"at {self.station}"] if self.station else [])]
        )

    @property
    def shown_contents(self) -> tuple[str, ...] | None:
        """Its products, for people; `None` when the log does not show them."""
        return None if self.contents is None else tuple(spoken(product.type) for product in self.contents)


@dataclass(frozen=True)
class OpenTasks(Record):
    """Tasks of which the log does not say whether they were handed in, although it shows other submissions.

    Attributes:
        ids: Of the tasks.
        why: In words.
    """

    ids: frozenset[str] = frozenset()
    why: str = ""


@dataclass(frozen=True)
class FaultyProducts(Record):
    """The individuals that the configuration of a trial makes faulty."""

    names: frozenset[str] = frozenset()


@dataclass(frozen=True)
class SensorBill(Record):
    """The sensors that an official record counts, and what they cost.

    Attributes:
        cost: In dollars.
        sensors: Sensor types by sensor name; `None` when the record does not list them.
    """

    cost: float
    sensors: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        # A check must not be able to change what the next one reads.
        if self.sensors is not None:
            object.__setattr__(self, "sensors", FrozenMap(dict(self.sensors)))


def orders_of(trial: Trial) -> tuple[Order, ...]:
    """The orders of a trial, in order of announcement."""
    return tuple(item for item in trial.work if isinstance(item, Order))


def submissions_of(trial: Trial) -> tuple[KitSubmission, ...]:
    """The kits and assemblies that were submitted, in order of time."""
    return tuple(one for one in trial.submissions if isinstance(one, KitSubmission))


def open_task(trial: Trial, task: Task) -> str:
    """Why the log does not say whether a task was handed in; empty where it does."""
    opened = (record for record in trial.records if isinstance(record, OpenTasks))
    return next((record.why for record in opened if task.id in record.ids), "")


def faulty_products(trial: Trial) -> frozenset[str] | None:
    """Names of individuals that the configuration makes faulty; `None` when no file says."""
    listed = [record.names for record in trial.records if isinstance(record, FaultyProducts)]
    return listed[0] if listed else None


def sensor_cost(trial: Trial) -> float | None:
    """Cost of the sensors in dollars, by an official record; `None` when none gives it."""
    costs = [record.cost for record in trial.records if isinstance(record, SensorBill)]
    return costs[0] if costs else None
