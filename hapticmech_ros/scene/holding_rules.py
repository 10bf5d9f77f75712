# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules of a scene's device and hand that concern more than one value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from hapticmech_ros.errors import InvalidInputError, SceneProblem
from hapticmech_ros.scene.device import SERVO_ANGLE, most_servo_stiffness
from hapticmech_ros.scene.document import SceneDocument
from hapticmech_ros.scene.hand import AnyHand, ArmHand, ConstantWrenchHand, TargetHand, read_script
from hapticmech_ros.scene.part import Vector3


def broken_holding_rules(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Yield every rule of device and hand that ``scene`` breaks."""
    yield from _sampling(scene)
    yield from _servo(scene)
    yield from _waypoints(scene)
    yield from _grips(scene.hand)
    yield from _tremor(scene.hand)
    yield from _script(scene)


def pose_without_torques(scene: SceneDocument) -> str:
    """Return a warning about a pose that the device cannot hold; empty if it can."""
    if scene.task == "position" or scene.device.actuated == "all":
        return ""
    return (
        "the device has no torques: with task: pose, a link that turns as it moves feels too heavy"
        " unless you turn the handle with it; with task: position you hold it as by a ball joint"
    )


def hand_beyond_device(scene: SceneDocument) -> str:
    """Return a warning about a hand that pushes harder than the device can; empty if it does not.

    Joint constraints and contacts do not hold it then: the device is pushed through.
    """
    pushes = [("force", 0.0), ("torque", 0.0)]
    if isinstance(scene.hand, ConstantWrenchHand):
        force, torque = scene.hand.force, scene.hand.torque
        pushes = [("force", math.hypot(*force)), ("torque", math.hypot(*torque))]
    elif scene.hand.kind == "scripted":
        rows = read_script(scene.hand.file)
        sizes = np.linalg.norm(rows[:, 1:].reshape(-1, 2, 3), axis=2).max(axis=0, initial=0.0)
        pushes = [("force", float(sizes[0])), ("torque", float(sizes[1]))]
    for what, size in pushes:
        limit = float(getattr(scene.device, f"{what}_limit"))
        if size > limit:
            unit = "N" if what == "force" else "N m"
            return (
                f"the hand pushes with {size:.4g} {unit}, but device.{what}_limit is {limit:.4g}"
                f" {unit}: where the mechanism is blocked, the hand pushes the device away from it"
            )
    return ""


def hand_vectors(scene: SceneDocument) -> Iterator[tuple[str, Vector3, Vector3]]:
    """Yield key, linear and angular part of the hand's vectors."""
    hand = scene.hand
    if isinstance(hand, ConstantWrenchHand):
        yield "hand", hand.force, hand.torque
    elif isinstance(hand, TargetHand):
        for index, waypoint in enumerate(hand.waypoints):
            yield f"hand.waypoints[{index}]", waypoint.xyz, waypoint.rotation
    if hand.tremor is not None:
        yield "hand.tremor", hand.tremor.force, hand.tremor.torque
        yield "hand.tremor", hand.tremor.xyz, hand.tremor.rotation


def _sampling(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Explicit damping is stable where a step takes less than all speed, and so is a grip's spring.

    That one joins masses as light as the device's inertia.
    """
    device, hand = scene.device, scene.hand
    step = scene.simulation.period / device.substeps
    rule = "times the device's substep must not exceed its {}: more substeps, or less damping"
    own = device.mass, device.inertia
    sources = [("device", device.damping, device.angular_damping, *own)]
    if isinstance(hand, TargetHand):
        moved = own
        if isinstance(hand, ArmHand):
            arm = hand.mass, hand.angular_inertia
            moved = arm if hand.grip else (own[0] + arm[0], own[1] + arm[1])
            if hand.grip:
                grip, least = hand.grip, (min(own[0], arm[0]), min(own[1], arm[1]))
                sources.append(("hand.grip", grip.damping, grip.angular_damping, *least))
                stiff = "times the square of the device's substep must not exceed the lighter {}"
                for key, value, what, most in (
                    ("stiffness", grip.stiffness, "mass", least[0]),
                    ("angular_stiffness", grip.angular_stiffness, "inertia", least[1]),
                ):
                    if value * step**2 > most:
                        yield SceneProblem(f"hand.grip.{key}", value, stiff.format(what))
        sources.append(("hand", hand.damping, hand.angular_damping, *moved))
    for source, damping, angular_damping, mass, inertia in sources:
        for key, value, what, most in (
            ("damping", damping, "mass", mass),
            ("angular_damping", angular_damping, "inertia", inertia),
        ):
            if value * step > most:
                yield SceneProblem(f"{source}.{key}", value, rule.format(what))


def _servo(scene: SceneDocument) -> Iterator[SceneProblem]:
    device, period = scene.device, scene.simulation.period
    for key, stiffness, what, side in (
        ("stiffness", device.servo.stiffness, "mass", "force"),
        ("angular_stiffness", device.servo.angular_stiffness, "inertia", "torque"),
    ):
        limit, slew = getattr(device, f"{side}_limit"), getattr(device.safety, f"{side}_slew")
        highest = most_servo_stiffness(getattr(device, what), period, limit, slew)
        if stiffness is not None and stiffness > highest:
            rule = (
                f"must be at most {highest:.3g}, device.{what} times the square of"
                f" {SERVO_ANGLE:g} / period or of {side}_slew / {side}_limit"
            )
            yield SceneProblem(f"device.servo.{key}", stiffness, rule)


def _waypoints(scene: SceneDocument) -> Iterator[SceneProblem]:
    if isinstance(scene.hand, TargetHand):
        times = [waypoint.time for waypoint in scene.hand.waypoints]
        for index, (before, after) in enumerate(pairwise(times), start=1):
            if after <= before:
                rule = f"waypoint times must increase; the one before is {before}"
                yield SceneProblem(f"hand.waypoints[{index}].time", after, rule)


def _grips(hand: AnyHand) -> Iterator[SceneProblem]:
    """Yield the first grab that follows a grab, or release that follows a release."""
    switches = [(time, "release_at") for time in hand.release_at]
    switches = sorted(switches + [(time, "grab_at") for time in hand.grab_at])
    for (before, key), (after, next_key) in pairwise(switches):
        if before == after or key == next_key:
            rule = f"releases and grabs must alternate; the one before is {key} {before}"
            yield SceneProblem(f"hand.{next_key}", after, rule)
            return


def _tremor(hand: AnyHand) -> Iterator[SceneProblem]:
    tremor = hand.tremor
    if tremor is None or isinstance(hand, TargetHand):
        return
    for key, value in (("xyz", tremor.xyz), ("rotation", tremor.rotation)):
        if any(value):
            rule = "only a hand with waypoints has a target to move: use force or torque"
            yield SceneProblem(f"hand.tremor.{key}", value, rule)


def _script(scene: SceneDocument) -> Iterator[SceneProblem]:
    if scene.hand.kind != "scripted":
        return
    try:
        rows = read_script(scene.hand.file)
    except InvalidInputError as error:
        rule = error.rule if error.what == "script" else f"{error.what}: {error.rule}"
        yield SceneProblem("hand.file", error.value, rule)
        return
    if scene.task_space == "planar" and rows[:, 3:6].any():
        rule = "a planar scene moves in the world's x-y plane: the columns fz, tx and ty must be 0"
        yield SceneProblem("hand.file", scene.hand.file, rule)
