# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Over the graph: safety cannot be taken from device and controller by parameters."""

from pathlib import Path

import pytest
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from ros.harness import WAIT_S, Peer, allowing, running

pytestmark = pytest.mark.ros

DEVICE, CONTROLLER = "haptic_device", "teleoperation_controller"
# Less safe than five_bar allows: what a stranger set over the network.
WORSE = {
    "force_limit": 1000.0,
    "torque_limit": 100.0,
    "force_slew": 1e6,
    "torque_slew": 1e5,
    "start_ramp": 0.001,
    "command_timeout": 1.0,
}


def test_no_running_device_is_made_less_safe(domain: int, peer: Peer) -> None:
    samples = peer.listen("device/state", Float64MultiArray)
    with running(DEVICE, domain):
        peer.until(lambda: samples, "the device")
        before = peer.parameters_of(DEVICE, *WORSE)
        for name, value in WORSE.items():
            refused = peer.set_parameters(DEVICE, **{name: value})
            assert not refused.successful
            for words in (name, "the scene's device.", f"got {value:g}"):
                assert words in refused.reason
        assert not peer.set_atomically(DEVICE, view_rate=20.0, force_limit=1000.0).successful
        assert peer.parameters_of(DEVICE, *WORSE, "view_rate") == [*before, 100.0]
        assert peer.set_parameters(DEVICE, force_limit=3.0, force_slew=100.0).successful
        # Nor by way of a device that is made anew.
        assert peer.transition(DEVICE, "deactivate", "cleanup")
        assert peer.set_parameters(DEVICE, force_limit=1000.0).successful
        assert not peer.transition(DEVICE, "configure")
        assert peer.state_of(DEVICE) == "unconfigured"


@pytest.mark.parametrize("name", WORSE)
def test_no_device_starts_less_safe(
    domain: int, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    given = {name: WORSE[name]}
    with running(DEVICE, domain, **given) as process:
        assert process.wait(WAIT_S) == 1
    told = capfd.readouterr().err
    assert f"{name}: must be" in told
    assert f"got {WORSE[name]:g}" in told
    assert "Traceback" not in told


def test_a_locked_device_stays_as_it_was_started(domain: int, peer: Peer) -> None:
    samples = peer.listen("device/state", Float64MultiArray)
    with running(DEVICE, domain, lock_safety=True, force_limit=5.0) as process:
        peer.until(lambda: samples, "the device")
        # Not even to the scene's own.
        for name, value in (
            ("force_limit", 6.0),
            ("force_limit", 4.0),
            ("command_timeout", 0.02),
            ("message_age_limit", 10.0),
            ("use_sim_time", True),
        ):
            refused = peer.set_parameters(DEVICE, **{name: value})
            assert not refused.successful
            assert name in refused.reason
            assert "lock_safety" in refused.reason
        assert not peer.set_parameters(DEVICE, lock_safety=False).successful
        assert peer.set_parameters(DEVICE, view_rate=20.0).successful
        # What leads to zero is always possible.
        stop = SetBool.Request(data=True)
        assert peer.call(SetBool, "device/emergency_stop", stop).success
        assert peer.transition(DEVICE, "deactivate", "cleanup")
        # And no other scene is a way round it.
        refused = peer.set_parameters(DEVICE, scene="two_link")
        assert not refused.successful
        assert "lock_safety" in refused.reason
        assert process.poll() is None


def test_no_running_controller_commands_from_older_inputs_than_the_scene_allows(
    domain: int, peer: Peer
) -> None:
    name = "input_timeout"
    with running(CONTROLLER, domain):
        peer.until(lambda: peer.state_of(CONTROLLER) == "active", "the controller")
        for value in (1.0, 0.1001):
            refused = peer.set_parameters(CONTROLLER, **{name: value})
            assert not refused.successful
            for words in (name, "the scene's device.safety.command_timeout, 0.1", f"got {value:g}"):
                assert words in refused.reason
        assert peer.parameters_of(CONTROLLER, name) == [0.0]
        for value in (0.05, 0.1):
            assert peer.set_parameters(CONTROLLER, **{name: value}).successful
        # Nor by way of a controller that is made anew.
        assert peer.transition(CONTROLLER, "deactivate", "cleanup")
        assert peer.set_parameters(CONTROLLER, **{name: 1.0}).successful
        assert not peer.transition(CONTROLLER, "configure")
        assert peer.state_of(CONTROLLER) == "unconfigured"


def test_no_controller_starts_less_safe(domain: int, capfd: pytest.CaptureFixture[str]) -> None:
    with running(CONTROLLER, domain, input_timeout=0.5) as process:
        assert process.wait(WAIT_S) == 1
    told = capfd.readouterr().err
    rule = "input_timeout: must be at most the scene's device.safety.command_timeout, 0.1"
    assert f"{rule} (got 0.5)" in told
    assert "Traceback" not in told


@pytest.mark.parametrize(
    ("node", "name"),
    [
        (DEVICE, "command_timeout"),
        ("mechanism_simulator", "command_timeout"),
        (CONTROLLER, "input_timeout"),
    ],
)
def test_a_timeout_that_cannot_hold_is_refused(
    domain: int, peer: Peer, node: str, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    rule = f"{name}: must be 0 or at least 3 periods of 250 Hz, 0.012 s (got 0.011)"
    with running(node, domain, control_rate=250.0, **{name: 0.011}) as process:
        assert process.wait(WAIT_S) == 1
    told = capfd.readouterr().err
    assert rule in told
    assert "Traceback" not in told
    with running(node, domain, control_rate=250.0):
        peer.until(lambda: peer.state_of(node) == "active", "the node")
        refused = peer.set_parameters(node, **{name: 0.011})
        assert not refused.successful
        assert rule in refused.reason
        assert peer.parameters_of(node, name) == [0.0]
        assert peer.set_parameters(node, **{name: 0.012}).successful
        assert peer.set_parameters(node, **{name: 0.0}).successful


def test_a_slow_driver_is_waited_for_as_long_as_the_scene_allows(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    scene = allowing(tmp_path, command_timeout=0.5)
    with running(CONTROLLER, domain, scene, input_timeout=0.5, network_delay=0.05):
        peer.until(lambda: peer.state_of(CONTROLLER) == "active", "the controller")
        refused = peer.set_parameters(CONTROLLER, input_timeout=0.501)
        assert "command_timeout, 0.5" in refused.reason


def test_a_locked_controller_stays_as_it_was_started(domain: int, peer: Peer) -> None:
    with running(CONTROLLER, domain, lock_safety=True) as process:
        peer.until(lambda: peer.state_of(CONTROLLER) == "active", "the controller")
        for name, value in (
            ("input_timeout", 0.05),
            ("input_timeout", 0.005),
            ("message_age_limit", 10.0),
            ("soften", False),
            ("use_sim_time", True),
        ):
            refused = peer.set_parameters(CONTROLLER, **{name: value})
            assert not refused.successful
            assert name in refused.reason
            assert "lock_safety" in refused.reason
        assert not peer.set_parameters(CONTROLLER, lock_safety=False).successful
        # Gains are tuned while it renders.
        assert peer.set_parameters(CONTROLLER, view_rate=20.0, c1=0.5).successful
        assert peer.transition(CONTROLLER, "deactivate", "cleanup")
        refused = peer.set_parameters(CONTROLLER, scene="two_link")
        assert not refused.successful
        assert "lock_safety" in refused.reason
        assert process.poll() is None
