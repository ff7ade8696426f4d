"""Messages that wait to be decoded together come in recorded order."""

from __future__ import annotations

import numpy as np
import pytest

from ariac_score.logs.columnar import Payloads, message_buffer
from ariac_score.logs.columnar.message_buffer import Pending
from ariac_score.logs.containers.items import Batch, Connection, Message

X = Connection("/x", "std_msgs/msg/Float64", "cdr")


def batch_of(*payloads: bytes) -> Batch:
    count = len(payloads)
    return Batch(
        (X,), np.zeros(count, dtype=np.int64), np.arange(count, dtype=np.int64), Payloads.joined(payloads)
    )


@pytest.mark.parametrize(
    ("size", "portions"), [(9, []), (10, [[0], [1]])], ids=["copied and waiting", "decoded in place"]
)
def test_what_waits_comes_before_a_batch_that_is_not_copied(
    monkeypatch: pytest.MonkeyPatch, size: int, portions: list[list[int]]
) -> None:
    monkeypatch.setattr(message_buffer, "SLAB_BYTES", 80)  # an eighth of it is worth no copy
    pending = Pending()
    pending.add(Message(X, 0, b"abc"), 0)

    found = [waiting[X].numbers.tolist() for waiting in pending.take(batch_of(b"d" * size), {X}, 1)]

    assert found == portions
    assert [waiting.numbers.tolist() for waiting in pending.empty().values()] == (
        [] if portions else [[0, 1]]
    )


def test_single_messages_are_decoded_once_there_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(message_buffer, "_SLAB_MESSAGES", 3)
    pending, full = Pending(), []
    for number in range(3):
        pending.add(Message(X, number, b"a"), number)
        full.append(pending.full)

    assert full == [False, False, True]
