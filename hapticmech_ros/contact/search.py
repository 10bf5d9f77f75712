"""Where declared pairs of shapes touch: bounding boxes first, then points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.contact.near_kernels import near_pairs
from hapticmech_ros.contact.shape_kernels import HALF_SPACE, JOINT, KIND
from hapticmech_ros.contact.tables import shape_tables
from hapticmech_ros.contact.touch_kernels import (
    FOUND_VALUES,
    MOST_POINTS,
    POINT_VALUES,
    touching_points,
)
from hapticmech_ros.mechanism.mechanism import Mechanism, placement_view
from hapticmech_ros.scene.contacts import Shape

if TYPE_CHECKING:
    from hapticmech_ros.contact.nearest import Nearest

# Points are looked for this many steps ahead: forces begin half a step before surfaces meet.
STEPS_AHEAD = 1.5
# Points count that are apart by this share of the shapes' size, moving or not.
SLACK = 1e-3


class Search:
    """Finds the points of contact of a scene.

    Args:
        mechanism: that carries the shapes.

    Attributes:
        axes: (nv, 6) joint axes at the last configuration, as twists about the world's origin.
        joint_poses: (joints, 12) there.
        poses: (shapes, 12) there.
        moves: (joints, nv) 1 where a rate moves a joint, 0 elsewhere.
        pairs: (pairs, 4) shapes a and b, and the joints that carry them.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        scene, self._model = mechanism.scene, mechanism.model
        self._data, self._later = self._model.createData(), self._model.createData()
        self._tables = shape_tables(scene.shapes, mechanism.tree)
        place = {shape.name: index for index, shape in enumerate(scene.shapes)}
        shapes = np.array([(place[pair.a], place[pair.b]) for pair in scene.contacts])
        self.pairs = np.hstack((shapes, self._tables.numbers[:, JOINT][shapes]))
        self.moves = _moves(self._model)
        self.joint_poses = placement_view(self._data.oMi)
        self.axes = np.zeros((self._model.nv, 6))
        self.poses = np.zeros((len(scene.shapes), 12))
        count = len(shapes)
        self._margins, self._found = np.zeros(count), np.zeros((count, FOUND_VALUES))
        self._points = np.zeros((MOST_POINTS * count, POINT_VALUES))
        self._owners = np.zeros(MOST_POINTS * count, dtype=np.int64)
        searches = [self._searched(scene.shapes, a, b) for a, b in shapes.tolist()]
        self._nearest = [(i, search) for i, search in enumerate(searches) if search is not None]

    def place(self, q: Array) -> None:
        """Take a configuration (nq,), of which everything that follows is."""
        pin.computeJointJacobians(self._model, self._data, q)
        self.axes = np.ascontiguousarray(self._data.J.T)

    def near(self, rates: Array, step: float, slack: float = SLACK) -> bool:
        """Return whether any pair may touch within a step, by bounding boxes.

        Args:
            rates: (nv,) expected.
            step: s.
            slack: share of the shapes' size by which they may be apart, moving or not.
        """
        count = near_pairs(
            self._tables.numbers,
            self._tables.values,
            self.joint_poses,
            self.axes,
            self.moves,
            np.array(rates),
            STEPS_AHEAD * step,
            slack,
            self.pairs,
            self.poses,
            self._margins,
        )
        return count > 0

    def points(self) -> tuple[Array, Array]:
        """Return points that touch, or may within a step, of the pairs that were near.

        Returns:
            (n,) indices of pairs, in order; and (n, 7) position, m, unit normal from b to a, and
            depth, m, below 0 for a gap.
        """
        poses = self.poses
        for pair, nearest in self._nearest:
            if self._margins[pair] >= 0.0:
                a, b = self.pairs[pair, :2]
                self._found[pair] = nearest.search(poses[a], poses[b])
        count = touching_points(
            *self._tables.of_touching,
            poses,
            self.pairs,
            self._margins,
            self._found,
            self._points,
            self._owners,
        )
        return self._owners[:count].copy(), self._points[:count].copy()

    def later_axes(self, q: Array, change: Array) -> Array:
        """Return (nv, 6) joint axes at q ⊕ change, as twists about the world's origin."""
        moved = pin.integrate(self._model, q, change)
        pin.computeJointJacobians(self._model, self._later, moved)
        return np.ascontiguousarray(self._later.J.T)

    def _searched(self, shapes: tuple[Shape, ...], a: int, b: int) -> Nearest | None:
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
