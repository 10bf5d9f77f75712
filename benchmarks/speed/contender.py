# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulator has to offer to take part: restart, advance, read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

from benchmarks.accuracy.cases import Output
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import Simulator

EXTRA = "pip install '.[bench]'"
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


class Peer(Protocol):
    """A simulator."""

    @property
    def name(self) -> str:
        """For tables and plots."""

    @property
    def methods(self) -> tuple[Method, ...]:
        """Integrators that are tried."""

    def missing(self) -> str:
        """Return why it cannot run here, empty if it can."""

    def contender(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> Contender:
        """Return the scene ready to run.

        Raises:
            UnsuitableError: not a scene for this peer or method.
        """


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


def joint_place(tree: TreeModel, name: str) -> int:
    """Return where a revolute or prismatic joint's coordinate is in q.

    Raises:
        InvalidInputError: no such joint, or one with other coordinates.
    """
    simple = {
        joint: index
        for index, (joint, kind) in enumerate(zip(tree.joint_names, tree.joint_types, strict=True))
        if kind in ("revolute", "prismatic")
    }
    if name not in simple:
        rule = f"must be one of the revolute and prismatic joints {list(simple)}"
        raise InvalidInputError("joint", name, rule)
    return int(tree.position_slice(simple[name]).start)
