# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``task: position``: the point is held as by a ball joint, of a device without torques."""

import numpy as np
import pytest

from benchmarks.push import WAY, time_alone
from hapticmech_ros import Session, load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.operational import Analyser, analyse
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.plan.scene_plan import check_scene
from hapticmech_ros.scene import scene_from_document
from oracles.posed import posed

POSITION = ["task=position"]
IDEAL = "{preset: inverse3, coulomb_friction: 0.0, actuator_bandwidth: 0.0, force_sensor: measured}"


@pytest.mark.parametrize("name", shipped_scenes())
def test_it_has_the_rows_and_the_inertia_of_positions(name):
    pose, position = (posed(load_scene(name, changes=c), 1, 0.2) for c in ([], POSITION))
    for point in pose.mechanism.point_names:
        whole, part = (
            analyse(pair.mechanism, pair.q, point, pair.v, pair.mechanism.initially_active)
            for pair in (pose, position)
        )
        rows = [row for row in whole.rows.tolist() if row < 3]
        assert part.rows.tolist() == rows
        expected = np.zeros((6, 6))
        expected[np.ix_(rows, rows)] = whole.inverse_inertia[np.ix_(rows, rows)]
        scale = np.abs(expected).max()
        assert np.abs(part.inverse_inertia - expected).max() <= 1e-13 * scale
        # Nothing is as free as the link alone, which turns about the point.
        assert (
            part.spectrum.s.max() <= 1.0 + 1e-12
            or position.mechanism.scene.operational_points[
                position.mechanism.point_names.index(point)
            ].metric
        )


@pytest.mark.parametrize("planar", [False, True])
def test_a_free_link_is_as_free_as_itself_wherever_it_is_held(planar):
    link = {
        "name": "body",
        "parent": "world",
        "joint": {"name": "base", "type": "planar" if planar else "free"},
        "inertial": {
            "mass": 2.0,
            "com": [0.3, -0.1, 0.0 if planar else 0.2],
            "inertia": {"ixx": 0.02, "iyy": 0.03, "izz": 0.04},
        },
    }
    point = {"name": "held", "link": "body", "origin": {"xyz": [0.1, 0.4, 0.0]}}
    document = {
        "format": "hapticmech-scene/1",
        "name": "body",
        "task_space": "planar" if planar else "spatial",
        "task": "position",
        "links": [link],
        "operational_points": [point],
        "hand": {"kind": "constant_wrench", "force": [0.0, 0.0, 0.0], "start_delay": 0.0},
    }
    moved = posed(scene_from_document(document), 1, 0.5)
    found = analyse(moved.mechanism, moved.q)
    assert found.spectrum.s == pytest.approx(np.ones(2 if planar else 3), abs=1e-13)
    arm = np.array([0.1, 0.4, 0.0]) - link["inertial"]["com"]
    if planar:
        # 1 / m across the arm's direction, and more along it: what turns gives way.
        most = 1.0 / 2.0 + arm @ arm / 0.04
        masses = np.linalg.eigvalsh(found.inverse_inertia[:2, :2])
        assert masses == pytest.approx([0.5, most], rel=1e-12)


@pytest.mark.parametrize(
    ("name", "pose", "position"), [("door", 5, 2), ("five_bar", 1, 0), ("ur5e", 0, 0)]
)
def test_constraints_are_counted_of_positions(name, pose, position):
    counts = []
    for changes in ([], POSITION):
        mechanism = Mechanism(load_scene(name, changes=changes))
        analysis = Analyser(mechanism).analyse(
            mechanism.evaluate(*start_of(mechanism), mechanism.initially_active)
        )
        counts.append(rigid_count(analysis.spectrum.s, mechanism.scene.perception))
    assert counts == [pose, position]


def start_of(mechanism):
    pair = posed(mechanism.scene)
    return pair.q, pair.v


PUSHES = {"five_bar": (-1.0, 0.0, 0.0), "door": (-0.1739, 0.9848, 0.0)}


def pushed(name, *changes, way=WAY):
    """Return how long a push of 1 N takes through a device without torques, alone, and the run."""
    direction = PUSHES[name]
    numbers = ", ".join(map(str, direction))
    hand = f"hand={{kind: constant_wrench, force: [{numbers}], start_delay: 2.0}}"
    scene = load_scene(name, changes=[f"device={IDEAL}", hand, *changes])
    period = scene.simulation.period
    run = Session(scene).run(round(3.0 / period))
    place, start = run["device_true_position"], round(2.0 / period)
    moved = (place[start:] - place[start]) @ direction
    took = int(np.flatnonzero(moved >= way)[0]) * period
    return took, time_alone(name, np.array([*direction, 0.0, 0.0, 0.0]), way), run


@pytest.mark.parametrize("name", PUSHES)
def test_a_device_without_torques_feels_the_mechanism(name):
    took, alone, run = pushed(name, *POSITION)
    # A period more or less, of a hundred and more.
    assert took == pytest.approx(alone, abs=0.00101)
    # The handle is not turned, and what turns it is not asked for.
    assert not run["on_hand"][:, 3:].any()
    assert not run["on_mechanism"][:, 3:].any()


@pytest.mark.parametrize(("way", "felt"), [(0.01, 1.21), (0.03, 2.37)])
def test_the_pose_of_a_handle_that_nobody_turns_is_felt_as_inertia(way, felt):
    """docs/devices.md: figures for the door."""
    took, alone, _ = pushed("door", way=way)
    assert (took / alone) ** 2 == pytest.approx(felt, rel=0.02)


def test_the_check_warns_of_a_pose_without_torques():
    device = "device={preset: inverse3}"
    (warning,) = (one for one in check(device) if "torques" in one)
    assert "task: position" in warning
    assert not any("torques" in one for one in check(device, *POSITION))
    assert not any("torques" in one for one in check())


def check(*changes):
    return check_scene(load_scene("door", changes=changes)).warnings
