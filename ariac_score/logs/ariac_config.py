"""Reading the YAML files of ARIAC 2017 to 2024: the trial's orders and the team's sensors.

Numbers may be written as arithmetic with `pi`, such as `'-pi/2'`, which the official
start-up script passes to `eval`. Here they are parsed and walked: numbers, `pi`, the
four operations and signs, nothing else.

Source: `nist_gear/script/gear.py` of 2017 to 2022; ARIAC notes on log formats,
sections 7.1 to 7.3 and 8.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

from ariac_score.contracts import LogDescription, Wanted
from ariac_score.datafiles import YamlDocument, load_yaml
from ariac_score.errors import DataFileError, LogError, did_you_mean
from ariac_score.trial.model import LogDefect, Order, Pose, Task, TeamSetup, Tray, Trial, WantedProduct

__all__ = ["TeamConfigReader", "TrialConfigReader", "arithmetic"]

MAX_SHIPMENTS = 1000
MAX_EXPRESSION_CHARS = 100
_SNIFFED_BYTES = 4_000_000
_GLUED = re.compile(r"\d(?![eE][+-]?\d)[A-Za-z_]")
"""A digit run into a word, which Python parses with a warning."""
_UPDATE = re.compile(r"^(?P<order>.+)_update_\d+$")
_OTHER_CAMERAS = ("robot_camera", "gantry_bin_camera", "gantry_tray_camera")
_HIGH_PRIORITY = 3

# Trials of 2023 and 2024; log formats, section 7.3.
_KINDS = ("kitting", "assembly", "combined")
_TYPES = ("battery", "pump", "sensor", "regulator")
_COLORS = ("red", "green", "blue", "orange", "purple")
_DESTINATIONS = ("kitting", "assembly_front", "assembly_back", "warehouse")
_STATIONS = ("as1", "as2", "as3", "as4")
_CONDITIONS = ("time_condition", "part_place_condition", "submission_condition")
_CHALLENGES = ("faulty_part", "dropped_part", "robot_malfunction", "sensor_blackout", "human")
_QUADRANTS = (1, 2, 3, 4)

_Path = tuple["str | int", ...]
_Kind = TypeVar("_Kind")


class TrialConfigReader:
    """Reads the orders of a trial configuration.

    Orders and their updates are given side by side, without times: when each was
    announced, and so whether an update came, only a log of the trial can tell.
    """

    def can_read(self, path: Path) -> bool:
        """Whether it is a YAML file with `orders` at its top level."""
        return "orders" in _top_level_keys(path)

    def describe(self, path: Path) -> LogDescription:
        """How many orders, tasks and products it asks for."""
        try:
            document = load_yaml(path)
            orders = _orders(document)
        except (DataFileError, LogError) as error:
            return LogDescription(format="ARIAC trial configuration", damage=str(error))
        tasks = [task for order in orders for task in order.tasks]
        return LogDescription(
            format="ARIAC trial configuration",
            defects=tuple(_mistakes(document, path.name)),
            facts={
                "orders": sum(1 for order in orders if not order.updates),
                "updates": sum(1 for order in orders if order.updates),
                "tasks": len(tasks),
                "products": sum(len(task.products) for task in tasks),
            },
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The orders, in the order of the file.

        A mistake where parts are put before the start, such as the rotation `p1/2` of
        official files, changes no order: it is named among the defects.

        Raises:
            DataFileError: It is malformed, or an order has not the shape of 2017 to 2024.
        """
        document = load_yaml(path)
        orders = _orders(document)
        wanted.progress(1.0)
        return Trial(
            id=path.stem,
            orders=orders,
            log_defects=tuple(_mistakes(document, path.name)),
            faulty_products=_faulty_products(document),
        )


class TeamConfigReader:
    """Reads the sensors a team placed; a robot camera it switched on is one of them, typed by its key."""

    def can_read(self, path: Path) -> bool:
        """Whether it is a YAML file with sensors (2024: static ones or robot cameras) but no `orders`."""
        keys = _top_level_keys(path)
        return bool(keys) and "orders" not in keys

    def describe(self, path: Path) -> LogDescription:
        """How many sensors the team has, by type."""
        try:
            sensors = _sensors(load_yaml(path))
        except DataFileError as error:
            return LogDescription(format="ARIAC team configuration", damage=str(error))
        types = sorted(sensors.values())
        return LogDescription(
            format="ARIAC team configuration",
            facts={"sensors": len(types), **{kind: types.count(kind) for kind in types}},
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The team's set-up; its name is not in these files.

        Raises:
            DataFileError: It is malformed, or a sensor has no type.
        """
        sensors = _sensors(load_yaml(path))
        wanted.progress(1.0)
        return Trial(id=path.stem, team=TeamSetup(sensors=MappingProxyType(sensors)))


def arithmetic(text: str) -> float:
    """The value of a number written as arithmetic, such as `-pi/2`.

    Raises:
        ValueError: It holds anything but numbers, `pi`, `+ - * /` and brackets, or
            its value is not finite; the message says what.

    >>> round(arithmetic("-pi/2"), 6)
    -1.570796
    """
    if len(text) > MAX_EXPRESSION_CHARS:
        raise ValueError(f"{text[:20]!r}… is longer than {MAX_EXPRESSION_CHARS} characters")
    try:
        if _GLUED.search(text):
            raise ValueError
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"{text!r} is not a number nor arithmetic with pi") from None
    try:
        value = _value(tree.body, text)
    except (ZeroDivisionError, OverflowError):
        raise ValueError(f"{text!r} has no finite value") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} has no finite value")
    return value


_BINARY: Mapping[type[ast.operator], Callable[[float, float], float]] = MappingProxyType(
    {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
)


def _value(node: ast.expr, text: str) -> float:
    if isinstance(node, ast.Constant):
        number = node.value
        if isinstance(number, (int, float)) and not isinstance(number, bool):
            return float(number)
    if isinstance(node, ast.Name):
        if node.id == "pi":
            return math.pi
        raise ValueError(f"{text!r} names {node.id!r}; only pi is known")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        operand = _value(node.operand, text)
        return -operand if isinstance(node.op, ast.USub) else operand
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return _BINARY[type(node.op)](_value(node.left, text), _value(node.right, text))
    raise ValueError(f"{text!r} is not a number nor arithmetic with pi")


def _top_level_keys(path: Path) -> frozenset[str]:
    """Which of the keys we look for begin a line of a YAML file."""
    try:
        if path.suffix not in (".yaml", ".yml") or not path.is_file():
            return frozenset()
        with path.open("rb") as file:
            head = file.read(_SNIFFED_BYTES)
    except OSError:
        return frozenset()
    found = re.findall(
        rb"""^(?:\xef\xbb\xbf)?["']?(orders|sensors|static_sensors|robot_cameras)["']?[ \t]*:""",
        head,
        re.MULTILINE,
    )
    return frozenset(key.decode() for key in found)


class _Reading:
    """Takes values out of a document, refusing wrong shapes by their place."""

    def __init__(self, document: YamlDocument) -> None:
        self.document = document

    def refuse(self, path: _Path, cause: str, hint: str) -> NoReturn:
        raise DataFileError(
            cause, file=self.document.file, place=self.document.place(path), hint=hint
        ) from None

    def _typed(self, value: Any, kind: type[_Kind], words: str, path: _Path) -> _Kind:
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            self.refuse(path, f"{value!r} is not {words}", f"give {words} here")
        return value

    def mapping(self, value: Any, path: _Path) -> Mapping[Any, Any]:
        if value is None:
            self.refuse(path, "nothing is given here", "give a map, or remove the key")
        return self._typed(value, dict, "a map", path)

    def sequence(self, value: Any, path: _Path) -> Sequence[Any]:
        return self._typed(value, list, "a list", path)

    def text(self, value: Any, path: _Path) -> str:
        text = self._typed(value, str, "text", path)
        return text if text else self.refuse(path, "an empty name is given here", "give the name")

    def count(self, value: Any, path: _Path) -> int:
        number = self._typed(value, int, "a whole number", path)
        if not 0 <= number <= MAX_SHIPMENTS:
            self.refuse(path, f"{number} shipments cannot be ordered", f"give 0 to {MAX_SHIPMENTS}")
        return number

    def number(self, value: Any, path: _Path) -> float:
        if isinstance(value, str):
            try:
                return arithmetic(value)
            except ValueError as cause:
                self.refuse(path, str(cause), "write a number, or arithmetic with pi such as 'pi/2'")
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
            self.refuse(path, f"{value!r} is not a finite number", "give a number")
        return float(value)

    def three(self, value: Any, path: _Path) -> tuple[float, float, float]:
        numbers = self.sequence(value, path)
        if len(numbers) != 3:
            self.refuse(path, f"{len(numbers)} numbers are given, not 3", "give three numbers")
        x, y, z = (self.number(number, (*path, i)) for i, number in enumerate(numbers))
        return x, y, z

    def pose(self, value: Any, path: _Path) -> Pose:
        parts = self.mapping(value, path)
        # gear.py: each of the two defaults to zeros.
        xyz = self.three(parts.get("xyz", [0, 0, 0]), (*path, "xyz"))
        rpy = self.three(parts.get("rpy", [0, 0, 0]), (*path, "rpy"))
        return Pose.from_rpy(xyz, rpy)

    def names(self, parent: Mapping[Any, Any], key: str, count: int, path: _Path) -> list[str] | None:
        """A list with one name for each shipment; `None` when it is left out."""
        if key not in parent:
            return None
        names = self.sequence(parent[key], (*path, key))
        if len(names) != count:
            self.refuse(
                (*path, key),
                f"{len(names)} names are given for {count} shipments",
                "give one for each shipment",
            )
        return [self.text(name, (*path, key, i)) for i, name in enumerate(names)]

    def given(self, parent: Mapping[Any, Any], key: str, path: _Path) -> Any:
        """The value of a key that must be there."""
        if key not in parent:
            near = did_you_mean(key, [str(k) for k in parent], what="given") if parent else ""
            self.refuse(path, f"key {key!r} is missing", f"add {key!r}" + (f"; {near}" if near else ""))
        return parent[key]

    def one_of(self, parent: Mapping[Any, Any], key: str, known: Sequence[_Kind], path: _Path) -> _Kind:
        """The value of a key that must be there and be one of a few."""
        value = self.given(parent, key, path)
        # Not by `in`: True is 1 to Python.
        for choice in known:
            if type(value) is type(choice) and value == choice:
                return choice
        words = [str(choice) for choice in known]
        return self.refuse((*path, key), f"{value!r} is no {key}", did_you_mean(str(value), words))

    def truth(self, parent: Mapping[Any, Any], key: str, path: _Path) -> bool:
        """The value of a key that is true or false; false when it is left out."""
        value = parent.get(key, False)
        return self._typed(value, bool, "true or false", (*path, key))


def _orders(document: YamlDocument) -> tuple[Order, ...]:
    reading = _Reading(document)
    if document.data is None:
        reading.refuse((), "the file is empty", "this official file holds no trial; choose another")
    root = reading.mapping(document.data, ())
    orders = root.get("orders")
    if isinstance(orders, list):
        return _listed_orders(reading, root, orders)
    aliases = _aliases(reading, root)
    taken: list[Order] = []
    for order_id, value in reading.mapping(orders, ("orders",)).items():
        path = ("orders", str(order_id))
        taken.append(_order(reading, str(order_id), value, path, aliases, first=not taken))
    known = {order.id for order in taken}
    for order in taken:
        if order.updates and order.updates not in known:
            reading.refuse(
                ("orders", order.id),
                f"it updates {order.updates!r}, which is not ordered",
                "an update is named after its order",
            )
    return tuple(taken)


def _faulty_products(document: YamlDocument) -> frozenset[str] | None:
    """The individuals that are faulty (2017 to 2022); from 2023 on challenges make parts faulty."""
    reading, root = _Reading(document), document.data
    if isinstance(root.get("orders"), list):
        return None
    path: _Path = ("faulty_products",)
    listed = reading.sequence(root.get("faulty_products") or [], path)
    return frozenset(reading.text(name, (*path, i)) for i, name in enumerate(listed))


def _aliases(reading: _Reading, root: Mapping[Any, Any]) -> Mapping[str, str]:
    """Names that stand for product types, so that one order serves several trials."""
    options = root.get("options") or {}
    path = ("options", "model_type_aliases")
    named = reading.mapping(options, ("options",)).get("model_type_aliases") or {}
    return {
        str(alias): reading.text(kind, (*path, str(alias)))
        for alias, kind in reading.mapping(named, path).items()
    }


def _order(
    reading: _Reading, order_id: str, value: Any, path: _Path, aliases: Mapping[str, str], *, first: bool
) -> Order:
    parts = reading.mapping(value, path)
    if "kitting" in parts or "assembly" in parts:
        tasks = [
            *_tasks_of(reading, order_id, "kitting", parts, path, aliases),
            *_tasks_of(reading, order_id, "assembly", parts, path, aliases),
        ]
        regular = 1
    else:
        tasks = _flat_tasks(reading, order_id, parts, path, aliases)
        # Rulebooks 2019 and 2020, as coded: every order after the first has high priority.
        regular = 1 if first else _HIGH_PRIORITY
    priority = parts.get("priority", regular)
    if type(priority) is not int or priority < 1:
        reading.refuse((*path, "priority"), f"{priority!r} is not a priority", "give 1 (regular) or 3 (high)")
    update = _UPDATE.match(order_id)
    return Order(order_id, tuple(tasks), None, priority, update["order"] if update else "")


def _flat_tasks(
    reading: _Reading, order_id: str, parts: Mapping[Any, Any], path: _Path, aliases: Mapping[str, str]
) -> list[Task]:
    """The shipments of 2017 to 2020; in 2017 they are kits of parts."""
    kits = "kit_count" in parts or "parts" in parts
    noun, count_key, products_key = (
        ("kit", "kit_count", "parts") if kits else ("shipment", "shipment_count", "products")
    )
    count = reading.count(parts.get(count_key, 1), (*path, count_key))
    agvs = reading.names(parts, "destinations", count, path)
    products = _products(reading, parts, products_key, path, aliases)
    return [
        Task(f"{order_id}_{noun}_{k}", "kitting", products, agvs[k] if agvs else "any") for k in range(count)
    ]


def _tasks_of(
    reading: _Reading,
    order_id: str,
    kind: str,
    parts: Mapping[Any, Any],
    path: _Path,
    aliases: Mapping[str, str],
) -> list[Task]:
    """The kitting or assembly shipments of 2021 and 2022."""
    if kind not in parts:
        return []
    path = (*path, kind)
    block = reading.mapping(parts[kind], path)
    if "shipment_count" not in block:
        reading.refuse(path, "key 'shipment_count' is missing", "add 'shipment_count'")
    count = reading.count(block["shipment_count"], (*path, "shipment_count"))
    agvs = reading.names(block, "agvs", count, path)
    stations = reading.names(block, "stations" if kind == "assembly" else "destinations", count, path)
    trays = reading.names(block, "trays", count, path)
    products = _products(reading, block, "products", path, aliases)
    return [
        Task(
            id=f"{order_id}_{kind}_shipment_{k}",
            kind=kind,
            products=products,
            agv=agvs[k] if agvs else "any",
            station=stations[k] if stations else "",
            # Rulebook 2022: the ordered tray pose is the identity at the AGV's tray centre.
            tray=Tray(trays[k], Pose((0.0, 0.0, 0.0))) if trays else None,
        )
        for k in range(count)
    ]


def _products(
    reading: _Reading, parts: Mapping[Any, Any], key: str, path: _Path, aliases: Mapping[str, str]
) -> tuple[WantedProduct, ...]:
    path = (*path, key)
    if key not in parts:
        reading.refuse(path[:-1], f"key {key!r} is missing", f"add {key!r}")
    products: list[WantedProduct] = []
    for slot, value in reading.mapping(parts[key], path).items():
        place = (*path, str(slot))
        product = reading.mapping(value, place)
        if "type" not in product:
            reading.refuse(place, "key 'type' is missing", "add the product's type")
        kind = reading.text(product["type"], (*place, "type"))
        pose = reading.pose(product["pose"], (*place, "pose")) if "pose" in product else None
        products.append(WantedProduct(str(slot), aliases.get(kind, kind), pose))
    return tuple(products)


def _listed_orders(reading: _Reading, root: Mapping[Any, Any], orders: Sequence[Any]) -> tuple[Order, ...]:
    """The orders of 2023 and 2024; each has one task, which is handed in under the order's id."""
    if len(orders) > MAX_SHIPMENTS:
        reading.refuse(("orders",), f"{len(orders)} orders cannot be announced", f"give 1 to {MAX_SHIPMENTS}")
    ids: list[str] = []
    for number, value in enumerate(orders):
        path: _Path = ("orders", number)
        order_id = reading.text(reading.given(reading.mapping(value, path), "id", path), (*path, "id"))
        if "/" in order_id or order_id.split() != [order_id]:
            reading.refuse(
                (*path, "id"), f"{order_id!r} is no order id", "ids are 8 letters and digits, without spaces"
            )
        if order_id in ids:
            reading.refuse((*path, "id"), f"order {order_id!r} is given twice", "give each order its own id")
        ids.append(order_id)
    challenged = _challenged(reading, root, ids)
    return tuple(
        _listed_order(reading, order_id, orders[number], ("orders", number), ids, challenged)
        for number, order_id in enumerate(ids)
    )


def _challenged(reading: _Reading, root: Mapping[Any, Any], ids: Sequence[str]) -> frozenset[tuple[str, int]]:
    """The quadrants of orders that a faulty-part challenge is set on."""
    found: set[tuple[str, int]] = set()
    for number, value in enumerate(reading.sequence(root.get("challenges") or [], ("challenges",))):
        path: _Path = ("challenges", number)
        for kind, challenge in reading.mapping(value, path).items():
            if kind not in _CHALLENGES:
                reading.refuse(path, f"{kind!r} is no challenge", did_you_mean(str(kind), _CHALLENGES))
            if kind == "faulty_part":
                place = (*path, "faulty_part")
                parts = reading.mapping(challenge, place)
                order_id = reading.one_of(parts, "order_id", ids, place)
                found |= {(order_id, q) for q in _QUADRANTS if reading.truth(parts, f"quadrant{q}", place)}
    return frozenset(found)


def _listed_order(
    reading: _Reading,
    order_id: str,
    value: Any,
    path: _Path,
    ids: Sequence[str],
    challenged: frozenset[tuple[str, int]],
) -> Order:
    parts = reading.mapping(value, path)
    _check_announcement(reading, parts, path, ids)
    kind = reading.one_of(parts, "type", _KINDS, path)
    key = f"{kind}_task"
    block = reading.mapping(reading.given(parts, key, path), (*path, key))
    path = (*path, key)
    priority = _HIGH_PRIORITY if reading.truth(parts, "priority", path[:-1]) else 1
    if kind == "kitting":
        tray_id = reading.given(block, "tray_id", path)
        if type(tray_id) is not int or not 0 <= tray_id <= 99:
            reading.refuse(
                (*path, "tray_id"), f"{tray_id!r} is no tray id", "give the number of a tray, 0 to 9"
            )
        task = Task(
            id=order_id,
            kind=kind,
            products=_listed_products(
                reading, block, path, {q for order, q in challenged if order == order_id}
            ),
            agv=f"agv{reading.one_of(block, 'agv_number', _QUADRANTS, path)}",
            station=reading.one_of(block, "destination", _DESTINATIONS, path),
            tray=Tray(f"kit_tray_{tray_id:02d}"),
        )
    else:
        products = _listed_products(reading, block, path, None)
        task = Task(order_id, kind, products, station=reading.one_of(block, "station", _STATIONS, path))
    return Order(order_id, (task,), None, priority)


def _check_announcement(reading: _Reading, order: Mapping[Any, Any], path: _Path, ids: Sequence[str]) -> None:
    """That an order says when it is announced; the time itself only a log can tell."""
    place = (*path, "announcement")
    condition = reading.mapping(reading.given(order, "announcement", path), place)
    for kind, value in condition.items():
        if kind not in _CONDITIONS:
            reading.refuse(place, f"{kind!r} is no condition", did_you_mean(str(kind), _CONDITIONS))
        if kind == "submission_condition":
            reading.one_of(reading.mapping(value, (*place, kind)), "order_id", ids, (*place, kind))
        if kind == "time_condition" and reading.number(value, (*place, kind)) < 0:
            reading.refuse((*place, kind), f"{value!r} s is before the start", "give 0 or more")


def _listed_products(
    reading: _Reading, block: Mapping[Any, Any], path: _Path, challenged: set[int] | None
) -> tuple[WantedProduct, ...]:
    """The products of a task; those of a kit (`challenged` is given) have a quadrant, others a pose."""
    path = (*path, "products")
    products: list[WantedProduct] = []
    for number, value in enumerate(reading.sequence(reading.given(block, "products", path[:-1]), path)):
        place = (*path, number)
        product = reading.mapping(value, place)
        kind = reading.one_of(product, "type", _TYPES, place)
        name = f"{kind}_{reading.one_of(product, 'color', _COLORS, place)}"
        if challenged is None:
            pose = reading.pose(reading.given(product, "assembled_pose", place), (*place, "assembled_pose"))
            products.append(WantedProduct(f"part_{number}", name, pose))
        else:
            quadrant = reading.one_of(product, "quadrant", _QUADRANTS, place)
            products.append(
                WantedProduct(f"part_{number}", name, None, quadrant, challenged=quadrant in challenged)
            )
    return tuple(products)


def _mistakes(document: YamlDocument, where: str) -> Iterator[LogDefect]:
    """Numbers of 2023 and 2024 outside the orders that are none, such as the official `p1/2`."""
    root = document.data
    if not isinstance(root, dict) or not isinstance(root.get("orders"), list):
        return
    for path, value in _numbers_in(root.get("parts"), ("parts",)):
        yield from _mistake(document, path, value, where)
    for path, value in _leaves(root.get("assembly_inserts"), ("assembly_inserts",)):
        yield from _mistake(document, path, value, where)


def _mistake(document: YamlDocument, path: _Path, value: Any, where: str) -> Iterator[LogDefect]:
    if isinstance(value, str):
        try:
            arithmetic(value)
        except ValueError as cause:
            message = f"{cause} ({document.place(path)}); no order depends on it"
            yield LogDefect("configuration_mistake", where, 1, message)


def _leaves(value: Any, path: _Path) -> Iterator[tuple[_Path, Any]]:
    """Every value that is no map or list, with its path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, str(key)))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _leaves(inner, (*path, number))
    else:
        yield path, value


def _numbers_in(value: Any, path: _Path) -> Iterator[tuple[_Path, Any]]:
    return ((place, leaf) for place, leaf in _leaves(value, path) if place[-1] in ("rotation", "offset"))


def _sensors(document: YamlDocument) -> dict[str, str]:
    reading = _Reading(document)
    root = reading.mapping(document.data, ())
    sensors: dict[str, str] = {}
    for key in ("sensors", "static_sensors"):
        if root.get(key) is not None:
            for name, value in reading.mapping(root[key], (key,)).items():
                path: _Path = (key, str(name))
                sensor = reading.mapping(value, path)
                if "type" not in sensor:
                    reading.refuse(path, "key 'type' is missing", "add the sensor's type")
                sensors[str(name)] = reading.text(sensor["type"], (*path, "type"))
    if root.get("robot_cameras") is not None:
        for name, value in reading.mapping(root["robot_cameras"], ("robot_cameras",)).items():
            path = ("robot_cameras", str(name))
            on_robot = reading.mapping(value, path)
            if reading.truth(on_robot, "active", path):
                sensors[str(name)] = f"robot_{reading.one_of(on_robot, 'type', ('rgb', 'rgbd'), path)}_camera"
    for name in _OTHER_CAMERAS:
        camera = root.get(name)
        if camera is not None and reading.mapping(camera, (name,)).get("enable") is True:
            sensors[name] = name
    return dict(sorted(sensors.items()))
