# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How large the numbers may be that a scene's nodes accept and send: far above what it needs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hapticmech_ros.scene.part import Part, Positive

# Products of several such numbers, and of a scene's own, stay finite.
Limit = Annotated[Positive, Field(le=1e15)]


class Limits(Part):
    """Largest sizes of the numbers in messages; what is beyond is refused, and never sent.

    They are no envelope for a hand (that is ``device.force_limit`` and the safety of the device's
    node), but what tells a number that was meant from one that was not.

    Attributes:
        position: m, of devices, operational points and grasps, per axis.
        linear_velocity: m/s, per axis.
        angular_velocity: rad/s, per axis.
        joint_position: rad or m, of every joint; a shaft may turn for hours.
        joint_velocity: rad/s or m/s.
        force: N, per axis, of every command, push and measurement.
        torque: N m, per axis.
        stiffness: N/m, N and N m/rad, of the gains that the device is told.
        damping: N s/m, N s and N m s/rad, of the same.
        ratio: of the projectors P_c and Π, of G, and of singular values; 1, m, 1/m.
        inverse_inertia: 1/kg, 1/(kg m) and 1/(kg m²), of Λ_h⁻¹.
        acceleration: m/s² and rad/s², of an operational point that nobody holds.
        energy: J, that a controller tells the device.
    """

    position: Limit = 1e3
    linear_velocity: Limit = 1e3
    angular_velocity: Limit = 1e5
    joint_position: Limit = 1e9
    joint_velocity: Limit = 1e5
    force: Limit = 1e6
    torque: Limit = 1e6
    stiffness: Limit = 1e9
    damping: Limit = 1e9
    ratio: Limit = 1e9
    inverse_inertia: Limit = 1e12
    acceleration: Limit = 1e12
    energy: Limit = 1e12
