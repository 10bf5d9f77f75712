# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Operational points put elsewhere on a mechanism: the same as a scene that has them there."""

import itertools

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import (
    flat_grasp,
    flat_grasps,
    grasp_of,
    grasp_posed,
    grasp_written,
    grasped,
)
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.simulation import Simulator
from oracles.analysed import Terms, terms_of
from oracles.closed_form import inverse_inertia
from oracles.generator import closed_chain, random_mechanism
from oracles.running import with_start
from sampling import sampled

SAMPLES = [
    *(random_mechanism(k, planar) for planar in (False, True) for k in sampled(range(6), planar)),
    *(closed_chain(seed, kind) for seed, kind in enumerate(("spherical", "revolute", "weld"))),
]


def places(sample, count=4):
    """Yield link and origin of random places on any link of a sample."""
    rng = np.random.default_rng(len(sample.q))
    planar = sample.document["task_space"] == "planar"
    for _ in range(count):
        link = sample.document["links"][int(rng.integers(len(sample.document["links"])))]
        turn = (0.0, 0.0, float(rng.normal())) if planar else tuple(rng.normal(size=3).tolist())
        yield link["name"], Origin(xyz=tuple(rng.normal(scale=0.3, size=3).tolist()), rpy=turn)


def document_with(document, link, origin):
    """Return a document whose first operational point is there."""
    first, *others = document["operational_points"]
    moved = {**first, "link": link, "origin": origin.model_dump(mode="json")}
    return {**document, "operational_points": [moved, *others]}


@pytest.mark.parametrize("sample", SAMPLES)
def test_x_at_any_place_is_that_of_a_scene_which_has_the_point_there(sample):
    mechanism = Mechanism(scene_from_document(sample.document))
    active = mechanism.initially_active
    w = mechanism.evaluate(sample.q, sample.v, active).closure_jacobian
    # Rates that the closures allow: of others, redundant rows make what the unit of length makes.
    v = sample.v - np.linalg.pinv(w, rcond=1e-10) @ (w @ sample.v)
    for link, origin in places(sample):
        mechanism.set_operational_point(grasped(mechanism.scene, "", link, origin))
        terms = mechanism.evaluate(sample.q, v, active)
        analyser = Analyser(mechanism)
        own = Terms(mechanism, terms, analyser.analyse(terms))
        # D, W and J of a mechanism made anew, and X from them by another
        # formula: nothing is carried over from the place before.
        anew = terms_of(document_with(sample.document, link, origin), sample.q, v)
        expected = inverse_inertia(anew.d, anew.w, anew.j)
        conditioned = np.linalg.cond(anew.d)
        assert np.abs(own.x - expected).max() < 1e-13 * conditioned * anew.scale
        found, other = own.analysis, anew.analysis
        assert found.rank == other.rank
        size = 1.0 + np.abs(other.free_acceleration).max()
        off = np.abs(found.free_acceleration - other.free_acceleration).max()
        assert off < 1e-13 * conditioned * size
        point, there = terms.points[0], anew.evaluation.points[0]
        assert np.abs(point.pose.homogeneous - there.pose.homogeneous).max() < 1e-13
        assert np.abs(point.twist - there.twist).max() < 1e-12
        # The other point stays where it was.
        assert np.abs(terms.points[1].jacobian - anew.evaluation.points[1].jacobian).max() < 1e-12


def test_steps_push_where_the_point_is_now():
    sample = random_mechanism(3)
    document = with_start(sample.document, sample.q, sample.v)
    scene = scene_from_document(document)
    link, origin = next(places(sample))
    moved = scene_from_document(document_with(document, link, origin))
    simulator, other = Simulator(scene), Simulator(moved)
    push = np.vstack((np.array([3.0, -1.0, 2.0, 0.1, 0.2, -0.1]), np.zeros(6)))
    state = simulator.step(simulator.initial_state(), push)
    simulator.evaluate(state)
    simulator.set_operational_point(grasped(simulator.scene, "", link, origin))
    expected = other.step(state, push)
    found = simulator.step(state, push)
    assert np.abs(found.v - expected.v).max() < 1e-13 * np.abs(expected.v).max()
    assert (found.q == expected.q).all() or np.abs(found.q - expected.q).max() < 1e-15
    pose = simulator.evaluate(found).points[0].pose
    assert np.abs(pose.homogeneous - other.evaluate(found).points[0].pose.homogeneous).max() < 1e-14


def test_closures_chosen_later_have_the_point_at_its_new_place():
    scene = load_scene("four_bar_closing")
    mechanism, other = Mechanism(scene), Mechanism(scene)
    point = grasped(scene, "", "link1", Origin(xyz=(0.01, 0.02, 0.0)))
    q = np.array([-0.1, -1.34, -2.31])
    mechanism.evaluate(q, q, (False,))
    mechanism.set_operational_point(point)
    other.set_operational_point(point)
    for active in ((False,), (True,)):
        found, expected = (one.evaluate(q, q, active).points[0] for one in (mechanism, other))
        assert np.abs(found.jacobian - expected.jacobian).max() < 1e-15


def test_what_is_sent_as_numbers_comes_back_to_the_bit():
    for sample in SAMPLES:
        scene = scene_from_document(sample.document)
        for link, origin in places(sample):
            point = grasped(scene, "", link, origin)
            assert grasp_of(scene, "", flat_grasp(scene, point)) == point
    assert flat_grasps(scene).shape == (len(scene.operational_points), 7)


def test_another_point_can_be_meant_and_an_offset_from_it():
    sample = random_mechanism(1)
    scene = scene_from_document(sample.document)
    mechanism = Mechanism(scene)
    active = mechanism.initially_active
    middle = mechanism.evaluate(sample.q, sample.v, active).points[1].pose
    assert grasped(scene, "tip", "middle").origin == scene.operational_point("middle").origin
    offset = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.9])), np.array([0.1, 0.2, 0.3]))
    mechanism.set_operational_point(grasp_posed(scene, "tip", "middle", offset))
    found = mechanism.evaluate(sample.q, sample.v, active).points[0].pose
    assert np.abs(found.homogeneous - (middle * offset).homogeneous).max() < 1e-13


def test_written_grasps():
    scene = load_scene("five_bar")
    assert grasp_written(scene, "", "link3").origin == Origin()
    assert grasp_written(scene, "", " link3  0.01 2e-2 0").origin.xyz == (0.01, 0.02, 0.0)
    turned = grasp_written(scene, "handle", "link3 0 0 0 0 0 1.5")
    assert (turned.name, turned.link, turned.origin.rpy) == ("handle", "link3", (0.0, 0.0, 1.5))
    assert grasp_written(scene, "", "handle") == scene.operational_point()


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "must be one of"),
        ("link9", "must be one of"),
        ("world", "must be one of"),
        ("link3 1 2", "x y z"),
        ("link3 1 2 3 4", "x y z"),
        ("link3 1 2 x", "x y z"),
        ("link3 nan 0 0", "within 1000 m"),
        ("link3 inf 0 0", "within 1000 m"),
        ("link3 1e200 1e200 0", "within 1000 m"),
        ("link3 0 0 0 0 0 nan", "finite"),
        ("link3 0 0 1000.1", "within 1000 m"),
    ],
)
def test_what_cannot_be_grasped_is_refused(text, rule):
    with pytest.raises(InvalidInputError, match=rule):
        grasp_written(load_scene("five_bar"), "", text)


def test_an_unknown_point_is_refused():
    with pytest.raises(InvalidInputError, match="operational point"):
        grasped(load_scene("five_bar"), "nobody", "link1")


@pytest.mark.parametrize("number", [-1.0, 0.5, 4.0, np.nan])
def test_a_number_that_is_no_link_is_refused(number):
    with pytest.raises(InvalidInputError, match="link of a grasp"):
        grasp_of(load_scene("five_bar"), "", np.array([number, *[0.0] * 6]))


def test_a_link_that_says_nothing_of_units_needs_a_point_with_a_metric():
    document = document_of(load_scene("five_bar"))
    for key in ("ixx", "iyy", "izz"):
        document["links"][2]["inertial"]["inertia"][key] = 0.0
    name = document["links"][2]["name"]
    with pytest.raises(InvalidInputError, match="metric"):
        grasped(scene_from_document(document), "", name)
    document["operational_points"][0]["metric"] = {"mass": 1.0, "length": 0.03}
    scene = scene_from_document(document)
    assert grasped(scene, "", name).metric == scene.operational_point().metric


def test_coming_back_is_as_if_nothing_had_been():
    scene = load_scene("spatial_arm")
    mechanism, other = Mechanism(scene), Mechanism(scene)
    before = mechanism.scene
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(2, mechanism.nv))
    for link, point in itertools.product(scene.links, (scene.operational_point(),)):
        mechanism.set_operational_point(grasped(scene, "", link.name, Origin(xyz=(0.1, 0.0, 0.2))))
        mechanism.set_operational_point(point)
        found, expected = (one.evaluate(q, v, ()).points[0] for one in (mechanism, other))
        assert found.jacobian.tobytes() == expected.jacobian.tobytes()
    assert mechanism.scene == before
    assert mechanism.length == other.length
