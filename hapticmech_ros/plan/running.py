# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that run for a scene, from which the plan takes its facts."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.device import ImpedanceDevice, device_for
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import Plan, plan_of
from hapticmech_ros.mechanism.redundancy import Redundancy, redundancy
from hapticmech_ros.mechanism.schemes import SCHEMES, Scheme
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import MechanismState, Simulator


@dataclass(frozen=True, slots=True)
class Running:
    """Objects of a scene at its start.

    Attributes:
        scene: they are made from.
        simulator: steps the mechanism.
        state: initial state, loops closed.
        analyser: of the operational point that is held.
        device: held by the hand.
        rows: rows, rank and mobility of the closures active there.
        stepping: integrator, period, substeps, Baumgarte's rate.
        scheme: the integrator's stages.
    """

    scene: Scene
    simulator: Simulator
    state: MechanismState
    analyser: Analyser
    device: ImpedanceDevice
    rows: Redundancy
    stepping: Plan
    scheme: Scheme

    @property
    def mechanism(self) -> Mechanism:
        """The simulator's mechanism."""
        return self.simulator.mechanism

    @property
    def flat(self) -> bool:
        """Whether q is a vector like v, so that steps are added to it."""
        return self.mechanism.nq == self.mechanism.nv

    @property
    def can_latch(self) -> tuple[str, ...]:
        """Names of the open closures that latch when their frames come near each other."""
        return tuple(
            loop.name
            for loop, on in zip(self.mechanism.closures, self.state.active, strict=True)
            if not on and loop.latch_distance is not None
        )


def running(scene: Scene, point: str = "") -> Running:
    """Build the objects that run for a scene, as a session does.

    Args:
        scene: to run.
        point: operational point that is held; the scene's first one if empty.

    Returns:
        The scene's objects at its start.

    Raises:
        InvalidInputError: no such point.
        ClosureError: the scene cannot close.
    """
    simulator = Simulator(scene)
    analyser = Analyser(simulator.mechanism, point)
    state = simulator.initial_state()
    stepping = plan_of(simulator.scene.simulation)
    return Running(
        scene,
        simulator,
        state,
        analyser,
        device_for(scene),
        redundancy(simulator.mechanism, state.q, state.active),
        stepping,
        SCHEMES[stepping.integrator],
    )
