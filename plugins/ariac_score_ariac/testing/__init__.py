"""For tests of what reads ARIAC's records: trials made to order, their messages, official documents."""

from ariac_score_ariac.testing.trials import kitting_trial, made_trial

__all__ = ["kitting_trial", "made_trial"]
