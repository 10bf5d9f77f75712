# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech run --live`` in a browser: a link is dragged, a loop opened, a gain set."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8MultiArray

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.view import Placer
from live.in_browser import Browser, drag, sight, wait_until
from oracles.users import five_bar_of_two
from ros.harness import WAIT_S, Peer, program

# A browser without a GPU draws with the processor.
pytestmark = pytest.mark.alone
SCENE, LINK = "five_bar", "link1"
# A wrench of a closed tab ends within this, s.
ENDS_S = 0.2


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    found = Browser(tmp_path)
    yield found
    found.close()


@contextmanager
def served(command: list[str], domain: int, folder: Path) -> Iterator[str]:
    """Run what serves a page, and yield where this is."""
    output = folder / "output"

    def addresses() -> list[str]:
        text = output.read_text(encoding="utf-8")
        return re.findall(r"\[live_page\]: (http\S+)", text)

    # Into a file: a pipe that nobody reads is full some time, and who writes then waits.
    with (
        output.open("w") as stream,
        program(domain, *command, stdout=stream, stderr=subprocess.STDOUT),
    ):
        wait_until(addresses, "the page's address")
        yield addresses()[0]


def graph_of(scene: str) -> list[str]:
    """Return the command of a graph, held where it is but for the mouse."""
    command = [sys.executable, "-m", "hapticmech_ros", "run", scene, "--live"]
    return [*command, "-p", "haptic_device.hand=still", "-p", "live_page.port=8780"]


@pytest.fixture
def address(domain: int, tmp_path: Path) -> Iterator[str]:
    """Run the graph, and return where its page is."""
    with served(graph_of(SCENE), domain, tmp_path) as found:
        yield found


class Pushes:
    """Hears what a page pushes one body with: time of the message, s, and force, N."""

    def __init__(self, peer: Peer, topic: str) -> None:
        self.rows: list[tuple[float, float]] = []
        peer.node.create_subscription(WrenchStamped, f"{topic}/live_page", self._received, 1000)

    def _received(self, message: WrenchStamped) -> None:
        force, stamp = message.wrench.force, message.header.stamp
        self.rows.append((stamp.sec + 1e-9 * stamp.nanosec, float(np.hypot(force.x, force.y))))


def test_a_running_graph_is_dragged_tuned_and_let_go(
    peer: Peer, browser: Browser, address: str
) -> None:
    assert address.startswith("http://127.0.0.1:")
    joints = peer.listen("mechanism/measured_js", JointState)
    closures = peer.listen("mechanism/closures", UInt8MultiArray, LATCHED)
    pushes = Pushes(peer, f"mechanism/{LINK}/external_cf").rows

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
    peer.until(lambda: any(force > 0.0 for _, force in pushes), "the push")

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
    tab.click_text("p, span, div", "tune")
    tab.click_text("p, span, div", "gains")
    tab.nudge("constraint stiffness, N/m")
    wait_until(lambda: tab.text("live-changed"), "a changed gain on the page")
    (stiffness,) = peer.parameters_of("teleoperation_controller", "constraint_stiffness")
    assert tab.text("live-changed") == f"controller.joint_constraint.stiffness={stiffness:g}"


def test_of_several_users_one_hand_is_dragged_and_the_others_are_not(
    domain: int, peer: Peer, browser: Browser, tmp_path: Path
) -> None:
    scene = str(five_bar_of_two(tmp_path))
    poses = {p: peer.listen(f"{p}/device/measured_cp", PoseStamped) for p in ("left", "right")}
    pushes = {p: Pushes(peer, f"{p}/device/hand_cf").rows for p in poses}
    # Slower than real devices are: nine processes and a browser share few processors.
    command = [*graph_of(scene), "--control-rate", "200"]
    with served(command, domain, tmp_path) as address:
        page = browser.page()
        page.open(address)
        wait_until(lambda: "right/haptic_device" in page.text("live-rate"), "both devices' rates")
        wait_until(lambda: "an arm" in page.text("live-holding-right"), "what holds the right one")
        assert "displace it by" in page.text("live-holding-right")
        peer.until(lambda: all(poses.values()), "both devices")
        before = poses["right"][-1].pose.position
        place = np.array((before.x, before.y, 0.0))
        x, y = drag(page, sight(page, scene).pixel(place), 30.0)
        page.wait_for_text("live-dragged", "hand right")
        page.wait_for_text("live-holders", page.text("live-you"))

        peer.until(
            lambda: bool(pushes["right"]) and pushes["right"][-1][1] > 0.1,
            "a force on the right hand",
        )
        # To the left on the page, which is along -x of the world.
        peer.until(
            lambda: poses["right"][-1].pose.position.x < before.x - 5e-4, "the device to be moved"
        )
        page.mouse("mouseReleased", x, y)
        peer.until(lambda: pushes["right"][-1][1] == 0.0, "the force to end")
        page.close()
    assert pushes["left"] == []


def test_the_page_says_why_a_hand_cannot_be_dragged(
    domain: int, peer: Peer, browser: Browser, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "hapticmech_ros.nodes.entry", "live_page", "--ros-args"]
    with served([*command, "-p", "port:=8781"], domain, tmp_path) as address:
        page = browser.page()
        page.open(address)
        page.wait_for_text(
            "live-holding", "cannot be dragged: no device subscribes to device/hand_cf"
        )
        drag(page, sight(page, SCENE).hand, 20.0)
        page.wait_for_text("live-refused", "hand: no device subscribes to device/hand_cf")
        page.wait_for_text("live-dragged", "nothing")
        told = peer.publisher("/diagnostics", DiagnosticArray)
        status = DiagnosticStatus(name="haply_device", message="rendering")

        peer.until(
            lambda: "haply_device drives a real device" in page.text("live-holding"),
            "the page to know the device",
            WAIT_S,
            doing=lambda: told.publish(DiagnosticArray(status=[status])),
        )
        page.close()
