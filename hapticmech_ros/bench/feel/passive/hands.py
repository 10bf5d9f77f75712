"""Hands that do not come to rest: the library's models, moved for as long as a trial lasts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import ArmHand, Hand, Tremor, Waypoint

# From waypoint to waypoint, s; and how far from where it took hold, m and rad.
EVERY_S = 0.6
REACH_M, TURN_RAD = 0.015, 0.1
# Peak of physiological tremor, as docs/devices.md has it, and a force that shows.
TREMOR = Tremor(frequency=10.0, force=(0.5, 0.3, 0.0))
_SEED = 20


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


# Name -> the hand of a scene for so many seconds.
HANDS: dict[str, Callable[[Scene, float], Hand]] = {
    "scene": lambda scene, seconds: scene.hand,
    "relaxed": lambda scene, seconds: _arm(scene, seconds, "relaxed"),
    "firm": lambda scene, seconds: _arm(scene, seconds, "firm"),
    "tremor": lambda scene, seconds: _arm(scene, seconds, "relaxed", tremor=TREMOR),
    "grips": _grips,
}
