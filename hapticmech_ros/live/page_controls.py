# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controls of the page, and its numbers and plots. To be called in viser's event loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import chain, repeat
from typing import Any

import numpy as np
import viser
import viser.uplot

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import (
    Backend,
    Command,
    Draggable,
    DragStiffness,
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
from hapticmech_ros.live.drawing import Drawn, NodeKey
from hapticmech_ros.live.grip import SOFTEST, STIFFEST
from hapticmech_ros.live.history import History
from hapticmech_ros.live.instances import InstanceArrays, unit_body
from hapticmech_ros.live.live_picture import LAYERS, LivePicture
from hapticmech_ros.live.numbers import QUICK_TIMERS, browser, numbers_html
from hapticmech_ros.live.settings import (
    HANDS,
    LONGEST_DELAY_MS,
    MOUSE_ALONE,
    changes_of,
    gain_sliders,
)
from hapticmech_ros.loading import load_scene
from hapticmech_ros.quaternions import quaternion_of

_LINE_WIDTH = 2.0


class SceneNodes:
    """What is seen of a scene.

    Args:
        server: of the page.
        on_drag: told viser's event where something is dragged, and the link that it is of, if any.
    """

    def __init__(
        self, server: viser.ViserServer, on_drag: Callable[[Any, str | None], None]
    ) -> None:
        self._server, self._on_drag = server, on_drag
        self._shown: Drawn | None = None
        self._nodes: dict[NodeKey, Any] = {}
        self._lines: Any = None
        self._hulls: dict[int, Any] = {}
        self._labels: dict[str, Any] = {}

    def clear(self) -> None:
        """Show nothing."""
        kinds: tuple[dict[Any, Any], ...] = (self._nodes, self._hulls, self._labels)
        for node in (*(one for kind in kinds for one in kind.values()), self._lines):
            if node is not None:
                node.remove()
        for kind in kinds:
            kind.clear()
        self._shown = self._lines = None

    def show(self, new: Drawn, holders: Mapping[Draggable, int]) -> None:
        """Show a picture.

        Args:
            new: the picture.
            holders: which client drags a body.
        """
        picture, old, self._shown = new.picture, self._shown, new
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
            self._show_labels(new, holders)

    def _show_labels(self, new: Drawn, holders: Mapping[Draggable, int]) -> None:
        """Say of several users whose hand is where, and which browser drags it."""
        for user in new.state.users if new.picture.hues else ():
            holder = holders.get(Draggable("hand", user.point))
            text = user.point if holder is None else f"{user.point}: {browser(holder)}"
            place = user.device[:, 3]
            label = self._labels.get(user.point)
            if label is None:
                label = self._server.scene.add_label(
                    f"/users/{user.point}", text, position=place, anchor="bottom-center"
                )
                self._labels[user.point] = label
            if label.text != text:
                label.text = text
            label.position = place

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
                self._on_drag(event, None if shown is None else shown.link_at(body, at))

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
            self._on_drag(event, picture.link_of_hull(number))

        node.on_drag("left")(dragged)
        self._hulls[number] = node
        return node


# Layers that are not seen at first.
HIDDEN = frozenset({"axes"})
# So many closures are seen without being asked for.
_FEW = 4
_STROKES = ("#7a4fd0", "#1a7f86", "#d9534f", "#2f6fd0", "#c79a2a", "#5a5a5a")


class Controls:
    """What people set on the page, and are told there.

    Args:
        server: of the page.
        backend: what is shown and moved.
        first: scene with which it begins.
        given: changes of that scene, ``key=value`` each.
        scenes: that can be chosen.
        history: what is plotted.
        save: sends who asked, by viser's event, the present picture.

    Attributes:
        hidden: layers that are not drawn.
        said: why what somebody asked for was not done; empty for nothing.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        backend: Backend,
        first: str,
        given: Sequence[str],
        scenes: Sequence[str],
        history: History,
        save: Callable[[Any], None],
    ) -> None:
        self._gui, self._backend, self._history = server.gui, backend, history
        self._first, self._given = first, tuple(given)
        self.hidden, self.said = HIDDEN, ""
        self._of_scene: list[Any] = []
        self._closures: dict[str, Any] = {}
        self._hands: list[Any] = []
        # Boxes that show what is told of a state.
        self._told: list[tuple[Any, Callable[[LiveState], bool]]] = []
        self._plots: list[tuple[Any, Callable[[], tuple[Array, ...]]]] = []
        self._make(scenes, save)

    def tell(self, new: Drawn, scene: str, holders: Mapping[Draggable, int]) -> None:
        """Tell the numbers of a picture.

        Args:
            new: the picture.
            scene: name of its scene.
            holders: which client drags a body.
        """
        state = new.state
        self._numbers.content = numbers_html(
            state, new.frame, scene, new.picture.hues, holders, self.said
        )
        shown = [(box, of(state)) for box, of in self._told]
        if self._closures:
            shown += zip(self._closures.values(), state.active, strict=True)
        for box, wanted in shown:
            if box.value != wanted:
                box.value = wanted

    @property
    def wants_plots(self) -> bool:
        """Whether plots are to be drawn."""
        return bool(self._with_plots.value)

    def plot(self) -> None:
        """Draw the plots anew."""
        for plot, columns in self._plots:
            plot.data = columns()

    def open(self, opened: Opened, closures: Sequence[str]) -> None:
        """Make the controls that are of a scene anew.

        Args:
            opened: the scene.
            closures: names of its loops, as a state has them.
        """
        for control in self._of_scene:
            control.remove()
        gui, scene = self._gui, opened.scene
        prefixes = {user: f"{user} " if len(opened.users) > 1 else "" for user in opened.users}
        points = [point.name for point in scene.operational_points]
        frames = [*points, *(link.name for link in scene.links if link.name not in points)]
        self._of_scene = []
        for user, prefix in prefixes.items():
            held = gui.add_dropdown(f"{prefix}point held", frames, initial_value=user)
            self._when(held, partial(Hold, user))
            self._of_scene.append(held)
        if Open in self._backend.takes:
            with self._begin_with:
                self._of_scene += self._make_hands(prefixes.values())
        self._closures = {}
        if closures and SwitchClosure in self._backend.takes:
            folder = gui.add_folder("closures", expand_by_default=len(closures) < _FEW)
            self._of_scene.append(folder)
            with folder:
                for name in closures:
                    box = gui.add_checkbox(name, initial_value=True)
                    self._when(box, partial(SwitchClosure, name))
                    self._closures[name] = box
        gains = gui.add_folder("gains", expand_by_default=False)
        with gains:
            for user, prefix in prefixes.items():
                for one in gain_sliders(scene.held_at(user)):
                    label = f"{prefix}{one.label}"
                    slider = gui.add_slider(label, 0.0, one.highest, one.step, one.value)
                    self._when(slider, partial(Tune, user, one.key))
        plots = gui.add_folder("plots", expand_by_default=False)
        with plots:
            self._make_plots()
        self._of_scene += [gains, plots]

    def _when(self, handle: Any, command: Callable[[Any], Command | None]) -> None:
        """Send a command when somebody changes a control; changes by the program send none."""

        async def changed(event: Any) -> None:
            if event.client is not None:
                self.said = ""
                wanted = command(event.target.value)
                if wanted is not None:
                    self._backend.send(wanted)

        handle.on_update(changed)

    def _pressed(self, button: Any, command: Callable[[], Command | None]) -> None:
        async def pressed(_event: Any) -> None:
            self.said = ""
            wanted = command()
            if wanted is not None:
                self._backend.send(wanted)

        button.on_click(pressed)

    def _make(self, scenes: Sequence[str], save: Callable[[Any], None]) -> None:
        gui, takes = self._gui, self._backend.takes
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
        if DragStiffness in takes:
            spring = gui.add_slider("stiffness of the mouse", SOFTEST, STIFFEST, 0.1, 1.0)
            self._when(spring, DragStiffness)
        if Open in takes:
            self._begin_with = gui.add_folder("begin with", expand_by_default=False)
            with self._begin_with:
                self._delay = gui.add_slider("delay, ms", 0.0, LONGEST_DELAY_MS, 1.0, 0.0)
                self._pressed(gui.add_button("begin anew"), self._begun_anew)
        with gui.add_folder("show", expand_by_default=False):
            boxes = {
                name: gui.add_checkbox(name, initial_value=name not in HIDDEN) for name in LAYERS
            }
            self._with_plots = gui.add_checkbox("plots", initial_value=True)

        async def layered(_event: Any) -> None:
            self.hidden = frozenset(name for name, box in boxes.items() if not box.value)

        for box in boxes.values():
            box.on_update(layered)
        with gui.add_folder("keep", expand_by_default=False):
            if Record in takes:
                recording = gui.add_checkbox("record a bag", initial_value=False)
                self._told.append((recording, lambda state: bool(state.recording)))
                self._when(recording, self._recorded)
            gui.add_button("save a picture").on_click(save)

    def _make_scene_picker(self, scenes: Sequence[str]) -> None:
        names = list(dict.fromkeys((self._first, *scenes)))
        self._scene = self._gui.add_dropdown("scene", names, initial_value=self._first)
        # A client could send any name, and so have any file read.
        self._when(self._scene, lambda name: self._opening(name) if name in names else None)

    def _make_plots(self) -> None:
        self._plots = []
        for title, names, columns in self._history.plots():
            plot = self._gui.add_uplot(
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

    def _make_hands(self, prefixes: Iterable[str]) -> list[Any]:
        """Make what chooses who holds each device at the next beginning."""
        chosen = [box.value for box in self._hands]
        self._hands = [
            self._gui.add_dropdown(f"{prefix}held by", list(HANDS), initial_value=one, order=0.0)
            for prefix, one in zip(prefixes, chain(chosen, repeat(MOUSE_ALONE)))  # noqa: B905
        ]
        return self._hands

    def _begun_anew(self) -> Open | None:
        return self._opening(self._scene.value)

    def _opening(self, name: str) -> Open | None:
        """Return what begins a scene as it is chosen; None, and say why, if it is refused."""
        try:
            scene = load_scene(name)
        except HapticMechError as error:
            self.said = str(error)
            return None
        held_by = [box.value for box in self._hands] or [MOUSE_ALONE]
        # What was given at the start is of its scene alone.
        given = self._given if name == self._first else ()
        return Open(name, (*changes_of(scene, held_by, self._delay.value), *given))

    def _recorded(self, wanted: bool) -> Record:
        name = f"live_{time.strftime('%Y%m%d_%H%M%S')}" if wanted else ""
        return Record(name)
