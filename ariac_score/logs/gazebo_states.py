"""All frames of a `state.log`, read as a stream.

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

import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from operator import ne
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.gazebo_models import (
    ANY_MODEL,
    MODEL_AS_WRITTEN,
    Column,
    Entity,
    Model,
    ancestor,
    texts_of_models,
    unescaped,
)
from ariac_score.logs.gazebo_text import CorruptError, Tape, frames, text, without_cdata
from ariac_score.trial.model import LogDefect
from ariac_score.trial.spans import FloatArray

__all__ = ["GazeboStates", "Scan", "read_states"]

_END_OF_LOG = b"</gazebo_log>"
_ENCODING = re.compile(rb"""^\s+encoding\s*=\s*(['"])(\w+)\1\s*>$""")
_VERSION = re.compile(rb"<gazebo_version>([^<]{0,200})</gazebo_version>")
# At most 30 digits: `int` refuses very long numbers with an error of its own.
_SIM_TIME = re.compile(rb"<sim_time>\s*(\d{1,30})\s+(\d{1,30})\s*</sim_time>")
_DELETIONS = re.compile(rb"<deletions>|</deletions>")
_END_OF_MODEL = b"</model>"
_NAME = re.compile(rb"<name>([^<]*)</name>")
_POSE = re.compile(
    rb"""(?:<link\s+name\s*=\s*(?:'(?P<link>[^'<\n]*)'|"(?P<also>[^"<\n]*)")[^<>]*>\s*)?"""
    rb"""<pose[^<>]*>(?P<numbers>[^<]*)</pose>"""
)
_NUMBERS = re.compile(rb"<pose[^<>]*>([^<]*)</pose>")
"""Finds the same numbers as `_POSE`, in the same order, without looking for whose they are."""


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
    scan = Scan(path, wanted)
    scan.run(progress)
    return scan.states()


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


class Scan:
    """One pass over one file; keeps what was read even when the pass ends in an error."""

    def __init__(self, path: Path, wanted: Callable[[Entity], bool] | None) -> None:
        self.path, self.wanted = path, wanted
        self.version, self.cut_off = "", ""
        self.chunk = 0
        self.t_ns: array[int] = array("q")
        # The models of the previous frame in order, the frame from which on they are listed, and their texts.
        self.listed: list[Model] = []
        self.since = 0
        self.segments: list[bytes] = []
        # All poses in the order of their frames, and those of the current frame that are still text.
        self.numbers: array[float] = array("d")
        self.poses = 0
        self.fresh: list[bytes] = []
        self.fresh_of: list[Column] = []
        self.root = Model("", "", None)
        self.models: dict[str, Model] = {}
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
        shown: dict[Column, list[tuple[IntArray, IntArray]]] = {}
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
        head, *segments = frame.split(MODEL_AS_WRITTEN)
        changed = None if ANY_MODEL in head else self._changed(segments)
        if changed is None:
            # Other models than before, or other text before their names: look at all of the frame.
            segments = texts_of_models(frame)
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
                or ANY_MODEL in segment
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
            here = ancestor(model, model.ends)

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
                    self.deleted.setdefault(unescaped(name[1].strip()), []).append(index)
            begin = -1

    def _child(self, parent: Model, segment: bytes) -> Model:
        quote = segment[:1]
        end = segment.find(quote, 1)
        if quote not in (b"'", b'"') or end < 0:
            raise CorruptError(f"frame {len(self.t_ns)} holds a model without a quoted name")
        raw = segment[1:end]
        model = parent.children.get(raw)
        if model is None:
            name = unescaped(raw)
            # Several models may contain one of the same name, such as a wheel on each cart.
            key = name if name not in self.models else f"{parent.key}::{name}"
            if key in self.models:
                raise CorruptError(f"two models are called {key!r}")
            model = parent.children[raw] = self.models[key] = Model(name, key, parent)
            model.quoted = segment[: end + 1]
        return model

    def _parse(self, model: Model, segment: bytes, parts: Sequence[bytes], index: int) -> None:
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

    def _learn(self, model: Model, segment: bytes) -> None:
        """Find out which entities the poses in the text of a model belong to.

        The text runs from the model's name to the next model's: its own poses, then
        after each `</model>` those that an ancestor lists behind it.
        """
        own, *after = segment.split(_END_OF_MODEL)
        whose = self._whose(model, own, links_only=False)
        above: Model | None = model
        for piece in after:
            above = above.parent if above is not None else None
            if above is not None and above is not self.root and b"<link" in piece:
                whose += self._whose(above, piece, links_only=True)
            else:
                whose += [None] * len(_NUMBERS.findall(piece))
        model.ends, model.chosen = len(after), [column is not None for column in whose]
        model.whose = [column for column in whose if column is not None]

    def _whose(self, model: Model, text: bytes, *, links_only: bool) -> list[Column | None]:
        """The columns of the poses in some text, in order; `None` for poses that are not converted."""
        own_expected = not links_only
        found: list[Column | None] = []
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

    def _column(self, model: Model, written: bytes | None) -> Column:
        """The column of a link, by its name as written, or of the model itself."""
        link = "" if written is None else unescaped(written)
        column = model.columns.get(link)
        if column is None:
            entity = Entity(model.top, model.key, link)
            converted = self.wanted is None or self.wanted(entity)
            column = model.columns[link] = Column(entity, converted)
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
