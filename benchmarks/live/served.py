# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A live page that is served by this process, and what its session tells meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from benchmarks.live.browser import Page, wait_until
from hapticmech_ros.live.commands import LiveState, Open, Opened, Report
from hapticmech_ros.live.live_picture import LiveFrame, LivePicture, first_view
from hapticmech_ros.live.live_session import LiveSession
from hapticmech_ros.live.page import FIELD_OF_VIEW, LivePage
from hapticmech_ros.live.page_controls import HIDDEN
from hapticmech_ros.live.process import LiveProcess
from hapticmech_ros.live.settings import changes_of
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics import Array


def asked(scene: str) -> Open:
    """Return what the page begins a scene with."""
    return Open(scene, changes_of(load_scene(scene)))


class WatchedProcess(LiveProcess):
    """A live process that keeps what it told.

    Attributes:
        opened: scenes, in their order.
        states: with the time at which each was heard, s of the monotonic clock.
    """

    def __init__(self, scene: str) -> None:
        self.opened: list[Opened] = []
        self.states: list[tuple[float, LiveState]] = []
        super().__init__(asked(scene))

    def news(self, timeout_s: float) -> list[Report]:
        """Return what has come, and keep it."""
        found = super().news(timeout_s)
        for one in found:
            if isinstance(one, LiveState):
                self.states.append((time.monotonic(), one))
            elif isinstance(one, Opened):
                self.opened.append(one)
        return found


class Served(AbstractContextManager["Served"]):
    """A page; as a context manager it ends it.

    Args:
        scenes: that can be chosen; it begins with the first one.

    Attributes:
        process: of its session.
        address: where it is.
    """

    def __init__(self, scenes: Sequence[str]) -> None:
        self.process = WatchedProcess(scenes[0])
        self._page = LivePage(self.process, scenes[0], (), scenes, "127.0.0.1", 8765)
        self.address = self._page.address
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._page.serve, args=(self._stop.is_set,))
        self._thread.start()

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()
        self._page.close()
        self.process.close()

    def opened_in(self, page: Page) -> None:
        """Open it in a tab, and wait until it shows numbers."""
        page.open(self.address)
        wait_until(lambda: page.text("live-count"), "the page's numbers")


@dataclass(frozen=True, slots=True)
class Sight:
    """How a planar scene is seen on a page at its start.

    Attributes:
        state: of the session.
        frame: its picture.
        middle: (2,) of the canvas, px.
        centre: (3,) what is in its middle, m, world axes.
        scale: pixels of a metre.
    """

    state: LiveState
    frame: LiveFrame
    middle: tuple[float, float]
    centre: Array
    scale: float

    def pixel(self, place: Array) -> tuple[float, float]:
        """Return where (x, y) a place of the plane is on the page.

        Args:
            place: (3,) m, world axes.
        """
        x, y, _ = self.scale * (place - self.centre)
        return self.middle[0] + float(x), self.middle[1] - float(y)

    @property
    def hand(self) -> tuple[float, float]:
        """Where (x, y) the hand, of several the first one, is on the page."""
        return self.hand_at(self.state.users[0].point)

    def hand_at(self, point: str) -> tuple[float, float]:
        """Return where (x, y) the hand that holds a point is on the page."""
        return self.pixel(self.state.user(point).device[:, 3])


def sight(page: Page, scene: str) -> Sight:
    """Return how a planar scene is seen on a page at its start."""
    session = LiveSession(asked(scene), 0.0)
    picture, state = LivePicture(session.opened), session.state()
    frame = picture.draw(state, HIDDEN)
    eye, centre, _ = first_view(frame.shapes, planar=True)
    left, top, width, height = page.ask(
        "(() => { const r = document.querySelector('canvas').getBoundingClientRect();"
        " return [r.x, r.y, r.width, r.height]; })()"
    )
    # Of what is seen there, half of its height, m.
    half = float(np.tan(0.5 * FIELD_OF_VIEW) * np.linalg.norm(eye - centre))
    scale = 0.5 * height / half
    return Sight(state, frame, (left + 0.5 * width, top + 0.5 * height), centre, scale)


def hold(page: Page, place: tuple[float, float]) -> None:
    """Take hold of what is at a place (x, y) of the page, once it is drawn."""
    wait_until(lambda: page.is_drawn(*place), "what is to be dragged")
    page.mouse("mouseMoved", *place)
    page.mouse("mousePressed", *place, pressed=True)


def drag(page: Page, start: tuple[float, float], pixels: float) -> tuple[float, float]:
    """Take hold of what is at a place, pull it to the left, and return where (x, y) it is then."""
    x, y = start
    hold(page, start)
    for share in np.linspace(0.0, 1.0, 20).tolist():
        page.mouse("mouseMoved", x - share * pixels, y, pressed=True)
    return x - pixels, y
