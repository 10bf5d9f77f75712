# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inertias that MuJoCo's own compiler gives bodies: of meshes and shells, which have several rules.

MuJoCo, if it is installed, reads the file in a child process with limits, as others' files are not
trusted. What is read here in the XML itself does not need it, has line numbers in its errors, and
is the same without it: the compiler is asked for bodies only whose geoms have no simple shape.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from hapticmech_ros.cage import CageError, Limits, caged
from hapticmech_ros.formats.model import Body

# Of the compiler: its library takes 0.2 GB, large meshes as much again.
LIMITS = Limits(memory=1_500_000_000, seconds=60, output=16_000_000)
INSTALL = "pip install 'hapticmech_ros[mjcf]'"


class NotCompiledError(Exception):
    """MuJoCo is not installed, or refuses the file; the text says which."""


def compiled_bodies(path: Path) -> dict[str, Body]:
    """Return the file's bodies by name, with their inertia as MuJoCo computes it.

    Args:
        path: of the MJCF file.

    Raises:
        NotCompiledError: there is no MuJoCo, or it refuses the file.
    """
    if find_spec("mujoco") is None:
        raise NotCompiledError(f"MuJoCo computes it, which is not installed: {INSTALL}")
    try:
        (found,) = caged(bodies_of, [str(path.resolve())], LIMITS)
    except CageError as error:
        raise NotCompiledError(f"MuJoCo computes it, for which the file {error.rule}") from None
    return {
        name: Body(name, mass, np.array(com), np.array(inertia).reshape(3, 3))
        for name, mass, com, inertia in found
    }


def bodies_of(path: str) -> list[Any]:
    """Return name, mass (kg), centre (m, body axes) and inertia about it (kg m²) of all bodies.

    In a child process, where MuJoCo is.

    Args:
        path: of the MJCF file.
    """
    import mujoco

    # It would write them into a file in the folder where a user happens to be.
    mujoco.set_mju_user_warning(lambda _: None)
    model = mujoco.MjModel.from_xml_path(path)
    bodies = []
    for index in range(1, model.nbody):
        # Bodies without a name are called by their number by our reader, too.
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, index) or f"body{index}"
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[index])
        axes = turn.reshape(3, 3)
        inertia = (axes * model.body_inertia[index]) @ axes.T
        mass, com = float(model.body_mass[index]), model.body_ipos[index].tolist()
        bodies.append((name, mass, com, inertia.ravel().tolist()))
    return bodies
