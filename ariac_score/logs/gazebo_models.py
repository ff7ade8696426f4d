"""The models of a `state.log`: their place in the tree, their texts, and whose poses these give."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ariac_score.logs.columnar.columns import ranges
from ariac_score.logs.containers.items import IntArray

__all__ = [
    "ANY_MODEL",
    "MODEL_AS_WRITTEN",
    "Column",
    "Entity",
    "Model",
    "ancestor",
    "texts_of_models",
    "unescaped",
]

ANY_MODEL, MODEL_AS_WRITTEN = b"<model", b"<model name="
_MODEL = re.compile(rb"<model\s+name\s*=\s*")


@dataclass(frozen=True)
class Entity:
    """A model, or a link of one, with poses in the frames.

    Attributes:
        top: The top-level model it belongs to.
        model: Its own model, which may be nested in another; its path where another model has that name.
        link: Its name as a link; empty for the model itself.
    """

    top: str
    model: str
    link: str = ""

    @property
    def key(self) -> str:
        """Unique name within a log: `model|` for a model and `model|link` for a link.

        >>> Entity("cart1", "box_1", "box_1::lid").key
        'box_1|box_1::lid'
        """
        return f"{self.model}|{self.link}"

    @property
    def scoped(self) -> str:
        """Its name as Gazebo scopes it, with the models it is nested in.

        >>> Entity("cart1", "box_1", "box_1::lid").scoped
        'cart1::box_1::box_1::lid'
        """
        return "::".join(filter(None, (self.top, "" if self.model == self.top else self.model, self.link)))


@dataclass(frozen=True, eq=False)
class Column:
    """One entity, and whether its poses are converted."""

    entity: Entity
    converted: bool


class Model:
    """One model's place in the tree, with its text in the previous frame.

    Attributes:
        text: From its name to the next model's name.
        quoted: Its name, with quotes, at the start of the text.
        ends: How many models end in the text.
        around: The text around the numbers of its poses.
        whose: The columns of its poses that are converted.
        chosen: Whether each of its poses is converted.
        changes: The frames in which the text changed.
        shown: For each change the columns of its poses, and the number of the first; the others follow it.
        runs: Runs of frames that list it, each as its first frame and the one after its last.
    """

    def __init__(self, name: str, key: str, parent: Model | None) -> None:
        self.name, self.key, self.parent = name, key, parent
        self.children: dict[bytes, Model] = {}
        self.columns: dict[str, Column] = {}
        self.written: dict[bytes | None, Column] = {}
        self.text = self.quoted = b""
        self.ends = 0
        self.around: list[bytes] = []
        self.whose: list[Column] = []
        self.chosen: list[bool] = []
        self.changes: array[int] = array("q")
        self.shown: list[tuple[list[Column], int]] = []
        self.runs: array[int] = array("q")

    def frames(self, count: int) -> IntArray:
        """The frames that list it, among the given number of whole frames."""
        # A run may have begun in a frame that turned out to be corrupt, which does not count.
        first, behind = np.minimum(np.array(self.runs, dtype=np.int64), count).reshape(-1, 2).T
        return ranges(first, behind - first)

    def poses(self, frames: IntArray) -> Iterator[tuple[Column, IntArray, IntArray]]:
        """Each column that its text gives poses of, with the frames and the numbers of its poses there."""
        version = np.searchsorted(np.array(self.changes, dtype=np.int64), frames, side="right") - 1
        rows: dict[Column, IntArray] = {}
        first = np.array([number for _, number in self.shown], dtype=np.int64)
        kinds = {id(whose): whose for whose, _ in self.shown}
        kind = np.array([id(whose) for whose, _ in self.shown], dtype=np.uint64)
        for key, whose in kinds.items():
            alike = np.flatnonzero(kind == key)
            for place, column in enumerate(whose):
                if column not in rows:
                    rows[column] = np.full(len(self.shown), -1, dtype=np.int64)
                rows[column][alike] = first[alike] + place
        for column, of_version in rows.items():
            at = of_version[version]
            yield column, frames[at >= 0], at[at >= 0]

    @property
    def top(self) -> str:
        """The name of the top-level model above (or at) this one."""
        model = self
        while model.parent is not None and model.parent.parent is not None:
            model = model.parent
        return model.key


def texts_of_models(frame: bytes) -> list[bytes]:
    """The text of each model from its quoted name on, up to the next model's."""
    segments = frame.split(MODEL_AS_WRITTEN)
    if len(segments) - 1 != frame.count(ANY_MODEL):
        segments = _MODEL.split(frame)
    del segments[0]
    return segments


def ancestor(model: Model, levels: int) -> Model:
    """The model some levels up; the root when there are not that many."""
    for _ in range(levels):
        if model.parent is None:
            break
        model = model.parent
    return model


_ENTITIES = {"&lt;": "<", "&gt;": ">", "&apos;": "'", "&quot;": '"', "&amp;": "&"}
"""`&amp;` last: `&amp;lt;` is the text `&lt;`, not `<`."""


def unescaped(raw: bytes) -> str:
    """A name as the log writes it, without the entities of XML."""
    text = raw.decode("utf-8", "replace")
    for entity, character in _ENTITIES.items() if "&" in text else ():
        text = text.replace(entity, character)
    return text
