"""The orders of ARIAC, which are the work of its trials."""

from __future__ import annotations

from ariac_score import Order, Trial

__all__ = ["orders_of"]


def orders_of(trial: Trial) -> tuple[Order, ...]:
    """The orders of a trial, in order of announcement."""
    return tuple(item for item in trial.work if isinstance(item, Order))
