# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulator has to offer to take part: restart, advance, read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.accuracy.cases import Output
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import Simulator

EXTRA = "pip install '.[bench]'"
# A revolute closure is two points of its axis on each other, m: five independent rows out of six.
AXIS_POINTS = (0.0, 0.2)
Reading = list[tuple[float, ...]]
# Of how closures are kept, each a number by name that the peer explains.
Setting = Mapping[str, float]
FREE: tuple[Setting, ...] = (MappingProxyType({}),)


class UnsuitableError(HapticMechError):
    """A scene that a peer cannot do, or not as the scene means it."""

    def __init__(self, peer: str, scene: str, reason: str) -> None:
        self.peer, self.scene, self.reason = peer, scene, reason
        super().__init__(f"{scene} by {peer}: {reason}")


class State(NamedTuple):
    """Where all start: q (nq,) and v (nv,) of our tree, on the closures."""

    q: Array
    v: Array


class Contender(Protocol):
    """A simulator with a scene, an integrator and a step. Only :meth:`advance` is timed."""

    def restart(self) -> None:
        """Go back to the initial state."""

    def advance(self, steps: int) -> None:
        """Take so many steps.

        Raises:
            ArithmeticError, HapticMechError, RuntimeError: the motion is lost.
        """

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad: one number per component."""


@dataclass(frozen=True, slots=True)
class Method:
    """An integrator of a peer.

    Attributes:
        name: as the peer calls it.
        order: of its error, which says what steps are worth a run.
        settings: that are tried where there are closures; the one that comes closest at a step is
            timed.
        multiples: steps in units of a problem; by order if empty.
    """

    name: str
    order: int
    settings: tuple[Setting, ...] = FREE
    multiples: tuple[float, ...] = ()

    def settings_for(self, scene: Scene) -> tuple[Setting, ...]:
        """Return the settings that matter to a scene."""
        return self.settings if any(closure.active for closure in scene.closures) else FREE


@dataclass(frozen=True, slots=True)
class Peer:
    """A simulator.

    Attributes:
        name: for tables and plots, and of what is imported.
        methods: integrators that are tried.
        contender: returns a scene ready to run, from a start by a method with a step (s) and a
            setting; raises UnsuitableError if it is not a scene for this peer or method.
    """

    name: str
    methods: tuple[Method, ...]
    contender: Callable[[Scene, State, Method, float, Setting], Contender]


def setting_text(setting: Setting) -> str:
    """Return a setting for people."""
    return ", ".join(f"{name} {value:g}" for name, value in setting.items())


def initial_state(scene: Scene) -> State:
    """Return the scene's initial state with its closures met.

    Raises:
        ClosureError: the scene cannot close.
    """
    state = Simulator(scene).initial_state()
    return State(state.q, state.v)


def joint_efforts(tree: TreeModel) -> Array:
    """Return (nv,) constant efforts in the joints of a tree, N m or N."""
    efforts = np.zeros(tree.pinocchio.nv)
    for index, joint in enumerate(tree.joints):
        efforts[tree.velocity_slice(index)] = joint.effort
    return efforts


def refuse_what_no_peer_has(scene: Scene, peer: str) -> None:
    """Check that a scene holds only what simulators agree on.

    Args:
        scene: to check.
        peer: its name.

    Raises:
        UnsuitableError: regularised friction, stops of Hunt and Crossley's kind, or gears.
    """
    if scene.couplings:
        raise UnsuitableError(peer, scene.name, f"gear {scene.couplings[0].name}")
    for link in scene.links:
        if link.joint.friction:
            raise UnsuitableError(peer, scene.name, f"friction in {link.joint.name}")
        if link.joint.limits is not None:
            raise UnsuitableError(peer, scene.name, f"stops of {link.joint.name}")
