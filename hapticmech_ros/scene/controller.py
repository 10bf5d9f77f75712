# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains of the controllers of Fig. 3, and of passivity control.

Joint-constraint gains of a scene that gives none: the same rule for every device.

    k = min(2000 N/m, m (0.3 / τ)²),      b = 2 ζ √(k m),      ζ = 0.8

Along a constrained direction a hand feels the device's own mass m, on a spring that is closed after
τ: a period of sampling and hold, the lag of the velocity filter where encoders are stepped, and,
where the device does not close it itself, one more and the connection's round trip. ω τ = 0.3
leaves a margin of three to such a loop's stability limit; 2000 N/m yields by a millimetre under 2
N.

Spring and damper scale alike with the metric's lengths, so in rotation the felt inertia of the
device, and with it the critical damping, are smaller: in the shipped scenes ζ = 0.8 in translation
is up to 1.3 there. One is critical on average, and neither rings.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.part import Flag, NonNegative, Part, Positive, Real

MOST_N_PER_M = 2000.0
# Phase lag ω τ (rad) of a delayed spring by design; it becomes unstable at about three times that.
DESIGN_PHASE_LAG = 0.3
DAMPING_RATIO = 0.8


def lag_of(device: Device, connection: Connection, period: float, local: bool) -> float:
    """Return τ, s, of a spring between device and operational point.

    Args:
        device: whose velocity may be filtered.
        connection: between device and controller.
        period: s.
        local: whether the device closes it itself.
    """
    lag = period
    if device.position_resolution > 0.0 or device.angle_resolution > 0.0:
        lag += 1.0 / (2.0 * math.pi * device.velocity_filter)
    return lag if local else lag + period + 2.0 * connection.designed


def damping_for(stiffness: float, device: Device) -> float:
    """Return b, N s/m, that goes with a stiffness, N/m."""
    return 2.0 * DAMPING_RATIO * math.sqrt(stiffness * device.mass)


def by_rule(
    gains: JointConstraintGains, device: Device, connection: Connection, period: float
) -> JointConstraintGains:
    """Return gains with stiffness and damping by the rule, where they were not given."""
    given = gains.model_fields_set
    if {"stiffness", "damping"} <= given:
        return gains
    lag = lag_of(device, connection, period, gains.local)
    stiffness = gains.stiffness
    if "stiffness" not in given:
        stiffness = min(MOST_N_PER_M, device.mass * (DESIGN_PHASE_LAG / lag) ** 2)
    damping = gains.damping
    if "damping" not in given:
        damping = damping_for(stiffness, device)
    return gains.model_copy(update={"stiffness": stiffness, "damping": damping})


class Perception(Part):
    """Which directions count as rigid, in s = sqrt(mu) (docs/notation.md).

    Control weighs directions smoothly from 1 at ``s_on`` to 0 at ``s_off``; the reported count
    switches on below ``s_on`` and off above ``s_off``, each after ``dwell``.

    Attributes:
        s_on: below which a direction is rigid.
        s_off: above which it is free; above ``s_on``.
        dwell: s.
    """

    s_on: Annotated[Positive, Field(lt=1.0)] = 0.02
    s_off: Annotated[Positive, Field(lt=1.0)] = 0.05
    dwell: NonNegative = 0.005


class Experiment(Part):
    """The scene's experiment.

    Attributes:
        duration: s, after the hand starts.
    """

    duration: Positive = 5.0


# Of one of the six channels: 0 cuts it, 1 is the one that renders the mechanism as it is.
Channel = Annotated[Real, Field(ge=0.0, le=1.0)]
# Of local force feedback: the mechanism feels 1 / (1 + C) times as heavy.
Feedback = Annotated[Real, Field(gt=-1.0, le=10.0)]


class JointConstraintGains(Part):
    """Finite stiffness that renders rigid joints.

    Along a constrained direction n, normalised in the metric, the gain is per unit of the metric's
    mass: pure translation of the link meets ``stiffness`` N/m and ``damping`` N s/m.

    Attributes:
        stiffness: N/m; where a scene gives none, by the rule of
            :mod:`~hapticmech_ros.scene.controller`.
        damping: N s/m; likewise.
        force_limit: N, of the controller's wrench.
        torque_limit: N m, likewise.
        feedforward: β, share of the hand's push along n that is cancelled by feedforward.
        local: whether the device corrects each command for its motion along constrained directions
            since the sample that the command answers; see docs/feel.md.
    """

    stiffness: NonNegative = 2000.0
    damping: NonNegative = 40.0
    force_limit: Positive = 15.0
    torque_limit: Positive = 0.8
    feedforward: Annotated[Real, Field(ge=0.0, le=1.0)] = 0.0
    local: Flag = True


class PositionChannelGains(Part):
    """Local position controllers C_m = C_s of the four-channel architecture: spring and damper.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        angular_stiffness: N m/rad.
        angular_damping: N m s/rad.
        to_mechanism: C1, share of it that pulls the mechanism after the device.
        to_device: C4, share of it that pulls the device after the mechanism.
    """

    stiffness: NonNegative = 300.0
    damping: NonNegative = 10.0
    angular_stiffness: NonNegative = 0.3
    angular_damping: NonNegative = 0.01
    to_mechanism: Channel = 1.0
    to_device: Channel = 1.0


class ForceChannelGains(Part):
    """Force channels.

    Attributes:
        contact: C2, contact to hand.
        hand: C3, hand to mechanism.
        mechanism_feedback: C5, local force feedback of the mechanism.
        device_feedback: C6, local force feedback of the device.
        local: whether the device corrects each command for the change of the hand's wrench since
            the sample that the command answers; see docs/feel.md.
    """

    contact: Channel = 1.0
    hand: Channel = 1.0
    mechanism_feedback: Feedback = 0.0
    device_feedback: Feedback = 0.0
    local: Flag = True


class Passivity(Part):
    """Limits of the energy that the device may give back; see docs/passivity.md.

    Attributes:
        control: whether the limits are enforced; energies are published in any case.
        allowance: J, that it may give without having received it.
        slack: J, by which the mechanism may have received more than the hand has given.
    """

    control: Flag = True
    allowance: NonNegative = 5.0e-4
    slack: Positive = 0.1


class Controller(Part):
    """Gains of the three controllers of Fig. 3, and their ramps.

    Attributes:
        joint_constraint: of the spring and damper that render rigid joints.
        position_channel: of the four-channel controller's position channels.
        force_channel: of its force channels.
        passivity: of the device's energy.
        engagement_ramp: s, over which dampers, then springs are ramped up when rendering starts. It
            is up to six times as long where a moving device would have to be braked with more than
            ``engagement_force``.
        engagement_force: N, of dampers that then equalise both sides' velocities.
        grasp_ramp: s, of the change from one grasp to another.
        gain_ramp: s, of a change of gains while they render.
    """

    joint_constraint: JointConstraintGains = JointConstraintGains()
    position_channel: PositionChannelGains = PositionChannelGains()
    force_channel: ForceChannelGains = ForceChannelGains()
    passivity: Passivity = Passivity()
    engagement_ramp: NonNegative = 0.5
    engagement_force: Positive = 0.08
    grasp_ramp: NonNegative = 0.25
    gain_ramp: NonNegative = 0.3

    @property
    def local(self) -> bool:
        """Whether the device is to correct commands by itself; see docs/passivity.md."""
        return self.force_channel.local or self.joint_constraint.local

    def closed_in_device(self, local: bool) -> Controller:
        """Return gains with force channel and joint constraint closed in the device, or not."""
        force = self.force_channel.model_copy(update={"local": local})
        joint = self.joint_constraint.model_copy(update={"local": local})
        return self.model_copy(update={"force_channel": force, "joint_constraint": joint})


class Connection(Part):
    """Network between device and controller, besides the graph itself: none by default.

    ``delay``, ``jitter``, ``loss`` and ``seed`` are simulated. ``expected`` is a real network's
    delay: no message is delayed for it, but gains, prediction and timeouts are designed for it too.

    Attributes:
        delay: s, in each direction.
        jitter: share of it by which each message is earlier or later, evenly spread.
        loss: share of the messages that do not arrive.
        seed: of both; the same seed gives the same connection.
        expected: s, in each direction, of the real network.
        expected_jitter: share of it by which its messages may be earlier or later.
    """

    delay: Annotated[NonNegative, Field(le=1.0)] = 0.0
    jitter: Annotated[Real, Field(ge=0.0, le=1.0)] = 0.0
    loss: Annotated[Real, Field(ge=0.0, lt=1.0)] = 0.0
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    expected: Annotated[NonNegative, Field(le=1.0)] = 0.0
    expected_jitter: Annotated[Real, Field(ge=0.0, le=1.0)] = 0.2

    @property
    def designed(self) -> float:
        """One-way delay (s) that gains, prediction and timeouts are designed for."""
        return self.delay + self.expected

    @property
    def latest(self) -> float:
        """One-way delay (s) of the latest message."""
        return self.delay * (1.0 + self.jitter) + self.expected * (1.0 + self.expected_jitter)

    @property
    def networked(self) -> bool:
        """Whether a real network is declared."""
        return self.expected > 0.0

    @property
    def direct(self) -> bool:
        """Whether nothing lies between: no simulated connection, and no declared network."""
        return self.ideal and not self.networked

    @property
    def ideal(self) -> bool:
        """Whether messages arrive at once, all of them."""
        return self.delay == 0.0 and self.loss == 0.0
