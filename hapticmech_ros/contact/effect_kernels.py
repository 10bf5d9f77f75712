# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the forces at points of contact do to the links that touch, and in the joints."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local
from hapticmech_ros.contact.layout import JOINT_A, JOINT_B, SHAPE_A, Contacts
from hapticmech_ros.contact.shape_kernels import put_point
from hapticmech_ros.mechanism.kernels.small_matrices import cross


@inner
def contact_effects(contacts: Contacts, places: Array, count: int) -> None:
    """Fill ``step_force``, ``origins`` and the links' rows of ``external``.

    Args:
        contacts: with so many points and the forces there.
        places: (joints, 12) poses of the joints at the step's start.
        count: number of points.
    """
    moment, force, axes, moves = local(3), contacts.step_force, contacts.axes, contacts.moves
    points, forces, owners = contacts.points, contacts.forces, contacts.owners
    pairs, poses, origins = contacts.pairs, contacts.poses, contacts.origins
    for j in range(force.size):
        force[j] = 0.0
    for c in range(count):
        pair = pairs[owners[c]]
        cross(points[c], forces[c], moment)
        for i in range(3):
            origins[c, i] = poses[pair[SHAPE_A], 9 + i]
        for j in range(force.size):
            side = moves[pair[JOINT_A], j] - moves[pair[JOINT_B], j]
            if side != 0.0:
                for i in range(3):
                    force[j] += side * (axes[j, i] * forces[c, i] + axes[j, 3 + i] * moment[i])
    _push_links(contacts, places, count)


@inner
def _push_links(contacts: Contacts, places: Array, count: int) -> None:
    """Fill the links' rows of ``external``; see ``motion_kernels.add_link_forces``."""
    moment, arm, place = local(3), local(3), local(3)
    carriers, link_origins, acts = contacts.carriers, contacts.link_origins, contacts.acts
    points, forces, owners = contacts.points, contacts.forces, contacts.owners
    for link in range(carriers.size):
        push, origin = contacts.external[link], link_origins[link]
        push[0] = carriers[link]
        for i in range(3):
            push[1 + i], push[4 + i], push[7 + i] = origin[i], 0.0, 0.0
        put_point(places[carriers[link]], origin[0], origin[1], origin[2], place)
        for c in range(count):
            sign = acts[link, owners[c]]
            if sign != 0.0:
                for i in range(3):
                    arm[i] = points[c, i] - place[i]
                cross(arm, forces[c], moment)
                for i in range(3):
                    push[4 + i] += sign * forces[c, i]
                    push[7 + i] += sign * moment[i]
