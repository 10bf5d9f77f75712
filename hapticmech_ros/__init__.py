# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Feel virtual mechanisms: their inertia, their joints and their contacts.

The names in ``__all__`` are the public API of the numerical core; none of them needs ROS or a
clock. They are loaded when first used, which makes commands start fast. The inputs and
outputs of each part are::

    scene        file -> checked description of the model     (formats, loading)
    mechanism    q, v, closures -> terms of Eq. 1, and their derivatives
    simulation   state, wrenches -> state a period later      (contact)
    operational  terms -> Λ_h⁻¹, its null space, a_0 at the point held
    control      device's sample, operational model -> wrenches on hand and mechanism
    device       wrench, hand -> pose, twist and hand's wrench a period later
    session      scene, pushes -> a run: all of the above, tick by tick
    wire         numbers <-> messages: topics, layouts, bounds
    nodes        messages -> messages: the same four roles as processes of ROS 2
    bag          messages <-> files

robot, live, haply, view, experiment, analysis, offline and study are beside them: of the ten, none
but their own nodes import these. Above all are graph (nodes as processes, and the experiment over
them) and cli (the commands). Below the ten, and without them, are numerics, compilation (of
kernels), files, system and errors.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hapticmech_ros.control import ControlArchitecture, ControlOutput
    from hapticmech_ros.device import DeviceState, HandLaw, SimulatedDevice
    from hapticmech_ros.errors import (
        BagError,
        ClosureError,
        HapticMechError,
        InvalidInputError,
        SceneError,
    )
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.mechanism import Mechanism
    from hapticmech_ros.operational import OperationalAnalysis, analyse
    from hapticmech_ros.scene import Scene
    from hapticmech_ros.session import Run, Sample, Session, SharedSession
    from hapticmech_ros.simulation import MechanismState, Simulator

_HOMES = {
    "BagError": "errors",
    "ClosureError": "errors",
    "ControlArchitecture": "control",
    "ControlOutput": "control",
    "DeviceState": "device",
    "HandLaw": "device",
    "HapticMechError": "errors",
    "InvalidInputError": "errors",
    "Mechanism": "mechanism",
    "MechanismState": "simulation",
    "OperationalAnalysis": "operational",
    "Run": "session",
    "Sample": "session",
    "Scene": "scene",
    "SceneError": "errors",
    "Session": "session",
    "SharedSession": "session",
    "SimulatedDevice": "device",
    "Simulator": "simulation",
    "analyse": "operational",
    "load_scene": "loading",
}

__all__ = [
    "BagError",
    "ClosureError",
    "ControlArchitecture",
    "ControlOutput",
    "DeviceState",
    "HandLaw",
    "HapticMechError",
    "InvalidInputError",
    "Mechanism",
    "MechanismState",
    "OperationalAnalysis",
    "Run",
    "Sample",
    "Scene",
    "SceneError",
    "Session",
    "SharedSession",
    "SimulatedDevice",
    "Simulator",
    "analyse",
    "load_scene",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
