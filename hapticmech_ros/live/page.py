# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page itself: all that is known here of viser, and nowhere else.

What viser is told is told in its event loop: its messages are not safe to send from other threads.
Pictures are computed outside it, so that the mouse is heard meanwhile.
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
from typing import Any

import numpy as np
import viser
import viser.uplot

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import (
    Backend,
    Command,
    DragStiffness,
    Failed,
    Hold,
    LiveState,
    Open,
    Opened,
    Pause,
    Record,
    Reset,
    Step,
    SwitchClosure,
    Tune,
)
from hapticmech_ros.live.drawing import Drawing, Drawn, NodeKey
from hapticmech_ros.live.grip import SOFTEST, STIFFEST
from hapticmech_ros.live.history import History
from hapticmech_ros.live.instances import InstanceArrays, unit_body
from hapticmech_ros.live.live_picture import LAYERS, LiveFrame, LivePicture, first_view
from hapticmech_ros.live.mouse import Mouse
from hapticmech_ros.live.numbers import QUICK_TIMERS, numbers_html
from hapticmech_ros.live.settings import (
    HANDS,
    LONGEST_DELAY_MS,
    MOUSE_ALONE,
    changes_of,
    gain_sliders,
)
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.view.drawn import draw_shapes
from hapticmech_ros.view.mass_ellipsoid import MASS

# Pictures, numbers and plots a second, at most.
PICTURES_HZ, NUMBERS_HZ, PLOTS_HZ = 30.0, 10.0, 4.0
# How often a drag is told again, s.
REPEAT_S = 0.05
FIELD_OF_VIEW = float(np.deg2rad(45.0))
# Layers that are not seen at first.
HIDDEN = frozenset({"axes"})
# So many closures are seen without being asked for.
_FEW = 4
_LINE_WIDTH = 2.0
_STROKES = ("#7a4fd0", "#1a7f86", "#d9534f", "#2f6fd0", "#c79a2a", "#5a5a5a")


class LivePage:
    """A page on a live session, or on a running graph of nodes.

    Args:
        backend: what is shown and moved.
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
        self._backend, self._first, self._given = backend, first, tuple(given)
        self._asked = Open(first)
        with redirect_stdout(io.StringIO()):  # whoever serves it says where it is
            self._server = server = viser.ViserServer(host=host, port=port, verbose=False)
        # Clients without the button could ask for a tunnel to a server elsewhere as well.
        server.request_share_url = _no_share
        server.gui.configure_theme(show_share_button=False, show_logo=False)
        server.gui.main_panel.dock_right()
        server.scene.configure_environment_map(hdri=None)
        # Fewer lights than by default: where no GPU draws, each takes time at every pixel.
        server.scene.configure_default_lights(enabled=False)
        server.scene.add_light_ambient("/ambient", intensity=0.9)
        server.scene.add_light_directional("/light", position=(0.5, 0.4, 1.0), intensity=2.5)
        server.initial_camera.fov = FIELD_OF_VIEW
        self._mouse = Mouse(backend.send)
        self._drawing: Drawing | None = None
        self._newest: LiveState | None = None
        self._shown: Drawn | None = None
        self._has_view = False
        self._number, self._name = 0, ""
        self._history = History()
        self._nodes: dict[NodeKey, Any] = {}
        self._lines: Any = None
        self._hulls: dict[int, Any] = {}
        self._of_scene: list[Any] = []
        self._closures: dict[str, Any] = {}
        # Boxes that show what is told of a state.
        self._told: list[tuple[Any, Callable[[LiveState], bool]]] = []
        self._hidden = HIDDEN
        self._said = ""
        self._drawn = dict.fromkeys(("picture", "numbers", "plots"), 0.0)
        self._with_viser(lambda: self._make_controls(scenes))

        async def gone(client: Any) -> None:
            self._mouse.let_go(client.client_id)

        async def repeat() -> None:
            while True:
                self._mouse.repeat()
                await asyncio.sleep(REPEAT_S)

        server.on_client_disconnect(gone)
        # There, as that loop is what notices that a tab is closed: if it hangs, the drag ends.
        self._repeating = asyncio.run_coroutine_threadsafe(repeat(), server.get_event_loop())

    @property
    def address(self) -> str:
        """Where the page is."""
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
            HapticMechError: what is shown has ended.
        """
        while not ended():
            for report in self._backend.news(REPEAT_S):
                if isinstance(report, Opened):
                    drawing = Drawing(LivePicture(report))
                    self._with_viser(partial(self._open, report, drawing))
                elif isinstance(report, Failed):
                    self._said = report.reason
                elif report.number == self._number:
                    self._newest = report
            state, current = self._newest, self._drawing
            if state is None or current is None:
                continue
            self._history.add(state)
            if not self._has_view:
                self._with_viser(partial(self._look_at_scene, current.picture, state))
            if self.looked_at and self._due("picture", PICTURES_HZ):
                self._with_viser(partial(self._show, current.drawn(state, self._hidden)))

    def close(self) -> None:
        """Serve it no more."""
        self._repeating.cancel()
        self._mouse.let_go()
        self._server.stop()

    def _due(self, what: str, rate: float) -> bool:
        now = time.monotonic()
        if now - self._drawn[what] < 1.0 / rate:
            return False
        self._drawn[what] = now
        return True

    # What is seen.

    def _with_viser(self, work: Callable[[], None]) -> None:
        """Do it in viser's event loop, and wait until it is done."""

        async def done() -> None:
            work()

        asyncio.run_coroutine_threadsafe(done(), self._server.get_event_loop()).result()

    def _open(self, opened: Opened, drawing: Drawing) -> None:
        """Draw another scene, or the same held elsewhere."""
        self._mouse.let_go()
        self._said = ""
        new = self._drawing is None or opened.asked != self._asked
        self._asked, self._number, self._name = opened.asked, opened.number, opened.scene.name
        picture = drawing.picture
        self._drawing, self._shown, self._newest = drawing, None, None
        self._history.begin(picture.directions)
        for node in (*self._nodes.values(), *self._hulls.values(), self._lines):
            if node is not None:
                node.remove()
        self._nodes, self._lines, self._hulls = {}, None, {}
        if new:
            self._has_view = False
            self._make_scene_controls(opened, picture.closures)

    def _show(self, new: Drawn) -> None:
        """Show a picture, and from time to time its numbers and plots."""
        picture = new.picture
        old, self._shown = self._shown, new
        with self._server.atomic():
            for key, arrays in new.instances.items():
                self._show_instances(key, arrays, None if old is None else old.instances.get(key))
            self._show_lines(*new.lines)
            for number, pose in new.frame.hulls.items():
                node = self._hulls.get(number) or self._made_hull(picture, number)
                turned = np.roll(quaternion_of(pose.rotation), 1)
                node.position, node.wxyz = pose.translation, turned
            for number, node in self._hulls.items():
                node.visible = number in new.frame.hulls
        if self._due("numbers", NUMBERS_HZ):
            self._tell(new.state, new.frame)
        if self._with_plots.value and self._due("plots", PLOTS_HZ):
            for plot, columns in self._plots:
                plot.data = columns()

    def _show_lines(self, ends: Array, colours: Array) -> None:
        if self._lines is not None and len(ends) == len(self._lines.points):
            self._lines.points, self._lines.colors = ends, colours
            return
        if self._lines is not None:
            self._lines.remove()
        self._lines = self._server.scene.add_line_segments(
            "/lines", ends, colours, thickness=_LINE_WIDTH, thickness_units="screen"
        )

    def _show_instances(
        self, key: NodeKey, new: InstanceArrays, old: InstanceArrays | None
    ) -> None:
        node = self._nodes.get(key)
        if node is None or old is None or len(old.shapes) != len(new.shapes):
            if node is not None:
                node.remove()
            self._nodes[key] = self._made_instances(key, new)
            return
        for name, before, now in (
            ("batched_positions", old.positions, new.positions),
            ("batched_wxyzs", old.quaternions, new.quaternions),
            ("batched_scales", old.scales, new.scales),
            ("batched_colors", old.colours, new.colours),
            ("batched_opacities", old.opacities, new.opacities),
        ):
            if not np.array_equal(before, now):
                setattr(node, name, now)

    def _made_instances(self, key: NodeKey, arrays: InstanceArrays) -> Any:
        body, grabbed = key
        corners, triangles = unit_body(body)
        node = self._server.scene.add_batched_meshes_simple(
            f"/{'grabbed' if grabbed else 'seen'}/{body}",
            corners,
            triangles,
            arrays.quaternions,
            arrays.positions,
            batched_scales=arrays.scales,
            batched_colors=arrays.colours,
            batched_opacities=arrays.opacities,
            # The ellipsoid covers much of the picture: a material that is quickly computed.
            material="toon3" if body == "sphere" and not grabbed else "standard",
            lod="off",
            flat_shading=body == "box",
            cast_shadow=False,
            receive_shadow=False,
        )
        if grabbed:

            async def dragged(event: Any) -> None:
                shown, at = self._shown, event.instance_index
                self._dragged(event, None if shown is None else shown.link_at(body, at))

            node.on_drag("left")(dragged)
        return node

    def _made_hull(self, picture: LivePicture, number: int) -> Any:
        hull = picture.hulls[number]
        node = self._server.scene.add_mesh_simple(
            f"/hulls/{number}",
            hull.vertices,
            hull.triangles,
            color=tuple(round(255 * part) for part in hull.colour[:3]),
            opacity=hull.colour[3],
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
        )

        async def dragged(event: Any) -> None:
            self._dragged(event, picture.link_of_hull(number))

        node.on_drag("left")(dragged)
        self._hulls[number] = node
        return node

    def _look_at_scene(self, picture: LivePicture, state: LiveState) -> None:
        """Let everybody look at a new scene from where it is seen well."""
        # Before anybody looks, if possible: a browser that is starting takes up only a part of it.
        self._has_view = True
        eye, centre, up = first_view(picture.draw(state, self._hidden).shapes, picture.planar)
        self._server.scene.set_up_direction("+y" if picture.planar else "+z")
        for camera in (
            self._server.initial_camera,
            *(client.camera for client in self._server.get_clients().values()),
        ):
            name = "up" if camera is self._server.initial_camera else "up_direction"
            setattr(camera, name, up)
            camera.position, camera.look_at = eye, centre

    def _dragged(self, event: Any, link: str | None) -> None:
        """By mouse: drag a link, the hand if its name is empty, or nothing if there is none."""
        if event.phase == "end":
            self._mouse.let_go(event.client_id)
            return
        eye, seen = np.array(event.client.camera.position), np.array(event.end_position)
        if event.phase == "update":
            self._mouse.move(event.client_id, eye, seen)
            return
        shown = self._shown
        if shown is None:
            return
        device, start = shown.state.device[:, 3], np.array(event.start_position)
        if shown.picture.is_hand(device, eye, start):
            link = ""
        if link is None:
            return
        held, grip = (start, shown.frame.in_link(link, start)) if link else (device, np.zeros(3))
        self._mouse.grab(event.client_id, link, grip, held, eye, start, shown.picture.planar)
        self._mouse.move(event.client_id, eye, seen)

    # Numbers and controls.

    def _tell(self, state: LiveState, frame: LiveFrame) -> None:
        self._numbers.content = numbers_html(
            state, self._name, frame.analysis.spectrum.s, frame.masses, self._said
        )
        shown = [(box, of(state)) for box, of in self._told]
        shown += zip(self._closures.values(), state.active, strict=True)
        for box, wanted in shown:
            if box.value != wanted:
                box.value = wanted

    def _when(self, handle: Any, command: Callable[[Any], Command | None]) -> None:
        """Send a command when somebody changes a control; changes by the program send none."""

        async def changed(event: Any) -> None:
            if event.client is not None:
                wanted = command(event.target.value)
                if wanted is not None:
                    self._said = ""
                    self._backend.send(wanted)

        handle.on_update(changed)

    def _pressed(self, button: Any, command: Callable[[], Command]) -> None:
        async def pressed(_event: Any) -> None:
            self._said = ""
            self._backend.send(command())

        button.on_click(pressed)

    def _make_controls(self, scenes: Sequence[str]) -> None:
        gui, takes = self._server.gui, self._backend.takes
        gui.add_html(QUICK_TIMERS)
        self._numbers = gui.add_html("")
        if Open in takes:
            self._make_scene_picker(scenes)
        if Pause in takes:
            paused = gui.add_checkbox("pause", initial_value=False)
            self._told.append((paused, lambda state: state.paused))
            self._when(paused, Pause)
            self._pressed(gui.add_button("one tick"), Step)
            self._pressed(gui.add_button("reset"), Reset)
        spring = gui.add_slider("stiffness of the mouse", SOFTEST, STIFFEST, 0.1, 1.0)
        self._when(spring, DragStiffness)
        if Open in takes:
            with gui.add_folder("begin with", expand_by_default=False):
                self._hand = gui.add_dropdown("held by", list(HANDS), initial_value=MOUSE_ALONE)
                self._delay = gui.add_slider("delay, ms", 0.0, LONGEST_DELAY_MS, 1.0, 0.0)
                self._pressed(gui.add_button("begin anew"), self._begun_anew)
        with gui.add_folder("show", expand_by_default=False):
            boxes = {
                name: gui.add_checkbox(name, initial_value=name not in HIDDEN) for name in LAYERS
            }
            self._with_plots = gui.add_checkbox("plots", initial_value=True)

        async def layered(_event: Any) -> None:
            self._hidden = frozenset(name for name, box in boxes.items() if not box.value)

        for box in boxes.values():
            box.on_update(layered)
        with gui.add_folder("keep", expand_by_default=False):
            if Record in takes:
                recording = gui.add_checkbox("record a bag", initial_value=False)
                self._told.append((recording, lambda state: bool(state.recording)))
                self._when(recording, self._recorded)
            gui.add_button("save a picture").on_click(self._save_picture)
        self._plots: list[tuple[Any, Callable[[], tuple[Array, ...]]]] = []

    def _make_scene_picker(self, scenes: Sequence[str]) -> None:
        names = list(dict.fromkeys((self._first, *scenes)))
        self._scene = self._server.gui.add_dropdown("scene", names, initial_value=self._first)
        # A client could send any name, and so have any file read.
        self._when(
            self._scene, lambda name: Open(name, self._changes(name)) if name in names else None
        )

    def _make_scene_controls(self, opened: Opened, closures: Sequence[str]) -> None:
        """Make the controls that are of a scene anew."""
        for control in self._of_scene:
            control.remove()
        gui, scene = self._server.gui, opened.scene
        points = [point.name for point in scene.operational_points]
        frames = [*points, *(link.name for link in scene.links if link.name not in points)]
        held = gui.add_dropdown("point held", frames, initial_value=opened.point)
        self._when(held, Hold)
        self._of_scene = [held]
        self._closures = {}
        if closures:
            folder = gui.add_folder("closures", expand_by_default=len(closures) < _FEW)
            self._of_scene.append(folder)
            with folder:
                for name in closures:
                    box = gui.add_checkbox(name, initial_value=True)
                    self._when(box, partial(SwitchClosure, name))
                    self._closures[name] = box
        gains = gui.add_folder("gains", expand_by_default=False)
        with gains:
            for one in gain_sliders(scene):
                slider = gui.add_slider(one.label, 0.0, one.highest, one.step, one.value)
                self._when(slider, partial(Tune, one.key))
        plots = gui.add_folder("plots", expand_by_default=False)
        with plots:
            self._make_plots()
        self._of_scene += [gains, plots]

    def _make_plots(self) -> None:
        self._plots = []
        for title, names, columns in self._history.plots():
            plot = self._server.gui.add_uplot(
                columns(),
                (
                    viser.uplot.Series(label="s"),
                    *(
                        viser.uplot.Series(label=name, stroke=_STROKES[i % len(_STROKES)], width=2)
                        for i, name in enumerate(names)
                    ),
                ),
                title=title,
                scales={"x": viser.uplot.Scale(time=False, auto=True)},
                aspect=2.2,
            )
            self._plots.append((plot, columns))

    def _begun_anew(self) -> Open:
        return Open(self._scene.value, self._changes(self._scene.value))

    def _changes(self, scene: str) -> tuple[str, ...]:
        """Return the changes of a scene; those that were given at the start are of its alone."""
        given = self._given if scene == self._first else ()
        return (*changes_of(self._hand.value, self._delay.value), *given)

    def _recorded(self, wanted: bool) -> Record:
        name = f"live_{time.strftime('%Y%m%d_%H%M%S')}" if wanted else ""
        return Record(name)

    def _save_picture(self, event: Any) -> None:
        """Send a client the present picture as a PNG file."""
        shown, name = self._shown, f"{self._name}.png"
        if event.client is None or shown is None:
            return
        with TemporaryDirectory() as folder:
            path = Path(folder) / name
            shapes = [one for one in shown.frame.shapes if one.namespace != MASS]
            title = f"{self._name}, {shown.state.time:.2f} s"
            draw_shapes(shapes, path, shown.picture.planar, title)
            content = path.read_bytes()
        self._with_viser(partial(event.client.send_file_download, name, content))


def _no_share(verbose: bool = True) -> None:
    """Share the page with nobody."""
