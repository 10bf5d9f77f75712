# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels: the points of contact at a period's start, in case it is not completed."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, put
from hapticmech_ros.contact.layout import FOUND, NOW, Contacts


@inner
def _copy(count: int, source: Array, target: Array) -> None:
    for k in range(count):
        for i in range(source.shape[1]):
            target[k, i] = source[k, i]


@inner
def keep(contacts: Contacts) -> None:
    """Keep points and forces as they are."""
    count, owners, kept = contacts.counts[NOW], contacts.owners, contacts.kept_owners
    put(contacts.kept_counts, contacts.counts)
    for k in range(count):
        kept[k] = owners[k]
    _copy(count, contacts.points, contacts.kept_points)
    _copy(count, contacts.forces, contacts.kept_forces)
    _copy(count, contacts.origins, contacts.kept_origins)
    put(contacts.kept_joint_force, contacts.joint_force)
    put(contacts.kept_report, contacts.report)


@inner
def restore(contacts: Contacts) -> None:
    """Put points and forces back as they were kept."""
    found = contacts.counts[FOUND]
    put(contacts.counts, contacts.kept_counts)
    contacts.counts[FOUND] = found
    count, owners, kept = contacts.counts[NOW], contacts.owners, contacts.kept_owners
    for k in range(count):
        owners[k] = kept[k]
    _copy(count, contacts.kept_points, contacts.points)
    _copy(count, contacts.kept_forces, contacts.forces)
    _copy(count, contacts.kept_origins, contacts.origins)
    put(contacts.joint_force, contacts.kept_joint_force)
    put(contacts.report, contacts.kept_report)
