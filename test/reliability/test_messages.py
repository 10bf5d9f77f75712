# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile messages and states against all actors at once, in one thread and made-up time."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message

from benchmarks.reliability.fake_graph import ACTORS, START_NS, FakeGraph, Host
from benchmarks.reliability.messages import run_in_process
from hapticmech_ros.errors import OutputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.actor import MOST_DEFECTS
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene import document_of
from hapticmech_ros.wire.wrench import decode_wrench
from nodes.stand_ins import applied, heard, last_sample, say
from nodes.stand_ins import push as push_wrench
from sampling import sampled

CONTROLLER, DEVICE = "teleoperation_controller", "haptic_device"
MECHANISM, ANALYSER = "mechanism_simulator", "nullspace_analyser"
ON_LINK, ON_HAND = "/mechanism/link2/external_cf/x", "/device/hand_cf/x"
HELD = "/mechanism/link2/external_cf/persistent/x"
STATE_TOPICS = {
    "device/state": CONTROLLER,
    "mechanism/state": ANALYSER,
    "analysis/handle/operational_model": CONTROLLER,
    "device/local_feedback_gain": DEVICE,
}


# Without the viewer, which costs most and does nothing to others.
FOUR = ACTORS[:4]


def rendering(scene="five_bar"):
    """Return a graph that renders, and has found whoever pushes."""
    found = FakeGraph(scene, [ON_LINK, ON_HAND, HELD], FOUR)
    found.run(0.3)
    assert well(found)
    return found


@pytest.fixture
def graph():
    return rendering()


def as_accurate(folder, accuracy):
    """Return the path of a scene that watches its steps otherwise."""
    document = document_of(load_scene("five_bar"))
    document["simulation"] = {**document["simulation"], "accuracy": accuracy}
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return str(path)


@pytest.fixture
def fragile(tmp_path):
    """Return a graph whose mechanism does no steps again in smaller ones."""
    return rendering(as_accurate(tmp_path, {"max_substeps": 1}))


@pytest.fixture(scope="module")
def unmoved():
    """Return a graph that only refuses."""
    return rendering()


def well(graph):
    """Return whether all actors do their work now."""
    return all(host.active and host.actor.status()[0] for host in graph.hosts.values())


def unharmed(graph):
    comes_back(graph, 0.02)
    assert all(host.actor.failures.count == 0 for host in graph.hosts.values())


def comes_back(graph, after=0.8):
    """Assert that all do their work again some time (s) later, and have told nothing wild."""
    graph.run(after)
    assert well(graph)
    assert graph.seen.not_finite == graph.seen.beyond == 0


def push(graph, topic, force, torque=0.0):
    push_wrench(graph, topic, (force, 0.0, 0.0, 0.0, 0.0, torque))


def changed(graph, topic, where, value):
    """Return the last message of a topic, stamped now, with some numbers changed."""
    message = graph.last[f"/{topic}"]
    size = graph_size(message)
    values = np.frombuffer(message[-8 * size :]).copy()
    values[:2] = divmod(graph.now_ns, NANOSECONDS)
    values[where] = value
    return message[: -8 * size] + values.tobytes()


def graph_size(message):
    (label,) = struct.unpack_from("<I", message, 8)
    at = 12 + label
    at += -(at - 4) % 4 + 12
    return struct.unpack_from("<I", message, at)[0]


def force_now(graph):
    return np.linalg.norm(applied(graph)[:3])


@pytest.mark.parametrize("topic", STATE_TOPICS)
def test_a_stamp_that_is_none_ends_nobody(unmoved, topic):
    host = unmoved.hosts[STATE_TOPICS[topic]]
    for stamp in (1.797e308, -1.797e308, np.nan, np.inf, -1.0, 0.5, 2.0**31):
        for index in (0, 1):
            before = host.refused
            unmoved.put(f"/{topic}", changed(unmoved, topic, index, stamp))
            assert host.refused == before + 1, host.last_refusal
            assert "stamp" in host.last_refusal or "finite" in host.last_refusal
    unharmed(unmoved)


def test_velocities_beyond_reason_are_refused_before_anything_is_computed(unmoved):
    analyser = unmoved.hosts[ANALYSER]
    for speed in (1e4, 1e80, 1e160, 1e308):
        unmoved.put("/device/state", changed(unmoved, "device/state", slice(9, 15), speed))
        assert "limits.linear_velocity" in unmoved.hosts[CONTROLLER].last_refusal
        before, rate = analyser.refused, min(1e3 * speed, 1e308)
        unmoved.put("/mechanism/state", changed(unmoved, "mechanism/state", slice(7, 10), rate))
        assert analyser.refused == before + 1
    unharmed(unmoved)


@pytest.mark.parametrize("topic", [ON_LINK, HELD, ON_HAND])
def test_pushes_beyond_reason_are_refused(unmoved, topic):
    for force in (1e7, 1e80, 1e308, np.nan):
        before = sum(host.refused for host in unmoved.hosts.values())
        push(unmoved, topic, force)
        assert sum(host.refused for host in unmoved.hosts.values()) == before + 1
    unharmed(unmoved)


@pytest.mark.parametrize(
    ("node", "topic"),
    [
        (DEVICE, "/device/servo_cf"),
        (MECHANISM, "/mechanism/handle/servo_cf"),
        (MECHANISM, "/mechanism/handle/external_cf"),
    ],
)
def test_bad_wrenches_are_refused_and_move_nothing(node, topic):
    kind = next(kind for kind in FOUR if kind.name == node)
    given = {DEVICE: {"wait_for_start": True}}
    graph = FakeGraph("five_bar", [topic], [kind], given)
    topics = heard(graph, f"/{topic.split('/')[1]}/measured_js")
    graph.run(0.3)
    host = graph.hosts[node]
    for number, (wrench, how) in enumerate(
        (
            ([0.0, np.nan, 0.0, 0.0, 0.0, 0.0], {}),
            ([0.0, 0.0, 0.0, 0.0, 0.0, np.inf], {}),
            (np.eye(6)[0], {"frame": "base_link"}),
            (np.eye(6)[0], {"late_s": 10.0}),
            (np.eye(6)[0], {"late_s": -5.0}),
        ),
        1,
    ):
        push_wrench(graph, topic, wrench, **how)
        assert host.refused == number
    graph.run(0.3)
    (joints,) = topics
    assert len(joints) > 20
    assert np.ptp([joint.position for joint in joints], axis=0).max() == 0.0


@pytest.mark.parametrize("topic", [ON_LINK, HELD])
def test_a_push_that_a_mechanism_cannot_bear_is_forgotten_and_the_graph_comes_back(fragile, topic):
    graph = fragile
    for _ in range(3):
        push(graph, topic, 1e6)
        graph.run(0.01)
    mechanism = graph.actor(MECHANISM)
    assert mechanism.failures.count >= 1
    assert mechanism.failures.defects == 0
    told = mechanism.status()
    assert not told[0]
    assert "restarting after an error" in told[1]
    assert "restarts at rest" in graph.hosts[MECHANISM].log.lines[-1][1]
    # It is silent for half a second, and then all goes on.
    before = mechanism.failures.count
    comes_back(graph)
    assert mechanism.failures.count == before


@pytest.mark.parametrize(("force", "torque"), [(0.0, 50.0), (500.0, 0.0), (400.0, 40.0)])
def test_a_device_that_is_thrown_or_spun_comes_back(graph, force, torque):
    """Held by nobody it would go on at that speed, and nobody would ever render with it."""
    device, most = graph.actor(DEVICE), load_scene("five_bar").device.motion
    push(graph, ON_HAND, force, torque)
    speeds = []
    for _ in range(1000):
        graph.tick()
        twist = last_sample(graph).sample.twist.copy()
        speeds.append((np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])))
    assert device.failures.count >= 1
    assert device.failures.defects == 0
    assert "must not exceed device.motion" in device.failures.last
    assert np.all(np.max(speeds, axis=0) <= (most.speed, most.angular_speed))
    comes_back(graph, 1.0)


def test_steps_that_stay_inaccurate_are_told(graph):
    """A push that makes it whirl by tens of radians a step."""
    mechanism, log = graph.actor(MECHANISM), graph.hosts[MECHANISM].log.lines
    assert mechanism.status()[0]
    said = len(log)
    push(graph, HELD, 1e6)
    graph.run(0.02)
    well, sentence, figures = mechanism.status()
    assert not well
    assert "have an energy error above" in sentence
    assert int(figures["steps_inaccurate"]) > 0
    assert int(figures["steps_refined"]) > int(figures["steps_inaccurate"])
    told = [line for line in log[said:] if "have an energy error above" in line[1]]
    assert len(told) == 1
    assert told[0][0] == "warning"
    assert mechanism.failures.count == 0


def test_errors_of_many_steps_that_are_each_within_their_tolerance_are_told(tmp_path):
    graph = rendering(as_accurate(tmp_path, {"tolerance": 0.1}))
    mechanism = graph.actor(MECHANISM)
    well, sentence, figures = mechanism.status()
    assert well
    assert float(figures["energy_drift"]) < 1e-6
    for _ in range(20):
        push(graph, HELD, 1e4)
        graph.run(0.005)
    # What they make from nothing is taken out beyond a thousandth of what was exchanged; what is
    # lost cannot be given back, and is counted and told as long as it lasts.
    before = int(mechanism.status()[2]["steps_inaccurate"])
    assert before > 0
    graph.run(1.1)
    well, sentence, figures = mechanism.status()
    assert int(figures["steps_inaccurate"]) > before
    assert float(figures["energy_surplus_j"]) < 0.0
    drift = float(figures["energy_drift"])
    assert drift > 1e-3
    assert not well
    assert f"drifted by {drift:.1%}" in sentence
    assert mechanism.failures.count == 0


def test_a_mechanism_that_fails_again_at_once_begins_where_the_scene_does(fragile):
    graph = fragile
    mechanism = graph.actor(MECHANISM)
    start = mechanism.simulator.initial_state()
    push(graph, ON_LINK, 300.0)
    graph.run(0.05)
    moved = mechanism.state.q.copy()
    assert not np.allclose(moved, start.q, atol=1e-6)
    push(graph, HELD, 1e6)
    graph.run(0.6)
    assert mechanism.failures.count == 1
    # Near where it failed, until it fails again.
    assert np.abs(mechanism.state.q - start.q).max() > 0.1
    push(graph, HELD, 1e6)
    graph.run(0.05)
    assert mechanism.failures.count == 2
    assert (mechanism.state.q == start.q).all()
    comes_back(graph)


def hold_at(graph, x, y=0.0):
    """Ask for the peg's operational point to be put elsewhere on its link, m."""
    message = PoseStamped()
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.w = 1.0
    say(graph, "/mechanism/handle/set_operational_point", message, "peg")


def test_a_point_that_flies_faster_than_can_be_told_brings_the_mechanism_to_rest():
    """The joints keep their limits where a point far out on a tumbling link does not."""
    graph = rendering("peg_in_hole")
    mechanism = graph.actor(MECHANISM)
    v = np.zeros_like(mechanism.state.v)
    v[-1] = 500.0
    mechanism.state = replace(mechanism.state, v=v)
    hold_at(graph, 5.0)
    graph.run(0.1)
    assert mechanism.failures.count == 1
    assert "limits.linear_velocity" in mechanism.failures.last
    assert not mechanism.state.v.any()
    comes_back(graph, 1.5)


def test_a_point_out_of_the_scene_s_limits_is_refused():
    graph = rendering("peg_in_hole")
    mechanism, host = graph.actor(MECHANISM), graph.hosts[MECHANISM]
    before = mechanism._grasps.numbers.copy()
    # Within the limits on the link, which is itself 35 mm from the world's origin.
    hold_at(graph, 0.0, 999.99)
    graph.run(0.01)
    assert (mechanism._grasps.numbers == before).all()
    assert "limits.position" in host.last_refusal
    assert mechanism.failures.count == 0
    hold_at(graph, 0.0, 0.04)
    graph.run(0.01)
    assert mechanism._grasps.numbers[0, 2] == 0.04


def test_a_hand_that_is_torn_away_is_let_go_and_taken_again(graph):
    device = graph.actor(DEVICE)
    home = device._state.pose.translation.copy()
    taken = device.times_held
    for _ in range(10):
        push(graph, ON_HAND, 9e5)
        graph.run(0.005)
    assert device.failures.count >= 1
    assert device.failures.defects == 0
    # What its actuators do is zero from the failure on, and published.
    assert force_now(graph) == 0.0
    push(graph, ON_HAND, 0.0)
    comes_back(graph)
    assert device.times_held >= taken
    assert np.isfinite(device._state.pose.translation).all()
    assert np.abs(device._state.pose.translation - home).max() < 1e3


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_a_device_whose_state_is_none_goes_back_to_where_it_was(graph, bad):
    device = graph.actor(DEVICE)
    before = device._state.pose.translation.copy()
    device._state.flat[7:13] = bad
    device._state.flat[:3] = bad
    graph.run(0.003)
    assert device.failures.count >= 1
    assert np.abs(device._state.pose.translation - before).max() < 1e-3
    assert force_now(graph) == 0.0
    comes_back(graph)


def test_a_controller_whose_answer_is_none_lets_go_of_both_and_engages_anew(graph):
    controller = graph.actor(CONTROLLER)
    side = controller.side
    engaged = controller.engagements
    real = side.tick

    def broken(*arguments):
        answer = real(*arguments)
        answer.wrenches[:2] = np.nan
        return answer

    side.tick = broken
    graph.run(0.003)
    assert controller.failures.count == 1
    assert "wrench is not sent" in controller.failures.last
    assert controller.side is not side
    comes_back(graph, 0.3)
    assert controller.engagements > engaged


def test_who_cannot_help_failing_is_deactivated_with_nobody_under_a_force(graph):
    host = graph.hosts[CONTROLLER]

    def broken(*arguments):
        raise OverflowError("math range error")

    host.actor._answer_to = broken
    graph.run(0.2)
    assert not host.active
    assert host.actor.failures.defects == MOST_DEFECTS
    assert any(level == "fatal" and "math range error" in text for level, text in host.log.lines)
    for topic in ("/device/servo_cf", "/mechanism/handle/servo_cf"):
        assert not decode_wrench(graph.last[topic]).values.any()
    assert force_now(graph) == 0.0


def test_a_state_that_cannot_be_analysed_is_refused_and_counted(graph):
    analyser = graph.actor(ANALYSER)

    def broken(state):
        raise np.linalg.LinAlgError("Singular matrix")

    real, analyser._model.evaluate = analyser._model.evaluate, broken
    before = graph.hosts[ANALYSER].refused
    graph.run(0.01)
    analyser._model.evaluate = real
    assert graph.hosts[ANALYSER].refused >= before + 5
    assert "Singular matrix" in graph.hosts[ANALYSER].last_refusal
    assert analyser.failures.count == 0
    comes_back(graph, 0.3)


def test_broken_poses_are_refused_and_counted(graph):
    host = graph.hosts[MECHANISM]
    message = PoseStamped()
    message.header.frame_id = "handle"
    good = serialize_message(message)
    before = host.refused
    for wrong in (b"", b"\0\1\0\0", good[:20], good[:-9]):
        graph.put("/mechanism/handle/set_operational_point", wrong)
    assert host.refused == before + 4
    assert host.actor.failures.count == 0


@pytest.mark.parametrize("time_ns", [-5, 2**31 * NANOSECONDS])
def test_a_clock_that_no_stamp_can_tell_is_refused_at_the_start(time_ns):
    class Late(FakeGraph):
        def __init__(self):
            self.now_ns = time_ns
            self.exchange = None

    host = Host(Late(), DEVICE)
    with pytest.raises(OutputError, match="builtin_interfaces/Time"):
        HapticDevice(host, HapticDevice.parameters_type(scene="five_bar"))


def test_time_that_goes_beyond_what_stamps_hold_leaves_the_device_at_zero(graph):
    graph.now_ns = 2**31 * NANOSECONDS - 5_000_000
    for host in graph.hosts.values():
        host.begin_anew()
    graph.run(0.02)
    device = graph.hosts[DEVICE]
    assert "builtin_interfaces/Time" in device.actor.failures.last
    assert not np.any(device.actor._state.applied)
    assert graph.seen.not_finite == 0
    # Nobody has given up: as soon as the clock is right again, all go on.
    assert all(host.active for host in graph.hosts.values())
    graph.now_ns = START_NS
    for host in graph.hosts.values():
        host.begin_anew()
    comes_back(graph, 1.0)


def test_thousands_of_hostile_messages(tmp_path: Path):
    figures = run_in_process(len(sampled(range(2_000), every=10)), tmp_path, ["five_bar"])
    broken = [figure for figure in figures if not figure.kept]
    assert not broken, (broken, (tmp_path / "messages_in_process.txt").read_text())


@pytest.mark.parametrize("stall_ms", [30, 120, 500, 1500])
def test_a_mechanism_that_stood_still_and_catches_up_is_held_by_nobody_meanwhile(stall_ms):
    """It moves by several periods in one then: held, it pulled with twice the hand's force."""
    graph = FakeGraph("five_bar", actors=FOUR)
    graph.run(0.01)
    mechanism, forces = graph.hosts[MECHANISM], []

    def run(ms, standing=False):
        mechanism.active = not standing
        for _ in range(2 * ms):
            graph.tick()
            forces.append(np.linalg.norm(applied(graph)[:3]))

    run(1000)
    before = max(forces)
    run(stall_ms, standing=True)
    run(1000)
    assert well(graph)
    assert forces[-1] > 0.4
    assert max(forces) < 1.15 * max(before, 0.5)
