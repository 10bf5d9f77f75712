# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One physical loop, cut open at any of its joints.

Bodies 1..n and joints 0..n: joint 0 carries body 1 on the world, joint n carries body n on the
world. In the authored pose all link frames have the world's axes and sit at their carrying joint,
so that q = 0 (unit quaternions) is the same pose whatever the cut.
"""

from __future__ import annotations

import numpy as np

from oracles.generator import blank, floats, random_inertial, unit
from oracles.kinematics import Array, Document, rpy_of_rotation


def frame_along(axis: Array) -> Array:
    """Return a rotation with ``axis`` as its z axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(axis, x), axis), axis=1)


def loop(seed: int, cut: int, kinds: tuple[str, ...], planar: bool, held: int) -> Document:
    """Return the loop of ``seed`` cut at joint ``cut``, held at a point of body ``held``."""
    rng = np.random.default_rng([seed, len(kinds)])
    bodies = len(kinds) - 1
    angles = np.linspace(np.pi, 0.0, bodies + 1) + rng.uniform(-0.2, 0.2, bodies + 1)
    joints = np.stack((np.cos(angles), np.sin(angles), np.zeros(bodies + 1)), axis=1) * 0.3
    joints += rng.uniform(-0.1, 0.1, joints.shape)
    axes = [unit(rng) for _ in kinds]
    gravity = rng.uniform(-9.0, 9.0, 3)
    inertials = [random_inertial(rng, planar) for _ in range(bodies)]
    coms = 0.5 * (joints[:-1] + joints[1:]) + rng.uniform(-0.05, 0.05, (bodies, 3))
    schedule = coms[held - 1] + rng.uniform(-0.1, 0.1, 3)
    if planar:
        joints[:, 2] = coms[:, 2] = schedule[2] = gravity[2] = 0.0
        axes = [np.array([0.0, 0.0, 1.0])] * len(kinds)
    document = blank(planar, gravity)
    at = {"world": np.zeros(3)}

    def carry(body: int, parent: str, joint: int) -> None:
        origin = {"xyz": floats(joints[joint] - at[parent])}
        at[f"body{body}"] = joints[joint]
        inertial = inertials[body - 1] | {"com": floats(coms[body - 1] - joints[joint])}
        carried = {"name": f"joint{joint}", "type": kinds[joint], "axis": floats(axes[joint])}
        document["links"].append(
            {
                "name": f"body{body}",
                "parent": parent,
                "joint": carried | {"origin": origin},
                "inertial": inertial,
            }
        )

    for body in range(1, cut + 1):
        carry(body, f"body{body - 1}" if body > 1 else "world", body - 1)
    for body in range(bodies, cut, -1):
        carry(body, f"body{body + 1}" if body < bodies else "world", body)
    sides = [f"body{cut}" if cut else "world", f"body{cut + 1}" if cut < bodies else "world"]
    kind = "planar_pin" if planar else kinds[cut]
    rpy = rpy_of_rotation(frame_along(axes[cut]))
    origins = [{"xyz": floats(joints[cut] - at[side]), "rpy": rpy} for side in sides]
    frames = [{"link": s, "origin": o} for s, o in zip(sides, origins, strict=True)]
    document["closures"] = [{"name": "cut", "kind": kind, "a": frames[0], "b": frames[1]}]
    grip_origin = {"xyz": floats(schedule - at[f"body{held}"])}
    document["operational_points"] = [
        {"name": "grip", "link": f"body{held}", "origin": grip_origin}
    ]
    return document
