# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that are one flat array (Float64MultiArray): its named fields are all there is to them.

A class is a message's table, its label, and the view that reads and writes it. Names and sizes of
the fields go into the message's label, so that a bag can be read without this package. Wrenches and
twists are those of the world's axes, at the point that is held.
"""

from __future__ import annotations

from typing import ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from hapticmech_ros.compilation.records import (
    Field,
    Flag,
    Nested,
    Number,
    Record,
    Vector,
    Whole,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import (
    SECONDS,
    WRENCH,
    ControllerEnergies,
    DeviceSample,
    LocalModel,
    OperationalModelSample,
)
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.stamped import seconds_of, stamp_of

Kind = TypeVar("Kind", bound="Message")
# Of messages whose fields depend on a scene.
STAMP, FLAG = Field(2, SECONDS), Field(1, ("flags",))
GRASP_FIELD = Field(7, ("link", *("position",) * 3, *("angle",) * 3))


class Message(Record):
    """Data (n,) of a message, which begins with the time that it stands for.

    Attributes:
        what: the message's name, for errors.
        stamp: seconds and nanoseconds, as two numbers, to lose no bit.
    """

    what: ClassVar[str]
    stamp = Vector(2, SECONDS)

    @property
    def stamp_ns(self) -> int:
        """Time that it stands for, ns."""
        seconds, nanoseconds = self.stamp.tolist()
        return int(seconds) * NANOSECONDS + int(nanoseconds)

    @stamp_ns.setter
    def stamp_ns(self, time_ns: int) -> None:
        self.stamp[:] = seconds_of(time_ns)

    @classmethod
    def of(cls: type[Kind], stamp_ns: int, **fields: npt.ArrayLike) -> Kind:
        """Return a message of a time, ns, with these fields; the others are zero."""
        made = cls()
        made.stamp_ns = stamp_ns
        made.fill(**fields)
        return made

    @classmethod
    def completed(cls, values: Array) -> Array:
        """Return data (n,); those of an older version, completed.

        Args:
            values: (n,) the data.
        """
        return values


class DeviceStateMessage(Message):
    """``device/state``.

    Attributes:
        sample: what is measured.
        applied: by the actuators, on the hand, until now, N and N m; zero when servo_cf is lost.
        round_trip: from a sample to its answer, as the device finds it, s; 0: not known.
        obeys: whether it obeys servo_cf; what does not is not told, and counts as if it did.
    """

    what = "device state"
    sample = Nested(DeviceSample, flat=True)
    applied = Vector(6, WRENCH)
    round_trip = Number("duration")
    obeys = Flag()

    @classmethod
    def completed(cls, values: Array) -> Array:
        """Return data (29,); of older versions, which ended before ``round_trip``, completed.

        Args:
            values: (n,) the data.
        """
        old = values.shape == (cls.layout.start("round_trip"),)
        return np.append(values, (0.0, 1.0)) if old else values


class OperationalModelMessage(Message):
    """``analysis/<point>/operational_model``.

    Attributes:
        count: joint constraints reported.
        directions: t, of the task space: how many s there are.
        operational_model: what the controllers use of the analysis and of the point.
        commanded: whether the mechanism received the controller's commands then, and acted on them.
        grasp: where the operational point is: the link's place among the scene's, and xyz (m) and
            rpy (rad) in its frame.
    """

    what = "operational_model"
    count = Whole("count")
    directions = Whole("count")
    operational_model = Nested(OperationalModelSample, flat=True)
    commanded = Flag()
    grasp = Vector(GRASP_FIELD.size, GRASP_FIELD.quantities)

    @property
    def s(self) -> Array:
        """(t,) sqrt(μ), descending."""
        return self.operational_model.s[: self.directions]


class MechanismEnergy(Message):
    """``mechanism/energy``, J; the last three as in ``simulation.EnergyAccount``.

    Attributes:
        kinetic, potential: now.
        work_in, damping_loss, latch_loss: since the start.
        closure_error: largest residual of the closed loops, m or rad.
        surplus: what steps made from nothing, or lost if negative.
        refined, inaccurate: steps that were done again, and those that were still inaccurate.
    """

    what = "energy"
    kinetic = Number()
    potential = Number()
    work_in = Number()
    damping_loss = Number()
    latch_loss = Number()
    closure_error = Number()
    surplus = Number()
    refined = Number()
    inaccurate = Number()

    @property
    def balance(self) -> float:
        """Energy now, less what came in, plus what was lost, J; constant if nothing leaks."""
        held = self.kinetic + self.potential
        return held - self.work_in + self.damping_loss + self.latch_loss


ENERGY_NAMES = tuple(MechanismEnergy.layout)[1:]


class LocalFeedbackGain(Message):
    """``device/local_feedback_gain``: how a command depends on the device, for its own loop.

    Attributes:
        stamp: of the command that it goes with.
        answered: seconds and nanoseconds of the device's sample that this command answers.
        to_mechanism: E_m, what the mechanism has got through its point, J.
        model: G, K and B.
    """

    what = "gain"
    answered = Vector(2, SECONDS)
    to_mechanism = Number("energy")
    model = Nested(LocalModel, flat=True)

    @classmethod
    def answering(
        cls, stamp_ns: int, answered_ns: int, to_mechanism: float, model: Array
    ) -> LocalFeedbackGain:
        """Return a message.

        Args:
            stamp_ns: of the command that it goes with, ns.
            answered_ns: of the device's sample that this command answers, ns.
            to_mechanism: E_m, J.
            model: (108,) G, K and B, row by row.
        """
        made = cls.of(stamp_ns, answered=seconds_of(answered_ns), to_mechanism=to_mechanism)
        made.model.values[:] = model
        return made

    @property
    def answered_ns(self) -> int:
        """Time of the sample that the command answers, ns.

        Raises:
            InvalidInputError: no stamp.
        """
        return stamp_of(*self.answered.tolist())


# J. What passivity control makes available may be infinite; said where nothing is held back.
UNLIMITED = 1e30


class DeviceEnergy(Message):
    """``device/energy``, J since the hand took hold.

    Attributes:
        from_hand: E_h, what the hand has put in.
        taken_by_actuators: W, work that they have taken from the device.
        to_mechanism: E_m, as far as the device knows it.
        available: what the actuators may give; 1e30 where nothing is held back.
        dissipated: what passivity control has taken in excess of the commands.
    """

    what = "device energy"
    from_hand = Number()
    taken_by_actuators = Number()
    to_mechanism = Number()
    available = Number()
    dissipated = Number()


class ControllerEnergy(Message):
    """``controller/energy``, J since rendering started.

    Attributes:
        energies: of the controllers.
    """

    what = "controller energy"
    energies = Nested(ControllerEnergies, flat=True)
