"""Shapes of a scene as arrays that kernels take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.contact.hull import Polytope, box
from hapticmech_ros.contact.shape_kernels import (
    CAPSULE,
    CYLINDER,
    HALF_SIZE,
    HALF_SPACE,
    MIDDLE,
    POLYTOPE,
    SHAPE_VALUES,
    SPHERE,
)
from hapticmech_ros.mechanism.model import TreeModel, se3
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, Mesh, Shape, Sphere


@dataclass(frozen=True)
class ShapeTables:
    """All shapes of a scene.

    Attributes:
        numbers: (shapes, 6) kind, joint that carries it, and where its vertices and faces are.
        values: (shapes, 20) pose in the joint, radius, half-length, middle and half-lengths of a
            bounding box; see ``shape_kernels``.
        vertices: (v, 3) of all polytopes, m.
        faces: (f, 2) first corner and number of corners.
        corners: (c,) vertices, in order around each face.
        normals: (f, 3) outward.
        polytopes: of each shape, None where it is none.
    """

    numbers: Array
    values: Array
    vertices: Array
    faces: Array
    corners: Array
    normals: Array
    polytopes: tuple[Polytope | None, ...]

    @property
    def of_touching(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """What ``touching_points`` takes."""
        return self.numbers, self.values, self.vertices, self.faces, self.corners, self.normals


def shape_tables(shapes: tuple[Shape, ...], tree: TreeModel) -> ShapeTables:
    """Return the tables of shapes on a tree's links.

    Raises:
        SceneError: a mesh that cannot be read.
    """
    numbers = np.zeros((len(shapes), 6), dtype=np.int64)
    values = np.zeros((len(shapes), SHAPE_VALUES))
    polytopes = _polytopes(shapes)
    vertices, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    faces: list[tuple[int, int]] = []
    corners: list[int] = []
    many = 0
    for index, shape in enumerate(shapes):
        joint, placement = tree.link_joint[shape.link]
        pose = placement * se3(shape.origin)
        values[index, :12] = np.concatenate((pose.rotation.T.ravel(), pose.translation))
        kind, radius, half = _kind(shape)
        values[index, 12:14] = radius, half
        polytope = polytopes[index]
        first_face = len(faces)
        if polytope is None:
            values[index, HALF_SIZE:] = radius, radius, half if kind == CYLINDER else half + radius
        else:
            low, high = polytope.vertices.min(axis=0), polytope.vertices.max(axis=0)
            values[index, MIDDLE:HALF_SIZE] = 0.5 * (low + high)
            values[index, HALF_SIZE:] = 0.5 * (high - low)
            for face in polytope.faces:
                faces.append((len(corners), len(face)))
                corners += [many + corner for corner in face]
            vertices.append(polytope.vertices)
            normals.append(polytope.normals)
        count = 0 if polytope is None else len(polytope.vertices)
        numbers[index] = kind, joint, many, many + count, first_face, len(faces)
        many += count
    return ShapeTables(
        numbers,
        values,
        np.concatenate(vertices),
        np.array(faces, dtype=np.int64).reshape(-1, 2),
        np.array(corners, dtype=np.int64),
        np.concatenate(normals),
        polytopes,
    )


def _kind(shape: Shape) -> tuple[int, float, float]:
    """Return a shape's kind, radius and half-length."""
    match shape.geometry:
        case Sphere(radius=radius):
            return SPHERE, radius, 0.0
        case Capsule(radius=radius, length=length):
            return CAPSULE, radius, 0.5 * length
        case Cylinder(radius=radius, length=length):
            return CYLINDER, radius, 0.5 * length
        case Box() | Mesh():
            return POLYTOPE, 0.0, 0.0
    return HALF_SPACE, 0.0, 0.0


def _polytopes(shapes: tuple[Shape, ...]) -> tuple[Polytope | None, ...]:
    found: dict[int, Polytope] = {}
    if any(isinstance(shape.geometry, Mesh) for shape in shapes):
        # Here, so that scenes without meshes do not load what reads them.
        from hapticmech_ros.contact.mesh_hulls import mesh_hulls

        found = mesh_hulls(shapes)
    for index, shape in enumerate(shapes):
        if isinstance(shape.geometry, Box):
            found[index] = box(shape.geometry.size)
    return tuple(found.get(index) for index in range(len(shapes)))
