# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand of one's own on the device that kernels move, and the states that they hand on."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.device import (
    NO_WRENCH,
    DeviceState,
    GraspSchedule,
    ImpedanceDevice,
    device_for,
    grasp_schedule_of,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.device import Compensation, Device, Workspace
from hapticmech_ros.scene.hand import (
    ArmHand,
    ConstantWrenchHand,
    SpringDamperHand,
    Tremor,
    Waypoint,
)
from oracles.devices import NOTHING, PERIOD, START, body_of, law_of, run
from sampling import sampled


def test_a_spring_of_ones_own_swings_a_mass_at_its_frequency():
    stiffness, mass, substeps = 120.0, 0.3, 8
    away = np.array([0.01, 0.0, 0.0])

    def spring(elapsed, pose, twist, held):
        force = stiffness * (held.translation + away - pose.translation)
        return np.concatenate((force, np.zeros(3)))

    body = ImpedanceDevice(Device(mass=mass, substeps=substeps), PERIOD, False, law=spring)
    ticks = 1000
    states = run(body, ticks)
    moved = np.array([state.pose.translation[0] - START.translation[0] for state in states])
    # Position Verlet swings at (2 / h) asin(ω h / 2), in phase.
    step, speed = PERIOD / substeps, np.sqrt(stiffness / mass)
    half = np.arcsin(0.5 * speed * step)
    phase = 2.0 * half * substeps * np.arange(ticks + 1)
    expected = 0.01 * (1.0 - np.cos(phase))
    assert np.abs(moved - expected).max() < 1e-10


def test_a_law_is_asked_while_its_grip_holds_and_its_mass_is_in_what_a_sensor_reads():
    schedule = GraspSchedule(start=0.01, switches=(0.02, 0.03), mass=0.5, inertia=1e-3)
    asked = []

    def watching(elapsed, pose, twist, held):
        asked.append(elapsed)
        return np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0])

    body = ImpedanceDevice(
        Device(mass=0.3, substeps=2), PERIOD, False, law=watching, schedule=schedule
    )
    states = run(body, 50)
    times = np.array(asked)
    holding = (times > 0.01 - 1e-9) & ((times < 0.03 - 1e-9) | (times > 0.04 - 1e-9))
    assert holding.all()
    # Begin and end of each period, and the middles of its two substeps; and where the grip begins.
    assert len(asked) == (20 + 10) * 4 + 1
    # 0.4 N on 0.8 kg: 0.5 N/kg of acceleration, of which the hand's mass takes 0.25 N.
    assert states[15].hand_wrench[0] == pytest.approx(0.15, rel=1e-9)
    assert states[35].hand_wrench[0] == 0.0


def test_a_law_on_a_scenes_device_holds_as_the_scenes_hand_would():
    scene = load_scene("five_bar")
    hand = ArmHand(kind="arm", waypoints=(Waypoint(time=0.0),), release_at=(0.1,), start_delay=0.1)
    scene = scene.model_copy(update={"hand": hand})
    times = []

    def watching(elapsed, pose, twist, held):
        times.append(elapsed)
        return np.zeros(6)

    Session(scene, device=device_for(scene, law=watching)).run(400)
    assert grasp_schedule_of(hand).mass > 0.0
    assert min(times) == pytest.approx(0.1, abs=1e-9)
    assert max(times) < 0.2 - 1e-9


def test_what_a_law_is_given_is_its_own():
    kept = []

    def spoiling(elapsed, pose, twist, held):
        kept.append((pose.translation.copy(), twist.copy()))
        twist[:] = 9.0
        pose.translation[:] = 9.0
        held.translation[:] = 9.0
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    def pushing(elapsed, pose, twist, held):
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    ends = [
        run(ImpedanceDevice(Device(), PERIOD, False, law=law), 5)[-1] for law in (spoiling, pushing)
    ]
    assert np.array_equal(ends[0].flat, ends[1].flat)
    assert np.linalg.norm(kept[-1][1]) > 0.0


@pytest.mark.parametrize("wrong", [np.zeros(3), 1.0, np.zeros((6, 1))])
def test_what_is_no_wrench_is_refused(wrong):
    body = ImpedanceDevice(
        Device(),
        PERIOD,
        False,
        law=lambda elapsed, pose, twist, held: wrong,
        schedule=GraspSchedule(start=0.01),
    )
    start = body.at_rest(START, held=True)
    with pytest.raises(InvalidInputError, match=r"shape of the hand's wrench: must be \(6,\)"):
        body.step(start, NOTHING, start, 10)


def test_an_unknown_part_of_a_state_is_refused():
    state = ImpedanceDevice(Device(), PERIOD, False).at_rest(pin.SE3.Identity())
    with pytest.raises(InvalidInputError, match="part of a state: must be one of pose, home"):
        state.replaced(speed=np.zeros(6))


# Of a state, by the names of its properties.
PARTS = (
    *("pose", "twist", "measured_pose", "measured_twist", "hand_wrench", "applied", "reported"),
    *("home", "anchor", "window"),
)
# Sums of some ten products, each rounded to 1e-16, in another order. Stepping from the same state
# leaves no more than that; spring and damper enlarge it by k h / m, less than 1.
ROUNDING = 1e-12
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


def compare(found, expected, bound=ROUNDING):
    for name in PARTS:
        one, other = (numbers(getattr(state, name)) for state in (found, expected))
        assert one.shape == other.shape
        assert np.abs(one - other).max() < bound * max(np.abs(other).max(), 1.0), name
    apart = np.abs(found.published - expected.published).max()
    assert apart < bound * max(np.abs(expected.published).max(), 1.0)


def numbers(part):
    return part.homogeneous if isinstance(part, pin.SE3) else np.asarray(part)


def nobody(elapsed, pose, twist, held):
    return NO_WRENCH


def random_pose(rng, planar, angle):
    axis = np.array([0.0, 0.0, 1.0]) if planar else rng.normal(size=3)
    position = rng.normal(size=3) * ((1.0, 1.0, 0.0) if planar else 1.0)
    return pin.SE3(pin.exp3(angle * axis / np.linalg.norm(axis)), position)


@pytest.mark.parametrize(
    ("device", "hand", "planar"),
    [(one, *case) for one in DEVICES for case in sampled(product(HANDS, (False, True)), one)],
)
def test_kernels_around_a_law_do_what_one_kernel_does(device, hand, planar):
    held = HANDS[hand]
    alone = ImpedanceDevice(DEVICES[device], PERIOD, planar, held)
    law, schedule = (law_of(held), grasp_schedule_of(held)) if held else (nobody, GraspSchedule())
    around = ImpedanceDevice(DEVICES[device], PERIOD, planar, law=law, schedule=schedule)
    pose = random_pose(np.random.default_rng(1), planar, 0.4)
    states = starts = [body.at_rest(pose, held=True) for body in (alone, around)]
    compare(*states)
    for tick in range(700):
        command = np.repeat((0.3, 3e-3), 3) * np.sin(0.02 * tick + np.arange(6))
        states = [
            body.step(state, command, start, tick)
            for body, state, start in zip((alone, around), states, starts, strict=True)
        ]
        # Roundings of 700 periods add up; what moves freely carries them on for up to 1 s.
        compare(*states, 1e-10)
    assert np.abs(states[0].pose.translation - pose.translation).max() > 1e-3


@pytest.mark.parametrize("short", [2e-3, 1e-4, 1e-8])
def test_a_hand_pulls_back_by_nearly_half_a_turn(short):
    still = {"waypoints": (Waypoint(time=0.0),), "start_delay": 0.0, "angular_damping": 0.0}
    hand = SpringDamperHand(kind="spring_damper", **still)
    # Too heavy to be turned by more than 1e-6 rad in a period.
    body = body_of(Device(inertia=3.0), hand)
    rng = np.random.default_rng(9)
    for _ in range(100):
        start = body.at_rest(random_pose(rng, False, 1.0))
        turn = random_pose(rng, False, np.pi - short).rotation
        held = body.at_rest(pin.SE3(turn @ start.pose.rotation, start.pose.translation))
        pull = body.step(start, NO_WRENCH, held, 0).hand_wrench[3:]
        assert np.abs(pin.exp3(pull) - turn).max() < 2e-6
        assert abs(np.linalg.norm(pull) - np.pi) < 2.1e-3


def test_the_hand_has_the_state_in_which_it_took_hold():
    body, law = body_of(DEVICES["ideal"], AT_ONCE), law_of(AT_ONCE)
    rng = np.random.default_rng(4)
    state = body.at_rest(random_pose(rng, False, 1.0))
    one, other = (body.at_rest(random_pose(rng, False, 1.0)) for _ in range(2))
    for held in (one, other, None, one, other.replaced(), other):
        found = body.step(state, NO_WRENCH, held, 5)
        given = 6 * PERIOD, found.pose, found.twist
        expected = NO_WRENCH if held is None else law(*given, held.pose)
        assert np.abs(found.hand_wrench - expected).max() < ROUNDING * 10.0


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
    compiled = body_of(DEVICES["quantised"], SPRING)
    start = compiled.at_rest(random_pose(np.random.default_rng(3), False, 1.0), held=True)
    first = compiled.step(start, np.ones(6), start, 0)
    before = start.flat.tobytes(), first.flat.tobytes()
    compiled.step(first, np.zeros(6), start, 1)
    assert (start.flat.tobytes(), first.flat.tobytes()) == before
    assert np.array_equal(compiled.step(start, np.ones(6), start, 0).flat, first.flat)


def test_arrays_that_cannot_be_written_are_taken():
    compiled = body_of(DEVICES["ideal"], None)
    start = compiled.at_rest(pin.SE3.Identity())
    command = np.arange(1.0, 7.0) / 10.0
    expected = compiled.step(start, command, None, 0, command).flat
    command.flags.writeable = False
    assert np.array_equal(compiled.step(start, command, None, 0, command).flat, expected)
    apart = np.column_stack((command, np.full(6, 7.0)))[:, 0]
    assert np.array_equal(compiled.step(start, apart, None, 0, apart).flat, expected)


def test_a_scene_has_its_device_and_its_hand():
    scene = load_scene("spatial_arm")
    assert type(device_for(scene)) is ImpedanceDevice
    pose = random_pose(np.random.default_rng(8), False, 1.0)
    for with_hand in (True, False):
        body = device_for(scene, with_hand)
        start = body.at_rest(pose, held=True)
        own = ImpedanceDevice(scene.device, PERIOD, False, scene.hand if with_hand else None)
        found = body.step(start, NO_WRENCH, start, 700)
        compare(found, own.step(start, NO_WRENCH, start, 700))
        assert found.hand_wrench.any() == with_hand
