# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers of a scene with other gains, and what they answer about one place."""

import numpy as np
import pinocchio as pin

from hapticmech_ros import Session
from hapticmech_ros.control import ControlArchitecture, DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.account_kernels import model_answer
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.device_side_kernels import (
    account_for_actuators,
    enforce,
    take_energy,
)
from hapticmech_ros.control.loop_layout import Answer, ControllerSettings, HandMemory, Locality
from hapticmech_ros.control.measurements import (
    flat_device,
    flat_operational_model,
    operational_model_of,
)
from hapticmech_ros.control.passivity import PassivityController, corrected
from hapticmech_ros.device import NO_WRENCH
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.scene import document_of, scene_from_document
from oracles.generator import unit
from oracles.running import varied

NOTHING = np.zeros(6)
FREE = {"force_limit": 1e12, "torque_limit": 1e12}


class Account(PassivityController):
    """A device's account, part by part: what ``DeviceSide.allow`` does in one call."""

    def record(self, sample, applied):
        account_for_actuators(self.account, DeviceSample(sample), applied)

    def receive(self, mechanism):
        take_energy(self.account, mechanism)

    def enforce(self, command, sample, added=NO_WRENCH):
        held = np.array(command, dtype=float)
        enforce(self.account, held, DeviceSample(sample), added)
        return held


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


def corrected_answers(scene, gains, time, states, carried=None):
    """Return what a control answers to two states of the device, and the first answer, corrected.

    Args:
        scene: at whose start the point is.
        gains: of its controller, other ones.
        time: s, of a ramp of 0.04 s.
        states: two of them, each the way from the point, the twist, and the hand's wrench, (6,).
        carried: of another grasp, see :func:`engage`.
    """
    control, sample = ControlArchitecture(varied(scene, controller=gains)), Session(scene).tick()
    model, pose = operational_model_of(sample.analysis), sample.point.pose
    clutch, seen = engage(0.0, pose, pose, 0.04, carried), PointMeasurement(pose, NOTHING, NOTHING)
    devices = []
    for way, twist, hand in states:
        moved = pin.SE3(pin.exp3(way[3:]) @ pose.rotation, pose.translation + way[:3])
        devices.append(DeviceMeasurement(moved, twist, hand))
    old, new = (control.compute(time, clutch, one, seen, model).device for one in devices)
    closes = local_model(control, time, clutch, model, seen)
    # The hand's wrench was never measured before: nothing of it is carried on.
    memory = HandMemory().values
    return old, new, corrected(old, closes, *map(flat_device, devices), memory, 1e-3)
