# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers of a scene with other gains, and what they answer about one place."""

import numpy as np
import pinocchio as pin

from hapticmech_ros.control import ControlArchitecture, DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.account_kernels import model_answer
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.loop_layout import Answer, ControllerSettings, Locality
from hapticmech_ros.control.measurements import flat_operational_model
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.scene import document_of, scene_from_document
from oracles.generator import unit

NOTHING = np.zeros(6)
FREE = {"force_limit": 1e12, "torque_limit": 1e12}


def random_pose(rng):
    return pin.SE3(pin.exp3(rng.uniform(0.0, np.pi) * unit(rng)), rng.normal(size=3))


def control_of(name, joint=FREE, device=FREE, **gains):
    """Return the control of a scene with other gains and limits; without limits if left out."""
    document = document_of(load_scene(name))
    for key, changed in {"joint_constraint": joint, **gains}.items():
        document["controller"][key] = {**document["controller"].get(key, {}), **changed}
    document["device"] = {**document["device"], **device}
    return ControlArchitecture(scene_from_document(document))


def answered(control, model, error=NOTHING, rate=NOTHING, hand=NOTHING, contact=NOTHING):
    """Return what a control answers, ramps over, a device that is an error away from the point."""
    here = pin.SE3.Identity()
    device = DeviceMeasurement(pin.exp6(pin.Motion(error)), rate, hand)
    point = PointMeasurement(here, NOTHING, contact)
    return control.compute(1.0, engage(0.0, here, here), device, point, model)


def local_model(control, time, clutch, model, point):
    """Return G, K and B (108,) as they come with an answer."""
    gains, answer, closes = control.gains, Answer(), Locality()
    closes.force_channel = gains.force_channel.local
    closes.joint_constraint = gains.joint_constraint.local
    settings = ControllerSettings(control.settings_at(time, clutch))
    seen = OperationalModelSample(flat_operational_model(model, point))
    model_answer(settings, seen, time, closes, answer)
    return answer.model.values
