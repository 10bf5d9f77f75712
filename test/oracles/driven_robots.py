# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that tests drive, and what Pinocchio's forward dynamics make of torques."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.robot.law import OperationalLaw

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = {"iiwa14": str(ROOT / "examples/iiwa14.yaml"), "ur5e": "ur5e"}
AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@cache
def robot(name):
    """Return a robot's mechanism."""
    return Mechanism(load_scene(ROBOTS[name]))


def law_of(name, **options):
    return OperationalLaw(robot(name), **options)


def poses(name, count, seed=0, least=0.0):
    """Return so many states of a robot, with the smallest s of each above a limit."""
    rng, law, found = np.random.default_rng(seed), law_of(name), []
    while len(found) < count:
        q = rng.uniform(-2.0, 2.0, law.mechanism.nv)
        v = rng.normal(size=law.mechanism.nv)
        if law.state(q, v).analysis.spectrum.s[-1] > least:
            found.append((q, v))
    return found


def accelerated(law, q, v, torque, contact=None):
    """Return v̇ (nv,), and the operational point's acceleration (6,), by Pinocchio alone."""
    model = law.mechanism.model
    data, frame = model.createData(), model.getFrameId(f"point/{law.point}")
    external = np.zeros(model.nv)
    if contact is not None:
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        external = pin.getFrameJacobian(model, data, frame, AXES).T @ contact
    vdot = np.array(pin.aba(model, data, q, v, torque + external))
    pin.forwardKinematics(model, data, q, v, vdot)
    pin.updateFramePlacements(model, data)
    return vdot, np.array(pin.getFrameClassicalAcceleration(model, data, frame, AXES).vector)


def pose_of(law, q):
    """Return the operational point's pose at q, by Pinocchio alone."""
    model = law.mechanism.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(f"point/{law.point}")].copy()
