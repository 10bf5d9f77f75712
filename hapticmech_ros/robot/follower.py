# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that follows a point by irregular samples, and stops safely without them.

Time is an argument, s. As long as joint states, target and, where there is a sensor, wrenches are
fresh, the robot follows by the law through a clutch: it makes the same motion as the target,
relative to their poses at the engagement. Otherwise it fails closed:

    joint states stale, or   effort: the weight's, at the joints' last positions
    too old for the rates:
    target or wrench stale:  effort: that, and a brake
    either:                  velocity: zero;  position: the joints' at that time

and engages with the target anew when all inputs are back.

A robot that oscillates about its target carries a payload too large for its rates. It then gets
slower ones (:mod:`.law`), and the observer restarts from its mean estimate. After `SLOWEST` such
steps the robot brakes and does not follow any more.

The loop with the observer of R6 is stable up to some multiple of the modelled inertia
(:mod:`.law`); beyond that it oscillates, with growing amplitude. Repeated reversals of the speed
relative to the target distinguish an oscillation from a moving target, a contact or a blocked
robot. A reversal is a relative twist with a part of at least `speed` against the largest one since
the last reversal, which was as large. `REVERSALS` within `WINDOW` / ω are an oscillation: three
periods of a loop with κ = ω and ρ = 50 times its inertia, whose frequency is about √3/2 ω / ∛ρ.

Friction, a payload and wrong masses are not in the model. With the momentum p = D v, ṗ = τ + Cᵀ v -
g + Jᵀ F_c + d, and d is their disturbance. Its estimate follows it at a rate κ, and needs no
accelerations:

    r = κ (p - ∫ (τ + Cᵀ v - g + Jᵀ F_c + r) dt),      ṙ = κ (d - r)                         (R6)

(A. De Luca, R. Mattone: Actuator failure detection and isolation using generalized momenta, IEEE
ICRA 2003). h - r in place of h in R3 then balances friction and payload as well. Measured contacts
are no disturbance; others are balanced like one: a robot without a wrench sensor would push ever
harder against a contact, and needs a rate of 0.

It also loads the arm of a robot's file: with gravity, and a gripper whose fingers are locked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.clutch import Clutch, engage
from hapticmech_ros.errors import (
    HapticMechError,
    InvalidInputError,
    check_not_negative,
    check_one_of,
    check_positive,
)
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.inertia import dtrsv
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.robot.interfaces import (
    EARTH,
    Interface,
    VirtualRobot,
    VirtualState,
    WrenchSensor,
)
from hapticmech_ros.robot.law import (
    OperationalLaw,
    RobotState,
    Target,
    Tuning,
    TuningRamp,
    longest_delay,
)
from hapticmech_ros.scene import Scene

NO_GRAVITY = np.empty(0)


def load_arm(file: str, gravity: Array = NO_GRAVITY) -> Scene:
    """Return the arm of a robot's file.

    Args:
        file: scene, URDF, MJCF or SDF, or the name of a shipped scene.
        gravity: (3,) m/s², world axes; empty: as in the file, and of a URDF file downwards along z.
            Zero for a robot whose own controller carries its weight.

    Raises:
        SceneError: as :func:`~hapticmech_ros.loading.load_scene`.
        InvalidInputError: gravity is not three numbers.
    """
    scene = arm_of(load_scene(file))
    if gravity.size == 0:
        if Path(file).suffix.lower() != ".urdf":
            return scene
        # URDF does not define gravity; by convention z is up.
        gravity = EARTH
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise InvalidInputError("gravity", gravity, "must be three numbers")
    return scene.model_copy(update={"gravity": tuple(gravity.tolist())})


def arm_of(scene: Scene) -> Scene:
    """Return a scene without couplings, whose joints are locked where they start.

    Their motors have their own controller, and their motion changes the arm's inertia less than a
    payload does.

    Args:
        scene: of a robot.
    """
    if not scene.couplings:
        return scene
    coupled = {name for one in scene.couplings for name in (one.joint, one.leader)}
    locked = {"locked": True}
    links = tuple(
        link.model_copy(update={"joint": link.joint.model_copy(update=locked)})
        if link.joint.name in coupled
        else link
        for link in scene.links
    )
    return scene.model_copy(update={"links": links, "couplings": ()})


class Observed(NamedTuple):
    """State of the observer.

    Attributes:
        disturbance: (nv,) r, N m or N.
        momentum: (nv,) the integral in R6, N m s or N s.
    """

    disturbance: Array
    momentum: Array


class DisturbanceObserver:
    """Estimates the disturbance of joints, a period at a time.

    Args:
        mechanism: of the robot.
        rate: κ, 1/s; 0: an estimate stays constant.
        period: s.

    Raises:
        InvalidInputError: a rate that is negative, or that the period does not allow.
    """

    def __init__(self, mechanism: Mechanism, rate: float, period: float) -> None:
        self._rate, self._period = checked_rate(rate, period), period
        self._tree = mechanism.tree
        self._model, self._data = mechanism.model, mechanism.model.createData()

    def with_rate(self, rate: float) -> DisturbanceObserver:
        """Return the same observer with another rate, which begins anew.

        Args:
            rate: κ, 1/s.

        Raises:
            InvalidInputError: a rate that is negative, or that the period does not allow.
        """
        other = copy(self)
        other._rate = checked_rate(rate, self._period)
        return other

    def begin(self, state: RobotState, disturbance: Array | None = None) -> Observed:
        """Return an estimate to begin with.

        Args:
            state: of the robot.
            disturbance: (nv,) r, N m or N; None: nothing.
        """
        held = np.zeros_like(state.v) if disturbance is None else disturbance
        if self._rate == 0.0:
            return Observed(held, _momentum(state))
        return Observed(held, _momentum(state) - held / self._rate)

    def next(
        self, known: Observed, before: RobotState, torque: Array, contact: Array, now: RobotState
    ) -> Observed:
        """Return the estimate at the end of a period.

        Args:
            known: the estimate at its start.
            before: state of the robot then.
            torque: (nv,) that the joints had over the period, N m or N.
            contact: (6,) F_c then, by the environment on the robot, N and N m, world axes.
            now: state of the robot at the end.
        """
        if self._rate == 0.0:
            return known
        model, data = self._model, self._data
        coriolis = pin.computeCoriolisMatrix(model, data, before.q, before.v)
        weight = pin.computeGeneralizedGravity(model, data, before.q)
        if self._tree.carried.any():
            pin.computeJointJacobians(model, data, before.q)
            weight = weight - self._tree.carried_force(data)
        pushed = before.point.jacobian.T @ contact
        rate = torque + coriolis.T @ before.v - weight + pushed + known.disturbance
        momentum = known.momentum + self._period * rate
        return Observed(self._rate * (_momentum(now) - momentum), momentum)


def checked_rate(rate: float, period: float) -> float:
    """Return an observer's rate, 1/s.

    Args:
        rate: κ, 1/s.
        period: s.

    Raises:
        InvalidInputError: a rate that is negative, or that the period does not allow.
    """
    if not 0.0 <= rate * period < 1.0:
        rule = f"must be 0 or more and below {1.0 / period:g} 1/s"
        raise InvalidInputError("observer_rate", rate, rule)
    return rate


def balanced(state: RobotState, observed: Observed) -> RobotState:
    """Return the state with h - r in place of h: the law then balances the disturbance.

    Args:
        state: of the robot.
        observed: of its joints.
    """
    return state._replace(bias_force=state.bias_force - observed.disturbance)


def _momentum(state: RobotState) -> Array:
    """Return p (nv,)."""
    return np.asarray(state.factor @ (state.factor.T @ state.v))


# 6 π over the angular rate 50^(-1/3) √3 / 2 of ω.
REVERSALS, WINDOW = 6, 80.0


class SwingWatch:
    """Counts reversals of a relative speed.

    Args:
        speed: m/s, that counts.
        lever: m, that makes speeds of angular ones.
        window: s, within which reversals are a swing.
    """

    def __init__(self, speed: float, lever: float, window: float) -> None:
        self._window = window
        self._speed, self._scale = speed, np.repeat((1.0, lever), 3)
        self._peak = np.zeros(6)
        self._times: deque[float] = deque(maxlen=REVERSALS)

    def begin(self) -> None:
        """Forget all reversals."""
        self._peak = np.zeros(6)
        self._times.clear()

    def swings(self, twist: Array, time: float) -> bool:
        """Return whether it swings now.

        Args:
            twist: (6,) of the point relative to its target, m/s and rad/s.
            time: s.
        """
        twist = twist * self._scale
        size, largest = float(np.linalg.norm(twist)), float(np.linalg.norm(self._peak))
        against = -float(twist @ self._peak)
        if largest >= self._speed and against >= self._speed * largest:
            self._times.append(time)
            self._peak = twist
        elif size > largest:
            self._peak = twist
        return len(self._times) == REVERSALS and time - self._times[0] <= self._window


_NOTHING = np.zeros(6)
_NEVER = -np.inf
# Times that a follower slows down.
SLOWEST = 4


@dataclass(frozen=True, slots=True)
class FollowerSettings:
    """How a robot follows.

    Attributes:
        interface: commands that its controller accepts.
        period: s, between commands.
        joint_timeout, target_timeout, wrench_timeout: s, after which samples count as lost.
        has_sensor: whether its contact wrench is measured.
        observer_rate: rate of the observer of disturbances, 1/s; 0: none.
        largest_error: m, between target and robot, beyond which the clutch slips: it then does not
            pull harder after a target that jumps, or when blocked.
        leash: of the virtual robot, rad or m; see :class:`.interfaces.VirtualRobot`.
        swing_speed: m/s about the target that count as an oscillation of a robot with an observer;
            0: none.
        gain_ramp: s, of a change of gains.

    Raises:
        InvalidInputError: an unknown interface, or a time that is not positive.
    """

    interface: Interface = "effort"
    period: float = 1e-3
    joint_timeout: float = 0.02
    target_timeout: float = 0.05
    wrench_timeout: float = 0.05
    has_sensor: bool = False
    observer_rate: float = 0.0
    largest_error: float = 0.1
    leash: float = 0.1
    swing_speed: float = 0.05
    gain_ramp: float = 0.3

    def __post_init__(self) -> None:
        check_one_of("interface", self.interface, ("effort", "velocity", "position"))
        check_positive(
            period=self.period,
            joint_timeout=self.joint_timeout,
            target_timeout=self.target_timeout,
            wrench_timeout=self.wrench_timeout,
            largest_error=self.largest_error,
        )
        check_not_negative(swing_speed=self.swing_speed, gain_ramp=self.gain_ramp)


class Order(NamedTuple):
    """A command to a robot's controller.

    Attributes:
        values: (nv,) torques, rates or positions, by the interface.
        trouble: why the robot does not follow; empty if it does.
        contact: (6,) F_c, by the environment on the robot, N and N m, world axes at the point:
            measured, or estimated by the observer; zero if it does not follow.
        rates: (nv,) v_c that go with positions, rad/s or m/s; zero with torques.
    """

    values: Array
    trouble: str
    contact: Array
    rates: Array


@dataclass(slots=True)
class Counts:
    """Counts of events so far.

    Attributes:
        orders: given.
        followed: of these, in which the robot followed.
        engagements: of robot and target.
        joints_stale, target_stale, wrench_stale: orders without fresh samples, those with joint
            states too old for the rates included.
        slipped: times that the target was too far away.
        swings: oscillations about the target, each of which slowed the robot down.
        saturated: orders in which torque limits acted.
        leashed: orders in which the virtual robot was held back.
    """

    orders: int = 0
    followed: int = 0
    engagements: int = 0
    joints_stale: int = 0
    target_stale: int = 0
    wrench_stale: int = 0
    slipped: int = 0
    swings: int = 0
    saturated: int = 0
    leashed: int = 0

    def figures(self) -> Iterator[tuple[str, str]]:
        """Yield names and numbers, for diagnostics."""
        for name in self.__slots__:
            yield name, str(getattr(self, name))


class Follower:
    """Turns samples into commands of a robot's joints.

    Args:
        law: of the robot.
        settings: of it.
        sensor: corrects its wrenches; None: uncorrected.

    Attributes:
        counts: of events so far.

    Raises:
        InvalidInputError: rates of torques that the period alone is too long for, or that it does
            not allow the observer.
    """

    def __init__(
        self, law: OperationalLaw, settings: FollowerSettings, sensor: WrenchSensor | None = None
    ) -> None:
        self._law, self._settings = law, settings
        self._check_delay(Tuning(law.gains, settings.observer_rate))
        self._sensor = WrenchSensor() if sensor is None else sensor
        self.counts = Counts()
        self._tuning = Tuning(law.gains, settings.observer_rate)
        self._ramp: TuningRamp | None = None
        self._virtual = VirtualRobot(law, settings.period, settings.leash)
        self._observer = DisturbanceObserver(law.mechanism, settings.observer_rate, settings.period)
        self._watch = self._new_watch()
        nv = law.mechanism.nv
        self._q, self._v, self._joints_at = np.zeros(nv), np.zeros(nv), _NEVER
        self._pose, self._twist, self._target_at = pin.SE3.Identity(), _NOTHING, _NEVER
        self._wrench, self._wrench_at = _NOTHING, _NEVER
        self._held: Array | None = None
        self._clutch: Clutch | None = None
        self._state = VirtualState(self._q, self._v)
        self._before: RobotState | None = None
        self._torques = [np.zeros(nv), np.zeros(nv)]
        self._observed = Observed(np.zeros(nv), np.zeros(nv))
        self._mean_observed = np.zeros(nv)

    @property
    def follows(self) -> bool:
        """Whether the robot follows the target now."""
        return self._clutch is not None

    @property
    def tuning(self) -> Tuning:
        """Gains and the observer's rate as they are now."""
        return self._tuning.slowed(self.counts.swings)

    def tune(self, tuning: Tuning, now: float) -> None:
        """Change gains gradually, over ``gain_ramp``; a slowed robot stays slowed.

        Args:
            tuning: requested.
            now: s.

        Raises:
            InvalidInputError: an observer that begins or ends, or a rate that the period does not
                allow.
        """
        self.check_change(tuning)
        if tuning == (self._tuning if self._ramp is None else self._ramp.new):
            # A ramp to the present goal would reset the oscillation watch.
            return
        self._ramp = TuningRamp(now, self._settings.gain_ramp, self._tuning, tuning)

    def check_change(self, tuning: Tuning) -> None:
        """Check that gains can change while the robot follows.

        Without its estimate of friction and payload the robot would drop its load.

        Args:
            tuning: requested.

        Raises:
            InvalidInputError: an observer that begins or ends, or a rate that the period does not
                allow.
        """
        rate = checked_rate(tuning.observer_rate, self._settings.period)
        self._check_delay(tuning)
        if (self._tuning.observer_rate == 0.0) is not (rate == 0.0):
            rule = "must stay above 0" if rate == 0.0 else "must stay 0"
            raise InvalidInputError("observer_rate", rate, f"{rule} while the robot follows")

    def _check_delay(self, tuning: Tuning) -> None:
        """Refuse rates of torques that no joint states are new enough for."""
        period, longest = self._settings.period, longest_delay(tuning)
        if self._settings.interface == "effort" and longest <= period:
            rule = f"must allow a delay above one period, {period:g} s, not only {longest:g} s"
            raise InvalidInputError("linear_rate", tuning.gains.linear_rate, rule)

    def update_joints(self, q: Array, v: Array, time: float) -> None:
        """Take a sample of the joints.

        Args:
            q: (nv,) positions, rad or m.
            v: (nv,) rates, rad/s or m/s.
            time: of the sample, s.

        Raises:
            InvalidInputError: wrong size, NaN or infinity.
        """
        self._q, self._v = self._law.mechanism.check_state(q, v)
        self._joints_at = time

    def update_target(self, pose: pin.SE3, twist: Array, time: float) -> None:
        """Take a sample of the target.

        Args:
            pose: in its world.
            twist: (6,) m/s and rad/s, world axes at its point.
            time: of the sample, s.
        """
        self._pose, self._twist, self._target_at = pose, twist, time

    def update_wrench(self, wrench: Array, time: float, frame: str = "") -> None:
        """Take a sample of the wrench sensor, which is at the point.

        Args:
            wrench: (6,) as measured, on the robot, N and N m.
            time: of the sample, s.
            frame: whose axes it is given in: the point's if empty, or those of a link or of the
                robot's world. Samples in these are dropped until joint states were received.

        Raises:
            InvalidInputError: the robot has no such frame.
        """
        if frame not in ("", self._law.point):
            if self._joints_at == _NEVER:
                return
            given, own = (
                self._law.mechanism.frame_pose(self._q, n) for n in (frame, self._law.point)
            )
            wrench = turned(wrench, own.rotation.T @ given.rotation)
        self._wrench, self._wrench_at = wrench, time
        self._sensor.record(wrench)

    def tare(self) -> None:
        """Set the sensor's offset: its present measurement, less the tool's weight, is no contact.

        Raises:
            HapticMechError: no joint states, too few samples, or a robot that moves.
        """
        if self._joints_at == _NEVER:
            raise HapticMechError("no joint states have come")
        state = self._law.state(self._q, self._v)
        self._sensor.tare(state.point.pose.rotation, self._v)

    def let_go(self) -> None:
        """Follow no more, until all samples are fresh again."""
        self._clutch, self._before, self._held = None, None, None

    def last(self) -> Order | None:
        """Return the robot's last command, or None before joint states were received."""
        if self._joints_at == _NEVER:
            return None
        return self._stop("it has ended", self._law.resting(self._q))

    def order(self, now: float) -> Order | None:
        """Return the robot's command, or None before joint states were received.

        Args:
            now: s.

        Raises:
            HapticMechError: the robot's terms cannot be found where it is.
        """
        if self._joints_at == _NEVER:
            return None
        self.counts.orders += 1
        settings = self._settings
        self._pass_on(now)
        age, trouble = now - self._joints_at, ""
        if age > settings.joint_timeout:
            trouble = "joint states are stale"
        elif settings.interface == "effort" and age + settings.period > longest_delay(self.tuning):
            trouble = "joint states are too old for the rates"
        if trouble:
            self.counts.joints_stale += 1
            return self._stop(trouble, self._law.resting(self._q))
        state = self._law.state(self._q, self._v)
        if now - self._target_at > settings.target_timeout:
            self.counts.target_stale += 1
            return self._stop("the target is stale", self._law.braking(state))
        if settings.has_sensor and now - self._wrench_at > settings.wrench_timeout:
            self.counts.wrench_stale += 1
            return self._stop("the wrench sensor is stale", self._law.braking(state))
        target = self._target(self._clutch or self._engage(state), now)
        away = target.pose.translation - state.point.pose.translation
        if float(np.linalg.norm(away)) > settings.largest_error:
            self.counts.slipped += 1
            return self._stop("the target is too far away", self._law.braking(state))
        if self._swings(state, target, now):
            return self._stop("the robot swings", self._law.braking(state))
        self.counts.followed += 1
        return self._follow(state, target)

    def _swings(self, state: RobotState, target: Target, now: float) -> bool:
        """Return whether the robot has oscillated too often; slow it down when it does."""
        settings = self._settings
        if self.counts.swings > SLOWEST:
            return True
        # Without an observer no payload makes it oscillate.
        if 0.0 in (settings.swing_speed, self._tuning.observer_rate):
            return False
        if not self._watch.swings(state.point.twist - target.twist, now):
            return False
        self.counts.swings += 1
        self._before = state
        self._adopt(self._mean_observed)
        self._watch = self._new_watch()
        return self.counts.swings > SLOWEST

    def _pass_on(self, now: float) -> None:
        """Let gains be those of now."""
        if self._ramp is None:
            return
        self._tuning = self._ramp.at(now)
        self._adopt(self._observed.disturbance)
        if self._tuning is self._ramp.new:
            self._ramp, self._watch = None, self._new_watch()

    def _adopt(self, disturbance: Array) -> None:
        """Go on with the tuning as it is, and with an estimate (nv,), N m or N."""
        tuning, settings = self.tuning, self._settings
        self._law = self._law.with_gains(tuning.gains)
        self._virtual = VirtualRobot(self._law, settings.period, settings.leash)
        self._observer = self._observer.with_rate(tuning.observer_rate)
        if self._before is not None:
            self._observed = self._observer.begin(self._before, disturbance)

    def _stop(self, trouble: str, torque: Array) -> Order:
        """Return the order of a robot that does not follow."""
        if self._held is None:
            self.let_go()
            self._held = self._q.copy()
        values = {"effort": torque, "velocity": np.zeros_like(self._q), "position": self._held}
        return Order(values[self._settings.interface], trouble, _NOTHING, np.zeros_like(self._q))

    def _new_watch(self) -> SwingWatch:
        """Return a watch for the law as it is; one that never ends its window without a rate."""
        rate = max(self._law.gains.linear_rate, 1.0)
        return SwingWatch(self._settings.swing_speed, self._law.lever, WINDOW / rate)

    def _engage(self, state: RobotState) -> Clutch:
        """Engage with the target at both present poses."""
        self.counts.engagements += 1
        self._held = None
        self._clutch = clutch = engage(0.0, self._pose, state.point.pose)
        self._state = self._virtual.at_rest(self._q)
        self._before = None
        self._watch.begin()
        # Of the last two orders: one acts over a period that begins when it has been sent.
        self._torques = [state.bias_force, state.bias_force]
        return clutch

    def _follow(self, state: RobotState, target: Target) -> Order:
        rotation = state.point.pose.rotation
        measured = turned(self._sensor.contact(self._wrench, rotation), rotation)
        contact = measured if self._settings.has_sensor else _NOTHING
        felt = contact
        if self._tuning.observer_rate:
            self._observe(state, contact)
            if self._settings.has_sensor:
                state = balanced(state, self._observed)
            else:
                felt = self._estimated(state)
        if self._settings.interface == "effort":
            command = self._law.command(state, target, contact)
            self._torques = [self._torques[1], command.torque]
            self.counts.saturated += command.limited.saturated
            return Order(command.torque, "", felt, np.zeros_like(self._q))
        setpoint, self._state = self._virtual.next(self._state, self._q, target, contact)
        self.counts.saturated += setpoint.command.limited.saturated
        self.counts.leashed += setpoint.leashed
        is_velocity = self._settings.interface == "velocity"
        values = setpoint.velocity if is_velocity else self._state.q
        return Order(values, "", felt, self._state.v)

    def _target(self, clutch: Clutch, now: float) -> Target:
        """Return the target now: its last sample, carried on by its twist."""
        later = max(now - self._target_at, 0.0)
        turn = pin.exp3(later * self._twist[3:])
        place = self._pose.translation + later * self._twist[:3]
        return Target(clutch.mapped(pin.SE3(turn @ self._pose.rotation, place)), self._twist)

    def _observe(self, state: RobotState, contact: Array) -> None:
        if self._before is None:
            self._observed = self._observer.begin(state)
            self._mean_observed = np.zeros_like(state.v)
        elif self._before is not state:
            self._observed = self._observer.next(
                self._observed, self._before, self._torques[0], contact, state
            )
        # Over the window of the watch.
        share = self._settings.period * self._law.gains.linear_rate / WINDOW
        self._mean_observed += share * (self._observed.disturbance - self._mean_observed)
        self._before = state

    def _estimated(self, state: RobotState) -> Array:
        """Return the contact wrench (6,) that explains the disturbance: Λ⁺ J D⁻¹ r."""
        moving = dtrsv(state.factor, self._observed.disturbance, lower=1)
        moving = dtrsv(state.factor, moving, lower=1, trans=1)
        return np.asarray(state.shaped.inverse @ (state.point.jacobian @ moving))
