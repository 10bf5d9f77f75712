# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment (section 4): run or read it, summarise, compare, draw Fig. 5."""

from hapticmech_ros.experiment.from_bag import record_from_bag, shared_record_from_bag
from hapticmech_ros.experiment.from_session import SessionRecorder, run_session, run_shared_session
from hapticmech_ros.experiment.record import (
    ExperimentRecord,
    GraphHealth,
    NodeHealth,
    SharedRecord,
    health_from_bag,
)
from hapticmech_ros.experiment.run import compare
from hapticmech_ros.experiment.summary import summarise, summarise_shared

# Drawing (figures, run) is imported where it is used: matplotlib is slow to import.
__all__ = [
    "ExperimentRecord",
    "GraphHealth",
    "NodeHealth",
    "SessionRecorder",
    "SharedRecord",
    "compare",
    "health_from_bag",
    "record_from_bag",
    "run_session",
    "run_shared_session",
    "shared_record_from_bag",
    "summarise",
    "summarise_shared",
]
