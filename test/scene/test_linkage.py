# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Linkages by points: what they stand for is what one would have written by hand."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from commands import ran
from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.scene.linkage import with_linkage

ROOT = Path(__file__).resolve().parents[2]
# Rounding of a few sines of angles of order one.
SAME = 1e-12
BASE = {
    "format": "hapticmech-scene/1",
    "name": "drawn",
    "hand": {"kind": "constant_wrench"},
}
FOUR_BAR = {
    "points": {
        "A": [0.0, 0.0],
        "B": [0.03, 0.04],
        "C": [0.15, 0.1],
        "D": [0.2, 0.0],
        "P": [0.1, 0.15],
    },
    "ground": ["A", "D"],
    "bars": [
        {"name": "crank", "points": ["A", "B"], "mass": 0.1},
        {"name": "coupler", "points": ["B", "C", "P"], "density": 1.5},
        {"name": "rocker", "points": ["C", "D"], "mass": 0.2},
    ],
}


def document(linkage, **more):
    found = {**BASE, "task_space": "planar", "linkage": linkage}
    return {**found, "operational_points": [{"name": "handle", "point": "P"}], **more}


def drawn(linkage, **more):
    return scene_from_document(with_linkage(document(linkage, **more), "drawn"))


def state_of(scene):
    sim = Simulator(scene)
    state = sim.initial_state()
    terms = sim.evaluate(state)
    return sim, state, terms


def test_the_five_bar_by_points_is_the_shipped_one():
    hand_written = load_scene("five_bar")
    sim, state, terms = state_of(hand_written)
    points = {"A": [0.0, 0.0], "E": [0.09, 0.0]}
    for name, link in zip("BCD", ("link2", "link3", "link4"), strict=True):
        points[name] = sim.mechanism.frame_pose(state.q, link).translation[:2].tolist()
    bars = [
        {
            "name": f"link{at + 1}",
            "points": list(pair),
            "mass": mass,
            "inertia": inertia,
            "joint": {"name": f"joint{at + 1}", "damping": 0.005},
        }
        for at, (pair, mass, inertia) in enumerate(
            [("AB", 1.0, 0.0021), ("BC", 1.0, 0.0021), ("CD", 1.0, 0.0021), ("DE", 0.5, 0.00105)]
        )
    ]
    linkage = {"points": points, "ground": ["A", "E"], "bars": bars}
    scene = drawn(linkage, operational_points=[{"name": "handle", "point": "C"}])
    assert [link.joint.name for link in scene.links] == [
        link.joint.name for link in hand_written.links
    ]
    other, drawn_state, drawn_terms = state_of(scene)
    assert np.abs(drawn_state.q - state.q).max() < SAME
    d = drawn_terms.closing.space.factor @ drawn_terms.closing.space.factor.T
    np.testing.assert_allclose(
        d, terms.closing.space.factor @ terms.closing.space.factor.T, atol=SAME
    )
    expected = Analyser(sim.mechanism, "handle").analyse(terms).inverse_inertia
    found = Analyser(other.mechanism, "handle").analyse(drawn_terms).inverse_inertia
    np.testing.assert_allclose(found, expected, rtol=SAME, atol=SAME * np.abs(expected).max())


def test_a_bar_weighs_as_rods_between_its_points():
    scene = drawn(FOUR_BAR)
    crank, coupler, rocker = scene.links
    assert crank.inertial.mass == 0.1
    assert crank.inertial.inertia.izz == pytest.approx(0.1 * 0.05**2 / 12.0, rel=SAME)
    # Two rods: their masses, and their moments about the common centre (Huygens and Steiner).
    b, c, p = (np.array(FOUR_BAR["points"][name]) for name in "BCP")
    rods = [(b, c), (c, p)]
    masses = [1.5 * np.linalg.norm(two - one) for one, two in rods]
    middles = [0.5 * (one + two) for one, two in rods]
    com = sum(m * x for m, x in zip(masses, middles, strict=True)) / sum(masses)
    izz = sum(
        m * (np.sum((two - one) ** 2) / 12.0 + np.sum((x - com) ** 2))
        for m, x, (one, two) in zip(masses, middles, rods, strict=True)
    )
    assert coupler.inertial.mass == pytest.approx(sum(masses), rel=SAME)
    assert coupler.inertial.inertia.izz == pytest.approx(izz, rel=SAME)
    sim, state, terms = state_of(scene)
    assert terms.closing.error < SAME
    place = sim.mechanism.frame_pose(state.q, "coupler")
    np.testing.assert_allclose(place.act(np.array(coupler.inertial.com))[:2], com, atol=SAME)
    held = sim.mechanism.frame_pose(state.q, "handle").translation[:2]
    np.testing.assert_allclose(held, p, atol=SAME)
    assert rocker.parent == "coupler"


def test_a_slider_is_where_the_closed_form_of_a_crank_has_it():
    linkage = {
        "points": {"O": [0.0, 0.0], "B": [0.0, 0.05], "P": [np.sqrt(0.15**2 - 0.05**2), 0.0]},
        "ground": ["O"],
        "bars": [
            {"name": "crank", "points": ["O", "B"], "mass": 0.1},
            {"name": "rod", "points": ["B", "P"], "mass": 0.1},
        ],
        "sliders": [{"name": "piston", "point": "P", "along": [2.0, 0.0], "mass": 0.3}],
    }
    points = [{"name": "handle", "point": "P", "metric": {"mass": 1.0, "length": 0.1}}]
    angle = 1.1
    turned = {"q": {"crank_at_O": angle}}
    scene = drawn(linkage, operational_points=points, initial_state=turned)
    sim, state, _ = state_of(scene)
    # Closed from there: wherever the crank is then, the piston is at its place for that angle.
    angle = float(state.q[sim.mechanism.joint_slices("crank_at_O")[0]][0])
    expected = 0.05 * np.cos(angle) + np.sqrt(0.15**2 - (0.05 * np.sin(angle)) ** 2)
    place = sim.mechanism.frame_pose(state.q, "piston").translation
    np.testing.assert_allclose(place, [expected, 0.0, 0.0], atol=1e-11)
    assert abs(angle - np.pi / 2) > 0.01


RSSR = {
    "points": {
        "A": [0.0, 0.0, 0.0],
        "B": [0.0, 0.05, 0.0],
        "C": [0.2, 0.1, 0.12],
        "D": [0.2, 0.1, 0.0],
    },
    "ground": ["A", "D"],
    "hinges": {"A": [0.0, 0.0, 1.0], "D": [0.0, 3.0, 0.0]},
}
ENDS = [
    {"name": "crank", "points": ["A", "B"], "mass": 0.1},
    {"name": "rocker", "points": ["D", "C"], "mass": 0.1},
]
ROD = {"name": "rod", "points": ["B", "C"], "mass": 0.1}


@pytest.mark.parametrize(
    "linkage",
    [
        {**RSSR, "bars": [ENDS[0], ROD, ENDS[1]]},
        {**RSSR, "bars": ENDS, "rods": [{"name": "rod", "points": ["B", "C"]}]},
    ],
    ids=["a rod on balls", "a rod"],
)
def test_a_rod_on_balls_between_hinges_is_where_its_length_has_it(linkage):
    """B turns about z through A and C about y through D: |B - C| = L is A sin + B cos = C."""
    start = {"q": {"crank_at_A": 0.4}}
    scene = drawn(
        linkage,
        task_space="spatial",
        operational_points=[{"name": "handle", "point": "C", "link": "rocker"}],
        initial_state=start,
    )
    sim, state, _ = state_of(scene)
    q, mechanism = state.q, sim.mechanism
    theta = float(q[mechanism.joint_slices("crank_at_A")[0]][0])
    assert abs(theta) > 0.1
    b = 0.05 * np.array([-np.sin(theta), np.cos(theta), 0.0])
    d, arm = np.array(RSSR["points"]["D"]), 0.12
    length = np.linalg.norm(np.subtract(RSSR["points"]["B"], RSSR["points"]["C"]))
    # C = D + arm (sin φ, 0, cos φ): |C - B|² = L².
    gap = d - b
    sine, cosine = 2.0 * arm * gap[0], 2.0 * arm * gap[2]
    rest = length**2 - gap @ gap - arm**2
    middle = np.arctan2(sine, cosine)
    apart = np.arccos(rest / np.hypot(sine, cosine))
    roots = np.array([middle + apart, middle - apart])
    expected = roots[np.argmin(np.abs(roots))]
    place = mechanism.frame_pose(q, "handle").translation
    np.testing.assert_allclose(
        place, d + arm * np.array([np.sin(expected), 0.0, np.cos(expected)]), atol=1e-11
    )
    # The crank, the rod's spin about its own line if it has one.
    spins = any(link.name == "rod" for link in scene.links)
    assert mechanism.nv - state_of(scene)[2].closing.rank == 1 + spins


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ground": ["A", "d"]}, r"linkage.ground: no such point: .*\(got 'd'\)"),
        ({"points": {**FOUR_BAR["points"], "P": [1.0, 2.0, 3.0]}}, "linkage.points.P: .*2 coordi"),
        ({"ground": []}, "bar crank shares no point with the ground"),
        ({"bars": [{"name": "b", "points": ["A", "B"]}]}, "bar b needs mass or density"),
        ({"bars": [{"name": "b", "points": ["A", "BB"], "mass": 1.0}]}, "did you mean 'B'"),
        ({"points": {**FOUR_BAR["points"], "B": [0.0, 0.0]}}, "points A and B of bar crank"),
        ({"bars": [{"name": "b", "points": ["A"], "mass": 1.0}]}, r"linkage.bars\[0\].points"),
        ({"rods": [{"name": "t", "points": ["A", "D"]}]}, "a rod joins points of two bars"),
        (
            {"sliders": [{"name": "s", "point": "C", "along": [0.0, 0.0], "mass": 1.0}]},
            "not be zero",
        ),
        (
            {
                "sliders": [
                    {"name": "s", "point": "C", "along": [1.0, 0.0], "mass": 1.0, "on": "crnk"}
                ]
            },
            "did you mean 'crank'",
        ),
        ({"hinges": {"A": [0.0, 0.0, 1.0]}}, "hinges are for space"),
        ({"bars": [FOUR_BAR["bars"][0]] * 2}, "names of bars and sliders must be unique"),
    ],
)
def test_errors_name_the_point_or_bar(change, said):
    with pytest.raises(SceneError, match=said):
        drawn({**FOUR_BAR, **change})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            {"operational_points": [{"name": "handle", "point": "Q"}]},
            r"operational_points\[0\].point: no such point",
        ),
        ({"links": []}, "links come from the linkage"),
    ],
)
def test_points_of_other_keys_are_checked_too(more, said):
    with pytest.raises(SceneError, match=said):
        drawn(FOUR_BAR, **more)


def test_a_copy_can_be_written_out(tmp_path):
    path, copy = tmp_path / "drawn.yaml", tmp_path / "copy.yaml"
    path.write_text(yaml.safe_dump(document(FOUR_BAR)), encoding="utf-8")
    ran("scene", "copy", path, copy, "--expanded")
    assert "linkage" not in yaml.safe_load(copy.read_text(encoding="utf-8"))
    assert load_scene(copy) == load_scene(path)
    moved = load_scene(path, changes=["linkage.points.B=[0.02, 0.05]"])
    assert moved.links[1].joint.origin.xyz[0] == pytest.approx(np.hypot(0.02, 0.05), rel=SAME)


def test_the_mechanisms_of_the_page_are_scenes(tmp_path):
    page = (ROOT / "docs" / "write-a-mechanism.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    example = (ROOT / "examples" / "four_bar.yaml").read_text(encoding="utf-8")
    assert yaml.safe_load(blocks[0]) == yaml.safe_load(example)
    mobility = {}
    for number, block in enumerate(blocks):
        path = tmp_path / f"{number}.yaml"
        path.write_text(block, encoding="utf-8")
        sim, _, terms = state_of(load_scene(path))
        mobility[sim.scene.name] = sim.mechanism.nv - terms.closing.rank
    # The rod turns about its own line too.
    assert mobility == {"four_bar": 1, "slider_crank": 1, "rod_on_balls": 2}
