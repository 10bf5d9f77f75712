# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism's energies, as ``mechanism/energy`` tells them."""

from __future__ import annotations

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.simulation import MechanismState
from hapticmech_ros.wire.layouts import Energy


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
