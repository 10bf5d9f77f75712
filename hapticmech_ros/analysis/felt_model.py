# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a hand will feel, predicted: the loop of one period as equations, without running it.

With z the shift by a period T, S = z⁻¹ + ... + z⁻ᵈ and d the periods from measuring to acting:

    device      V_d⁺ = A V_d + A_u (F_h + u),  p_d⁺ = p_d + A_p V_d + A_q (F_h + u)
    mechanism   x⁺ = A_m x + B_m w,  (p, V, a) = C x
    in flight   V̂ = V + d T a + T X S W,  p̂ = p + d T V̂
    controller  c = C (p_d - p̂, V_d - V̂),  W = C3 F_h + C1 c,
                U = G F_h + Λ_d a - (k P_c (p_d - p̂) + b P_c (V_d - V̂)) - C4 (1 - Π) c_d
    acting      w = z⁻ᵈ W,  u = z⁻ᵈ U + (1 - z⁻ᵈ) (G F_h - k P_c p_d - b P_c V_d)

and G = (1 + C6) Λ_d X - 1 + (1 - β) Π. X and a are X_τ and a_τ of
``operational/delay_compensation``, and c_d is c with C as it acts on the device. A force channel
that is closed by the controller has neither what is in flight nor the correction by G: then V̂ = V
and p̂ = p; a joint constraint that is closed by the controller has no correction by P_c. Limits,
ramps and encoder steps are left out, as is what a push bends: small motions of a device at full
force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.analysis.linear_point import LinearPoint, LinearSystem, linear_point
from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.compensated_delay import compensated_loop_delay
from hapticmech_ros.control.force_gain import force_gain
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.device import Device
from hapticmech_ros.simulation import Simulator


@dataclass(frozen=True, slots=True)
class FeltModel(LinearSystem):
    """Device, mechanism and controller as one linear system, from F_h to the device's twist.

    Attributes:
        mechanism: what should be felt.
        sampled: (n, 6) part of B by the samples of F_h alone, that the commands answer.
    """

    mechanism: LinearPoint
    sampled: Array

    def ratio(self, direction: Array, frequencies: Array) -> Array:
        """Return felt over desired impedance along a push, (k,) complex: 1 is right.

        Args:
            direction: (6,) of the push, N and N m, world axes; velocities are seen along it.
            frequencies: (k,) Hz, below half the sample rate.
        """
        felt, desired = self.admittance(frequencies), self.mechanism.admittance(frequencies)
        along = [np.einsum("i,kij,j->k", direction, one, direction) for one in (desired, felt)]
        return np.asarray(along[0] / along[1])

    def varying_ratio(self, direction: Array, frequencies: Array) -> Array:
        """Return the same, (k,) complex, of a hand whose wrench varies within a period.

        On device and mechanism acts its mean over the period, F̄ = F (e^sT - 1) / (s T), while
        commands answer the sample F at its start, half a period before. For a mass m on a device
        m_d the error is ω T / 2 (m / m_d - 1).

        Args:
            direction: (6,) of the push, N and N m, world axes; velocities are seen along it.
            frequencies: (k,) Hz, below half the sample rate.
        """
        turns = 2j * np.pi * self.period * np.asarray(frequencies, dtype=float)
        mean = (np.exp(turns) - 1.0) / turns
        desired, one = self.mechanism.admittance(frequencies), np.eye(len(self.step))
        found = []
        for turn, share, alone in zip(turns, mean, desired, strict=True):
            push = self.push * share + self.sampled * (1.0 - share)
            felt = self.twist @ np.linalg.solve(np.exp(turn) * one - self.step, push)
            found.append(share * (direction @ alone @ direction) / (direction @ felt @ direction))
        return np.array(found)


def felt_model(scene: Scene, point: str = "", delay: int = 1) -> FeltModel:
    """Return the model of a scene's loop where the scene starts: with its device and its gains.

    Args:
        scene: whose device, mechanism and gains; its hand is not in it.
        point: operational point that the device holds; the first one if empty.
        delay: whole periods d from measuring to acting.

    Raises:
        InvalidInputError: a negative delay, or an unknown point.
        ClosureError: the scene cannot close.
    """
    simulator, compensated_delay = Simulator(scene), compensated_loop_delay(scene, delay)
    mechanism = linear_point(simulator, simulator.initial_state(), point, compensated_delay)
    return loop_model(ControlArchitecture(scene), scene.device, mechanism, delay)


def loop_model(
    control: ControlArchitecture, device: Device, mechanism: LinearPoint, delay: int
) -> FeltModel:
    """Return the model of a loop.

    Args:
        control: its gains, and whether the device closes the force channel.
        device: what it drives.
        mechanism: as the operational point shows it, for a loop as late as this.
        delay: whole periods d from measuring to acting, 0 or more.
    """
    loop = _Loop(control, device, mechanism, delay)
    size = loop.size
    columns = np.hstack((np.eye(size), np.zeros((size, 6))))
    pushes = np.hstack((np.zeros((6, size)), np.eye(6)))
    after = loop.next(columns, pushes, pushes)
    sampled = loop.next(columns, pushes, np.zeros_like(pushes))[:, size:]
    twist = np.zeros((6, size))
    twist[:, 6:12] = np.eye(6)
    return FeltModel(mechanism.period, after[:, :size], after[:, size:], twist, mechanism, sampled)


class _Loop:
    """One period, for any number of states at once: they are columns."""

    def __init__(
        self, control: ControlArchitecture, device: Device, mechanism: LinearPoint, delay: int
    ) -> None:
        self._control, self._mechanism = control, mechanism
        self._inverse_inertia = mechanism.compensated.inverse_inertia
        self._share = mechanism.analysis.wrench_projector
        self._delay, self._period = delay, mechanism.period
        self._local = control.gains.force_channel.local
        task = np.zeros((6, 1))
        task[mechanism.analysis.rows] = 1.0
        self._task = task
        self._move = _device_period(device, mechanism.period, task)
        beta = control.gains.joint_constraint.feedforward
        feedback = control.gains.force_channel.device_feedback
        gain = force_gain(
            control.device_inertia, self._inverse_inertia, self._share, beta, feedback
        )
        self._gain = task * gain * task.T
        joint = control.gains.joint_constraint
        projector = task * mechanism.analysis.constraint_projector * task.T
        self._rigid = joint.stiffness * projector, joint.damping * projector
        self._rigid_local = joint.local
        ideal = device.position_resolution == 0.0 and device.angle_resolution == 0.0
        cut_off = 2.0 * np.pi * device.velocity_filter * mechanism.period
        self._filter = None if ideal else cut_off / (1.0 + cut_off)
        n = len(mechanism.step)
        # Pose, twist and measured twist of the device, state of the mechanism, and d times W, U,
        # F_h, pose and measured twist, newest first.
        self._splits = np.cumsum([6, 6, 6, n, *[6 * delay] * 4])
        self.size = 18 + n + 30 * delay

    def next(self, state: Array, hand: Array, acting_hand: Array) -> Array:
        """Return states (size, k) a period on, with F_h (6, k) as sampled and as it acts."""
        pose, twist, seen, x, told, sent, answered, places, rates = np.split(state, self._splits)
        if self._filter is None:
            seen = twist
        to_mechanism, to_device = self._answer(pose, seen, x, told, hand)
        told, acting = self._passed_on(told, to_mechanism)
        sent, command = self._passed_on(sent, to_device)
        answered, then = self._passed_on(answered, hand)
        if self._local:
            command = command + self._gain @ (hand - then)
        places, place = self._passed_on(places, pose)
        rates, rate = self._passed_on(rates, seen)
        if self._rigid_local:
            spring, damper = self._rigid
            command = command - spring @ (pose - place) - damper @ (seen - rate)
        kept, gained, moved, pushed = self._move
        net = acting_hand + command
        new_pose = pose + moved * twist + pushed * net
        new_twist = kept * twist + gained * net
        if self._filter is not None:
            seen = seen + self._filter * ((new_pose - pose) / self._period - seen)
        new_x = self._mechanism.step @ x + self._mechanism.push @ acting
        return np.vstack((new_pose, new_twist, seen, new_x, told, sent, answered, places, rates))

    def _answer(
        self, pose: Array, twist: Array, x: Array, told: Array, hand: Array
    ) -> tuple[Array, Array]:
        """Return W and U of a period."""
        gains, task = self._control.gains, self._task
        channels, inertia = self._control.channels, self._control.device_inertia
        mechanism = self._mechanism
        point, speed = mechanism.pose @ x, mechanism.twist @ x
        free = mechanism.acceleration @ x
        if self._local and self._delay:
            ahead = self._delay * self._period
            impulse = self._period * told.reshape(self._delay, 6, -1).sum(axis=0)
            speed = speed + ahead * free + self._inverse_inertia @ impulse
            point = point + ahead * speed
        error, rate = task * (pose - point), task * (twist - speed)
        hand = task * hand
        coupling = channels.stiffness[:, None] * error + channels.damping[:, None] * rate
        held = channels.held_stiffness[:, None] * error + channels.held_damping[:, None] * rate
        spring, damper = self._rigid
        in_range = gains.position_channel.to_device * (held - self._share @ held)
        device = self._gain @ hand + task * (inertia @ free) - spring @ error - damper @ rate
        told = channels.force.hand * hand + gains.position_channel.to_mechanism * coupling
        return told, device - in_range

    def _passed_on(self, queue: Array, newest: Array) -> tuple[Array, Array]:
        """Return what is on the way after a period, newest first, and what acts in it."""
        whole = np.vstack((newest, queue))
        return whole[: len(queue)], whole[-6:]


def _device_period(device: Device, period: float, task: Array) -> tuple[Array, Array, Array, Array]:
    """Return A, A_u, A_p and A_q of a device, (6, 1) each, over all of its substeps."""
    inertia = np.array([[device.mass]] * 3 + [[device.inertia]] * 3)
    damping = np.array([[device.damping]] * 3 + [[device.angular_damping]] * 3)
    step = period / device.substeps
    gain = step * task / inertia
    kept, gained, moved, pushed = np.ones((6, 1)), np.zeros((6, 1)), *np.zeros((2, 6, 1))
    for _ in range(device.substeps):
        kept, gained = kept - gain * damping * kept, gained + gain * (1.0 - damping * gained)
        moved, pushed = moved + step * kept, pushed + step * gained
    return kept, gained, moved, pushed
