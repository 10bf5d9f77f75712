# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Accelerations and closure forces from Pinocchio's own constraint solver (API of Pinocchio 4)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from oracles.kinematics import Array, Document, rotation_of_rpy

# A revolute closure is two points of its axis on each other: five independent rows out of six.
REVOLUTE_POINTS = (0.0, 0.2)


def _placement(mechanism, frame: Document, along_z: float) -> tuple[int, pin.SE3]:
    joint, link = mechanism.tree.link_joint[frame["link"]]
    origin = frame.get("origin", {})
    rotation = rotation_of_rpy(origin.get("rpy", (0, 0, 0)))
    placement = pin.SE3(rotation, np.asarray(origin.get("xyz", (0, 0, 0)), dtype=float))
    return joint, link * placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, along_z]))


def constraint_dynamics(
    mechanism, document: Document, q: Array, v: Array, force: Array
) -> tuple[Array, list[Array]]:
    """Return v' and, per Pinocchio constraint, the force on frame a in world axes (3 or 6)."""
    model = mechanism.model
    data = model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in document["closures"]:
        kind = (
            pin.ContactType.CONTACT_6D
            if closure["kind"] == "weld"
            else (pin.ContactType.CONTACT_3D)
        )
        offsets = REVOLUTE_POINTS if closure["kind"] == "revolute" else (0.0,)
        for along_z in offsets:
            joint_a, frame_a = _placement(mechanism, closure["a"], along_z)
            joint_b, frame_b = _placement(mechanism, closure["b"], along_z)
            constraint = pin.RigidConstraintModel(
                kind, model, joint_a, frame_a, joint_b, frame_b, pin.ReferenceFrame.LOCAL
            )
            models.append(constraint)
            datas.append(constraint.createData())
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 1e-9, 200)
    accel = pin.constraintDynamics(model, data, q, v, force, models, datas, settings)
    forces = []
    for constraint, result in zip(models, datas, strict=True):
        pose = data.oMi[constraint.joint1_id] * constraint.joint1_placement
        wrench = result.contact_force
        parts = [pose.rotation @ wrench.linear]
        if constraint.type == pin.ContactType.CONTACT_6D:
            parts.append(pose.rotation @ wrench.angular)
        forces.append(np.concatenate(parts))
    return np.array(accel), forces
