# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt over desired impedance of what a robot touches: device, mechanism, robot, environment.

A multisine force along one axis of the world acts on the device of a session whose mechanism leads
a robot in MuJoCo; its tool is fixed to a linear environment, whose force acts on the mechanism.
Desired is what the hand would feel of the mechanism fixed to that environment itself:

    Z_d = Z_m + E / s,      Z_m of the mechanism alone, E(s) of the environment

The closed form takes device, mechanism and controller as the linear model of one period of
:mod:`~hapticmech_ros.analysis.felt_model`, with its answers to F_h and to F_c along the axis. A
robot with the inverse inertia x = X_aa, torques that act over a period T one period late,
D = exp(-3/2 T s), and n periods of delay each way closes it by

    F_c = -E H exp(-(1 + 2 n) T s) p
    torques:    H = D b / (s² + D b + x E),      b = 2 ζ ω s + ω²
    otherwise:  H = b b_s / (a (a_s + x E) + x E b_s),      a = s² + b

with p of the operational point, a_s and b_s of the joints' own controllers
(:mod:`hapticmech_ros.robot.interfaces`), r their rate and c the correction of velocities:
a_s = s² + 2 r s + r² and b_s = r² for positions, b_s = 2 r s + r² with rates; a_s = s² + b_s and
b_s = 2 r (s + c) for velocities. Whether that loop is stable is told by Nyquist's criterion on the
line Re s = `SLOWEST`; the robot by itself is stable.

What is measured is the linear loop: the feedback's passivity control is not in it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.robot.driven import STEPS, DrivenRobot
from hapticmech_ros.analysis.felt_model import felt_model
from hapticmech_ros.analysis.impedance import (
    alone,
    amplitudes,
    faded_in,
    mechanism_twists,
    multisine,
)
from hapticmech_ros.analysis.touch import (
    ROWS,
    Setup,
    fine_times,
    means_of,
    samples_of,
    scripted,
)
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism import Mechanism, PointKinematics
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.interfaces import CORRECTION, RATE, Interface
from hapticmech_ros.robot.law import Gains, OperationalLaw
from hapticmech_ros.robot.linear_environment import Impedance, LinearEnvironment
from hapticmech_ros.robot.mujoco_robot import MujocoRobot
from hapticmech_ros.scene import Scene

FREQUENCIES_HZ = (1, 2, 3, 5, 7, 10, 14, 20, 30)
# Amplitude of the force, N per Hz.
PUSH_N_PER_HZ = 0.0005
# In which the force fades in; what dies away before the window; the window, of whole periods of all
# frequencies.
FADING_S, SETTLING_S, WINDOW_S = 1.0, 6.0, 1.0
# What may still change of any frequency from one window to the next.
STEADY = 0.02
# Rate, 1/s, below which growth is none.
SLOWEST = 0.05
# What the robot's controller takes, and whether positions come with their rates.
INTERFACES: dict[str, tuple[Interface, bool]] = {
    "effort": ("effort", False),
    "velocity": ("velocity", False),
    "position": ("position", False),
    "trajectory": ("position", True),
}


@dataclass(frozen=True, slots=True)
class FeltEnvironment:
    """What a hand feels of an environment.

    Attributes:
        environment: its name.
        interface: of the robot.
        delay: n, further periods from mechanism to robot, and back.
        frequencies: (k,) Hz.
        ratio: (k,) complex, felt over desired impedance; NaN if the motion became not steady.
        predicted: (k,) the ratio by the closed form.
        stable: whether the loop is, by the closed form.
    """

    environment: str
    interface: str
    delay: int
    frequencies: Array
    ratio: Array
    predicted: Array
    stable: bool

    @property
    def steady(self) -> bool:
        """Whether the motion became periodic, as the force is."""
        return bool(np.isfinite(self.ratio).all())

    def model_error(self, frequency: float) -> float:
        """Return the largest |predicted / ratio - 1| up to a frequency, Hz."""
        off = np.abs(self.predicted / self.ratio - 1.0)
        return float(off[self.frequencies <= frequency].max())


@dataclass(frozen=True, slots=True)
class Loop:
    """A device's scene, a robot, and how they are connected.

    Attributes:
        scene: of device and mechanism.
        robot: scene of the robot.
        gains: of its law.
        axis: 0 to 2 of the world, along which force and environment are.
    """

    scene: Scene
    robot: Scene
    gains: Gains
    axis: int = 0


class RobotInEnvironment(DrivenRobot):
    """A robot in MuJoCo, its follower, and the environment at its tool.

    Args:
        loop: whose robot it is.
        interface: one of ``INTERFACES``.
        environment: at its tool.

    Attributes:
        mobility: X_aa where it starts, 1/kg.
    """

    def __init__(self, loop: Loop, interface: str, environment: Impedance) -> None:
        period = loop.scene.simulation.period
        law = OperationalLaw(Mechanism(loop.robot), gains=loop.gains)
        robot = MujocoRobot(loop.robot, step=period / STEPS)
        super().__init__(robot, law, *INTERFACES[interface], period)
        self._environment = LinearEnvironment(environment, np.eye(3)[loop.axis])
        at_rest = law.state(law.posture, 0.0 * law.posture).analysis
        self.mobility = float(at_rest.inverse_inertia[loop.axis, loop.axis])

    def go_on(self, time: float) -> Array:
        """Move for a period; see :meth:`DrivenRobot.move`."""
        sensed = np.concatenate((self._environment.force, np.zeros(3)))
        return self.move(time, sensed, self._environment)


def felt_environment(
    loop: Loop, name: str, environment: Impedance, interface: str, delay: int
) -> FeltEnvironment:
    """Return what a hand feels of an environment, along an axis of the world.

    Args:
        loop: that is measured.
        name: of the environment.
        environment: at the robot's tool.
        interface: one of ``INTERFACES``.
        delay: further periods each way.
    """
    free = alone(loop.scene)
    setup, period = Setup(free, "", 1), free.simulation.period
    window = round(WINDOW_S / period)
    times = period * np.arange(round(SETTLING_S / period) + 2 * window)
    frequencies, fine = np.array(FREQUENCIES_HZ, dtype=float), fine_times(period, times.size)
    force = multisine(fine, frequencies, PUSH_N_PER_HZ * frequencies)
    force *= faded_in(fine, FADING_S)
    push = force[:, None] * np.eye(6)[loop.axis]
    robot = RobotInEnvironment(loop, interface, environment)
    closed = ClosedForm(loop, interface, environment, robot.mobility, delay, setup.delay)
    try:
        moved = device_twists(setup, robot, push, delay)
        still = device_twists(
            setup, RobotInEnvironment(loop, interface, environment), 0.0 * push, delay
        )
        velocity = (moved - still)[:, loop.axis]
    except HapticMechError:
        velocity = np.full(times.size, np.nan)
    means = means_of(push)
    own = (mechanism_twists(setup, means) - mechanism_twists(setup, 0.0 * means))[:, loop.axis]
    pushed, desired = (
        _steady(times, one, frequencies, window)[1] for one in (samples_of(force), own)
    )
    s = 2.0j * np.pi * frequencies
    reference = pushed / desired + environment.dynamic_stiffness(s) / s
    felt = np.full(frequencies.size, complex(np.nan, np.nan))
    if np.isfinite(velocity).all():
        before, after = _steady(times, velocity, frequencies, window)
        if (np.abs(after - before) <= STEADY * np.abs(after)).all():
            felt = pushed / after
    predicted = closed.impedance(frequencies) / reference
    ratio = felt / reference
    return FeltEnvironment(
        name, interface, delay, frequencies, ratio, predicted, closed.is_stable()
    )


class ClosedForm:
    """The linear loop of device, mechanism, robot and environment; see the module.

    Args:
        loop: that is meant.
        interface: one of ``INTERFACES``.
        environment: at the robot's tool.
        mobility: X_aa of the robot along the axis, 1/kg.
        delay: n, further periods each way.
        control_delay: d, periods from a sample of the device to its command.
    """

    def __init__(
        self,
        loop: Loop,
        interface: str,
        environment: Impedance,
        mobility: float,
        delay: int,
        control_delay: int,
    ) -> None:
        self._model = felt_model(alone(loop.scene), "", control_delay)
        self._axis, self._gains, self._mobility = np.eye(6)[loop.axis], loop.gains, mobility
        self._interface, self._environment, self._delay = interface, environment, delay

    def impedance(self, frequencies: Array) -> Array:
        """Return Z (k,) complex, N s/m, that a hand feels.

        Args:
            frequencies: (k,) Hz.
        """
        s = 2.0j * np.pi * frequencies
        answers, back = self._model.responses(self._axis, frequencies), self._back(s)
        place = answers.place_by_hand / (1.0 + back * answers.place_by_contact)
        return np.asarray(1.0 / (answers.twist_by_hand - answers.twist_by_contact * back * place))

    def is_stable(self) -> bool:
        """Return whether no motion grows faster than by ``SLOWEST``.

        Raises:
            HapticMechError: the curve turns too fast to be followed.
        """
        half = np.pi / self._model.period
        for count in (4000, 16000, 64000):
            # Up to half the sample rate, where the loop's gain is none.
            rates = np.concatenate((np.linspace(0.0, 3.0, count), np.geomspace(3.0, half, count)))
            s = SLOWEST + 1j * rates
            answers = self._model.responses(self._axis, s / (2.0j * np.pi))
            angles = np.unwrap(np.angle(1.0 + self._back(s) * answers.place_by_contact))
            if np.abs(np.diff(angles)).max() < 0.25 * np.pi:
                # Of the upper half: once for each pair of poles on the right.
                return bool(abs(angles[-1] - angles[0]) < 0.5 * np.pi)
        raise HapticMechError("the loop's curve turns too fast to be followed")

    def _back(self, s: Array) -> Array:
        """Return F_c (k,) per -p, N/m."""
        period = self._model.period
        stiff = self._environment.dynamic_stiffness(s)
        through = transfer(self._gains, self._mobility, stiff, self._interface, s, period)
        return np.asarray(stiff * through * np.exp(-(1.0 + 2.0 * self._delay) * period * s))


def transfer(
    gains: Gains, mobility: float, stiff: Array, interface: str, s: Array, period: float
) -> Array:
    """Return H (k,), from the target's motion to that of the tool in an environment.

    Args:
        gains: of the law.
        mobility: X_aa of the robot along the axis, 1/kg.
        stiff: (k,) E(s), N/m.
        interface: one of ``INTERFACES``.
        s: (k,) 1/s.
        period: T, s.
    """
    rate = gains.linear_rate
    wanted, pushed = 2.0 * gains.damping_ratio * rate * s + rate**2, mobility * stiff
    if interface == "effort":
        late = np.exp(-1.5 * period * s)
        return np.asarray(late * wanted / (s**2 + late * wanted + pushed))
    servo = 2.0 * RATE * s + RATE**2
    forwards = {
        "position": RATE**2 + 0.0 * s,
        "trajectory": servo,
        "velocity": 2.0 * RATE * (s + CORRECTION),
    }
    held = s**2 + (forwards["velocity"] if interface == "velocity" else servo)
    given = forwards[interface]
    return np.asarray(wanted * given / ((s**2 + wanted) * (held + pushed) + pushed * given))


def device_twists(setup: Setup, robot: RobotInEnvironment, pushes: Array, delay: int) -> Array:
    """Return twists (n, 6) of a device whose mechanism leads a robot, m/s and rad/s, world axes.

    Args:
        setup: of the session.
        robot: with its follower and its environment.
        pushes: (8 n, 6) on the device, in a script's rows, N and N m, world axes.
        delay: further periods each way.
    """
    period, periods = setup.scene.simulation.period, len(pushes) // ROWS
    with scripted(fine_times(period, periods), pushes) as hand:
        scene = setup.scene.model_copy(update={"hand": hand})
        session = replace(setup, scene=scene).session()
    there: deque[PointKinematics] = deque(maxlen=delay + 1)
    back = deque([np.zeros(6)] * (delay + 1), maxlen=delay + 1)
    twists = np.empty((periods, 6))
    for tick in range(periods):
        sample = session.tick(external_wrench=back[0])
        twists[tick] = sample.device.twist
        there.append(sample.seen.point)
        time = period * tick
        robot.follower.update_target(there[0].pose, there[0].twist, time)
        back.append(robot.go_on(time))
    return twists


def _steady(times: Array, values: Array, frequencies: Array, window: int) -> tuple[Array, Array]:
    """Return amplitudes (k,) in the last window but one, and in the last."""
    first = amplitudes(times[:window], values[-2 * window : -window], frequencies)
    return first, amplitudes(times[:window], values[-window:], frequencies)
