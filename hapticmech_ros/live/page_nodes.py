# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A picture on the page: viser's nodes, changed from picture to picture where it has changed.

To be called in viser's event loop.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import viser

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import Draggable
from hapticmech_ros.live.drawing import Drawn, NodeKey
from hapticmech_ros.live.instances import InstanceArrays, unit_body
from hapticmech_ros.live.live_picture import LivePicture
from hapticmech_ros.live.numbers import browser
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
