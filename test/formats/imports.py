# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What tests of files have in common: a scene as Pinocchio's model, in the names of its file."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin

from hapticmech_ros import load_scene
from hapticmech_ros.formats import read_model
from hapticmech_ros.formats.shapes import notes_of_shapes
from hapticmech_ros.formats.stops import with_metrics, with_stops
from hapticmech_ros.mechanism.model import build_tree, se3
from hapticmech_ros.scene import scene_from_document

PROBE = {"kind": "sphere", "radius": 0.01}
HAND = {"kind": "constant_wrench"}


def notes_in(imported):
    """Return what is said of a file, its shapes included, none of which is in the scene."""
    return [*imported.notes, *notes_of_shapes(imported)]


class Read:
    """A file's mechanism as ours: the tree, and the file's names in it."""

    def __init__(self, path, free_base=False):
        self.imported = read_model(path, free_base)
        points = [{"name": "held", "link": self.imported.tips[0]}]
        document = {"format": "hapticmech-scene/1", "hand": HAND, "operational_points": points}
        document |= self.imported.document
        document.pop("couplings", None)
        self.scene = scene_from_document(with_stops(with_metrics(document), str(path)))
        self.tree = build_tree(self.scene)
        self.model = self.tree.pinocchio
        self.data = self.model.createData()

    @property
    def notes(self):
        return {note.what: note.count for note in notes_in(self.imported)}

    def joint(self, name):
        """Return the number of a joint in our model, by the file's name."""
        return self.model.getJointId(self.imported.joints[name])

    def written(self, name):
        """Return the joint as the scene has it, by the file's name."""
        ours = self.imported.joints[name]
        return next(link.joint for link in self.scene.links if link.joint.name == ours)

    def inertia(self, q):
        full = np.triu(pin.crba(self.model, self.data, q))
        return full + np.triu(full, 1).T

    def bias(self, q, v):
        return pin.nonLinearEffects(self.model, self.data, q, v).copy()

    def pose(self, name, q):
        """Return where a frame of the file is."""
        pin.forwardKinematics(self.model, self.data, q)
        link, place = self.imported.places[name]
        joint, own = self.tree.link_joint[link]
        return self.data.oMi[joint] * own * place


def random_state(model, rng):
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    return q, rng.normal(size=model.nv)


def scene_naming_all(path, base="fixed"):
    """Write a scene beside a model, in which contacts name all shapes of it; return it loaded."""
    imported = read_model(path, base == "free")
    shapes = [{"name": "here", "link": "world", "geometry": PROBE}]
    shapes.append({"name": "there", "link": imported.tips[0], "geometry": PROBE})
    contacts = []
    for name, solid in imported.shapes.items():
        moves = carried(imported, imported.places[solid.body][0])
        contact = {"name": f"c{len(contacts)}", "a": name, "b": "here" if moves else "there"}
        contacts.append({**contact, "stiffness": 1.0})
    document = {"format": "hapticmech-scene/1", "model": {"file": path.name, "base": base}}
    scene = path.parent / "naming_all.yaml"
    scene.write_text(json.dumps({**document, "shapes": shapes, "contacts": contacts}))
    return load_scene(scene)


def carried(imported, name):
    """Return whether a joint moves a link."""
    links = {link["name"]: link for link in imported.document["links"]}
    while name in links:
        if links[name]["joint"]["type"] != "fixed":
            return True
        name = links[name]["parent"]
    return False


def shape_pose(read, shape, q):
    """Return where a shape of a scene is in the world."""
    pin.forwardKinematics(read.model, read.data, q)
    if shape.link == "world":
        return se3(shape.origin)
    joint, own = read.tree.link_joint[shape.link]
    return read.data.oMi[joint] * own * se3(shape.origin)


def supports(points, pose):
    """Return how far points (n, 3), moved to a place, reach along a few directions."""
    directions = np.random.default_rng(5).normal(size=(40, 3))
    return ((points @ pose.rotation.T + pose.translation) @ directions.T).max(axis=0)
