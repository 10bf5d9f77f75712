# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Model and data of a scene's contacts as the arrays that kernels take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import SIZES
from hapticmech_ros.contact.hull import Polytope, box
from hapticmech_ros.contact.layout import (
    BOX_VALUES,
    CAPSULE,
    COUNTS,
    CYLINDER,
    FIRST_WORKSPACE,
    FOUND_VALUES,
    HALF_SIZE,
    HALF_SPACE,
    JOINT,
    KIND,
    MIDDLE,
    MOST_POINTS,
    PARTS,
    POINT_VALUES,
    POLYTOPE,
    PUSH_VALUES,
    REPORT_VALUES,
    SHAPE_VALUES,
    SPHERE,
    Contacts,
    workspace_size,
)
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.model import TreeModel, se3
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, Mesh, Shape, Sphere


@dataclass(frozen=True)
class ShapeModel:
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


def shape_model(shapes: tuple[Shape, ...], tree: TreeModel) -> ShapeModel:
    """Return the model of shapes on a tree's links.

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
    return ShapeModel(
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


def contacts_of(
    scene: Scene,
    shapes: ShapeModel,
    model: Model,
    places: dict[str, tuple[int, Array]],
    settings: tuple[float, float, float, float, float],
) -> tuple[Array, Array]:
    """Return the two arrays of a :class:`Contacts`, (integers,) and (numbers,), its data at zero.

    Args:
        scene: whose contacts.
        shapes: the scene's shapes.
        model: the mechanism's, with any set of closures.
        places: per link with shapes the joint that carries it, and its origin (3,) there, m.
        settings: (5,) as in :class:`Contacts`.
    """
    nq, nv, joints = model.nq, model.nv, model.joints
    place = {shape.name: index for index, shape in enumerate(scene.shapes)}
    links = {shape.name: shape.link for shape in scene.shapes}
    named = list(places)
    acts = np.zeros((len(named), len(scene.contacts)))
    pairs = np.zeros((len(scene.contacts), 5), dtype=np.int64)
    for index, contact in enumerate(scene.contacts):
        both = [place[contact.a], place[contact.b]]
        searched = HALF_SPACE not in shapes.numbers[both, KIND]
        pairs[index] = *both, *shapes.numbers[both, JOINT], searched
        for shape, sign in ((contact.a, 1.0), (contact.b, -1.0)):
            if links[shape] in places:
                acts[named.index(links[shape]), index] += sign
    most = MOST_POINTS * len(pairs)
    parts = {
        "shapes": shapes.numbers,
        "pairs": pairs,
        "faces": shapes.faces,
        "corners": shapes.corners,
        "carriers": np.array([joint for joint, _ in places.values()], dtype=np.int64),
        "counts": np.zeros(COUNTS, dtype=np.int64),
        "owners": np.zeros(most, dtype=np.int64),
        "owners_before": np.zeros(most, dtype=np.int64),
        "shape_values": shapes.values,
        "vertices": shapes.vertices,
        "normals": shapes.normals,
        "laws": np.array(
            [(c.stiffness, c.damping, c.friction, c.dissipation) for c in scene.contacts]
        ),
        "moves": _moves(joints, nv),
        "acts": acts,
        "link_origins": np.array([origin for _, origin in places.values()]).reshape(-1, 3),
        "settings": np.array(settings),
        "axes": np.zeros((nv, 6)),
        "poses": np.zeros((len(scene.shapes), 12)),
        "boxes": np.zeros((len(scene.shapes), BOX_VALUES)),
        "margins": np.zeros(len(pairs)),
        "found": np.zeros((len(pairs), FOUND_VALUES)),
        "points": np.zeros((most, POINT_VALUES)),
        "forces": np.zeros((most, 3)),
        "points_before": np.zeros((most, POINT_VALUES)),
        "forces_before": np.zeros((most, 3)),
        "free": np.zeros(nv),
        "change": np.zeros(nv),
        "origins": np.zeros((most, 3)),
        "q": np.zeros(nq),
        "joint_force": np.zeros(nv),
        "step_force": np.zeros(nv),
        "stiff": np.zeros(nv),
        "branch": np.zeros((nv, nv)),
        "report": np.zeros(REPORT_VALUES),
        "begun": np.zeros(nq + nv),
        "external": np.zeros((len(named) + len(scene.links), PUSH_VALUES)),
        "frames": np.zeros((most, 9)),
        "workspace": np.zeros(workspace_size(min(most, FIRST_WORKSPACE), nv)),
    }
    remembered = ("counts", "owners", "points", "forces", "origins", "joint_force", "report")
    return _packed(parts | {f"kept_{name}": parts[name] for name in remembered})


def with_workspace(numbers: Array, values: Array, points: int) -> tuple[Array, Array]:
    """Return the two arrays, (integers,) and (numbers,), with a workspace for so many points.

    Args:
        numbers: (integers,) of the contacts.
        values: (numbers,) the others; see :class:`Contacts`.
        points: their number.
    """
    contacts = Contacts(numbers, values)
    parts = {name: getattr(contacts, name) for name in PARTS}
    return _packed(parts | {"workspace": np.zeros(workspace_size(points, contacts.free.size))})


def _packed(parts: dict[str, Array]) -> tuple[Array, Array]:
    """Return parts one after the other, and where each one is."""
    whole = [np.zeros(SIZES + 3 * len(PARTS), dtype=np.int64)]
    real: list[Array] = []
    for name, part in PARTS.items():
        kept, values = whole if part.whole else real, parts[name]
        columns = values.shape[1] if part.dimensions == 2 else 1
        whole[0][part.at : part.at + 3] = sum(one.size for one in kept), len(values), columns
        kept.append(values.ravel())
    return np.concatenate(whole), np.concatenate(real)


def _moves(joints: Array, nv: int) -> Array:
    """Return (joints, nv) 1 where a rate moves a joint, 0 elsewhere."""
    moves = np.zeros((len(joints), nv))
    for joint, (parent, first, count, *_) in enumerate(joints.tolist()):
        if joint:
            moves[joint] = moves[parent]
            moves[joint, first : first + count] = 1.0
    return moves
