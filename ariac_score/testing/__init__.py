"""For authors of plugins and tests: trials made to order, and their record in every log format."""

from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.testing.contract import contract_checks
from ariac_score.testing.contract_check import ContractCheck, ContractError
from ariac_score.testing.made import example_trial, made_trial
from ariac_score.testing.recordings import recorded_messages
from ariac_score.testing.rosmonitoring import monitored_events, write_event_log
from ariac_score.testing.source_contract import source_checks
from ariac_score.testing.trial_log import write_trial_log
from ariac_score.testing.trials import NEAR_MISS, SNAPSHOT_SIGNALS, NearMiss, near_miss_trial

__all__ = [
    "NEAR_MISS",
    "SNAPSHOT_SIGNALS",
    "ContractCheck",
    "ContractError",
    "NearMiss",
    "Recorded",
    "contract_checks",
    "example_trial",
    "made_trial",
    "monitored_events",
    "near_miss_trial",
    "recorded_messages",
    "source_checks",
    "write_bag",
    "write_event_log",
    "write_trial_log",
]
