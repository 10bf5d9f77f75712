# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A file's mechanism, in any format: bodies, joints, loop joints, and the rest.

A joint carries a body from another; a body that two joints carry closes a loop.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

Array = np.ndarray
Document = dict[str, Any]
WORLD = "world"

DRAWN = "for pictures only: nothing of it is felt"
DRIVEN = "joints have no motors here: your hand and the forces of the scene move them"
FOREIGN = "belongs to another simulator"
# Drake's tags for rotors, in URDF and SDFormat.
ROTOR, GEAR = "drake:rotor_inertia", "drake:gear_ratio"
ROTOR_ELSEWHERE = "rotor of no revolute or prismatic joint"
WHY_ELSEWHERE = "write armature at the joints that it moves"
# A loop of the file that the scene has not closed; its notes come first.
LEFT_OPEN = "loop left open"
SENSED = "only poses and wrenches are measured"
UNKNOWN = "not part of a mechanism, or unknown"
# Elements for pictures and sensors only; and motors, controllers, contacts.
_UNFELT = ("visual", "material", "geom", "camera", "light", "sensor")
_IDLE = (
    *("actuator", "transmission", "ros2_control", "safety_controller", "calibration", "flag"),
    *("effort limit", "velocity limit", "plugin", "gazebo", "include of a world", "collision"),
)


@dataclass(frozen=True, slots=True)
class Note:
    """Something in a file that the scene lacks or represents differently.

    Attributes:
        what: element or attribute.
        count: how many of them.
        why: the effect, or where to write it instead.
    """

    what: str
    count: int
    why: str

    @property
    def felt(self) -> bool:
        """Whether it may change what is felt."""
        return self.what not in _UNFELT

    @property
    def rank(self) -> int:
        """Its place in lists: loops left open (0), others that may change the mechanism (1), ...

        Then drives and contacts (2), and pictures and sensors (3).
        """
        if self.what.startswith(LEFT_OPEN):
            return 0
        return 3 if not self.felt else 2 if self.what.partition(":")[0] in _IDLE else 1

    def __str__(self) -> str:
        return f"{self.what} ({self.count} x): {self.why}"


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body.

    Attributes:
        name: as in the file.
        mass: kg.
        com: (3,) centre of mass in the body's frame, m.
        inertia: (3, 3) about the centre of mass, axes of the body's frame, kg m².
        gravcomp: fraction of its weight that is carried; 1 of a body without gravity.
    """

    name: str
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    gravcomp: float = 0.0


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint.

    Attributes:
        name: as in the file.
        type: of a scene's joints.
        parent, child: bodies, or ``world``.
        in_parent: joint's frame in the parent's.
        of_child: the child's frame in the joint's, at position 0.
        axis: (3,) unit vector in the joint's frame.
        damping: N m s/rad or N s/m.
        friction: Coulomb, N m or N.
        stiffness: N m/rad or N/m.
        rest: rad or m, where that is slack.
        armature: inertia of its rotor as the joint feels it, kg m² or kg.
        limits: lower and upper, rad or m, or None.
    """

    name: str
    type: str
    parent: str
    child: str
    in_parent: pin.SE3
    of_child: pin.SE3 = field(default_factory=pin.SE3.Identity)
    axis: Array = field(default_factory=lambda: np.array((0.0, 0.0, 1.0)))
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    armature: float = 0.0
    limits: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class LoopJoint:
    """A closure: kind of a scene, its frames in two bodies, and whether it holds from the start.

    A rod has a length, m.
    """

    name: str
    kind: str
    a: tuple[str, pin.SE3]
    b: tuple[str, pin.SE3]
    active: bool = True
    length: float | None = None


@dataclass(frozen=True, slots=True)
class Coupling:
    """θ_joint = ratio θ_leader + offset; or a polynomial of θ_leader, the constant first."""

    name: str
    joint: str
    leader: str
    ratio: float
    offset: float
    polycoef: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Point:
    """A frame that the file names, fixed in a body: where people may take hold."""

    name: str
    body: str
    origin: pin.SE3


Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Solid:
    """A shape of the file for collisions or to be drawn; its errors are raised once it is needed.

    Attributes:
        name: as in the file; empty if it has none.
        body: that it is fixed in, or ``world``.
        kind: of a scene's geometries; else the file's own kind.
        what: element, for notes.
        read: returns its frame in the body, and its geometry as in a scene.
        colour: red, green, blue and opacity, 0 to 1, if the file has one.
    """

    name: str
    body: str
    kind: str
    what: str
    read: Callable[[], tuple[pin.SE3, Document]]
    colour: Rgba | None = None


# Of one joint, as in a scene's ``initial_state``.
State = float | Sequence[float]


class Keyframe(NamedTuple):
    """A named state: positions and rates of joints by the file's names; others are 0."""

    q: Mapping[str, State]
    v: Mapping[str, State]


@dataclass(frozen=True, slots=True)
class Model:
    """A file's mechanism, loops included.

    Attributes:
        name: of the model.
        bodies: by name; ``world`` is not among them.
        hinges: joints; those that close loops are among them.
        loop_joints, couplings, points, solids: see their classes.
        visuals: shapes that are drawn.
        gravity: (3,) m/s² if the file has one.
        bases: poses in the world of bodies that no joint carries; the origin if left out.
        notes: of parts that the scene does not have.
        start: positions of joints, as in a scene's ``initial_state``, where these are not zero.
        floating: why a body floats, for messages.
        keyframes: by name.
        where: "link" or "joint", and name -> line and element.
        locks: joints whose stops leave no travel, though the file has no such stops -> what it has.
    """

    name: str
    bodies: Mapping[str, Body]
    hinges: Sequence[Joint]
    loop_joints: Sequence[LoopJoint] = ()
    couplings: Sequence[Coupling] = ()
    points: Sequence[Point] = ()
    solids: Sequence[Solid] = ()
    gravity: tuple[float, float, float] | None = None
    bases: Mapping[str, pin.SE3] = field(default_factory=dict)
    notes: Sequence[Note] = ()
    start: Mapping[str, State] = field(default_factory=dict)
    floating: str = "with base: free it floats"
    keyframes: Mapping[str, Keyframe] = field(default_factory=dict)
    where: Mapping[tuple[str, str], str] = field(default_factory=dict)
    visuals: Sequence[Solid] = ()
    locks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Imported:
    """A model as parts of a scene's document.

    Attributes:
        document: ``name``, ``links``, ``closures`` and other keys from the file.
        places: name in the file -> link of the scene, or ``world``, and the frame in it.
        joints: name in the file -> name in the scene.
        shapes: by name in the scene, those for collisions; a scene has those that contacts name.
        tips: links at the ends of the tree, the one furthest from the world first.
        notes: of parts that the scene does not have, except shapes.
        keyframes: by name, with the scene's names of joints.
        where: link or joint of the scene -> line and element of the file.
        visuals: shapes that are drawn.
        absent: joints of the file that the scene has not, by name, and why.
    """

    document: Document
    places: Mapping[str, tuple[str, pin.SE3]]
    joints: Mapping[str, str]
    shapes: Mapping[str, Solid]
    tips: Sequence[str]
    notes: Sequence[Note]
    keyframes: Mapping[str, Keyframe]
    where: Mapping[str, str]
    visuals: Sequence[Solid]
    absent: Mapping[str, str]


def from_z(axis: Array) -> pin.SE3:
    """Return the rotation that turns z to an axis.

    Args:
        axis: The axis, (3,).
    """
    turn = pin.SE3.Identity()
    turn.rotation = pin.Quaternion.FromTwoVectors(np.array((0.0, 0.0, 1.0)), axis).matrix()
    return turn


def origin_of(place: pin.SE3) -> Document:
    """Return a transform as a scene's origin."""
    rpy = pin.rpy.matrixToRpy(place.rotation)
    return {"xyz": [float(x) for x in place.translation], "rpy": [float(x) for x in rpy]}


class Names:
    """Names that are taken."""

    def __init__(self) -> None:
        self._taken = {WORLD}
        self._tried: Counter[str] = Counter()

    def new(self, name: str) -> str:
        """Return the name, or the nearest that is allowed and not taken."""
        cleaned = found = clean(name)
        while found in self._taken:
            self._tried[cleaned] += 1
            found = f"{cleaned}_{self._tried[cleaned] + 1}"
        self._taken.add(found)
        return found


def clean(name: str) -> str:
    """Return a name of letters, digits and underscores that begins with a letter."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return found if re.match(r"[A-Za-z]", found) else f"n{found}"
