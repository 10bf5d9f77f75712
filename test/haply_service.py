# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An emulated service in a thread of the test's process."""

from __future__ import annotations

import asyncio
import io
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from hapticmech_ros import load_scene
from hapticmech_ros.haply.emulator import EmulatedInverse3, Faults, Service
from hapticmech_ros.scene import Scene

SCENE = load_scene("five_bar").with_(device={"preset": "inverse3"})


class Served:
    """An emulated service.

    Attributes:
        uri: of it.
        device: behind it.
    """

    def __init__(self, device: EmulatedInverse3, faults: Faults | None, port: int) -> None:
        self.device = device
        self._service = Service(device, faults)
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._port = port
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(10.0)

    @property
    def uri(self) -> str:
        return f"ws://127.0.0.1:{self._port}"

    def stop(self) -> None:
        """End it as if its process were killed."""
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(10.0)

    def _run(self) -> None:
        def ready(port: int) -> None:
            self._port = port
            self._ready.set()

        serving = self._service.serve("127.0.0.1", self._port, ready)
        self._task = self._loop.create_task(serving)
        try:
            self._loop.run_until_complete(self._task)
        except asyncio.CancelledError:
            pass
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.close()


@contextmanager
def served(
    scene: Scene = SCENE,
    mounting: np.ndarray | None = None,
    faults: Faults | None = None,
    idle_after: float = 0.05,
    port: int = 0,
    trace: io.StringIO | None = None,
) -> Iterator[Served]:
    """Serve for as long as the block lasts."""
    rotation = np.eye(3) if mounting is None else mounting
    made = Served(EmulatedInverse3(scene, rotation, idle_after, trace), faults, port)
    try:
        yield made
    finally:
        made.stop()
