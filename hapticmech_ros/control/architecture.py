# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: the three controllers joined, from measurements to the wrenches of both sides.

Four-channel teleoperation controller (Lawrence; Hashtrudi-Zaad and Salcudean).

On the device, and on the mechanism:

    Λ_d ẍ = Λ_d X ((1 + C6) F_h + C2 F_c) + ... - C4 (1 - Π) C e
    f     = C3 F_h + C5 F_c + C1 C e

Force channels carry the contact wrench to the hand (C2) and the hand's wrench to the mechanism
(C3). Position channels, a spring and damper C = C_m = C_s, pull operational point and device
together; on the device's side only in the range of X, since the joint-constraint controller has
the rest. C1 and C4 are shares of C: a local controller goes with its channel. C5 and C6 are local
force feedback. Both sides move alike, which is transparency, where C2 = 1 + C5 = C3 = 1 + C6 and
C1 = C4 = 1; then the mechanism feels 1 / (1 + C6) times as heavy.

With a connection whose round trip takes τ, C's bandwidth ω on the device is held to ω τ <= 0.3: a
factor scales its damping, and the factor's square its stiffness, which keeps the damping ratio. The
mechanism's side closes its loop without the connection, and keeps C.

Gains go from one set to another without a bump.

A user's own control law is a function from measurements to the wrenches of both sides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.clutch import Clutch, engage, pose_error
from hapticmech_ros.control.kernels import answer_measurements
from hapticmech_ros.control.loop_layout import BRAKE, ControllerSettings, ControlWrenches
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    InFlight,
    OperationalModel,
    PointMeasurement,
    device_of,
    flat_device,
    flat_operational_model,
    model_of,
    point_ahead,
    predicted_twist,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import (
    DeviceSample,
    OperationalModelSample,
)
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.numerics.saturation import limited
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import (
    DESIGN_PHASE_LAG,
    Controller,
    PositionChannelGains,
)
from hapticmech_ros.scene.part import Part


class PositionChannels:
    """Spring and damper of the position channels.

    Args:
        position: C.
        inertia: (6,) diagonal of Λ_d, kg and kg m².
        lag: s, from measuring to acting, there and back.

    Attributes:
        stiffness, damping: (6,) of C, N/m, N m/rad and N s/m, N m s/rad.
        held_stiffness, held_damping: (6,) of it as it acts on the device.
    """

    def __init__(self, position: PositionChannelGains, inertia: Array, lag: float) -> None:
        stiffness = np.array([position.stiffness] * 3 + [position.angular_stiffness] * 3)
        damping = np.array([position.damping] * 3 + [position.angular_damping] * 3)
        share = bandwidth_factor(stiffness, damping, inertia, lag)
        self.stiffness, self.damping = stiffness, damping
        self.held_stiffness, self.held_damping = share**2 * stiffness, share * damping


def bandwidth_factor(stiffness: Array, damping: Array, inertia: Array, lag: float) -> Array:
    """Return the factor (6,) that keeps ω τ and its damper's phase lag within 0.3 rad.

    ω and damping are multiplied by it, stiffness by its square.

    Args:
        stiffness: (6,) of C, N/m and N m/rad.
        damping: (6,) of C, N s/m and N m s/rad.
        inertia: (6,) diagonal of Λ_d, kg and kg m².
        lag: τ, s.
    """
    pace = np.maximum(np.sqrt(stiffness / inertia), damping / inertia)
    return np.asarray(DESIGN_PHASE_LAG / np.maximum(pace * lag, DESIGN_PHASE_LAG))


P = TypeVar("P", bound=Part)


class GainRamp(NamedTuple):
    """Linear interpolation of all gains from old to new ones over the new ones' ``gain_ramp``.

    A spring that becomes stiffer while it is stretched takes up energy: the ledger records it, and
    passivity control does not let the device give it.

    Attributes:
        start: s.
        old, new: gains before and after.
        old_delay, new_delay: one-way delays (s) that they are for.
    """

    start: float
    old: Controller
    new: Controller
    old_delay: float = 0.0
    new_delay: float = 0.0

    def at(self, time: float) -> tuple[Controller, bool]:
        """Return the gains of ``time`` (s), and whether they are the new ones."""
        share = self._share(time)
        if share >= 1.0:
            return self.new, True
        return blended(self.old, self.new, share), False

    def delay_at(self, time: float) -> float:
        """Return the one-way delay (s) that the gains of ``time`` (s) are for."""
        share = min(self._share(time), 1.0)
        return self.old_delay * (1.0 - share) + self.new_delay * share

    def _share(self, time: float) -> float:
        ramp = self.new.gain_ramp
        return max((time - self.start) / ramp, 0.0) if ramp > 0.0 else 1.0


def blended(old: P, new: P, share: float) -> P:
    """Return a part with numbers interpolated from old to new; other values are the new ones."""
    changed = {}
    for name in type(new).model_fields:
        before, after = getattr(old, name), getattr(new, name)
        if isinstance(after, Part):
            changed[name] = blended(before, after, share)
        elif isinstance(after, float) and before != after:
            changed[name] = before + share * (after - before)
    return new.model_copy(update=changed)


# A ramp is no longer than so many of those of a start at rest.
LONGEST_RAMP = 6.0


class ControlArchitecture:
    """The controllers of a scene; one kernel computes a control period.

    It holds gains only; the :class:`Clutch` holds the state. :meth:`tune` changes gains gradually
    while it renders. Measurements are flat arrays, see :mod:`~hapticmech_ros.control.measurements`.

    A user's own control law is a function (:func:`control_for`), or, for more, a subclass that
    overrides :meth:`answer`; ``super().answer`` is the scene's. Its owner
    (:class:`~hapticmech_ros.session.session.Session` or the rendering controller) then calls it in
    Python for each sample that the controllers get, and does the rest as always: account,
    passivity, connection, and the loops that the device closes, which correct the answer by the
    scene's gains unless these disable local loops. Such a law

    - takes arrays that it does not change, and returns wrenches (6, 6), rows as in
      :class:`ControlOutput`: the first acts on the hand, the second on the mechanism, the account
      reads the error in the last one;
    - keeps the limits (:func:`~hapticmech_ros.numerics.saturation.limited`) and the ramps of a new
      engagement (:meth:`Clutch.ramp` for springs and dampers, :meth:`Clutch.force_ramp` for what
      follows from measured forces), and adds the wrench carried on from another grasp
      (:meth:`joined`);
    - calls :meth:`apply_gains_at` before it reads ``gains``, which :meth:`tune` changes.

    docs/feel.md has an example.

    Attributes:
        answers_in_python: whether :meth:`answer` is overridden by a law in Python.
        task: (6,) 1 for rows of a six-vector that the task space has, else 0.
        limits: N and N m, of the device.
        device_inertia: (6, 6) Λ_d, kg and kg m², at the point held.
        gains: the present ones.
        channels: spring and damper of the position channels with them.
        delay: one-way delay (s) that the gains are for.
    """

    answers_in_python: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "answer" in vars(cls):
            cls.answers_in_python = True

    def __init__(self, scene: Scene) -> None:
        self.limits = (scene.device.force_limit, scene.device.torque_limit)
        self.device_inertia = np.diag(scene.device.inertias)
        self.acts = np.array(scene.device.acts)
        self.delay = scene.connection.designed
        self._period = scene.simulation.period
        self.task = np.zeros(6)
        self.task[list(scene.task_rows)] = 1.0
        self._gain_ramp: GainRamp | None = None
        self._settings = ControllerSettings()
        self._settings.fill(
            task=self.task,
            inertia=scene.device.inertias,
            force_limit=self.limits[0],
            torque_limit=self.limits[1],
        )
        self._clutch: Clutch | None = None
        self.apply_gains(scene.controller)

    def apply_gains(self, gains: Controller, delay: float | None = None) -> None:
        """Set gains, for a one-way delay (s), at once; while it renders, that is a bump."""
        self.delay = self.delay if delay is None else delay
        self.gains = gains
        lag = 2.0 * self.delay + 1.5 * self._period
        joint, force, position = gains.joint_constraint, gains.force_channel, gains.position_channel
        self.channels = PositionChannels(position, np.diag(self.device_inertia), lag)
        self._settings.fill(
            stiffness=self.channels.stiffness,
            damping=self.channels.damping,
            held_stiffness=self.channels.held_stiffness,
            held_damping=self.channels.held_damping,
            feedforward=joint.feedforward,
            joint_stiffness=joint.stiffness,
            joint_damping=joint.damping,
            joint_force_limit=joint.force_limit,
            joint_torque_limit=joint.torque_limit,
            c1=position.to_mechanism,
            c2=force.contact,
            c3=force.hand,
            c4=position.to_device,
            c5=force.mechanism_feedback,
            c6=force.device_feedback,
        )

    def settings_at(self, time: float, clutch: Clutch) -> Array:
        """Return the controllers' settings at ``time`` (s) as an array (59,) for kernels.

        It is the same array each time, a
        :class:`~hapticmech_ros.control.loop_layout.ControllerSettings`.
        """
        self.apply_gains_at(time)
        if clutch is not self._clutch:
            self._clutch = clutch
            turn = pin.Quaternion(quaternion_of(clutch.turn))
            # An identity rotation becomes exactly that.
            turn.normalize()
            self._settings.fill(
                ramp=clutch.duration,
                carries=clutch.carried is not None,
                engaged_at=clutch.time,
                displacement=clutch.displacement,
                turn=turn.coeffs(),
            )
        return self._settings.values

    def tune(self, time: float, gains: Controller, delay: float | None = None) -> None:
        """Interpolate linearly to other gains from ``time`` (s) on, over their ``gain_ramp``.

        Args:
            time: s.
            gains: the other ones.
            delay: one-way delay (s) that they are for; as before if left out.
        """
        delay = self.aim[1] if delay is None else delay
        self._gain_ramp = GainRamp(time, self.gains, gains, self.delay, delay)

    @property
    def aim(self) -> tuple[Controller, float]:
        """The present gains, or a ramp's last ones, and the one-way delay (s) they are for."""
        ramp = self._gain_ramp
        return (self.gains, self.delay) if ramp is None else (ramp.new, ramp.new_delay)

    @property
    def is_ramping(self) -> bool:
        """Whether a ramp is changing the gains."""
        return self._gain_ramp is not None

    def apply_gains_at(self, time: float) -> None:
        """Take the gains of ``time`` (s), if they are passing to others."""
        if self._gain_ramp is not None:
            gains, arrived = self._gain_ramp.at(time)
            self.apply_gains(gains, self._gain_ramp.delay_at(time))
            if arrived:
                self._gain_ramp = None

    def engage(
        self,
        time: float,
        device: Array,
        operational_model: Array,
        ahead: float,
        carried: Array | None = None,
    ) -> Clutch:
        """Return the clutch, engaged at the present poses.

        It closes over ``engagement_ramp`` at a start, or longer if it has to brake more; over
        ``grasp_ramp`` if a grasp changes.

        Args:
            time: s.
            device: (19,) the device's sample, in SI units; see ``layout.DeviceSample``.
            operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
            ahead: as in :meth:`answer`.
            carried: (6,) the device's wrench until now, if it held the mechanism elsewhere; N and
                N m, world axes.
        """
        own, point = device_of(device), point_ahead(operational_model, ahead)
        gains = self.gains
        if carried is not None:
            return engage(time, own.pose, point.pose, gains.grasp_ramp, carried)
        apart = (self.task * (own.twist - OperationalModelSample(operational_model).twist))[:3]
        momentum = float(self.device_inertia[0, 0] * np.sqrt(apart @ apart))
        return engage(time, own.pose, point.pose, _start_ramp(gains, momentum))

    def with_slip(
        self, time: float, clutch: Clutch, device: Array, operational_model: Array
    ) -> Clutch:
        """Return the clutch to use at ``time`` (s); see :meth:`Clutch.with_slip`.

        Args:
            time: s.
            clutch: the one until now.
            device: (19,) the device's sample, in SI units; see ``layout.DeviceSample``.
            operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
        """
        if not clutch.is_closing:
            return clutch
        own, twist = device_of(device), OperationalModelSample(operational_model).twist
        return clutch.with_slip(time, own.pose, own.twist, twist)

    def compute(
        self,
        time: float,
        clutch: Clutch,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: OperationalModel,
        in_flight: InFlight | None = None,
    ) -> ControlOutput:
        """Return the wrenches for measurements at ``time`` (s); see :meth:`answer`.

        Args:
            time: s.
            clutch: that connects the two poses.
            device: its measurement.
            point: that of the operational point.
            model: what the analysis reports.
            in_flight: what of earlier commands to the mechanism has not acted yet.
        """
        own, operational_model = flat_device(device), flat_operational_model(model, point)
        return ControlOutput(*self.answer(time, clutch, own, operational_model, 0.0, in_flight))

    def answer(
        self,
        time: float,
        clutch: Clutch,
        device: Array,
        operational_model: Array,
        ahead: float,
        in_flight: InFlight | None = None,
    ) -> Array:
        """Return the wrenches for measurements, (6, 6): rows and units of :class:`ControlOutput`.

        Args:
            time: s.
            clutch: that connects the two poses.
            device: (19,) the device's sample, in SI units; see ``layout.DeviceSample``.
            operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
            ahead: s, from the time of ``operational_model`` to that of ``device``; the point's pose
                is extrapolated by its twist for as long.
            in_flight: what of earlier commands to the mechanism has not acted yet, for a device
                that corrects commands by itself; see
                :func:`~hapticmech_ros.control.measurements.point_ahead`.

        Raises:
            InvalidInputError: an array of another size.
        """
        sizes, known = (
            (device.size, operational_model.size),
            (DeviceSample.layout, OperationalModelSample.layout),
        )
        if sizes != (known[0].size, known[1].size):
            rule = f"must be {known[0].size} and {known[1].size}"
            raise InvalidInputError("numbers of device and rendering", sizes, rule)
        settings = ControllerSettings(self.settings_at(time, clutch))
        seen = OperationalModelSample(operational_model)
        if in_flight is not None:
            seen = OperationalModelSample(operational_model.copy())
            seen.twist[:] = predicted_twist(seen, in_flight)
            ahead += in_flight.duration
        out = ControlWrenches()
        answer_measurements(settings, DeviceSample(device), seen, time, ahead, out)
        out.on_hand[:] = self.joined(time, clutch, out.on_hand)
        return out.values.reshape(6, 6)

    def joined(self, time: float, clutch: Clutch, wrench: Array) -> Array:
        """Return the device's wrench (6,) with the rest of that carried on from another grasp.

        Args:
            time: s.
            clutch: that connects the two poses.
            wrench: (6,) of the controllers, N and N m, world axes.
        """
        if clutch.carried is None:
            return wrench
        return limited(wrench + clutch.faded(time), *self.limits)


def _start_ramp(gains: Controller, momentum: float) -> float:
    """Return the duration of a start's ramp, s.

    Args:
        gains: with the ramp of a start at rest, and the force that brakes.
        momentum: of the device, relative to the operational point, N s.
    """
    ramp = gains.engagement_ramp
    longer = 2.0 * BRAKE * momentum / gains.engagement_force
    return ramp if longer <= ramp else min(longer, LONGEST_RAMP * ramp)


@dataclass(frozen=True, slots=True)
class LawInput:
    """A sample's measurements, as a control law gets them; world axes.

    Attributes:
        time: s.
        device: pose, twist (6,) and F_h (6,) of the device.
        point: pose, twist (6,) and F_c (6,) of the operational point, at the device's time.
        model: X, P_c, Π (6, 6) and a_0 (6,) of the operational point.
        error: (6,) e, from the operational point to the device's pose as the clutch maps it, m and
            rad; zero out of the task space.
        rate: (6,) ė, twist of the device less that of the point, m/s and rad/s; zero likewise.
    """

    time: float
    device: DeviceMeasurement
    point: PointMeasurement
    model: OperationalModel
    error: Array
    rate: Array


class ControlLaw(Protocol):
    """A user's own control law: a function of the measurements."""

    def __call__(self, seen: LawInput, /) -> tuple[Array, Array]:
        """Return the wrenches of a period.

        Args:
            seen: the measurements.

        Returns:
            (6,) on the hand by the device, and (6,) on the mechanism by the hand; N and N m, world
            axes.
        """
        ...


class LawControl(ControlArchitecture):
    """Controllers whose wrenches are those of a law; see :func:`control_for`."""

    def __init__(self, scene: Scene, law: ControlLaw) -> None:
        super().__init__(scene)
        self._law = law

    def apply_gains(self, gains: Controller, delay: float | None = None) -> None:
        """Set gains without any that the device corrects by."""
        super().apply_gains(gains.closed_in_device(False), delay)

    def answer(
        self,
        time: float,
        clutch: Clutch,
        device: Array,
        operational_model: Array,
        ahead: float,
        in_flight: InFlight | None = None,
    ) -> Array:
        """Return the wrenches for measurements, (6, 6): rows and units of :class:`ControlOutput`.

        Args:
            time: s.
            clutch: that connects the two poses.
            device: (19,) the device's sample, in SI units; see ``layout.DeviceSample``.
            operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
            ahead: s, from the time of ``operational_model`` to that of ``device``.
            in_flight: commands to the mechanism that have not acted yet.

        Raises:
            InvalidInputError: a wrench of the law that is none, or not finite.
        """
        own, point = device_of(device), point_ahead(operational_model, ahead, in_flight)
        error = self.task * pose_error(point.pose, clutch.mapped(own.pose))
        rate = self.task * (own.twist - point.twist)
        seen = LawInput(time, own, point, model_of(operational_model), error, rate)
        on_hand, on_mechanism = (clutch.ramp(time) * one for one in _checked(self._law(seen)))
        found = ControlWrenches()
        found.fill(
            on_hand=self.joined(time, clutch, limited(self.task * on_hand, *self.limits)),
            on_mechanism=limited(self.task * on_mechanism, *self.limits),
            error=error,
        )
        return found.values.reshape(6, 6)


def control_for(scene: Scene, law: ControlLaw) -> ControlArchitecture:
    """Return controllers with a user's own law in place of the scene's three.

    ``Session(scene, control=control_for(scene, law))``. Wrenches of the law are kept within the
    device's limits and the task space, and grow over the ramp of each engagement. The device
    corrects none of them. Passivity control, energies, the connection and the safety envelope are
    the scene's.

    Args:
        scene: whose device, limits, ramps and task space are used.
        law: called once for each sample that the controllers get.
    """
    return LawControl(scene, law)


def _checked(wrenches: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return a law's wrenches.

    Raises:
        InvalidInputError: they are not two of (6,), or not finite.
    """
    found = np.asarray(wrenches, dtype=float)
    if found.shape != (2, 6) or not np.isfinite(found).all():
        rule = "must be two finite wrenches (6,): on the hand, and on the mechanism"
        raise InvalidInputError("wrenches of the control law", found.tolist(), rule)
    return found[0], found[1]
