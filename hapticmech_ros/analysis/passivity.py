# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Passivity trials: energy at each hand's port over connections with delay, jitter and loss.

A trial is a run of a scene with a device, a hand and a connection for each user. The hands are
those of the library, moving during the whole trial, each in its own way. Of several users the
energies of all are added as well; see docs/passivity.md.

It records the energy through a run's ports: between each hand and its device, and of all together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from hapticmech_ros.analysis.scene_variants import LOOPS
from hapticmech_ros.analysis.study import SharedResults, Sheet, Show, plain, shared, silent
from hapticmech_ros.errors import HapticMechError, check_one_of
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Connection, damping_for
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ArmHand, ConstantWrenchHand, Hand, Tremor, Waypoint
from hapticmech_ros.session import Run, Session, SharedSession
from hapticmech_ros.system.workers import Workers

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
    """Return E_h (k,) = W + ½ vᵀ Λ_d v, J: the energy that the hand supplied, less friction losses.

    It uses the true motion and the wrench that acted, not the loop's own account; without the
    driver's compensation, which acts on the device only.

    Args:
        run: of a user.
        device: that is held.
    """
    inertia = np.array(device.inertias)
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
    """Return (k,), J, the largest deficit of E_h below E_m of one user; see docs/passivity.md.

    Passivity control keeps E_h - E_m above -(s + ε) by each side's last message from the other. It
    misses the exchange since then: the most that E_m grew, or that W fell, within the connection's
    longest delay.

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
        Each user's rows, by the point that is held, at least one; and the reason of an early end,
        else empty.
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

    With several users, rows before an error in the same call are not known.
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


# Joint-constraint stiffness of every trial, N/m, instead of that by the rule.
STIFFNESS = 2000.0
JITTER, LOSS = 0.2, 0.05
# J, least admissible E_h, beyond the energy that the mechanism supplied itself.
ALLOWED_J = 1e-3
# Time between waypoints, s, and their distance from the pose of grasp, m and rad.
EVERY_S = 0.6
REACH_M, TURN_RAD = 0.015, 0.1
# Peak frequency of physiological tremor (docs/devices.md), and a clearly visible force.
TREMOR = Tremor(frequency=10.0, force=(0.5, 0.3, 0.0))
_SEED = 20


@dataclass(frozen=True, slots=True)
class Trial:
    """Conditions of a trial.

    Attributes:
        scene: name or path.
        device: preset, or "scene" for the scene's own.
        hand: of :data:`HANDS`.
        delay: s, in each direction.
        local: whether the device closes force channel and joint constraint.
        control: whether passivity control is on.
        seconds: duration, s.
    """

    scene: str
    device: str = "scene"
    hand: str = "scene"
    delay: float = 0.0
    local: bool = True
    control: bool = True
    seconds: float = 60.0

    def __str__(self) -> str:
        where = "device" if self.local else "controller"
        delay = f"{1e3 * self.delay:g} ms"
        return f"{self.scene}, {self.device}, {self.hand}, {delay}, loop in {where}"


@dataclass(frozen=True, slots=True)
class Found:
    """Results of a trial.

    Attributes:
        trial: its conditions.
        ports: of each user.
        in_sum: J, least energy of all ports together: as ``lowest`` of one, of Σ E_h and Σ E_m.
        margin: J, least of that energy above the bound that passivity control keeps in sum; see
            :func:`~hapticmech_ros.analysis.passivity.may_lack`.
        ended: reason for an early end; else empty.
    """

    trial: Trial
    ports: tuple[Port, ...]
    in_sum: float
    margin: float
    ended: str

    @property
    def lowest(self) -> float:
        """Least energy at a port, J."""
        return min(port.lowest for port in self.ports)

    @property
    def most_force(self) -> float:
        """Largest force of a device's actuators, N."""
        return max(port.most_force for port in self.ports)

    @property
    def chatter(self) -> float:
        """Largest change of a device's force from sample to sample, rms, N."""
        return max(port.chatter for port in self.ports)

    @property
    def changed(self) -> float:
        """Largest share of a user's samples whose command was changed by passivity control."""
        return max(port.changed for port in self.ports)

    @property
    def drift(self) -> float:
        """Largest distance of a device and its operational point, rms, m."""
        return max(port.drift for port in self.ports)

    @property
    def passive(self) -> bool:
        """Whether each port was passive to the end, and all in sum kept their bound."""
        return min(self.lowest, self.margin) >= -ALLOWED_J and not self.ended


def scene_of(trial: Trial) -> Scene:
    """Return the scene of a trial.

    Raises:
        SceneError: it cannot be loaded.
        InvalidInputError: an unknown hand or device preset.
    """
    check_one_of("hand", trial.hand, HANDS)
    scene = load_scene(trial.scene)
    if not scene.hands:
        return scene.model_copy(update=_conditions(trial, scene, 0))
    hands = [
        entry.model_copy(update=_conditions(trial, scene.held_by(entry), index))
        for index, entry in enumerate(scene.hands)
    ]
    return scene.model_copy(update={"hands": tuple(hands)})


def _conditions(trial: Trial, scene: Scene, user: int) -> dict[str, object]:
    """Return the device, hand, controller and connection of one user, of those of a scene."""
    device = scene.device
    if trial.device != "scene":
        device = Device.model_validate({"preset": trial.device})
    controller = scene.controller
    damping = damping_for(STIFFNESS, device)
    gains = {"stiffness": STIFFNESS, "damping": damping, "local": trial.local}
    updated = {
        "joint_constraint": controller.joint_constraint.model_copy(update=gains),
        "force_channel": controller.force_channel.model_copy(update={"local": trial.local}),
        "passivity": controller.passivity.model_copy(update={"control": trial.control}),
    }
    hand = HANDS[trial.hand](scene, trial.seconds, _SEED + user)
    return {
        "device": device,
        "hand": _turning(hand, device),
        "controller": controller.model_copy(update=updated),
        "connection": Connection(delay=trial.delay, jitter=JITTER, loss=LOSS, seed=1 + user),
    }


def _turning(hand: Hand, device: Device) -> Hand:
    """Return a hand that does not accelerate a freely rotating handle without end."""
    if device.actuated == "all" or not isinstance(hand, ConstantWrenchHand):
        return hand
    return hand.model_copy(update={"torque": (0.0, 0.0, 0.0)})


def tried(trial: Trial) -> Found:
    """Run a trial.

    Returns:
        Its results.

    Raises:
        SceneError: it cannot be loaded.
        InvalidInputError: as :func:`scene_of`.
    """
    scene = scene_of(trial)
    session = SharedSession(scene) if scene.hands else Session(scene)
    runs, ended = run_of(session, round(trial.seconds / session.period))
    users, ports = users_of(session), list[Port]()
    hands, mechanism, lack = np.zeros((3, len(next(iter(runs.values())))))
    for point, run in runs.items():
        own = users[point].scene
        ports.append(port_of(point, run, own.device, users[point].passivity.changed))
        hands += energy_of(run, own.device)
        mechanism += run["to_mechanism"]
        lack += may_lack(run, own)
    in_sum, margin = least_energy(hands, mechanism), least_energy(hands + lack, mechanism)
    return Found(trial, tuple(ports), in_sum, margin, ended)


def _arm(scene: Scene, seconds: float, seed: int, impedance: str, **more: object) -> Hand:
    rng = np.random.default_rng(seed)
    planar = scene.task_space == "planar"
    waypoints = [Waypoint(time=0.0)]
    for time in np.arange(EVERY_S, seconds, EVERY_S).tolist():
        way, turn = REACH_M * rng.uniform(-1, 1, 3), TURN_RAD * rng.uniform(-1, 1, 3)
        if planar:
            way[2] = turn[0] = turn[1] = 0.0
        waypoints.append(
            Waypoint(time=time, xyz=tuple(way.tolist()), rotation=tuple(turn.tolist()))
        )
    document = {"kind": "arm", "impedance": impedance, "waypoints": tuple(waypoints), **more}
    return ArmHand.model_validate(document)


def _grips(scene: Scene, seconds: float, seed: int) -> Hand:
    releases = np.arange(2.0, seconds, 4.0).tolist()
    grabs = np.arange(3.0, seconds, 4.0).tolist()[: len(releases)]
    return _arm(scene, seconds, seed, "firm", release_at=releases, grab_at=grabs)


# Name -> function of a scene, a duration (s) and a seed of its motion that returns the hand.
HANDS: dict[str, Callable[[Scene, float, int], Hand]] = {
    "scene": lambda scene, seconds, seed: scene.hand,
    "relaxed": lambda scene, seconds, seed: _arm(scene, seconds, seed, "relaxed"),
    "firm": lambda scene, seconds, seed: _arm(scene, seconds, seed, "firm"),
    "tremor": lambda scene, seconds, seed: _arm(scene, seconds, seed, "relaxed", tremor=TREMOR),
    "grips": _grips,
}


@dataclass(frozen=True)
class PassivityTrials(SharedResults):
    """Results of trials.

    Attributes:
        found: results of each trial, in order.
    """

    NAME: ClassVar[str] = "passivity"
    FAULT: ClassVar[str] = "a trial was not passive, or lost"

    found: tuple[Found, ...]

    @property
    def sound(self) -> bool:
        """Whether all trials were passive."""
        return super().sound and all(one.passive for one in self.found)

    def document(self) -> list[object]:
        """Return a dictionary for each trial."""
        return [plain(one) for one in self.found]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a row for each scene, loop and delay, with the worst of all devices and hands."""
        lines = []
        for (scene, local, delay), group in groupby(sorted(self.found, key=_key), key=_key):
            rows = list(group)
            lines.append(
                (
                    scene,
                    "device" if local else "controller",
                    f"{1e3 * delay:g}",
                    f"{sum(one.passive for one in rows)} of {len(rows)}",
                    f"{1e3 * min(one.lowest for one in rows):.2f}",
                    f"{1e3 * min(one.in_sum for one in rows):.2f}",
                    f"{max(one.most_force for one in rows):.1f}",
                    f"{max(one.chatter for one in rows):.2f}",
                    f"{100.0 * max(one.changed for one in rows):.0f} %",
                    f"{1e3 * max(one.drift for one in rows):.1f}",
                )
            )
        yield Sheet(
            "worst device and hand: least energy at a port and in sum, largest force, chatter, "
            "commands changed, drift",
            ("scene", "loop in", "ms", "passive", "mJ", "sum, mJ", "N", "N/T", "changed", "mm"),
            tuple(lines),
            ("loop in",),
        )


def trials(
    scenes: Sequence[str],
    devices: Sequence[str],
    hands: Sequence[str],
    delays: Sequence[float],
    seconds: float = 60.0,
) -> list[Trial]:
    """Return trials for every combination, with loops closed in the device and in the controller.

    Args:
        scenes: names or paths.
        devices: presets, or "scene".
        hands: of :data:`HANDS`.
        delays: s, in each direction.
        seconds: s of each trial.
    """
    return [
        Trial(scene, device, hand, delay, local, seconds=seconds)
        for scene, device, hand, delay, local in product(
            scenes, devices, hands, delays, LOOPS.values()
        )
    ]


def passivity(
    asked: Sequence[Trial], show: Show = silent, workers: Workers = None
) -> PassivityTrials:
    """Run trials.

    Args:
        asked: conditions of the trials.
        show: called after each trial.
        workers: that share the trials; they load its scene themselves.

    Returns:
        Results of all trials.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: an unknown hand or device, or no process.
    """
    for trial in {(trial.scene, trial.device, trial.hand): trial for trial in asked}.values():
        scene_of(trial)
    found, lost = shared(tried, asked, workers, show, _line)
    return PassivityTrials(tuple(found), lost=lost)


def _key(found: Found) -> tuple[str, bool, float]:
    return found.trial.scene, found.trial.local, found.trial.delay


def _line(trial: Trial, found: Found) -> str:
    verdict = "passive" if found.passive else f"NOT passive {found.ended}".rstrip()
    total = f", in sum {1e3 * found.in_sum:.2f} mJ" if len(found.ports) > 1 else ""
    lowest, force = f"{1e3 * found.lowest:.2f} mJ", f"{found.most_force:.1f} N"
    return f"{trial}: {verdict}, {lowest}{total}, {force}"
