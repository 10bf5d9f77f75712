# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The driver of an Inverse3 against the emulated service, over a real WebSocket."""

from __future__ import annotations

import socket
import time
from contextlib import contextmanager

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.children import wait_until
from haply_service import SCENE, served
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.haply.emulator import START, Faults
from hapticmech_ros.haply.inverse3 import Inverse3
from hapticmech_ros.haply.messages import Link

# A relaxed arm holds it: it goes nowhere in whatever time a test takes.
ARM = {"kind": "arm", "start_delay": 0.0, "waypoints": [{"time": 0.0}]}
HELD = SCENE.with_(hand=ARM)
TURNED = np.asarray(pin.rpy.rpyToMatrix(0.3, -0.7, 2.0))
# A machine with other work answers late: patience for tests, which check no times.
SILENCE = 2.0


def driver(uri, mounting=None, scene=SCENE, silence=SILENCE, device_id=""):
    made = Inverse3(
        Link(uri), scene, np.eye(3) if mounting is None else mounting, device_id, silence
    )
    made._wait = 0.5
    return made


def until(condition):
    wait_until(condition, 10.0, "what has to happen", look_again_s=0.001)


def found(device):
    until(device.look)
    # Who it is has been said, and is answered.
    return stepped(device, device.at_rest(pin.SE3.Identity()), None)


@contextmanager
def driven(scene=SCENE, mounting=None, **options):
    """Yield a service, its device and the first state that is found of it."""
    with served(scene, mounting, **options) as service:
        device = driver(service.uri, mounting, scene)
        yield service, device, found(device)
        device.close()


def stepped(device, state, *commands):
    """Return the state after periods with these commands."""
    for command in commands:
        state = device.step(state, command, None, 0)
    return state


def test_places_velocities_and_orientation_are_turned_into_the_world():
    with driven(mounting=TURNED) as (_, device, begun):
        assert begun.pose.translation == pytest.approx(TURNED @ START, abs=1e-4)
        state = stepped(device, begun, None)
        assert device.fresh
        # The handle has the axes of the world at the start, and none of the base.
        assert state.measured_pose.rotation == pytest.approx(np.eye(3), abs=1e-3)


def test_a_force_acts_along_the_axes_of_the_world_and_is_told_a_period_later():
    with driven(HELD, TURNED) as (_, device, begun):
        begin = begun.pose.translation.copy()
        command = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.5])
        state = stepped(device, begun, command)
        assert not state.applied.any()
        fastest = 0.0
        for _ in range(300):
            state = device.step(state, command, None, 0)
            fastest = max(fastest, state.measured_twist[0])
            time.sleep(0.0005)
        # No torque: it has no motors for that.
        assert state.applied == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        moved = state.pose.translation - begin
        assert moved[0] > 1e-3
        assert abs(moved[1]) + abs(moved[2]) < 0.05 * moved[0]
        assert fastest > 0.01


def test_a_device_that_was_let_go_tells_no_force_that_it_does_not_give():
    with driven(HELD) as (_, device, begun):
        state = stepped(device, begun, *3 * [np.ones(6)])
        assert state.applied[:3].any()
        device.let_go()
        assert not stepped(device, state, None).applied.any()


def given(service):
    return service.device.state()["current_cursor_force"]["x"]


def pushed_with_a_late_answer(service):
    """Return a device that has sent a force and waits for no answer."""
    device = driver(service.uri, scene=HELD)
    state = found(device)
    device._wait = 0.0
    device.step(state, np.ones(6), None, 0)
    until(lambda: given(service))
    return device


def test_a_device_is_let_go_after_the_answer_that_is_still_to_come():
    with served(HELD, faults=Faults(delay=0.1), idle_after=10.0) as service:
        device = pushed_with_a_late_answer(service)
        device.let_go()
        until(lambda: not given(service))
        assert device.look()
        device.close()


def test_a_device_that_cannot_be_let_go_is_left():
    """The service gives a force for as long as the connection lasts."""
    with served(HELD, faults=Faults(delay=0.2), idle_after=10.0) as service:
        device = pushed_with_a_late_answer(service)
        device.silence = 0.01
        device.let_go()
        assert "no valid sample" in device.problem
        assert device.connections_lost == 1
        until(lambda: not given(service))
        device.close()


def test_forces_stay_within_the_device_s_limit():
    with driven() as (_, device, begun):
        state = stepped(device, begun, np.full(6, 100.0), None)
        assert np.linalg.norm(state.applied) == pytest.approx(SCENE.device.force_limit)


def test_without_a_command_there_is_no_force():
    with driven() as (service, device, begun):
        assert not stepped(device, begun, np.ones(6), None, None).applied.any()
        assert not given(service)


def test_the_hand_is_estimated_from_motion_and_force():
    """A push of 1 N, nothing in between: the observer finds it within its bandwidth."""
    device_keys = {"preset": "inverse3", "coulomb_friction": 0.0, "actuator_bandwidth": 0.0}
    # Heavy, so that it is not far away after a second, and without end stops.
    device_keys |= {"mass": 2.0, "workspace": {"radius": 0.0}}
    hand = {"kind": "constant_wrench", "force": [0.0, 1.0, 0.0], "start_delay": 0.0}
    scene = SCENE.with_(device=device_keys, hand=hand)
    with driven(scene) as (_, device, begun):
        state, told = begun, []
        for _ in range(200):
            state = device.step(state, np.zeros(6), None, 0)
            told.append(state.reported[:3].copy())
            time.sleep(0.0008)
    assert np.median(told[100:], axis=0) == pytest.approx([0.0, 1.0, 0.0], abs=0.15)


def test_a_service_that_is_not_there_is_waited_for():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    device = driver(f"ws://127.0.0.1:{port}")
    for _ in range(20):
        assert not device.look()
        time.sleep(0.001)
    assert "refused" in device.problem
    with served(port=port):
        until(device.look)
        assert device.problem == ""
        device.close()


def test_a_service_that_ends_is_lost_and_found_again():
    with served() as service:
        device = driver(service.uri)
        state = found(device)
        port = int(service.uri.rpartition(":")[2])
    until(lambda: not device.look())
    assert device.problem
    assert device.connections_lost == 1
    with served(port=port):
        until(device.look)
        stepped(device, device.at_rest(state.pose), None)
        assert device.fresh
        device.close()


def test_a_service_that_answers_no_more_is_given_up():
    with served(faults=Faults(silent=1.0)) as service:
        device = driver(service.uri, silence=0.05)
        device._wait = 0.001
        until(device.look)
        state = device.at_rest(pin.SE3.Identity())
        deadline = time.monotonic() + 10.0
        while device.look():
            state = device.step(state, np.ones(6), None, 0)
            assert not device.fresh
            assert time.monotonic() < deadline
        assert "no valid sample" in device.problem


def test_of_commands_one_at_most_is_unanswered():
    with served(faults=Faults(delay=0.2)) as service:
        link = Link(service.uri)
        until(lambda: link.look() or link.is_open)
        assert link.answers(5.0)
        assert link.send("{}")
        assert not link.send("{}")
        assert link.answers(5.0)
        assert link.send("{}")
        link.close()


def test_garbage_is_counted_and_nothing_of_it_is_obeyed():
    with driven(faults=Faults(garbage=0.3, seed=5)) as (_, device, begun):
        state, samples = begun, 0
        for _ in range(600):
            if not device.look():
                state = found(device)
            before = state
            state = device.step(state, None, None, 0)
            if device.fresh:
                samples += 1
                assert np.isfinite(state.flat).all()
                way = state.pose.translation - before.pose.translation
                assert np.linalg.norm(way) < 1.0
            else:
                assert state is before
        assert device.refused > 20
        assert samples > 300


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({}, "device.actuated"),
        ({"preset": "inverse3", "force_sensor": "measured"}, "device.force_sensor"),
    ],
)
def test_a_scene_with_another_device_is_refused(keys, named):
    with pytest.raises(InvalidInputError, match=named):
        driver("ws://127.0.0.1:1", scene=SCENE.with_(device=keys))


@pytest.mark.parametrize("uri", ["http://a:1", "ws://host", "ws://host:x", "", "ws://:5"])
def test_addresses_that_are_none_are_refused(uri):
    with pytest.raises(InvalidInputError, match="uri"):
        Link(uri)


def test_a_device_that_is_not_the_wanted_one_is_not_driven():
    with served() as service:
        device = driver(service.uri, device_id="0000")
        until(lambda: device.look() or "no Inverse3 '0000'" in device.problem)
        assert not device.look()
        device.close()
