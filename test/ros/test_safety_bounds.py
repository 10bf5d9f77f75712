"""Over the graph: a device's safety cannot be taken from it by parameters."""

import pytest
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from ros.harness import WAIT_S, Peer, running

pytestmark = pytest.mark.ros

DEVICE = "haptic_device"
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
