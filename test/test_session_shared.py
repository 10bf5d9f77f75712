# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several users on one mechanism, by sessions: what each feels of it, and of the others."""

from itertools import pairwise

import numpy as np
import pytest

from hapticmech_ros import InvalidInputError, Session, SharedSession, Simulator, load_scene
from hapticmech_ros.analysis.impedance import amplitudes, faded_in, multisine
from hapticmech_ros.analysis.touch import fine_times, samples_of, scripted
from hapticmech_ros.control import control_for
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.analysis import ContactWrenches, by_others, coupling, transmission
from hapticmech_ros.scene import document_of, scene_from_document
from oracles.closed_form import kkt
from oracles.running import varied
from oracles.users import MASS, REACH, inverse_inertia, two_points
from sampling import only_long, sampled

ARM = {"mass": 0.5, "damping": 8.0, "stiffness": 200.0}
TURNING = {"angular_inertia": 5e-4, "angular_damping": 4e-2, "angular_stiffness": 0.2}
HOLDS = {"kind": "arm", "start_delay": 0.0, "waypoints": [{"time": 0.0}], **ARM, **TURNING}
ROUNDING = 1e-12


def shared(*hands, **changes):
    return scene_from_document(two_points(hands=list(hands), **changes))


def spread():
    """Return scenes with two points and more, with and without loops."""
    yield shared({"point": "a"}, {"point": "b"})
    points = [
        {"name": "a", "link": "hand", "origin": {"xyz": [0, 0, 0.06]}},
        {"name": "b", "link": "upper_arm", "origin": {"xyz": [0, 0, 0.2]}},
    ]
    yield load_scene("spatial_arm").with_(operational_points=points)
    points = [
        {"name": "a", "link": "payload", "origin": {"xyz": [0.04, 0, 0]}},
        {"name": "b", "link": "payload", "origin": {"xyz": [-0.04, 0, 0]}},
        {"name": "c", "link": "left_forearm", "origin": {"xyz": [0.05, 0, 0]}},
    ]
    yield load_scene("shared_payload").with_(operational_points=points)
    document = document_of(load_scene("five_bar"))
    handle = document["operational_points"][0]
    elbow = handle | {"name": "elbow", "origin": {"xyz": [0.01, 0, 0], "rpy": [0, 0, 0]}}
    yield scene_from_document(document | {"operational_points": [handle, elbow]})


@pytest.mark.parametrize("scene", list(spread()), ids=lambda s: s.name)
def test_the_coupling_is_that_of_the_mechanism_with_its_loops_closed(scene):
    simulator = Simulator(scene)
    state = simulator.initial_state()
    terms = simulator.evaluate(state)
    found, points = coupling(terms), terms.points
    scale = np.abs(found).max()
    for j, point in enumerate(points):
        for k, force in enumerate(point.jacobian):
            rates = kkt(terms.inertia, terms.closure_jacobian, force, 0.0 * terms.closure_bias)[0]
            for i, other in enumerate(points):
                # The oracle solves with W D⁻¹ Wᵀ, whose condition is the square of that here.
                assert found[i, j, :, k] == pytest.approx(other.jacobian @ rates, abs=1e-9 * scale)
    assert found.transpose(1, 0, 3, 2) == pytest.approx(found, abs=ROUNDING * scale)
    for index, point in enumerate(scene.operational_points):
        own = Analyser(simulator.mechanism, point.name).analyse(terms).inverse_inertia
        assert found[index, index] == pytest.approx(own, abs=ROUNDING * scale)


def test_the_coupling_of_a_free_body_is_the_closed_form():
    simulator = Simulator(shared({"point": "a"}, {"point": "b"}))
    found = coupling(simulator.evaluate(simulator.initial_state()))
    places = np.array([[REACH, 0, 0], [-REACH, 0, 0]])
    for i, one in enumerate(places):
        for j, other in enumerate(places):
            assert found[i, j] == pytest.approx(inverse_inertia(one, other), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("scene", list(spread()), ids=lambda s: s.name)
def test_another_hand_is_felt_as_what_accelerates_the_point_as_it_does(scene):
    simulator = Simulator(scene)
    terms, count = simulator.evaluate(simulator.initial_state()), len(scene.operational_points)
    task = np.zeros(6)
    task[list(scene.task_rows)] = 1.0
    wrenches = task * np.random.default_rng(4).normal(size=(count, 6))
    felt = ContactWrenches(simulator.mechanism).at(terms, by_others(terms, wrenches))
    x = coupling(terms)
    for i, point in enumerate(scene.operational_points):
        analysis = Analyser(simulator.mechanism, point.name).analyse(terms)
        wanted = sum(x[i, j] @ wrenches[j] for j in range(count) if j != i)
        others = [j for j in range(count) if j != i]
        by_matrix = sum(transmission(analysis, x[i, j]) @ wrenches[j] for j in others)
        assert felt[i] == pytest.approx(by_matrix, abs=1e-9 * np.abs(by_matrix).max())
        # Along the directions that the joints do not constrain; along the others, nothing.
        free = analysis.weights == 0.0
        rigid = analysis.weights == 1.0
        assert free.any()
        columns = np.zeros((6, free.size))
        columns[analysis.rows] = analysis.spectrum.wrenches
        scale = np.abs(x[i]).max() * np.abs(wrenches).max()
        along = columns[:, free].T
        assert along @ (x[i, i] @ felt[i]) == pytest.approx(along @ wanted, abs=1e-9 * scale)
        assert columns[:, rigid].T @ x[i, i] @ felt[i] == pytest.approx(0.0, abs=1e-9 * scale)


@pytest.mark.parametrize("name", ["five_bar", "crane"])
def test_one_hand_alone_is_a_session_to_the_bit(name):
    scene = load_scene(name)
    point = scene.operational_points[0].name
    one = Session(scene)
    other = SharedSession(scene.with_(hands=[{"point": point}]))
    for _ in range(600):
        expected, found = one.tick(), other.tick()[point]
    assert np.array_equal(found.mechanism.q, expected.mechanism.q)
    assert np.array_equal(found.wrenches, expected.wrenches)
    assert np.array_equal(found.hand_wrench, expected.hand_wrench)


def test_many_ticks_are_single_ones():
    scene = shared({"point": "a", "hand": HOLDS | {"waypoints": [{"time": 0.0}, WAY]}}, HOLD_B)
    one, other = SharedSession(scene), SharedSession(scene)
    rows = one.run(400, every=4)
    for tick in range(400):
        samples = other.tick()
        if tick % 4 == 0:
            for point, sample in samples.items():
                assert np.array_equal(rows[point]["q"][tick // 4], sample.mechanism.q)
                assert np.array_equal(rows[point]["on_hand"][tick // 4], sample.acting[0])
    assert one.time == other.time == pytest.approx(0.4)
    assert len(rows["a"]["q"]) == len(rows["b"]["q"]) == 100


WAY = {"time": 0.3, "xyz": [0.02, 0.01, 0.0]}
HOLD_B = {"point": "b", "hand": HOLDS}
FREQUENCIES = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0])


def felt(scene, direction, exchange=True):
    """Return the twist of device a along a direction, per unit of a multisine push on it, (k,)."""
    period = scene.simulation.period
    fine = fine_times(period, round(3.0 / period))
    push = faded_in(fine, 0.5) * multisine(fine, FREQUENCIES, 5e-4 * FREQUENCIES)
    with scripted(fine, push[:, None] * direction) as hand:
        pushes, holds = scene.hands
        session = SharedSession(varied(scene, hands=(varied(pushes, hand=hand), holds)))
    if not exchange:
        session._direct = {point: {} for point in "ab"}
    twists = session.run(round(3.0 / period))["a"]["device_twist"] @ direction
    times, push = samples_of(fine), samples_of(push)
    # What the start has set in motion has died away.
    last = slice(times.size - round(1.0 / period), None)
    answer = amplitudes(times[last], twists[last], FREQUENCIES)
    return answer / amplitudes(times[last], push[last], FREQUENCIES)


def with_an_arm(direction, massless):
    """Return the same of the body alone with the arm b on it, (k,): closed form."""
    a, b = np.array([REACH, 0, 0]), np.array([-REACH, 0, 0])
    own, to, back, there = (inverse_inertia(p, q) for p, q in ((a, a), (a, b), (b, a), (b, b)))
    parts = [
        np.diag([ARM[line]] * 3 + [TURNING[turn]] * 3)
        for line, turn in (
            ("mass", "angular_inertia"),
            ("damping", "angular_damping"),
            ("stiffness", "angular_stiffness"),
        )
    ]
    if massless:
        parts[0] = np.zeros((6, 6))
    found = []
    for s in 2j * np.pi * FREQUENCIES:
        arm = s * parts[0] + parts[1] + parts[2] / s
        held = own - to @ arm @ np.linalg.solve(s * np.eye(6) + there @ arm, back)
        found.append(direction @ held @ direction / s)
    return np.array(found)


@pytest.mark.parametrize(
    ("massless", "most", "axis"),
    sampled([(*case, axis) for case in ((True, 0.015), (False, 0.06)) for axis in (0, 1)], every=4),
)
def test_one_feels_the_arm_of_the_other_through_the_body(axis, massless, most):
    """Its device gets what the other does at once; what is left is of the order of the period.

    It is several times as much of a mass that is fixed to the other device, where F_j jumps with
    the commands.
    """
    direction, errors = np.eye(6)[axis], []
    wanted = with_an_arm(direction, massless)
    other = HOLD_B
    if massless:
        springs = {k: v for k, v in HOLDS.items() if k not in ("mass", "angular_inertia")}
        other = {"point": "b", "hand": springs | {"kind": "spring_damper"}}
    alone = direction @ inverse_inertia(*[np.array([REACH, 0, 0])] * 2) @ direction
    matters = np.abs(alone / (2j * np.pi * FREQUENCIES) / wanted - 1.0)
    assert matters.min() > 0.15
    for period in (1e-3, 5e-4, *only_long(2.5e-4)):
        scene = shared({"point": "a"}, other, simulation={"period": period})
        errors.append(np.abs(felt(scene, direction) / wanted - 1.0))
    assert errors[0].max() < most
    # With a coupling that is late by two periods they are several times as large at 10 Hz.
    scene = shared({"point": "a"}, other)
    late = np.abs(felt(scene, direction, exchange=False) / wanted - 1.0)
    assert late[-1] > 4.0 * errors[0][-1]
    # They fall with the period; what is left of the start is not subtracted.
    for coarse, fine in pairwise(errors):
        assert (fine[3:] < 0.6 * coarse[3:]).all()


@pytest.mark.parametrize("passive", [False, True])
def test_the_other_lets_go_and_its_push_is_felt_no_more(passive):
    """Both push against each other and nothing moves; then one lets go.

    The device that nobody holds follows the body. Its mass is balanced by its actuators; with
    passivity control they give no energy that they have not got, and the other hand moves it too.
    """
    push = {"kind": "constant_wrench", "start_delay": 0.5}
    scene = shared(
        {"point": "a", "hand": push | {"force": [-0.5, 0.0, 0.0]}},
        {"point": "b", "hand": push | {"force": [0.5, 0.0, 0.0], "release_at": [1.0]}},
        controller={"passivity": {"control": passive}},
    )
    rows = SharedSession(scene).run(2000)
    time, speed = rows["a"]["time"], rows["a"]["twist"][:, 0]
    assert np.abs(speed[(time > 0.6) & (time < 1.5)]).max() < 1e-6
    alone, moved = (time > 1.6) & (time < 1.95), MASS + passive * scene.device.mass
    for point in "ab":
        gained = np.polyfit(time[alone], rows[point]["device_twist"][alone, 0], 1)[0]
        # Passivity control brakes in jerks, by what it saw a period before.
        assert gained == pytest.approx(-0.5 / moved, rel=0.05 if passive else 0.002)


def test_what_the_hands_do_is_what_the_body_gets():
    scene = shared({"point": "a", "hand": HOLDS | {"waypoints": [{"time": 0.0}, WAY]}}, HOLD_B)
    session, works = SharedSession(scene), []
    for _ in range(1000):
        before = session.mechanism
        samples = session.tick()
        # With a wrench held over the step its work is that of the displacement.
        terms = [session.simulator.evaluate(state) for state in (before, session.mechanism)]
        for index, sample in enumerate(samples.values()):
            mean = 0.5 * (terms[0].points[index].twist + terms[1].points[index].twist)
            works.append(session.period * float(sample.acting[1] @ mean))
    account = session.mechanism.account
    energy = sum(session.simulator.mechanism.energy(session.mechanism.q, session.mechanism.v))
    assert account.work_in == pytest.approx(energy, abs=1e-12)
    # Twists within the step are not quite linear in time.
    exchanged = np.abs(works).sum()
    assert exchanged > 1e-4
    assert sum(works) == pytest.approx(account.work_in, abs=1e-5 * exchanged)


def test_two_arms_on_a_light_body_come_to_rest():
    """Firm arms with half a kilogram on devices that are as heavy as the body.

    Lighter ones are below the M-width of masses that are fixed to the devices (docs/limits.md).
    """
    firm = {"kind": "arm", "impedance": "firm", "start_delay": 0.0, "waypoints": [{"time": 0.0}]}
    document = two_points(hands=[{"point": "a", "hand": firm}, {"point": "b", "hand": firm}])
    inertia = {"ixx": 1.2e-3, "iyy": 1.2e-3, "izz": 1.2e-3}
    document["links"][0]["inertial"] = {"mass": 0.3, "inertia": inertia}
    session = SharedSession(scene_from_document(document))
    push = {"a": np.array([1.0, 0.3, 0.2, 0.01, 0.0, 0.01])}
    sizes = [
        np.linalg.norm(session.tick(hand_wrenches=push if 600 <= k < 620 else {})["a"].device.twist)
        for k in range(3500)
    ]
    assert max(sizes[600:700]) > 0.1
    assert max(sizes[3000:]) < 1e-3 * max(sizes[600:700])


@pytest.mark.parametrize("impedance", ["relaxed", "firm"])
def test_behind_50_ms_each_nothing_is_given_that_was_not_got(impedance):
    """Round trips of 200 ms from one hand to the other and back; without control they diverge."""
    arm = {"kind": "arm", "impedance": impedance, "start_delay": 0.0, "waypoints": [{"time": 0.0}]}
    late = {"delay": 0.05, "expected": 0.05}
    scene = shared(*({"point": point, "hand": arm, "connection": late} for point in "ab"))
    session, given, lowest, speeds = SharedSession(scene), 0.0, 0.0, []
    push = {"a": np.array([2.0, 0.6, 0.4, 0.01, 0.0, 0.01])}
    for tick in range(5000):
        samples = session.tick(hand_wrenches=push if 1000 <= tick < 1100 else {})
        for sample in samples.values():
            given += session.period * float(sample.hand_wrench @ sample.device.twist)
        lowest = min(lowest, given)
        speeds.append(max(np.linalg.norm(s.device.twist[:3]) for s in samples.values()))
    passivity = scene.controller.passivity
    assert lowest > -2.0 * (passivity.allowance + passivity.slack)
    assert max(speeds[1000:1300]) > 0.03
    assert max(speeds[4700:]) < 0.05 * max(speeds)


def test_a_law_of_ones_own_is_not_corrected_for_others():
    """How it answers F_c is not known; the other user's device is corrected all the same."""
    scene = shared({"point": "a", "hand": HOLDS | {"waypoints": [{"time": 0.0}, WAY]}}, HOLD_B)
    law = control_for(scene.held_at("a"), lambda seen: (np.zeros(6), seen.device.hand_wrench))
    session = SharedSession(scene, controls={"a": law})
    session.run(200)
    others = {point: session.user(point)._parts.others for point in "ab"}
    assert not others["a"].any()
    assert others["b"].any()


def test_loops_are_switched_for_all():
    (scene,) = [one for one in spread() if one.name == "shared_payload"]
    session = SharedSession(scene.with_(hands=[{"point": "a"}, {"point": "c"}]))
    session.run(50)
    before = session.user("c").controller
    session.switch_closure("left_grasp", closed=False)
    samples = session.tick()
    assert [sample.mechanism.active for sample in samples.values()] == [(False, True)] * 2
    assert session.user("c").controller is before


PUSH = np.zeros(6)


@pytest.mark.parametrize(
    ("ask", "rule"),
    [
        (lambda one: one.tick(external_wrenches={"c": PUSH}), "must be a point that is held"),
        (lambda one: one.tick(hand_wrenches={"a": PUSH[:3]}), r"must be \(6,\)"),
        (lambda one: one.tick(hand_wrenches={"b": PUSH + np.nan}), "finite"),
        (lambda one: one.tick(on_links={"tail": PUSH}), "tail"),
        (lambda one: one.run(-1, 1), "or more"),
        (lambda one: one.run(1, 0), "or more"),
        (lambda one: one.user("c"), "'c'"),
        (lambda one: SharedSession(one.scene, command_delay=-1), "command_delay"),
        (lambda one: SharedSession(one.scene, controls={"c": one.user("a")._control}), "controls"),
    ],
)
def test_bad_input_moves_nothing(ask, rule):
    session = SharedSession(shared({"point": "a"}, HOLD_B))
    session.run(10)
    state = session.mechanism
    with pytest.raises(InvalidInputError, match=rule):
        ask(session)
    assert session.mechanism is state
    assert session.time == pytest.approx(0.01)


def test_one_user_holds_elsewhere_and_the_others_stay():
    """Held at the other point's place, X_ii and X_ij are those of that point: one and the same."""
    session = SharedSession(shared({"point": "a"}, {"point": "b", "hand": HOLDS}))
    session.run(50)
    session.set_operational_point("a", "b")
    pushed = session.tick(hand_wrenches={"b": np.array([0.5, 0.0, 0.2, 0.0, 0.01, 0.0])})
    for name in ("a", "b"):
        felt = pushed[name].analysis.inverse_inertia
        assert felt == pytest.approx(pushed["b"].analysis.inverse_inertia, abs=1e-9)
    found = coupling(session.simulator.evaluate(session.mechanism))
    assert found[0, 1] == pytest.approx(found[1, 1], rel=1e-9, abs=1e-9 * np.abs(found).max())
    with pytest.raises(InvalidInputError, match="must be a point that is held"):
        session.set_operational_point("c", "b")
    rows = session.run(500)
    assert np.isfinite(rows["a"]["position"]).all()
    assert np.abs(rows["b"]["position"][-1] - rows["b"]["position"][0]).max() < 0.05
