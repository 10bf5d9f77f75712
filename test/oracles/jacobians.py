# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Jacobians, inertia and momentum of a scene from axes and arms of its joints, in plain NumPy.

For trees of revolute, prismatic and free joints; a free joint's rates are in its body's axes.
"""

from __future__ import annotations

import numpy as np

from oracles.closed_form import inverse_inertia
from oracles.kinematics import Array, Document, link_poses, place, skew
from oracles.newton_euler import moments

RATE_SIZE = {"revolute": 1, "prismatic": 1, "free": 6}


class Jacobians:
    """A scene's document at configuration q."""

    def __init__(self, document: Document, q: Array) -> None:
        self._links, self._closures = document["links"], document.get("closures", [])
        self.poses = link_poses(document, q)
        self.nv = sum(RATE_SIZE[link["joint"]["type"]] for link in self._links)
        self._carried: dict[str, list[tuple[int, Array]]] = {"world": []}
        start = 0
        for link in self._links:
            own = self._twists(link)
            above = self._carried[link.get("parent", "world")]
            self._carried[link["name"]] = [*above, (start, own)]
            start += own.shape[1]

    def at(self, link: str, point: Array) -> Array:
        """Return (6, nv): world axes, of the point of a link that is at ``point`` now."""
        found = np.zeros((6, self.nv))
        for start, twists in self._carried[link]:
            part = slice(start, start + twists.shape[1])
            found[:3, part] = twists[:3] - skew(point) @ twists[3:]
            found[3:, part] = twists[3:]
        return found

    def of_frame(self, frame: Document) -> Array:
        """Return (6, nv) at the origin of ``{link, origin}``."""
        point = place(self.poses[frame["link"]], frame.get("origin"))[1]
        return self.at(frame["link"], point)

    def closing_rows(self) -> Array:
        """Return W of welds and ball joints: by what twists of frames at one place differ."""
        rows = [np.zeros((0, self.nv))]
        for closure in self._closures:
            apart = self.of_frame(closure["a"]) - self.of_frame(closure["b"])
            rows.append(apart[: 3 if closure["kind"] == "spherical" else 6])
        return np.vstack(rows)

    def inverse_inertia(self, frame: Document) -> Array:
        """Return X (6, 6) at the origin of ``{link, origin}``, with independent coordinates."""
        return inverse_inertia(self.inertia(), self.closing_rows(), self.of_frame(frame))

    def momenta(self) -> Array:
        """Return (6, nv): momentum, and angular momentum about the world's origin, per rate."""
        total = np.zeros((6, self.nv))
        for link in self._links:
            centre, mass, body = self._body(link)
            jacobian = self.at(link["name"], centre)
            linear = mass * jacobian[:3]
            total[:3] += linear
            total[3:] += skew(centre) @ linear + body @ jacobian[3:]
        return total

    def inertia(self) -> Array:
        """Return D (nv, nv)."""
        total = np.zeros((self.nv, self.nv))
        for link in self._links:
            centre, mass, body = self._body(link)
            move, spin = np.split(self.at(link["name"], centre), 2)
            total += mass * move.T @ move + spin.T @ body @ spin
        return total

    def _body(self, link: Document) -> tuple[Array, float, Array]:
        rotation, origin = self.poses[link["name"]]
        inertial = link["inertial"]
        centre = origin + rotation @ np.asarray(inertial.get("com", (0, 0, 0)), dtype=float)
        return centre, inertial["mass"], rotation @ moments(link) @ rotation.T

    def _twists(self, link: Document) -> Array:
        """Return (6, k) twists of a joint's rates, linear part at the world's origin."""
        joint = link["joint"]
        rotation, origin = self.poses[link["name"]]
        if joint["type"] == "free":
            arm = skew(origin) @ rotation
            return np.block([[rotation, arm], [np.zeros((3, 3)), rotation]])
        axis = rotation @ np.asarray(joint.get("axis", (0, 0, 1)), dtype=float)
        if joint["type"] == "prismatic":
            return np.concatenate((axis, np.zeros(3)))[:, None]
        return np.concatenate((np.cross(origin, axis), axis))[:, None]
