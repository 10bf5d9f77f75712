# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Predicts the dynamics that a hand feels: the loop of one period as equations, without running it.

With z the shift by a period T, S = z⁻¹ + ... + z⁻ᵈ and d the periods from measuring to acting:

    device      V_d⁺ = A V_d + A_u (F̄_h + u),  p_d⁺ = p_d + A_p V_d + A_q (F̄_h + u)
    mechanism   x⁺ = A_m x + B_m (w + F_c),  (p, V, a) = C x
    in flight   V̂ = V + (d + ½) T (a + X F_c) + T X (S W + ½ (C3 F_h + C5 F_c)),
                p̂ = p + (d + ½) T V̂
    controller  c = C (p_d - p̂, V_d - V̂),  W = C3 F_h + C5 F_c + C1 c,
                U = G F_h + C2 (Λ_d X + (1 - β) Π) F_c + Λ_d a
                    - (k P_c (p_d - p̂) + b P_c (V_d - V̂)) - C4 (1 - Π) c_d
    acting      w = z⁻ᵈ W,  u = z⁻ᵈ U + (1 - z⁻ᵈ) (G F_h - k P_c p_d - b P_c V_d)
                    + G ½ (1 - z⁻¹) F_h + (1 + 2 R²)⁻¹ (1 - 8/5 R²) G 5/12 (1 - z⁻¹)² F_h

with G = (1 + C6) Λ_d X - 1 + (1 - β) Π and R = 1 + G. X and a are X_τ and a_τ of
``operational/observe_kernels``, and c_d is c with C as it acts on the device. A force
channel that is closed by the controller has neither commands in flight nor the correction by G:
then V̂ = V and p̂ = p; a joint constraint that is closed by the controller has no correction by
P_c. The model leaves out limits, ramps, encoder steps, and nonlinear effects of large pushes.

A hand's wrench varies within a period. On the device acts its mean F̄_h, while commands answer the
sample F_h at the period's start; both are inputs here. So is a wrench F_c of an environment, which
is held over a period and which the controllers know at its start.

A mechanism as its operational point shows it for small motions: x⁺ = A x + B F, y = C x.

x holds θ and v in coordinates that the closures leave free and that are orthonormal in the mass
metric: q = q_0 ⊕ L⁻ᵀ N θ, v = v_0 + L⁻ᵀ N v', N an orthonormal complement of range(L⁻¹Wᵀ). A and B
are central differences of the simulator's own step, so they have its integrator's errors; C those
of kinematics and analysis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.loop_delay import compensated_loop_delay, periods_before
from hapticmech_ros.control.loop_stability import force_gain, lead_gains
from hapticmech_ros.mechanism.projection import project
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational.analysis import Analyser
from hapticmech_ros.operational.results import CompensatedResponse, OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.device import Device
from hapticmech_ros.simulation import MechanismState, Simulator

# Of a difference, in √kg m and √kg m/s, and N and N m. Errors are about 1e-9 of it where nothing
# but rounding counts, and its square where something bends.
CHANGE = 1e-5


def response(a: Array, b: Array, c: Array, places: Array) -> Array:
    """Return C (z - A)⁻¹ B, (k, outputs, inputs) complex.

    Args:
        a: (n, n) A.
        b: (n, inputs) B.
        c: (outputs, n) C.
        places: (k,) complex z.
    """
    one = np.eye(len(a))
    answers = [np.linalg.solve(z * one - a, b) for z in places]
    return np.array([c @ answer for answer in answers])


@dataclass(frozen=True, slots=True)
class LinearSystem:
    """A wrench in, a twist out: x⁺ = A x + B F, V = C x, once a period.

    Attributes:
        period: s.
        step: (n, n) A; x in √kg m and √kg m/s.
        push: (n, 6) B, of F held over the period, N and N m, world axes at the point.
        twist: (6, n) C, of V at the period's start, m/s and rad/s, likewise.
    """

    period: float
    step: Array
    push: Array
    twist: Array

    def admittance(self, frequencies: Array) -> Array:
        """Return C (z - A)⁻¹ B at z = exp(i ω T), (k, 6, 6) complex: V per F, SI, world axes.

        Args:
            frequencies: (k,) Hz.
        """
        turns = np.exp(2j * np.pi * self.period * np.asarray(frequencies, dtype=float))
        return response(self.step, self.push, self.twist, turns)

    def run(self, external: Array) -> Array:
        """Return twists (k, 6), m/s and rad/s, from rest under wrenches, one a period.

        Args:
            external: (k, 6) N and N m, world axes at the point.
        """
        return self.driven(np.asarray(external, dtype=float) @ self.push.T)

    def driven(self, driven: Array) -> Array:
        """Return twists (k, 6), m/s and rad/s, from rest.

        Args:
            driven: (k, n) B F of each period.
        """
        states = np.zeros((len(driven), len(self.step)))
        for index in range(len(driven) - 1):
            states[index + 1] = self.step @ states[index] + driven[index]
        return np.asarray(states @ self.twist.T)

    @property
    def growth(self) -> float:
        """Largest eigenvalue's size of A; above 1 it is unstable."""
        return float(np.abs(np.linalg.eigvals(self.step)).max())


@dataclass(frozen=True, slots=True)
class LinearPoint(LinearSystem):
    """Linear map of a mechanism's small deviations over a period: n/2 positions, then velocities.

    Attributes:
        pose: (6, n) of the point, deviation in m and rad, world axes, per deviation.
        acceleration: (6, n) of the point's free acceleration, m/s² and rad/s²: of a_0, or of a_τ
            with delay compensation.
        by_past: (6, n/2) of the same, by the velocities that were ``periods_before`` ago.
        periods_before: how long ago; 0 if those are not known.
        analysis: of the point where the mechanism is linearised.
        compensated: X_τ and a_τ there.
    """

    pose: Array
    acceleration: Array
    by_past: Array
    periods_before: int
    analysis: OperationalAnalysis
    compensated: CompensatedResponse


def linear_point(
    simulator: Simulator,
    state: MechanismState,
    point: str = "",
    compensated_delay: float = 0.0,
    periods_before: int = 0,
) -> LinearPoint:
    """Return the linear model of a mechanism at a state.

    It is meant for equilibria; at another state it is the tangent there.

    Args:
        simulator: of the mechanism.
        state: where; loops may be closed.
        point: operational point; the first one if empty.
        compensated_delay: τ, s; 0 for none.
        periods_before: how long before a state the rates are that its compensation knows; 0 if none
            are.

    Raises:
        InvalidInputError: unknown point.
        ClosureError: a closed loop came apart.
    """
    return _Differences(simulator, state, point, compensated_delay, periods_before).found()


class _Differences:
    def __init__(
        self,
        simulator: Simulator,
        state: MechanismState,
        point: str,
        compensated_delay: float,
        periods_before: int,
    ) -> None:
        self._simulator, self._state = simulator, state
        self._mechanism = simulator.mechanism
        self._analyser = Analyser(self._mechanism, point, compensated_delay)
        terms = simulator.evaluate(state)
        self._pose = terms.points[self._analyser.index].pose
        self._analysis = self._analyser.analyse(terms)
        self._periods_before = periods_before
        before = self._before(state.v)
        self._compensated = self._analyser.compensated(terms, before)
        space = terms.space
        self._factor = space.factor
        nv = self._mechanism.nv
        basis = np.hstack((space.basis, np.eye(nv)))
        self._free = np.linalg.qr(basis)[0][:, space.rank : nv]
        self._rates = np.linalg.solve(self._factor.T, self._free)
        self._wrenches = np.zeros((len(self._mechanism.point_names), 6))

    def found(self) -> LinearPoint:
        """Return the model."""
        size, calm = 2 * self._free.shape[1], np.zeros(6)
        stepped = self._columns(size, lambda x: self._stepped(self._moved(x), calm))
        external_count = self._columns(6, lambda wrench: self._stepped(self._state, wrench))
        shown = self._columns(size, lambda x: self._shown(self._moved(x)))
        rows, half = shown.reshape(3, 6, size), size // 2
        by_past = np.zeros((6, half))
        if self._periods_before:
            by_past = self._columns(half, self._free_after)
        return LinearPoint(
            period=self._simulator.period,
            step=stepped,
            push=external_count,
            twist=rows[1],
            pose=rows[0],
            acceleration=rows[2],
            by_past=by_past,
            periods_before=self._periods_before,
            analysis=self._analysis,
            compensated=self._compensated,
        )

    @staticmethod
    def _columns(size: int, function: Callable[[Array], Array]) -> Array:
        """Return the derivative of a function of ``size`` numbers, where they are 0."""
        changes = CHANGE * np.eye(size)
        columns = [(function(one) - function(-one)) / (2.0 * CHANGE) for one in changes]
        return np.array(columns).T

    def _moved(self, x: Array) -> MechanismState:
        """Return the state with these coordinates, its closures met."""
        mechanism, state = self._mechanism, self._state
        theta, speed = np.split(x, 2)
        q = mechanism.integrate(state.q, self._rates @ theta)
        v = state.v + self._rates @ speed
        q, v, error, _ = project(mechanism, q, v, state.active)
        return replace(state, q=q, v=v, closure_error=error)

    def _stepped(self, state: MechanismState, wrench: Array) -> Array:
        """Return the coordinates a period later."""
        wrenches = self._wrenches.copy()
        wrenches[self._analyser.index] = wrench
        after, start = self._simulator.step(state, wrenches), self._state
        moved = pin.difference(self._mechanism.model, start.q, after.q)
        both = np.column_stack((moved, after.v - start.v))
        return np.asarray((self._free.T @ self._factor.T @ both).T.ravel())

    def _shown(self, state: MechanismState) -> Array:
        """Return deviation of the pose, twist and free acceleration of the point, (18,)."""
        terms = self._simulator.evaluate(state)
        seen = terms.points[self._analyser.index]
        before = self._before(self._state.v)
        compensated = self._analyser.compensated(terms, before)
        turned = pin.log3(seen.pose.rotation @ self._pose.rotation.T)
        away = seen.pose.translation - self._pose.translation
        return np.concatenate((away, turned, seen.twist, compensated.free_acceleration))

    def _before(self, rates: Array) -> Array:
        """Return (1 + nv,) the past rates for the compensation."""
        return np.concatenate(((self._periods_before * self._simulator.period,), rates))

    def _free_after(self, speed: Array) -> Array:
        """Return the point's free acceleration at the state, after other rates, (6,)."""
        terms = self._simulator.evaluate(self._state)
        before = self._before(self._state.v + self._rates @ speed)
        return self._analyser.compensated(terms, before).free_acceleration


class Responses(NamedTuple):
    """Answers of a loop along one direction over frequency, complex.

    Attributes:
        twist_by_hand: (k,) of the device per sample of F_h, m/s per N or rad/s per N m.
        twist_by_contact: (k,) of the device per F_c, likewise.
        place_by_hand: (k,) of the operational point per sample of F_h, m/N or rad/(N m).
        place_by_contact: (k,) of the operational point per F_c, likewise.
    """

    twist_by_hand: Array
    twist_by_contact: Array
    place_by_hand: Array
    place_by_contact: Array


def _mean_share(turns: Array) -> Array:
    """Return the mean of e^sT over a period that begins at 1, of s T (k,)."""
    return np.asarray((np.exp(turns) - 1.0) / turns)


@dataclass(frozen=True, slots=True)
class FeltModel(LinearSystem):
    """Device, mechanism and controller as one linear system, from F_h to the device's twist.

    Attributes:
        push: (n, 6) B, of the mean of F_h over the period, as the hand acts on the device.
        mechanism: the desired one.
        sampled: (n, 6) of the sample of F_h at the period's start, which the commands answer.
        contact: (n, 6) of F_c, which acts on the mechanism in the period.
        place: (6, n) C of the operational point's pose at the period's start, deviation in m and
            rad, world axes.
    """

    mechanism: LinearPoint
    sampled: Array
    contact: Array
    place: Array

    def ratio(self, direction: Array, frequencies: Array) -> Array:
        """Return felt over desired impedance along a push, (k,) complex: 1 is right.

        Args:
            direction: (6,) of the push, N and N m, world axes; velocities are seen along it.
            frequencies: (k,) Hz, below half the sample rate.
        """
        found, s = self.responses(direction, frequencies), self._rates(frequencies)
        mean = _mean_share(s * self.period)
        desired = self.mechanism.admittance(frequencies)
        along = np.einsum("i,kij,j->k", direction, desired, direction)
        return np.asarray(mean * along / found.twist_by_hand)

    def responses(self, direction: Array, frequencies: Array) -> Responses:
        """Return the dynamics along a direction by wrenches along it.

        The mean of a hand's wrench over a period is F̄ = F (e^sT - 1) / (s T).

        Args:
            direction: (6,) of the wrenches, N and N m, world axes; motion is seen along it.
            frequencies: (k,) Hz, below half the sample rate, or complex: s / (2 π i).
        """
        turns, one = self._rates(frequencies) * self.period, np.eye(len(self.step))
        seen = np.vstack((direction @ self.twist, direction @ self.place))
        found = []
        for turn, share in zip(turns, _mean_share(turns), strict=True):
            push = (self.push * share + self.sampled) @ direction
            driven = np.column_stack((push, self.contact @ direction))
            found.append(seen @ np.linalg.solve(np.exp(turn) * one - self.step, driven))
        return Responses(*np.array(found).reshape(-1, 4).T)

    @staticmethod
    def _rates(frequencies: Array) -> Array:
        """Return s (k,) of frequencies, Hz."""
        return 2j * np.pi * np.asarray(frequencies)

    def run_with(self, samples: Array, means: Array) -> Array:
        """Return twists (k, 6) of the device, m/s and rad/s, from rest under a hand's wrench.

        Args:
            samples: (k, 6) F_h at each period's start, N and N m, world axes at the point.
            means: (k, 6) its mean over each period, likewise.
        """
        return self.driven(means @ self.push.T + samples @ self.sampled.T)


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
    before = periods_before(scene, delay)
    mechanism = linear_point(simulator, simulator.initial_state(), point, compensated_delay, before)
    return loop_model(ControlArchitecture(scene), scene.device, mechanism, delay)


def loop_model(
    control: ControlArchitecture, device: Device, mechanism: LinearPoint, delay: int
) -> FeltModel:
    """Return the model of a loop.

    Args:
        control: its gains, and whether the device closes the force channel.
        device: that it drives.
        mechanism: at the operational point, for a loop with this delay.
        delay: whole periods d from measuring to acting, 0 or more.
    """
    loop = _Loop(control, device, mechanism, delay)
    size, n = loop.size, len(mechanism.step)
    # The state, F̄_h, F_h and F_c.
    inputs = np.split(np.eye(size + 18), np.cumsum([size, 6, 6]))
    step, acting, sampled, contact = np.split(loop.next(*inputs), np.cumsum([size, 6, 6]), axis=1)
    twist, place = np.zeros((6, size)), np.zeros((6, size))
    twist[:, 6:12], place[:, 18 : 18 + n] = np.eye(6), mechanism.pose
    return FeltModel(mechanism.period, step, acting, twist, mechanism, sampled, contact, place)


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
        self._leads = lead_gains(self._gain)
        touch = force_gain(control.device_inertia, self._inverse_inertia, self._share, beta)
        self._touch = task * (np.eye(6) + touch) * task.T
        joint = control.gains.joint_constraint
        projector = task * mechanism.analysis.constraint_projector * task.T
        self._rigid = joint.stiffness * projector, joint.damping * projector
        self._rigid_local = joint.local
        ideal = device.position_resolution == 0.0 and device.angle_resolution == 0.0
        cut_off = 2.0 * np.pi * device.velocity_filter * mechanism.period
        self._filter = None if ideal else cut_off / (1.0 + cut_off)
        n = len(mechanism.step)
        past = n // 2 * mechanism.periods_before
        # Pose, twist and measured twist of the device, state of the mechanism, the last two F_h,
        # the mechanism's velocities in the last periods, and d times W, U, F_h, pose and measured
        # twist, newest first.
        self._splits = np.cumsum([6, 6, 6, n, 12, past, *[6 * delay] * 4])
        self.size = 30 + n + past + 30 * delay

    def next(self, state: Array, acting_hand: Array, hand: Array, contact: Array) -> Array:
        """Return states (size, k) a period on, with F_h (6, k) as it acts and as sampled, and F_c.

        Args:
            state: (size, k).
            acting_hand: (6, k) F̄_h.
            hand: (6, k) F_h.
            contact: (6, k) F_c.
        """
        parts = np.split(state, self._splits)
        pose, twist, seen, x, before, past, commanded, sent, answered, places, rates = parts
        if self._filter is None:
            seen = twist
        half, mechanism = len(x) // 2, self._mechanism
        free, speeds = mechanism.acceleration @ x, np.vstack((x[half:], past))
        if mechanism.periods_before:
            free = free + mechanism.by_past @ past[-half:]
        past = speeds[: len(past)]
        to_mechanism, to_device = self._answer(pose, seen, x, free, commanded, hand, contact)
        commanded, acting = self._passed_on(commanded, to_mechanism)
        sent, command = self._passed_on(sent, to_device)
        answered, then = self._passed_on(answered, hand)
        last, earlier = np.split(before, 2)
        before = np.vstack((hand, last))
        if self._local:
            line, bend = self._leads
            command = command + self._gain @ (hand - then) + line @ (0.5 * (hand - last))
            command = command + bend @ (5.0 / 12.0 * (hand - 2.0 * last + earlier))
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
        new_x = mechanism.step @ x + mechanism.push @ (acting + contact)
        mine = new_pose, new_twist, seen, new_x, before, past
        return np.vstack((*mine, commanded, sent, answered, places, rates))

    def _answer(
        self,
        pose: Array,
        twist: Array,
        x: Array,
        free: Array,
        commanded: Array,
        hand: Array,
        contact: Array,
    ) -> tuple[Array, Array]:
        """Return W and U of a period."""
        gains, task = self._control.gains, self._task
        channels, inertia = self._control.channels, self._control.device_inertia
        mechanism = self._mechanism
        point, speed = mechanism.pose @ x, mechanism.twist @ x
        hand, contact = task * hand, task * contact
        force = gains.force_channel
        forces = force.hand * hand + force.mechanism_feedback * contact
        if self._local:
            ahead = (self._delay + 0.5) * self._period
            impulse = 0.5 * self._period * forces + ahead * contact
            impulse = impulse + self._period * commanded.reshape(self._delay, *hand.shape).sum(
                axis=0
            )
            speed = speed + ahead * free + self._inverse_inertia @ impulse
            point = point + ahead * speed
        error, rate = task * (pose - point), task * (twist - speed)
        coupling = channels.stiffness[:, None] * error + channels.damping[:, None] * rate
        held = channels.held_stiffness[:, None] * error + channels.held_damping[:, None] * rate
        spring, damper = self._rigid
        in_range = gains.position_channel.to_device * (held - self._share @ held)
        device = self._gain @ hand + task * (inertia @ free) - spring @ error - damper @ rate
        device = device + force.contact * (self._touch @ contact)
        commanded = forces + gains.position_channel.to_mechanism * coupling
        return commanded, device - in_range

    def _passed_on(self, queue: Array, newest: Array) -> tuple[Array, Array]:
        """Return the commands in flight after a period, newest first, and those acting in it."""
        whole = np.vstack((newest, queue))
        return whole[: len(queue)], whole[-6:]


def _device_period(device: Device, period: float, task: Array) -> tuple[Array, Array, Array, Array]:
    """Return A, A_u, A_p and A_q of a device, (6, 1) each, over all of its substeps.

    Each moves by the mean of the twists at its ends, and its damper is by that mean.
    """
    inertia = np.array([[device.mass]] * 3 + [[device.inertia]] * 3)
    damping = np.array([[device.damping]] * 3 + [[device.angular_damping]] * 3)
    step = period / device.substeps
    gain = step * task / inertia
    lost = 0.5 * gain * damping
    share, gain = (1.0 - lost) / (1.0 + lost), gain / (1.0 + lost)
    kept, gained, moved, pushed = np.ones((6, 1)), np.zeros((6, 1)), *np.zeros((2, 6, 1))
    for _ in range(device.substeps):
        before = kept, gained
        kept, gained = share * kept, share * gained + gain
        moved = moved + 0.5 * step * (before[0] + kept)
        pushed = pushed + 0.5 * step * (before[1] + gained)
    return kept, gained, moved, pushed
