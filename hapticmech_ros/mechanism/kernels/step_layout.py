# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the mechanism's kernels read and fill besides matrices, by name: one table for each array.

Kernels index with the names below each table; Python takes slices of the tables.
"""

from __future__ import annotations

from hapticmech_ros.layout import Field, Layout

_ONE = Field(1)

# Of a step: its length, s; 1 where positions move with the rates at the step's end; φ at which the
# projection stops, up to which it may stop when φ halves no more, and beyond which a step may have
# been a jump, m; Baumgarte's rate a, 1/s, 0 for the projection; φ beyond which a loop has come
# apart, m; 1 where θ̇ differs from v at later stages; what of singular positions ends a run, see
# ``run_kernels``; by which share of what it exchanges a step's energy account may be off, 0 where
# nobody looks; how many of the wrenches on links are those of contacts, which come first; and which
# share of what was exchanged all steps together may make from nothing.
STEP_SETTINGS = Layout(
    dict.fromkeys(
        (
            "step",
            "late",
            "closed",
            "rounded",
            "far",
            "baumgarte_rate",
            "apart",
            "local_rates",
            "heeded",
            "tolerance",
            "touching",
            "drift",
        ),
        _ONE,
    )
)
(
    STEP,
    LATE,
    CLOSED,
    ROUNDED,
    FAR,
    BAUMGARTE_RATE,
    APART,
    LOCAL_RATES,
    HEEDED,
    TOLERANCE,
    TOUCHING,
    DRIFT,
) = STEP_SETTINGS.starts(*STEP_SETTINGS)

# Of a run: work done and energy lost since it began, J; |φ| of the round before; in the mass metric
# how far the step went, if it may have been a jump, and the projection; steps done; by how much the
# energy accounts of all steps are off, J; and the part of the work that contacts did, J. Then what
# the run began with, see ``motion.Owed``; the last of it is the largest so far; and the number of
# steps after which too much had been lost without a cause.
STEP_ACCOUNT = Layout(
    dict.fromkeys(
        (
            "work_in",
            "energy_lost",
            "last_error",
            "went",
            "projected",
            "steps_done",
            "surplus",
            "contact_work",
            "owed_surplus",
            "owed_work",
            "owed_loss",
            "moved",
            "lossy",
        ),
        _ONE,
    )
)
(
    WORK_IN,
    ENERGY_LOST,
    LAST_ERROR,
    WENT,
    PROJECTED,
    STEPS_DONE,
    SURPLUS,
    CONTACT_WORK,
    OWED_SURPLUS,
    OWED_WORK,
    OWED_LOSS,
    MOVED,
    LOSSY,
) = STEP_ACCOUNT.starts(*STEP_ACCOUNT)
# What the run began with.
OWED = STEP_ACCOUNT.slice("owed_surplus", "moved")

# What a run does, whole numbers: steps; stages of the rule; 1 for an implicit rule; 1 where terms
# at the start are known; steps from one sample to the next, 0 for none; and with contacts what it
# begins with, see ``contact.step_kernels``, and how many rows of ``external`` behind those of the
# contacts are wrenches from outside.
RUN_PLAN = Layout(
    dict.fromkeys(
        (
            "steps",
            "stages",
            "implicit",
            "terms_known",
            "sample_every",
            "begins_with",
            "pushes",
        ),
        _ONE,
    )
)
(
    STEPS,
    STAGES,
    IMPLICIT,
    TERMS_KNOWN,
    SAMPLE_EVERY,
    BEGINS_WITH,
    PUSHES,
) = RUN_PLAN.starts(*RUN_PLAN)

# The end of a packed array of terms: largest |φ|, m or rad; the rank; ``least`` and ``resolved`` of
# a Closing; and the potential energy, J, infinite until a step's account has asked for it.
TERMS_TAIL = Layout(dict.fromkeys(("error", "rank", "least", "resolved_rank", "potential"), _ONE))
ERROR, RANK, LEAST, RESOLVED_RANK, POTENTIAL = TERMS_TAIL.starts(*TERMS_TAIL)
