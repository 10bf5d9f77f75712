# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What tests of files have in common: a scene as Pinocchio's model, in the names of its file."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
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
        return mass_matrix(self.model, self.data, q)

    def bias(self, q, v):
        return pin.nonLinearEffects(self.model, self.data, q, v).copy()

    def pose(self, name, q):
        """Return where a frame of the file is."""
        pin.forwardKinematics(self.model, self.data, q)
        link, place = self.imported.places[name]
        joint, own = self.tree.link_joint[link]
        return self.data.oMi[joint] * own * place


def saved(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def beside(path, said="", model=""):
    """Return the scene of a file beside a model, that says this of it."""
    text = f"format: hapticmech-scene/1\nmodel: {model or path.name}\n{said}\n"
    return load_scene(saved(path.parent, "scene.yaml", text))


def refused(path, rule):
    """Assert that a file breaks one rule, and return where: a line and element of the file."""
    with pytest.raises(SceneError) as caught:
        read_model(path)
    (problem,) = caught.value.problems
    assert rule in problem.rule
    assert str(path) in str(caught.value)
    assert problem.key_path.startswith("line")
    return problem.key_path


def counts_in(imported):
    """Return how many of what is said of a file, its shapes included."""
    return {note.what: note.count for note in notes_in(imported)}


def mass_matrix(model, data, q):
    """Return D (nv, nv) of a model of Pinocchio's, which computes a half of it."""
    upper = np.triu(pin.crba(model, data, q))
    return upper + np.triu(upper, 1).T


def in_order_of(ours, theirs, names):
    """Return where each rate of theirs is among ours; and q as ours from q as theirs."""
    rates, q_from = np.zeros(theirs.nv, dtype=int), []
    for name in names:
        joint = theirs.joints[theirs.getJointId(name)]
        own = ours.model.joints[ours.joint(name)]
        assert own.nv == joint.nv
        rates[joint.idx_v : joint.idx_v + joint.nv] = range(own.idx_v, own.idx_v + own.nv)
        q_from.append((own.idx_q, own.nq, joint.idx_q, joint.nq))

    def convert(q):
        found = np.zeros(ours.model.nq)
        for at, size, there, size_there in q_from:
            part = q[there : there + size_there]
            turned = size == 1 and size_there == 2
            found[at : at + size] = np.arctan2(part[1], part[0]) if turned else part
        return found

    return rates, convert


def same_dynamics(ours, theirs, error, names=()):
    """Yield three states of a model of Pinocchio's, with data, at which all is the same as in ours.

    Args:
        ours: a file as :class:`Read` has it.
        theirs: model of Pinocchio's.
        error: of inertia and bias forces, as a share of the largest of each.
        names: of their joints; empty where these come in the same order.

    Yields:
        Their q, and ours.
    """
    theirs.gravity.linear = ours.model.gravity.linear = np.array((0.3, -0.2, -9.81))
    assert ours.model.nv == theirs.nv
    rates, convert = in_order_of(ours, theirs, names) if names else (np.arange(theirs.nv), np.array)
    data, rng = theirs.createData(), np.random.default_rng(1)
    for _ in range(3):
        q, v = random_state(theirs, rng)
        at, rate = convert(q), np.zeros(theirs.nv)
        rate[rates] = v
        full = mass_matrix(theirs, data, q)
        inertia = ours.inertia(at)[np.ix_(rates, rates)]
        assert np.abs(inertia - full).max() <= error * np.abs(full).max()
        bias = pin.nonLinearEffects(theirs, data, q, v)
        assert np.abs(ours.bias(at, rate)[rates] - bias).max() <= error * np.abs(bias).max()
        yield q, at


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
