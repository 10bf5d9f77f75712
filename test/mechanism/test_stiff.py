# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The linearly implicit rule: against closed forms and references, and what dies out in a step."""

import numpy as np
import pytest

from benchmarks.accuracy import cases
from hapticmech_ros.errors import InaccurateStepError, InvalidInputError
from hapticmech_ros.mechanism.schemes import COUPLED, DIAGONAL, REACHED, WEIGHTS
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.odes import solve_stiff
from oracles.planar_linkages import bar, five_bar, five_bar_bent
from oracles.running import run, with_start

PERIOD = 1e-3
GOVERNOR = next(case for case in cases() if case.name == "flyball_governor")


def simulated(document, period=PERIOD, **simulation):
    step = {"period": period, "integrator": "linearly_implicit"} | simulation
    return Simulator(scene_from_document(document | {"simulation": step}))


def swung(q=0.3, v=0.0, **joint):
    """Return a bar on a pivot; its moment of inertia about the pivot is 0.00260625 kg m²."""
    document = bar()
    document["links"][0]["joint"] |= joint
    return with_start(document, np.array([q]), np.array([v]))


MOMENT = 0.0021 + 1.0 * 0.0225**2


def test_the_coefficients_are_of_order_three_with_any_jacobian():
    g = DIAGONAL
    assert abs(g**3 - 3.0 * g**2 + 1.5 * g - 1.0 / 6.0) < 1e-15
    a, c, b = REACHED, COUPLED + g * np.eye(4), WEIGHTS
    at, one = a.sum(axis=1), np.ones(4)
    # Trees up to order 3, every edge either f' (α) or J (γ); those with J vanish.
    expected = {
        (): (b @ one, 1.0),
        "a": (b @ at, 1 / 2),
        "c": (b @ c @ one, 0.0),
        "a2": (b @ at**2, 1 / 3),
        "aa": (b @ a @ at, 1 / 6),
        "ac": (b @ a @ c @ one, 0.0),
        "ca": (b @ c @ at, 0.0),
        "cc": (b @ c @ c @ one, 0.0),
    }
    for found, wanted in expected.values():
        assert abs(found - wanted) < 1e-15
    # Stiffly accurate.
    assert np.abs(a[3] + c[3] - b).max() == 0.0


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_a_linear_oscillator(damping):
    """q = exp(-d t) (cos w t + d / w sin w t), to order 3 where the step follows it."""
    stiffness, end = 30.0, 0.1
    decay = damping / (2.0 * MOMENT)
    turn = np.sqrt(stiffness / MOMENT - decay**2)
    fading, phase = 0.3 * np.exp(-decay * end), turn * end
    q = fading * (np.cos(phase) + decay / turn * np.sin(phase))
    v = -fading * (turn + decay**2 / turn) * np.sin(phase)
    errors = []
    for period in (4e-4, 2e-4):
        document = swung(stiffness=stiffness, damping=damping)
        last = run(simulated(document, period), end)[-1]
        errors.append(np.hypot(last.q[0] - q, (last.v[0] - v) / turn))
    assert errors[0] < 1e-4
    assert abs(np.log2(errors[0] / errors[1]) - 3.0) < 0.15


@pytest.mark.parametrize("joint", [{"stiffness": 1e8}, {"damping": 1e6}])
def test_what_is_much_faster_than_the_step_dies_out(joint):
    """L-stable: what explicit rules blow up is gone after a few steps, and no rate is left."""
    states = run(simulated(swung(v=5.0, **joint), 1e-2), 0.1)
    assert abs(states[-1].q[0]) < (1e-5 if "stiffness" in joint else 0.31)
    assert abs(states[-1].v[0]) < 1e-3
    blown = simulated(swung(v=5.0, **joint), 1e-2, integrator="rk4")
    with pytest.raises(InaccurateStepError, match="joint1"):
        run(blown, 1.0)
    unwatched = {"integrator": "rk4", "accuracy": {"tolerance": 0.0}}
    with pytest.raises(InvalidInputError, match="finite"):
        run(simulated(swung(v=5.0, **joint), 1e-2, **unwatched), 1.0)


def test_friction_holds_a_bar_against_a_push():
    """It creeps at the speed where tanh balances the push, without rattling."""
    document = swung(friction=1.0, friction_speed=1e-3, effort=0.5)
    sim = simulated(document)
    states = run(sim, 0.2)
    creep = 1e-3 * np.arctanh(0.5)
    rates = np.array([state.v[0] for state in states[50:]])
    assert np.abs(rates - creep).max() < 1e-3 * creep


def test_the_governor_at_a_millisecond():
    """Springs and dampers of 8e5 N/m and 4e4 N s/m between 3 kg: rates of 3e4 1/s."""
    output = GOVERNOR.outputs[0]
    errors = []
    for period in (1e-3, 5e-4):
        step = {"integrator": "linearly_implicit", "substeps": 1, "period": period}
        sim = Simulator(GOVERNOR.scene.stepped(**step))
        states = run(sim, output.times[1])
        picked = [states[round(time / period)] for time in output.times[:2]]
        heights = [sim.mechanism.frame_pose(s.q, output.name).translation[2] for s in picked]
        errors.append(np.abs(np.array(heights) - np.array(output.values[:2])[:, 0]).max())
    # 7e-7 and 1.4e-7 were measured: h times the spring's rate is 30, where orders are lower.
    assert errors[0] < 2e-6
    assert np.log2(errors[0] / errors[1]) > 2.0


@pytest.mark.parametrize("duplicated", [False, True])
def test_a_closed_chain_with_a_stiff_joint_follows_the_reference(duplicated):
    q, v = five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5])
    document = with_start(five_bar(-9.81, 0.002), q, v)
    document["links"][1]["joint"] |= {"stiffness": 5e3, "damping": 5.0, "rest": float(q[1])}
    if duplicated:
        pin_ = document["closures"][0]
        document["closures"] = [pin_, pin_ | {"name": "again"}]
    start = simulated(document)
    begun, mechanism = start.initial_state(), start.mechanism

    def rates(_, state):
        terms = mechanism.evaluate(state[:4], state[4:], begun.active)
        return np.concatenate((state[4:], terms.acceleration(np.zeros(4))[0]))

    (expected,) = solve_stiff(rates, np.concatenate((begun.q, begun.v)), [0.2])
    errors = []
    for period in (1e-3, 5e-4):
        end = run(simulated(document, period), 0.2)[-1]
        errors.append(np.abs(end.q - expected[:4]).max())
        assert end.closure_error < 1e-14
    assert errors[0] < 1e-5
    assert errors[0] > 4.0 * errors[1]


@pytest.mark.parametrize(("period", "slowest"), [(2e-3, 0.1), (2.5e-5, -1.99)])
def test_a_stop_gives_back_no_more_than_it_got(period, slowest):
    """A bar thrown against a hard stop, 6000 rad/s: long steps take its energy, short ones none."""
    limits = {"lower": -1.0, "upper": 0.4, "stiffness": 1e5, "damping": 0.0}
    states = run(simulated(swung(v=2.0, limits=limits), period), 0.07)
    # At 2.5e-5 s it leaves by 8e-4 too fast, to order 3 in 0.15 rad a step.
    assert -2.002 < states[-1].v[0] < slowest
    # 2 rad/s over 6000 rad/s, and what a long step goes before it sees the stop.
    assert max(state.q[0] for state in states) < 0.4 + 4e-4 + 2.0 * period


def test_friction_stops_a_bar_where_it_should():
    """v = v0 - f t / I until it stops: 5 rad/s, 0.1 N m, half the way of v0² I / 2f."""
    states = run(simulated(swung(v=5.0, friction=0.1)), 0.2)
    way = 0.5 * 25.0 * MOMENT / 0.1
    assert abs(states[-1].v[0]) < 1e-9
    # tanh lets go a little below its speed of 0.01 rad/s.
    assert states[-1].q[0] - 0.3 == pytest.approx(way, abs=2e-4)
