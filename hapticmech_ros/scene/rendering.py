"""What renders the mechanism in a scene: perception, device, hand."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from hapticmech_ros.scene.part import NonNegative, Part, Positive, Vector3


class Perception(Part):
    """Which directions count as rigid, in s = sqrt(mu) (docs/notation.md).

    Control weighs directions smoothly from 1 at ``s_on`` to 0 at ``s_off``; the reported count
    switches on below ``s_on`` and off above ``s_off``, each after ``dwell`` seconds.
    """

    s_on: Annotated[Positive, Field(lt=1.0)] = 0.02
    s_off: Annotated[Positive, Field(lt=1.0)] = 0.05
    dwell: NonNegative = 0.005


class Device(Part):
    """Impedance-type haptic device, as a rigid body driven by hand and actuators.

    Attributes:
        mass: kg.
        inertia: principal moments about the point held, kg m^2, isotropic.
        damping: N s/m.
        angular_damping: N m s/rad.
        force_limit: N, saturation of the actuators' force (norm).
        torque_limit: N m, saturation of the actuators' torque (norm).
        position_resolution: m, encoder step per axis; 0 is ideal.
        angle_resolution: rad, encoder step of the rotation vector per axis; 0 is ideal.
        velocity_filter: Hz, cut-off of the velocity estimate when an encoder step is set.
        substeps: integration steps per sample period.
    """

    mass: Positive = 0.3
    inertia: Positive = 3.0e-4
    damping: NonNegative = 0.0
    angular_damping: NonNegative = 0.0
    force_limit: Positive = 20.0
    torque_limit: Positive = 1.0
    position_resolution: NonNegative = 0.0
    angle_resolution: NonNegative = 0.0
    velocity_filter: Positive = 100.0
    substeps: Annotated[int, Field(strict=True, ge=1, le=100)] = 4


class ConstantWrenchHand(Part):
    """Hand that pushes with a constant wrench, world axes, at the point held (N, N m)."""

    kind: Literal["constant_wrench"]
    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)
    start_delay: NonNegative = 0.25


class Waypoint(Part):
    """Target of the hand from where it took hold: displacement (m) and rotation vector (rad)."""

    time: NonNegative
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rotation: Vector3 = (0.0, 0.0, 0.0)


class SpringDamperHand(Part):
    """Hand as a spring and damper between the point held and a target that visits waypoints."""

    kind: Literal["spring_damper"]
    stiffness: Positive = 300.0
    damping: NonNegative = 5.0
    angular_stiffness: Positive = 1.0
    angular_damping: NonNegative = 0.01
    waypoints: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    start_delay: NonNegative = 0.25


Hand = Annotated[ConstantWrenchHand | SpringDamperHand, Field(discriminator="kind")]


class Experiment(Part):
    """How long the experiment lasts after the hand starts, in s."""

    duration: Positive = 5.0
