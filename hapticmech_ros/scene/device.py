# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The haptic device of a scene: its mechanics, its actuators and its sensors.

Real devices that a scene can name, with figures and their sources, are in ``config/devices``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from hapticmech_ros.errors import listed
from hapticmech_ros.files import shared
from hapticmech_ros.files.yaml_text import read_yaml
from hapticmech_ros.scene.part import (
    AsAngle,
    Flag,
    Name,
    NonNegative,
    Part,
    Positive,
    Real,
    Vector3,
)


@dataclass(frozen=True, slots=True)
class DevicePreset:
    """A real device.

    Attributes:
        name: in scenes.
        description: manufacturer and model, and its moving parts.
        sources: of the figures.
        chosen: keys without a published figure, and how it was chosen.
        device: keys of a scene's ``device``, SI units.
    """

    name: str
    description: str
    sources: tuple[str, ...]
    chosen: Mapping[str, str]
    device: Mapping[str, Any]


@cache
def device_presets() -> Mapping[str, DevicePreset]:
    """Return the devices that come with the package, by name."""
    folder = shared("config/devices")
    found = {}
    for path in sorted(folder.glob("*.yaml")) if folder is not None else ():
        document = read_yaml(path.read_text(encoding="utf-8"), str(path))
        found[path.stem] = DevicePreset(
            path.stem,
            document["description"],
            tuple(document["sources"]),
            MappingProxyType(document["chosen"]),
            MappingProxyType(document["device"]),
        )
    return MappingProxyType(found)


ForceSensor = Literal["measured", "estimated", "absent"]


class Workspace(Part):
    """End stops of the real device: a ball about where it starts, and a cone of rotations.

    Beyond the limit, a spring and damper push back inwards, and never pull.

    Attributes:
        radius: m; 0 is unlimited.
        angle: rad, of the rotation from where it starts; 0 is unlimited.
        stiffness: N/m.
        damping: N s/m.
        angular_stiffness: N m/rad.
        angular_damping: N m s/rad.
    """

    radius: NonNegative = 0.0
    angle: Annotated[NonNegative, Field(le=3.0), AsAngle] = 0.0
    stiffness: Positive = 20000.0
    damping: NonNegative = 50.0
    angular_stiffness: Positive = 20.0
    angular_damping: NonNegative = 0.05


class Compensation(Part):
    """Wrenches that the driver adds to commands to hide the device's own weight and friction.

    Attributes:
        gravity: whether actuators carry ``gravity_load``.
        friction: share of viscous and Coulomb friction that actuators give back, below 1: if all of
            it were, an overestimated friction would drive the device.
        dead_zone: m/s; below this speed friction is not compensated, above twice this speed by the
            whole share: noise at rest then causes no chatter.
        angular_dead_zone: rad/s, the same of rotation.
    """

    gravity: Flag = False
    friction: Annotated[Real, Field(ge=0.0, lt=1.0)] = 0.0
    dead_zone: Positive = 0.01
    angular_dead_zone: Positive = 0.2


class Safety(Part):
    """How far a node's parameters may go; the device node's envelope keeps to it.

    Attributes:
        force_slew: N/s, fastest change of the force.
        torque_slew: N m/s, fastest change of the torque.
        start_ramp: s, shortest time over which force and torque limit open when commands begin.
        workspace_radius: m, furthest from where the device starts that a force points outwards;
            0 is anywhere.
        command_timeout: s, longest that a command stands, and that a controller commands from its
            last inputs; 12 ms, a node's own at 1 kHz, are always allowed.
    """

    force_slew: Positive = 2000.0
    torque_slew: Positive = 100.0
    start_ramp: NonNegative = 0.1
    workspace_radius: NonNegative = 0.0
    command_timeout: Annotated[Real, Field(ge=0.012, le=1.0)] = 0.1


# Of a spring that is sampled and held, and the device's mass: the most of ω T, the angle by which
# they oscillate in a period T. With a damping ratio ζ it is stable for ω T < 4 ζ and ζ ω T < 1;
# this leaves room for the lag of a velocity filter.
SERVO_ANGLE = 0.25


def most_servo_stiffness(inertia: float, period: float, limit: float, slew: float) -> float:
    """Return the largest stiffness of a commanded pose, N/m of a mass or N m/rad of an inertia.

    A force that oscillates between its limits at ω changes by up to ``limit`` ω a second: where it
    may not change as fast, it lags, and a push makes it oscillate for ever.

    Args:
        inertia: kg, or kg m².
        period: of samples, s.
        limit: of the force, N, or the torque, N m.
        slew: fastest change of that, N/s or N m/s.
    """
    return min(SERVO_ANGLE / period, slew / limit) ** 2 * inertia


class Servo(Part):
    """Impedance between the device and a pose that CRTK's ``servo_cp`` or ``hold`` commands.

    Attributes:
        stiffness: N/m; left out: 200, or less if period, mass and slew limit allow no more.
        angular_stiffness: N m/rad; left out: 0.1, or less, likewise.
        damping_ratio: of the device alone on that stiffness; 1 is critical damping.
    """

    stiffness: Positive | None = None
    angular_stiffness: Positive | None = None
    damping_ratio: Annotated[Real, Field(ge=0.4, le=2.0)] = 0.7


class Motion(Part):
    """The fastest possible motion of the device; faster samples are refused as faults.

    Attributes:
        speed: m/s.
        angular_speed: rad/s.
        acceleration: m/s^2.
        angular_acceleration: rad/s^2.
    """

    speed: Positive = 5.0
    angular_speed: Positive = 100.0
    acceleration: Positive = 500.0
    angular_acceleration: Positive = 20000.0


class Device(Part):
    """Impedance-type haptic device, as a rigid body driven by hand and actuators.

    Attributes:
        preset: name of a real device, whose figures are the defaults of the other keys; see
            docs/devices.md.
        mass: kg.
        inertia: principal moments about the point held, kg m^2, isotropic.
        damping: N s/m.
        angular_damping: N m s/rad.
        coulomb_friction: N, of translation: below this force a device at rest stays at rest.
        angular_coulomb_friction: N m, of rotation.
        gravity_load: N, world axes, the unbalanced part of the device's weight.
        force_limit: N, saturation of the actuators' force (norm).
        torque_limit: N m, saturation of the actuators' torque (norm).
        actuated: motions with actuators; without those of rotation the torque is zero, and the
            handle turns freely with its inertia; see the scene's ``task``.
        actuator_bandwidth: Hz, of a first-order lag between command and wrench; 0 is ideal.
        position_resolution: m, encoder step per axis; 0 is ideal.
        angle_resolution: rad, encoder step of the rotation vector per axis; 0 is ideal.
        velocity_filter: Hz, cut-off of the velocity estimate when an encoder step is set.
        force_sensor: source of the hand's wrench: measured by a sensor under the hand, estimated
            from motion and actuators, or absent: reported as zero.
        observer_bandwidth: Hz, of the estimate.
        servo_axes: of the wrenches that a driver takes and measures: those of ``world``, or its
            own, on CRTK's ``body/servo_cf`` and ``body/measured_cf``. Of drivers without
            ``device/state``; the simulated device has those of ``world``.
        workspace: end stops.
        motion: its fastest possible motion.
        compensation: by the device's driver.
        servo: gains for commanded poses.
        safety: bounds of a node's safety parameters.
        substeps: integration steps per sample period.
    """

    preset: Name | None = None
    mass: Positive = 0.3
    inertia: Positive = 3.0e-4
    damping: NonNegative = 0.0
    angular_damping: NonNegative = 0.0
    coulomb_friction: NonNegative = 0.0
    angular_coulomb_friction: NonNegative = 0.0
    gravity_load: Vector3 = (0.0, 0.0, 0.0)
    force_limit: Positive = 20.0
    torque_limit: Positive = 1.0
    actuated: Literal["all", "translation"] = "all"
    actuator_bandwidth: NonNegative = 0.0
    position_resolution: NonNegative = 0.0
    angle_resolution: NonNegative = 0.0
    velocity_filter: Positive = 100.0
    force_sensor: ForceSensor = "measured"
    observer_bandwidth: Positive = 30.0
    servo_axes: Literal["world", "body"] = "world"
    workspace: Workspace = Workspace()
    motion: Motion = Motion()
    compensation: Compensation = Compensation()
    servo: Servo = Servo()
    safety: Safety = Safety()
    substeps: Annotated[int, Field(strict=True, ge=1, le=100)] = 4

    @property
    def acts(self) -> tuple[float, ...]:
        """1 for each of the six coordinates that actuators drive, 0 for others."""
        return (1.0,) * 6 if self.actuated == "all" else (1.0,) * 3 + (0.0,) * 3

    @property
    def inertias(self) -> tuple[float, ...]:
        """Diagonal of Λ_d (6,): mass, kg, and inertia, kg m²."""
        return (self.mass,) * 3 + (self.inertia,) * 3

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, given: object) -> object:
        """Add the preset's figures for keys that are left out.

        ``workspace`` and ``compensation`` are merged key by key too. An unknown preset adds none.
        """
        if not isinstance(given, Mapping) or not isinstance(given.get("preset"), str):
            return given
        preset = device_presets().get(given["preset"])
        if preset is None:
            return given
        joined = {**preset.device, **given}
        for key, value in preset.device.items():
            own = given.get(key)
            if isinstance(value, Mapping) and isinstance(own, Mapping):
                joined[key] = {**value, **own}
        return joined

    @field_validator("preset")
    @classmethod
    def _known(cls, preset: str | None) -> str | None:
        known = sorted(device_presets())
        if preset is not None and preset not in known:
            raise ValueError(f"unknown device: must be one of {listed(known)}")
        return preset
