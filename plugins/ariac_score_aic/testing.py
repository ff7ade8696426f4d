"""A made trial, for trying checks without a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ariac_score import Item, Span, Trial
from ariac_score.testing import made_trial as any_trial
from ariac_score_aic.consumption import Consumed, Consumption
from ariac_score_aic.messages import (
    CONTACTS,
    CONTROLLER,
    EVENT,
    SCORING_STATIC,
    SCORING_TF,
    TF,
    TF_STATIC,
    WRENCHES,
    AicMessages,
    Controller,
    Texts,
    Transforms,
    Wrenches,
)
from ariac_score_aic.run_config import Connection
from ariac_score_aic.task_times import TaskTimes

__all__ = ["made_trial"]

_SECOND_NS = 10**9
_CONNECTION = Connection("cable_0", "sfp_tip", "nic_card_mount_0", "sfp_port_0")
_INSERTED = b"nic_card_mount_0/sfp_port_0"
_NAMES = (
    "aic_world",
    "task_board",
    "task_board/nic_card_mount_0/sfp_port_0_link",
    "task_board/nic_card_mount_0/sfp_port_0_link_entrance",
    "cable_0/sfp_tip_link",
    "gripper/tcp",
)


def made_trial() -> Trial:
    """A task that is completed in 20 s: the plug sinks into its port, and the gripper with it."""
    consumed = Consumed(_messages(), _as_coded(), (_CONNECTION,), _times(), 180.0, "trial_1")
    plug = Item("plug", "connection", dict(vars(_CONNECTION)))
    task = Item("cable_1", "task", {"time_limit_s": 180.0, "time_s": 20.0}, (plug,))
    return replace(
        any_trial(), work=(task,), submissions=(), facts={}, records=(consumed,), recorded=Span(0.0, 30.0)
    )


def _as_coded() -> Consumption:
    return Consumption(
        "gripper/tcp",
        "aic_world",
        "aic_world",
        True,
        True,
        True,
        "at_start",
        False,
        WRENCHES[0],
        True,
        False,
        False,
    )


def _times() -> TaskTimes:
    return TaskTimes(5 * _SECOND_NS, 25 * _SECOND_NS, True, True, True, 20.0, True, "task_times.yaml")


def _messages() -> AicMessages:
    stamps = np.arange(1, 1501) * (_SECOND_NS // 50)
    order = np.arange(1, len(stamps) + 1) * 3
    height_m = np.linspace(0.2, 0.0, len(stamps))
    force_n = np.zeros((len(stamps), 3))
    force_n[700:730, 2] = 25.0
    velocity_m_s = np.tile([0.02, 0.0, -0.02], (len(stamps), 1))
    return AicMessages(
        "bag_trial_1_20260520_101112_345",
        (_SECOND_NS // 50, 30 * _SECOND_NS),
        {TF: 1500, CONTROLLER: 1500, WRENCHES[0]: 1500, CONTACTS: 1500, EVENT: 1},
        _transforms(order, stamps, height_m),
        Controller(order, stamps, velocity_m_s, np.zeros((len(stamps), 3))),
        {WRENCHES[0]: Wrenches(order + 1, stamps, force_n)},
        events=Texts(
            np.array([3601]), np.array([24 * _SECOND_NS]), np.array([24 * _SECOND_NS]), (_INSERTED,)
        ),
        contact_ns=stamps,
        log=Texts(np.array([1]), np.array([0]), np.array([_SECOND_NS]), (b"SwitchToAICController::Execute",)),
    )


def _transforms(order: np.ndarray, stamps: np.ndarray, height_m: np.ndarray) -> Transforms:
    moving = np.zeros((len(stamps), 7))
    moving[:, 2], moving[:, 6] = height_m, 1.0
    board = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
    board[2, 2] = 0.0458
    codes = np.concatenate([[1, 2, 3], np.full(len(stamps), 4), np.full(len(stamps), 5)])
    parents = np.concatenate([[0, 1, 1], np.zeros(2 * len(stamps))]).astype(np.int64)
    all_orders = np.concatenate([[1, 1, 1], order, order])
    columns = [
        all_orders,
        np.concatenate([[2, 2, 2], np.full(2 * len(stamps), 2)]),
        np.concatenate([np.full(3, _SECOND_NS // 50), stamps, stamps]),
        parents,
        codes,
        np.concatenate([board, moving, np.add(moving, [0, 0, 0.1, 0, 0, 0, 0])]),
    ]
    by_order = np.argsort(all_orders, kind="stable")
    topics = (TF, TF_STATIC, SCORING_TF, SCORING_STATIC)
    order, topic, stamp_ns, parent, child, rows = (column[by_order] for column in columns)
    return Transforms(order, topic, stamp_ns, parent, child, rows, topics, _NAMES)
