# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches on links: as on an operational point there, and with the same energy account."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from oracles.generator import random_mechanism
from oracles.kinematics import link_poses, point_pose
from oracles.newton_euler import jacobian_of
from oracles.running import simulator, total_energy, with_start, wrenches_on

SEEDS = range(6)
STEPS = 40


def _document(seed, damped=True):
    sample = random_mechanism(seed, planar=seed % 2 == 1)
    document = with_start(sample.document, sample.q, 0.3 * sample.v)
    if not damped:
        links = [link | {"joint": link["joint"] | {"damping": 0.0}} for link in document["links"]]
        document = document | {"links": links}
    return document


def _push(seed):
    rng = np.random.default_rng([seed, 7])
    return rng.normal(size=6) * np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_link_is_pushed_like_an_operational_point_at_its_origin(seed):
    document = _document(seed)
    link = document["links"][-2]["name"]
    point = {"name": "probe", "link": link, "origin": {}}
    points = [*document["operational_points"], point]
    sim, other = simulator(document), simulator(document | {"operational_points": points})
    one, two, untouched = (s.initial_state() for s in (sim, other, sim))
    at_points, wrench = np.zeros((len(points), 6)), _push(seed)
    at_points[-1] = wrench
    for _ in range(STEPS):
        one = sim.step(one, np.zeros((len(points) - 1, 6)), {link: wrench})
        two = other.step(two, at_points)
        untouched = sim.step(untouched, np.zeros((len(points) - 1, 6)))
    # The same sums in another order, amplified by forty steps of a mechanism's own dynamics.
    assert np.abs(one.q - two.q).max() < 1e-11
    assert np.abs(one.v - two.v).max() < 1e-9
    assert one.account.work_in == pytest.approx(two.account.work_in, rel=1e-9)
    assert np.abs(one.v - untouched.v).max() > 1e-4


@pytest.mark.parametrize("seed", SEEDS)
def test_pushes_on_links_pay_for_the_energy_they_bring(seed):
    document = _document(seed, damped=False)
    links = [document["links"][index]["name"] for index in (-1, 1)]
    errors = []
    for period in (2e-3, 1e-3):
        sim = simulator(document, period=period)
        state = first = sim.initial_state()
        pushes = dict(zip(links, (_push(seed), _push(seed + 100)), strict=True))
        for _ in range(round(0.08 / period)):
            state = sim.step(state, wrenches_on(sim), pushes)
        gained = total_energy(sim, state) - total_energy(sim, first)
        errors.append(abs(gained - state.account.work_in))
        assert abs(state.account.work_in) > 1e-4
        assert state.account.damping_loss == 0.0
    # rk4 and the account's own quadrature: what is left over is truncation, which a halved step
    # brings down by 2^4 (by 2^3 and more where projections add to it), or rounding.
    assert errors[1] < max(errors[0] / 6.0, 1e-10)
    assert errors[1] < 1e-6 * abs(state.account.work_in)


@pytest.mark.parametrize("seed", SEEDS)
def test_jacobian_of_a_link_is_the_rate_of_its_pose(seed):
    document = _document(seed)
    mechanism = simulator(document).mechanism
    sample = random_mechanism(seed, planar=seed % 2 == 1)
    for link in (entry["name"] for entry in document["links"]):

        def pose(change, link=link):
            return link_poses(document, mechanism.integrate(sample.q, change))[link]

        expected = jacobian_of(pose, mechanism.nv)
        # Central differences: the step's fourth power, and rounding over the step.
        assert np.abs(mechanism.link_jacobian(sample.q, link) - expected).max() < 1e-8


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_of_frames_are_those_of_plain_kinematics(seed):
    document = _document(seed)
    mechanism = simulator(document).mechanism
    q = random_mechanism(seed, planar=seed % 2 == 1).q
    poses = link_poses(document, q)
    for name, (rotation, position) in poses.items():
        found = mechanism.frame_pose(q, name)
        assert np.abs(found.rotation - rotation).max() < 1e-12
        assert np.abs(found.translation - position).max() < 1e-12
    for index, point in enumerate(document["operational_points"]):
        rotation, position = point_pose(document, q, index)
        found = mechanism.frame_pose(q, point["name"])
        assert np.abs(found.rotation - rotation).max() < 1e-12
        assert np.abs(found.translation - position).max() < 1e-12
        upright = mechanism.frame_pose(q, f"{point['name']}_world")
        assert np.array_equal(upright.rotation, np.eye(3))
        assert np.array_equal(upright.translation, found.translation)


@pytest.mark.parametrize("frame", ["link1", "tip", "tip_world"])
def test_poses_are_copies(frame):
    document = _document(0)
    mechanism = simulator(document).mechanism
    sample = random_mechanism(0)
    found = mechanism.frame_pose(sample.q, frame)
    before = found.homogeneous.copy()
    mechanism.frame_pose(mechanism.integrate(sample.q, np.ones(mechanism.nv)), frame)
    assert np.array_equal(found.homogeneous, before)


@pytest.mark.parametrize(
    "ask",
    [
        lambda sim, state: sim.mechanism.frame_pose(state.q, "elbow"),
        lambda sim, state: sim.mechanism.link_jacobian(state.q, "elbow"),
        lambda sim, state: sim.step(state, np.zeros((2, 6)), {"elbow": np.ones(6)}),
    ],
    ids=["frame_pose", "link_jacobian", "step"],
)
def test_unknown_frames_and_links_are_refused(ask):
    sim = simulator(_document(0))
    with pytest.raises(InvalidInputError, match="elbow"):
        ask(sim, sim.initial_state())
