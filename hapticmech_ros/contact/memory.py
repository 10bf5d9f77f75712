# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts of a mechanism: model and data as arrays for kernels, and their points as objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from hapticmech_ros.compilation import arrays_of
from hapticmech_ros.contact.hull import Polytope, box
from hapticmech_ros.contact.layout import (
    BOX_VALUES,
    CAPSULE,
    CYLINDER,
    FIRST_WORKSPACE,
    FOUND_VALUES,
    HALF_SIZE,
    HALF_SPACE,
    JOINT,
    KIND,
    MIDDLE,
    MOST_POINTS,
    NOTHING,
    POINT_VALUES,
    POLYTOPE,
    PUSH_VALUES,
    SHAPE_VALUES,
    SPHERE,
    ContactCounts,
    ContactReport,
    Contacts,
    workspace_size,
)
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, Mesh, Shape, Sphere


def shape_parts(
    shapes: tuple[Shape, ...], polytopes: tuple[Polytope | None, ...], tree: TreeModel
) -> dict[str, Array]:
    """Return (n,) or (n, m) the parts of a :class:`Contacts` for shapes on links, by name.

    Args:
        shapes: all of a scene.
        polytopes: of each shape, None where it is none.
        tree: that carries them.
    """
    numbers = np.zeros((len(shapes), 6), dtype=np.int64)
    values = np.zeros((len(shapes), SHAPE_VALUES))
    vertices, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    faces: list[tuple[int, int]] = []
    corners: list[int] = []
    many = 0
    for index, (shape, polytope) in enumerate(zip(shapes, polytopes, strict=True)):
        joint, pose = tree.place(shape.link, shape.origin)
        values[index, :12] = np.concatenate((pose.rotation.T.ravel(), pose.translation))
        kind, radius, half = _kind(shape)
        values[index, 12:14] = radius, half
        first, first_face = many, len(faces)
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
            many += len(polytope.vertices)
        numbers[index] = kind, joint, first, many, first_face, len(faces)
    return {
        "shapes": numbers,
        "shape_values": values,
        "vertices": np.concatenate(vertices),
        "faces": np.array(faces, dtype=np.int64).reshape(-1, 2),
        "corners": np.array(corners, dtype=np.int64),
        "normals": np.concatenate(normals),
    }


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
        # Imported here: scenes without meshes do not need it.
        from hapticmech_ros.contact.hull import mesh_hulls

        found = mesh_hulls(shapes)
    for index, shape in enumerate(shapes):
        if isinstance(shape.geometry, Box):
            found[index] = box(shape.geometry.size)
    return tuple(found.get(index) for index in range(len(shapes)))


def contacts_of(
    mechanism: Mechanism,
    shapes: Mapping[str, Array],
    links: Sequence[str],
    settings: tuple[float, float, float, float, float],
) -> tuple[Array, Array]:
    """Return the two arrays of a :class:`Contacts`, (integers,) and (numbers,), its data at zero.

    Args:
        mechanism: whose contacts.
        shapes: (n,) or (n, m) parts by name, see :func:`shape_parts`.
        links: with shapes.
        settings: (5,) a :class:`~hapticmech_ros.contact.layout.ContactSettings`, in its order.
    """
    scene, nq, nv = mechanism.scene, mechanism.nq, mechanism.nv
    places = [mechanism.link_place(link) for link in links]
    place = {shape.name: index for index, shape in enumerate(scene.shapes)}
    acts = np.zeros((len(links), len(scene.contacts)))
    pairs = np.zeros((len(scene.contacts), 5), dtype=np.int64)
    for index, contact in enumerate(scene.contacts):
        both = [place[contact.a], place[contact.b]]
        searched = HALF_SPACE not in shapes["shapes"][both, KIND]
        pairs[index] = *both, *shapes["shapes"][both, JOINT], searched
        for shape, sign in zip(both, (1.0, -1.0), strict=True):
            if scene.shapes[shape].link in links:
                acts[links.index(scene.shapes[shape].link), index] += sign
    most = MOST_POINTS * len(pairs)
    parts = {
        **shapes,
        "pairs": pairs,
        "carriers": np.array([joint for joint, _ in places], dtype=np.int64),
        "counts": ContactCounts().values,
        "owners": np.zeros(most, dtype=np.int64),
        "owners_before": np.zeros(most, dtype=np.int64),
        "laws": np.array(
            [(c.stiffness, c.damping, c.friction, c.dissipation) for c in scene.contacts]
        ),
        "moves": _moves(mechanism.active_set(mechanism.initially_active).model.joints, nv),
        "acts": acts,
        "link_origins": np.array([pose.translation for _, pose in places]).reshape(-1, 3),
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
        "report": ContactReport().values,
        "begun": np.zeros(nq + nv),
        "external": np.zeros((len(links) + len(scene.links), PUSH_VALUES)),
        "frames": np.zeros((most, 9)),
        "workspace": np.zeros(workspace_size(min(most, FIRST_WORKSPACE), nv)),
    }
    remembered = ("counts", "owners", "points", "forces", "origins", "joint_force", "report")
    kept = {f"kept_{name}": parts[name] for name in remembered}
    return arrays_of(Contacts, {}, parts | kept)


def _moves(joints: Array, nv: int) -> Array:
    """Return (joints, nv) 1 where a rate moves a joint, 0 elsewhere."""
    moves = np.zeros((len(joints), nv))
    for joint, (parent, first, count, *_) in enumerate(joints.tolist()):
        if joint:
            moves[joint] = moves[parent]
            moves[joint, first : first + count] = 1.0
    return moves


@dataclass(frozen=True, slots=True)
class Touching:
    """Points of contact in the step that led to a state; n of them, in order of their pairs.

    Attributes:
        pairs: (n,) index of each point's pair among the scene's contacts.
        points: (n, 3) position at the step's start, midway between both surfaces, m, world.
        normals: (n, 3) unit normals from b to a, world axes.
        depths: (n,) m, how far the shapes overlap there; below 0 for a gap.
        forces: (n, 3) on a by b, held over the step, N, world axes.
        origins: (n, 3) of the frames of shapes a, m, world, at the step's start.
        joint_force: (nv,) mean of Σ J_cᵀ λ over the period, each at its step's start, N m or N.
        sweeps: that the solver did; none where Newton's rule was enough.
        residual: m/s, error of the points' rates by the law.
        divided: number of parts of the last step, divided for an impact; points and forces are
            those of the last part.
    """

    pairs: Array
    points: Array
    normals: Array
    depths: Array
    forces: Array
    origins: Array
    joint_force: Array
    sweeps: int = 0
    residual: float = 0.0
    divided: int = 1

    def wrench(self, pair: int, origin: Array | None = None) -> Array:
        """Return (6,) the wrench of a pair: by b, on a, at a point, N and N m, world axes.

        Args:
            pair: index among the scene's contacts.
            origin: (3,) the point, m; the origin of shape a's frame if left out.
        """
        mine = self.pairs == pair
        force = self.forces[mine]
        about = self.origins[mine] if origin is None else origin
        torque = np.cross(self.points[mine] - about, force).sum(axis=0)
        return np.concatenate((force.sum(axis=0), torque))


# Shapes further apart than this share of their size, and than they come in a period, are stepped as
# if there were no contacts.
FAR = 0.05


class ContactMemory:
    """Model and data of a mechanism's contacts.

    Args:
        mechanism: whose.

    Attributes:
        links: names of links with shapes, in order.
        polytopes: per shape its polytope, or None.
        arrays: the two arrays of a :class:`~hapticmech_ros.contact.layout.Contacts`.
        contacts: views of their parts, found once.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        scene, simulation = mechanism.scene, mechanism.scene.simulation
        self.links = sorted({shape.link for shape in scene.shapes} - {"world"})
        self.polytopes = _polytopes(scene.shapes)
        shapes = shape_parts(scene.shapes, self.polytopes, mechanism.tree)
        # Positions move by the mean of both rates, or by the new one.
        ahead = 0.0 if simulation.integrator == "semi_implicit_euler" else 0.5
        settings = ahead, simulation.period, FAR, 0.0, NOTHING
        self._hold(*contacts_of(mechanism, shapes, self.links, settings))
        none, still = np.zeros((0, 3)), np.zeros(mechanism.nv)
        owners = np.zeros(0, dtype=np.int64)
        self._nothing = Touching(owners, none, none, np.zeros(0), none, none, still)
        self._last: Touching | None = None

    def begin_with(self, touching: Touching | None) -> None:
        """Make points and forces those of a period, if they are not."""
        contacts, known = self.contacts, self._last
        self._last = None
        contacts.joint_force[:] = 0.0 if touching is None else touching.joint_force
        if touching is None or not touching.pairs.size:
            contacts.counts.points = 0
        elif touching is not known:
            count = len(touching.pairs)
            contacts.counts.points = count
            contacts.owners[:count] = touching.pairs
            contacts.points[:count, :3] = touching.points
            contacts.points[:count, 3:6] = touching.normals
            contacts.points[:count, 6] = touching.depths
            contacts.forces[:count] = touching.forces
            contacts.origins[:count] = touching.origins
            report = contacts.report
            report.sweeps, report.residual = touching.sweeps, touching.residual

    def touching(self) -> Touching:
        """Return the points of contact of the last step."""
        contacts = self.contacts
        count = int(contacts.counts.points)
        if not count:
            # Of an impact that was over before the period was.
            felt = contacts.joint_force
            # Of few numbers NumPy's any takes longer.
            if any(felt.tolist()):
                return replace(self._nothing, joint_force=felt.copy())
            return self._nothing
        points = contacts.points[:count].copy()
        self._last = Touching(
            contacts.owners[:count].copy(),
            points[:, :3],
            points[:, 3:6],
            points[:, 6],
            contacts.forces[:count].copy(),
            contacts.origins[:count].copy(),
            contacts.joint_force.copy(),
            int(contacts.report.sweeps),
            contacts.report.residual,
            int(contacts.counts.parts),
        )
        return self._last

    def enlarge(self) -> None:
        """Make the solver's workspace large enough for the points that were found."""
        contacts = Contacts(*self.arrays)
        points = min(2 * contacts.counts.points_found, len(contacts.points))
        parts = {name: place.view(contacts) for name, place in Contacts.parts.items()}
        room = np.zeros(workspace_size(points, contacts.free.size))
        self._hold(*arrays_of(Contacts, {}, parts | {"workspace": room}))

    def _hold(self, numbers: Array, values: Array) -> None:
        self.arrays = numbers, values
        contacts = Contacts(numbers, values)
        self.contacts = SimpleNamespace(
            **{name: getattr(contacts, name) for name in Contacts.parts}
        )
