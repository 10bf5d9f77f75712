"""Energies at the ports of rendering, as ``device/energy`` and ``controller/energy`` tell them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.control.energy_ledger import LedgerEntry
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.wire.bounds import bounds_of
from hapticmech_ros.wire.layouts import checked_values
from hapticmech_ros.wire.stamps import seconds_of

# Field -> size; ``stamp`` is seconds and nanoseconds, the rest J.
CONTROLLER_ENERGY_FIELDS: dict[str, int] = {
    "stamp": 2,
    "to_mechanism": 1,
    "stored": 1,
    "injected": 1,
    "dissipated": 1,
}
DEVICE_ENERGY_FIELDS: dict[str, int] = {
    "stamp": 2,
    "from_hand": 1,
    "taken_by_actuators": 1,
    "to_mechanism": 1,
    "available": 1,
    "dissipated": 1,
}
_CONTROLLER = bounds_of("controller energy", CONTROLLER_ENERGY_FIELDS)
_DEVICE = bounds_of("device energy", DEVICE_ENERGY_FIELDS)
# Told as available where nothing is held back.
UNLIMITED = 1e30


class DeviceEnergy(NamedTuple):
    """A decoded ``device/energy`` message, J since the hand took hold.

    Attributes:
        stamp_ns: ns.
        from_hand: E_h, what the hand has put in.
        taken_by_actuators: W.
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


def pack_controller_energy(entry: LedgerEntry, stamp_ns: int) -> Array:
    """Return the data (6,) of a ``controller/energy`` message."""
    return np.array((*seconds_of(stamp_ns), *entry))


def unpack_controller_energy(data: object) -> tuple[int, LedgerEntry]:
    """Return stamp, ns, and energies of a ``controller/energy`` message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp_ns, values = checked_values(data, _CONTROLLER)
    return stamp_ns, LedgerEntry(*map(float, values[2:]))


def pack_device_energy(energy: DeviceEnergy) -> Array:
    """Return the data (7,) of a ``device/energy`` message."""
    stamp_ns, *energies = energy
    energies[3] = min(energies[3], UNLIMITED)
    return np.array((*seconds_of(stamp_ns), *energies))


def unpack_device_energy(data: object) -> DeviceEnergy:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp_ns, values = checked_values(data, _DEVICE)
    return DeviceEnergy(stamp_ns, *map(float, values[2:]))
