# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two users on the five-bar, against its Lagrange equations in independent coordinates."""

from contextlib import ExitStack
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from hapticmech_ros import SharedSession, Simulator, load_scene
from hapticmech_ros.analysis.scene_variants import of_first_user
from hapticmech_ros.analysis.touch import scripted
from hapticmech_ros.operational.analysis import coupling
from hapticmech_ros.plan.step_accuracy import experiment_run
from hapticmech_ros.scene.hand import ARM_IMPEDANCES
from oracles.five_bar import FiveBar
from sampling import only_long, sampled

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
LEFT, RIGHT = 1, 2
LINKS = {"left": LEFT, "right": RIGHT}
IDLE = {"kind": "constant_wrench", "start_delay": 0.0}
# Push of each user: it turns links by less than 0.3 mrad in the time that is looked at.
PUSHES = {
    "left": np.array([-0.01, 0.003, 0.0, 0.0, 0.0, 1e-4]),
    "right": np.array([0.005, 0.008, 0.0, 0.0, 0.0, -2e-4]),
}

PUSHING = [("left",), ("right",), ("left", "right")]


def linkage(q):
    return FiveBar(q[0], q[0] + q[1])


def undamped(**keys):
    """Return the scene without friction in its joints, with other hands."""
    free = [f"links[{index}].joint.damping=0.0" for index in range(4)]
    return load_scene("two_users").with_(*free, **keys)


def found_couplings(scene, q=None):
    simulator = Simulator(scene)
    state = simulator.initial_state()
    terms = simulator.evaluate(state)
    if q is not None:
        terms = simulator.mechanism.evaluate(q, np.zeros(4), state.active)
    return coupling(terms), state.q if q is None else q


@cache
def experiment():
    scene = load_scene("two_users")
    ticks = round((scene.hand.start_delay + scene.experiment.duration) / scene.simulation.period)
    return SharedSession(scene).run(ticks)


def test_the_start_is_as_written():
    _, q = found_couplings(load_scene("two_users"))
    bar = linkage(q)
    assert bar.starts[2] == pytest.approx([0.035, 0.065], abs=1e-9)
    assert bar.angles == pytest.approx(np.cumsum(q), abs=1e-12)


def test_the_inverse_inertia_of_both_users_and_between_them():
    found, q = found_couplings(load_scene("two_users"))
    bar = linkage(q)
    for i, one in enumerate(LINKS.values()):
        for j, other in enumerate(LINKS.values()):
            wanted = bar.coupling(one, other)
            # Rounding, and the loop, which is closed to 1e-12 of its size.
            assert np.abs(found[i, j][PLANAR] - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_each_meets_one_joint_constraint_along_its_outer_link():
    """X_ii and X_ij are zero for it: it moves nobody, and nobody else moves that way."""
    found, q = found_couplings(load_scene("two_users"))
    bar = linkage(q)
    for index, (link, outer) in enumerate(((LEFT, 0), (RIGHT, 3))):
        wrench = bar.balanced(link, outer)
        for other in range(2):
            moved = found[other, index][PLANAR] @ wrench
            assert np.abs(moved).max() < 1e-11 * np.abs(found[other, index][PLANAR]).max()
        sigma = np.linalg.svd(found[index, index][PLANAR], compute_uv=False)
        assert sigma[1] > 1e-3 * sigma[0]
        assert sigma[2] < 1e-12 * sigma[0]


def test_links_1_and_2_in_line_take_a_direction_from_right_alone():
    """Left, on link 2, keeps its two: along the line nobody moves, but link 2 turns."""
    bar = FiveBar(0.8, 0.8)
    q = np.diff(bar.angles, prepend=0.0)
    found, _ = found_couplings(load_scene("two_users"), q)
    ranks = []
    for index, link in enumerate(LINKS.values()):
        block = found[index, index][PLANAR]
        assert block == pytest.approx(bar.coupling(link, link), abs=1e-9 * np.abs(block).max())
        sigma = np.linalg.svd(block, compute_uv=False)
        ranks.append(int(np.count_nonzero(sigma > 1e-9 * sigma[0])))
    assert ranks == [2, 1]
    wrench = bar.balanced(RIGHT, 1)
    assert np.abs(found[1, 1][PLANAR] @ wrench).max() < 1e-9 * np.abs(found[1, 1][PLANAR]).max()


def errors_of_accelerations(pushing, period):
    """Return how far points and devices are from Σ X_ij F_j, relative to its largest part."""
    idle, begins = [{"point": point, "hand": IDLE} for point in LINKS], 0.7
    scene = undamped(hands=idle, simulation={"period": period})
    pushes = {point: PUSHES[point] for point in pushing}
    # In a ramp: a jump, or one at each sample, is none that a device can carry on.
    times = begins + np.array([0.0, 0.01, 0.1])
    with ExitStack() as scripts:
        hands = []
        for held in scene.hands:
            push = np.outer([0.0, 1.0, 1.0], pushes.get(held.point, np.zeros(6)))
            hand = scripts.enter_context(scripted(times, push))
            hands.append(held.model_copy(update={"hand": hand}))
        session = SharedSession(scene.model_copy(update={"hands": tuple(hands)}))
    session.run(round(begins / period))
    bar = linkage(session.mechanism.q)
    count, late = round(0.05 / period), slice(round(0.02 / period), None)
    times = period * np.arange(count)
    samples = [session.tick() for _ in range(count)]
    # What the push has set in motion on the springs along constrained directions moves no rate of
    # the linkage, if seen by the device's inertia.
    inertia = np.diag([session.scene.device.mass] * 2 + [session.scene.device.inertia])
    errors = []
    for point, link in LINKS.items():
        wanted = sum(
            bar.coupling(link, LINKS[other]) @ push[[0, 1, 5]] for other, push in pushes.items()
        )
        at, scale = bar.jacobian(link), np.abs(wanted).max()
        rows = np.array([sample[point].point.twist[[0, 1, 5]] for sample in samples])
        gained = np.polyfit(times[late], rows[late], 1)[0]
        rows = np.array([sample[point].device.twist[[0, 1, 5]] for sample in samples])
        rates = np.linalg.solve(at.T @ inertia @ at, at.T @ inertia @ rows.T)
        device = at @ np.polyfit(times[late], rates.T[late], 1)[0]
        errors.append([np.abs(one - wanted).max() / scale for one in (gained, device)])
    return np.array(errors)


@pytest.mark.parametrize("pushing", sampled(PUSHING), ids="+".join)
def test_both_are_accelerated_by_what_either_pushes(pushing):
    """Of points to 0.03 %, of devices to 0.15 % and the second order of the period."""
    periods = 1e-3, 5e-4, *only_long(2.5e-4)
    errors = [errors_of_accelerations(pushing, period) for period in periods]
    worst = np.array([one.max(axis=0) for one in errors])
    assert (worst[0] < (3e-4, 1.5e-3)).all()
    assert (worst[1:, 1] < 0.4 * worst[:-1, 1]).all()


def test_right_feels_the_spring_of_the_left_arm_and_then_the_inertia_alone():
    """At rest the compliance through the mechanism; from when left lets go, X_ii F_i."""
    arm = ARM_IMPEDANCES["firm"]
    # Damped so that both are at rest soon.
    still = {"kind": "arm", "impedance": "firm", "damping": 60.0, "angular_damping": 0.05}
    still |= {"start_delay": 0.0, "waypoints": [{"time": 0.0}], "release_at": [6.0]}
    push = {"kind": "constant_wrench", "start_delay": 0.6, "force": [0.1, 0.06, 0.0]}
    hands = [{"point": "left", "hand": still}, {"point": "right", "hand": push}]
    wrench, errors = np.array([0.1, 0.06, 0.0]), []
    for period in (1e-3, *only_long(5e-4)):
        session = SharedSession(undamped(hands=hands, simulation={"period": period}))
        bar = linkage(session.mechanism.q)
        right = session.run(round(6.05 / period))["right"]
        time = right["time"]
        rest = int(np.searchsorted(time, 5.9))
        assert np.abs(right["twist"][rest]).max() < 1e-5
        moved = right["position"][rest] - right["position"][0]
        spring = arm["stiffness"], arm["angular_stiffness"]
        yielded = bar.compliance(LEFT, *spring, RIGHT) @ wrench
        assert np.linalg.norm(yielded[:2]) > 1e-4
        # A displacement of 0.3 mm in a linkage of 45 mm is linear to a percent.
        assert moved[:2] == pytest.approx(yielded[:2], abs=0.02 * np.abs(yielded[:2]).max())
        own = linkage(right["q"][rest]).coupling(RIGHT, RIGHT)
        wanted = own @ wrench
        # What is felt of left holds the push, along the directions that are free.
        felt = right["external"][rest][[0, 1, 5]]
        assert own @ felt == pytest.approx(-wanted, abs=1e-3 * np.abs(wanted).max())
        late = time > 6.015
        # But for what joins left's device, which nobody holds, to its point: its arm's wrench ends
        # with a jump at a sample, of which half a period too much is carried on.
        device, channel = session.scene.device, session.scene.controller.position_channel
        led = 0.5 * period * np.linalg.norm(wrench) / device.mass * channel.damping
        assert np.abs(right["external"][late]).max() < led
        gained = np.polyfit(time[late], right["twist"][late][:, [0, 1, 5]], 1)[0]
        errors.append(np.abs(gained - wanted).max() / np.abs(wanted).max())
    assert errors[0] < 0.02
    for coarse, fine in pairwise(errors):
        assert fine < 0.7 * coarse


def test_the_experiment_is_what_its_description_says():
    rows = experiment()
    time = rows["right"]["time"] - 0.25
    count = {point: run["count"] for point, run in rows.items()}
    assert set(count["left"]) == {1.0}
    changes = np.flatnonzero(np.diff(count["right"]))
    assert [count["right"][index + 1] for index in changes] == [2.0]
    assert 5.0 < time[changes[0]] < 6.0
    q = rows["right"]["q"]
    pin3 = 0.045 * np.array(
        [np.cos(q[:, 0]) + np.cos(q[:, 0] + q[:, 1]), np.sin(q[:, 0]) + np.sin(q[:, 0] + q[:, 1])]
    )
    moved = np.linalg.norm(pin3.T - pin3[:, 0], axis=1)
    alone = (time > 2.0) & (time < 4.0)
    assert 8e-3 < moved[alone].max() < 10e-3
    assert np.linalg.norm(pin3[:, -1]) == pytest.approx(0.09, abs=1e-6)
    # After left has let go, its hand does nothing, and right feels nothing of it.
    after = time > 5.01
    assert not rows["left"]["device_hand_wrench"][after].any()
    assert np.abs(rows["right"]["external"][after]).max() < 0.25
    before = (time > 4.8) & (time < 4.99)
    assert np.abs(rows["right"]["external"][before][:, 0]).min() > 5.0


def test_the_experiment_of_the_check_is_that_of_both():
    scene = load_scene("two_users").with_(experiment={"duration": 0.3})
    rows, account = experiment_run(scene)
    session = SharedSession(scene)
    for one, other in zip(rows, session.run(550).values(), strict=True):
        assert np.array_equal(one["q"], other["q"])
        assert np.array_equal(one["on_hand"], other["on_hand"])
        # Left pushes, and right is pushed by it.
        assert one["device_hand_wrench"].any()
    assert account == session.mechanism.account


def test_what_measures_one_user_has_the_device_and_gains_of_the_first_point():
    lighter = {"device": {"mass": 0.2}, "controller": {"passivity": {"control": False}}}
    scene = load_scene("two_users").with_(hands=[{"point": "right"}, {"point": "left", **lighter}])
    alone = of_first_user(scene)
    assert (alone.device.mass, alone.controller.passivity.control) == (0.2, False)
    assert alone.held_points == ("left",)
