# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Passivity trials: energy at each hand's port over connections with delay, jitter and loss.

A trial is a run of a scene with a device, a hand and a connection for each user. The hands are
those of the library, moving during the whole trial, each in its own way. Of several users the
energies of all are added as well; see docs/passivity.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import ClassVar

import numpy as np

from hapticmech_ros.analysis.ports import (
    Port,
    energy_of,
    least_energy,
    may_lack,
    port_of,
    run_of,
    users_of,
)
from hapticmech_ros.analysis.scene_variants import LOOPS
from hapticmech_ros.analysis.study import SharedResults, Sheet, Show, plain, silent
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Connection
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.gain_rule import damping_for
from hapticmech_ros.scene.hand import ArmHand, ConstantWrenchHand, Hand, Tremor, Waypoint
from hapticmech_ros.session import Session, SharedSession
from hapticmech_ros.workers import Lost, Workers, in_order

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
        ports: of each user.
        in_sum: J, least energy of all ports together: as ``lowest`` of one, of Σ E_h and Σ E_m.
        margin: J, least of that energy above the bound that passivity control keeps in sum; see
            :func:`~hapticmech_ros.analysis.ports.may_lack`.
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
    if trial.hand not in HANDS:
        raise InvalidInputError("hand", trial.hand, f"must be one of {', '.join(HANDS)}")
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
    total = f", in sum {1e3 * found.in_sum:.2f} mJ" if len(found.ports) > 1 else ""
    lowest, force = f"{1e3 * found.lowest:.2f} mJ", f"{found.most_force:.1f} N"
    return f"{found.trial}: {verdict}, {lowest}{total}, {force}"
