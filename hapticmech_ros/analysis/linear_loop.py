# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Linear discrete-time model of a session's loop, with the mechanism's position frozen.

    device   (Λ_d + M_a) ẍ = F_s + u - D ẋ,      F_s = -K_s x - B_s ẋ
    point    p̈ = X u_m,                          e = x - p

    u = G F_h - K e - B ė   on the device,       C3 F_h + K_m e + B_m ė   on the mechanism

G, K and B are the controllers' linear laws at the position; the device closes the parts N_k and N_b
of K and B itself. Sampling, hold and delay by whole periods are those of :class:`Session`. The
model includes the device's substeps, the velocity filter of its encoders, the correction of
commands by the change of the hand's wrench, its lead until the next sample, and the prediction with
commands in flight; it excludes limits, encoder steps and Coulomb friction. The loop is unstable if
the matrix of one tick has an eigenvalue outside the unit circle.
:mod:`hapticmech_ros.control.loop_stability` is the special case without hand, device damping and
encoders.

Rules of the literature for a sampled virtual wall of stiffness K and damping B with a hold.

They apply to one degree of freedom of mass m and physical damping b, held by any passive user. None
of them bounds B; docs/limits.md compares them with sessions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.loop_stability import ON_CIRCLE, force_gain, lead_gains
from hapticmech_ros.control.measurements import OperationalModel
from hapticmech_ros.device.hand import spring_gains
from hapticmech_ros.errors import InvalidInputError, check_not_negative, check_positive
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import ArmHand, ConstantWrenchHand, SpringDamperHand


def passive_stiffness(physical: float, damping: float, period: float) -> float:
    """Return the largest K of a passive wall, N/m: b > K T / 2 + |B|. 0 if there is none.

    Colgate and Schenkel, "Passivity of a class of sampled-data systems", J. Robotic Systems 1997.

    Args:
        physical: b of the device, N s/m.
        damping: B of the wall, N s/m.
        period: T, s.

    Raises:
        InvalidInputError: a damping below 0, or a period that is not positive.
    """
    check_positive(period=period)
    check_not_negative(physical=physical, damping=damping)
    return max(0.0, 2.0 * (physical - abs(damping)) / period)


def delayed_stiffness(physical: float, damping: float, period: float, delay: float) -> float:
    """Return the largest stable K by the rule with delay, N/m: (b + B) / (T / 2 + t_d).

    Gil, Sanchez, Hulin, Preusche and Hirzinger, "Stability boundary for haptic rendering: influence
    of damping and delay", J. Computing and Information Science in Engineering 2009.

    Args:
        physical: b of the device, N s/m.
        damping: B of the wall, N s/m.
        period: T, s.
        delay: t_d, s, from measuring to acting, without the hold.

    Raises:
        InvalidInputError: as :func:`passive_stiffness`, or a delay below 0.
    """
    check_positive(period=period)
    check_not_negative(physical=physical, damping=damping, delay=delay)
    return (physical + damping) / (0.5 * period + delay)


def lightest_mass(device: float, hand: float) -> float:
    """Return the lower bound of the virtual mass for stability, kg: m_d m_a / (m_d + 2 m_a).

    On a device of mass m_d with a rigidly fixed mass m_a, the force channel responds to
    F_h = -m_a ẍ of one sample with u = (m_d / m_v - 1) F_h in a later one. With (m_d + m_a) ẍ = u
    successive commands are u' = -(m_d / m_v - 1) m_a / (m_d + m_a) u; they decay if the factor is
    inside (-1, 1), for any number of samples of delay.

    Args:
        device: m_d, kg.
        hand: m_a, kg.

    Raises:
        InvalidInputError: a mass below 0, or no device.
    """
    check_positive(device=device)
    check_not_negative(hand=hand)
    return device * hand / (device + 2.0 * hand)


# Relative resolution for sessions, and for eigenvalues.
RESOLUTION, FINE = 0.01, 1e-4


def frontier(
    stable: Callable[[float], bool],
    guess: float,
    least: float,
    most: float,
    resolution: float = RESOLUTION,
) -> float | None:
    """Return the largest stable value; None if ``least`` is not stable.

    The search goes outward from a guess until a stable and an unstable value are found, and bisects
    between them. If there is only one limit, the result does not depend on the guess.

    Args:
        stable: returns whether a positive value is stable.
        guess: first value to try.
        least: lower end of the search.
        most: upper end; returned if it is stable.
        resolution: relative resolution of the result.

    Raises:
        InvalidInputError: bounds that are not 0 < least < most.
    """
    if not 0.0 < least < most:
        raise InvalidInputError("bounds", (least, most), "must be positive and in order")
    known = cache(stable)
    low = high = float(np.clip(guess, least, most))
    step = 1.3
    while known(high) and high < most:
        low, high, step = high, min(step * high, most), step**2
    while not known(low) and low > least:
        low, high, step = max(low / step, least), low, step**2
    if known(high):
        return most
    if not known(low):
        return None
    while high > (1.0 + resolution) * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@dataclass(frozen=True, slots=True)
class Held:
    """Linear impedance of the hand, (6, 6) each.

    Attributes:
        stiffness, damping: K_s and B_s, of a spring and damper to a fixed pose.
        mass: M_a, of a mass rigidly fixed to the device.
    """

    stiffness: Array
    damping: Array
    mass: Array


NOBODY = Held(np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6)))


def held_by(scene: Scene) -> Held | None:
    """Return the linear impedance of the scene's hand; None if this model has none for it."""
    hand: object = scene.hand
    if isinstance(hand, ArmHand) and hand.grip is not None:
        return None
    if isinstance(hand, SpringDamperHand | ArmHand):
        stiffness, damping = spring_gains(hand)
        mass = [0.0] * 6
        if isinstance(hand, ArmHand):
            mass = [hand.mass] * 3 + [hand.angular_inertia] * 3
        return Held(np.diag(stiffness), np.diag(damping), np.diag(mass))
    return NOBODY if isinstance(hand, ConstantWrenchHand) else None


def tick_matrix(
    scene: Scene, law: Law, inverse_inertia: Array, rows: Array, delay: int, held: Held = NOBODY
) -> Array:
    """Return the transition matrix (size, size) of one tick.

    Args:
        scene: whose device and period are used.
        law: of the controllers.
        inverse_inertia: (6, 6) X, 1/kg, 1/(kg m) and 1/(kg m²), world axes at the point.
        rows: (t,) indices of the task space's rows in a six-vector.
        delay: whole periods from measuring to acting.
        held: impedance of the hand.

    Raises:
        InvalidInputError: a delay below 0.
    """
    check_not_negative(delay=delay)
    loop = _Loop(scene, law, inverse_inertia, rows, delay, held)
    return loop.tick(np.eye(loop.size))


def diverges(matrix: Array) -> bool:
    """Return whether an eigenvalue of a tick's matrix is outside the unit circle.

    Eigenvalues of rigid motions lie on it, up to the rounding of double roots.

    Args:
        matrix: (size, size) of :func:`tick_matrix`.
    """
    return float(np.abs(np.linalg.eigvals(matrix)).max()) > 1.0 + ON_CIRCLE


class _Loop:
    """State: x, ẋ, p, ṗ, measured ẋ, F_h of the hand's mass, the last two F_h, then commands.

    They are oldest first, those to the device before those to the mechanism.
    """

    def __init__(
        self, scene: Scene, law: Law, inverse_inertia: Array, rows: Array, delay: int, held: Held
    ) -> None:
        def cut(square: Array) -> Array:
            return np.asarray(square[np.ix_(rows, rows)])

        device = scene.device
        self._n, self._delay, self._local = len(rows), delay, law.local
        self._period, self._substeps = scene.simulation.period, device.substeps
        self._x_inverse = cut(inverse_inertia)
        self._force, self._hand = cut(law.force), cut(law.hand)
        self._stiffness, self._damping = cut(law.stiffness), cut(law.damping)
        self._pull, self._drag = cut(law.pull), cut(law.drag)
        self._near = cut(law.near[0]), cut(law.near[1])
        self._spring, self._grip, self._mass = map(cut, (held.stiffness, held.damping, held.mass))
        self._leads = lead_gains(self._force)
        self._gain = np.linalg.inv(cut(np.diag(device.inertias)) + self._mass)
        loss = cut(np.diag([device.damping] * 3 + [device.angular_damping] * 3))
        self._lost = 0.5 * self._period / self._substeps * self._gain @ loss
        coarse = device.position_resolution > 0.0 or device.angle_resolution > 0.0
        cut_off = 2.0 * np.pi * device.velocity_filter * self._period
        self._filter = cut_off / (1.0 + cut_off) if coarse else None
        self.size = self._n * (8 + 2 * delay)

    def tick(self, states: Array) -> Array:
        """Return states (size, k) a period later."""
        period, parts = self._period, states.reshape(-1, self._n, states.shape[1])
        x, rate, p, p_rate, seen, inert, last, earlier = parts[:8]
        to_device = list(parts[8 : 8 + self._delay])
        to_mechanism = list(parts[8 + self._delay :])
        force = inert - self._spring @ x - self._grip @ rate
        ahead, predicted = p_rate, p
        if self._local:
            commanded = sum(to_mechanism, 0.5 * self._hand @ force)
            ahead = p_rate + period * self._x_inverse @ commanded
            predicted = p + (self._delay + 0.5) * period * ahead
        error, error_rate = x - predicted, seen - ahead
        command = -self._stiffness @ error - self._damping @ error_rate
        # Closed in the device: the value at the sample is replaced by the current one.
        near = self._near[0] @ x + self._near[1] @ seen
        command = command + near
        # With a local force channel commands are corrected by G times the change of F_h.
        to_device.append(command if self._local else command + self._force @ force)
        mechanism = self._hand @ force + self._pull @ error + self._drag @ error_rate
        to_mechanism.append(mechanism)
        act = to_device.pop(0) - near
        if self._local:
            line, bend = self._leads
            act = act + self._force @ force + line @ (0.5 * (force - last))
            act = act + bend @ (5.0 / 12.0 * (force - 2.0 * last + earlier))
        push = self._x_inverse @ to_mechanism.pop(0)
        x_next, rate_next, inert_next = self._device(x, rate, act)
        seen_next = rate_next
        if self._filter is not None:
            seen_next = seen + self._filter * ((x_next - x) / period - seen)
        p_next = p + period * p_rate + 0.5 * period**2 * push
        new = (x_next, rate_next, p_next, p_rate + period * push, seen_next, inert_next)
        return np.concatenate((*new, force, last, *to_device, *to_mechanism))

    def _device(self, x: Array, rate: Array, act: Array) -> tuple[Array, Array, Array]:
        """Return x, ẋ and F_h of the hand's mass a period later; see ``device/kernels``."""
        step, one = self._period / self._substeps, np.eye(self._n)
        kept, given = one - self._lost, np.linalg.inv(one + self._lost)
        acceleration, own = np.zeros_like(x), -self._spring @ x - self._grip @ rate
        for _ in range(self._substeps):
            change = step * self._gain @ (act + own)
            seen = rate + 0.5 * change - self._lost @ rate
            own = -self._spring @ (x + 0.5 * step * rate) - self._grip @ seen
            later = given @ (kept @ rate + step * self._gain @ (act + own))
            x = x + 0.5 * step * (rate + later)
            acceleration, rate = (later - rate) / step, later
        end = -self._spring @ x - self._grip @ rate
        return x, rate, -self._mass @ (acceleration + self._gain @ (end - own))


@dataclass(frozen=True, slots=True)
class Law:
    """Linear gains of a controller at a position, (6, 6) each, world axes at the point held.

    Attributes:
        force: G, from F_h to the device's wrench.
        stiffness, damping: K and B, from e and ė to the device's wrench; N/m and N s/m, in rotation
            N m/rad and N m s/rad.
        hand: C3, from F_h to the mechanism's wrench.
        pull, drag: K_m and B_m, from e and ė to the mechanism's wrench.
        local: whether the device corrects commands by G times the change of F_h.
        near: N_k and N_b, closed in the device.
    """

    force: Array
    stiffness: Array
    damping: Array
    hand: Array
    pull: Array
    drag: Array
    local: bool
    near: tuple[Array, Array] = (np.zeros((6, 6)), np.zeros((6, 6)))


def law_of(control: ControlArchitecture, model: OperationalModel) -> Law:
    """Return the linear law of a scene's controllers, without limits and ramps.

    Args:
        control: control architecture with the gains.
        model: operational model at the position.
    """
    joint, channels = control.gains.joint_constraint, control.channels
    x, share, projector = model.inverse_inertia, model.wrench_projector, model.constraint_projector
    free = np.eye(6) - share
    position, force = control.gains.position_channel, control.gains.force_channel
    rigid = joint.stiffness * projector, joint.damping * projector
    held = position.to_device * free
    nothing = np.zeros((6, 6))
    return Law(
        force=force_gain(
            control.device_inertia, x, share, joint.feedforward, force.device_feedback
        ),
        stiffness=rigid[0] + held * channels.held_stiffness,
        damping=rigid[1] + held * channels.held_damping,
        hand=force.hand * np.eye(6),
        pull=position.to_mechanism * np.diag(channels.stiffness),
        drag=position.to_mechanism * np.diag(channels.damping),
        local=force.local,
        near=rigid if joint.local else (nothing, nothing),
    )
