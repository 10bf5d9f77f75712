# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Over the graph: safety cannot be taken from device and controller by parameters."""

import pytest
from std_srvs.srv import SetBool

from ros.harness import Peer, refused, running

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


@pytest.mark.parametrize(
    ("node", "worse", "rule", "safer"),
    [
        (
            DEVICE,
            list(WORSE.items()),
            "the scene's device.",
            [{"force_limit": 3.0, "force_slew": 100.0}],
        ),
        # Which would command from older inputs than the scene allows.
        (
            CONTROLLER,
            [("input_timeout", 1.0), ("input_timeout", 0.1001)],
            "the scene's device.safety.command_timeout, 0.1",
            [{"input_timeout": 0.05}, {"input_timeout": 0.1}],
        ),
    ],
)
def test_no_running_node_is_made_less_safe(
    domain: int, peer: Peer, node: str, worse: list, rule: str, safer: list
) -> None:
    names = [*dict(worse), "view_rate"]
    with running(node, domain):
        peer.until(lambda: peer.state_of(node) == "active", "the node")
        before = peer.parameters_of(node, *names)
        for name, value in worse:
            refused(peer, node, (name, rule, f"got {value:g}"), **{name: value})
        # Nor is it given a timeout that cannot hold, 250 Hz being its rate.
        timeout = "command_timeout" if node == DEVICE else "input_timeout"
        too_short = f"{timeout}: must be 0 or at least 3 periods of 250 Hz, 0.012 s (got 0.011)"
        refused(peer, node, (too_short,), **{timeout: 0.011})
        less_safe = dict(worse[:1])
        assert not peer.set_atomically(node, view_rate=20.0, **less_safe).successful
        assert peer.parameters_of(node, *names) == before
        for given in safer:
            assert peer.set_parameters(node, **given).successful
        assert peer.set_parameters(node, **{timeout: 0.012}).successful
        # Nor by way of a node that is made anew.
        assert peer.transition(node, "deactivate", "cleanup")
        assert peer.set_parameters(node, **less_safe).successful
        assert not peer.transition(node, "configure")
        assert peer.state_of(node) == "unconfigured"


@pytest.mark.parametrize(
    ("node", "given", "kept", "free"),
    [
        (
            DEVICE,
            {"force_limit": 5.0},
            # Not even to the scene's own.
            [("force_limit", 6.0), ("force_limit", 4.0), ("command_timeout", 0.02)],
            {"view_rate": 20.0},
        ),
        (
            CONTROLLER,
            {},
            [("input_timeout", 0.05), ("input_timeout", 0.005), ("soften", False)],
            # Gains are tuned while it renders.
            {"view_rate": 20.0, "c1": 0.5},
        ),
    ],
)
def test_a_locked_node_stays_as_it_was_started(
    domain: int, peer: Peer, node: str, given: dict, kept: list, free: dict
) -> None:
    with running(node, domain, lock_safety=True, **given) as process:
        peer.until(lambda: peer.state_of(node) == "active", "the node")
        for name, value in (*kept, ("message_age_limit", 10.0), ("use_sim_time", True)):
            refused(peer, node, (name, "lock_safety"), **{name: value})
        assert not peer.set_parameters(node, lock_safety=False).successful
        assert peer.set_parameters(node, **free).successful
        # What leads to zero is always possible.
        if node == DEVICE:
            stop = SetBool.Request(data=True)
            assert peer.call(SetBool, "device/emergency_stop", stop).success
        assert peer.transition(node, "deactivate", "cleanup")
        # And no other scene is a way round it.
        refused(peer, node, ("lock_safety",), scene="two_link")
        assert process.poll() is None
