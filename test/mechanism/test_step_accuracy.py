# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps whose energy account is off: refined, counted, and above a limit refused."""

import numpy as np
import pytest

from benchmarks.accuracy.n_four_bar import document as windows
from hapticmech_ros import Session, Simulator, load_scene
from hapticmech_ros.errors import ClosureError, InaccurateStepError
from hapticmech_ros.scene import scene_from_document
from oracles import pendulum
from oracles.planar_linkages import chain, elbow, five_bar, five_bar_bent, pin_end, relative_angles
from oracles.running import (
    run,
    simulator,
    total_energy,
    unaccounted,
    varied,
    with_joints,
    with_start,
    wrenches_on,
)


def pushed_down(force, **accuracy):
    """Return simulator and states of the scissor lift, its platform pushed down (N)."""
    step = {"accuracy": accuracy, "integrator": "rk2"}
    sim = Simulator(varied(load_scene("scissor_lift"), simulation=step))
    down = (0.0, -force, 0.0, 0.0, 0.0, 0.0)
    return sim, run(sim, 0.6, wrenches_on(sim, platform_rim=down))


@pytest.mark.parametrize("force", [20.0, 50.0])
def test_a_lift_pushed_to_its_stops_makes_no_energy(force):
    """Without a watch the account is off by 4 % of what is exchanged, or more than all of it."""
    sim, states = pushed_down(force)
    account = states[-1].account
    exchanged = abs(account.work_in) + account.damping_loss
    off = unaccounted(sim, states)
    assert off[-1] == pytest.approx(account.surplus, abs=1e-9 * exchanged)
    assert off.max() < 1e-3 * exchanged
    assert account.refined > 0
    unwatched, before = pushed_down(force, tolerance=0.0)
    assert np.abs(unaccounted(unwatched, before)).max() > 0.03 * exchanged


def nearly_crossing(epsilon, period):
    """Return a turning parallelogram next to the line, one crank longer by ``epsilon`` (m)."""
    lengths, masses = np.array([1.0, 2.0, 1.0 + epsilon]), np.array([1.0, 2.0, 0.7])
    document = pin_end(chain(lengths, masses, masses * lengths**2 / 12.0), np.array([2.0, 0.0]))
    angle, pivot = -0.0513, np.array([2.0, 0.0])
    tip = np.array([np.cos(angle), np.sin(angle)])
    both = [[angle, *elbow(tip, 2.0, lengths[2], pivot, side)] for side in (1, -1)]
    absolute = np.array(min(both, key=lambda found: abs(np.sin(found[1]))))
    return simulator(
        with_start(document, relative_angles(absolute), np.array([5.0, -5.0, 5.0])), period
    )


@pytest.mark.parametrize("period", [1e-3, 1e-4])
@pytest.mark.parametrize("epsilon", 10.0 ** np.arange(-12.0, -2.0))
def test_branches_that_nearly_cross_make_no_energy(epsilon, period):
    sim = nearly_crossing(epsilon, period)
    state, nothing = sim.initial_state(), wrenches_on(sim)
    start = total_energy(sim, state)
    for _ in range(round(0.04 / period)):
        state = sim.step(state, nothing)
        assert total_energy(sim, state) < start * (1.0 + 1e-5)
    lost = 1.0 - total_energy(sim, state) / start
    assert lost < 1e-4 or state.account.inaccurate
    # By steps of equal length alone it was 4e-3.
    assert lost < 5e-5


def test_what_cannot_be_refined_is_an_error_that_names_a_joint():
    lengths, masses = np.array([1.0, 0.5]), np.array([1.0, 0.3])
    document = chain(lengths, masses, masses * lengths**2 / 12.0)
    document["links"][1]["joint"] |= {"stiffness": 1e11, "rest": 0.0}
    sim = simulator(with_start(document, np.array([0.3, 1e-6])))
    with pytest.raises(InaccurateStepError, match=r"step at 0.* s .* joint") as raised:
        sim.run(sim.initial_state(), 100)
    assert raised.value.joint == document["links"][1]["joint"]["name"]
    assert abs(raised.value.off) > 0.1 * raised.value.exchanged
    stepped = sim.run(sim.initial_state(), round(raised.value.time / sim.period)).end
    with pytest.raises(InaccurateStepError, match=str(raised.value).split(" has ")[0]):
        sim.step(stepped, wrenches_on(sim))


def test_a_loop_that_springs_tear_open_says_so():
    """Smaller steps are tried before that: the error is that of the whole step."""
    document = with_start(five_bar(), five_bar_bent(1.9, 0.6))
    sim = simulator(with_joints(document, stiffness=1e8, rest=0.0))
    with pytest.raises(ClosureError, match="came apart"):
        sim.run(sim.initial_state(), 100)


def test_a_session_has_the_account_of_its_mechanism():
    session = Session(load_scene("five_bar"))
    before = total_energy(session.simulator, session.mechanism)
    session.run(500)
    after, account = session.mechanism, session.mechanism.account
    off = total_energy(session.simulator, after) - before - account.work_in + account.damping_loss
    assert off == pytest.approx(account.surplus, abs=1e-15)
    assert 0.0 < abs(off) < 1e-4 * (abs(account.work_in) + account.damping_loss)
    assert account.refined < 5
    assert account.inaccurate == 0


def test_steps_within_their_tolerance_add_up_to_a_drift_that_is_told():
    """A body that tumbles by 0.6 rad in a step: each one is within 1e-6."""
    document = chain(np.array([0.3]), np.array([1.0]), np.array([1e-3]))
    document["task_space"] = "spatial"
    link = document["links"][0]
    link["joint"] = {"name": "ball", "type": "spherical"}
    link["inertial"]["inertia"] = {"ixx": 1e-3, "iyy": 7e-3, "izz": 7.5e-3}
    sim = simulator(with_start(document, np.array([0, 0, 0, 1.0]), np.array([0.5, 8.0, 600.0])))
    start = sim.initial_state()
    kinetic, state = sim.mechanism.energy(start.q, start.v)[0], sim.run(start, 5000).end
    now = sim.mechanism.energy(state.q, state.v)[0]
    assert state.account.inaccurate == 0
    assert state.account.drift(now) == pytest.approx(abs(now - kinetic) / now, rel=1e-3)
    assert state.account.drift(now) > 1e-5


def test_a_mechanism_at_rest_without_load_is_accurate_by_a_rule_whose_account_is_only_counted():
    """Nothing is exchanged, of which any share is allowed, an infinite one too."""
    document = with_start(five_bar(), five_bar_bent(1.9, 0.6)) | {"gravity": [0.0, 0.0, 0.0]}
    sim = simulator(document, integrator="semi_implicit_euler")
    for state in (sim.run(sim.initial_state(), 20).end, run(sim, 0.02)[-1]):
        assert state.account.refined == state.account.inaccurate == 0


# Tolerances of the motion below, where a rule's own would have steps done again.
COARSE = {"rk2": 1e-3}


def swinging(integrator):
    """Return the document of two bars on springs whose motions turn by 0.1 to 0.6 rad in a step."""
    document = chain(np.array([1.0, 0.8]), np.array([1.0, 0.5]), np.array([1.0, 0.5]) / 12.0)
    document = with_joints(document, stiffness=2000.0, rest=0.0)
    document |= {"hand": {"kind": "constant_wrench"}}
    # Steps that count as accurate and are not done again: what they add up to is tested.
    accuracy = {"tolerance": COARSE.get(integrator)}
    simulation = {"integrator": integrator, "accuracy": accuracy}
    return with_start(document, np.array([0.3, -0.4])) | {"simulation": simulation}


def test_energy_that_swings_and_comes_back_is_left_in_the_motion():
    """Semi-implicit Euler's, by 1.5e-3 of what moves in two parallelograms at 1 ms.

    Its crests taken out, the motion is 0.14 m behind after 10 s, ten crossings later; with them it
    is where the exact one is to the order of the rule.
    """
    sim = simulator(windows(2), integrator="semi_implicit_euler")
    end = sim.run(sim.initial_state(), 10_000).end
    mechanism = sim.mechanism
    tip = mechanism.evaluate(end.q, end.v, end.active).points[mechanism.point_index("b0")].pose
    exact = pendulum.windows(2, [10.0])[0]
    assert np.abs(tip.translation[:2] - exact).max() < 1e-4
    assert end.account.inaccurate == 0


# What a session may make from nothing, of what it exchanged: `drift` of the rule, and a step more.
DRIFTS = {"rk2": 1.1e-3, "semi_implicit_euler": 1.1e-2}


@pytest.mark.parametrize("integrator", DRIFTS)
def test_what_accurate_steps_add_up_to_is_taken_out_of_the_motion(integrator):
    """Kinetic and potential energy stay below start, work and losses, step by step or in a run."""
    sim = Simulator(scene_from_document(swinging(integrator)))
    states = run(sim, 2.0)
    off, account = unaccounted(sim, states), states[-1].account
    assert off.max() < DRIFTS[integrator] * max(sim.mechanism.energy(s.q, s.v)[0] for s in states)
    assert off[-1] == pytest.approx(account.surplus, abs=1e-9 * total_energy(sim, states[0]))
    assert account.inaccurate > 0
    at_once = sim.run(states[0], 2000).end
    assert at_once.account == account
    assert np.array_equal(at_once.v, states[-1].v)
