# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the hand feels of contacts: the wrench at the operational point, consistent and in full."""

import numpy as np
import pytest

from commands import printed_by
from hapticmech_ros import Session, load_scene
from hapticmech_ros.operational import Analyser, analyse
from hapticmech_ros.operational.analysis import contact_wrench
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.running import varied

PUSH = 0.5


def against_a_wall(name="two_link", law=None):
    """Return a shipped scene whose first point's link carries a ball beside a wall."""
    document = document_of(load_scene(name))
    sim = Simulator(load_scene(name))
    state = sim.initial_state()
    point = sim.evaluate(state).points[0].pose.translation
    held = document["operational_points"][0]
    ball = {
        "name": "ball",
        "link": held["link"],
        "origin": held["origin"],
        "geometry": {"kind": "sphere", "radius": 0.01},
    }
    wall = {
        "name": "wall",
        "link": "world",
        "origin": {"xyz": [float(point[0]) - 0.0101, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.0]},
        "geometry": {"kind": "half_space"},
    }
    law = law or {"stiffness": 5e3, "damping": 50.0}
    pair = {"name": "touch", "a": "ball", "b": "wall"} | law
    document["hand"] = {"kind": "constant_wrench", "force": [-PUSH, 0.0, 0.0]}
    for link in document["links"]:
        link["joint"]["damping"] = 0.02
    return scene_from_document(document | {"shapes": [ball, wall], "contacts": [pair]})


def by_formula(terms, found, force):
    """Return F_c = Σ (1 - w_i) n_i (n_iᵀ a_c) / μ_i, T18 of docs/derivations.md."""
    space, spectrum, gives = terms.space, found.spectrum, found.weights < 1.0
    pushed = space.without_closure_part(space.to_mass_metric(force))
    acceleration = (terms.points[0].jacobian @ space.from_mass_metric(pushed))[found.rows]
    along = (spectrum.wrenches.T @ acceleration)[gives]
    shares = (1.0 - found.weights[gives]) * along / spectrum.mu[gives]
    return spectrum.wrenches[:, gives] @ shares


def test_a_direction_that_is_rigid_in_part_has_so_much_less():
    scene = against_a_wall("five_bar")
    mechanism = Simulator(scene).mechanism
    s = analyse(mechanism, Simulator(scene).initial_state().q).spectrum.s
    sim = Simulator(varied(scene, perception={"s_on": 0.9 * s[1], "s_off": 1.2 * s[1]}))
    terms, analyser = sim.evaluate(sim.initial_state()), Analyser(sim.mechanism)
    found, force = analyser.analyse(terms), np.cos(np.arange(4.0))
    assert 0.1 < found.weights[1] < 0.9
    wrench = contact_wrench(analyser, terms, force)
    assert wrench[found.rows] == pytest.approx(by_formula(terms, found, force), rel=1e-12)


def test_the_device_feels_the_contact_in_steady_state():
    """The hand's push, what the device gives back, and the contact's wrench: equal within 2 %."""
    session = Session(against_a_wall())
    for _ in range(3000):
        sample = session.tick()
    point = sample.mechanism.touching.wrench(0, sample.point.pose.translation)
    assert np.linalg.norm(sample.mechanism.v) < 1e-4
    assert point[0] > 0.5 * PUSH
    # Along what the mechanism can move, J_c's wrench and F_c accelerate it alike.
    x = sample.analysis.inverse_inertia
    assert x @ sample.contact_wrench == pytest.approx(x @ point, rel=0.02, abs=1e-6)
    # At rest the device's force is what the hand's is, and what it gives along the free directions
    # is the contact's.
    felt = sample.output.device
    assert felt[:2] == pytest.approx(-sample.hand_wrench[:2], abs=0.02 * PUSH)
    share = np.eye(6) - sample.analysis.wrench_projector
    assert (share @ felt)[:2] == pytest.approx((share @ sample.contact_wrench)[:2], abs=0.02 * PUSH)


def test_a_scene_without_contacts_imports_kernels_only():
    """Which are one with those of a session; what builds shapes and searches is not there."""
    program = (
        "import sys; from hapticmech_ros import Session, load_scene; "
        "s = Session(load_scene('two_link')); s.tick(); "
        "print([m for m in sys.modules if m.startswith('hapticmech_ros.contact.') "
        "and not m.endswith(('kernels', 'layout'))])"
    )
    assert printed_by("-c", program, timeout=60.0).strip() == "[]"
