# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Holding a mechanism elsewhere while it runs: no bump on the device, and the new place is felt."""

from functools import cache

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import grasped
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.mechanism import Origin

# What a hand is promised not to feel at a change of grasp, N from one sample to the next.
BUMP_N = 0.1
SPEED, HAND_N = 1.0, 3.0


@cache
def long_arm():
    """Return a planar arm of two links of 0.4 m, pushed by 3 N: its end is fast soon."""
    document = document_of(load_scene("two_link"))
    for link in document["links"]:
        link["inertial"] = {
            "mass": 1.0,
            "com": [0.2, 0.0, 0.0],
            "inertia": {"ixx": 0.02, "iyy": 0.02, "izz": 0.02},
        }
    document["links"][1]["joint"]["origin"] = {"xyz": [0.4, 0.0, 0.0]}
    document["operational_points"] = [
        {
            "name": "handle",
            "link": "link2",
            "origin": {"xyz": [0.4, 0.0, 0.0]},
            "metric": {"mass": 1.0, "length": 0.03},
        }
    ]
    document["hand"] = {"kind": "constant_wrench", "force": [0.0, HAND_N, 0.0]}
    return scene_from_document(document)


def run_to_speed(scene, delay=1):
    """Return a session whose device has just come to 1 m/s, and its last sample."""
    session = Session(scene, command_delay=delay)
    for _ in range(3000):
        sample = session.tick()
        if np.linalg.norm(sample.device.measured_twist[:3]) >= SPEED:
            return session, sample
    raise AssertionError("never came to speed")


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize(
    ("frame", "xyz"),
    [
        ("link1", (0.1, 0.05, 0.0)),  # heavy, held in two directions, at a seventh of the speed
        ("link1", (0.4, 0.0, 0.0)),
        ("link2", (0.1, -0.1, 0.0)),
        ("link2", (0.4, 0.0, 0.0)),  # where it is held already
    ],
)
def test_a_switch_at_a_metre_a_second_is_no_bump(frame, xyz, delay):
    session, last = run_to_speed(long_arm(), delay)
    session.set_operational_point(frame, Origin(xyz=xyz))
    samples = [session.tick() for _ in range(600)]
    wrenches = np.array([sample.output.device for sample in (last, *samples)])
    steps = np.linalg.norm(np.diff(wrenches[:, :3], axis=0), axis=1)
    # Of the switch itself nothing is felt at all; while the grasp closes, no more than promised.
    assert steps[0] <= 1e-12
    assert round(steps.max(), 2) <= BUMP_N
    assert np.linalg.norm(np.diff(wrenches[:, 3:], axis=0), axis=1).max() < 1e-3
    # In the end the device is with the mechanism, no further away than the hand can push it.
    error = samples[-1].output.error[:3]
    assert np.linalg.norm(error) < HAND_N / long_arm().controller.joint_constraint.stiffness


@pytest.mark.parametrize("name", ["five_bar", "spatial_arm", "two_link"])
def test_the_new_place_is_felt_as_if_it_had_been_held_from_the_start(name):
    scene = load_scene(name)
    link = scene.links[0].name
    session = Session(scene)
    session.run(300)
    session.set_operational_point(link, Origin(xyz=(0.02, 0.01, 0.0)))
    sample = session.tick()
    there = grasped(scene, "", link, Origin(xyz=(0.02, 0.01, 0.0)))
    points = (there, *scene.operational_points[1:])
    other = Session(scene.model_copy(update={"operational_points": points}))
    terms = other.simulator.evaluate(sample.mechanism)
    expected = other._analyser.analyse(terms).inverse_inertia
    size = np.abs(expected).max()
    assert np.abs(sample.analysis.inverse_inertia - expected).max() < 1e-11 * size
    assert (sample.point.pose.translation == terms.points[0].pose.translation).all()
    assert sample.count == np.count_nonzero(sample.analysis.weights == 1.0)


def test_the_hand_lets_go_of_the_old_place():
    """A command that was meant for the old place does not push at the new one."""
    session, last = run_to_speed(long_arm())
    assert np.abs(last.output.mechanism).max() > 1.0
    session.set_operational_point("link1", Origin(xyz=(0.4, 0.0, 0.0)))
    before = session.tick().mechanism
    alone = session.simulator.step(before, np.zeros((1, 6)))
    assert session.tick().mechanism.v.tobytes() == alone.v.tobytes()


def test_a_place_that_is_not_there_is_refused_and_nothing_changes():
    session, other = Session(load_scene("five_bar")), Session(load_scene("five_bar"))
    for one in (session, other):
        one.run(20)
    with pytest.raises(InvalidInputError, match="must be one of"):
        session.set_operational_point("nowhere")
    assert session.tick().output.device.tobytes() == other.tick().output.device.tobytes()
