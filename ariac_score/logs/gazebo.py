"""Reading `state.log`, the motion record of Gazebo classic.

The file is a sequence of compressed chunks, each a sequence of `<state>` frames; 600 KB
of it hold 25 MB of text. It is read as a stream: no XML tree, and no more text in memory
than one frame and one piece of a chunk. Most models stand still, so a model whose text
is the same as in the previous frame is not parsed again.

Why not an XML parser? A log that was cut off is not well-formed, and parsing every frame
takes many times as long as comparing it with the one before.

Source: Gazebo classic 7 to 11, `physics/WorldState` and `util/LogRecord`; ARIAC notes
on log formats, section 4.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from operator import ne
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ariac_score.checks.contracts import LogDescription, ReaderFacts, TopicDescription, Wanted
from ariac_score.errors import CutOffError, LogError, NothingToScoreError
from ariac_score.logs.columnar.columns import ranges
from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.gazebo_text import CorruptError, Tape, frames, text, without_cdata
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch
from ariac_score.trial.clock import SIMULATED_TIME, Clock
from ariac_score.trial.cut import cut_at
from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.tracks import ModelTrack

__all__ = ["Entity", "GazeboStateReader", "GazeboStates", "read_states"]


CLOCK = Clock(SIMULATED_TIME)


_END_OF_LOG = b"</gazebo_log>"


_ENCODING = re.compile(rb"""^\s+encoding\s*=\s*(['"])(\w+)\1\s*>$""")


_VERSION = re.compile(rb"<gazebo_version>([^<]{0,200})</gazebo_version>")


# At most 30 digits: `int` refuses very long numbers with an error of its own.
_SIM_TIME = re.compile(rb"<sim_time>\s*(\d{1,30})\s+(\d{1,30})\s*</sim_time>")


_DELETIONS = re.compile(rb"<deletions>|</deletions>")


_END_OF_MODEL = b"</model>"


_NAME = re.compile(rb"<name>([^<]*)</name>")


_MODEL = re.compile(rb"<model\s+name\s*=\s*")


_MODEL_AS_WRITTEN = b"<model name="


_ANY_MODEL = b"<model"


_POSE = re.compile(
    rb"""(?:<link\s+name\s*=\s*(?:'(?P<link>[^'<\n]*)'|"(?P<also>[^"<\n]*)")[^<>]*>\s*)?"""
    rb"""<pose[^<>]*>(?P<numbers>[^<]*)</pose>"""
)


_NUMBERS = re.compile(rb"<pose[^<>]*>([^<]*)</pose>")
"""Finds the same numbers as `_POSE`, in the same order, without looking for whose they are."""


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
class GazeboStates:
    """All frames of a log, by column.

    Attributes:
        t_ns: Simulated time of each frame, shape (n,), ns, as recorded: may repeat or run back.
        poses: For each converted entity the frames that list it, shape (m,), and its poses there,
            shape (m, 6): x, y, z in m and roll, pitch, yaw in rad, world frame, as recorded.
        entities: Every model and link seen, converted or not, by key.
        listed: For each model (by `Entity.model`) the frames that list it, shape (m,).
        deleted: For each deleted model the frames that delete it.
        gazebo_version: As in the header; empty when it has none.
        cut_off: Why the log ends early, in words; empty for a whole one.
    """

    t_ns: IntArray
    poses: Mapping[str, tuple[IntArray, FloatArray]]
    entities: Mapping[str, Entity]
    listed: Mapping[str, IntArray]
    deleted: Mapping[str, IntArray]
    gazebo_version: str = ""
    cut_off: str = ""

    @property
    def t_s(self) -> FloatArray:
        """Simulated time of each frame, shape (n,), s."""
        t_s: FloatArray = self.t_ns / 1e9
        return t_s

    @property
    def models(self) -> tuple[str, ...]:
        """Names of all models, nested ones too, sorted."""
        return tuple(sorted(e.model for e in self.entities.values() if not e.link))

    @property
    def links(self) -> tuple[str, ...]:
        """Keys of all links, sorted."""
        return tuple(sorted(key for key, e in self.entities.items() if e.link))

    @property
    def defects(self) -> tuple[LogDefect, ...]:
        """Faults of the log as a whole; `where` is left to the caller."""
        repeated = int((np.diff(self.t_ns) == 0).sum())
        found = []
        if self.cut_off:
            found.append(LogDefect("cut_off", "", 1, self.cut_off))
        if repeated:
            message = "frames repeated a simulated time; the last frame of each was kept"
            found.append(LogDefect("repeated_stamps", "", repeated, message))
        return tuple(found)

    def pose_in_each_frame(self, key: str) -> tuple[IntArray, FloatArray]:
        """The last known pose of an entity in every frame while it exists.

        A log may list only the models that moved since the previous frame; the others
        have stayed where they were, until they are deleted.

        Returns:
            The frames from its first listing on, less those in which it is deleted,
            shape (k,), and its pose in each, shape (k, 6).
        """
        listed, poses = self.poses[key]
        if not len(listed):  # listed twice in a frame, the second time without a pose
            return listed, poses
        frames = np.arange(listed[0], len(self.t_ns), dtype=np.int64)
        row = np.searchsorted(listed, frames, side="right") - 1
        entity = self.entities[key]
        alive = np.ones(len(frames), dtype=bool)
        for name in {entity.top, entity.model}:
            if name in self.deleted:
                deleted = np.concatenate(([-1], self.deleted[name]))
                alive &= deleted[np.searchsorted(deleted, frames, side="right") - 1] <= listed[row]
        return frames[alive], poses[row[alive]]


def read_states(
    path: Path,
    wanted: Callable[[Entity], bool] | None = None,
    progress: Callable[[float], None] | None = None,
) -> GazeboStates:
    """Read every frame of a `state.log`.

    A log that was cut off (a killed server leaves no end) is read up to the cut.

    Args:
        path: The file.
        wanted: Which entities' poses to convert; all when left out.
        progress: Called after each chunk with the share of the file read, 0 to 1.

    Raises:
        NothingToScoreError: The file is missing or empty.
        LogError: A complete chunk is corrupt, or there is not one whole frame.
    """
    scan = _Scan(path, wanted)
    scan.run(progress)
    return scan.states()


@dataclass(frozen=True, eq=False)
class _Column:
    """One entity, and whether its poses are converted."""

    entity: Entity
    converted: bool


def _merged(shown: Sequence[tuple[IntArray, IntArray]], poses: FloatArray) -> tuple[IntArray, FloatArray]:
    """The frames that show an entity, and its pose in each.

    Args:
        shown: For each model whose text gives its poses, the frames and the number of its pose in each.
        poses: All poses, shape (n, 6).
    """
    frames, rows = (np.concatenate(parts) for parts in zip(*shown, strict=True))
    if len(shown) > 1:
        order = np.argsort(frames, kind="stable")
        frames, rows = frames[order], rows[order]
    return frames, poses[rows]


class _Model:
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

    def __init__(self, name: str, key: str, parent: _Model | None) -> None:
        self.name, self.key, self.parent = name, key, parent
        self.children: dict[bytes, _Model] = {}
        self.columns: dict[str, _Column] = {}
        self.written: dict[bytes | None, _Column] = {}
        self.text = self.quoted = b""
        self.ends = 0
        self.around: list[bytes] = []
        self.whose: list[_Column] = []
        self.chosen: list[bool] = []
        self.changes: array[int] = array("q")
        self.shown: list[tuple[list[_Column], int]] = []
        self.runs: array[int] = array("q")

    def frames(self, count: int) -> IntArray:
        """The frames that list it, among the given number of whole frames."""
        # A run may have begun in a frame that turned out to be corrupt, which does not count.
        first, behind = np.minimum(np.array(self.runs, dtype=np.int64), count).reshape(-1, 2).T
        return ranges(first, behind - first)

    def poses(self, frames: IntArray) -> Iterator[tuple[_Column, IntArray, IntArray]]:
        """Each column that its text gives poses of, with the frames and the numbers of its poses there."""
        version = np.searchsorted(np.array(self.changes, dtype=np.int64), frames, side="right") - 1
        rows: dict[_Column, IntArray] = {}
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


class _Scan:
    """One pass over one file; keeps what was read even when the pass ends in an error."""

    def __init__(self, path: Path, wanted: Callable[[Entity], bool] | None) -> None:
        self.path, self.wanted = path, wanted
        self.version, self.cut_off = "", ""
        self.chunk = 0
        self.t_ns: array[int] = array("q")
        # The models of the previous frame in order, the frame from which on they are listed, and their texts.
        self.listed: list[_Model] = []
        self.since = 0
        self.segments: list[bytes] = []
        # All poses in the order of their frames, and those of the current frame that are still text.
        self.numbers: array[float] = array("d")
        self.poses = 0
        self.fresh: list[bytes] = []
        self.fresh_of: list[_Column] = []
        self.root = _Model("", "", None)
        self.models: dict[str, _Model] = {}
        self.deleted: dict[str, list[int]] = {}

    def run(self, progress: Callable[[float], None] | None) -> None:
        """Read the whole file."""
        try:
            size = self.path.stat().st_size
            if not size:
                raise NothingToScoreError(
                    "the state log is empty",
                    file=self.path,
                    hint="switch on gazebo_state_logging in the trial and let the simulator shut down",
                )
            with self.path.open("rb") as file:
                for done in self._chunks(Tape(file, self.path)):
                    if progress is not None:
                        progress(min(1.0, done / size))
        except FileNotFoundError:
            raise NothingToScoreError("no such file", file=self.path, hint="check the path") from None
        except OSError as cause:
            raise LogError(
                f"cannot be read: {cause.strerror}", file=self.path, hint="check the permissions"
            ) from cause
        if not self.t_ns:
            raise LogError(
                "not one whole frame in this state log",
                file=self.path,
                place=f"chunk {self.chunk}" if self.chunk else "",
                hint="the recording stopped before it began; use the log of another run",
            )

    def states(self) -> GazeboStates:
        """What was read so far, as arrays."""
        self._end_run(len(self.t_ns))
        self.listed = []
        frames = {key: model.frames(len(self.t_ns)) for key, model in self.models.items()}
        shown: dict[_Column, list[tuple[IntArray, IntArray]]] = {}
        for key, model in self.models.items():
            for column, at, rows in model.poses(frames[key]):
                shown.setdefault(column, []).append((at, rows))
        columns = sorted(
            (c for m in self.models.values() for c in m.columns.values()), key=lambda c: c.entity.key
        )
        poses = np.array(self.numbers[: len(self.numbers) // 6 * 6], dtype=np.float64).reshape(-1, 6)
        nowhere = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))]
        return GazeboStates(
            t_ns=np.array(self.t_ns, dtype=np.int64),
            poses=MappingProxyType(
                {c.entity.key: _merged(shown.get(c, nowhere), poses) for c in columns if c.converted}
            ),
            entities=MappingProxyType({c.entity.key: c.entity for c in columns}),
            listed=MappingProxyType({key: frames[key] for key in sorted(self.models)}),
            deleted=MappingProxyType(
                {k: np.array(self.deleted[k], dtype=np.int64) for k in sorted(self.deleted)}
            ),
            gazebo_version=self.version,
            cut_off=self.cut_off,
        )

    def _chunks(self, tape: Tape) -> Iterator[int]:
        """Read chunk after chunk, yielding the offset behind each."""
        while True:
            between = tape.take_past(b"<chunk")
            if between is None:
                self._finish(tape.rest())
                return
            self._note_version(between)
            self.chunk += 1
            offset = tape.offset
            tag = tape.take_past(b">")
            body = None if tag is None else tape.take_past(b"</chunk>")
            # A killed server leaves a chunk that ends anywhere; its whole frames count.
            if tag is None or body is None:
                body = tape.rest()
                self._cut("in the middle of chunk")
                if tag is not None:
                    self._read_chunk(without_cdata(body), tag, offset, whole=False)
                self._describe_cut()
                return
            self._read_chunk(without_cdata(body.removesuffix(b"</chunk>")), tag, offset, whole=True)
            yield tape.offset

    def _finish(self, rest: bytes) -> None:
        self._note_version(rest)
        if _END_OF_LOG not in rest:
            self._cut("after chunk")
            self._describe_cut()

    def _cut(self, where: str) -> None:
        self.cut_off = f"the file ends {where} {self.chunk}" if self.chunk else "the file ends in its header"

    def _describe_cut(self) -> None:
        last = f"{self.t_ns[-1] / 1e9:.3f} s" if self.t_ns else "nothing"
        self.cut_off += f" without </gazebo_log>; it was read up to {last} of simulated time"

    def _note_version(self, header: bytes) -> None:
        """Look for the version between chunks; the rest of a chunk there means that its tag was damaged."""
        if b"CDATA" in header:
            raise LogError(
                f"what follows chunk {self.chunk} is corrupt: a chunk without its opening tag",
                file=self.path,
                hint="the file was damaged after it was written; copy it again, or score without it",
            )
        found = _VERSION.search(header)
        if found:
            self.version = found[1].strip().decode("utf-8", "replace")

    def _read_chunk(self, body: bytes, tag: bytes, offset: int, *, whole: bool) -> None:
        named = _ENCODING.match(tag)
        encoding = named[2].decode() if named else ""
        try:
            for frame, plain in frames(text(body, encoding, whole=whole)):
                self._read_frame(frame, plain=plain)
        except CorruptError as cause:
            raise LogError(
                f"chunk {self.chunk} is corrupt: {cause}",
                file=self.path,
                place=f"byte {offset}",
                hint="the file was damaged after it was written; copy it again, or score without it",
            ) from cause.__cause__

    def _read_frame(self, frame: bytes, *, plain: bool) -> None:
        time = _SIM_TIME.search(frame)
        if time is None:
            raise CorruptError(f"frame {len(self.t_ns)} has no <sim_time> of seconds and nanoseconds")
        t_ns = int(time[1]) * 10**9 + int(time[2])
        if t_ns >= 2**63:
            raise CorruptError(f"frame {len(self.t_ns)} has a simulated time beyond 292 years")
        index = len(self.t_ns)
        if not plain:
            self._note_deletions(frame, index)
        head, *segments = frame.split(_MODEL_AS_WRITTEN)
        changed = None if _ANY_MODEL in head else self._changed(segments)
        if changed is None:
            # Other models than before, or other text before their names: look at all of the frame.
            segments = _segments(frame)
            changed = self._changed(segments)
        if changed is None:
            self._list_anew(segments, index)
        else:
            for place, parts in changed:
                self._parse(self.listed[place], segments[place], parts, index)
        self.segments = segments
        self._convert()
        self.t_ns.append(t_ns)

    def _changed(self, segments: Sequence[bytes]) -> Sequence[tuple[int, list[bytes]]] | None:
        """The models whose text changed, with its parts; `None` when the list of models changed, too."""
        if len(segments) != len(self.segments):
            return None
        changed = []
        # Nearly all models stand still, and comparing equal bytes is the fastest way to find that out.
        for place in compress(range(len(segments)), map(ne, segments, self.segments)):
            model, segment = self.listed[place], segments[place]
            parts = _NUMBERS.split(segment)
            # The same text around its numbers proves the same names, links and ends.
            if parts[::2] != model.around and (
                not segment.startswith(model.quoted)
                or segment.count(_END_OF_MODEL) != model.ends
                or _ANY_MODEL in segment
            ):
                return None
            changed.append((place, parts))
        return changed

    def _list_anew(self, segments: Sequence[bytes], index: int) -> None:
        """Find the models of a frame that lists others than the previous one."""
        if any(segment[:1].isspace() for segment in segments):
            segments = [segment.lstrip() for segment in segments]
        self._end_run(index)
        here, self.listed, self.since = self.root, [], index
        for segment in segments:
            model = self._child(here, segment)
            if segment != model.text:
                self._parse(model, segment, _NUMBERS.split(segment), index)
            self.listed.append(model)
            here = _ancestor(model, model.ends)

    def _end_run(self, behind: int) -> None:
        for model in self.listed:
            model.runs.extend((self.since, behind))

    def _note_deletions(self, frame: bytes, index: int) -> None:
        if b"<deletions>" not in frame:
            return
        begin = -1
        # Tag by tag: a pattern for pairs would search to the end of the frame for each tag without a partner.
        for tag in _DELETIONS.finditer(frame):
            if tag[0] == b"<deletions>":
                begin = tag.end() if begin < 0 else begin
                continue
            if begin >= 0:
                for name in _NAME.finditer(frame, begin, tag.start()):
                    self.deleted.setdefault(_words(name[1].strip()), []).append(index)
            begin = -1

    def _child(self, parent: _Model, segment: bytes) -> _Model:
        quote = segment[:1]
        end = segment.find(quote, 1)
        if quote not in (b"'", b'"') or end < 0:
            raise CorruptError(f"frame {len(self.t_ns)} holds a model without a quoted name")
        raw = segment[1:end]
        model = parent.children.get(raw)
        if model is None:
            name = _words(raw)
            # Several models may contain one of the same name, such as a wheel on each cart.
            key = name if name not in self.models else f"{parent.key}::{name}"
            if key in self.models:
                raise CorruptError(f"two models are called {key!r}")
            model = parent.children[raw] = self.models[key] = _Model(name, key, parent)
            model.quoted = segment[: end + 1]
        return model

    def _parse(self, model: _Model, segment: bytes, parts: Sequence[bytes], index: int) -> None:
        """Take the poses of a model whose text changed; mostly only its numbers did."""
        if parts[::2] != model.around:
            self._learn(model, segment)
            if len(model.chosen) != len(parts) // 2:
                raise CorruptError(f"frame {len(self.t_ns)} has poses that cannot be told apart")
            model.around = list(parts[::2])
        self.fresh += compress(parts[1::2], model.chosen)
        self.fresh_of += model.whose
        model.text = segment
        model.changes.append(index)
        model.shown.append((model.whose, self.poses))
        self.poses += len(model.whose)

    def _learn(self, model: _Model, segment: bytes) -> None:
        """Find out which entities the poses in the text of a model belong to.

        The text runs from the model's name to the next model's: its own poses, then
        after each `</model>` those that an ancestor lists behind it.
        """
        own, *after = segment.split(_END_OF_MODEL)
        whose = self._whose(model, own, links_only=False)
        above: _Model | None = model
        for piece in after:
            above = above.parent if above is not None else None
            if above is not None and above is not self.root and b"<link" in piece:
                whose += self._whose(above, piece, links_only=True)
            else:
                whose += [None] * len(_NUMBERS.findall(piece))
        model.ends, model.chosen = len(after), [column is not None for column in whose]
        model.whose = [column for column in whose if column is not None]

    def _whose(self, model: _Model, text: bytes, *, links_only: bool) -> list[_Column | None]:
        """The columns of the poses in some text, in order; `None` for poses that are not converted."""
        own_expected = not links_only
        found: list[_Column | None] = []
        for pose in _POSE.finditer(text):
            single, double, _ = pose.groups()
            written = double if single is None else single
            if not written and not own_expected:
                found.append(None)  # a pose inside a link, of something that is neither model nor link
                continue
            own_expected = False
            column = model.written.get(written)
            if column is None:
                column = self._column(model, written)
            found.append(column if column.converted else None)
        return found

    def _column(self, model: _Model, written: bytes | None) -> _Column:
        """The column of a link, by its name as written, or of the model itself."""
        link = "" if written is None else _words(written)
        column = model.columns.get(link)
        if column is None:
            entity = Entity(model.top, model.key, link)
            converted = self.wanted is None or self.wanted(entity)
            column = model.columns[link] = _Column(entity, converted)
        model.written[written] = column
        return column

    def _convert(self) -> None:
        """Convert the new poses of a frame, all at once where each has six numbers."""
        if not self.fresh:
            return
        # With a separator between the poses: five numbers and then seven would otherwise pass for two poses.
        words = b" | ".join(self.fresh).split()
        between = words[6::7]
        del words[6::7]
        fits = len(words) == 6 * len(self.fresh) and between.count(b"|") == len(self.fresh) - 1
        try:
            numbers = array("d", map(float, words if fits else ()))
        except ValueError:
            fits = False
        if fits:
            self.numbers += numbers
        else:
            for column, text in zip(self.fresh_of, self.fresh, strict=True):
                self.numbers.extend(self._six(text, column.entity))
        self.fresh.clear()
        self.fresh_of.clear()

    def _six(self, text: bytes, entity: Entity) -> list[float]:
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != 6:
            frame = len(self.t_ns)
            raise CorruptError(f"frame {frame} gives {entity.key!r} a pose that is not six numbers")
        return numbers


def _segments(frame: bytes) -> list[bytes]:
    """The text of each model from its quoted name on, up to the next model's."""
    segments = frame.split(_MODEL_AS_WRITTEN)
    if len(segments) - 1 != frame.count(_ANY_MODEL):
        segments = _MODEL.split(frame)
    del segments[0]
    return segments


def _ancestor(model: _Model, levels: int) -> _Model:
    """The model some levels up; the root when there are not that many."""
    for _ in range(levels):
        if model.parent is None:
            break
        model = model.parent
    return model


_ENTITIES = {"&lt;": "<", "&gt;": ">", "&apos;": "'", "&quot;": '"', "&amp;": "&"}
"""`&amp;` last: `&amp;lt;` is the text `&lt;`, not `<`."""


def _words(raw: bytes) -> str:
    text = raw.decode("utf-8", "replace")
    for entity, character in _ENTITIES.items() if "&" in text else ():
        text = text.replace(entity, character)
    return text


class GazeboStateReader:
    """Reads positions of bodies from `state.log`.

    Times are simulated time. Positions are those of the models' and links' origins in
    the world frame; models have 3 significant digits in the real files, links 4.
    Recording pauses while nothing moves, which leaves gaps between frames.

    Reads:
        The position of every model and link that the log map names, frame by frame.
    Refuses:
        A log without one whole frame, and one with a corrupt chunk. A log that was cut off
        is read up to the cut, which the result notes.
    Source:
        Gazebo classic 7 to 11, `physics/WorldState` and `util/LogRecord`; ARIAC notes on
        log formats, section 4.
    """

    facts = ReaderFacts(formats="Gazebo state.log")

    def can_read(self, path: Path) -> bool:
        """Whether the file begins like a Gazebo log, or is an empty `state.log`."""
        try:
            if not path.is_file():
                return False
            with path.open("rb") as file:
                head = file.read(1024)
        except OSError:
            return False
        return b"<gazebo_log" in head if head else path.name == "state.log"

    def describe(self, path: Path) -> LogDescription:
        """The models the log shows, and how many states, models and links it has."""
        scan = _Scan(path, lambda _entity: False)
        damage = ""
        try:
            scan.run(None)
        except LogError as error:
            damage = str(error)
        states = scan.states()
        t_s = states.t_s
        return LogDescription(
            format="Gazebo state log",
            topics=tuple(
                _described(name, t_s[states.listed[name]])
                for name in states.models
                if len(states.listed[name])
            ),
            clock=str(CLOCK),
            facts={
                "states": len(t_s),
                "models": len(states.models),
                "links": len(states.links),
                "gazebo_version": states.gazebo_version,
            },
            defects=_placed(states.defects, path),
            damage=damage,
            duration_s=float(t_s.max() - t_s.min()) if len(t_s) else 0.0,
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """Bodies, and where they are in each frame when positions are wanted.

        Raises:
            NothingToScoreError: The file is missing or empty.
            LogError: A complete chunk is corrupt, there is not one whole frame, or
                time runs back so far that the file holds two recordings.
        """
        wanted.log_map.refuse_unfilled()
        models, reader = wanted.log_map.models, wanted.tracks
        positions = "position" in wanted.quantities

        def of_tracks(entity: Entity) -> bool:
            return reader is not None and reader.follows(entity.scoped)

        states = read_states(
            path,
            lambda entity: of_tracks(entity) or (positions and _is_followed(entity, models)),
            progress=wanted.progress,
        )
        builder = TrialBuilder(path.stem, file=path, clock=CLOCK)
        if not states.cut_off:
            builder.witnessed.add("bodies")  # the lost part might have shown others
        for defect in _placed(states.defects, path):
            builder.defect(defect.kind, defect.where, defect.count, defect.message)
        for key in sorted(states.entities):
            _add_entity(builder, states, states.entities[key], models, positions=positions)
        t_s = states.t_s
        builder.recorded = Span(float(t_s.min()), float(t_s.max()))
        if states.cut_off and wanted.partial:
            error = CutOffError(states.cut_off, file=path)
            back_s = float((np.maximum.accumulate(t_s) - t_s).max())
            builder.cut = cut_at(error, path.name, builder.recorded.end_s, largest_step_back_s=back_s)
        if reader is not None:
            tracks = [
                _track(states, entity) for _, entity in sorted(states.entities.items()) if of_tracks(entity)
            ]
            until_s = float(t_s.max()) if states.cut_off else math.inf
            builder.records.append(reader.record(t_s, tracks, pauses=True, until_s=until_s))
        return builder.build()


def _described(name: str, t_s: FloatArray) -> TopicDescription:
    gap = float(np.diff(t_s).max()) if len(t_s) > 1 else None
    return TopicDescription(name, "model", len(t_s), float(t_s[0]), float(t_s[-1]), gap)


def _placed(defects: tuple[LogDefect, ...], path: Path) -> tuple[LogDefect, ...]:
    return tuple(LogDefect(d.kind, path.name, d.count, d.message) for d in defects)


def _match(entity: Entity, models: tuple[BodyMatch, ...]) -> tuple[BodyMatch, Body] | None:
    """The first body of the log map that an entity's top-level model stands for."""
    for match in models:
        body = match.body_for(entity.top)
        if body is not None:
            return match, body
    return None


def _is_followed(entity: Entity, models: tuple[BodyMatch, ...]) -> bool:
    found = _match(entity, models)
    if found is None:
        return False
    return found[0].follows_link(entity.link) if entity.link else entity.model == entity.top


def _track(states: GazeboStates, entity: Entity) -> ModelTrack:
    frames, poses = states.poses[entity.key]
    deleted = [states.deleted[name] for name in sorted({entity.top, entity.model}) if name in states.deleted]
    gone: IntArray = np.unique(np.concatenate(deleted)) if deleted else np.zeros(0, dtype=np.int64)
    return ModelTrack(entity.scoped, frames, poses, gone)


def _add_entity(
    builder: TrialBuilder,
    states: GazeboStates,
    entity: Entity,
    models: tuple[BodyMatch, ...],
    *,
    positions: bool,
) -> None:
    found = _match(entity, models)
    if found is None or not _is_followed(entity, models):
        return
    body = found[1]
    links = (entity.link,) if entity.link else ()
    builder.add_body(Body(body.id, body.kind, body.radius_m, links))
    if entity.key in states.poses and positions:
        frames, poses = states.pose_in_each_frame(entity.key)
        if not len(frames):
            return
        last_of_stamp = np.append(np.diff(states.t_ns[frames]) != 0, True)
        name = f"position/{body.id}::{entity.link}" if entity.link else f"position/{body.id}"
        t, places = states.t_s[frames][last_of_stamp], poses[last_of_stamp, :3]
        builder.add_signal(name, "m", t, places, source="Gazebo poses")
