"""From recorded messages to signals, poses, orders and events, as the log map defines them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ariac_score.checks.contracts import Wanted
from ariac_score.logs.columnar.message_buffer import Pending, Waiting
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.types import Decode, UnknownTypeError, decoder_for
from ariac_score.logs.containers.items import Batch, Connection, IntArray, Message
from ariac_score.logs.gather.body_links import add_unrecorded_links
from ariac_score.logs.gather.clock_witnesses import WITNESSES, ClockWitnesses
from ariac_score.logs.gather.clocks import Clocks, TrialClock
from ariac_score.logs.gather.collected_columns import (
    Decoded,
    PoseBatch,
    by_header,
    clock_key,
    columns_for,
)
from ariac_score.logs.gather.frame_publishers import FramePublishers
from ariac_score.logs.gather.intake import Intake, MessageRoute, Ticks
from ariac_score.logs.gather.model_frames import ModelFrames
from ariac_score.logs.gather.model_states import ModelPoses
from ariac_score.logs.gather.numbering import Numbering, note_contested
from ariac_score.logs.gather.position_frames import PositionFrames, refuse_unknown_root
from ariac_score.logs.gather.repeats import changed
from ariac_score.logs.gather.transforms import TransformTree, row_of, times_s
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch, Channel
from ariac_score.trial.model import Body
from ariac_score.trial.spans import Span
from ariac_score.trial.vocabulary import subject_of

__all__ = ["Collector"]


class Collector:
    """Takes the items of a scan and keeps what is wanted of them.

    Messages are buffered and decoded many at a time. The outcome is the same as if each were
    decoded on arrival: where several topics feed one signal, the recorded order is restored,
    and of several errors the first is raised.

    Args:
        wanted: What the log map and the checks need.
        file: The recording, for error messages.
        stamped_by_reader: Whether the reader gives all messages their times, so that a message's own stamp
            counts only where the log map asks for it.
    """

    def __init__(self, wanted: Wanted, file: Path, *, stamped_by_reader: bool = False) -> None:
        self._wanted, self._file = wanted, file
        self._clocks, self._stamped_by_reader = Clocks(file), stamped_by_reader
        log_map = wanted.log_map
        log_map.refuse_unfilled()
        self._tree = TransformTree(log_map.root_frame, file=file)
        self._models = ModelPoses(log_map.models)
        # Links before models: models inside models are listed as links only.
        tracks = wanted.tracks
        self._frames = {links: ModelFrames(tracks) for links in (True, False)} if tracks else {}
        channels = [self._stamped(channel) for channel in log_map.channels_for(wanted.quantities)]
        self._intakes = [Intake(channel, wanted) for channel in channels]
        self._ticks = Ticks(self._clocks) if any(c.stamp != "log" for c in channels) else None
        self._witnesses = ClockWitnesses()
        self._routes: dict[Connection, MessageRoute] = {}
        self._pending = Pending()
        self._numbering, self._frame_publishers = Numbering(), FramePublishers()
        self._number = 0
        self._others: set[str] = set()
        self.share = 0.0

    def _stamped(self, channel: Channel) -> Channel:
        if self._stamped_by_reader and not channel.stamp:
            return replace(channel, stamp="log")
        return channel

    @property
    def topics(self) -> frozenset[str]:
        """The topics it takes messages of, with and without leading slash."""
        names = {intake.channel.topic.lstrip("/") for intake in self._everyone()}
        if self._ticks:
            names |= {name.lstrip("/") for name in WITNESSES}
        return frozenset(name for plain in names for name in (plain, f"/{plain}"))

    @property
    def unseen_losses(self) -> bool:
        """Whether it takes messages of a source that loses some and says nothing of it."""
        return not all(connection.sees_losses for connection in self._routes)

    def _everyone(self) -> list[Intake]:
        return [*self._intakes, self._ticks] if self._ticks else self._intakes

    def take(self, item: Connection | Message | Batch) -> None:
        """Take one item of a scan, in recorded order."""
        if isinstance(item, Connection):
            self._connect(item)
            return
        if isinstance(item, Batch):
            self._take_many(item)
            return
        if (seen := self._witnesses.of_message(item)) is not None:
            self._clocks.witness(*seen)
        self._number += 1  # of all messages, so that order across topics can be restored
        if item.connection in self._routes:
            if item.sequence:
                self._numbering.take(item.connection, np.array([self._number]), np.array([item.sequence]))
            self._pending.add(item, self._number)
            if self._pending.full:
                self.flush()

    def _take_many(self, batch: Batch) -> None:
        first = self._number + 1
        self._number += len(batch)
        for seen in self._witnesses.of_batch(batch):
            self._clocks.witness(*seen)
        if batch.sequences is not None and batch.sequences.any():
            self._take_sequences(batch, batch.sequences, first)
        for waiting in self._pending.take(batch, self._routes, first):
            self._decode_waiting(waiting)

    def _take_sequences(self, batch: Batch, sequences: IntArray, first: int) -> None:
        self._numbering.count_across(batch.sources, sequences)
        for place, connection in enumerate(batch.connections):
            if connection in self._routes:
                rows = np.flatnonzero(batch.sources == place)
                self._numbering.take(connection, rows + first, sequences[rows])

    def _connect(self, connection: Connection) -> None:
        intakes = [intake for intake in self._everyone() if intake.accepts(connection)]
        if not intakes:
            self._others.add(f"/{connection.topic.lstrip('/')}")
            for intake in self._everyone():
                if intake.is_on(connection):
                    intake.foreign[connection.type] = None
            if self._ticks:
                self._witnesses.connect(connection)
            return
        alone = ""
        try:
            try:
                columns = columns_for(connection, [i.needs for i in intakes])
            except PlanError as error:
                columns, alone = None, str(error)
            # Columns need no code generated by rosbags, which takes longer than to decode most topics.
            decode = decoder_for(connection) if columns is None else _when_needed(connection)
        except UnknownTypeError as error:
            for intake in intakes:
                intake.untyped[connection.type] = str(error)
            return
        self._routes[connection] = MessageRoute(intakes, decode, columns, connection.topic, alone)

    def flush(self) -> None:
        """Decode what is buffered."""
        self._decode_waiting(self._pending.empty())

    def _decode_waiting(self, waiting: Mapping[Connection, Waiting]) -> None:
        waiting = {c: messages for c, messages in waiting.items() if not self._took_changes(c, messages)}
        alone = self._one_by_one(waiting)
        together = PoseBatch()
        for connection, messages in waiting.items():
            if connection not in alone:
                self._decode_columns(connection, messages, together)
        self._decode_each({connection: waiting[connection] for connection in alone})
        for intake in self._intakes:
            intake.settle_columns()
        # At the end: poses from several connections are first put into recorded order.
        together.hand_over(self._tree, self._models, self._frames, share=self.share)

    def _one_by_one(self, waiting: Iterable[Connection]) -> list[Connection]:
        """The connections whose messages must be decoded one by one.

        One such connection takes along all that share a target with it, or their messages
        would reach that target out of order.
        """
        alone = {c for c in waiting if self._routes[c].columns is None}
        targets: set[object] = set()
        before = -1
        while len(alone) != before:  # until no further connection is drawn in
            before = len(alone)
            targets.update(target for c in alone for target in self._routes[c].targets())
            alone |= {c for c in waiting if not targets.isdisjoint(self._routes[c].targets())}
        return [c for c in waiting if c in alone]

    def _took_changes(self, connection: Connection, messages: Waiting) -> bool:
        """Take the changes of a topic of which nothing else matters; whether it is one."""
        route = self._routes[connection]
        if not all(intake.only_changes for intake in route.intakes):
            return False
        stamps_ns, places = messages.stamps_ns, changed(messages).tolist()
        try:
            decoded = [route.decode(messages.payloads.one(i)) for i in places]
        except UnknownTypeError:
            return False
        if any(hasattr(message, "header") for message in decoded):
            return False  # stamps of its own are looked at one by one
        for intake in route.intakes:
            key = clock_key(intake.channel)
            self._clocks.without_header(key, len(stamps_ns), declared=intake.channel.stamp == "log")
            sequences = self._numbering.of(connection, messages.numbers)
            intake.sent.take(connection, messages.numbers, stamps_ns, sequences)
            intake.received += len(stamps_ns)
            for message, stamp_ns in zip(decoded, stamps_ns[places].tolist(), strict=True):
                intake.take(message, connection.type, stamp_ns)
        return True

    def _decode_columns(self, connection: Connection, messages: Waiting, together: PoseBatch) -> None:
        route = self._routes[connection]
        assert route.columns is not None
        decoded = Decoded.of(route.columns, messages)
        for intake in route.intakes:
            poses = intake.channel.poses
            stamps_ns = decoded.stamps_ns(intake.channel, self._clocks)
            refused: dict[int, str] = {}
            sent = decoded.sequence_numbers, stamps_ns
            if poses == "frames":
                static = intake.channel.topic.endswith("tf_static")
                sent = decoded.first_of_each(stamps_ns)
                if static:
                    self._frame_publishers.take_static(
                        connection, *decoded.frames, decoded.transforms, stamps_ns
                    )
                else:
                    self._frame_publishers.take(connection, *decoded.frames, stamps_ns)
                together.add_frames(decoded, stamps_ns, static=static)
            elif poses == "models":
                refused = together.add_models(
                    decoded, stamps_ns, links=connection.type.endswith("LinkStates")
                )
            else:
                intake.take_columns(decoded, stamps_ns)
            intake.frame_ids |= decoded.frame_ids
            sequences = decoded.sequences
            if sequences is None:
                sequences = self._numbering.of(connection, sent[0])
            intake.sent.take(connection, *sent, sequences)
            intake.received += len(decoded.sequence_numbers) - len(refused)
            intake.refused |= decoded.refused | refused

    def _decode_each(self, waiting: Mapping[Connection, Waiting]) -> None:
        rows = sorted(
            (number, i, place)
            for place, messages in enumerate(waiting.values())
            for i, number in enumerate(messages.numbers.tolist())
        )
        connections = list(waiting)
        for number, i, place in rows:
            connection = connections[place]
            messages, route = waiting[connection], self._routes[connection]
            message = Message(connection, int(messages.stamps_ns[i]), messages.payloads.one(i))
            self._decode(message, number, route)

    def _decode(self, item: Message, number: int, route: MessageRoute) -> None:
        try:
            message = route.decode(item.payload)
        except UnknownTypeError as error:
            for intake in route.intakes:
                intake.refused[number] = str(error)
            return
        for intake in route.intakes:
            try:
                self._hand_over(item, number, message, intake)
                intake.received += 1
            except (AttributeError, TypeError) as error:
                # The recording's type has the expected name but other fields.
                intake.refused[number] = str(error)

    def _hand_over(self, item: Message, number: int, message: object, intake: Intake) -> None:
        channel = intake.channel
        if channel.poses == "frames":
            static = channel.topic.endswith("tf_static")
            for transform in message.transforms:  # type: ignore[attr-defined]  # rosbags makes the class
                stamp_ns = item.stamp_ns if static else self._stamp_ns(item, number, transform, channel)
                self._tree.add(transform, stamp_ns, static=static)
                names = transform.header.frame_id, transform.child_frame_id
                if static:
                    row = row_of(transform)
                    self._frame_publishers.take_one_static(item.connection, *names, row, stamp_ns)
                else:
                    self._frame_publishers.take_one(item.connection, *names, stamp_ns)
            self._sent(item, number, message, intake, item.stamp_ns)
            return
        stamp_ns = self._stamp_ns(item, number, message, channel)
        self._sent(item, number, message, intake, stamp_ns)
        if channel.poses == "models":
            links = item.connection.type.endswith("LinkStates")
            self._models.add(message, stamp_ns, links=links)
            if self._frames:
                self._frames[links].add(message, stamp_ns)
            return
        intake.take(message, item.connection.type, stamp_ns)

    def _sent(self, item: Message, number: int, message: object, intake: Intake, stamp_ns: int) -> None:
        """Take note of who sent a message, and of how it numbered it."""
        numbers, stamps_ns = np.array([number]), np.array([stamp_ns])
        frame_id = getattr(getattr(message, "header", None), "frame_id", None)
        if isinstance(frame_id, str) and intake.places:
            intake.frame_ids.add(frame_id)
        sequence = getattr(getattr(message, "header", None), "seq", None)
        if isinstance(sequence, int | np.integer):
            intake.sent.take(item.connection, numbers, stamps_ns, np.array([int(sequence)]))
        else:
            sequences = self._numbering.of(item.connection, numbers)
            intake.sent.take(item.connection, numbers, stamps_ns, sequences)

    def _stamp_ns(self, item: Message, number: int, message: object, channel: Channel) -> int:
        """The stamp that counts: the message's own, or that of the recorder."""
        if not by_header(channel):
            self._clocks.without_header(clock_key(channel), 1, declared=channel.stamp == "log")
            return item.stamp_ns
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        sec, nanosec = getattr(stamp, "sec", None), getattr(stamp, "nanosec", None)
        if not isinstance(sec, int | np.integer) or not isinstance(nanosec, int | np.integer):
            if channel.stamp == "header":
                raise TypeError("its header has no stamp")
            self._clocks.without_header(clock_key(channel), 1)
            return item.stamp_ns
        header_ns = int(sec) * 10**9 + int(nanosec)
        return self._clocks.stamp_ns(clock_key(channel), number, header_ns, item.stamp_ns)

    def clock(self, first_ns: int, last_ns: int) -> TrialClock:
        """The clock of the trial, after the last message.

        Args:
            first_ns: The earliest log time of the recording.
            last_ns: The latest.

        Raises:
            LogError: Stamps are from clocks that nothing relates to each other.
        """
        self.flush()
        self._clocks.settle()
        return self._clocks.trial_clock(first_ns, last_ns)

    def settle(self, builder: TrialBuilder, origin_ns: int) -> None:
        """Hand everything to the builder, in trial time.

        Args:
            builder: Of the trial.
            origin_ns: Trial time 0 on the clock of the trial, ns.

        Raises:
            LogError: A signal is recorded twice or its time runs backwards; frames contradict each other;
                stamps are from clocks that nothing relates to each other.
        """
        self.flush()
        # Before anything is handed over: one topic on two clocks refuses the whole recording.
        self._clocks.settle()
        self._clocks.note(builder)
        if self._clocks.simulated:
            self._retime()
        for route in self._routes.values():
            if route.slow:
                cause = f"its messages were decoded one by one, which is slower: {route.slow}"
                builder.defect("decoded_one_by_one", route.topic, 1, cause)
        self._find_frames()
        received: set[str] = set()
        numbered = not self._numbering.of_recorder
        for intake in self._intakes:
            intake.by_arrival = self._clocks.by_arrival(clock_key(intake.channel))
            intake.settle(builder, origin_ns, self._wanted, numbered=numbered)
            if intake.received:
                received |= intake.channel.bodies
        # Several channels may offer one topic with different types; only one of them can be recorded.
        taken = {i.channel.topic for i in self._intakes if i.recorded}
        due: set[str] = set()
        for intake in self._intakes:
            if intake.recorded or intake.channel.topic not in taken:
                builder.unrecorded.extend(intake.unrecorded(self._others))
                due |= set() if intake.channel.optional else intake.channel.bodies
                builder.due.update(intake.due())
        builder.published_kinds = self._wanted.log_map.published_kinds
        for body in self._wanted.log_map.bodies:
            if body.id in received:
                builder.add_body(body)
        self._settle_frames(builder, origin_ns)
        if "position" in self._wanted.quantities:
            of_models = [intake.unknown for intake in self._intakes if intake.channel.poses == "models"]
            self._models.settle(builder, origin_ns, of_models)
        self._add_unrecorded_bodies(builder, due)
        self._add_unmatched(builder, (*self._tree.unmatched, *self._models.unmatched))
        add_unrecorded_links(builder, self._tree.matched, self._tree.names(), of_each=False)
        add_unrecorded_links(builder, self._models.matched, self._models.link_names(), of_each=True)
        records = (frames.record(origin_ns) for frames in self._frames.values())
        builder.records.extend(record for record in records if record is not None)

    def _find_frames(self) -> None:
        """Find whose positions are to be transformed into the root frame, where they are in several.

        Raises:
            LogError: They are, and recorded transforms do not lead from all of them to the root.
        """
        if not self._position_frames().several:
            return
        root = self._wanted.log_map.root_frame.lstrip("/")
        if self._tree.places_any(self._wanted.log_map.frames):
            refuse_unknown_root(root, self._tree.names(), file=self._file)
        for intake in self._intakes:
            others = {frame.lstrip("/") for frame in intake.frame_ids} - {""}
            if len(others) == 1 and root not in others and self._tree.leads_to_root(*others):
                (intake.elsewhere,) = others
        self._position_frames().refuse_several()

    def _position_frames(self) -> PositionFrames:
        log_map = self._wanted.log_map
        frames = PositionFrames(self._file, log_map.root_frame)
        for intake in self._intakes:
            for frame in sorted(intake.frame_ids):
                there = log_map.root_frame if intake.elsewhere else frame
                frames.take(there, f"topic {intake.channel.topic}")
        if self._tree.places_any(log_map.frames):
            frames.take(log_map.root_frame, "tf")
        if self._models.places_any:
            frames.take("world", "Gazebo")
        return frames

    def _add_unmatched(self, builder: TrialBuilder, unmatched: Iterable[BodyMatch]) -> None:
        """Add the bodies that a pattern names and nothing recorded matches, where others of the kind are."""
        kinds = {body.kind for body in builder.bodies.values()}
        for match in unmatched:
            name = match.body or match.match
            if match.kind in kinds and name not in builder.bodies and not set("*?[") & set(name):
                builder.add_body(Body(name.replace("/", "_"), match.kind, match.radius_m))

    def _settle_frames(self, builder: TrialBuilder, origin_ns: int) -> None:
        if not any(intake.channel.poses == "frames" and intake.received for intake in self._intakes):
            return
        contested: dict[str, list[Span]] = {}
        for frame, stretch in self._frame_publishers.contested():
            ends_ns = np.array([stretch.first_ns, stretch.last_ns])
            if self._clocks.simulated:
                ends_ns = self._clocks.on_trial_clock("/tf", ends_ns)
            start_s, end_s = times_s(ends_ns, origin_ns).tolist()
            contested.setdefault(frame, []).append(Span(start_s, end_s))
            note_contested(builder, f"frame {frame}", stretch, contested[frame][-1])
        if builder.recorded is not None:
            for frame, stretch in self._frame_publishers.contested_static():
                contested.setdefault(frame, []).append(builder.recorded)
                note_contested(builder, f"frame {frame}", stretch, builder.recorded)
        holes = [
            hole
            for intake in self._intakes
            if intake.channel.poses == "frames" and not intake.channel.topic.endswith("tf_static")
            for hole in intake.unknown.holes
        ]
        self._tree.settle(builder, origin_ns, self._wanted.log_map.frames, holes=holes, contested=contested)
        for intake in self._intakes:
            if intake.elsewhere:
                intake.settle_transformed(builder, origin_ns, self._tree)

    def _add_unrecorded_bodies(self, builder: TrialBuilder, due: Set[str]) -> None:
        """Add the bodies that lack: where others of their kind were, or at a stated rate."""
        # A monitor misses only the signals of bodies it knows of: without these, it would find nothing wrong
        # with the others. Where none of a kind was recorded, it already finds that nobody is there, but not
        # how often a limit of theirs may have been broken.
        kinds = {body.kind for body in builder.bodies.values()}
        stated = {part for name in builder.due for part in subject_of(name).split("/")}
        for body in self._wanted.log_map.bodies:
            known = body.kind in kinds or body.id in stated
            if body.id in due and body.id not in builder.bodies and known:
                builder.add_body(body)

    def _retime(self) -> None:
        """Put all kept stamps on the clock of the trial."""
        self._tree.retime(partial(self._clocks.on_trial_clock, "/tf"), self._clocks.of_log)
        of_models = partial(self._clocks.on_trial_clock, "poses of models")
        self._models.retime(of_models)
        for frames in self._frames.values():
            frames.retime(of_models)
        for intake in self._intakes:
            intake.retime(partial(self._clocks.on_trial_clock, clock_key(intake.channel)))


def _when_needed(connection: Connection) -> Decode:
    def decode(payload: bytes | memoryview) -> object:
        return decoder_for(connection)(payload)  # definitions it has compiled are cached

    return decode
