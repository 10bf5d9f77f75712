# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks three ways: published values, equations written by hand, and the package.

The equations (test/oracles) share no code with the package: what agrees here is the physics, the
scenes that state it, and the values the package ships.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy import cases, n_four_bar
from hapticmech_ros import Mechanism, Simulator
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.scene import scene_from_document
from oracles import bricard, governor, pendulum, squeezer
from oracles.planar_loops import Loop
from oracles.running import run, total_energy

CASES = {case.name: case for case in cases()}
# Published with 10 digits behind the point, except: A02 12 (N = 40: 10), A05 9, and A03 16, of
# which 9 stand: the equations integrated by two methods at tolerances from 1e-11 to 2e-14 agree
# with each other to 4e-11.
ROUNDING = {
    "pendulum": 6e-11,
    "n_four_bar_2": 5e-12,
    "n_four_bar_40": 6e-11,
    "andrews": 2e-9,
    "bricard": 6e-11,
    "flyball_governor": 6e-10,
}
ORACLES = {
    "pendulum": lambda times: pendulum.let_go(1.0, times),
    "n_four_bar_2": lambda times: pendulum.windows(2, times),
    "n_four_bar_40": lambda times: pendulum.windows(40, times),
    "andrews": squeezer.motion,
    "bricard": bricard.corner,
    "flyball_governor": lambda times: governor.heights(times)[:, None],
}
# Order of the squeezer's angles in the scene's tree, and its coordinates by name.
ANGLES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
IN_TREE = [0, 1, 2, 4, 3, 6, 5]


def named(names):
    return pytest.mark.parametrize("case", [CASES[name] for name in names], ids=lambda c: c.name)


def mechanism_of(name):
    return Mechanism(CASES[name].scene)


@named(CASES)
def test_equations_by_hand_give_the_published_values(case):
    times = case.outputs[0].times
    found = ORACLES[case.name](times)
    if case.name == "andrews":
        errors = [o.error(found[:, [ANGLES.index(o.name)]]) for o in case.outputs]
    else:
        errors = [output.error(found) for output in case.outputs]
    assert max(errors) < ROUNDING[case.name]


def test_windows_fall_in_line_when_it_is_written():
    case = CASES["n_four_bar_2"]
    heights = pendulum.windows(2, case.singular_times)[:, 1]
    # Times are rounded to 5e-9 s, and the tips pass at 4.9 m/s.
    assert np.abs(heights).max() < 5e-9 * 5.0
    assert len(case.singular_times) == 10


# Rows and rank of the closures at the start, and the total mass in kg.
@pytest.mark.parametrize(
    ("name", "freedoms", "rows", "rank", "mass"),
    [
        ("pendulum", 1, 0, 0, 1.0),
        ("n_four_bar_2", 5, 4, 4, 5.0),
        ("n_four_bar_40", 81, 80, 80, 81.0),
        ("andrews", 7, 6, 6, sum(squeezer.MASSES)),
        ("bricard", 5, 5, 4, 5.0),
        ("flyball_governor", 4, 0, 0, 3 * governor.ROD + governor.SLIDER + 2 * governor.BALL),
    ],
)
def test_scene_is_the_mechanism_that_was_published(name, freedoms, rows, rank, mass):
    scene = CASES[name].scene
    mechanism = Mechanism(scene)
    q, v = authored_state(scene, mechanism.tree)
    closing = mechanism.closing_terms(q, mechanism.initially_active)
    assert mechanism.nv == freedoms
    assert closing.jacobian.shape == (rows, freedoms)
    assert closing.space.rank == rank
    # As authored, not as assembled: parts are 1 m long and rates 1 rad/s at most.
    assert closing.error < 1e-15
    assert np.abs(closing.jacobian @ v).max(initial=0.0) < 1e-15
    assert sum(link.inertial.mass for link in scene.links) == pytest.approx(mass, rel=1e-12)
    energy = CASES[name].energy
    if energy is not None:
        assert sum(mechanism.energy(q, v)) == pytest.approx(energy, rel=1e-12, abs=1e-14)


def test_the_small_row_of_windows_is_the_same_from_the_file_and_made():
    assert n_four_bar(2) == CASES["n_four_bar_2"].scene


@pytest.mark.parametrize("windows", [0, -1, 201])
def test_a_row_of_windows_has_some_but_not_too_many(windows):
    with pytest.raises(InvalidInputError, match="windows"):
        n_four_bar(windows)


@pytest.mark.parametrize("seed", range(5))
def test_squeezer_by_hand_has_the_scene_s_inertia_and_closures(seed):
    rng = np.random.default_rng(seed)
    angles, rates = squeezer.START + rng.uniform(-1.0, 1.0, 7), rng.uniform(-100.0, 100.0, 7)
    mechanism = mechanism_of("andrews")
    q, v = angles[IN_TREE], rates[IN_TREE]
    terms = mechanism.evaluate(q, v, mechanism.initially_active)
    inertia, force = squeezer.dynamics(squeezer.BARS, angles, rates)
    expected = inertia[np.ix_(IN_TREE, IN_TREE)]
    scale = np.abs(expected).max()
    assert np.abs(terms.inertia - expected).max() < 1e-13 * scale
    assert np.abs(terms.bias_force + force[IN_TREE]).max() < 1e-13 * scale * 1e4
    assert np.abs(terms.closure_residual - squeezer.closing(angles)).max() < 1e-15


def test_squeezer_s_spring_and_drive_are_where_they_are_by_hand():
    mechanism = mechanism_of("andrews")
    (spring,) = mechanism.scene.springs
    angles = squeezer.START + 0.3
    held = mechanism.frame_pose(angles[IN_TREE], spring.a.link).act(np.array(spring.a.origin.xyz))
    assert abs(complex(*held[:2]) - squeezer.SPRING_END.at(angles)) < 1e-15
    assert (spring.b.link, complex(*spring.b.origin.xyz[:2])) == ("world", squeezer.C)
    assert (spring.stiffness, spring.rest_length) == (squeezer.STIFFNESS, squeezer.REST)
    efforts = {link.joint.name: link.joint.effort for link in mechanism.scene.links}
    assert efforts == dict.fromkeys(ANGLES, 0.0) | {"beta": squeezer.TORQUE}


@pytest.mark.parametrize("angle", [-0.4, 0.0, np.pi / 6, 1.2])
def test_governor_by_hand_has_the_scene_s_inertia(angle):
    mechanism = mechanism_of("flyball_governor")
    q = np.array([0.7, angle, angle, 0.6])
    inertia = mechanism.evaluate(q, np.zeros(4), ()).inertia
    arm = governor.ACROSS + governor.ROD * 0.25 + governor.BALL
    expected = np.diag([governor.about_shaft(angle)[0], arm, arm, governor.SLIDER])
    assert np.abs(inertia - expected).max() < 1e-13 * expected.max()


def test_governor_s_springs_start_slack():
    mechanism = mechanism_of("flyball_governor")
    q, _ = authored_state(mechanism.scene, mechanism.tree)
    for spring in mechanism.scene.springs:
        ends = [
            mechanism.frame_pose(q, end.link).act(np.array(end.origin.xyz))
            for end in (spring.a, spring.b)
        ]
        assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(spring.rest_length, abs=1e-15)


@named(["pendulum", "n_four_bar_2", "bricard"])
def test_the_package_gives_the_published_values(case):
    simulator = Simulator(case.scene)
    output = case.outputs[0]
    states = run(simulator, output.times[-1])
    at_times = [states[round(time / simulator.period)] for time in output.times]
    found = [
        simulator.evaluate(state).points[0].pose.translation[list(output.components)]
        for state in at_times
    ]
    assert output.error(found) < output.tolerance
    assert total_energy(simulator, states[-1]) == pytest.approx(case.energy, abs=1e-9)


def loops():
    three, four = np.array([0.3, 0.9, 0.7]), np.array([0.5, 0.8, 0.6, 0.7])
    crank = Loop(three[:2], np.array([0.4, 0.9]), np.array([0.01, 0.05]), None, 1.7)
    return {
        "slider_crank": (crank, [0.4], [6.0]),
        "slider_crank_behind": (_weighed(crank, side=-1), [2.0], [-6.0]),
        "four_bar": (
            Loop(three, np.array([0.5, 1.5, 1.0]), three**2 / 12, np.array([0.8, 0.1])),
            [1.1],
            [5.0],
        ),
        "five_bar": (
            Loop(four, four, four**3 / 12, np.array([1.0, -0.1]), side=-1),
            [2.2, 0.7],
            [1.0, -2.0],
        ),
    }


def _weighed(loop, **changes):
    return replace(loop, **({"gravity": -9.81, "damping": 0.05} | changes))


@pytest.mark.parametrize("name", loops())
@pytest.mark.parametrize("weighed", [False, True])
def test_planar_loops_by_hand_and_the_package_move_alike(name, weighed):
    loop, u, speed = loops()[name]
    loop = _weighed(loop) if weighed else loop
    u, speed = np.array(u), np.array(speed)
    document = loop.document(u, speed)
    document["simulation"] = {"period": 2.5e-4, "integrator": "rk4"}
    simulator = Simulator(scene_from_document(document))
    states = run(simulator, 0.2)
    times = [0.1, 0.2]
    found = [states[round(time / simulator.period)].q[: loop.lengths.size] for time in times]
    turned, expected = np.cumsum(found, axis=1), loop.motion(u, speed, times)
    # rk4 at 0.25 ms and up to 20 rad/s: (5e-3)^4 = 6e-10 of a step's share, summed over 4 rad.
    assert np.abs(np.exp(1j * turned) - np.exp(1j * expected)).max() < 1e-10
    moved = np.abs(expected - loop.angles(u)).max()
    assert moved > 0.1


def test_an_output_tells_the_worst_component_and_refuses_other_shapes():
    output = CASES["pendulum"].outputs[0]
    found = np.array(output.values)
    found[1, 0] += 2e-3
    found[0, 1] -= 1e-3
    assert output.error(found) == pytest.approx(2e-3, rel=1e-9)
    with pytest.raises(InvalidInputError, match="shape"):
        output.error(found[:1])
