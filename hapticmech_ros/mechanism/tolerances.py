# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tolerances of the closures' rank and of the projection onto them; kernels know these numbers."""

from __future__ import annotations

# Singular values of A = L⁻¹Wᵀ below this fraction of the largest carry no force: redundant
# closures. This is a numerical tolerance; which directions a user feels as rigid is another
# question.
SOLVER_RANK_TOLERANCE = 1e-8
# Below this fraction of the largest one a singular value is the rounding of rows that follow from
# others. One between the two shows that a singular position is near.
RESOLVED = 1e-11
# Where one is below this share of the largest, the rounding of φ turns the closures' rows by 1e-4
# and more.
NEAR = 1e-6
# A step that passes a singular position needs care from further off: at speed a turn of the rows by
# 1e-7 already costs energy. It passes one if it moves a joint by more, rad or m, than σ is from 0.
PASSING = 1e-4
# Next to a singular position, below the first share, a branch is interpolated between points whose
# shares are above the second one.
SINGULAR, DETERMINED = 1e-3, 3e-4
# Rounding of an energy, as a share of it; and an imperceptible energy, J: a thousand times the
# thermal one of a degree of freedom at room temperature, k T. A step at rest exchanges less.
ENERGY_ROUNDING, UNFELT = 1e-14, 4e-18
# Energy that steps make from nothing is taken out of the motion where it exceeds this share of the
# energy exchanged since the start plus the largest kinetic one, and the rounding of so many steps;
# see also ``schemes``. Energy lost without a cause cannot be restored: it is counted.
DRIFT, ROUNDED_STEPS = 1e-3, 1e6
# Off the closures by a residual δ (relative to the mechanism's length), as the inner stages of a
# step are, rows that depend on each other on the closures differ by the order of δ: 0.2 δ was
# measured on duplicated spatial loops. Singular values below this many δ are rounding; the cap
# keeps far-off poses, from which a loop is being closed, from losing rows that they need.
DRIFT_FACTOR = 10.0
DRIFT_CAP = 1e-4

# The projection stops once φ is this fraction of the mechanism's length (rad for axes): next to
# rounding, since close to a singular position, at a relative singular value σ, an error of φ turns
# the free velocities by φ/σ². On the N-four-bar 1e-11 cost five digits.
PROJECTION_TOLERANCE = 1e-14
# Closer still where σ itself is small: φ may turn the free velocities by this much. Below the
# second number, a fraction of the length as well, all is rounding.
NEAR_SINGULAR, LEAST_TOLERANCE = 1e-3, 2e-16
# It also stops where φ is this small and halves no more: rounding, far from the world's origin...
ROUNDING_TOLERANCE = 1e-11
# ...and a loop that is still open by this fraction after all iterations has come apart.
PROJECTION_FAILURE = 1e-6
PROJECTION_ITERATIONS = 10
# Of these, how many may use the factors of the step's last stage; and the largest share of φ that
# such an iteration may leave: if it leaves more, factors at the present q are used.
SIMPLIFIED, SHRINKS = 6, 0.1
# A projection that moves the mechanism by more than this fraction of the step before it, in mass
# metric, may have found another assembly. After a quarter of a radian by the coarsest rule it moves
# it by 0.11 at most, after a whole radian by 0.55; by rk4 then by 0.05.
JUMP = 0.5
# Baumgarte's pull leaves loops open, by about the error of a step over (a h)². This far open (of
# the length) it has lost them: users feel and see it, and accelerations are those of another
# mechanism.
BAUMGARTE_FAILURE = 1e-2
