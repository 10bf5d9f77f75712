# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page itself: only this module and ``page_controls`` use viser.

Viser is called in its event loop only: its messages are not safe to send from other threads.
Pictures are computed outside it, and mouse events are received meanwhile.
"""

from __future__ import annotations

import asyncio
import io
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
import viser

from hapticmech_ros.live.commands import Backend, Drag, Failed, LiveState, Open, Opened
from hapticmech_ros.live.grip import Mice
from hapticmech_ros.live.live_picture import Drawn, LivePicture, first_view, ground_below
from hapticmech_ros.live.page_controls import (
    Controls,
    History,
    SceneNodes,
    browser,
    words,
    you_html,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.view.drawn import draw_shapes

Made = TypeVar("Made")
# Pictures, numbers and plots a second, at most.
PICTURES_HZ, NUMBERS_HZ, PLOTS_HZ = 30.0, 10.0, 4.0
# Period of sending drags again, s.
REPEAT_S = 0.05
BACKGROUND = (232, 236, 241)
FIELD_OF_VIEW = float(np.deg2rad(45.0))
# Share of a phone's height that viser's panel covers.
COVERED = 0.6


class LivePage:
    """A page on a live session, or on a running graph of nodes.

    Args:
        backend: session or graph to show and move.
        first: scene with which it begins.
        given: changes of that scene, ``key=value`` each.
        scenes: that can be chosen on the page.
        host: address that is served.
        port: likewise; the next free one if it is taken.
    """

    def __init__(
        self,
        backend: Backend,
        first: str,
        given: Sequence[str],
        scenes: Sequence[str],
        host: str,
        port: int,
    ) -> None:
        self._backend = backend
        self._asked = Open(first)
        with redirect_stdout(io.StringIO()):  # the caller prints the address
            self._server = server = viser.ViserServer(host=host, port=port, verbose=False)
        # Clients can request a tunnel to another server without the button as well.
        server.request_share_url = _no_share
        server.gui.configure_theme(show_share_button=False, show_logo=False)
        server.gui.main_panel.dock_right()
        server.scene.configure_environment_map(hdri=None)
        # Fewer lights than by default: where no GPU draws, each takes time at every pixel.
        server.scene.configure_default_lights(enabled=False)
        server.scene.add_light_ambient("/ambient", intensity=0.7)
        server.scene.add_light_directional("/light", position=(0.5, 0.4, 1.0), intensity=1.4)
        # By the browser: an image of viser's takes time at every pixel of every picture.
        server.gui.add_html(f"<style>canvas[data-engine] {{ background: rgb{BACKGROUND} }}</style>")
        server.initial_camera.fov = FIELD_OF_VIEW
        self._mice = Mice(backend.send)
        # Text for each browser alone: its name, and why its drag was refused.
        self._you: dict[int, Any] = {}
        self._picture: LivePicture | None = None
        self._newest: LiveState | None = None
        self._shown: Drawn | None = None
        self._view: tuple[Array, Array, Array] | None = None
        self._number, self._name = 0, ""
        self._history = History()
        self._nodes = SceneNodes(server, self._dragged)
        self._drawn = dict.fromkeys(("picture", "numbers", "plots"), 0.0)
        self._controls = self._with_viser(
            lambda: Controls(
                server, backend, first, given, scenes, self._history, self._save_picture
            )
        )

        async def came(client: Any) -> None:
            number = client.client_id
            self._you[number] = client.gui.add_html(you_html(number, ""), order=-1.0)
            self._fit(client)

        async def gone(client: Any) -> None:
            self._you.pop(client.client_id, None)
            self._mice.let_go(client.client_id)

        async def repeat() -> None:
            while True:
                self._mice.repeat()
                await asyncio.sleep(REPEAT_S)

        server.on_client_connect(came)
        server.on_client_disconnect(gone)
        # In that loop, as it also detects closed tabs: if it hangs, the drag ends.
        self._repeating = asyncio.run_coroutine_threadsafe(repeat(), server.get_event_loop())

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def looked_at(self) -> bool:
        """Whether it is open in a browser."""
        return bool(self._server.get_clients())

    def serve(self, ended: Callable[[], bool]) -> None:
        """Serve the page until it is to end.

        Args:
            ended: whether it is.

        Raises:
            HapticMechError: the session or graph has ended.
        """
        while not ended():
            for report in self._backend.news(REPEAT_S):
                if isinstance(report, Opened):
                    self._with_viser(partial(self._open, report, LivePicture(report)))
                elif isinstance(report, Failed):
                    self._controls.said = report.reason
                elif report.number == self._number:
                    self._newest = report
            state, picture = self._newest, self._picture
            if state is None or picture is None:
                continue
            self._history.add(state)
            if self._view is None:
                self._with_viser(partial(self._look_at_scene, picture, state))
            if self.looked_at and self._due("picture", PICTURES_HZ):
                self._with_viser(partial(self._show, picture.drawn(state, self._controls.hidden)))

    def close(self) -> None:
        """Serve it no more."""
        self._repeating.cancel()
        self._mice.let_go()
        self._server.stop()

    def _due(self, what: str, rate: float) -> bool:
        now = time.monotonic()
        if now - self._drawn[what] < 1.0 / rate:
            return False
        self._drawn[what] = now
        return True

    # Pictures.

    def _with_viser(self, work: Callable[[], Made]) -> Made:
        """Run it in viser's event loop, and return its result."""

        async def done() -> Made:
            return work()

        return asyncio.run_coroutine_threadsafe(done(), self._server.get_event_loop()).result()

    def _open(self, opened: Opened, picture: LivePicture) -> None:
        """Draw another scene, or the same held elsewhere."""
        self._mice.let_go()
        self._controls.said = ""
        new = self._picture is None or opened.asked != self._asked
        self._asked, self._number, self._name = opened.asked, opened.number, opened.scene.name
        self._picture, self._shown, self._newest = picture, None, None
        self._history.begin(picture.users, picture.directions)
        self._nodes.clear()
        if new:
            self._view = None
            self._controls.open(opened, picture.closures)

    def _show(self, new: Drawn) -> None:
        """Show a picture, and from time to time its numbers and plots."""
        self._shown, holders = new, self._mice.holders()
        self._nodes.show(new, holders)
        if self._due("numbers", NUMBERS_HZ):
            self._controls.tell(new, self._name, holders)
        if self._due("plots", PLOTS_HZ):
            self._controls.plot()

    def _look_at_scene(self, picture: LivePicture, state: LiveState) -> None:
        """Move all browsers' cameras to the new scene's default view."""
        # If possible before a browser connects: one that is starting applies only a part of it.
        frame = picture.draw(state, self._controls.hidden)
        eye, centre, up = first_view(frame.shapes, picture.planar)
        self._view = eye, centre, up
        self._server.scene.set_up_direction("+y" if picture.planar else "+z")
        ground = ground_below(frame.shapes, picture.planar)
        self._nodes.stand_on(ground)
        seen = {one.meaning for one in frame.shapes}
        seen |= {"hulls" for number in picture.solids if number >= 0}
        self._controls.explain(seen, ground.words, picture.hues)
        for camera in (
            self._server.initial_camera,
            *(client.camera for client in self._server.get_clients().values()),
        ):
            name = "up" if camera is self._server.initial_camera else "up_direction"
            setattr(camera, name, up)
            camera.position, camera.look_at = eye, centre
        for client in self._server.get_clients().values():
            self._fit(client)

    def _fit(self, client: Any) -> None:
        """On a phone, show the scene above viser's panel, which covers the lower part."""
        if self._view is None or (aspect := client.camera.aspect) >= 1.0:
            return
        eye, centre, up = self._view
        away = (eye - centre) * max(1.0 / (1.0 - COVERED), 1.0 / aspect)
        near = away / np.linalg.norm(away)
        high = 2.0 * np.tan(0.5 * FIELD_OF_VIEW) * np.linalg.norm(away)
        upright = up - (up @ near) * near
        centre = centre - 0.5 * COVERED * high * upright / np.linalg.norm(upright)
        client.camera.position, client.camera.look_at = centre + away, centre

    def _dragged(self, event: Any, link: str | None) -> None:
        """By mouse: drag a link, the hand that is seen there, or nothing if there is none."""
        client = event.client_id
        if Drag not in self._backend.takes:
            return
        if event.phase == "end":
            self._mice.let_go(client)
            return
        eye, seen = np.array(event.client.camera.position), np.array(event.end_position)
        if event.phase == "update":
            self._mice.move(client, eye, seen)
            return
        shown, start = self._shown, np.array(event.start_position)
        body = None if shown is None else shown.body_at(eye, start, link)
        if shown is None or body is None:
            return
        held, grip = shown.held(body, start)
        problem = shown.state.user(body.name).immovable if body.kind == "hand" else ""
        if not problem:
            holder = self._mice.grab(client, body, grip, held, eye, start, shown.picture.planar)
            problem = "" if holder == client else f"{browser(holder)} drags it"
            self._mice.move(client, eye, seen)
        name = words(body, bool(shown.picture.hues))
        if client in self._you:
            self._you[client].content = you_html(client, f"{name}: {problem}" if problem else "")

    def _save_picture(self, event: Any) -> None:
        """Send a client the present picture as a PNG file."""
        shown, name = self._shown, f"{self._name}.png"
        if event.client is None or shown is None:
            return
        with TemporaryDirectory() as folder:
            path = Path(folder) / name
            title = f"{self._name}, {shown.state.time:.2f} s"
            picture = shown.picture
            draw_shapes(shown.frame.shapes, path, picture.planar, title, users=picture.hues)
            content = path.read_bytes()
        self._with_viser(partial(event.client.send_file_download, name, content))


def _no_share(verbose: bool = True) -> None:
    """Refuse to share the page."""
