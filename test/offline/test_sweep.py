# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joints prescribed over a grid: loops stay closed and on their branch."""

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.offline import PrescribedJoint, SweptStates, sweep
from hapticmech_ros.offline.figure import sweep_figure
from hapticmech_ros.operational import analyse
from hapticmech_ros.scene import scene_from_document
from oracles.generator import closed_chain
from oracles.planar_linkages import LENGTHS, PIVOT, elbow
from oracles.running import with_start

WIDE = PrescribedJoint("joint1", tuple(np.linspace(-3.0, 3.0, 25).tolist()))
BENT = PrescribedJoint("joint2", tuple(np.linspace(-2.0, 2.0, 17).tolist()))


@pytest.fixture(scope="module")
def five_bar():
    return load_scene("five_bar")


@pytest.fixture(scope="module")
def swept(five_bar):
    told = []
    found = sweep(five_bar, [WIDE, BENT], workers=1, show=told.append)
    assert told[-1] == len(found.grid)
    return found


def test_prescribed_joints_are_where_they_were_put(swept):
    assert np.abs(swept.q[:, :2] - swept.places).max() < 1e-15 * 8
    for axis, prescribed in enumerate((WIDE, BENT)):
        assert (np.array(prescribed.values)[swept.grid[:, axis]] == swept.places[:, axis]).all()
    assert len({tuple(row) for row in swept.grid.tolist()}) == len(swept.grid)


def test_loops_are_closed_and_some_places_out_of_reach(five_bar, swept):
    mechanism = Mechanism(five_bar)
    active = mechanism.initially_active
    errors = [mechanism.closing_terms(q, active).error for q in swept.q]
    assert max(errors) < 1e-12
    assert 100 < len(errors) < 25 * 17


def test_the_rest_is_what_triangles_say(swept):
    """Given two bars, the other two are an elbow, bent to one side or the other."""
    sides = set()
    for q in swept.q:
        absolute = np.cumsum(q)
        tip = sum(
            length * np.array([np.cos(angle), np.sin(angle)])
            for length, angle in zip(LENGTHS[:2], absolute[:2], strict=True)
        )
        gaps = {}
        for side in (1, -1):
            angles = elbow(tip, LENGTHS[2], LENGTHS[3], PIVOT, side)
            gaps[side] = np.abs(np.exp(1j * np.array(angles)) - np.exp(1j * absolute[2:])).max()
        side = min(gaps, key=gaps.get)
        # Near where the elbow is straight its angle is the root of what closes it.
        assert gaps[side] < 1e-5
        sides.add(side if gaps[-side] > 1e-2 else 0)
    assert len(sides - {0}) == 1


def test_what_is_left_out_is_out_of_reach(swept):
    """All that triangles can close is found: here all of it hangs together."""
    reached = {tuple(row) for row in swept.grid.tolist()}
    for i, first in enumerate(WIDE.values):
        for k, second in enumerate(BENT.values):
            tip = LENGTHS[0] * np.exp(1j * first) + LENGTHS[1] * np.exp(1j * (first + second))
            gap = abs(complex(*PIVOT) - tip)
            slack = min(LENGTHS[2] + LENGTHS[3] - gap, gap - abs(LENGTHS[3] - LENGTHS[2]))
            # Within 2 mm of straight the way there may lead past where it is straight.
            if abs(slack) > 0.002:
                assert ((i, k) in reached) == (slack > 0.0), (first, second)


def test_it_is_the_analysis_of_each_place(five_bar, swept):
    mechanism = Mechanism(five_bar)
    for index in range(0, len(swept.q), 23):
        expected = analyse(mechanism, swept.q[index])
        scale = np.abs(expected.inverse_inertia).max()
        assert np.abs(swept.inverse_inertia[index] - expected.inverse_inertia).max() < 1e-8 * scale
        assert np.abs(swept.s[index] - expected.spectrum.s).max() < 1e-7
        on = five_bar.perception.s_on
        assert swept.count[index] == int((swept.s[index] <= on).sum())


def test_processes_share_the_work_and_change_nothing(five_bar, swept):
    again = sweep(five_bar, [WIDE, BENT], workers=2)
    assert again.q.tobytes() == swept.q.tobytes()
    assert again.grid.tolist() == swept.grid.tolist()
    assert again.inverse_inertia.tobytes() == swept.inverse_inertia.tobytes()


def test_an_open_chain_goes_everywhere():
    scene = load_scene("two_link")
    joint = Mechanism(scene).tree.joint_names[1]
    prescribed = PrescribedJoint(joint, tuple(np.linspace(-np.pi, np.pi, 31).tolist()))
    found = sweep(scene, [prescribed])
    assert found.places[:, 0].tolist() == list(prescribed.values)
    # Two joints in a plane's three directions.
    assert (found.count == 1).all()


@pytest.mark.parametrize(
    ("prescribed", "rule"),
    [
        ([], "at least one"),
        ([WIDE, WIDE], "named once"),
        ([PrescribedJoint("elbow", (0.0,))], "must be one of joint1"),
        ([PrescribedJoint("joint1", ())], "at least one number"),
        ([PrescribedJoint("joint1", (0.0, float("nan")))], "finite"),
        (
            [
                PrescribedJoint("joint1", (0.5,)),
                PrescribedJoint("joint2", (3.1,)),
                PrescribedJoint("joint3", (3.1,)),
            ],
            "can reach",
        ),
    ],
)
def test_what_cannot_be_led_is_refused(five_bar, prescribed, rule):
    with pytest.raises(InvalidInputError, match=rule):
        sweep(five_bar, prescribed, workers=1)


def test_a_joint_of_several_degrees_of_freedom_is_refused():
    sample = closed_chain(1, "weld")
    scene = scene_from_document(with_start(sample.document, sample.q))
    joints = [link["joint"] for link in sample.document["links"]]
    names = [joint["name"] for joint in joints if joint["type"] == "spherical"]
    with pytest.raises(InvalidInputError, match="one degree of freedom"):
        sweep(scene, [PrescribedJoint(names[0], (0.0,))])


@pytest.mark.parametrize("joints", [["joint1=-1:1:9"], ["joint1=-1:1:9", "joint2=-1:1:7"]])
def test_the_command_writes_a_table_and_a_picture(joints, tmp_path):
    options = [part for joint in joints for part in ("--joint", joint)]
    command = ["sweep", "five_bar", *options, "--processes", "1", "--out", str(tmp_path)]
    done = ran(*command)
    assert "places reached" in done
    with np.load(tmp_path / "sweep.npz") as table:
        assert table["inverse_inertia"].shape[1:] == (6, 6)
        assert table["places"].shape[1] == len(joints)
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("places", [1, 2])
def test_a_mechanism_that_is_rigid_everywhere_has_a_picture_too(swept, places):
    n = places * 2
    arrays = {name: np.zeros((n, *array.shape[1:])) for name, array in swept.arrays().items()}
    arrays["grid"] = np.array([(i, k) for i in range(2) for k in range(places)])
    arrays["count"] = np.full(n, 3)
    prescribed = [
        PrescribedJoint("up", (0.0, 1.0)),
        PrescribedJoint("across", tuple(map(float, range(places)))),
    ]
    figure = sweep_figure(SweptStates(**arrays), prescribed, load_scene("five_bar"))
    figure.canvas.draw()
    said = {axes.get_title().split(": ")[1] for axes in figure.axes}
    assert said == {"rigid at all places"}
    arrays["inverse_inertia"][:] = np.eye(6)
    figure = sweep_figure(SweptStates(**arrays), prescribed, load_scene("five_bar"))
    figure.canvas.draw()
    assert figure.axes[0].get_title() == "mass along x (kg)"


@pytest.mark.parametrize("text", ["joint1", "joint1=1:2", "joint1=a:b:c", "joint1=0:1:-3"])
def test_the_command_says_what_a_joint_must_look_like(text):
    with pytest.raises(InvalidInputError, match="NAME=FROM:TO:NUMBER"):
        ran("sweep", "five_bar", "--joint", text)
