"""Where declared pairs of shapes touch: bounding boxes first, then points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from hapticmech_ros.contact.near_kernels import near_pairs
from hapticmech_ros.contact.shape_kernels import HALF_SPACE, JOINT, KIND
from hapticmech_ros.contact.tables import shape_tables
from hapticmech_ros.contact.touch_kernels import (
    FOUND_VALUES,
    MOST_POINTS,
    POINT_VALUES,
    touching_points,
)
from hapticmech_ros.mechanism.compiled.mechanism import placement_view
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.scene.contacts import Shape

if TYPE_CHECKING:
    from hapticmech_ros.contact.nearest import Nearest

_UNSOUGHT = np.zeros(FOUND_VALUES)
# Points are looked for this many steps ahead: forces begin half a step before surfaces meet.
STEPS_AHEAD = 1.5


class Search:
    """Finds the points of contact of a scene.

    Args:
        mechanism: that carries the shapes.

    Attributes:
        axes: (nv, 6) joint axes at the last configuration, as twists about the world's origin.
        joint_poses: (joints, 12) there.
        moves: (joints, nv) 1 where a rate moves a joint, 0 elsewhere.
        joints: (pairs, 2) joints that carry a and b.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        scene, self._model = mechanism.scene, mechanism.model
        self._data, self._later = self._model.createData(), self._model.createData()
        self._tables = shape_tables(scene.shapes, mechanism.tree)
        place = {shape.name: index for index, shape in enumerate(scene.shapes)}
        pairs = [(place[contact.a], place[contact.b]) for contact in scene.contacts]
        self._pairs = np.array(pairs, dtype=np.int64)
        self.joints = np.ascontiguousarray(self._tables.numbers[:, JOINT][self._pairs])
        self.moves = _moves(self._model)
        self.joint_poses = placement_view(self._data.oMi)
        self.axes = np.zeros((self._model.nv, 6))
        self._poses = np.zeros((len(scene.shapes), 12))
        self._margins = np.zeros(len(pairs))
        self._points = np.zeros((MOST_POINTS, POINT_VALUES))
        self._nearest = [self._searched(scene.shapes, pair) for pair in pairs]

    def points(self, q: Array, rates: Array, step: float) -> tuple[Array, Array]:
        """Return points that touch, or may within a step.

        Args:
            q: (nq,) configuration.
            rates: (nv,) expected.
            step: s.

        Returns:
            (n,) indices of pairs, in order; and (n, 7) position, m, unit normal from b to a, and
            depth, m, below 0 for a gap.
        """
        pin.computeJointJacobians(self._model, self._data, q)
        self.axes = np.ascontiguousarray(self._data.J.T)
        tables, poses, margins = self._tables, self._poses, self._margins
        near_pairs(
            tables.numbers,
            tables.values,
            self.joint_poses,
            self.axes,
            self.moves,
            rates,
            STEPS_AHEAD * step,
            self._pairs,
            poses,
            margins,
        )
        owners: list[int] = []
        found = []
        for pair in np.flatnonzero(margins >= 0.0).tolist():
            a, b = self._pairs[pair]
            nearest = self._nearest[pair]
            seen = _UNSOUGHT if nearest is None else nearest.search(poses[a], poses[b])
            count = touching_points(
                *tables.of_touching, poses, a, b, margins[pair], seen, self._points
            )
            owners += [pair] * count
            found.append(self._points[:count].copy())
        if not owners:
            return np.zeros(0, dtype=np.int64), np.zeros((0, POINT_VALUES))
        return np.array(owners), np.concatenate(found)

    def later_axes(self, q: Array, change: Array) -> Array:
        """Return (nv, 6) joint axes at q ⊕ change, as twists about the world's origin."""
        moved = pin.integrate(self._model, q, change)
        pin.computeJointJacobians(self._model, self._later, moved)
        return np.ascontiguousarray(self._later.J.T)

    def centres(self, owners: Array) -> Array:
        """Return (n, 2, 3) the origins of both shapes of pairs, m, at the last configuration."""
        return np.ascontiguousarray(self._poses[self._pairs[owners], 9:])

    def _searched(self, shapes: tuple[Shape, ...], pair: tuple[int, int]) -> Nearest | None:
        a, b = pair
        if HALF_SPACE in self._tables.numbers[[a, b], KIND]:
            return None
        # Here, so that a scene with nothing but half-spaces needs no search.
        from hapticmech_ros.contact.nearest import Nearest

        polytopes = self._tables.polytopes
        return Nearest(shapes[a], shapes[b], (polytopes[a], polytopes[b]))


def _moves(model: pin.Model) -> Array:
    """Return (joints, nv) 1 where a rate moves a joint, 0 elsewhere."""
    moves = np.zeros((model.njoints, model.nv))
    for joint in range(1, model.njoints):
        first = model.idx_vs[joint]
        moves[joint] = moves[model.parents[joint]]
        moves[joint, first : first + model.nvs[joint]] = 1.0
    return moves
