# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What MJCF says once for many elements: settings, classes of defaults, ways to say rotations.

Inertias of meshes and shells, which have several rules, are those that MuJoCo's own compiler gives.
MuJoCo, if it is installed, reads the file in a child process with limits, as others' files are not
trusted. What is read here in the XML itself does not need it, has line numbers in its errors, and
is the same without it: the compiler is asked for bodies only whose geoms have no simple shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.cage import CageError, Limits, caged
from hapticmech_ros.formats.model import Body
from hapticmech_ros.formats.xml_nodes import Node, Source

# Of the compiler: its library takes 0.2 GB, large meshes as much again.
LIMITS = Limits(memory=1_500_000_000, seconds=60, output=16_000_000)
INSTALL = "pip install 'hapticmech_ros[mjcf]'"


class NotCompiledError(Exception):
    """MuJoCo is not installed, or refuses the file; the text says which."""


def compiled_bodies(path: Path) -> dict[str, Body]:
    """Return the file's bodies by name, with their inertia as MuJoCo computes it.

    Args:
        path: of the MJCF file.

    Raises:
        NotCompiledError: there is no MuJoCo, or it refuses the file.
    """
    if find_spec("mujoco") is None:
        raise NotCompiledError(f"MuJoCo computes it, which is not installed: {INSTALL}")
    try:
        (found,) = caged(bodies_of, [str(path.resolve())], LIMITS)
    except CageError as error:
        raise NotCompiledError(f"MuJoCo computes it, for which the file {error.rule}") from None
    return {
        name: Body(name, mass, np.array(com), np.array(inertia).reshape(3, 3))
        for name, mass, com, inertia in found
    }


def bodies_of(path: str) -> list[Any]:
    """Return name, mass (kg), centre (m, body axes) and inertia about it (kg m²) of all bodies.

    In a child process, where MuJoCo is.

    Args:
        path: of the MJCF file.
    """
    import mujoco

    # It would write them into a file in the folder where a user happens to be.
    mujoco.set_mju_user_warning(lambda _: None)
    model = mujoco.MjModel.from_xml_path(path)
    bodies = []
    for index in range(1, model.nbody):
        # Bodies without a name are called by their number by our reader, too.
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, index) or f"body{index}"
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[index])
        axes = turn.reshape(3, 3)
        inertia = (axes * model.body_inertia[index]) @ axes.T
        mass, com = float(model.body_mass[index]), model.body_ipos[index].tolist()
        bodies.append((name, mass, com, inertia.ravel().tolist()))
    return bodies


MAIN = "main"
CLASS_LIMIT = 1000
TURNS = ("axisangle", "xyaxes", "zaxis", "euler")
UP = np.array((0.0, 0.0, 1.0))
Classes = Mapping[str, Mapping[str, Mapping[str, str]]]
ACTUATOR = "actuator"
# Kinds of actuators, for which a class has the same defaults, whichever kind it names.
ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "orientation", "pid", "damper"),
    *("cylinder", "muscle", "dcmotor", "adhesion", "plugin"),
)


def settings(root: Node, tag: str) -> Node:
    """Return all elements of a kind as one; what is written later counts."""
    found = root.all(tag)
    attributes = {key: value for node in found for key, value in node.attributes.items()}
    children = [child for node in found for child in node.children]
    first = found[0] if found else root
    return Node(tag, attributes, first.line, children, file=first.file)


def _kind(node: Node) -> str:
    """Return what an element's defaults are kept under."""
    return ACTUATOR if node.tag in ACTUATORS else node.tag


@dataclass
class Context:
    """A file with its settings: what attributes an element has, and where it is.

    Attributes:
        source: the file.
        compiler: its settings.
        classes: class of defaults -> tag -> attributes.
        main: name of the class that holds where no other is named.
    """

    source: Source
    compiler: Node = field(init=False)
    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=dict)
    main: str = MAIN
    _compiled: dict[str, Body] | None = None

    def __post_init__(self) -> None:
        self.compiler = settings(self.source.root, "compiler")
        self._unit = 1.0 if self.word(self.compiler, "angle", "degree") == "radian" else np.pi / 180
        for node in self.source.root.all("default"):
            self.main = node.attributes.get("class", self.main)
        self.classes[self.main] = {}
        for node in self.source.root.all("default"):
            self._collect(node, self.main)

    def _collect(self, node: Node, name: str) -> None:
        """Read a class: its own elements first, then the classes in it, which begin as it is."""
        own = self.classes[name]
        for part in node.children:
            if part.tag != "default":
                own[_kind(part)] = own.get(_kind(part), {}) | part.attributes
        for inner in node.all("default"):
            called = self.source.text(inner, "class")
            if called in self.classes:
                raise self.source.error(inner, called, "names of classes must be unique")
            if len(self.classes) >= CLASS_LIMIT:
                raise self.source.error(inner, called, f"at most {CLASS_LIMIT} classes")
            self.classes[called] = dict(own)
            self._collect(inner, called)

    @property
    def has_compiled(self) -> bool:
        """Whether MuJoCo was asked for inertias."""
        return self._compiled is not None

    def compiled(self) -> Mapping[str, Body]:
        """Return the file's bodies by name, with MuJoCo's inertias, computed once.

        Raises:
            NotCompiledError: there is no MuJoCo, or it refuses the file.
        """
        if self._compiled is None:
            self._compiled = compiled_bodies(self.source.path)
        return self._compiled

    def known(self, node: Node, called: str) -> str:
        """Return the name of a class, if there is one.

        Raises:
            SceneError: an unknown class.
        """
        if called not in self.classes:
            rule = f"no such class of defaults: must be one of {sorted(self.classes)}"
            raise self.source.error(node, called, rule)
        return called

    def full(self, node: Node, childclass: str = "") -> Node:
        """Return an element with what its class says of such ones."""
        called = node.attributes.get("class", childclass or self.main)
        given = self.classes[self.known(node, called)].get(_kind(node), {})
        return replace(node, attributes={**given, **node.attributes})

    def word(self, node: Node, key: str, default: str) -> str:
        """Return an attribute that is a word."""
        return node.attributes.get(key, default).strip()

    def flag(self, node: Node, key: str, default: str = "false") -> bool:
        """Return an attribute that is true or false.

        Raises:
            SceneError: neither true nor false.
        """
        found = self.word(node, key, default)
        if found not in ("true", "false"):
            raise self.source.error(node, found, f"{key} must be true or false")
        return found == "true"

    def padded(self, node: Node, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return the numbers in an attribute, which may be fewer than there could be."""
        given = node.attributes.get(key, "")
        count = min(len(given.split(maxsplit=len(default) + 1)), len(default))
        return (*self.source.numbers(node, given, count, key), *default[count:])

    def angle(self, value: float) -> float:
        """Return a written angle in rad."""
        return float(value * self._unit)

    def place(self, node: Node) -> pin.SE3:
        """Return where an element is in what it is in."""
        position = np.array(self.source.values(node, "pos", (0.0, 0.0, 0.0)))
        return pin.SE3(self.rotation(node), position)

    def rotation(self, node: Node) -> np.ndarray:
        """Return an element's rotation (3, 3) in its parent's frame; the identity if none is given.

        Raises:
            SceneError: a rotation that is given in two ways.
        """
        given = [key for key in TURNS if key in node.attributes]
        if len(given) > 1:
            raise self.source.error(node, given, "one way of giving a rotation is enough")
        if not given:
            return self.quaternion(node, "quat")
        if given == ["euler"]:
            return self._euler(node)
        if given == ["axisangle"]:
            x, y, z, angle = self.source.values(node, "axisangle", (0.0,) * 4)
            unit = self._unit_of(node, "axisangle", np.array((x, y, z)))
            return np.asarray(pin.AngleAxis(self.angle(angle), unit).matrix())
        if given == ["zaxis"]:
            axis = self._unit_of(
                node, "zaxis", np.array(self.source.values(node, "zaxis", (0.0, 0.0, 1.0)))
            )
            return np.asarray(pin.Quaternion.FromTwoVectors(UP, axis).matrix())
        both = np.array(self.source.values(node, "xyaxes", (0.0,) * 6))
        x_axis = self._unit_of(node, "xyaxes", both[:3])
        y_axis = self._unit_of(node, "xyaxes", both[3:] - (both[3:] @ x_axis) * x_axis)
        return np.column_stack((x_axis, y_axis, np.cross(x_axis, y_axis)))

    def quaternion(self, node: Node, key: str) -> np.ndarray:
        """Return the rotation (3, 3) that a quaternion in an attribute is."""
        w, x, y, z = self.source.values(node, key, (1.0, 0.0, 0.0, 0.0))
        self._unit_of(node, key, np.array((w, x, y, z)))
        turn = pin.Quaternion(w, x, y, z)
        turn.normalize()
        return np.asarray(turn.matrix())

    def _unit_of(self, node: Node, key: str, vector: np.ndarray) -> np.ndarray:
        size = float(np.linalg.norm(vector))
        if not size > 0.0:
            raise self.source.error(node, node.attributes.get(key), f"{key} must not be zero")
        return np.asarray(vector / size)

    def _euler(self, node: Node) -> np.ndarray:
        """Small letters turn about axes that turn along, capitals about those that stay."""
        sequence = self.word(self.compiler, "eulerseq", "xyz")
        if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
            rule = "eulerseq must be three of x, y, z, X, Y, Z"
            raise self.source.error(self.compiler, sequence, rule)
        found = np.eye(3)
        for letter, angle in zip(
            sequence, self.source.values(node, "euler", (0.0, 0.0, 0.0)), strict=True
        ):
            axis = np.eye(3)["xyz".index(letter.lower())]
            turn = pin.AngleAxis(self.angle(angle), axis).matrix()
            found = found @ turn if letter.islower() else turn @ found
        return found
