# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of mechanism and analyser with joints that are poses, and with contacts."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.nodes.nullspace_analyser import NullspaceAnalyser
from hapticmech_ros.operational.analysis import ContactWrenches
from hapticmech_ros.simulation import MechanismState, Simulator
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import OperationalModelWriter
from hapticmech_ros.wire.messages import OperationalModelMessage
from hapticmech_ros.wire.state import StateLayout
from nodes.test_plain_messages import (
    COMMANDS,
    MODELS,
    MS,
    STATES,
    Process,
    States,
    _messages_are_published_by_rcl,
    by_the_kernel,
    command,
    folder,
)

__all__ = ["_messages_are_published_by_rcl", "folder"]

BALL = """
format: hapticmech-scene/1
name: ball
task_space: planar
gravity: [0.0, 0.0, 0.0]
links:
  - name: ball
    parent: world
    joint: {name: slide, type: planar}
    inertial: {mass: 0.5, inertia: {ixx: 2.0e-4, iyy: 2.0e-4, izz: 2.0e-4}}
shapes:
  - {name: round, link: ball, geometry: {kind: sphere, radius: 0.02}}
  - {name: ground, link: world, origin: {rpy: [-1.5707963, 0, 0]}, geometry: {kind: half_space}}
contacts:
  - {name: on_ground, a: round, b: ground, stiffness: 5.0e+3, damping: 20.0, friction: 0.3}
operational_points:
  - {name: handle, link: ball, origin: {xyz: [0.0, 0.03, 0.0]}, metric: {mass: 0.3, length: 0.03}}
  - {name: side, link: ball, origin: {xyz: [0.02, 0.0, 0.0]}, metric: {mass: 0.3, length: 0.03}}
initial_state:
  q: {slide: [0.0, 0.021, 1.0, 0.0]}
simulation: {period: 0.001}
hand: {kind: spring_damper, stiffness: 300.0, damping: 5.0, waypoints: [{time: 0.0}]}
"""
# A planar joint with a contact and two operational points, and free bodies in loops.
PUSHES = {
    # It latches after half a second.
    "door": (0.0, -0.3, 0.0, 0.0, 0.0, 0.0),
    "ball": (0.4, -3.0, 0.0, 0.0, 0.0, 0.0),
    "shared_payload": (2.0, 1.0, 3.0, 0.0, 0.0, 0.0),
    "stewart_platform": (2.0, 1.0, 3.0, 0.0, 0.0, 0.1),
}


@pytest.mark.parametrize("scene", PUSHES)
def test_joints_that_are_poses_and_contacts_move_as_the_simulator_does(
    folder: Path, monkeypatch: pytest.MonkeyPatch, scene: str
) -> None:
    if scene == "ball":
        (folder / "ball.yaml").write_text(BALL)
    file = str(folder / "ball.yaml") if scene == "ball" else scene
    commands = COMMANDS.replace("handle", load_scene(file).held_points[0])
    process = Process(MechanismSimulator, file, folder, (STATES, commands))
    actor, push = process.actor, np.array(PUSHES[scene])
    actor.port.set_timeout(10_000 * MS)
    process.settle(lambda: command(process, 0.0 * push))
    command(process, push)
    codes, moved, by_kernel = by_the_kernel(process, monkeypatch), actor.moved, []

    def noted(state: MechanismState, *given: Any) -> None:
        by_kernel.append(state)
        moved(state, *given)

    monkeypatch.setattr(actor, "moved", noted)
    begun = actor._ticks
    process.until(lambda: codes and actor._ticks > begun + 5)
    process.answers()
    by_kernel.clear()
    start = actor.state
    assert not any(start.active) or scene != "door"
    got = process.until(
        lambda: len(by_kernel) > 40 and (scene != "door" or actor.state.active == (True,))
    )
    got += process.answers()
    process.close()
    steps = round((actor.state.time - start.time) / actor.period_s)
    simulator = Simulator(actor.scene)
    mechanism = simulator.mechanism
    layout, felt = StateLayout(mechanism), ContactWrenches(mechanism)
    states, nobody = [start], np.zeros((len(mechanism.point_names), 6))
    wrenches = nobody.copy()
    wrenches[0] = push
    for _ in range(steps):
        states.append(simulator.step(states[-1], wrenches))
    assert actor.state.q == pytest.approx(states[-1].q, abs=1e-9)
    assert actor.state.account.work_in == pytest.approx(states[-1].account.work_in, rel=1e-6)
    touching = [state for state in by_kernel if state.touching and state.touching.pairs.size]
    assert (len(touching) > 5) == bool(actor.scene.contacts)
    numbers = np.array([[*mechanism.coordinates(state.q), *state.v] for state in states])
    touched = 0
    for message in got:
        values = FlatArray(layout.fields).decode(message)
        found = np.array([*values[layout.at["position"]], *values[layout.at["velocity"]]])
        nearest = int(np.abs(numbers - found).max(axis=1).argmin())
        assert found == pytest.approx(numbers[nearest], abs=1e-8)
        state, force = states[nearest], nobody
        if state.touching is not None and state.touching.joint_force.any():
            joint_forces = np.tile(state.touching.joint_force, (len(nobody), 1))
            force = felt.at(simulator.evaluate(state), joint_forces)
            touched += 1
        assert layout.unpack(values).contacts == pytest.approx(force, rel=1e-6, abs=1e-6)
    assert (touched > 20) == bool(actor.scene.contacts)


@pytest.mark.parametrize("scene", ["peg_in_hole", "shared_payload"])
def test_joints_that_are_poses_are_analysed_as_python_does(
    folder: Path, monkeypatch: pytest.MonkeyPatch, scene: str
) -> None:
    (point,) = load_scene(scene).operational_points
    models = MODELS.replace("handle", point.name)
    process = Process(NullspaceAnalyser, scene, folder, (models, STATES))
    actor, states = process.actor, States(Simulator(process.actor.scene))
    process.settle(lambda: process.speak(states.next()))
    actor.age_limit_ns = 1 << 62
    codes, past = by_the_kernel(process, monkeypatch), deepcopy(actor.past)
    process.answers()
    writer = OperationalModelWriter(actor.analyser, past)
    layout, expected, got = StateLayout(actor.mechanism), [], []
    for done in range(actor.analyses + 1, actor.analyses + 21):
        message = states.next()
        process.speak(message)
        got += process.until(lambda done=done: actor.analyses == done)
        writer.evaluate(layout.unpack(FlatArray(layout.fields).decode(message)))
        expected.append(writer.message.values.copy())
    got += process.answers()
    process.close()
    assert len(codes) > 10
    found = [FlatArray(OperationalModelMessage.layout).decode(message) for message in got]
    for one, other in zip(found, expected, strict=True):
        other[OperationalModelMessage.layout.start("count")] = OperationalModelMessage(one).count
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
