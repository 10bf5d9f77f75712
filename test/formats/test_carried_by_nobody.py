# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies that are the parent in all of their joints: free where other joints hold them."""

from __future__ import annotations

import numpy as np
import pytest

from formats.imports import saved
from hapticmech_ros import Mechanism, Simulator, load_scene
from hapticmech_ros.formats.reading import read_model
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.operational import Analyser

LINK = """<link name="{name}"><pose>{place}</pose><inertial><pose>{com}</pose><mass>{mass}</mass>
<inertia><ixx>8e-4</ixx><iyy>8e-4</iyy><izz>9e-4</izz></inertia></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><pose>{place}</pose><parent>{a}</parent>
<child>{b}</child><axis><xyz>0 0 1</xyz></axis></joint>"""
SCENE = """format: hapticmech-scene/1
model: {file}
operational_points:
  - {{name: tip, link: crank, origin: {{xyz: [0, 0.1, 0]}}}}
"""


def four_bar(folder, pins):
    """Return a four-bar whose pins B and C have the parents that are named first."""
    parts = [
        LINK.format(name="crank", place="0 0 0 0 0 0", com="0 0.05 0 0 0 0", mass=0.2),
        LINK.format(name="rocker", place="0.36 0 0 0 0 0", com="-0.06 0.08 0 0 0 0", mass=0.25),
        LINK.format(name="coupler", place="0 0.1 0 0 0 0", com="0.12 0.03 0 0 0 0", mass=0.3),
        JOINT.format(name="A", place="0 0 0 0 0 0", a="world", b="crank"),
        JOINT.format(name="D", place="0 0 0 0 0 0", a="world", b="rocker"),
    ]
    # Of a joint's pose: in the frame of its child.
    places = {
        ("B", "crank"): "0 0.1 0 0 0 0",
        ("B", "coupler"): "0 0 0 0 0 0",
        ("C", "rocker"): "-0.12 0.17 0 0 0 0",
        ("C", "coupler"): "0.24 0.07 0 0 0 0",
    }
    for name, (a, b) in pins.items():
        parts.append(JOINT.format(name=name, place=places[name, b], a=a, b=b))
    name = "_".join("_".join(pair) for pair in pins.values())
    text = f'<sdf version="1.7"><model name="four_bar">{"".join(parts)}</model></sdf>'
    file = saved(folder, f"{name}.sdf", text)
    return file, saved(folder, f"{name}.yaml", SCENE.format(file=file.name))


def felt(scene):
    simulator = Simulator(load_scene(str(scene)))
    state = simulator.initial_state()
    found = Analyser(simulator.mechanism, "tip").analyse(simulator.evaluate(state))
    rows = redundancy(simulator.mechanism, state.q, state.active)
    return found.inverse_inertia, rows.mobility


def test_a_coupler_that_is_nobodys_child_moves_as_one_that_is(tmp_path):
    usual = {"B": ("crank", "coupler"), "C": ("rocker", "coupler")}
    turned = {"B": ("coupler", "crank"), "C": ("coupler", "rocker")}
    ours, mobility = felt(four_bar(tmp_path, usual)[1])
    file, scene = four_bar(tmp_path, turned)
    theirs, same = felt(scene)
    assert mobility == same == 1
    assert np.abs(ours).max() > 1.0
    np.testing.assert_allclose(theirs, ours, atol=1e-9 * np.abs(ours).max())
    first = read_model(file).notes[0]
    assert str(first).startswith("body coupler: no joint carries it (1 x): it is free")


@pytest.mark.parametrize("joined", [False, True])
def test_a_body_that_nothing_joins_to_the_world_is_the_ground(tmp_path, joined):
    """A base with an arm on it, beside a mechanism that is held to the world or joined to it."""
    parts = [
        LINK.format(name="base", place="0 0 0 0 0 0", com="0 0 0 0 0 0", mass=1.0),
        LINK.format(name="arm", place="0 0 0 0 0 0", com="0.1 0 0 0 0 0", mass=0.2),
        JOINT.format(name="shoulder", place="0 0 0 0 0 0", a="base", b="arm"),
    ]
    if joined:
        parts += [
            LINK.format(name="other", place="1 0 0 0 0 0", com="0 0 0 0 0 0", mass=1.0),
            JOINT.format(name="pin", place="0 0 0 0 0 0", a="world", b="other"),
        ]
    text = f'<sdf version="1.7"><model name="m">{"".join(parts)}</model></sdf>'
    file = saved(tmp_path, "base.sdf", text)
    mechanism = Mechanism(load_scene(str(file)))
    assert mechanism.nv == 1 + joined
    assert not [note for note in read_model(file).notes if "no joint carries" in note.what]
