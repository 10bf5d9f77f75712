"""Layouts of the Float64MultiArray messages that carry more than one matrix.

Each layout is a sequence of named fields with sizes; the same text goes into the message's layout
labels, so that a bag can be read without this package.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.control import RenderingModel
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import Array

NANOSECONDS = 1_000_000_000

# Field -> size. ``stamp`` is seconds and nanoseconds, as two numbers, to lose no bit.
RENDERING_FIELDS: dict[str, int] = {
    "stamp": 2,
    "count": 1,
    "directions": 1,
    "s": 6,
    "inverse_inertia": 36,
    "constraint_projector": 36,
    "balanced_share": 36,
    "free_acceleration": 6,
}
ENERGY_FIELDS: dict[str, int] = {
    "stamp": 2,
    "kinetic": 1,
    "potential": 1,
    "work_in": 1,
    "damping_loss": 1,
    "latch_loss": 1,
    "closure_error": 1,
}


@dataclass(frozen=True, slots=True)
class Rendering:
    """A decoded ``rendering`` message: time (ns), count, s (t,), and the controllers' model."""

    stamp_ns: int
    count: int
    s: Array
    model: RenderingModel


@dataclass(frozen=True, slots=True)
class Energy:
    """A decoded ``energy`` message: time (ns); energies in J; closure error in m or rad."""

    stamp_ns: int
    kinetic: float
    potential: float
    work_in: float
    damping_loss: float
    latch_loss: float
    closure_error: float

    @property
    def balance(self) -> float:
        """Energy now, less what came in, plus what was lost, J; constant if nothing leaks."""
        held = self.kinetic + self.potential
        return held - self.work_in + self.damping_loss + self.latch_loss


def pack_rendering(rendering: Rendering) -> Array:
    """Return the message's data (124,)."""
    s = np.zeros(6)
    s[: rendering.s.size] = rendering.s
    model = rendering.model
    head = (*divmod(rendering.stamp_ns, NANOSECONDS), rendering.count, rendering.s.size)
    return np.concatenate(
        (
            head,
            s,
            model.inverse_inertia.ravel(),
            model.constraint_projector.ravel(),
            model.balanced_share.ravel(),
            model.free_acceleration,
        )
    )


def unpack_rendering(data: object) -> Rendering:
    """Return the decoded message.

    Raises:
        InvalidInputError: wrong length, or not finite.
    """
    values = _checked("rendering", data, RENDERING_FIELDS)
    matrices = values[10:118].reshape(3, 6, 6)
    return Rendering(
        int(values[0]) * NANOSECONDS + int(values[1]),
        int(values[2]),
        values[4 : 4 + int(values[3])],
        RenderingModel(matrices[0], matrices[1], matrices[2], values[118:]),
    )


def pack_energy(energy: Energy) -> Array:
    """Return the message's data (8,)."""
    return np.array(
        (
            *divmod(energy.stamp_ns, NANOSECONDS),
            energy.kinetic,
            energy.potential,
            energy.work_in,
            energy.damping_loss,
            energy.latch_loss,
            energy.closure_error,
        )
    )


def unpack_energy(data: object) -> Energy:
    """Return the decoded message.

    Raises:
        InvalidInputError: wrong length, or not finite.
    """
    values = _checked("energy", data, ENERGY_FIELDS)
    return Energy(int(values[0]) * NANOSECONDS + int(values[1]), *map(float, values[2:]))


def _checked(what: str, data: object, fields: dict[str, int]) -> Array:
    values = np.array(data, dtype=float)
    size = sum(fields.values())
    if values.shape != (size,):
        raise InvalidInputError(f"{what} message", values.size, f"must hold {size} numbers")
    if not np.isfinite(values).all():
        index = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InvalidInputError(f"{what} message[{index}]", values[index], "must be finite")
    return values
