# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trials of passivity: what is counted, what is refused, and what they find."""

import json
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hapticmech_ros import SharedSession
from hapticmech_ros.analysis.passivity import (
    ALLOWED_J,
    STIFFNESS,
    Trial,
    energy_of,
    least_energy,
    may_lack,
    passivity,
    run_of,
    scene_of,
    supplied,
    trials,
    tried,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.session import Run
from oracles.users import two_points
from sampling import sampled


def test_a_trial_has_the_stiffness_the_connection_and_the_device_that_are_asked_for():
    scene = scene_of(Trial("door", "premium_1_5_6dof", "grips", 0.03, local=False, seconds=9.0))
    joint = scene.controller.joint_constraint
    assert (joint.stiffness, joint.local) == (STIFFNESS, False)
    link = scene.connection
    assert (link.delay, link.jitter, link.loss) == (0.03, 0.2, 0.05)
    assert scene.device.preset == "premium_1_5_6dof"
    assert scene.hand.release_at == (2.0, 6.0)
    assert scene.hand.waypoints[-1].time == pytest.approx(9.0, abs=0.7)


def test_a_hand_does_not_spin_a_free_handle_up():
    assert scene_of(Trial("five_bar")).hand.torque != (0.0, 0.0, 0.0)
    assert scene_of(Trial("five_bar", "touch")).hand.torque == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("hand", ["grips", "tremor"])
def test_with_control_the_hand_gets_out_what_it_put_in(hand):
    found = tried(Trial("five_bar", "scene", hand, 0.05, local=False, seconds=3.5))
    assert found.passive
    assert found.lowest >= -1e-3
    assert found.changed > 0.1
    assert found.most_force <= 20.0


def test_without_control_that_is_seen():
    found = tried(Trial("five_bar", "scene", "scene", 0.05, local=False, control=False, seconds=2))
    assert not found.passive
    assert found.lowest < -0.1
    assert found.changed == 0.0


def test_a_hand_that_there_is_none_of_is_refused():
    with pytest.raises(InvalidInputError, match=r"hand: must be one of scene, relaxed.*nobody"):
        scene_of(Trial("five_bar", hand="nobody"))


def test_all_combinations_are_tried_and_told(tmp_path):
    asked = trials(["two_link"], ["scene"], ["scene"], [0.0, 0.01], 0.6)
    assert [(one.delay, one.local) for one in asked] == [
        (0.0, True),
        (0.0, False),
        (0.01, True),
        (0.01, False),
    ]
    told = []
    results = passivity(asked, told.append)
    results.write(tmp_path)
    assert [one.trial for one in results.found] == asked
    assert len(told) == 4
    rows = json.loads((tmp_path / "passivity.json").read_text(encoding="utf-8"))
    assert [row["passive"] for row in rows] == [one.passive for one in results.found]
    (sheet,) = results.sheets()
    assert len(sheet.rows) == 4


@pytest.fixture
def shared(tmp_path):
    """A function that writes a body held by an arm at one end, and led by another at the other."""

    def write(**passivity):
        arm = {"kind": "arm", "mass": 0.3, "damping": 8.0, "stiffness": 100.0, "start_delay": 0.0}
        there = {"xyz": [0.03, 0.0, 0.0]}
        way = [{"time": 0.0}, {"time": 0.3, **there}, {"time": 0.6}, {"time": 0.9, **there}]
        hands = [
            {"point": "a", "hand": arm | {"waypoints": way[:1]}},
            {"point": "b", "hand": arm | {"stiffness": 300.0, "waypoints": way}},
        ]
        path = tmp_path / "shared.yaml"
        document = two_points(hands=hands, controller={"passivity": passivity})
        path.write_text(json.dumps(document), encoding="utf-8")
        return str(path)

    return write


def test_each_user_has_conditions_of_its_own(shared):
    scene = scene_of(Trial(shared(slack=0.02), "touch", "firm", 0.03, local=False, seconds=5.0))
    one, other = (scene.held_at(point) for point in "ab")
    for user in (one, other):
        joint = user.controller.joint_constraint
        assert (joint.stiffness, joint.local) == (STIFFNESS, False)
        assert (user.device.preset, user.controller.passivity.slack) == ("touch", 0.02)
        assert (user.connection.delay, user.connection.loss) == (0.03, 0.05)
    assert one.connection.seed != other.connection.seed
    assert one.hand.waypoints[1].xyz != other.hand.waypoints[1].xyz
    own = scene_of(Trial(shared(), delay=0.03))
    assert own.held_at("a").hand.stiffness == 100.0
    assert own.held_at("b").hand.stiffness == 300.0


def test_energies_at_the_ports_are_those_of_the_motion(shared):
    """E_m by wrenches and motion, as E_h is; they end in the springs of both arms and the body."""
    scene = scene_of(Trial(shared(), delay=0.02))
    runs, ended = run_of(SharedSession(scene), 2500)
    assert not ended
    for point, run in runs.items():
        turns = Rotation.from_quat(run["quaternion"])
        turned = (turns[1:] * turns[:-1].inv()).as_rotvec()
        ways = np.hstack((np.diff(run["position"], axis=0), turned))
        # A wrench acts from the tick after that in which it was commanded.
        work = np.concatenate(([0.0], np.cumsum(np.sum(run["on_mechanism"][:-1] * ways, axis=1))))
        exchanged = np.abs(run["to_mechanism"]).max()
        assert exchanged > 5e-3
        assert run["to_mechanism"] == pytest.approx(work, abs=2e-3 * exchanged)
        held = energy_of(run, scene.held_at(point).device)
        device = scene.held_at(point).device
        moving = 0.5 * device.mass * np.sum(run["device_true_twist"][:, :3] ** 2, axis=1)
        assert held == pytest.approx(run["actuators"] + moving, abs=2e-3 * exchanged)


def test_what_the_mechanism_gave_counts_from_when_it_gave_it():
    """By hand: what was supplied once may be used later, what comes later may not."""
    to_mechanism = np.array([0.0, 1.0, -2.0, 0.5, -1.0])
    assert supplied(to_mechanism) == pytest.approx([0.0, 0.0, 2.0, 2.0, 2.0])
    assert least_energy(np.array([0.0, -1.0, -2.0, -2.5, 0.0]), to_mechanism) == -1.0
    assert least_energy(np.array([0.0, 0.5, -2.0, -2.5, 0.0]), to_mechanism) == -0.5


@pytest.mark.parametrize(
    ("hand", "delay"), sampled(product(("scene", "firm", "grips"), (0.0, 0.05)), every=3)
)
def test_with_several_users_each_port_is_passive_and_the_sum_keeps_its_bound(shared, delay, hand):
    found = tried(Trial(shared(slack=1e-3), hand=hand, delay=delay, seconds=3.0))
    assert found.passive
    assert [port.point for port in found.ports] == ["a", "b"]
    assert min(port.lowest for port in found.ports) >= -ALLOWED_J
    assert found.margin >= -ALLOWED_J
    # What one gets of the other is no energy of the mechanism's own.
    assert max(port.mechanism_gave for port in found.ports) > 1e-3
    if not delay:
        assert found.in_sum >= -2.0 * (1e-3 + 5e-4)


def test_in_sum_a_delay_may_give_what_the_slack_allows(shared):
    """The led arm's energy reaches the other before its hand has given it: less with less slack."""
    loose, tight = (
        tried(Trial(shared(slack=slack), delay=0.05, seconds=3.0)) for slack in (0.1, 1e-3)
    )
    assert loose.passive
    assert tight.passive
    assert loose.in_sum < -0.03
    assert tight.in_sum > 0.2 * loose.in_sum
    near = tried(Trial(shared(), seconds=3.0))
    assert near.in_sum >= -ALLOWED_J


def test_without_control_several_users_get_what_nobody_gave(shared):
    found = tried(Trial(shared(), delay=0.05, control=False, seconds=3.0))
    assert not found.passive
    assert found.lowest < -1.0
    assert found.margin < -1.0


def test_what_may_be_missing_is_slack_allowance_and_what_is_on_its_way(shared):
    scene = scene_of(Trial(shared(slack=0.02, allowance=1e-3), delay=0.01)).held_at("a")
    layout = SharedSession(scene_of(Trial(shared()))).user("a").layout
    run = Run(np.zeros((60, layout.size)), layout)
    run["to_mechanism"][:] = 1e-3 * np.minimum(np.arange(60.0), 30.0)
    # 10 ms, later by a fifth, and ten ticks: E_m grew by 22 mJ within them, and no more since.
    assert may_lack(run, scene) == pytest.approx(0.021 + 1e-3 * np.minimum(np.arange(60.0), 22.0))
    run["actuators"][40:] = -0.05
    assert may_lack(run, scene)[39:41] == pytest.approx([0.043, 0.071])


def test_one_user_s_sum_is_that_user_s_port():
    found = tried(Trial("two_link", hand="firm", delay=0.02, seconds=1.5))
    (port,) = found.ports
    assert found.in_sum == port.lowest == found.lowest
    assert found.margin > found.in_sum
