# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A picture as a page sends it: instances by body and by whether they can be grabbed, and lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import Draggable, LiveState
from hapticmech_ros.live.instances import (
    Body,
    InstanceArrays,
    Instances,
    instance_parts,
    line_segments,
)
from hapticmech_ros.live.live_picture import LiveFrame, LivePicture

# What can be grabbed, by the first part of its namespace: arrows are in the way of nothing.
_GRABBED = frozenset({"links", "joints", "solids", "device", "point"})
# Body, and whether it can be grabbed.
NodeKey = tuple[Body, bool]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A picture of a state.

    Attributes:
        picture: that drew it.
        state: that it is of.
        frame: its shapes.
        instances: body, and whether it can be grabbed -> arrays.
        lines: (n, 2, 3) ends, m, and (n, 2, 3) colours, 0 to 255; at least one.
    """

    picture: LivePicture
    state: LiveState
    frame: LiveFrame
    instances: dict[NodeKey, InstanceArrays]
    lines: tuple[Array, Array]

    def link_at(self, body: Body, place: int | None) -> str | None:
        """Return the link of an instance; None for what is of no link, such as hands."""
        shapes = self.instances[body, True].shapes
        shape = shapes[place] if place is not None and place < len(shapes) else None
        return None if shape is None else self.picture.link_of(shape, self.frame)

    def body_at(self, eye: Array, place: Array, link: str | None) -> Draggable | None:
        """Return what somebody means to drag; None for nothing.

        Args:
            eye: (3,) from where it is seen, m, world axes.
            place: (3,) that is pointed at, likewise.
            link: that is there; None for what is of no link.
        """
        hand = self.picture.hand_at(self.state, eye, place)
        if hand is not None:
            return Draggable("hand", hand)
        return None if link is None else Draggable("link", link)

    def held(self, body: Draggable, place: Array) -> tuple[Array, Array]:
        """Return where (3,), m, world axes, a body is held that is taken at a place.

        Args:
            body: that is taken.
            place: (3,) m, world axes.

        Returns:
            That place, and the same (3,) in the frame of the link, m; of a hand it is the device's.
        """
        if body.kind == "hand":
            return self.state.user(body.name).device[:, 3], np.zeros(3)
        return place, self.frame.in_link(body.name, place)


class Drawing:
    """Draws states of a scene, so that what is drawn keeps its place from picture to picture.

    Args:
        picture: of the scene.

    Attributes:
        picture: this.
    """

    def __init__(self, picture: LivePicture) -> None:
        self.picture = picture
        self._instances: dict[NodeKey, Instances] = {}

    def drawn(self, state: LiveState, hidden: frozenset[str]) -> Drawn:
        """Return the picture of a state, without some layers."""
        frame, instances = self.picture.draw(state, hidden), {}
        for grabbed in (True, False):
            shapes = [s for s in frame.shapes if (s.meaning in _GRABBED) == grabbed]
            for body, parts in instance_parts(shapes).items():
                arrays = self._instances.setdefault((body, grabbed), Instances()).arranged(parts)
                if len(arrays.shapes):
                    instances[body, grabbed] = arrays
        ends, colours = line_segments(frame.shapes)
        if not len(ends):
            ends, colours = np.zeros((1, 2, 3)), np.zeros((1, 2, 3), dtype=np.uint8)
        return Drawn(self.picture, state, frame, instances, (ends, colours))
