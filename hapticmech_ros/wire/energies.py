# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Energies of mechanism, device and controller, as ``.../energy`` tells them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.rendering_controller import LedgerEntry
from hapticmech_ros.layout import Field, Layout
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.simulation import MechanismState
from hapticmech_ros.wire.bounds import bounds_of
from hapticmech_ros.wire.layouts import STAMP, Energy, checked_values
from hapticmech_ros.wire.stamped import seconds_of

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
