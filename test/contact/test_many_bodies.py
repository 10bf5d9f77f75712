# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies on bodies, in corners, on links of a mechanism: and beside MuJoCo."""

from itertools import pairwise

import numpy as np
import pytest

from oracles.touching import (
    FLOOR,
    SHAPES,
    UPRIGHT,
    G,
    body,
    held,
    pair,
    run,
    scene,
    shape,
    valley,
)

LAW = {"stiffness": 1e5, "damping": 300.0, "friction": 0.5}


def stack(turn=0.0, law=LAW, gap=0.0):
    names = ("one", "two", "three")
    shapes = [FLOOR, *(shape(name, SHAPES["box"]) for name in names)]
    pairs = [pair("one_shape", **law)]
    pairs += [pair(f"{b}_shape", f"{a}_shape", **law) for a, b in pairwise(names)]
    q = {
        name: [0.004 * i, 0.0, 0.05 + (0.1 + gap) * i, 0, 0, np.sin(turn * i), np.cos(turn * i)]
        for i, name in enumerate(names)
    }
    return scene([body(name) for name in names], shapes, pairs, q)


@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_a_stack_of_three_comes_to_rest(turn):
    sim, states = run(stack(turn, gap=0.001), 1.5, 500)
    end = states[-1]
    assert len(end.touching.pairs) == 12
    assert np.abs(end.v).max() < 1e-5
    for number in range(3):
        up = end.touching.forces[end.touching.pairs == number, 2].sum()
        assert up == pytest.approx((3 - number) * G, rel=1e-4)
    assert end.account.contact_loss > 0.0
    total = held(sim, end) + end.account.contact_loss
    assert total == pytest.approx(held(sim, states[0]), abs=1e-6)


def test_a_box_rests_for_a_minute_where_it_is():
    """On its own four points with friction: neither slides, nor sinks, nor turns."""
    document = scene(
        [body("one")],
        [FLOOR, shape("one", SHAPES["box"])],
        [pair("one_shape", **LAW)],
        {"one": [0, 0, 0.0501, 0, 0, np.sin(0.2), np.cos(0.2)]},
        period=0.005,
    )
    _, states = run(document, 61.0, 200)
    # Positions are rounded, and rates solved for to 1e-8 of what gravity gives them in a step.
    assert np.abs(states[-1].q - states[1].q).max() < 1e-7


def test_a_box_in_a_corner_is_held_by_both_planes():
    """A V of two slopes of 45°, without friction: each carries m g / √2."""
    law = {"stiffness": 1e5, "damping": 300.0}
    q = [0, 0, 0.05 * np.sqrt(2.0), np.sin(np.pi / 8), 0, 0, np.cos(np.pi / 8)]
    document = scene(
        [body("one")],
        [*valley(), shape("one", SHAPES["box"])],
        [pair("one_shape", "left", **law), pair("one_shape", "right", **law)],
        {"one": q},
    )
    _, states = run(document, 0.5, 500)
    touching = states[-1].touching
    assert len(touching.pairs) == 8
    for number in range(2):
        force = touching.forces[touching.pairs == number].sum(axis=0)
        assert np.linalg.norm(force) == pytest.approx(G / np.sqrt(2.0), rel=1e-5)
    assert np.abs(states[-1].v).max() < 1e-6


@pytest.mark.parametrize("above", SHAPES)
@pytest.mark.parametrize("below", ["box", "cylinder"])
def test_any_shape_rests_on_a_face(above, below):
    names = ("under", "over")
    shapes = [FLOOR, shape("under", SHAPES[below]), shape("over", SHAPES[above])]
    pairs = [pair("under_shape", **LAW), pair("over_shape", "under_shape", **LAW)]
    q = {"under": [0, 0, 0.05, *UPRIGHT], "over": [0, 0, 0.15, *UPRIGHT]}
    _, states = run(scene([body(name) for name in names], shapes, pairs, q), 0.4, 400)
    touching = states[-1].touching
    assert touching.forces[touching.pairs == 1, 2].sum() == pytest.approx(G, rel=1e-3)
    assert touching.normals[touching.pairs == 1] == pytest.approx(
        np.tile([0, 0, 1.0], (int((touching.pairs == 1).sum()), 1)), abs=1e-4
    )


def test_action_is_reaction_between_links():
    """Two spheres that meet in free space keep their momentum, and do not gain energy."""
    ball = SHAPES["sphere"]
    document = scene(
        [body("one"), body("two", 3.0)],
        [shape("one", ball), shape("two", ball)],
        [pair("one_shape", "two_shape", stiffness=1e4, friction=0.3)],
        {"one": [-0.1, 0.01, 0, *UPRIGHT], "two": [0.1, 0, 0, *UPRIGHT]},
        {"one": [1.0, 0, 0, 0, 0, 0], "two": [-0.5, 0, 0, 0, 0, 0]},
        gravity=(0, 0, 0),
    )
    sim, states = run(document, 0.3, 300)
    moved = states[-1].q.reshape(2, 7)[:, :3] - states[0].q.reshape(2, 7)[:, :3]
    # Centre of mass: drift of -0.5 / 4 m/s whatever happens; steps of rk4 leave rounding.
    assert (moved[0] + 3.0 * moved[1]) / 0.3 == pytest.approx([-0.5, 0, 0], abs=1e-9)
    assert held(sim, states[-1]) < held(sim, states[0])
    assert states[-1].account.contact_loss > 0.0


def test_as_mujoco_has_it():
    """A box thrown onto a floor: both come to rest, and as far along."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.001" cone="elliptic" impratio="10"/>
        <worldbody><geom type="plane" size="5 5 1" friction="0.4"/>
        <body pos="0 0 0.06"><freejoint/>
        <geom type="box" size="0.05 0.05 0.05" mass="1" friction="0.4"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[0] = 1.5
    for _ in range(1000):
        mujoco.mj_step(model, data)
    document = scene(
        [body("one")],
        [FLOOR, shape("one", SHAPES["box"])],
        [pair("one_shape", stiffness=1e5, damping=300.0, friction=0.4)],
        {"one": [0, 0, 0.06, *UPRIGHT]},
        {"one": [1.5, 0, 0, 0, 0, 0]},
    )
    _, states = run(document, 1.0, 1000)
    assert states[-1].q[0] == pytest.approx(data.qpos[0], rel=0.05)
    assert states[-1].q[2] == pytest.approx(data.qpos[2], abs=1e-3)
    assert np.abs(states[-1].v).max() < 1e-4


def test_a_mesh_is_its_hull(tmp_path):
    """The cube of a mesh rests as a box does."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    triangles = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7)]
    triangles += [(2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    file = tmp_path / "cube.obj"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    mesh = {"kind": "mesh", "file": str(file), "scale": [0.05, 0.05, 0.05]}
    ends = []
    for geometry in (mesh, SHAPES["box"]):
        document = stack()
        document["shapes"] = [FLOOR, *(shape(n, geometry) for n in ("one", "two", "three"))]
        ends.append(run(document, 0.2, 200)[1][-1])
    assert ends[0].q == pytest.approx(ends[1].q, abs=1e-6)
