# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Passivity trials: energy at the hand's port over connections with delay, jitter and loss.

A trial is a run of a scene with a device, a hand and a connection. The hands are those of the
library, moving during the whole trial.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from hapticmech_ros.analysis.scene_variants import LOOPS
from hapticmech_ros.analysis.study import SharedResults, Sheet, Show, plain, silent
from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Connection
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.gain_rule import damping_for
from hapticmech_ros.scene.hand import ArmHand, ConstantWrenchHand, Hand, Tremor, Waypoint
from hapticmech_ros.session import Run, Session
from hapticmech_ros.workers import Lost, Workers, in_order

# Joint-constraint stiffness of every trial, N/m, instead of that by the rule.
STIFFNESS = 2000.0
JITTER, LOSS = 0.2, 0.05
# J, least admissible E_h, beyond the energy that the mechanism supplied itself.
ALLOWED_J = 1e-3
# Speed beyond which a device counts as having escaped from the hand, m/s or rad/s.
ESCAPED = 1e3
# Time between waypoints, s, and their distance from the pose of grasp, m and rad.
EVERY_S = 0.6
REACH_M, TURN_RAD = 0.015, 0.1
# Peak frequency of physiological tremor (docs/devices.md), and a clearly visible force.
TREMOR = Tremor(frequency=10.0, force=(0.5, 0.3, 0.0))
_SEED = 20
# Ticks between checks for an escaped device.
_AT_ONCE = 1000


@dataclass(frozen=True, slots=True)
class Trial:
    """Conditions of a trial.

    Attributes:
        scene: name or path.
        device: preset, or "scene" for the scene's own.
        hand: of :data:`HANDS`.
        delay: s, each way.
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
        lowest: J, least of W + ½ vᵀ Λ_d v - min(0, least E_m): energy supplied by the hand, less
            friction losses, plus that supplied by the mechanism itself.
        mechanism_gave: J, -min(0, least E_m).
        most_force: N, largest force of the actuators.
        motion: m/s, rms speed of the device in the last quarter.
        chatter: N, rms of the change of the force from sample to sample in the last quarter.
        changed: share of the samples whose command was changed by passivity control.
        drift: m, rms distance of device and operational point in the last quarter.
        ended: reason for an early end; else empty.
    """

    trial: Trial
    lowest: float
    mechanism_gave: float
    most_force: float
    motion: float
    chatter: float
    changed: float
    drift: float
    ended: str

    @property
    def passive(self) -> bool:
        """Whether the trial was passive to its end."""
        return self.lowest >= -ALLOWED_J and not self.ended


def scene_of(trial: Trial) -> Scene:
    """Return the scene of a trial.

    Raises:
        SceneError: it cannot be loaded.
        InvalidInputError: an unknown hand or device preset.
    """
    if trial.hand not in HANDS:
        raise InvalidInputError("hand", trial.hand, f"must be one of {', '.join(HANDS)}")
    scene = load_scene(trial.scene)
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
    late = Connection(delay=trial.delay, jitter=JITTER, loss=LOSS, seed=1)
    return scene.model_copy(
        update={
            "device": device,
            "hand": _turning(HANDS[trial.hand](scene, trial.seconds), device),
            "controller": controller.model_copy(update=updated),
            "connection": late,
        }
    )


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
    session = Session(scene)
    inertia = np.array([scene.device.mass] * 3 + [scene.device.inertia] * 3)
    run, ended = _ran(session, round(trial.seconds / session.period))
    seen, gave = np.zeros((len(run), 5)), float(max(0.0, np.max(-run["to_mechanism"])))
    twist, force = run["device_true_twist"], run["device_applied"][:, :3]
    # The driver's compensation acts on the device only.
    acting = run["device_applied"][1:] - run["device_added"][:-1]
    given = np.cumsum(np.sum(acting * _ways(run), axis=1))
    work = np.concatenate(([0.0], -given))
    seen[:, 0] = work + 0.5 * np.sum(inertia * twist**2, axis=1)
    seen[:, 0] += np.maximum.accumulate(np.maximum(-run["to_mechanism"], 0.0))
    seen[:, 1] = np.linalg.norm(force, axis=1)
    seen[:, 2] = np.linalg.norm(twist[:, :3], axis=1)
    seen[:, 3] = np.linalg.norm(np.diff(force, axis=0, prepend=np.zeros((1, 3))), axis=1)
    seen[:, 4] = np.linalg.norm(run["device_true_position"] - run["position"], axis=1)
    rest = np.sqrt(np.mean(seen[3 * len(seen) // 4 :] ** 2, axis=0))
    return Found(
        trial,
        lowest=float(seen[:, 0].min()),
        mechanism_gave=gave,
        most_force=float(seen[:, 1].max()),
        motion=float(rest[2]),
        chatter=float(rest[3]),
        changed=session.passivity.changed / len(seen),
        drift=float(rest[4]),
        ended=ended,
    )


def _ran(session: Session, ticks: int) -> tuple[Run, str]:
    """Return a run of the given ticks, or until the device escapes, and the reason of its end."""
    rows, done, ended = np.zeros((ticks, session.layout.size)), 0, ""
    while done < ticks and not ended:
        count = min(_AT_ONCE, ticks - done)
        try:
            session.run(count, into=rows[done:])
        except HapticMechError as error:
            ended = str(error)
            count = round(session.time / session.period) - done
        speeds = np.abs(Run(rows[done : done + count], session.layout)["device_true_twist"])
        escaped = np.flatnonzero(speeds.max(axis=1) > ESCAPED)
        if escaped.size:
            count = int(escaped[0]) + 1
            ended = f"the device escaped at {rows[done + count - 1, 0]:.3g} s"
        done += count
    # A run that fails at once has one row.
    return Run(rows[: max(done, 1)], session.layout), ended


def _ways(run: Run) -> Array:
    """Return the device's displacements (k - 1, 6) between ticks, m and rad."""
    turns = Rotation.from_matrix(run["device_true_rotation"].reshape(-1, 3, 3))
    turned = (turns[1:] * turns[:-1].inv()).as_rotvec()
    return np.hstack((np.diff(run["device_true_position"], axis=0), turned))


def _arm(scene: Scene, seconds: float, impedance: str, **more: object) -> Hand:
    rng = np.random.default_rng(_SEED)
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


def _grips(scene: Scene, seconds: float) -> Hand:
    releases = np.arange(2.0, seconds, 4.0).tolist()
    grabs = np.arange(3.0, seconds, 4.0).tolist()[: len(releases)]
    return _arm(scene, seconds, "firm", release_at=releases, grab_at=grabs)


# Name -> function of a scene and a duration (s) that returns the hand.
HANDS: dict[str, Callable[[Scene, float], Hand]] = {
    "scene": lambda scene, seconds: scene.hand,
    "relaxed": lambda scene, seconds: _arm(scene, seconds, "relaxed"),
    "firm": lambda scene, seconds: _arm(scene, seconds, "firm"),
    "tremor": lambda scene, seconds: _arm(scene, seconds, "relaxed", tremor=TREMOR),
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
                    f"{max(one.most_force for one in rows):.1f}",
                    f"{max(one.chatter for one in rows):.2f}",
                    f"{100.0 * max(one.changed for one in rows):.0f} %",
                    f"{1e3 * max(one.drift for one in rows):.1f}",
                )
            )
        yield Sheet(
            "worst device and hand: least energy, largest force, chatter, commands changed, drift",
            ("scene", "loop in", "ms", "passive", "mJ", "N", "N/T", "changed", "mm"),
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
        delays: s, each way.
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
    found, lost = list[Found](), list[str]()
    for one in in_order(tried, asked, workers):
        if isinstance(one, Lost):
            lost.append(str(one))
            show(lost[-1])
        else:
            found.append(one)
            show(_line(one))
    return PassivityTrials(tuple(found), lost=tuple(lost))


def _key(found: Found) -> tuple[str, bool, float]:
    return found.trial.scene, found.trial.local, found.trial.delay


def _line(found: Found) -> str:
    verdict = "passive" if found.passive else f"NOT passive {found.ended}".rstrip()
    return f"{found.trial}: {verdict}, {1e3 * found.lowest:.2f} mJ, {found.most_force:.1f} N"
