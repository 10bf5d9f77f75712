# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps with contacts beside the kernel: Pinocchio's kinematics, and steps of no contacts.

Near test, points and forces are the kernel's own functions, run as Python on what Pinocchio and the
dense factorisation say; everything around them is independent of the kernel.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from hapticmech_ros.contact.impact_kernels import MOST_PARTS
from hapticmech_ros.contact.layout import Contacts
from hapticmech_ros.contact.solver_kernels import contact_forces
from hapticmech_ros.contact.step_kernels import SLACK, STEPS_AHEAD, contact_effects
from hapticmech_ros.contact.stepping import ContactStepper
from hapticmech_ros.contact.touch_kernels import near_pairs, place_shapes, touching_points
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.kernels.model import DENSE
from hapticmech_ros.simulation import Simulator


class ContactLoop:
    """A scene with contacts, stepped a substep at a time."""

    def __init__(self, scene):
        plan = scene.simulation
        self.step_size = plan.period / plan.substeps
        self._scene = scene.model_copy(update={"contacts": (), "shapes": ()})
        self._simulators = {}
        self.alone = self._stepping(self.step_size)
        self._model = self.alone.mechanism.model
        # Of production nothing but the arrays that describe the scene.
        stepper = ContactStepper(Mechanism(scene))
        self._arrays, self._links = stepper.memory.arrays, stepper.memory.links
        self.contacts = Contacts(*self._arrays)
        self.held = 0.0
        self.forces = np.zeros((0, 3))

    def _stepping(self, step):
        """Return the simulator of the mechanism alone with steps of this length, s."""
        if step not in self._simulators:
            plan = self._scene.simulation.model_copy(update={"period": step, "substeps": 1})
            scene = self._scene.model_copy(update={"simulation": plan})
            self._simulators[step] = Simulator(scene)
        return self._simulators[step]

    def step(self, state, wrenches):
        """Return the state a substep later."""
        return self._after(state, wrenches, self.step_size)

    def _after(self, state, wrenches, step):
        contacts, q, v = self.contacts, state.q, state.v
        axes, places = self._kinematics(q)
        place_shapes(contacts, SimpleNamespace(joint_jacobian=axes, places=places))
        terms = self.alone.evaluate(state)
        force = sum(w @ one.jacobian for w, one in zip(wrenches, terms.points, strict=True))
        contacts.free[:] = v + step * terms.acceleration(force)[0]
        near_pairs(contacts, contacts.free, STEPS_AHEAD * step, SLACK)
        count, space, external = touching_points(*self._arrays), terms.space, {}
        contacts.report.values[:] = 0.0
        if count:
            halfway = pin.integrate(self._model, q, 0.5 * step * (v + contacts.free))
            later, _ = self._kinematics(halfway)
            model = SimpleNamespace(nv=v.size, path=DENSE, along=np.zeros(space.rank))
            metric = SimpleNamespace(
                factor=space.factor,
                basis=np.array(space.basis.T),
                tail=SimpleNamespace(rank=space.rank),
            )
            parts = contact_forces(model, metric, contacts, later, v, step, count)
            if parts > 1:
                parts = min(parts, MOST_PARTS)
                contacts.settings.is_part = 1.0
                for _ in range(parts):
                    state = self._after(state, wrenches, step / parts)
                contacts.settings.is_part = 0.0
                return state
            contact_effects(contacts, places, count)
            rows = contacts.external[: len(self._links), 4:]
            external = {link: row.copy() for link, row in zip(self._links, rows, strict=True)}
        self.held, self.forces = float(contacts.report.energy), contacts.forces[:count].copy()
        return self._stepping(step).step(state, wrenches, external)

    def _kinematics(self, q):
        """Return joint axes (nv, 6) about the world's origin, and poses of joints (joints, 12)."""
        data = self._model.createData()
        pin.computeJointJacobians(self._model, data, q)
        places = [np.concatenate((pose.rotation.T.ravel(), pose.translation)) for pose in data.oMi]
        return np.ascontiguousarray(data.J.T), np.array(places)
