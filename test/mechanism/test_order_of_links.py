# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The order in which a scene lists its links changes nothing: siblings first, or subtrees first."""

import numpy as np
import pytest

from hapticmech_ros import Mechanism
from hapticmech_ros.scene import scene_from_document

RNG = np.random.default_rng(11)


def link(name, parent, at):
    moments = RNG.uniform(0.5, 1.0, 3) * 1e-2
    return {
        "name": name,
        "parent": parent,
        "joint": {
            "name": f"j_{name}",
            "type": "revolute",
            "axis": [0.0, 0.0, 1.0] if name < "d" else [0.0, 1.0, 0.0],
            "origin": {"xyz": at},
        },
        "inertial": {
            "mass": float(RNG.uniform(0.5, 2.0)),
            "com": RNG.uniform(-0.2, 0.2, 3).tolist(),
            "inertia": dict(zip(("ixx", "iyy", "izz"), moments.tolist(), strict=True)),
        },
    }


LINKS = {
    "a": link("a", "world", [0.0, 0.0, 0.0]),
    "b": link("b", "world", [1.0, 0.0, 0.0]),
    "c": link("c", "a", [0.3, 0.1, 0.0]),
    "d": link("d", "b", [0.2, 0.0, 0.1]),
    "e": link("e", "a", [0.1, 0.4, 0.0]),
    "f": link("f", "c", [0.0, 0.2, 0.2]),
}
Q = {f"j_{name}": 0.3 * index - 0.7 for index, name in enumerate(LINKS)}
V = {f"j_{name}": 0.9 - 0.4 * index for index, name in enumerate(LINKS)}


def mechanism(order):
    document = {
        "format": "hapticmech-scene/1",
        "name": "tree",
        "gravity": [0.3, -9.81, 0.5],
        "links": [LINKS[name] for name in order],
        "operational_points": [{"name": "tip", "link": "f"}],
        "hand": {"kind": "constant_wrench"},
    }
    return Mechanism(scene_from_document(document))


@pytest.mark.parametrize("order", ["abcdef", "abecdf", "badcfe", "acfebd"])
def test_energy_and_inertia_agree_in_any_order(order):
    tree = mechanism(order)
    q = np.array([Q[name] for name in tree.tree.joint_names])
    v = np.array([V[name] for name in tree.tree.joint_names])
    terms = tree.evaluate(q, v, ())
    # D against the kinetic energy, which is summed body by body: rounding of some 30 terms.
    kinetic, _ = tree.energy(q, v)
    assert 0.5 * v @ terms.inertia @ v == pytest.approx(kinetic, rel=1e-13)
    reference = mechanism("acfebd")
    place = [reference.tree.joint_names.index(name) for name in tree.tree.joint_names]
    expected = reference.evaluate(q[np.argsort(place)], v[np.argsort(place)], ())
    scale = np.abs(expected.inertia).max()
    assert np.abs(terms.inertia - expected.inertia[np.ix_(place, place)]).max() < 1e-14 * scale
    force = np.abs(expected.bias_force).max()
    assert np.abs(terms.bias_force - expected.bias_force[place]).max() < 1e-13 * force
