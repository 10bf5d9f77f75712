# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What viewer and live page have in common: who the users are, and what is heard of all."""

from __future__ import annotations

from typing import TypeVar

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.grasp import flat_grasps, grasp_of
from hapticmech_ros.nodes.actor import ClockedActor
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.parameters import OnlookerParameters
from hapticmech_ros.nodes.viewer.scene_inputs import Heard, SceneInputs
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.counter import rigid_count
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.wire.topic import user_prefixes

P = TypeVar("P", bound=OnlookerParameters)


class Onlooker(ClockedActor[P]):
    """Hears a mechanism and all who hold it.

    Attributes:
        users: operational points that are held, in their order.
        prefixes: what is before the names of a user's topics, by its point.
        mechanism: of the graph.
        inputs: what is heard.

    Raises:
        InvalidInputError: no such operational point, or one that is named twice.
    """

    def __init__(self, node: Host, parameters: P) -> None:
        super().__init__(node, parameters)
        self.users = self._held(parameters)
        self.prefixes = user_prefixes(self.users)
        self.mechanism = Mechanism(self.shared_scene)
        self.inputs = SceneInputs(self, self.mechanism, self.prefixes)
        self._grasps = flat_grasps(self.shared_scene)
        self._analyse_anew()

    def apply_parameters(self, parameters: P) -> None:
        """Take new parameters."""
        super().apply_parameters(parameters)
        self._timeout_ns = nanoseconds(parameters.input_timeout)

    def activate(self) -> None:
        """Begin with what comes from now on."""
        self.inputs.forget()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether a tick can be done: always, with what there is."""
        del deadline_ns
        return True

    def analyser(self, user: str) -> Analyser:
        """Return the analyser of the point that a user holds."""
        return self._analysers[user]

    def followed(self, grasps: Array) -> bool:
        """Put operational points where the mechanism says that they are.

        Args:
            grasps: (points, 7) see :func:`~hapticmech_ros.mechanism.grasp.flat_grasps`.

        Returns:
            Whether they were elsewhere before.

        Raises:
            InvalidInputError: points that the scene cannot have.
        """
        if (grasps == self._grasps).all():
            return False
        mechanism = self.mechanism
        for name, numbers in zip(mechanism.point_names, grasps, strict=True):
            mechanism.set_operational_point(grasp_of(mechanism.scene, name, numbers))
        self._grasps = grasps
        self._analyse_anew()
        return True

    def count(self, user: str, heard: Heard, s: Array) -> int:
        """Return how many joint constraints a user feels: as heard, or else found from s.

        Args:
            user: by the point held.
            heard: what is known.
            s: (t,) of the spectrum at that point.
        """
        counted = heard.users[user].count
        return rigid_count(s, self.scene.perception) if counted is None else counted

    def _analyse_anew(self) -> None:
        self._analysers = {user: Analyser(self.mechanism, user) for user in self.users}

    def _held(self, parameters: P) -> tuple[str, ...]:
        named = parameters.held_points.split(",") if parameters.held_points else []
        if not named and parameters.operational_point:
            named = [self.point]
        scene = self.shared_scene
        points = named or scene.held_points
        found = tuple(scene.operational_point(name.strip()).name for name in points)
        if len(set(found)) < len(found):
            raise InvalidInputError("held_points", found, "each point can be held once")
        return found
