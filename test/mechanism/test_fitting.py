# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops written with seven digits: fitted within 1e-5, so that they move as they were meant to."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.fitting import FIT_TOLERANCE
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.linkage import with_linkage
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.running import with_start

# What frames rounded to seven digits change of a linkage whose numbers are of order one.
ROUNDED = 1e-6
CORNERS = np.array([[0.0, 0, 0], [0.03, 0.1, 0], [0.19, 0.13, 0], [0.2, 0.01, 0]])


def rounded(numbers, digits):
    return [float(f"{number:.{digits}g}") if digits else float(number) for number in numbers]


def origin(place, digits):
    angles = pin.rpy.matrixToRpy(place.rotation)
    return {"xyz": rounded(place.translation, digits), "rpy": rounded(angles, digits)}


def four_bar(kind, digits, seed=3, off=0.0):
    """Return a four-bar in a tilted plane whose links have axes of their own, anyhow turned."""
    rng = np.random.default_rng(seed)
    tilt = pin.exp3(rng.normal(size=3))
    corners, up = CORNERS @ tilt.T, tilt[:, 2]
    frames = [pin.SE3(pin.exp3(rng.normal(size=3)), corner) for corner in corners]
    links, before = [], pin.SE3.Identity()
    for number, frame in enumerate(frames[:3]):
        joint = {
            "name": f"joint{number}",
            "type": "revolute",
            "axis": rounded(frame.rotation.T @ up, digits),
            "origin": origin(before.actInv(frame), digits),
        }
        com = 0.5 * frame.actInv(corners[number + 1])
        inertial = {"mass": 1.0, "com": com.tolist(), "inertia": dict.fromkeys(MOMENTS, 1e-3)}
        parent = f"link{number - 1}" if number else "world"
        links.append(
            {"name": f"link{number}", "parent": parent, "joint": joint, "inertial": inertial}
        )
        before = frame
    place = pin.Quaternion.FromTwoVectors(np.array((0.0, 0.0, 1.0)), up).matrix()
    last = pin.SE3(place, corners[3] + off * up)
    return {
        "format": "hapticmech-scene/1",
        "name": "four_bar",
        "gravity": [0.0, 0.0, -9.81],
        "links": links,
        "closures": [
            {
                "name": "last",
                "kind": kind,
                "a": {
                    "link": "link2",
                    "origin": origin(before.actInv(pin.SE3(place, corners[3])), digits),
                },
                "b": {"link": "world", "origin": origin(last, digits)},
            }
        ],
        "operational_points": [{"name": "middle", "link": "link1"}],
        "hand": {"kind": "constant_wrench"},
    }


MOMENTS = ("ixx", "iyy", "izz")


def rank_and_mobility(mechanism):
    q, _ = consistent_initial_state(mechanism)
    found = redundancy(mechanism, q, mechanism.initially_active)
    return found.rank, found.mobility


def after(scene, steps=200):
    sim = Simulator(scene)
    return sim.run(sim.initial_state(), steps).end


@pytest.mark.parametrize("kind", ["revolute", "spherical"])
def test_a_planar_loop_in_space_of_seven_digits_moves_as_the_exact_one(kind):
    exact = scene_from_document(four_bar(kind, 0))
    written = scene_from_document(four_bar(kind, 7))
    with pytest.raises(ClosureError, match="cannot be closed"):
        consistent_initial_state(Mechanism(written, fit=False))
    mechanism = Mechanism(written)
    assert Mechanism(exact).fit is None
    assert rank_and_mobility(mechanism) == rank_and_mobility(Mechanism(exact)) == (2, 1)
    fit = mechanism.fit
    assert 1e-9 < fit.moved_rad < ROUNDED
    assert fit.moved_m < ROUNDED
    assert fit.mobility[1] == 1
    # Frames themselves, not what the fit says of them.
    for one, other in zip(written.links, mechanism.scene.links, strict=True):
        moved = np.subtract(one.joint.origin.xyz, other.joint.origin.xyz)
        assert np.abs(moved).max() < FIT_TOLERANCE * mechanism.length
    states = [after(one) for one in (exact, written)]
    fallen = np.abs(states[0].q).max()
    assert fallen > 0.01
    assert np.abs(states[0].q - states[1].q).max() < 10.0 * ROUNDED


@pytest.mark.parametrize(("digits", "moved"), [(7, 0), (8, 1)])
def test_bricard_of_seven_digits_moves(digits, moved):
    """With 1.570796 it is stuck as written; with 1.5707963 it is next to that all along."""
    scene = load_scene("bricard")
    document = document_of(scene)
    parts = [link["joint"] for link in document["links"]]
    parts += [closure[end] for closure in document["closures"] for end in "ab"]
    for part in parts:
        part["origin"] = {key: rounded(one, digits) for key, one in part["origin"].items()}
    written = scene_from_document(document)
    assert rank_and_mobility(Mechanism(written, fit=False)) == (5 - moved, moved)
    mechanism = Mechanism(written)
    assert rank_and_mobility(mechanism) == (4, 1)
    assert mechanism.fit.closures == ("hinge6",)
    assert mechanism.fit.mobility == (moved, 1)
    q, _ = consistent_initial_state(mechanism)
    assert mechanism.closing_terms(q, mechanism.initially_active).least > 0.1
    felt = []
    for one in (scene, written):
        sim = Simulator(one)
        terms = sim.evaluate(sim.initial_state())
        felt.append(terms.points[0].jacobian @ terms.closing.space.closed_rates(np.ones(5)))
    assert np.abs(felt[0]).max() > 0.01
    np.testing.assert_allclose(felt[1], felt[0], atol=ROUNDED)


def test_what_is_off_by_more_is_refused():
    """A hinge a hundredth of a millimetre beside its plane would be moved by more than it may."""
    scene = scene_from_document(four_bar("revolute", 7, off=1e-4))
    mechanism = Mechanism(scene)
    assert mechanism.fit is None
    with pytest.raises(ClosureError, match="cannot be closed"):
        consistent_initial_state(mechanism)


@pytest.mark.parametrize("bend", [1e-4, 1e-6, 1e-7])
def test_a_start_next_to_a_singular_position_is_no_reason(bend):
    """The rows are independent elsewhere on the motion, so that they say something of their own."""
    scene = scene_from_document(with_start(five_bar(), five_bar_bent(1.9, bend)))
    assert Mechanism(scene).fit is None


def test_shipped_scenes_are_as_written():
    for name in shipped_scenes():
        assert Mechanism(load_scene(name)).fit is None, name


@pytest.mark.parametrize("middle", ["bar", "rod"])
def test_three_parallel_bars_of_seven_digits_move(middle):
    """A parallelogram with a third leg, drawn askew: its length is off in the eighth digit."""
    cos, sin = np.cos(0.3), np.sin(0.3)
    at = {"A": (0, 0), "B": (0.05, 0.1), "C": (0.25, 0.1), "D": (0.2, 0)}
    at |= {"E": (0.07, 0), "F": (0.12, 0.1)}
    points = {
        name: rounded((cos * x - sin * y, sin * x + cos * y), 7) for name, (x, y) in at.items()
    }
    bars = [("left", "AB"), ("table", "BCF"), ("right", "CD")]
    linkage = {
        "points": points,
        "ground": ["A", "D", "E"],
        "bars": [{"name": name, "points": list(ends), "mass": 0.1} for name, ends in bars],
    }
    if middle == "bar":
        linkage["bars"].append({"name": "leg", "points": ["E", "F"], "mass": 0.1})
    else:
        linkage["rods"] = [{"name": "leg", "points": ["E", "F"]}]
    document = {
        "format": "hapticmech-scene/1",
        "name": "three_legs",
        "task_space": "planar",
        "linkage": linkage,
        "operational_points": [{"name": "middle", "point": "F"}],
        "hand": {"kind": "constant_wrench"},
        "gravity": [0.0, -9.81, 0.0],
    }
    scene = scene_from_document(with_linkage(document, "three_legs"))
    assert rank_and_mobility(Mechanism(scene, fit=False))[1] == 0
    mechanism = Mechanism(scene)
    assert rank_and_mobility(mechanism)[1] == 1
    assert mechanism.fit.moved_m < ROUNDED * mechanism.length
    scene_from_document(document_of(mechanism.scene))  # which is one of the plane still
    state = after(scene)
    # Legs of equal length turn alike.
    left = mechanism.frame_pose(state.q, "left").rotation
    assert (
        np.abs(
            left - mechanism.frame_pose(consistent_initial_state(mechanism)[0], "left").rotation
        ).max()
        > 0.01
    )
    right = mechanism.frame_pose(state.q, "right").rotation
    # Theirs is drawn from its other end.
    assert np.abs(left[:2, 0] + right[:2, 0]).max() < 10.0 * ROUNDED
