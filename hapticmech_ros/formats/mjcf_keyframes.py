# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keyframes of an MJCF file: named states, in the coordinates that a scene has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import Joint, Keyframe, State
from hapticmech_ros.formats.xml_nodes import Node, Source

# Numbers of a joint in qpos and in qvel.
_POSITIONS = {"revolute": 1, "prismatic": 1, "spherical": 4, "free": 7}
_RATES = {"revolute": 1, "prismatic": 1, "spherical": 3, "free": 6}


def read_keyframes(
    source: Source, hinges: Sequence[Joint], start: Mapping[str, State]
) -> dict[str, Keyframe]:
    """Return the file's keyframes by name; those without one are called by their place, from 0.

    Args:
        source: the file.
        hinges: its joints, in its order.
        start: where joints are that a keyframe without ``qpos`` says nothing of; 0 if left out.

    Raises:
        SceneError: a name twice, or another number of numbers than the joints have.
    """
    found: dict[str, Keyframe] = {}
    nodes = [key for section in source.root.all("keyframe") for key in section.all("key")]
    moving = [hinge for hinge in hinges if hinge.type in _POSITIONS]
    for place, node in enumerate(nodes):
        name = node.attributes.get("name", "").strip() or str(place)
        if name in found:
            raise source.error(node, name, "names of keyframes must be unique")
        found[name] = _keyframe(source, node, moving, start)
    return found


def _keyframe(
    source: Source, node: Node, moving: Sequence[Joint], start: Mapping[str, State]
) -> Keyframe:
    q: dict[str, State] = dict(start)
    if "qpos" in node.attributes:
        for hinge, part in _parts(source, node, "qpos", moving, _POSITIONS):
            q[hinge.name] = _position(hinge.type, part)
    v: dict[str, State] = {}
    if "qvel" in node.attributes:
        for hinge, part in _parts(source, node, "qvel", moving, _RATES):
            v[hinge.name] = _rate(hinge.type, part, q.get(hinge.name))
    return Keyframe(q, v)


def _parts(
    source: Source, node: Node, key: str, moving: Sequence[Joint], sizes: Mapping[str, int]
) -> Iterator[tuple[Joint, tuple[float, ...]]]:
    """Yield joints with their numbers."""
    count = sum(sizes[hinge.type] for hinge in moving)
    numbers = source.numbers(node, node.attributes[key], count, key)
    at = 0
    for hinge in moving:
        yield hinge, numbers[at : at + sizes[hinge.type]]
        at += sizes[hinge.type]


def _position(kind: str, numbers: tuple[float, ...]) -> State:
    """Return a joint's position: quaternions end with w instead of beginning with it."""
    if kind in ("revolute", "prismatic"):
        return numbers[0]
    *place, w, x, y, z = numbers
    return [*place, *_unit(x, y, z, w)]


def _rate(kind: str, numbers: tuple[float, ...], position: State | None) -> State:
    """Return a joint's rates: a free one's velocity is in its own axes, not the world's."""
    if kind in ("revolute", "prismatic"):
        return numbers[0]
    if kind == "spherical" or not isinstance(position, Sequence):
        return list(numbers)
    rotation = pin.Quaternion(np.array(position[3:])).matrix()
    return [*(float(x) for x in rotation.T @ np.array(numbers[:3])), *numbers[3:]]


def _unit(*quaternion: float) -> list[float]:
    size = float(np.linalg.norm(quaternion))
    # As MuJoCo does with one that says nothing.
    return [x / size for x in quaternion] if size > 0.0 else [0.0, 0.0, 0.0, 1.0]
