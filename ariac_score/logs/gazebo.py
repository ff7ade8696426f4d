"""Reading `state.log`, the motion record of Gazebo classic, as a trial."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ariac_score.checks.contracts import LogDescription, ReaderFacts, TopicDescription, Wanted
from ariac_score.errors import CutOffError, LogError
from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.gather.body_links import add_unrecorded_links
from ariac_score.logs.gazebo_models import Entity
from ariac_score.logs.gazebo_states import GazeboStates, Scan, read_states
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch
from ariac_score.trial.clock import SIMULATED_TIME, Clock
from ariac_score.trial.cut import cut_at
from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.tracks import ModelTrack

__all__ = ["GazeboStateReader"]

CLOCK = Clock(SIMULATED_TIME)


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
        scan = Scan(path, lambda _entity: False)
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
        found = {
            match for one in states.entities.values() if (both := _match(one, models)) for match in both[:1]
        }
        recorded = {one.link for one in states.entities.values() if one.link}
        add_unrecorded_links(builder, [match for match in models if match in found], recorded, of_each=True)
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
        rate_hz = found[0].rate_hz
        builder.add_signal(name, "m", t, places, source="Gazebo poses", stated_rate_hz=rate_hz)
