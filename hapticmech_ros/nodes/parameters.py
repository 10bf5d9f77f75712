# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes: one frozen, validated model per node. Imports no ROS.

A change builds the whole model anew, so rules that concern several parameters hold at all times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args, get_origin

from annotated_types import Ge, Le
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from hapticmech_ros.control.tuning import SCENES, TUNED
from hapticmech_ros.device.real_device import MOST_BUTTONS
from hapticmech_ros.errors import HapticMechError, InvalidInputError, shown
from hapticmech_ros.nodes.timeouts import COMMAND, CONTROLLER_INPUT, MECHANISM_COMMAND, ByRate
from hapticmech_ros.system.cpu_list import cpus_of
from hapticmech_ros.system.discovery import Transport

# Never: given at the start. Unconfigured: only while nothing is built from it. Any: at any time.
Changes = Literal["never", "unconfigured", "any"]
RealtimeMode = Literal["auto", "on", "off"]
P = TypeVar("P", bound="NodeParameters")
# Safety parameters of a device's node and of its controller's, and the one that locks them at the
# node's start.
LOCK = "lock_safety"
# A prefix of frames like that of topics.
FROM_NAMESPACE = "auto"
SAFETY = (
    *("command_timeout", "force_limit", "torque_limit", "force_slew", "torque_slew"),
    *("start_ramp", "workspace_radius", "message_age_limit", "input_timeout", "soften"),
)


class ParameterError(HapticMechError):
    """A parameter that breaks a rule."""


def _cpu_list(given: object) -> object:
    """Return CPUs as a list in text: ROS makes an integer of one, and an array of several."""
    numbers = [given] if isinstance(given, int) else given
    if isinstance(numbers, Sequence) and all(type(number) is int for number in numbers):
        given = ",".join(map(str, numbers))
    try:
        cpus_of(given if isinstance(given, str) else shown(given))
    except InvalidInputError as error:
        raise ValueError(error.rule) from None
    return given


CpuList = Annotated[str, BeforeValidator(_cpu_list)]


def text(default: str, description: str, changes: Changes = "unconfigured") -> Any:
    """Return a field for a name or a choice."""
    return Field(default, description=description, json_schema_extra={"changes": changes})


def flag(default: bool, description: str, changes: Changes = "unconfigured") -> Any:
    """Return a field for yes or no."""
    return Field(default, description=description, json_schema_extra={"changes": changes})


def number(
    default: float,
    description: str,
    unit: str,
    low: float,
    high: float,
    changes: Changes = "any",
) -> Any:
    """Return a field for a number within bounds."""
    return Field(
        default,
        ge=low,
        le=high,
        allow_inf_nan=False,
        description=f"{description}, {unit}",
        json_schema_extra={"changes": changes},
    )


def timeout(description: str, rule: ByRate, changes: Changes = "any") -> Any:
    """Return a field for a timeout that follows the control rate unless it is given."""
    return number(0.0, f"{description}; 0: {rule}", "s", 0.0, 1.0, changes)


def count(default: int, description: str, low: int, high: int, changes: Changes = "any") -> Any:
    """Return a field for a whole number within bounds."""
    return Field(
        default, ge=low, le=high, description=description, json_schema_extra={"changes": changes}
    )


def gain(description: str, unit: str, high: float) -> Any:
    """Return a field for a gain, which changes gradually."""
    return number(SCENES, f"{description}; -1: the scene's own", unit, SCENES, high)


class NodeParameters(BaseModel):
    """Parameters that every node has.

    Attributes:
        place: where there are few CPUs, the one to run on by itself: the first, the last (-1), or
            any (None). Senders and receivers run apart: a receiver need not wait until its sender
            has also published for people.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    place: ClassVar[int | None] = None

    scene: str = text("five_bar", "shipped scene, or path of a YAML file")
    operational_point: str = text(
        "", "operational point held by the user; empty: the scene's first"
    )
    control_rate: float = number(
        0.0, "samples per second; 0: the scene's own", "Hz", 0.0, 10000.0, "unconfigured"
    )
    network_delay: float = number(
        0.0,
        "one-way delay between device and controller; 0: the scene's connection.expected",
        "s",
        0.0,
        1.0,
        "unconfigured",
    )
    autostart: bool = flag(True, "configure and activate at the start", "never")
    lockstep: bool = flag(
        False, "advance by messages stamped with /clock, not by time; needs use_sim_time", "never"
    )
    transport: Transport = text(
        "auto",
        "auto: directly to processes of the same user and host where they use auto too; "
        "middleware: always through the middleware",
        "never",
    )
    realtime: RealtimeMode = text(
        "auto",
        "auto: real-time scheduling (nice -20 with fewer than 4 CPUs), locked memory, short idle "
        "states, where the system grants them; on: real-time scheduling with any number of CPUs; "
        "off: none of these",
        "never",
    )
    thread_priority: int = count(
        50, "priority of real-time scheduling (SCHED_FIFO)", 1, 99, "never"
    )
    cpu_affinity: CpuList = Field(
        "",
        description="CPUs to run on, such as 0,2-3; any: all; empty: with 2 or 3 CPUs one by the "
        "node's part, unless realtime is off, else all",
        json_schema_extra={"changes": "never", "untyped": True},
    )
    view_rate: float = number(100.0, "rate of topics outside the control loop", "Hz", 1.0, 1000.0)
    message_age_limit: float = number(0.25, "largest accepted age of a stamp", "s", 0.001, 3600.0)
    diagnostics_period: float = number(1.0, "time between diagnostics", "s", 0.01, 60.0)


class DriverParameters(NodeParameters):
    """Parameters that every driver of a haptic device has."""

    place = 0

    command_timeout: float = timeout(
        "servo_cf older than this counts as lost: actuators at zero", COMMAND
    )
    force_limit: float = number(
        0.0, "largest force on the hand; 0: the scene's device.force_limit", "N", 0.0, 1000.0
    )
    torque_limit: float = number(
        0.0, "largest torque on the hand; 0: the scene's device.torque_limit", "N m", 0.0, 100.0
    )
    force_slew: float = number(
        0.0, "largest rate of the force; 0: the scene's device.safety", "N/s", 0.0, 1e6
    )
    torque_slew: float = number(
        0.0, "largest rate of the torque; 0: the scene's device.safety", "N m/s", 0.0, 1e5
    )
    start_ramp: float = number(
        0.0,
        "ramp of the limits when commands begin; 0: the scene's device.safety",
        "s",
        0.0,
        10.0,
    )
    workspace_radius: float = number(
        0.0,
        "radius about the start pose, no outward force beyond it; 0: the scene's device.safety",
        "m",
        0.0,
        100.0,
    )
    lock_safety: bool = flag(
        False,
        "limits and timeouts of the device, message_age_limit, scene and rate cannot change",
        "never",
    )


class DeviceParameters(DriverParameters):
    """Parameters of the simulated haptic device."""

    hand: Literal["scene", "still", "commanded"] = text(
        "scene",
        "scene: the scene's hand; still: a relaxed arm that holds the device where it is; "
        "commanded: only hand_cf moves the device",
    )
    hand_timeout: float = number(0.2, "hand_cf expires after this; 0: never", "s", 0.0, 3600.0)
    wait_for_start: bool = flag(False, "the hand starts when device/start_hand is called")


class MountedParameters(DriverParameters):
    """Parameters of the driver of a device that stands somewhere."""

    mounting_roll: float = number(
        0.0, "axes of the device's base in the world, about x", "rad", -3.15, 3.15, "unconfigured"
    )
    mounting_pitch: float = number(0.0, "likewise, about y", "rad", -3.15, 3.15, "unconfigured")
    mounting_yaw: float = number(0.0, "likewise, about z", "rad", -3.15, 3.15, "unconfigured")


class HaplyParameters(MountedParameters):
    """Parameters of the driver of a Haply Inverse3."""

    uri: str = text("ws://127.0.0.1:10001", "address of Haply's Inverse service")
    device_id: str = text("", "device_id of the Inverse3; empty: the only one there is")


class RelayParameters(MountedParameters):
    """Parameters of the relay to a driver of ros2_control."""

    state_topic: str = text("/fd/joint_states", "JointState of the device's axes")
    joint_command_topic: str = text(
        "/fd/fd_controller/commands", "Float64MultiArray of efforts, in the order of axes"
    )
    axes: str = text(
        "fd_x fd_y fd_z", "joints of the base's x, y and z, and of roll, pitch and yaw, if any"
    )
    torques: bool = flag(False, "roll, pitch and yaw take efforts too", "unconfigured")
    button_topic: str = text("", "Joy of the handle's buttons; empty: none")


class MechanismParameters(NodeParameters):
    """Parameters of the mechanism simulator."""

    place = -1

    command_timeout: float = timeout(
        "servo_cf older than this counts as lost and is ramped to zero", MECHANISM_COMMAND
    )
    external_timeout: float = number(
        0.2, "external_cf expires after this; 0: never", "s", 0.0, 3600.0
    )
    held_points: str = text(
        "",
        "points with a controller, comma-separated: lockstep waits for those, and their "
        "buttons are received; empty: operational_point",
    )
    grasp: str = text(
        "",
        "pose of operational_point: link or point, then optionally x y z (m) and roll pitch yaw "
        "(rad); empty: as in the scene",
        "any",
    )
    require_external_wrench: bool = flag(
        False, "in lockstep, a tick waits for external_cf at every operational point"
    )
    closure_button: str = text(
        "",
        "closure and number of a button that opens and closes it, such as ground_pin 2; empty: "
        "none",
        "any",
    )


class AnalyserParameters(NodeParameters):
    """Parameters of the null-space analyser."""

    place = 0


class ControllerParameters(NodeParameters):
    """Parameters of the teleoperation controller."""

    place = -1

    input_timeout: float = timeout(
        "an input older than this counts as lost: disengaged", CONTROLLER_INPUT
    )
    lock_safety: bool = flag(
        False,
        "input_timeout, message_age_limit, soften, scene and rate cannot change",
        "never",
    )
    soften: bool = flag(True, "lower gains while the loop's delay exceeds what they allow", "any")
    device_frame: str = text(
        "world",
        "frame_id of a driver that has CRTK topics only; its axes are taken as those of the world",
        "unconfigured",
    )
    clutch_button: int = count(
        0, "button of the handle that disengages while it is pressed; 0: none", 0, MOST_BUTTONS
    )
    constraint_stiffness: float = gain("stiffness k of the joint constraint", "N/m", 1000000.0)
    constraint_damping: float = gain("damping b of the joint constraint", "N s/m", 10000.0)
    constraint_feedforward: float = gain("feedforward share beta of the joint constraint", "1", 1.0)
    position_stiffness: float = gain("stiffness of the position channel", "N/m", 1000000.0)
    position_damping: float = gain("damping of the position channel", "N s/m", 10000.0)
    position_angular_stiffness: float = gain(
        "angular stiffness of the position channel", "N m/rad", 10000.0
    )
    position_angular_damping: float = gain(
        "angular damping of the position channel", "N m s/rad", 1000.0
    )
    c1: float = gain("C1, device's position to the mechanism", "1", 1.0)
    c2: float = gain("C2, contact to the hand", "1", 1.0)
    c3: float = gain("C3, hand to the mechanism", "1", 1.0)
    c4: float = gain("C4, mechanism's position to the device", "1", 1.0)
    c5: float = gain("C5, local force feedback of the mechanism", "1", 10.0)
    c6: float = gain("C6, local force feedback of the device", "1", 10.0)

    @property
    def gains(self) -> dict[str, float]:
        """The gains among them, by name; -1 for the scene's."""
        return {name: getattr(self, name) for name in TUNED}


class SceneSubscriberParameters(NodeParameters):
    """Parameters of a node that subscribes to a scene's topics, without deadlines."""

    realtime: RealtimeMode = text("off", "as for the other nodes", "never")
    held_points: str = text(
        "",
        "points of several users, comma-separated, each with its nodes in a namespace of the "
        "point's name; empty: operational_point, or else those of the scene's hands",
    )
    input_timeout: float = number(0.5, "inputs older than this are not shown", "s", 0.02, 60.0)


class ViewerParameters(SceneSubscriberParameters):
    """Parameters of the scene viewer."""

    marker_rate: float = number(30.0, "rate of markers, frames and joint states", "Hz", 1.0, 200.0)
    force_scale: float = number(0.05, "length of an arrow per force", "m/N", 1e-4, 10.0)
    torque_scale: float = number(4.0, "radius of a ring per torque", "m/(N m)", 1e-3, 1000.0)
    tf: bool = flag(True, "publish /tf and /tf_static, where tf2_msgs is installed")
    frame_prefix: str = text(
        FROM_NAMESPACE, "prefix of all frames but world; auto: the node's namespace and a slash"
    )


class LiveParameters(SceneSubscriberParameters):
    """Parameters of the live page."""

    transport: Transport = text("middleware", "as for the other nodes", "never")
    host: str = text("127.0.0.1", "address that is served; 0.0.0.0: to the whole network", "never")
    port: int = count(
        8080, "port of the page; if it is taken, the next free one", 1, 65535, "never"
    )


def changes_of(model: type[NodeParameters], name: str) -> Changes:
    """Return when a parameter may change."""
    extra = model.model_fields[name].json_schema_extra
    return extra["changes"] if isinstance(extra, dict) else "never"  # type: ignore[return-value]


def is_typed(model: type[NodeParameters], name: str) -> bool:
    """Return whether ROS refuses values of another type than the default's."""
    extra = model.model_fields[name].json_schema_extra
    return not (isinstance(extra, dict) and extra.get("untyped"))


def locked_by(parameters: NodeParameters, name: str) -> str:
    """Return the parameter that keeps another as it is while the node runs; empty if none does."""
    if not getattr(parameters, LOCK, False):
        return ""
    fixed = name in SAFETY or name not in type(parameters).model_fields
    return LOCK if fixed or changes_of(type(parameters), name) == "unconfigured" else ""


def range_of(model: type[NodeParameters], name: str) -> tuple[float, float] | None:
    """Return the bounds of a number; None for anything else."""
    rules = model.model_fields[name].metadata
    low = [rule.ge for rule in rules if isinstance(rule, Ge)]
    high = [rule.le for rule in rules if isinstance(rule, Le)]
    return (low[0], high[0]) if low and high else None  # type: ignore[return-value]


def choices_of(model: type[NodeParameters], name: str) -> tuple[str, ...]:
    """Return the values that a choice may have; none for anything else."""
    kind = model.model_fields[name].annotation
    return tuple(map(str, get_args(kind))) if get_origin(kind) is Literal else ()


def validated(model: type[P], values: Mapping[str, object]) -> P:
    """Return the parameters, checked as a whole.

    Raises:
        ParameterError: names every parameter that breaks a rule, with value and rule.
    """
    try:
        return model.model_validate(dict(values), strict=False)
    except ValidationError as error:
        problems = [
            f"{'.'.join(map(str, e['loc']))}: {e['msg']} (got {shown(e['input'])})"
            for e in error.errors()
        ]
        raise ParameterError("; ".join(problems)) from None
