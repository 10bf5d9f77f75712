# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keys of a scene: the frozen, validated description of one haptic simulation.

All quantities are SI. Frames and origins follow the conventions of URDF: ``origin.xyz`` in metres
and ``origin.rpy`` in radians (fixed-axis roll, pitch, yaw) place a child frame in its parent's.
Unknown keys, NaN, wrong sizes and wrong types are refused; nothing is converted silently.

It also limits the numbers that a scene's nodes accept and send, far above those it needs.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import Field, model_validator

from hapticmech_ros.scene.contacts import ContactPair, Shape
from hapticmech_ros.scene.controller import Connection, Controller, Experiment, Perception, by_rule
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import Hand
from hapticmech_ros.scene.mechanism import (
    Closure,
    Coupling,
    InitialState,
    Link,
    OperationalPoint,
    Simulation,
    Spring,
)
from hapticmech_ros.scene.part import Name, Part, Positive, Vector3

# Products of several such numbers, and of a scene's own, stay finite.
Limit = Annotated[Positive, Field(le=1e15)]


class Limits(Part):
    """Largest sizes of the numbers in messages; larger ones are refused, and never sent.

    They do not protect the hand (``device.force_limit`` and the safety of the device's node do),
    but detect mistaken numbers.

    Attributes:
        position: m, of devices, operational points and grasps, per axis.
        linear_velocity: m/s, per axis.
        angular_velocity: rad/s, per axis.
        joint_position: rad or m, of every joint; a shaft may turn for hours.
        joint_velocity: rad/s or m/s.
        force: N, per axis, of every command, push and measurement.
        torque: N m, per axis.
        stiffness: N/m, N and N m/rad, of the gains that the device receives.
        damping: N s/m, N s and N m s/rad, of the same.
        ratio: of the projectors P_c and Π, of G, and of singular values; 1, m, 1/m.
        inverse_inertia: 1/kg, 1/(kg m) and 1/(kg m²), of Λ_h⁻¹.
        acceleration: m/s² and rad/s², of an operational point that no hand holds.
        energy: J, that a controller sends to the device.
    """

    position: Limit = 1e3
    linear_velocity: Limit = 1e3
    angular_velocity: Limit = 1e5
    joint_position: Limit = 1e9
    joint_velocity: Limit = 1e5
    force: Limit = 1e6
    torque: Limit = 1e6
    stiffness: Limit = 1e9
    damping: Limit = 1e9
    ratio: Limit = 1e9
    inverse_inertia: Limit = 1e12
    acceleration: Limit = 1e12
    energy: Limit = 1e12


S = TypeVar("S", bound="SceneDocument")
TaskSpace = Literal["planar", "spatial"]
Task = Literal["pose", "position"]
# Rows of a six-vector, force first, that a planar scene has: x, y, and rotation about z.
PLANAR = (0, 1, 5)


class HeldPoint(Part):
    """One of several hands on the mechanism: its point, device, gains and connection.

    Keys left out are the scene's own; gains left out follow from this device and this connection by
    the rule.

    Attributes:
        point: operational point that it holds; each is held once.
        hand: that holds the device.
        device: that renders.
        controller: gains.
        connection: between device and controller.
    """

    point: Name
    hand: Hand | None = None
    device: Device | None = None
    controller: Controller | None = None
    connection: Connection | None = None


class SceneDocument(Part):
    """One virtual mechanism, the device that renders it, the hand that moves it, and the gains.

    Each key is valid by itself; a :class:`~hapticmech_ros.scene.scene.Scene` keeps the rules
    between keys as well (:mod:`~hapticmech_ros.scene.rules`).

    Attributes:
        format: of the file.
        name: of the scene.
        description: for people.
        task_space: ``planar``: all moves in the world's x-y plane, and the device renders only
            forces in it and torques about z.
        task: coupling of device and operational point: the ``pose``, or the ``position`` alone, as
            by a ball joint. A device without torques renders a link that turns as it moves
            correctly only with ``position``, or if the hand turns the handle along.
        gravity: m/s², world axes.
        links: rigid bodies with their joints, in any order.
        closures: that close loops.
        couplings: gears and cams between joints.
        springs: between points.
        shapes: that may touch.
        contacts: pairs of shapes that do.
        operational_points: where a hand can hold the mechanism; the first one is held unless
            another is chosen.
        initial_state: positions and velocities at the start.
        simulation: step and integrator.
        perception: which directions count as rigid.
        device: that renders.
        hand: that holds the device.
        controller: gains.
        connection: between device and controller.
        hands: of several users on one mechanism, each with a device; empty: one, at the first
            operational point.
        experiment: of ``hapticmech experiment`` and ``demo``.
        limits: of numbers in messages.
    """

    format: Literal["hapticmech-scene/1"]
    name: Name
    description: str = ""
    task_space: TaskSpace = "spatial"
    task: Task = "pose"
    gravity: Vector3 = (0.0, 0.0, 0.0)
    links: Annotated[tuple[Link, ...], Field(min_length=1)]
    closures: tuple[Closure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    springs: tuple[Spring, ...] = ()
    shapes: tuple[Shape, ...] = ()
    contacts: tuple[ContactPair, ...] = ()
    operational_points: Annotated[tuple[OperationalPoint, ...], Field(min_length=1)]
    initial_state: InitialState = InitialState()
    simulation: Simulation = Simulation()
    perception: Perception = Perception()
    device: Device = Device()
    hand: Hand
    controller: Controller = Controller()
    connection: Connection = Connection()
    hands: tuple[HeldPoint, ...] = ()
    experiment: Experiment = Experiment()
    limits: Limits = Limits()

    @property
    def moving_rows(self) -> tuple[int, ...]:
        """Rows of a six-vector, force first, in which things can move: all, or those of a plane."""
        return PLANAR if self.task_space == "planar" else tuple(range(6))

    @property
    def task_rows(self) -> tuple[int, ...]:
        """Rows of the task space: ``moving_rows``, or those of position among them."""
        return tuple(row for row in self.moving_rows if self.task == "pose" or row < 3)

    def held_by(self: S, entry: HeldPoint) -> S:
        """Return the scene as it is for one of its ``hands``."""
        own = {key: getattr(entry, key) for key in ("hand", "device", "controller", "connection")}
        update = {key: value for key, value in own.items() if value is not None}
        return self.model_copy(update={**update, "hands": ()})

    @model_validator(mode="after")
    def _gains_by_rule(self) -> SceneDocument:
        """Fill in gains that were not given; see :mod:`~hapticmech_ros.scene.controller`."""
        hands = tuple(
            entry.model_copy(update={"controller": _with_rule(self, entry)}) for entry in self.hands
        )
        controller = _with_rule(self, self)
        # The model is frozen.
        object.__setattr__(self, "controller", controller)
        object.__setattr__(self, "hands", hands)
        return self


def _with_rule(scene: SceneDocument, entry: SceneDocument | HeldPoint) -> Controller:
    """Return the gains of a scene or of one of its hands, by the rule where none were given."""
    controller = entry.controller or scene.controller
    device, connection = entry.device or scene.device, entry.connection or scene.connection
    joint = controller.joint_constraint
    found = by_rule(joint, device, connection, scene.simulation.period)
    return (
        controller if found is joint else controller.model_copy(update={"joint_constraint": found})
    )
