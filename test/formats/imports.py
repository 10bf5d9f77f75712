"""What tests of files have in common: a scene as Pinocchio's model, in the names of its file."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats import read_model
from hapticmech_ros.formats.stops import with_metrics, with_stops
from hapticmech_ros.mechanism.model import build_tree
from hapticmech_ros.scene import scene_from_document

HAND = {"kind": "constant_wrench"}


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
        return {note.what: note.count for note in self.imported.notes}

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
