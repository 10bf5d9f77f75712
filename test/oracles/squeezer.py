# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Andrews' squeezer mechanism, the IVP test set's index-1 form: seven angles, six closures.

M q'' + G^T lambda = f and G q'' = -G' q'. Lengths m, masses kg, inertias kg m^2 about the centres.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oracles.bars import Bar, Place, arm, dynamics
from oracles.odes import solve

Array = np.ndarray

MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
A, B, C = -0.06934 - 0.00227j, -0.03635 + 0.03273j, 0.014 + 0.072j
STIFFNESS, REST, TORQUE = 4530.0, 0.07785, 0.033
D, DA, E, EA = 28e-3, 115e-4, 2e-2, 1421e-5
RR, RA, SS, SA, SB, SC, SD = 7e-3, 92e-5, 35e-3, 1874e-5, 1043e-5, 18e-3, 2e-2
TA, TB, U, UA, UB, ZF, ZT, FA = 2308e-5, 916e-5, 4e-2, 1228e-5, 449e-5, 2e-2, 4e-2, 1421e-5

# beta, theta, gamma, phi, delta, omega, epsilon
START = np.array(
    [
        -0.06171389001427645,
        0.0,
        0.45527981916307037,
        0.22266839016588588,
        0.48736497954384256,
        -0.22266839016588588,
        1.2305474445498212,
    ]
)
# Which angles turn each body, K1 to K7.
K1, K3, K5, K7 = np.eye(7)[[0, 2, 4, 6]]
K2, K4, K6 = K1 + np.eye(7)[1], K5 + np.eye(7)[3], K7 + np.eye(7)[5]

_CRANK, _G, _H = arm(RR, K1), arm(ZT, K5, A), arm(-1j * U, K7, A)
_CENTRES = (
    arm(RA, K1),
    _CRANK + arm(-DA, K2),
    arm(SB - 1j * SA, K3, B),
    _G + arm(-1j * (E - EA), K4),
    arm(TB - 1j * TA, K5, A),
    _H + arm(ZF - FA, K6),
    arm(-UB - 1j * UA, K7, A),
)
SPRING_END = arm(SD - 1j * SC, K3, B)
_MEETING = _CRANK + arm(-D, K2)
CLOSURES: tuple[Place, ...] = (
    _MEETING - arm(-1j * SS, K3, B),
    _MEETING - (_G + arm(-1j * E, K4)),
    _MEETING - (_H + arm(ZF, K6)),
)
BARS = [
    Bar(*parts)
    for parts in zip(MASSES, INERTIAS, _CENTRES, (K1, K2, K3, K4, K5, K6, K7), strict=True)
]


def forces(q: Array) -> Array:
    """Return the generalised forces (7,) of the spring and the drive, N m."""
    line = SPRING_END.at(q) - C
    pull = -STIFFNESS * (1.0 - REST / abs(line)) * line
    return (SPRING_END.jacobian(q).conj() * pull).real + TORQUE * K1


def acceleration(q: Array, v: Array) -> Array:
    """Return q'' (7,)."""
    inertia, force = dynamics(BARS, q, v)
    rows = np.array([part for z in CLOSURES for part in _parts(z.jacobian(q))])
    bias = np.array([part for z in CLOSURES for part in _parts(z.bias(q, v))])
    matrix = np.block([[inertia, rows.T], [rows, np.zeros((6, 6))]])
    return np.linalg.solve(matrix, np.append(force + forces(q), -bias))[:7]


def motion(times: Sequence[float]) -> Array:
    """Return the angles (times, 7) from rest at START."""
    start = np.append(START, np.zeros(7))
    return solve(lambda _, x: np.append(x[7:], acceleration(x[:7], x[7:])), start, times)[:, :7]


def _parts(value: Array | complex) -> tuple[Array, Array]:
    return np.real(value), np.imag(value)
