"""Whether a log is complete: what its recorder attests, what the rules ask for, what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ariac_score.engine.prepared import Prepared
from ariac_score.errors import LogError, RuleSetError
from ariac_score.results.signing import signed_text
from ariac_score.trial.attestation import Attestation, Lacking
from ariac_score.trial.channels import Channel
from ariac_score.trial.events import ORDER_ANNOUNCED
from ariac_score.trial.model import Trial
from ariac_score.trial.statements import NOBODY, RECORDER, Statement

__all__ = ["with_completeness"]

_ATTESTED = "attested"
_NO_MANIFEST = "no recorder's manifest is in it"


def with_completeness(trial: Trial, prepared: Prepared, *, trial_id: str = "", team: str = "") -> Trial:
    """The trial with whether its completeness is attested, and undecided where it is known to lack something.

    Args:
        trial: As recorded.
        prepared: The rules.
        trial_id, team: Whose trial it is to be; empty where nobody says.

    Raises:
        LogError: The rules ask for an attested log, and this is none.
        RuleSetError: The rules ask for one, and name no key that could attest it.
    """
    rules = prepared.rule_set.authority
    asked = rules.completeness == _ATTESTED
    if asked and not rules.recorder_keys:
        raise RuleSetError(
            "'completeness: attested' needs the public key of the organiser's recorder",
            file=prepared.rule_set.file,
            place="$.completeness",
            hint="add 'authority: {recorder_keys: [RW…]}', as minisign writes it into its .pub file",
        )
    if not trial.attestations:  # an official text, or a trial made by hand: there is no log to be complete
        if asked:
            raise LogError(
                "completeness is not attested: there is no log of a recorder", file=trial.id, hint=_RECORD
            )
        return trial
    reasons = {
        file: _reason(found, prepared, trial) or _of_another(found, trial_id, team)
        for file, found in trial.attestations
    }
    lacks = [words for _, found in trial.attestations if found for words in _lacking(found, prepared, trial)]
    for file, reason in reasons.items():
        if asked and reason:
            raise LogError(f"completeness is not attested: {reason}", file=file, hint=_RECORD)
    if asked and lacks:
        raise LogError(f"it is not what its recorder received: {lacks[0]}", file=trial.id, hint=_RECORD)
    open_ = [f"{file}: {reason}" for file, reason in reasons.items() if reason]
    attested = [found for _, found in trial.attestations if found]
    noted = [f"its recorder noted: {note}" for found in attested for note in found.notes]
    rarer = [one for found in attested for one in found.lacking if one.within and not lacks]
    noted += [f"missing, so gaps: {one}" for one in rarer]
    noted += [f"not read: {_unheard(found)}" for found in attested if found.early]
    noted += [f"definitions not attested: {words}" for f in attested if (words := _undefined(f, prepared))]
    noted += [f"recorded as {_named(f.trial, f.team)}" for f in attested if f.trial or f.team]
    statement = (
        Statement("completeness", NOBODY, detail="; ".join(open_ + noted))
        if open_
        else Statement("completeness", RECORDER, tuple(sorted(reasons)), "; ".join(lacks + noted))
    )
    why = trial.window_open or (f"the log is not what its recorder received: {lacks[0]}" if lacks else "")
    unread = _unread(trial, prepared)
    statements = (*(_as_far_as_read(one, unread) for one in trial.statements), statement)
    why = why or next(iter(unread.values()), "")
    return replace(trial, window_open=why, statements=tuple(sorted(statements)))


_UNREAD = frozenset({"undecodable_messages", "unreadable_messages"})
_WORK = frozenset({"submissions", ORDER_ANNOUNCED})


def _unread(trial: Trial, prepared: Prepared) -> dict[str, str]:
    """What nobody can read of what was asked for and of what was handed in, in words, by what it tells.

    What a topic of events may have told is open already: nobody then vouches that it did not happen.
    """
    unread = {one.where for one in trial.log_defects if one.kind in _UNREAD}
    return {
        kind: f"not all messages on {channel.topic} can be read"
        for channel in prepared.log_map.channels
        for kind in sorted(_WORK & set(channel.witnesses))
        if channel.topic in unread
    }


def _as_far_as_read(statement: Statement, unread: Mapping[str, str]) -> Statement:
    """A statement, or that nobody makes it: where no file states the work, it is what was announced."""
    if statement.fact != "work" or statement.by != RECORDER or ORDER_ANNOUNCED not in unread:
        return statement
    return Statement("work", NOBODY, detail=f"{unread[ORDER_ANNOUNCED]}, so more may have been asked for")


_LATE_S = 1.0
"""So late may the first heartbeat be, and so early the last."""
_RECORD = "record with the organiser's recorder running to the end"


def _reason(found: Attestation | None, prepared: Prepared, trial: Trial) -> str:
    """Why a log is not attested; empty where it is."""
    if found is None:
        return _NO_MANIFEST
    if found.problem:
        return found.problem
    if missed := _missed(found, trial):
        return missed
    read = {channel.topic for channel in prepared.log_map.channels_for(prepared.sources)}
    if unattested := sorted(read & set(found.unattested)):
        return f"its recorder did not listen to {', '.join(unattested)}"
    if uncompared := [f"{topic}: {why}" for topic, why in found.uncompared if topic in read]:
        return f"whether its recorder heard messages of the same definition cannot be told on {uncompared[0]}"
    keys = prepared.rule_set.authority.recorder_keys
    if not keys:
        return "a manifest is in it, and the rules name no key that should have signed it"
    refused = [signed_text(found.body, found.signature, key) for key in keys]
    return "" if not all(refused) else f"of its manifest, {refused[0]}"


def _of_another(found: Attestation | None, trial_id: str, team: str) -> str:
    """That it is a recording of another trial, or of another team's; empty where nothing says so."""
    if found is None:
        return ""
    others = [(found.trial, trial_id), (found.team, team)]
    if all(not said or not meant or said == meant for said, meant in others):
        return ""
    return (
        f"its recorder recorded {_named(found.trial, found.team)}, and this is to be {_named(trial_id, team)}"
    )


def _named(trial_id: str, team: str) -> str:
    names = ([f"trial {trial_id!r}"] if trial_id else []) + ([f"team {team!r}"] if team else [])
    return " of ".join(names)


def _missed(found: Attestation, trial: Trial) -> str:
    """What of the competition its recorder did not listen to; empty where it did all the time."""
    start_s, end_s, listened = trial.started_s, trial.ended_s, found.listened
    if listened is None:
        return ""
    if start_s is not None and listened.start_s > start_s + _LATE_S:
        return f"its recorder began at {listened.start_s:.3f} s, and the competition at {start_s:.3f} s"
    if end_s is not None and listened.end_s < end_s - _LATE_S:
        return f"its recorder ended at {listened.end_s:.3f} s, and the competition at {end_s:.3f} s"
    return ""


def _undefined(found: Attestation, prepared: Prepared) -> str:
    """The topics that are read and whose messages the recorder does not say the meaning of."""
    read = {channel.topic for channel in prepared.log_map.channels_for(prepared.sources)}
    return ", ".join(topic for topic in found.undefined if topic in read)


def _unheard(found: Attestation) -> str:
    return f"{_messages(len(found.early))} from before its recorder heard who sent them"


def _lacking(found: Attestation, prepared: Prepared, trial: Trial) -> list[str]:
    """What is missing, was put in or moved.

    A sample that is missing is a gap of its signal, and bounded as such; where a topic is missing altogether,
    another may stand in for it, which nobody but the organiser may choose. One that the recorder did not
    receive, though it lost none, or that lies at another time, is no sample.

    Two subscribers do not begin at once. What repeats itself and was received before the log heard that topic
    is no loss where the competition had not started.
    """
    read = {channel.topic for channel in prepared.log_map.channels_for(prepared.sources)}
    telling = {
        channel.topic
        for channel in prepared.log_map.channels
        if channel.whole or channel.as_consumed or channel.poses == "models"
    }
    gone = {one.topic for one in found.lacking if one.all and one.topic in read}
    lacking = [
        f"missing: {one}"
        for one in found.lacking
        if one.topic in telling | gone and not _of_others(one, prepared)
    ]
    late = [one for one in found.late if trial.started_s is None or one.span.end_s > trial.started_s]
    lacking += [f"missing: {one}" for one in late if one.topic in telling]
    put_in = dict(found.put_in) | {topic: n for topic, n in found.unlisted if topic in telling}
    more = [
        f"put in: {_messages(n)} on {topic} that it did not receive"
        for topic, n in sorted(put_in.items())
        if topic in read | telling
    ]
    moved = [
        f"moved: {_messages(n)} on {topic}, by more than {found.moved_by_s:.3g} s"
        for topic, n in found.moved
        if topic in read | telling
    ]
    return lacking + more + moved


def _of_others(lacking: Lacking, prepared: Prepared) -> bool:
    """Whether all that is missing came from nodes that no decoder of the topic listens to."""
    if lacking.all or not lacking.publishers:
        return False
    heeded = [_heeds(channel, prepared) for channel in prepared.log_map.channels if _tells(channel, lacking)]
    names = {name.rpartition("/")[2] for name in lacking.publishers}
    return not any(heeds is None or names & heeds for heeds in heeded)


def _tells(channel: Channel, lacking: Lacking) -> bool:
    return channel.topic == lacking.topic and channel.whole


def _heeds(channel: Channel, prepared: Prepared) -> frozenset[str] | None:
    """The nodes that count for a channel; `None` where all do."""
    if not channel.decoder:
        return None
    plugin = prepared.registry.find("ariac_score.decoders", channel.decoder)
    heeds: frozenset[str] | None = getattr(plugin.build({}), "heeds", None)
    return heeds


def _messages(count: int) -> str:
    return "1 message" if count == 1 else f"{count} messages"
