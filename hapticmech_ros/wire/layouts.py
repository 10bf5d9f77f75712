# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Layouts of the Float64MultiArray messages that carry more than one matrix.

Names and sizes of the fields go into the messages' layout labels, so that a bag can be read without
this package. ``device/local_feedback_gain`` says how commands depend on the device, for its own
loop; ``transmission`` and ``device/coupling_gain`` what other hands do to a point and its device.

Energies of mechanism, device and controller are those of ``.../energy``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.control import DeviceMeasurement, OperationalModel, PointMeasurement
from hapticmech_ros.control.measurements import (
    device_of,
    flat_device,
    flat_operational_model,
    model_of,
    place_of,
    point_of,
)
from hapticmech_ros.control.rendering_controller import LedgerEntry
from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import GRASP_SIZE
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import (
    DEVICE_SAMPLE,
    OPERATIONAL_MODEL,
    SECONDS,
    WRENCH,
    Field,
    Layout,
)
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.simulation import MechanismState
from hapticmech_ros.wire.bounds import Bounds, bounds_of, check_unit
from hapticmech_ros.wire.stamped import seconds_of, stamp_of

# Seconds and nanoseconds, as two numbers, to lose no bit.
STAMP = Field(2, SECONDS)
GRASP_FIELD = Field(GRASP_SIZE, ("link", *("position",) * 3, *("angle",) * 3))
FLAG = Field(1, ("flags",))
OPERATIONAL_MODEL_FIELDS = Layout(
    {
        "stamp": STAMP,
        "count": Field(1, ("count",)),
        "directions": Field(1, ("count",)),
        **OPERATIONAL_MODEL.fields,
        "commanded": FLAG,
        "grasp": GRASP_FIELD,
    }
)
DEVICE_FIELDS = Layout(
    {
        "stamp": STAMP,
        **DEVICE_SAMPLE.fields,
        "applied": Field(6, WRENCH),
        "round_trip": Field(1, ("duration",)),
        "obeys": FLAG,
    }
)
# Older versions ended before ``round_trip``; what is to be read there.
_OLD_DEVICE_SIZE, _NOT_TOLD = DEVICE_FIELDS.start("round_trip"), (0.0, 1.0)
DEVICE_MEASURED = DEVICE_FIELDS.slice("position", "hand_wrench")
_APPLIED = DEVICE_FIELDS.slice("applied")
ROUND_TRIP, OBEYS = DEVICE_FIELDS.start("round_trip"), DEVICE_FIELDS.start("obeys")
POINT_MODEL_PART, GRASP = (
    OPERATIONAL_MODEL_FIELDS.slice("s", "contact"),
    OPERATIONAL_MODEL_FIELDS.slice("grasp"),
)
COMMANDED = OPERATIONAL_MODEL_FIELDS.start("commanded")
_COUNT, _DIRECTIONS = (
    OPERATIONAL_MODEL_FIELDS.start("count"),
    OPERATIONAL_MODEL_FIELDS.start("directions"),
)
_S = OPERATIONAL_MODEL_FIELDS.start("s")
ENERGY_FIELDS = Layout(
    {
        "stamp": STAMP,
        **dict.fromkeys(
            ("kinetic", "potential", "work_in", "damping_loss", "latch_loss", "closure_error"),
            Field(1),
        ),
        **dict.fromkeys(("surplus", "refined", "inaccurate"), Field(1)),
    }
)
ENERGY_NAMES = tuple(ENERGY_FIELDS)[1:]


@dataclass(frozen=True, slots=True)
class OperationalModelMessage:
    """A decoded ``operational_model`` message.

    Attributes:
        stamp_ns: time it stands for, ns.
        count: joint constraints reported.
        s: (t,) sqrt(μ), descending.
        model: what the controllers use of the analysis.
        point: the operational point's pose, twist and contact wrench at the same time.
        commanded: whether the mechanism heard the controller's commands then, and acted on them.
        grasp: (7,) where the operational point is; see :func:`~.mechanism.grasp.flat_grasp`.
    """

    stamp_ns: int
    count: int
    s: Array
    model: OperationalModel
    point: PointMeasurement
    commanded: bool
    grasp: Array


@dataclass(frozen=True, slots=True)
class Energy:
    """A decoded ``energy`` message: time (ns); energies in J; closure error in m or rad.

    The last three are as in :class:`~hapticmech_ros.simulation.EnergyAccount`.
    """

    stamp_ns: int
    kinetic: float
    potential: float
    work_in: float
    damping_loss: float
    latch_loss: float
    closure_error: float
    surplus: float = 0.0
    refined: float = 0.0
    inaccurate: float = 0.0

    @property
    def balance(self) -> float:
        """Energy now, less what came in, plus what was lost, J; constant if nothing leaks."""
        held = self.kinetic + self.potential
        return held - self.work_in + self.damping_loss + self.latch_loss


class DeviceSample(NamedTuple):
    """A decoded ``device/state`` message.

    Attributes:
        stamp_ns: time it stands for, ns.
        measured: pose, twist and hand wrench.
        applied: (6,) by the actuators, on the hand, until now; zero when servo_cf is lost.
        round_trip: s, from a sample to its answer, as the device finds it; 0: not known.
        obeys: whether it obeys servo_cf; what does not is not told, and counts as if it did.
    """

    stamp_ns: int
    measured: DeviceMeasurement
    applied: Array
    round_trip: float = 0.0
    obeys: bool = True


def pack_device(sample: DeviceSample) -> Array:
    """Return the data (29,) of a ``device/state`` message."""
    stamp = seconds_of(sample.stamp_ns)
    measured = flat_device(sample.measured)
    reported = sample.round_trip, float(sample.obeys)
    return np.concatenate((stamp, measured, sample.applied, reported))


def unpack_device(data: object) -> DeviceSample:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp_ns, values = checked_values(whole_device(np.array(data, dtype=float)), _DEVICE)
    measured, obeys = device_of(values[DEVICE_MEASURED]), bool(values[OBEYS])
    return DeviceSample(stamp_ns, measured, values[_APPLIED], float(values[ROUND_TRIP]), obeys)


def whole_device(values: Array) -> Array:
    """Return a ``device/state`` message's data (n,); an older version's, completed.

    Args:
        values: (n,) the data.
    """
    return np.append(values, _NOT_TOLD) if values.shape == (_OLD_DEVICE_SIZE,) else values


def pack_operational_model(message: OperationalModelMessage) -> Array:
    """Return the message's data (151,)."""
    head = (*seconds_of(message.stamp_ns), message.count, message.s.size)
    operational_model = flat_operational_model(message.model, message.point)
    operational_model[: message.s.size] = message.s
    return np.concatenate((head, operational_model, (message.commanded,), message.grasp))


def unpack_operational_model(data: object) -> OperationalModelMessage:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp_ns, values = checked_values(data, _OPERATIONAL_MODEL)
    operational_model = values[POINT_MODEL_PART]
    return OperationalModelMessage(
        stamp_ns,
        int(values[_COUNT]),
        values[_S : _S + int(values[_DIRECTIONS])],
        model_of(operational_model),
        point_of(operational_model),
        bool(values[COMMANDED]),
        values[GRASP],
    )


def pack_energy(energy: Energy) -> Array:
    """Return the message's data (11,)."""
    values = (getattr(energy, name) for name in ENERGY_NAMES)
    return np.array((*seconds_of(energy.stamp_ns), *values))


def unpack_energy(data: object) -> Energy:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp_ns, values = checked_values(data, _ENERGY)
    return Energy(stamp_ns, *map(float, values[STAMP.size :]))


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """Return the pose of a position (3,), m, and a quaternion (4,), x, y, z, w.

    Args:
        position: (3,) m.
        quaternion: (4,) x, y, z, w.

    Raises:
        InvalidInputError: a quaternion off unit length by more than 1e-3.
    """
    check_unit(quaternion)
    return place_of(np.concatenate((position, quaternion)))


def device_bounds(limits: Limits | None = None) -> Bounds:
    """Return the bounds of ``device/state``; of finite numbers where no scene is known."""
    return bounds_of("device state", DEVICE_FIELDS, limits)


def operational_model_bounds(limits: Limits | None = None) -> Bounds:
    """Return the bounds of ``operational_model``; of finite numbers where no scene is known."""
    return bounds_of("operational_model", OPERATIONAL_MODEL_FIELDS, limits)


def checked_values(data: object, bounds: Bounds) -> tuple[int, Array]:
    """Return the stamp (ns) of a message's data, and the data as an array of their own (n,).

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    values = np.array(data, dtype=float)
    return bounds.stamp(values), values


_DEVICE, _OPERATIONAL_MODEL = device_bounds(), operational_model_bounds()
_ENERGY = bounds_of("energy", ENERGY_FIELDS)


class DeviceWriter:
    """A ``device/state`` message's data, written anew for each state of the device.

    What :func:`~hapticmech_ros.wire.layouts.pack_device` returns, without the objects between.

    Attributes:
        values: (29,) the data.
        hand_wrench: (6,) F_h of the state seen last, with what others added, N and N m, world
            axes; a view.
    """

    def __init__(self) -> None:
        self.values: Array = np.zeros(DEVICE_FIELDS.size)
        self.hand_wrench: Array = self.values[DEVICE_FIELDS.slice("hand_wrench")]
        self._published = self.values[DEVICE_FIELDS.slice("position", "applied")]

    def encode(
        self,
        state: DeviceState,
        push: Array,
        stamp_ns: int,
        round_trip: float = 0.0,
        obeys: bool = True,
    ) -> None:
        """Write a state.

        Args:
            state: of the device.
            push: (6,) by others, added to the hand's wrench; N and N m, world axes.
            stamp_ns: ns.
            round_trip: s, from a sample to its answer; 0: not known.
            obeys: whether the device obeys servo_cf.
        """
        self.values[0], self.values[1] = seconds_of(stamp_ns)
        self._published[:] = state.published
        self.values[ROUND_TRIP], self.values[OBEYS] = round_trip, obeys
        if push is not NO_WRENCH:
            self.hand_wrench += push


GAIN_FIELDS = Layout(
    {
        "stamp": STAMP,
        "answered": STAMP,
        "to_mechanism": Field(1, ("energy",)),
        "force": Field(36, ("ratio",)),
        "stiffness": Field(36, ("stiffness",)),
        "damping": Field(36, ("damping",)),
    }
)
_ANSWERED, _MODEL = GAIN_FIELDS.slice("answered"), GAIN_FIELDS.slice("force", "damping")
_TO_MECHANISM = GAIN_FIELDS.start("to_mechanism")


class LocalFeedbackGain(NamedTuple):
    """A decoded ``device/local_feedback_gain`` message.

    Attributes:
        stamp_ns: of the command that it goes with, ns.
        answered_ns: of the device's sample that this command answers, ns.
        to_mechanism: E_m, J: what the mechanism has got through its point.
        model: (108,) G, K and B, row by row.
    """

    stamp_ns: int
    answered_ns: int
    to_mechanism: float
    model: Array


def pack_gain(gain: LocalFeedbackGain) -> Array:
    """Return the data (113,) of a ``device/local_feedback_gain`` message."""
    stamps = *seconds_of(gain.stamp_ns), *seconds_of(gain.answered_ns)
    return np.concatenate(((*stamps, gain.to_mechanism), gain.model))


def gain_bounds(limits: Limits | None = None) -> Bounds:
    """Return the bounds of ``local_feedback_gain``; of finite numbers where no scene is known."""
    return bounds_of("gain", GAIN_FIELDS, limits)


_ANY = gain_bounds()


def unpack_gain(data: object, bounds: Bounds = _ANY) -> LocalFeedbackGain:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp, values = checked_values(data, bounds)
    answered = stamp_of(*values[_ANSWERED].tolist())
    return LocalFeedbackGain(stamp, answered, float(values[_TO_MECHANISM]), values[_MODEL])


_SQUARE = Field(36, ("ratio",))


class CouplingMatrices(NamedTuple):
    """A decoded message.

    Attributes:
        stamp_ns: of the mechanism's state, ns; of ``coupling_gain``, that of the device's sample
            that its command answers.
        by_point: (6, 6) by operational point that another hand holds: Y_ij, or H_j; 1, m and 1/m.
    """

    stamp_ns: int
    by_point: Mapping[str, Array]


class CouplingWire:
    """Layout of both messages: a stamp, and a matrix per other operational point.

    Args:
        others: operational points, in the scene's order.
        limits: of the scene.

    Attributes:
        fields: of the messages.
        bounds: of their numbers.
    """

    def __init__(self, others: Iterable[str], limits: Limits) -> None:
        self._others = tuple(others)
        matrices = dict.fromkeys(self._others, _SQUARE)
        self.fields = Layout({"stamp": STAMP, **matrices})
        self.bounds: Bounds = bounds_of("coupling", self.fields, limits)

    def pack(self, found: CouplingMatrices) -> Array:
        """Return a message's data (n,); zero for a point that ``by_point`` has not."""
        values = np.zeros(self.fields.size)
        values[:2] = seconds_of(found.stamp_ns)
        for name, matrix in found.by_point.items():
            values[self.fields.slice(name)] = matrix.ravel()
        return values

    def unpack(self, data: object) -> CouplingMatrices:
        """Return the decoded message, without matrices that are zero.

        Raises:
            InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
        """
        stamp, values = checked_values(data, self.bounds)
        parts = {name: values[self.fields.slice(name)] for name in self._others}
        matrices = {name: part.reshape(6, 6) for name, part in parts.items() if part.any()}
        return CouplingMatrices(stamp, matrices)


# J. What passivity control makes available may be infinite: told as finite, and bounded by that.
_JOULES = Field(1)
CONTROLLER_ENERGY_FIELDS = Layout({"stamp": STAMP, **dict.fromkeys(LedgerEntry._fields, _JOULES)})
# Told as available where nothing is held back.
UNLIMITED = 1e30


class DeviceEnergy(NamedTuple):
    """A decoded ``device/energy`` message, J since the hand took hold.

    Attributes:
        stamp_ns: ns.
        from_hand: E_h, what the hand has put in.
        taken_by_actuators: W, work that they have taken from the device.
        to_mechanism: E_m, as far as the device knows it.
        available: what the actuators may give; 1e30 where nothing is held back.
        dissipated: what passivity control has taken in excess of the commands.
    """

    stamp_ns: int
    from_hand: float
    taken_by_actuators: float
    to_mechanism: float
    available: float
    dissipated: float


_NAMES = tuple(name for name in DeviceEnergy._fields if name != "stamp_ns")
DEVICE_ENERGY_FIELDS = Layout({"stamp": STAMP, **dict.fromkeys(_NAMES, _JOULES)})
_DEVICE_ENERGY = bounds_of("device energy", DEVICE_ENERGY_FIELDS)
_AVAILABLE = _NAMES.index("available")


def pack_controller_energy(entry: LedgerEntry, stamp_ns: int) -> Array:
    """Return the data (6,) of a ``controller/energy`` message."""
    return np.array((*seconds_of(stamp_ns), *entry))


def pack_device_energy(energy: DeviceEnergy) -> Array:
    """Return the data (7,) of a ``device/energy`` message."""
    stamp_ns, *energies = energy
    energies[_AVAILABLE] = min(energies[_AVAILABLE], UNLIMITED)
    return np.array((*seconds_of(stamp_ns), *energies))


def unpack_device_energy(data: object) -> DeviceEnergy:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp_ns, values = checked_values(data, _DEVICE_ENERGY)
    return DeviceEnergy(stamp_ns, *map(float, values[STAMP.size :]))


def energy_of(mechanism: Mechanism, state: MechanismState, time_ns: int) -> Energy:
    """Return the energies of a mechanism at a state, at a time (ns).

    What contacts hold counts as potential energy, what they lose as lost by damping.
    """
    kinetic, potential = mechanism.energy(state.q, state.v)
    account = state.account
    return Energy(
        time_ns,
        kinetic,
        potential + account.contact_energy,
        account.work_in,
        account.damping_loss + account.contact_loss,
        account.latch_loss,
        state.closure_error,
        account.surplus,
        account.refined,
        account.inaccurate,
    )
