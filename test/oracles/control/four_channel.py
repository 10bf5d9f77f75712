# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches of the four channels."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import FourChannel


@dataclass(frozen=True, slots=True)
class ChannelWrenches:
    """Wrenches of the channels on both sides, world axes, N and N m.

    Attributes:
        device: (6,) on the hand, by the device, at the point held.
        mechanism: (6,) on the mechanism, by the hand, at the operational point.
    """

    device: Array
    mechanism: Array


def channel_wrenches(
    channels: FourChannel,
    wrench_projector: Array,
    error: Array,
    error_rate: Array,
    hand_wrench: Array,
    contact_wrench: Array,
) -> ChannelWrenches:
    """Return both sides' wrenches; see :mod:`hapticmech_ros.control.architecture`.

    Args:
        channels: their gains.
        wrench_projector: (6, 6) Π.
        error: (6,) e, twist that takes the operational point to the device, m and rad.
        error_rate: (6,) ė.
        hand_wrench: (6,) F_h, by the hand on the device.
        contact_wrench: (6,) F_c, by the environment on the mechanism at the operational point.
    """
    coupling = channels.stiffness * error + channels.damping * error_rate
    held = channels.held_stiffness * error + channels.held_damping * error_rate
    in_range = channels.position.to_device * (held - wrench_projector @ held)
    told = channels.force.hand * hand_wrench + channels.force.mechanism_feedback * contact_wrench
    return ChannelWrenches(
        device=channels.force.contact * contact_wrench - in_range,
        mechanism=told + channels.position.to_mechanism * coupling,
    )
