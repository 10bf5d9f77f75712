# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The contacts of a mechanism as arrays for kernels, and their points as objects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.contact.layout import (
    DIVISION,
    FOUND,
    NOTHING,
    NOW,
    OFF,
    PARTS,
    SWEEPS,
    Contacts,
)
from hapticmech_ros.contact.model_arrays import contacts_of, shape_model, with_workspace
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import plan_of


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
        residual: m/s, by which the points' rates are off what the law says.
        divided: into how many parts the last step was divided for an impact; points and forces are
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


def nothing_touching(nv: int) -> Touching:
    """Return what there is of a mechanism with so many rates where nothing touches."""
    none = np.zeros((0, 3))
    return Touching(np.zeros(0, dtype=np.int64), none, none, np.zeros(0), none, none, np.zeros(nv))


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
        scene, plan = mechanism.scene, plan_of(mechanism.scene.simulation)
        shapes = shape_model(scene.shapes, mechanism.tree)
        self.links = sorted({shape.link for shape in scene.shapes} - {"world"})
        self.polytopes = shapes.polytopes
        places = {link: mechanism.link_place(link) for link in self.links}
        # Positions move by the mean of both rates, or by the new one.
        ahead = 0.0 if plan.integrator == "semi_implicit_euler" else 0.5
        self._hold(
            *contacts_of(
                scene,
                shapes,
                mechanism.active_set(mechanism.initially_active).model,
                {link: (joint, pose.translation) for link, (joint, pose) in places.items()},
                (ahead, plan.period, FAR, 0.0, NOTHING),
            )
        )
        self._nothing = nothing_touching(mechanism.nv)
        self._last: Touching | None = None

    def begin_with(self, touching: Touching | None) -> None:
        """Make points and forces those of a period, if they are not."""
        contacts, known = self.contacts, self._last
        self._last = None
        contacts.joint_force[:] = 0.0 if touching is None else touching.joint_force
        if touching is None or not touching.pairs.size:
            contacts.counts[NOW] = 0
        elif touching is not known:
            count = len(touching.pairs)
            contacts.counts[NOW] = count
            contacts.owners[:count] = touching.pairs
            contacts.points[:count, :3] = touching.points
            contacts.points[:count, 3:6] = touching.normals
            contacts.points[:count, 6] = touching.depths
            contacts.forces[:count] = touching.forces
            contacts.origins[:count] = touching.origins
            contacts.report[[SWEEPS, OFF]] = touching.sweeps, touching.residual

    def touching(self) -> Touching:
        """Return the points of contact of the last step."""
        contacts = self.contacts
        count = int(contacts.counts[NOW])
        if not count:
            # Of an impact that was over before the period was.
            felt = contacts.joint_force
            # Of few numbers NumPy's any takes longer.
            if any(felt.tolist()):
                return replace(self._nothing, joint_force=felt.copy())
            return self._nothing
        points = contacts.points[:count].copy()
        report = contacts.report.tolist()
        self._last = Touching(
            contacts.owners[:count].copy(),
            points[:, :3],
            points[:, 3:6],
            points[:, 6],
            contacts.forces[:count].copy(),
            contacts.origins[:count].copy(),
            contacts.joint_force.copy(),
            int(report[SWEEPS]),
            report[OFF],
            int(contacts.counts[DIVISION]),
        )
        return self._last

    def enlarge(self) -> None:
        """Make the solver's workspace large enough for the points that were found."""
        contacts = self.contacts
        points = min(2 * int(contacts.counts[FOUND]), len(contacts.points))
        self._hold(*with_workspace(*self.arrays, points))

    def _hold(self, numbers: Array, values: Array) -> None:
        self.arrays = numbers, values
        contacts = Contacts(numbers, values)
        self.contacts = SimpleNamespace(**{name: getattr(contacts, name) for name in PARTS})
