"""What the AI for Industry Challenge knows of its runs: which trial it is, and what its scorer took."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, TypeVar

from ariac_score import (
    Fact,
    Item,
    LogDefect,
    LogError,
    Record,
    Span,
    Trial,
    check_parameters,
    did_you_mean,
    parameter,
)
from ariac_score_aic.consumption import Consumed, Consumption
from ariac_score_aic.finals import insertions_of
from ariac_score_aic.messages import CONTACTS, CONTROLLER, EVENT, SCORING_TF, TF, AicMessages
from ariac_score_aic.run_config import PlannedTrial, RunConfig
from ariac_score_aic.scoring_file import OfficialRun, official_of, times_from
from ariac_score_aic.signals import NO_HUMAN, with_signals
from ariac_score_aic.task_times import TaskTimes, TimesOfRun
from ariac_score_aic.time_bounds import times_of_log

__all__ = ["Aic", "trial_in_name"]

_BAG = re.compile(r"bag_(?P<trial>.+)_\d{8}_\d{6}_\d{1,6}")
_STAMP = re.compile(r"_\d{8}_\d{6}(_\d{1,6})?")
_Kept = TypeVar("_Kept", bound=Record)
_DEFAULT_LIMIT_S = 180.0


@dataclass(frozen=True)
class Aic:
    """The AI for Industry Challenge 2026, in one state of its scorer.

    Attributes:
        gripper_frame: The frame whose path is measured; a parameter of the engine.
        reference_frame: The frame that plugs and ports are measured in.
        tool_reference_frame: The frame that the path of the gripper is measured in.
        board: Whether frames of the task board hold at all times whatever topic they came on.
        poses: When poses of the gripper are asked for.
        end_distance: At which time the plug's place counts.
        start_distance: At which time the first distance is taken: the start of the task, or the first stamp.
        wrench_topic: Where the forces are.
        tare: Whether the offset that the controller states is taken from them.
        scoring_static: Whether `/scoring/tf_static` is heard.
        ends: Which layout of names and topics there is: one plug, both ends of a cable (phase 1), or the
            cables of a recording of the finals.

    Source:
        `aic_scoring/src/ScoringTier2.cc` of intrinsic-dev/aic, and its history.
    """

    gripper_frame: str = parameter("gripper/tcp", source="aic_engine.cpp, line 309")
    reference_frame: str = parameter("aic_world", source="ScoringTier2.cc")
    tool_reference_frame: str = parameter("aic_world", source="ScoringTier2.cc; 'root' since PR 552")
    board: Literal["static", "as_sent"] = parameter("static", source="PR 405")
    poses: Literal["while_reading", "at_every_stamp"] = parameter("while_reading", source="PR 334")
    end_distance: Literal["at_end", "latest"] = parameter("at_end", source="PR 218")
    start_distance: Literal["at_start", "first", "none"] = parameter("at_start", source="PR 307")
    lookups: Literal["right", "reversed"] = parameter("right", source="PR 234")
    wrench_topic: str = parameter("/fts_broadcaster/wrench", source="PR 346")
    tare: bool = parameter(True, source="PR 299")
    scoring_static: bool = parameter(False, source="PR 367")
    ends: Literal["one", "both", "finals"] = parameter("one", source="PR 552; batch_score_bags.py")

    levels: ClassVar[tuple[str, ...]] = ("connection", "task", "trial")
    facts: ClassVar[Mapping[str, Mapping[str, object]]] = {
        "connection": {
            "cable_name": {"type": "text", "meaning": "the cable"},
            "plug_name": {"type": "text", "meaning": "the plug"},
            "target_module_name": {"type": "text", "meaning": "the module it belongs into"},
            "port_name": {"type": "text", "meaning": "the port of that module"},
        },
        "task": {
            "time_limit_s": {"type": "number", "unit": "s", "meaning": "in which the task is to be done"},
            "time_s": {"type": "number", "unit": "s", "meaning": "from start to end; absent: not completed"},
        },
    }
    words: ClassVar[Mapping[str, tuple[str, str]]] = {
        "connection": ("connection", "connections"),
        "task": ("task", "tasks"),
        "trial": ("trial", "trials"),
    }

    def __post_init__(self) -> None:
        check_parameters(self)

    @property
    def usual_items(self) -> int:
        """The connections of a task: one plug, or both ends of a cable."""
        return 1 if self.ends == "one" else 2

    @property
    def consumption(self) -> Consumption:
        """How its scorer takes what is recorded."""
        return Consumption(
            self.gripper_frame,
            self.reference_frame,
            self.tool_reference_frame,
            self.board == "static",
            self.poses == "while_reading",
            self.end_distance == "at_end",
            self.start_distance,
            self.lookups == "reversed",
            self.wrench_topic,
            self.tare,
            self.scoring_static,
            self.ends == "both",
        )

    def complete(self, trial: Trial) -> Trial:
        """The trial with its task, its times and what the scorer took of the recording.

        Raises:
            LogError: The configuration or the result beside the recording is of another run.
        """
        messages = _one(trial, AicMessages)
        config = None if self.ends == "finals" else _one(trial, RunConfig)
        official, stated = _one(trial, OfficialRun), _one(trial, TimesOfRun)
        planned = _planned(messages, config)
        name = planned.id if planned else _named(messages, official, stated)
        times, notes = _times(name, official, stated)
        if messages is not None:
            if times.completed is None:
                logged = times_of_log(messages)
                times = (
                    times
                    if logged is None
                    else replace(logged, start_ns=times.start_ns, start_known=times.start_known)
                )
            connections = planned.connections[: 2 if self.ends == "both" else 1] if planned else ()
            limit_s = config.longest_limit_s if config else _DEFAULT_LIMIT_S
            consumed = Consumed(
                messages,
                self.consumption,
                connections,
                times,
                limit_s,
                name,
                by_engine=_BAG.fullmatch(messages.name) is not None,
            )
            trial = with_signals(replace(trial, records=(*trial.records, consumed)), consumed)
            trial = _with_task(trial, consumed)
            if self.ends != "finals":  # in a real cell there may be people whom no topic shows
                trial = replace(trial, witnessed=trial.witnessed | {NO_HUMAN})
        if config is not None and messages is not None:
            notes = (*notes, *_unlisted(config, self.wrench_topic))
        shown = official_of(official, name) if official else None
        if official is not None and shown is None and messages is not None:
            notes = (*notes, _other_run(name, official))
        return replace(
            trial,
            work=trial.work if messages is None else self._work(messages, planned, times),
            official=shown or trial.official,
            log_defects=tuple(sorted({*trial.log_defects, *notes})),
        )

    def _work(
        self, messages: AicMessages, planned: PlannedTrial | None, times: TaskTimes
    ) -> tuple[Item, ...]:
        if self.ends != "finals":
            return (_task(planned, times, both=self.ends == "both"),)
        return tuple(Item(f"cable_{n}", "task") for n in range(1, insertions_of(messages).cables + 1))

    def printed_level(self, name: str) -> str:  # noqa: ARG002  # the engine prints nothing inside a trial
        """The level of a block of an official text; the engine's has none inside a trial."""
        return "task"

    def made_trial(self) -> Trial:
        """A trial for trying checks: one task, inserted."""
        from ariac_score_aic.testing import made_trial  # noqa: PLC0415  # no score needs it

        return made_trial()


def _with_task(trial: Trial, consumed: Consumed) -> Trial:
    """The trial, of which the recording may lack a part of the task, where a file states when that was."""
    messages = consumed.messages
    if messages.recorded_ns is None or trial.recorded is None:
        return trial
    begin_ns, end_ns = consumed.with_task(messages.recorded_ns)
    before_s, after_s = (messages.recorded_ns[0] - begin_ns) / 1e9, (end_ns - messages.recorded_ns[1]) / 1e9
    whole = Span(trial.recorded.start_s - before_s, trial.recorded.end_s + after_s)
    return replace(trial, recorded=whole)


def trial_in_name(name: str) -> str:
    """The trial that a recording of the engine is of, by its name; the name where it is none of the engine's.

    >>> trial_in_name("bag_trial_1_20260514_191811_949"), trial_in_name("mine")
    ('trial_1', 'mine')
    """
    named = _BAG.fullmatch(name)
    return named["trial"] if named else name


def _one(trial: Trial, kind: type[_Kept]) -> _Kept | None:
    return next((record for record in trial.records if isinstance(record, kind)), None)


def _planned(messages: AicMessages | None, config: RunConfig | None) -> PlannedTrial | None:
    """The trial of the configuration that a recording is of, by the name that the engine gave to it.

    Raises:
        LogError: The configuration has no such trial.
    """
    if config is None or messages is None:
        return None
    found = [t for t in config.trials if _STAMP.fullmatch(messages.name.removeprefix(f"bag_{t.id}"))]
    if found:
        return max(found, key=lambda trial: len(trial.id))
    named = _BAG.fullmatch(messages.name)
    if named is None and len(config.trials) == 1:
        return config.trials[0]
    meant = named["trial"] if named else messages.name
    known = [trial.id for trial in config.trials]
    raise LogError(
        f"{config.file} has no trial {meant!r}"
        if named
        else f"which trial of {config.file} it is of cannot be seen from the name {messages.name!r}",
        file=messages.name,
        hint=(
            f"{did_you_mean(meant, known, what='its trials')}; give that of the run: --trial-config FILE"
            if named
            else "keep the name that the engine gave, bag_<trial>_<date>_<time>_<ms>"
        ),
    )


def _named(messages: AicMessages | None, official: OfficialRun | None, stated: TimesOfRun | None) -> str:
    """The id of the trial where no configuration says it."""
    if messages is None:
        return official.trials[0].id if official and len(official.trials) == 1 else ""
    ids = {trial.id for trial in official.trials} if official else set()
    ids |= {name for name, _ in stated.trials} if stated else set()
    found = [name for name in ids if messages.name.startswith(f"bag_{name}_")]
    if found:
        return max(found, key=len)
    return trial_in_name(messages.name)


def _times(
    name: str, official: OfficialRun | None, stated: TimesOfRun | None
) -> tuple[TaskTimes, tuple[LogDefect, ...]]:
    """When the task began and ended: as a file of its own states it, else as the official result implies."""
    own = dict(stated.trials).get(name) if stated else None
    trial = official.trial(name) if official else None
    implied = times_from(trial, official.file) if trial and official else None
    if own is None:
        return implied or TaskTimes(), ()
    if implied is None:
        return own, ()
    differs = (
        own.completed is not None and implied.completed is not None and own.completed != implied.completed
    )
    apart_s = (
        abs((own.duration_s or 0) - (implied.duration_s or 0))
        if own.duration_s and implied.duration_s
        else 0.0
    )
    if not differs and apart_s <= (1e-9 if implied.exact else 0.0051):
        return own, ()
    words = f"{own.source} and {implied.source} state different durations or ends of {name}; the first counts"
    return own, (LogDefect("contradicting_times", name, 1, words),)


def _unlisted(config: RunConfig, wrench_topic: str) -> Iterator[LogDefect]:
    """The topics of a score that a configuration leaves out, where it lists any."""
    missing = [
        t for t in (TF, SCORING_TF, CONTROLLER, wrench_topic, CONTACTS, EVENT) if t not in config.topics
    ]
    if config.topics and missing:
        words = f"scoring.topics leaves out {', '.join(missing)}: the engine records and scores none of it"
        yield LogDefect("unlisted_topics", config.file, len(missing), words)


def _other_run(name: str, official: OfficialRun) -> LogDefect:
    known = ", ".join(trial.id for trial in official.trials)
    return LogDefect("other_run", official.file, 1, f"it says nothing of trial {name!r}, but of {known}")


def _task(planned: PlannedTrial | None, times: TaskTimes, *, both: bool) -> Item:
    facts: dict[str, Fact] = {}
    if planned is not None:
        facts["time_limit_s"] = planned.time_limit_s
    if times.not_completed:
        facts["time_s"] = None
    elif times.duration_s is not None:
        facts["time_s"] = times.duration_s
    names = ("end_0", "end_1") if both else ("plug",)
    known = planned.connections if planned else ()
    inside = tuple(
        Item(name, "connection", dict(vars(known[i])) if i < len(known) else {})
        for i, name in enumerate(names)
    )
    return Item(planned.task if planned else "task", "task", facts, inside)
