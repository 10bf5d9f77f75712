# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links whose weight something outside carries, all of it or a share: forces, energies, motion."""

import copy

import mujoco
import numpy as np
import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.mechanism.model import build_tree
from hapticmech_ros.robot.mujoco_robot import MujocoTree
from hapticmech_ros.scene import scene_from_document
from oracles.differences import columns, relative
from oracles.generator import blank, random_mechanism
from oracles.kinematics import link_poses
from oracles.posed import posed
from oracles.running import run, simulator, unaccounted, with_start


def carried(seed, **options):
    """Return a random mechanism, of whose links a random share of the weight is carried."""
    sample = random_mechanism(seed, **options)
    rng = np.random.default_rng([seed, 21])
    document = copy.deepcopy(sample.document)
    for link in document["links"]:
        link["gravcomp"] = float(rng.choice([0.0, 1.0, 0.4, 1.3]))
    return with_start(document, sample.q, sample.v)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_forces_are_those_of_weights_that_act_in_part(seed, planar):
    # Seeds that 4 divides have a link that is fixed to another one, with another share.
    document = carried(seed, planar=planar)
    state = posed(scene_from_document(document))
    found = state.evaluate(state.mechanism.initially_active).bias_force
    without = copy.deepcopy(document)
    for link in without["links"]:
        link.pop("gravcomp")
    weighed = posed(scene_from_document(without))
    expected = weighed.evaluate(weighed.mechanism.initially_active).bias_force

    def carried_energy(change):
        poses, energy = link_poses(document, state.mechanism.integrate(state.q, change)), 0.0
        for link in document["links"]:
            inertial, (rotation, place) = link["inertial"], poses[link["name"]]
            centre = place + rotation @ np.array(inertial.get("com", np.zeros(3)))
            energy += link["gravcomp"] * inertial["mass"] * centre @ document["gravity"]
        return np.array([energy])

    lift = columns(carried_energy, state.v.size)[0]
    assert relative(found, expected + lift) < 1e-9


@pytest.mark.parametrize("integrator", ["rk4", "linearly_implicit"])
def test_the_energy_account_closes(integrator):
    sim = simulator(carried(4), integrator=integrator)
    states = run(sim, 0.3)
    # The rule of order 3 at 1 ms.
    assert np.abs(unaccounted(sim, states)).max() < 1e-6
    assert states[-1].account.inaccurate == 0


def balance(share):
    """Return two weights of 1 kg on a beam, one of them carried."""
    document = blank(planar=True, gravity=(0.0, -9.81, 0.0))
    inertia = dict.fromkeys(("ixx", "iyy", "izz"), 0.01)
    hinge = {"name": "pivot", "type": "revolute", "axis": [0.0, 0.0, 1.0]}
    document["links"] = [
        {
            "name": "beam",
            "joint": hinge,
            "inertial": {"mass": 1.0, "com": [-0.2, 0.0, 0.0], "inertia": inertia},
        },
        {
            "name": "weight",
            "parent": "beam",
            "joint": {"name": "glue", "type": "fixed", "origin": {"xyz": [0.2, 0.0, 0.0]}},
            "inertial": {"mass": 1.0, "inertia": inertia},
            "gravcomp": share,
        },
    ]
    document["operational_points"] = [{"name": "end", "link": "weight"}]
    return document


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_beam_falls_to_the_side_that_nothing_carries(share):
    sim = simulator(balance(share))
    state = sim.step(sim.initial_state(), np.zeros((1, 6)))
    # Torque m g r over 2 (I + m r²); cos q of a step later is 1 to 1e-10.
    assert state.v[0] == pytest.approx(1e-3 * share * 9.81 * 0.2 / 0.1, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_mujoco_carries_as_much(seed):
    # Links of simple joints, none fixed to another.
    document = carried(seed, closed=False)
    for link in document["links"]:
        if link["joint"]["type"] not in ("revolute", "prismatic", "spherical"):
            link["joint"]["type"] = "revolute"
            link["joint"].pop("armature", None)
    document.pop("initial_state")
    scene = scene_from_document(document)
    spec = mujoco.MjSpec()
    spec.option.gravity = document["gravity"]
    MujocoTree(build_tree(scene), spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = posed(scene).evaluate(())
    assert found.bias_force == pytest.approx(data.qfrc_bias - data.qfrc_gravcomp, abs=1e-9)


def test_a_weight_that_is_more_than_its_own_is_refused():
    """Shares of opposite signs in links fixed to each other would add up to none with a lever."""
    document = balance(-1.0)
    with pytest.raises(SceneError, match=r"links\[1\].gravcomp"):
        scene_from_document(document)
