# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The control law: wrenches from measurements, against the equations of Fig. 3 in NumPy."""

from dataclasses import astuple, replace

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import (
    DeviceMeasurement,
    OperationalModel,
    PointMeasurement,
)
from hapticmech_ros.control.clutch import engage, pose_error
from hapticmech_ros.control.measurements import (
    InFlight,
    device_of,
    flat_device,
    flat_operational_model,
    model_of,
    operational_model_of,
    point_ahead,
    point_of,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics.saturation import limited
from oracles.controllers import FREE, control_of, random_pose
from oracles.generator import unit

# Sums of some twenty products of the size of the largest, each rounded to 1e-16, in another order.
ROUNDING = 1e-12
SCENES = {"planar": "five_bar", "spatial": "spatial_arm"}
# Not between 3.05 and π - 0.01, where Pinocchio's logarithm loses up to 1e-11.
TURNS = (0.0, 1e-9, 1e-3, 0.1, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-7)


class Case:
    """Measurements, drawn at random, ``turn`` rad and ``way`` m from where they are tied."""

    def __init__(self, rng, turn=0.3, way=0.1, ahead=0.0, size=1.0):
        device, point = random_pose(rng), random_pose(rng)
        # Some times are within the ramp, others after it.
        self.clutch = engage(1.0, device, point, 1.5)
        step = pin.exp3(turn * unit(rng))
        moved = pin.SE3(step @ device.rotation, device.translation + way * unit(rng))
        twists, wrenches = size * rng.normal(size=(2, 6)), size * rng.normal(size=(2, 6))
        self.device = DeviceMeasurement(moved, twists[0], wrenches[0])
        self.point = PointMeasurement(point, twists[1], wrenches[1])
        self.model = OperationalModel(*rng.normal(size=(3, 6, 6)), rng.normal(size=6))
        self.ahead = ahead
        self.time = 1.0 + rng.uniform(0.2, 2.0)
        self.in_flight = None

    def flat(self):
        return flat_device(self.device), flat_operational_model(self.model, self.point), self.ahead

    def compute(self, control):
        given = self.device, self.point, self.model, self.in_flight
        return control.compute(self.time, self.clutch, *given).rows()

    def answer(self, control):
        return control.answer(self.time, self.clutch, *self.flat(), self.in_flight)


def law(control, case, ahead):
    """Return the rows of an answer as Fig. 3 has them."""
    gains, clutch, time = control.gains, case.clutch, case.time
    joint, force, position = gains.joint_constraint, gains.force_channel, gains.position_channel
    task, inertia, channels = control.task, np.diag(control.device_inertia), control.channels
    share, projector = case.model.wrench_projector, case.model.constraint_projector
    point = point_ahead(case.flat()[1], ahead, case.in_flight)
    ramp, through = clutch.ramp(time), clutch.force_ramp(time)

    def spring_damper(stiffness, damping):
        slow = [b * clutch.brake(time, b / m) for b, m in zip(damping, inertia, strict=True)]
        return ramp * stiffness * error + slow * rate

    error = task * pose_error(point.pose, clutch.mapped(case.device.pose))
    rate = task * (case.device.twist - point.twist)
    hand, contact = task * case.device.hand_wrench, task * point.contact_wrench
    push = hand + force.contact * contact
    moved = case.model.inverse_inertia @ (push + force.device_feedback * hand)
    motion = inertia * (moved + case.model.free_acceleration)
    rest = (1.0 - joint.feedforward) * share @ push
    impedance = task * (through * (motion - push) + ramp * rest)
    slow = clutch.brake(time, joint.damping / inertia[0]) * joint.damping
    constraint = -projector @ (ramp * joint.stiffness * error + slow * rate)
    sizes = np.linalg.norm(constraint.reshape(2, 3), axis=1)
    excess = max(sizes / (joint.force_limit, joint.torque_limit))
    constraint /= max(excess / through, 1.0) if through > 0.0 else 1.0
    held = spring_damper(channels.held_stiffness, channels.held_damping)
    channel = through * force.contact * contact - position.to_device * (held - share @ held)
    forces = through * (force.hand * hand + force.mechanism_feedback * contact)
    pulled = position.to_mechanism * spring_damper(channels.stiffness, channels.damping)
    on_hand = limited(impedance + constraint + channel, *control.limits)
    on_hand = control.joined(time, clutch, on_hand)
    told = limited(forces + pulled, *control.limits)
    return np.array([on_hand, told, impedance, constraint, channel, error])


def apart(found, expected):
    """Return the largest difference, relative to the largest number of the answer's rows."""
    assert found.shape == expected.shape == (6, 6)
    assert np.isfinite(expected).all()
    return np.abs(found - expected).max() / np.abs(expected).max()


def same(control, case):
    """Assert that a control keeps to the law, of objects and of numbers; return the answer."""
    found, expected = case.answer(control), law(control, case, case.ahead)
    assert apart(found, expected) < ROUNDING
    # Springs may make little of the pose error: it has to be the same in its own size too.
    error = expected[5]
    assert np.abs(found[5] - error).max() < ROUNDING * max(np.abs(error).max(), 1.0)
    assert apart(case.compute(control), law(control, case, 0.0)) < ROUNDING
    return found


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("beta", [0.0, 0.5, 1.0])
def test_wrenches_are_those_of_the_law(kind, beta):
    control = control_of(SCENES[kind], joint={**FREE, "feedforward": beta})
    rng = np.random.default_rng(5)
    for number in range(600):
        turn, ahead = rng.uniform(0.0, 3.0), (0.0, -0.005, 0.005)[number % 3]
        same(control, Case(rng, turn, rng.uniform(0.0, 0.5), ahead))


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("ahead", [0.0, 0.004])
def test_what_is_in_flight_is_foreseen_alike(kind, ahead):
    rng = np.random.default_rng(7)
    control = control_of(SCENES[kind])
    for _ in range(20):
        case = Case(rng, ahead=ahead)
        before = case.answer(control)
        case.in_flight = InFlight(0.02, 0.1 * rng.normal(size=6))
        assert apart(same(control, case), before) > 1e-3


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("way", [0.0, 1e-9, 0.1])
def test_wrenches_are_the_same_at_every_error(kind, turn, way):
    control = control_of(SCENES[kind])
    rng = np.random.default_rng(6)
    for _ in range(20):
        same(control, Case(rng, turn, way))
    # Nothing else but the error: its own rounding of some 1e-16 m and rad, times 2000 N/m, times
    # six entries of P_c of up to 3.
    still = Case(rng, turn, way, size=0.0)
    still.model = OperationalModel(*rng.normal(size=(3, 6, 6)), np.zeros(6))
    found, expected = still.answer(control), law(control, still, still.ahead)
    assert np.abs(found - expected).max() < ROUNDING * max(np.abs(expected).max(), 10.0)


@pytest.mark.parametrize("kind", SCENES)
def test_gains_of_every_kind_take_their_places(kind):
    """All gains different, so that none can stand in for another."""
    joint = {"stiffness": 31.0, "damping": 3.7, "feedforward": 0.3, **FREE}
    springs = {"stiffness": 17.0, "angular_stiffness": 2.3}
    dampers = {"damping": 1.9, "angular_damping": 0.7}
    forces, device = {"contact": 0.8, "hand": 0.45}, {"mass": 0.6, "inertia": 0.013, **FREE}
    control = control_of(
        SCENES[kind],
        joint,
        device,
        position_channel={**springs, **dampers, "to_mechanism": 0.35, "to_device": 0.6},
        force_channel={**forces, "mechanism_feedback": 0.15, "device_feedback": -0.2},
    )
    # Over a connection the device's side has softer channels than the mechanism's.
    control.apply_gains(control.gains, 0.05)
    assert (control.channels.held_stiffness < 0.5 * control.channels.stiffness).all()
    rng = np.random.default_rng(7)
    for _ in range(200):
        same(control, Case(rng, 0.5, 0.2))


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("where", ["joint", "device"])
@pytest.mark.parametrize("which", ["force_limit", "torque_limit"])
def test_every_limit_cuts_the_same(kind, where, which):
    free = control_of(SCENES[kind])
    control = control_of(SCENES[kind], **{where: {**FREE, which: 0.2}})
    rng = np.random.default_rng(8)
    cut = {"joint": (3,), "device": (0, 1)}[where]
    part = slice(3) if which == "force_limit" else slice(3, 6)
    met = 0
    for _ in range(100):
        case = Case(rng)
        expected, whole = same(control, case), case.answer(free)
        for row in cut:
            met += np.linalg.norm(whole[row, part]) > 0.2
            assert np.linalg.norm(expected[row, part]) < 0.2 * (1.0 + 1e-15)
    assert met > 80 * len(cut)


@pytest.mark.parametrize("duration", [0.0, 0.5])
@pytest.mark.parametrize("since", [-1.0, 0.0, 0.1, 0.5, 7.0])
def test_the_ramp_is_the_same(duration, since):
    # With a limit that is met, and opens with the ramp.
    control = control_of(SCENES["spatial"], joint={"force_limit": 0.5, "torque_limit": 0.5})
    case = Case(np.random.default_rng(10))
    case.clutch = replace(case.clutch, duration=duration)
    case.time = case.clutch.time + since
    found = same(control, case)
    # At a start dampers and springs come in, forces act.
    assert (found[[1, 2, 3]] != 0.0).all()
    # Another grasp's wrench is carried on instead.
    case.clutch = replace(case.clutch, carried=np.arange(6.0))
    found = same(control, case)
    let_through = case.clutch.ramp(case.time)
    assert (found[1:5] == 0.0).all() == (let_through == 0.0)
    if let_through == 0.0:
        assert np.array_equal(found[0], np.arange(6.0))


@pytest.mark.parametrize("ahead", [0.0, 0.004])
def test_flat_measurements_engage_without_error(ahead):
    control, case = control_of(SCENES["spatial"]), Case(np.random.default_rng(13), ahead=ahead)
    case.clutch = control.engage(case.time, *case.flat())
    assert case.clutch.time == case.time
    assert np.abs(case.answer(control)[5]).max() < ROUNDING
    later = (*case.flat()[:2], ahead + 0.01)
    moved = control.answer(case.time, case.clutch, *later)[5, :3]
    assert np.abs(moved + 0.01 * case.point.twist[:3]).max() < 0.1 * np.abs(moved).max()


@pytest.mark.parametrize("kind", SCENES)
def test_a_device_at_rest_on_a_mechanism_at_rest_stays_at_rest(kind):
    """To the bit: what rounding would make of it, springs of thousands would turn into motion."""
    control = control_of(SCENES[kind])
    rng = np.random.default_rng(16)
    for _ in range(200):
        case = Case(rng, size=0.0)
        pose = case.point.pose
        case.clutch = engage(1.0, pose, pose, 1.5)
        case.device = DeviceMeasurement(pose, np.zeros(6), np.zeros(6))
        for rows in (case.answer(control), case.compute(control)):
            assert (rows[[1, 3, 4, 5]] == 0.0).all()


def test_flat_measurements_stand_for_objects():
    case = Case(np.random.default_rng(14))
    device, operational_model, _ = case.flat()
    back, point, model = device_of(device), point_of(operational_model), model_of(operational_model)
    for one, other in ((back, case.device), (point, case.point)):
        # The quaternion between them: a few roundings.
        assert np.abs(pose_error(one.pose, other.pose)).max() < 1e-15 * 10
        assert (one.twist == other.twist).all()
    assert (back.hand_wrench == case.device.hand_wrench).all()
    assert (point.contact_wrench == case.point.contact_wrench).all()
    for found, expected in zip(astuple(model), astuple(case.model), strict=True):
        assert (found == expected).all()


def test_answers_are_copies_and_measurements_stay():
    control = control_of(SCENES["spatial"])
    rng = np.random.default_rng(15)
    case, other = Case(rng), Case(rng)
    device, operational_model, ahead = case.flat()
    for numbers in (device, operational_model):
        numbers.flags.writeable = False
    found = control.answer(case.time, case.clutch, device, operational_model, ahead)
    output = control.compute(case.time, case.clutch, case.device, case.point, case.model)
    before = found.tobytes(), output.rows().tobytes()
    other.answer(control)
    other.compute(control)
    assert (found.tobytes(), output.rows().tobytes()) == before


@pytest.mark.parametrize(("device", "operational_model"), [(18, 139), (20, 139), (19, 138), (0, 0)])
def test_measurements_of_another_size_are_refused(device, operational_model):
    control = control_of(SCENES["planar"])
    clutch = engage(0.0, pin.SE3.Identity(), pin.SE3.Identity())
    with pytest.raises(InvalidInputError, match="139"):
        control.answer(0.0, clutch, np.zeros(device), np.zeros(operational_model), 0.0)


def test_a_planar_scene_gets_no_wrench_out_of_its_plane():
    control, case = control_of(SCENES["planar"]), Case(np.random.default_rng(1))
    case.model = operational_model_of(Session(load_scene(SCENES["planar"])).tick().analysis)
    found = case.answer(control)
    assert np.array_equal(found[:, 2:5], np.zeros((6, 3)))
    assert found[:, [0, 1, 5]].any(axis=1).all()
