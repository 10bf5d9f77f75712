# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What passes through the ports of a run: between each hand and its device, and of all together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.device import Device
from hapticmech_ros.session import Run, Session, SharedSession

# Speed beyond which a device counts as having escaped from the hand, m/s or rad/s.
ESCAPED = 1e3
# Ticks between checks for an escaped device.
_AT_ONCE = 1000
# Ticks for which a connection may lose every message, and in which the loop answers.
_LOST = 10


@dataclass(frozen=True, slots=True)
class Port:
    """Results at the port of one user.

    Attributes:
        point: operational point that is held.
        lowest: J, least of E_h - min(0, least E_m): energy supplied by the hand, less friction
            losses, plus that supplied by the mechanism at the point.
        mechanism_gave: J, -min(0, least E_m).
        most_force: N, largest force of the actuators.
        motion: m/s, rms speed of the device in the last quarter.
        chatter: N, rms of the change of the force from sample to sample in the last quarter.
        changed: share of the samples whose command was changed by passivity control.
        drift: m, rms distance of device and operational point in the last quarter.
    """

    point: str
    lowest: float
    mechanism_gave: float
    most_force: float
    motion: float
    chatter: float
    changed: float
    drift: float


def port_of(point: str, run: Run, device: Device, changed: int) -> Port:
    """Return the results at a port.

    Args:
        point: operational point that is held.
        run: of its user.
        device: that is held.
        changed: samples whose command was changed by passivity control.
    """
    force, speed = run["device_applied"][:, :3], run["device_true_twist"][:, :3]
    steps = np.diff(force, axis=0, prepend=np.zeros((1, 3)))
    apart = run["device_true_position"] - run["position"]
    motion, chatter, drift = (_late_rms(vectors) for vectors in (speed, steps, apart))
    return Port(
        point,
        lowest=least_energy(energy_of(run, device), run["to_mechanism"]),
        mechanism_gave=float(supplied(run["to_mechanism"])[-1]),
        most_force=float(np.linalg.norm(force, axis=1).max()),
        motion=motion,
        chatter=chatter,
        changed=changed / len(run),
        drift=drift,
    )


def energy_of(run: Run, device: Device) -> Array:
    """Return E_h (k,) = W + ½ vᵀ Λ_d v, J: what the hand supplied, less friction losses.

    From the true motion and the wrench that acted, not from what the loop itself counts; without
    the driver's compensation, which acts on the device only.

    Args:
        run: of a user.
        device: that is held.
    """
    inertia = np.array([device.mass] * 3 + [device.inertia] * 3)
    acting = run["device_applied"][1:] - run["device_added"][:-1]
    given = np.cumsum(np.sum(acting * _ways(run), axis=1))
    moving = 0.5 * np.sum(inertia * run["device_true_twist"] ** 2, axis=1)
    return np.asarray(np.concatenate(([0.0], -given)) + moving)


def supplied(to_mechanism: Array) -> Array:
    """Return (k,), J, the most that a mechanism has supplied so far: -min(0, least E_m).

    Args:
        to_mechanism: (k,) J, E_m of a port, or of several in sum.
    """
    return np.maximum.accumulate(np.maximum(-to_mechanism, 0.0))


def least_energy(from_hands: Array, to_mechanism: Array) -> float:
    """Return the least of E_h - min(0, least E_m), J: of one port, or of several in sum.

    Args:
        from_hands: (k,) J, E_h or Σ E_h.
        to_mechanism: (k,) J, E_m or Σ E_m.
    """
    return float(np.min(from_hands + supplied(to_mechanism)))


def may_lack(run: Run, scene: Scene) -> Array:
    """Return (k,), J, what may be missing between E_h and E_m of one user; see docs/passivity.md.

    Passivity control keeps E_h - E_m above -(s + ε) by what each side knows of the other. Until a
    message has arrived it does not know what passed meanwhile: the most that E_m grew, or that W
    fell, within the connection's latest delay.

    Args:
        run: of the user.
        scene: as the user has it.
    """
    bounds, connection = scene.controller.passivity, scene.connection
    ticks = math.ceil(connection.latest / scene.simulation.period) + _LOST
    mechanism, actuators = run["to_mechanism"], run["actuators"]
    unknown = np.maximum(_grown(mechanism, ticks), _grown(-actuators, ticks))
    return bounds.slack + bounds.allowance + np.maximum.accumulate(unknown)


def users_of(session: Session | SharedSession) -> dict[str, Session]:
    """Return the session of each user, by the point that is held."""
    if isinstance(session, SharedSession):
        return {point: session.user(point) for point in session.points}
    return {session.scene.held_points[0]: session}


def run_of(session: Session | SharedSession, ticks: int) -> tuple[dict[str, Run], str]:
    """Run until the end, or until an error, or until a device escapes.

    Args:
        session: at its start.
        ticks: how many at most.

    Returns:
        What each user went through, by the point that is held, at least one row; and the reason of
        an early end, else nothing.
    """
    users = users_of(session)
    kept: dict[str, list[Array]] = {point: [] for point in users}
    done, ended = 0, ""
    while done < ticks and not ended:
        runs, ended = _some(session, min(_AT_ONCE, ticks - done))
        speeds = [np.abs(run["device_true_twist"]).max(axis=1) for run in runs.values()]
        count = len(speeds[0])
        escaped = np.flatnonzero(np.max(speeds, axis=0) > ESCAPED)
        if escaped.size:
            count = int(escaped[0]) + 1
            ended = f"the device escaped at {(done + count - 1) * session.period:.3g} s"
        for point, run in runs.items():
            kept[point].append(run.rows[:count])
        done += count
    return {point: _joined(kept[point], user) for point, user in users.items()}, ended


def _some(session: Session | SharedSession, ticks: int) -> tuple[dict[str, Run], str]:
    """Return runs of some ticks, and the error that ended them.

    Of several users what came before an error in the same call is not known.
    """
    if isinstance(session, SharedSession):
        try:
            return session.run(ticks), ""
        except HapticMechError as error:
            nothing = {point: user.run(0) for point, user in users_of(session).items()}
            return nothing, str(error)
    ((point, user),) = users_of(session).items()
    rows, before, ended = np.zeros((ticks, user.layout.size)), user.time, ""
    try:
        user.run(ticks, into=rows)
    except HapticMechError as error:
        ended = str(error)
        ticks = round((user.time - before) / user.period)
    return {point: Run(rows[:ticks], user.layout)}, ended


def _joined(parts: list[Array], user: Session) -> Run:
    """Return parts of a run as one; a run that failed at once has one row."""
    rows = np.concatenate(parts)
    return Run(rows if len(rows) else np.zeros((1, user.layout.size)), user.layout)


def _ways(run: Run) -> Array:
    """Return the device's displacements (k - 1, 6) between ticks, m and rad."""
    turns = Rotation.from_matrix(run["device_true_rotation"].reshape(-1, 3, 3))
    turned = (turns[1:] * turns[:-1].inv()).as_rotvec()
    return np.hstack((np.diff(run["device_true_position"], axis=0), turned))


def _grown(values: Array, ticks: int) -> Array:
    """Return by how much values (k,) are above their least of the last ticks, (k,)."""
    before = np.concatenate((np.full(ticks, values[0]), values))
    return np.asarray(values - sliding_window_view(before, ticks + 1).min(axis=1))


def _late_rms(vectors: Array) -> float:
    """Return the rms size of vectors (k, 3) in the last quarter."""
    last = vectors[3 * len(vectors) // 4 :]
    return float(np.sqrt(np.mean(np.sum(last**2, axis=1))))
