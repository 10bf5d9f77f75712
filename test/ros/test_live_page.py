# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech run --live`` in a browser: a link is dragged, a loop opened, a gain set."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8MultiArray

if find_spec("viser") is None:
    pytest.skip("viser, of the extra live, is not installed", allow_module_level=True)

from benchmarks.live.browser import Browser, chromium, wait_until

if chromium() is None:
    pytest.skip("Chromium is not installed", allow_module_level=True)

from benchmarks.live.served import drag, sight
from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.graph import private_environment, stop_process
from hapticmech_ros.nodes.qos import LATCHED
from hapticmech_ros.view import Placer
from ros.harness import WAIT_S, Peer

# A browser without a GPU draws with the processor.
pytestmark = [pytest.mark.ros, pytest.mark.alone]
SCENE, LINK = "five_bar", "link1"
# A wrench of a closed tab ends within this, s.
ENDS_S = 0.2


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    found = Browser(tmp_path)
    yield found
    found.close()


@pytest.fixture
def address(domain: int, tmp_path: Path) -> Iterator[str]:
    """Run the graph, held where it is but for the mouse, and return where its page is."""
    command = [sys.executable, "-m", "hapticmech_ros", "run", SCENE, "--live"]
    command += ["-p", "haptic_device.hand=still", "-p", "live_page.port=8780"]
    output = tmp_path / "output"

    def addresses() -> list[str]:
        text = output.read_text(encoding="utf-8")
        return re.findall(r"\[live_page\]: (http\S+)", text)

    # Into a file: a pipe that nobody reads is full some time, and who writes then waits.
    with output.open("w") as stream:
        process = subprocess.Popen(
            command, env=private_environment(domain), stdout=stream, stderr=subprocess.STDOUT
        )
        try:
            wait_until(addresses, "the page's address")
            yield addresses()[0]
        finally:
            stop_process(process)


def test_a_running_graph_is_dragged_tuned_and_let_go(
    domain: int, peer: Peer, browser: Browser, address: str
) -> None:
    del domain
    assert address.startswith("http://127.0.0.1:")
    joints = peer.listen("mechanism/measured_js", JointState)
    closures = peer.listen("mechanism/closures", UInt8MultiArray, LATCHED)
    pushes: list[tuple[float, float]] = []

    def pushed(message: WrenchStamped) -> None:
        force = message.wrench.force
        stamp = message.header.stamp
        pushes.append((stamp.sec + 1e-9 * stamp.nanosec, float(np.hypot(force.x, force.y))))

    topic = f"mechanism/{LINK}/external_cf/live_page"
    peer.node.create_subscription(WrenchStamped, topic, pushed, 1000)

    page = browser.page()
    page.open(address)
    wait_until(lambda: "Hz" in page.text("live-rate"), "the graph's rate on the page")
    asked = {one.partition("//")[2].split("/")[0] for one in page.addresses()}
    assert asked == {address.partition("//")[2]}

    joints.clear()
    peer.until(lambda: joints, "joint states")
    before = np.array(joints[-1].position)
    seen = sight(page, SCENE)
    placed = Placer(Mechanism(load_scene(SCENE))).at(before)
    (limb,) = [ends for name, ends in placed.limbs if name == LINK]
    drag(page, seen.pixel(limb.mean(axis=0)), 40.0)
    page.wait_for_text("live-dragged", LINK)
    moved = lambda: np.abs(np.array(joints[-1].position) - before).max() > 0.05  # noqa: E731
    peer.until(moved, "the mechanism to be moved")
    assert pushes[-1][1] > 0.0

    page.close()
    closed = page.connection.ended() + time.time() - time.monotonic()
    peer.until(lambda: pushes[-1][1] == 0.0, "the wrench to end")
    last = max(at for at, force in pushes if force > 0.0)
    assert last - closed < ENDS_S

    tab = browser.page()
    tab.open(address)
    wait_until(lambda: "Hz" in tab.text("live-rate"), "the graph's rate on the page again")
    tab.click_text("label", "ground_pin")
    peer.until(lambda: closures and list(closures[-1].data) == [0], "the open loop", WAIT_S)
    tab.click_text("label", "ground_pin")
    peer.until(lambda: list(closures[-1].data) == [1], "the closed loop", WAIT_S)

    # Last, as an arrow key turns the view as well.
    tab.click_text("p, span, div", "gains")
    tab.nudge("constraint stiffness, N/m")
    wait_until(lambda: tab.text("live-changed"), "a changed gain on the page")
    (stiffness,) = peer.parameters_of("teleoperation_controller", "constraint_stiffness")
    assert tab.text("live-changed") == f"controller.joint_constraint.stiffness={stiffness:g}"
