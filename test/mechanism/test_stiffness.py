# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which integrator a scene gets that names none: by its elements and the inertia they move."""

import numpy as np
import pytest

from hapticmech_ros import Session
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.elements import DAMPED, STIFF, stiff_elements
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.plan.scene_plan import plan_scene
from hapticmech_ros.scene import scene_from_document

PERIOD, MASS, LENGTH, OWN = 1e-3, 0.2, 0.3, 1e-4


def pendulum(spring=None, **joint):
    """Return a mass on a rod, with an element in its joint, or a spring."""
    own = dict.fromkeys(("ixx", "iyy", "izz"), OWN)
    bob = {"mass": MASS, "com": [LENGTH, 0.0, 0.0], "inertia": own}
    hinge = {"name": "hinge", "type": "revolute", "axis": [0.0, 0.0, 1.0]} | joint
    return scene_from_document(
        {
            "format": "hapticmech-scene/1",
            "name": "pendulum",
            "description": "A mass on a rod",
            "task_space": "planar",
            "links": [{"name": "rod", "joint": hinge, "inertial": bob}],
            "springs": [] if spring is None else [spring],
            "operational_points": [
                {"name": "tip", "link": "rod", "origin": {"xyz": [LENGTH, 0.0, 0.0]}}
            ],
            "initial_state": {"q": {"hinge": 0.1}},
            "hand": {"kind": "constant_wrench", "force": [0.0, 0.05, 0.0]},
            "simulation": {"period": PERIOD},
        }
    )


def stiff_ones(scene):
    mechanism = Mechanism(scene)
    return list(stiff_elements(scene, mechanism.tree, mechanism.elements.springs))


def chosen(scene):
    return Mechanism(scene).scene.simulation.integrator


def across(stiffness=0.0, damping=0.0):
    """Return a spring across the rod, at the mass: its length changes as the mass moves."""
    tip = {"link": "rod", "origin": {"xyz": [LENGTH, 0.0, 0.0]}}
    turned = np.array((-np.sin(0.1), np.cos(0.1)))
    place = LENGTH * np.array((np.cos(0.1), np.sin(0.1))) + 0.5 * turned
    anchor = {"link": "world", "origin": {"xyz": [*place.tolist(), 0.0]}}
    return {
        "name": "across",
        "a": tip,
        "b": anchor,
        "stiffness": stiffness,
        "damping": damping,
        "rest_length": 0.5,
    }


INERTIA = MASS * LENGTH**2 + OWN
AT_TIP = INERTIA / LENGTH**2
CASES = [
    ({"stiffness": 1.0}, PERIOD**2 / INERTIA, STIFF),
    ({"damping": 1.0}, PERIOD / INERTIA, DAMPED),
    ({"friction": 1.0, "friction_speed": 1.0}, PERIOD / INERTIA, DAMPED),
    ({"spring": across(stiffness=1.0)}, PERIOD**2 / AT_TIP, STIFF),
    ({"spring": across(damping=1.0)}, PERIOD / AT_TIP, DAMPED),
]


def times(element, factor):
    """Return the element so many times as strong."""
    if "spring" in element:
        spring = element["spring"]
        strong = {key: factor * spring[key] for key in ("stiffness", "damping")}
        return {"spring": spring | strong}
    return {
        key: value * (1.0 if key.endswith("speed") else factor) for key, value in element.items()
    }


@pytest.mark.parametrize(("element", "unit", "limit"), CASES)
def test_ratios_are_the_closed_forms(element, unit, limit):
    weak, strong = (pendulum(**times(element, share * limit / unit)) for share in (0.99, 1.01))
    assert stiff_ones(weak) == []
    assert chosen(weak) == "rk4"
    (found,) = stiff_ones(strong)
    assert found.ratio == pytest.approx(1.01 * limit, rel=1e-12)
    assert chosen(strong) == "linearly_implicit"


def test_a_scene_that_names_its_integrator_keeps_it():
    for name in SCHEMES:
        scene = pendulum(stiffness=1e6)
        assert chosen(scene.stepped(integrator=name)) == name


def test_shipped_scenes_have_nothing_that_is_too_stiff():
    for name in shipped_scenes():
        assert stiff_ones(load_scene(name)) == []
        assert chosen(load_scene(name)) == "rk4"


@pytest.mark.parametrize("ratio", [1e-4, 1.0, 0.99 * STIFF, 1.01 * STIFF, 1e3, 1e6])
def test_no_step_is_inaccurate_whatever_the_stiffness(ratio):
    """Up to the limit steps of rk4 are divided, beyond it the implicit rule damps."""
    session = Session(pendulum(stiffness=ratio * INERTIA / PERIOD**2))
    session.run(2000)
    account = session.mechanism.account
    assert account.inaccurate == 0
    exchanged = abs(account.work_in) + account.moved
    assert account.surplus < 1e-3 * exchanged
    if ratio < STIFF:
        assert abs(account.surplus) < 1e-3 * exchanged


def test_the_plan_says_why():
    def taken(scene):
        return next(c for c in plan_scene(scene).choices if c.about == "rule of a step")

    assert taken(pendulum()).why == "nothing is too stiff for it"
    found = taken(pendulum(stiffness=1e6))
    assert found.taken == "linearly_implicit"
    assert found.why.startswith("joint hinge: k T² / m = ")
