# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From the mouse to a force in a running graph: ``hapticmech run --live``, dragged in a browser."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from geometry_msgs.msg import WrenchStamped

from benchmarks.children import BenchError
from benchmarks.live.browser import Page, wait_until
from benchmarks.live.served import drag, sight
from benchmarks.reliability.caller import Stranger
from hapticmech_ros.graph.processes import private_environment, stop_process
from hapticmech_ros.nodes.messages import STREAM_PUBLISHER
from hapticmech_ros.numerics import Array

PORT = 8790
# The mouse jumps so far, px, and is still for so long, s, until the hand has come there.
JUMP, STILL_S = 40, 0.5
# Of a jump's force, what has to have come; N, of which a jump has more.
SHARE, LEAST_N = 0.5, 0.02


class _Forces(Stranger):
    """Hears the wrenches that the page sends to the device: arrival, monotonic s, and N."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        super().__init__("watch", environment)
        self.rows: list[tuple[float, float, float]] = []
        topic = "device/hand_cf/live_page"
        self.node.create_subscription(WrenchStamped, topic, self._received, STREAM_PUBLISHER)
        self._thread = threading.Thread(target=self.executor.spin)
        self._thread.start()

    def _received(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        self.rows.append((time.monotonic(), force.x, force.y))

    def close(self) -> None:
        """Hear no more, and leave the graph."""
        self.executor.shutdown()
        self._thread.join()
        super().close()


@contextmanager
def running(scene: str, folder: Path) -> Iterator[tuple[str, _Forces]]:
    """Run a graph with a page, and yield its address and what is heard of its forces."""
    environment = private_environment(73)
    settings = ("-p", "haptic_device.hand=commanded", "-p", f"live_page.port={PORT}")
    command = [sys.executable, "-m", "hapticmech_ros", "run", scene, "--live", *settings]
    output = folder / "graph.log"
    with output.open("w") as stream:
        process = subprocess.Popen(
            command, env=environment, stdout=stream, stderr=subprocess.STDOUT, text=True
        )
        try:
            found = wait_until(
                lambda: re.findall(r"\[live_page\]: (http\S+)", output.read_text("utf-8")),
                "the page's address",
            )
            with closing(_Forces(environment)) as forces:
                yield found[0], forces
        finally:
            stop_process(process)


def drag_in_steps(page: Page, forces: _Forces, scene: str, jumps: int) -> tuple[Array, Array]:
    """Let the mouse jump, and return how long its force took each time, s.

    Args:
        page: of a running graph.
        forces: that are heard of it.
        scene: that it renders, a planar one.
        jumps: how many.

    Returns:
        (jumps,) from when the mouse moved, and from when the browser told the page.

    Raises:
        BenchError: a jump without a force.
    """
    wait_until(lambda: "Hz" in page.text("live-rate"), "the graph's rate on the page")
    # A drag begins with the first moves.
    x, y = drag(page, sight(page, scene).hand, float(JUMP))
    page.wait_for_text("live-dragged", "hand")
    page.ask("window.moves.length = 0")
    sent = np.zeros(jumps)
    for jump in range(jumps):
        time.sleep(STILL_S)
        sent[jump] = time.monotonic()
        # To and fro: it stays where it can be reached.
        page.mouse("mouseMoved", x - JUMP * (1 - jump % 2), y, pressed=True)
    time.sleep(STILL_S)
    page.mouse("mouseReleased", x, y)
    told = np.array([one[0] for one in page.ask("window.moves")])[:jumps]
    told = 1e-3 * told + (time.monotonic() - time.time())
    came = arrivals(np.array(forces.rows), sent)
    return came - sent, came - told


def arrivals(rows: Array, sent: Array) -> Array:
    """Return when the force of each jump came first, s.

    Args:
        rows: (n, 3) arrivals, s, and forces, N.
        sent: (jumps,) when the mouse jumped, s.

    Raises:
        BenchError: a jump without a force.
    """
    found = np.zeros(sent.size)
    for jump, begun in enumerate(sent.tolist()):
        before = rows[rows[:, 0] <= begun][-1]
        after = rows[(rows[:, 0] > begun) & (rows[:, 0] < begun + STILL_S)]
        changed = np.hypot(*(after[:, 1:] - before[1:]).T) if len(after) else np.zeros(0)
        if not changed.size or changed.max() < LEAST_N:
            raise BenchError(f"jump {jump} of the mouse had no force")
        found[jump] = after[np.argmax(changed > SHARE * changed.max()), 0]
    return found
