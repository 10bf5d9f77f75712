# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device against the readable one: same motion, same measurements, same wrenches."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.device import NO_WRENCH, DeviceState, ImpedanceDevice, device_for
from hapticmech_ros.scene.device import Compensation, Device, Workspace
from hapticmech_ros.scene.hand import (
    ArmHand,
    ConstantWrenchHand,
    SpringDamperHand,
    Tremor,
    Waypoint,
)
from oracles.devices import body_of, readable_device_for
from sampling import sampled

# Of a state, by the names of its properties.
PARTS = (
    *("pose", "twist", "measured_pose", "measured_twist", "hand_wrench", "applied", "reported"),
    *("home", "anchor", "window"),
)
# By one kernel, and by kernels around a hand's law in Python.
OURS = ("kernel", "own hand")
# Sums of some ten products, each rounded to 1e-16, in another order. Stepping from the same state
# leaves no more than that; spring and damper enlarge it by k h / m, less than 1.
ROUNDING = 1e-12
# From here to π, rad, Pinocchio's logarithm is exact; up to here it loses 1e-15 / sin².
NEAR_PI = 2e-3
PUSHING = ConstantWrenchHand(
    kind="constant_wrench", force=(1.0, -2.0, 0.5), torque=(0.01, 0.0, -0.02), start_delay=0.25
)
SPRING = SpringDamperHand(
    kind="spring_damper",
    waypoints=(
        Waypoint(time=0.1, xyz=(0.01, 0.0, 0.0), rotation=(0.4, 0.0, 0.0)),
        Waypoint(time=0.5, xyz=(0.03, -0.02, 0.01), rotation=(0.4, 0.9, -0.3)),
        Waypoint(time=0.65, xyz=(0.0, 0.05, 0.0), rotation=(0.0, 0.0, 1.0)),
    ),
    start_delay=0.1,
)
AT_ONCE = SpringDamperHand(
    kind="spring_damper",
    waypoints=(Waypoint(time=0.0, xyz=(0.0, 0.01, 0.0), rotation=(0.1, 0.0, 0.0)),),
    start_delay=0.0,
)
TREMBLING = Tremor(
    frequency=9.0,
    force=(0.1, -0.2, 0.0),
    torque=(0.0, 0.0, 0.003),
    xyz=(1e-4, 0.0, 2e-4),
    rotation=(0.0, 0.01, 0.02),
)
ARM = ArmHand(
    kind="arm",
    waypoints=SPRING.waypoints,
    start_delay=0.1,
    release_at=(0.2, 0.5),
    grab_at=(0.3, 0.55),
    tremor=TREMBLING,
)
TAPPING = ConstantWrenchHand(
    kind="constant_wrench",
    force=(0.5, 0.0, 0.1),
    grab_at=(0.2,),
    release_at=(0.45,),
    tremor=Tremor(frequency=7.0, force=(0.0, 0.3, 0.0)),
)
HANDS = {
    "nobody": None,
    "pushing": PUSHING,
    "spring": SPRING,
    "at_once": AT_ONCE,
    "arm": ARM,
    "tapping": TAPPING,
}
DAMPED = {"damping": 0.4, "angular_damping": 1e-3}
DEVICES = {
    "ideal": Device(**DAMPED),
    "quantised": Device(position_resolution=1e-5, angle_resolution=1e-3, substeps=3),
    "positions": Device(position_resolution=2e-4, velocity_filter=30.0, **DAMPED),
    "angles": Device(angle_resolution=0.1, substeps=1),
    "weak": Device(force_limit=0.5, torque_limit=0.01, **DAMPED),
    "rough": Device(
        coulomb_friction=0.4,
        angular_coulomb_friction=4e-4,
        actuator_bandwidth=80.0,
        force_limit=3.0,
        force_sensor="absent",
        **DAMPED,
    ),
    "heavy": Device(
        coulomb_friction=0.2,
        gravity_load=(0.3, 0.0, -0.8),
        position_resolution=1e-5,
        force_sensor="estimated",
        compensation=Compensation(gravity=True, friction=0.7),
        actuator_bandwidth=150.0,
        **DAMPED,
    ),
    # Nothing of the force sensor here: an estimate magnifies roundings by m / T.
    "small": Device(actuated="translation", workspace=Workspace(radius=0.003, angle=0.05)),
}


def pair(device, hand, planar=False):
    return bodies_of(device, hand, planar, ("readable", "kernel"))


def bodies_of(device, hand, planar=False, kinds=("readable", *OURS)):
    return tuple(body_of(kind, device, hand, planar) for kind in kinds)


def compare(found, expected, bound=ROUNDING):
    for name in PARTS:
        one, other = (numbers(getattr(state, name)) for state in (found, expected))
        assert one.shape == other.shape
        assert np.abs(one - other).max() < bound * max(np.abs(other).max(), 1.0), name
    apart = np.abs(found.published - expected.published).max()
    assert apart < bound * max(np.abs(expected.published).max(), 1.0)


def numbers(part):
    return part.homogeneous if isinstance(part, pin.SE3) else np.asarray(part)


def random_pose(rng, planar, angle):
    axis = np.array([0.0, 0.0, 1.0]) if planar else rng.normal(size=3)
    position = rng.normal(size=3) * ((1.0, 1.0, 0.0) if planar else 1.0)
    return pin.SE3(pin.exp3(angle * axis / np.linalg.norm(axis)), position)


@pytest.mark.parametrize(
    ("device", "hand", "planar"),
    [(one, *case) for one in DEVICES for case in sampled(product(HANDS, (False, True)), one)],
)
def test_a_period_is_the_same_from_random_states(device, hand, planar):
    readable, *ours = bodies_of(DEVICES[device], HANDS[hand], planar)
    rng = np.random.default_rng(7)
    task = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) if planar else np.ones(6)
    limits = DEVICES[device].force_limit, DEVICES[device].torque_limit
    limited = held_by_nobody = 0
    for _ in range(250):
        angle = rng.choice([0.0, 1e-6, 0.5, 2.0, np.pi - NEAR_PI, np.pi - 1e-4])
        start = readable.at_rest(random_pose(rng, planar, angle))
        # Any twist: the first period brings it up.
        away = rng.normal(size=6) * task * np.repeat((300.0, 0.3), 3)
        state = readable.step(start, NO_WRENCH, None, 0, away)
        stretch = rng.choice([0.0, 1e-7, 0.3, 1.5])
        hold = random_pose(rng, planar, stretch)
        held = readable.at_rest(
            pin.SE3(hold.rotation @ start.pose.rotation, start.pose.translation + 0.01)
        )
        held = None if rng.random() < 0.2 else held
        command = rng.normal(size=6) * np.repeat(limits, 3)
        push = rng.normal(size=6) if rng.random() < 0.5 else NO_WRENCH
        ticks = int(rng.integers(900))
        expected = readable.step(state, command, held, ticks, push)
        for compiled in ours:
            compare(compiled.step(state, command, held, ticks, push), expected)
        sizes = np.linalg.norm(command.reshape(2, 3), axis=1)
        limited += bool((sizes > limits).any())
        held_by_nobody += held is None
    assert 100 < limited < 250
    assert 20 < held_by_nobody < 100


@pytest.mark.parametrize(
    ("device", "hand"),
    [
        (device, hand)
        for device in ("ideal", "positions", "weak", "rough", "heavy", "small")
        for hand in sampled(("pushing", "spring", "at_once", "arm", "tapping"), device)
    ],
)
def test_a_second_is_the_same(device, hand):
    bodies = bodies_of(DEVICES[device], HANDS[hand])
    pose = random_pose(np.random.default_rng(1), False, 0.4)
    states = [body.at_rest(pose, held=True) for body in bodies]
    starts = list(states)
    for state in states[1:]:
        compare(state, states[0])
    for tick in range(1000):
        command = np.repeat((0.3, 3e-3), 3) * np.sin(0.02 * tick + np.arange(6))
        states = [
            body.step(state, command, start, tick)
            for body, state, start in zip(bodies, states, starts, strict=True)
        ]
        # Roundings of 1000 periods add up; what moves freely carries them on for up to 1 s.
        for state in states[1:]:
            compare(state, states[0], 1e-10)
    assert np.abs(states[0].pose.translation - pose.translation).max() > 1e-3


@pytest.mark.parametrize("short", [2e-3, 1e-4, 1e-8])
def test_a_hand_turned_by_nearly_half_a_turn_pulls_the_same(short):
    hand = SpringDamperHand(kind="spring_damper", waypoints=(Waypoint(time=0.0),), start_delay=0.0)
    # Too heavy to be turned by more than 1e-6 rad in a period.
    readable, compiled = pair(Device(inertia=3.0), hand)
    rng = np.random.default_rng(9)
    for _ in range(100):
        start = readable.at_rest(random_pose(rng, False, 1.0))
        turn = random_pose(rng, False, np.pi - short).rotation
        held = readable.at_rest(pin.SE3(turn @ start.pose.rotation, start.pose.translation))
        expected = readable.step(start, NO_WRENCH, held, 0)
        compare(compiled.step(start, NO_WRENCH, held, 0), expected)
        assert abs(np.linalg.norm(expected.hand_wrench[3:]) - np.pi) < 2.1e-3


def test_the_hand_has_the_state_in_which_it_took_hold():
    readable, compiled = pair(DEVICES["ideal"], AT_ONCE)
    rng = np.random.default_rng(4)
    state = readable.at_rest(random_pose(rng, False, 1.0))
    one, other = (readable.at_rest(random_pose(rng, False, 1.0)) for _ in range(2))
    for held in (one, other, None, one, other.replaced(), other):
        found = compiled.step(state, NO_WRENCH, held, 5)
        compare(found, readable.step(state, NO_WRENCH, held, 5))


def test_parts_of_a_state_are_kept_to_the_bit_and_each_is_its_own():
    rng = np.random.default_rng(6)
    poses = {
        name: random_pose(rng, False, 1.0) for name in ("pose", "measured_pose", "home", "anchor")
    }
    sixes = ("twist", "measured_twist", "hand_wrench", "applied", "reported")
    parts = {**poses, **{name: rng.normal(size=6) for name in sixes}, "window": 3}
    assert set(parts) == set(PARTS)
    old = DeviceState.resting(pin.SE3.Identity())
    whole = old.replaced(**parts)
    for name, given in parts.items():
        alone = old.replaced(**{name: given})
        for other in PARTS:
            expected = given if other == name else getattr(old, other)
            for state, value in ((alone, expected), (whole, parts[other])):
                assert np.array_equal(*map(numbers, (getattr(state, other), value))), other
    place = pin.XYZQUATToSE3(whole.published[:7]).homogeneous
    assert np.abs(place - poses["measured_pose"].homogeneous).max() < 1e-15
    assert np.array_equal(whole.published[:3], poses["measured_pose"].translation)
    rest = np.concatenate([parts[name] for name in ("measured_twist", "reported", "applied")])
    assert np.array_equal(whole.published[7:], rest)
    assert np.array_equal(whole.without_force().applied, np.zeros(6))
    assert np.array_equal(whole.applied, parts["applied"])


def test_a_step_leaves_earlier_states_alone():
    _, compiled = pair(DEVICES["quantised"], SPRING)
    start = compiled.at_rest(random_pose(np.random.default_rng(3), False, 1.0), held=True)
    first = compiled.step(start, np.ones(6), start, 0)
    before = start.flat.tobytes(), first.flat.tobytes()
    compiled.step(first, np.zeros(6), start, 1)
    assert (start.flat.tobytes(), first.flat.tobytes()) == before
    assert np.array_equal(compiled.step(start, np.ones(6), start, 0).flat, first.flat)


def test_same_bits_on_every_run():
    ends = []
    for _ in range(2):
        _, compiled = pair(DEVICES["quantised"], SPRING)
        state = start = compiled.at_rest(pin.SE3.Identity(), held=True)
        for tick in range(300):
            state = compiled.step(state, np.sin(tick + np.arange(6.0)), start, tick)
        ends.append(state.flat.tobytes())
    assert ends[0] == ends[1]


def test_arrays_that_cannot_be_written_are_taken():
    _, compiled = pair(DEVICES["ideal"], None)
    start = compiled.at_rest(pin.SE3.Identity())
    command = np.arange(1.0, 7.0) / 10.0
    expected = compiled.step(start, command, None, 0, command).flat
    command.flags.writeable = False
    assert np.array_equal(compiled.step(start, command, None, 0, command).flat, expected)
    apart = np.column_stack((command, np.full(6, 7.0)))[:, 0]
    assert np.array_equal(compiled.step(start, apart, None, 0, apart).flat, expected)


def test_a_planar_device_stays_in_the_plane_to_the_bit():
    _, compiled = pair(DEVICES["ideal"], PUSHING, planar=True)
    state = start = compiled.at_rest(pin.SE3(pin.exp3(np.array([0, 0, 0.4])), np.zeros(3)), True)
    for tick in range(400):
        state = compiled.step(state, np.full(6, 0.1), start, tick, np.ones(6))
        assert np.array_equal(state.twist[2:5], np.zeros(3))
        assert np.array_equal(state.pose.rotation[:, 2], [0.0, 0.0, 1.0])
    assert state.twist[0] > 0.0


def test_a_scene_has_its_device_and_its_hand():
    scene = load_scene("spatial_arm")
    assert type(device_for(scene)) is ImpedanceDevice
    pose = random_pose(np.random.default_rng(8), False, 1.0)
    for with_hand in (True, False):
        bodies = [make(scene, with_hand) for make in (readable_device_for, device_for)]
        starts = [body.at_rest(pose, held=True) for body in bodies]
        ends = [body.step(s, NO_WRENCH, s, 700) for body, s in zip(bodies, starts, strict=True)]
        compare(ends[1], ends[0])
        assert ends[0].hand_wrench.any() == with_hand
