# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every topic of the graph, in the order of docs/topics.md.

A topic has a name, type, rate, direction of the wrench, and QoS. Names are relative, for namespaces
and remapping; ``{point}`` stands for the name of an operational point of the scene.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from hapticmech_ros.errors import check_one_of

# Replaces CRTK's own message types where they are not installed.
TEXT = "std_msgs/msg/String"
Rate = Literal[
    "control", "body", "view", "shared", "contact", "servo", "marker", "change", "1 Hz", "caller's"
]
Qos = Literal["stream", "latched", "command"]


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic.

    Attributes:
        name: relative name, with ``{point}`` where an operational point's name goes.
        type: ROS message type.
        publisher: node that publishes it, or ``any``.
        subscribers: nodes that subscribe.
        rate: ``control`` is the scene's control rate, ``view`` is for people and slower,
            ``shared`` the same in scenes with several operational points, ``contact`` in those
            with contacts, ``servo`` the same while a device is
            commanded to a pose, ``marker`` the scene viewer's; ``body`` is the control rate with
            ``device.servo_axes: body``.
        qos: name of the profile in nodes/messages.py.
        meaning: of its values; for wrenches also which body exerts them on which, at which point,
            and in which axes.
    """

    name: str
    type: str
    publisher: str
    meaning: str
    subscribers: tuple[str, ...] = ()
    rate: Rate = "view"
    qos: Qos = "stream"

    def names(self, absolute: str) -> bool:
        """Return whether an absolute name is this topic's, in any namespace, of any point."""
        own, given = self.name.strip("/").split("/"), absolute.strip("/").split("/")
        pairs = zip(reversed(own), reversed(given), strict=False)
        return len(given) >= len(own) and all(a in (b, "{point}") for a, b in pairs)

    def of(self, point: str, namespace: str = "") -> str:
        """Return the relative name for an operational point.

        Args:
            point: name of the operational point.
            namespace: of its user, see :func:`users_of`: all that is not the mechanism's is in it.
        """
        name = self.name.format(point=point)
        own = namespace and not name.startswith(("mechanism/", "/"))
        return f"{namespace}/{name}" if own else name


def users_of(points: Sequence[str]) -> list[tuple[str, str]]:
    """Return namespace and operational point of each user of one mechanism.

    Device, analyser and controller of one of several users are in a namespace of the point's name;
    one alone has none.

    Args:
        points: names of the operational points that are held.
    """
    return [(point if len(points) > 1 else "", point) for point in points]


POSE, TWIST, WRENCH = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/WrenchStamped",
)
ARRAY = "std_msgs/msg/Float64MultiArray"
DEVICE, MECHANISM = "haptic_device", "mechanism_simulator"
ANALYSER, CONTROLLER = "nullspace_analyser", "teleoperation_controller"
VIEWER, PAGE = "scene_viewer", "live_page"
# A robot that follows the mechanism, and one in MuJoCo in place of a real one.
FOLLOWER, ROBOT = "robot_follower", "simulated_robot"
# Drive devices that are not simulated, by the same topics as DEVICE.
HAPLY, RELAY = "haply_device", "relay_device"
REAL_DEVICES = (HAPLY, RELAY)


def user_prefixes(points: Sequence[str]) -> dict[str, str]:
    """Return the prefix of a user's names of topics, nodes and frames, by the point held.

    It is the namespace that :func:`users_of` gives, in that of the mechanism.
    """
    return {point: f"{space}/" if space else "" for space, point in users_of(points)}


def crtk_type(name: str) -> str:
    """Return the full name of one of CRTK's message types, or of its substitute."""
    return TEXT if importlib.util.find_spec("crtk_msgs") is None else f"crtk_msgs/msg/{name}"


_STATES = (
    "`ENABLED`, `DISABLED`, `PAUSED` or `FAULT`; crtk_msgs/OperatingState where that is installed"
)
_COMMANDS = (
    "`enable`, `disable`, `pause`, `resume`, `home` or `unhome`; crtk_msgs/StringStamped where "
    "that is installed"
)

DEVICE_STATE = Topic(
    "device/state",
    ARRAY,
    DEVICE,
    "measured_cp, measured_cv and hand/measured_cf of one sample in one message; of a device "
    "without it the controller uses those three; F_h of other users' devices",
    (CONTROLLER, DEVICE, PAGE),
    rate="control",
)
DEVICE_POSE = Topic(
    "device/measured_cp",
    POSE,
    DEVICE,
    "pose of the point held, frame `world`",
    (CONTROLLER, VIEWER, PAGE),
)
DEVICE_TWIST = Topic(
    "device/measured_cv",
    TWIST,
    DEVICE,
    "twist of the point held, at that point, axes of `world`",
    (CONTROLLER,),
)
DEVICE_FORCE = Topic(
    "device/measured_cf",
    WRENCH,
    DEVICE,
    "wrench that the actuators apply, as CRTK has it: by the device, on the hand, at the point "
    "held, axes of `world`",
    (CONTROLLER,),
)
HAND_FORCE = Topic(
    "device/hand/measured_cf",
    WRENCH,
    DEVICE,
    "F_h, measured or estimated (`force_sensor`): by the hand, on the device, at the point held, "
    "axes of `world`",
    (CONTROLLER, VIEWER, PAGE),
)
DEVICE_SETPOINT = Topic(
    "device/setpoint_cf",
    WRENCH,
    DEVICE,
    "wrench that the actuators apply: `servo_cf` within their limits, zero when it is lost; by "
    "the device, on the hand, at the point held, axes of `world`",
)
DEVICE_JOINTS = Topic(
    "device/measured_js",
    "sensor_msgs/msg/JointState",
    DEVICE,
    "the device's six coordinates as joints: x, y, z and rotation vector relative to `world`",
)
DEVICE_BUTTONS = Topic(
    "device/buttons",
    "sensor_msgs/msg/Joy",
    DEVICE,
    "`buttons` of the device's handle, 1 while pressed, with every change and once a second; no "
    "message of a device without any",
    (MECHANISM, CONTROLLER),
    rate="change",
    qos="latched",
)
DEVICE_COMMAND = Topic(
    "device/servo_cf",
    WRENCH,
    CONTROLLER,
    "by the device, on the hand, at the point held, axes of `world`; stamp of the device "
    "measurement it answers",
    (DEVICE, VIEWER, PAGE),
    rate="control",
)
DEVICE_BODY_COMMAND = Topic(
    "device/body/servo_cf",
    WRENCH,
    CONTROLLER,
    "`device/servo_cf` in the axes of `device/measured_cp`; the simulated device obeys it too, of "
    "other nodes, one of the two at a time",
    (DEVICE,),
    rate="body",
)
DEVICE_BODY_AXES = Topic(
    "device/body/set_cf_orientation_absolute",
    "std_msgs/msg/Bool",
    "any",
    "true: wrenches on `device/body/servo_cf` have the axes of `world` from now on",
    (DEVICE,),
    rate="caller's",
)
DEVICE_BODY_FORCE = Topic(
    "device/body/measured_cf",
    WRENCH,
    "any",
    "of a driver, with `device.servo_axes: body`: `device/measured_cf` in the axes of "
    "`device/measured_cp`",
    (CONTROLLER,),
    rate="caller's",
)
DEVICE_POSE_COMMAND = Topic(
    "device/servo_cp",
    POSE,
    "any",
    "pose, in `world`, to which the scene's `device.servo` pulls the device; refused while "
    "`servo_cf` is obeyed",
    (DEVICE,),
    rate="caller's",
)
DEVICE_POSE_SETPOINT = Topic(
    "device/setpoint_cp",
    POSE,
    DEVICE,
    "pose, in `world`, to which the device is pulled",
    rate="servo",
)
DEVICE_HOLD = Topic(
    "device/hold",
    "std_msgs/msg/Empty",
    "any",
    "holds the device where it is, by the scene's `device.servo`, until another command; refused "
    "while `servo_cf` is obeyed",
    (DEVICE,),
    rate="caller's",
)
DEVICE_FREE = Topic(
    "device/free",
    "std_msgs/msg/Empty",
    "any",
    "ends `servo_cp` and `hold`: the device is free",
    (DEVICE,),
    rate="caller's",
)
DEVICE_OPERATING_STATE = Topic(
    "device/operating_state",
    crtk_type("OperatingState"),
    DEVICE,
    _STATES,
    rate="change",
    qos="latched",
)
DEVICE_STATE_COMMAND = Topic(
    "device/state_command",
    crtk_type("StringStamped"),
    "any",
    _COMMANDS,
    (DEVICE,),
    rate="caller's",
)
DEVICE_GAIN = Topic(
    "device/local_feedback_gain",
    ARRAY,
    CONTROLLER,
    "gains G, K and B of the device's local feedback, which corrects `servo_cf` for the changes of "
    "F_h, pose and twist since the sample that it answers, and E_m; 6 x 6 each, axes of `world`; "
    "over a declared network, and until the device obeys, with every command, else at least 50 "
    "times a second",
    (DEVICE,),
)
DEVICE_COUPLING = Topic(
    "device/coupling_gain",
    ARRAY,
    CONTROLLER,
    "gains H_j by which the device corrects `servo_cf` for changes of the other hands' wrenches "
    "since those in the F_c of the command; 6 x 6 for each other operational point, "
    "axes of `world`; zero where no hand holds",
    (DEVICE,),
    rate="shared",
)
HAND_WRENCH = Topic(
    "device/hand_cf",
    WRENCH,
    "any",
    "extra hand wrench: by the hand, on the simulated device, at the point held; with `hand: "
    "commanded` there is no other. Also `device/hand_cf/<who>`, and "
    "`device/hand_cf/persistent`, which stays until it is replaced",
    (DEVICE,),
    rate="caller's",
    qos="command",
)
STATE = Topic(
    "mechanism/state",
    ARRAY,
    MECHANISM,
    "input of the analyser in one message: stamp, closed loops, joint positions and velocities, "
    "F_c and pose in its link of every operational point",
    (ANALYSER, VIEWER, PAGE),
    rate="control",
)
JOINT_STATES = Topic(
    "mechanism/measured_js",
    "sensor_msgs/msg/JointState",
    MECHANISM,
    "positions and velocities of every joint, passive ones included",
)
POINT_POSE = Topic(
    "mechanism/{point}/measured_cp",
    POSE,
    MECHANISM,
    "pose of the operational point, in `world`",
    (FOLLOWER,),
)
POINT_TWIST = Topic(
    "mechanism/{point}/measured_cv",
    TWIST,
    MECHANISM,
    "twist of the operational point, at that point, axes of `world`",
    (FOLLOWER,),
)
POINT_FORCE = Topic(
    "mechanism/{point}/measured_cf",
    WRENCH,
    MECHANISM,
    "F_c: by the environment (`external_cf` at the point, contacts, other hands), on the "
    "mechanism, at the operational point, axes of `world`",
)
POINT_JOINTS = Topic(
    "mechanism/{point}/measured_js",
    "sensor_msgs/msg/JointState",
    MECHANISM,
    "the same as `mechanism/measured_js`, for CRTK clients of one point",
)
POINT_COMMAND = Topic(
    "mechanism/{point}/servo_cf",
    WRENCH,
    CONTROLLER,
    "by the hand through the controller, on the mechanism, at the operational point, axes of "
    "`world`",
    (MECHANISM, VIEWER, PAGE),
    rate="control",
)
POINT_OPERATING_STATE = Topic(
    "mechanism/{point}/operating_state",
    crtk_type("OperatingState"),
    MECHANISM,
    _STATES,
    rate="change",
    qos="latched",
)
POINT_STATE_COMMAND = Topic(
    "mechanism/{point}/state_command",
    crtk_type("StringStamped"),
    "any",
    _COMMANDS,
    (MECHANISM,),
    rate="caller's",
)
EXTERNAL_WRENCH = Topic(
    "mechanism/{point}/external_cf",
    WRENCH,
    "any",
    "external wrench on the mechanism, at the operational point. Also `external_cf/<who>`, and "
    "`external_cf/persistent`, which stays until it is replaced; the same for every link",
    (MECHANISM,),
    rate="caller's",
    qos="command",
)
SET_OPERATIONAL_POINT = Topic(
    "mechanism/{point}/set_operational_point",
    POSE,
    "any",
    "moves the operational point to a pose in the frame of a link, of an operational point, or of "
    "`world` (then on its present link)",
    (MECHANISM,),
    rate="caller's",
    qos="command",
)
OPERATIONAL_POINT = Topic(
    "mechanism/{point}/operational_point",
    POSE,
    MECHANISM,
    "pose of the operational point in its link, which is the `frame_id`",
    rate="change",
    qos="latched",
)
CLOSURES = Topic(
    "mechanism/closures",
    "std_msgs/msg/UInt8MultiArray",
    MECHANISM,
    "1 where a loop closure is closed; names in the layout's labels",
    rate="change",
    qos="latched",
)
POINT_MODEL = Topic(
    "analysis/{point}/operational_model",
    ARRAY,
    ANALYSER,
    "input of the controller in one message: stamp, count, s, X_τ and a_τ (Λ_h⁻¹ and a_0 with "
    "delay compensation), P_c, Π, pose, twist and F_c of the operational point, axes of `world`, "
    "at that point, and the point's pose in its link",
    (CONTROLLER,),
    rate="control",
)
INVERSE_INERTIA = Topic(
    "analysis/{point}/inverse_inertia",
    ARRAY,
    ANALYSER,
    "Λ_h⁻¹, 6 x 6, force rows first; 1/kg, 1/(kg m), 1/(kg m²)",
)
TRANSMISSION = Topic(
    "analysis/{point}/transmission",
    ARRAY,
    ANALYSER,
    "Y_ij for each other operational point: a wrench F_j by the hand there is felt at this one as "
    "F_c = Y_ij F_j; 6 x 6, axes of `world`; zero where no hand holds",
    (CONTROLLER,),
    rate="shared",
)
PROJECTOR = Topic(
    "analysis/{point}/constraint_projector",
    ARRAY,
    ANALYSER,
    "P_c, 6 x 6: stiffness per N/m along constrained directions",
)
CONSTRAINT_WRENCHES = Topic(
    "analysis/{point}/constraint_wrenches",
    ARRAY,
    ANALYSER,
    "6 x count: wrenches at the hand that the joints balance, one per column",
)
SPECTRUM = Topic(
    "analysis/{point}/spectrum",
    ARRAY,
    ANALYSER,
    "μ, descending: 0 is rigid, 1 as free as the link alone",
)
COUNT = Topic(
    "analysis/{point}/constraint_count",
    "std_msgs/msg/UInt8",
    ANALYSER,
    "number of joint constraints felt",
    (VIEWER, PAGE),
)
IMPEDANCE_PART = Topic(
    "controller/impedance_cf",
    WRENCH,
    CONTROLLER,
    "impedance controller's part of `device/servo_cf`",
)
CONSTRAINT_PART = Topic(
    "controller/joint_constraint_cf",
    WRENCH,
    CONTROLLER,
    "joint-constraint controller's part of `device/servo_cf`",
)
CHANNEL_PART = Topic(
    "controller/four_channel_cf",
    WRENCH,
    CONTROLLER,
    "four-channel controller's part of `device/servo_cf`",
)
DIAGNOSTICS = Topic(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    "every node",
    "periods, missed deadlines, message ages, latency percentiles, refused messages",
    rate="1 Hz",
)
# Service of the simulated device, std_srvs/srv/Trigger: starts a hand with `wait_for_start`.
START_HAND = "device/start_hand"
# Service of a device, std_srvs/srv/SetBool: true puts the actuators at zero until false.
EMERGENCY_STOP = "device/emergency_stop"

CONTACTS = Topic(
    "mechanism/contacts",
    ARRAY,
    MECHANISM,
    "stamp, then for each point of contact its pair, position, normal, depth and force. Also "
    "`mechanism/contacts/<contact>/measured_cf`, the wrench of one pair: by shape b, on shape a, "
    "at the origin of a's frame, axes of `world`",
    (VIEWER, PAGE),
    rate="contact",
)
# One for each declared pair, whose name takes the place of the point's.
CONTACT_FORCE = Topic(
    "mechanism/contacts/{point}/measured_cf",
    WRENCH,
    MECHANISM,
    "by shape b, on shape a, at the origin of a's frame, axes of `world`",
    rate="contact",
)
DEVICE_ENERGY = Topic(
    "device/energy",
    ARRAY,
    DEVICE,
    "stamp; energy from the hand, absorbed by the actuators, received by the mechanism as far as "
    "known, available, and dissipated by passivity control, J",
)
CONTROLLER_ENERGY = Topic(
    "controller/energy",
    ARRAY,
    CONTROLLER,
    "stamp; energy given to the mechanism, stored in springs, injected by changes of springs, and "
    "dissipated in dampers, J",
)
ENERGY = Topic(
    "mechanism/energy",
    ARRAY,
    MECHANISM,
    "stamp, kinetic and potential energy, work by wrenches, losses (J), closure error (m, rad)",
)
MARKERS = Topic(
    "view/markers",
    "visualization_msgs/msg/MarkerArray",
    VIEWER,
    "markers in `world`: mechanism, closures, device, forces, constraint directions; "
    "colours in docs/visualization.md",
    rate="marker",
)
FRAMES = Topic(
    "view/frames",
    "geometry_msgs/msg/TransformStamped",
    VIEWER,
    "the frames of tf, one message each: every link, operational points with axes of body and of "
    "`world`, device",
    rate="marker",
)
ROBOT_DESCRIPTION = Topic(
    "robot_description",
    "std_msgs/msg/String",
    VIEWER,
    "URDF text of the mechanism's tree, loops cut open",
    rate="change",
    qos="latched",
)
URDF_JOINTS = Topic(
    "joint_states",
    "sensor_msgs/msg/JointState",
    VIEWER,
    "positions and velocities of the joints of `robot_description`, passive ones included",
    rate="marker",
)
SEEN_POINT_COMMAND = Topic(
    "view/{point}/servo_cf",
    WRENCH,
    VIEWER,
    "`mechanism/{point}/servo_cf` in the frame `<point>_world`, for RViz",
    rate="marker",
)
SEEN_POINT_FORCE = Topic(
    "view/{point}/measured_cf",
    WRENCH,
    VIEWER,
    "`mechanism/{point}/measured_cf` in the frame `<point>_world`, for RViz",
    rate="marker",
)
SEEN_DEVICE_COMMAND = Topic(
    "view/device/servo_cf",
    WRENCH,
    VIEWER,
    "`device/servo_cf` in the frame `device_world`, for RViz",
    rate="marker",
)
SEEN_HAND_FORCE = Topic(
    "view/device/hand/measured_cf",
    WRENCH,
    VIEWER,
    "`device/hand/measured_cf` in the frame `device_world`, for RViz",
    rate="marker",
)

VIEW_TOPICS: tuple[Topic, ...] = (
    MARKERS,
    FRAMES,
    ROBOT_DESCRIPTION,
    URDF_JOINTS,
    SEEN_POINT_COMMAND,
    SEEN_POINT_FORCE,
    SEEN_DEVICE_COMMAND,
    SEEN_HAND_FORCE,
)

TOPICS: tuple[Topic, ...] = (
    DEVICE_STATE,
    DEVICE_POSE,
    DEVICE_TWIST,
    DEVICE_FORCE,
    HAND_FORCE,
    DEVICE_SETPOINT,
    DEVICE_JOINTS,
    DEVICE_BUTTONS,
    DEVICE_COMMAND,
    DEVICE_BODY_COMMAND,
    DEVICE_BODY_AXES,
    DEVICE_BODY_FORCE,
    DEVICE_GAIN,
    DEVICE_COUPLING,
    DEVICE_POSE_COMMAND,
    DEVICE_POSE_SETPOINT,
    DEVICE_HOLD,
    DEVICE_FREE,
    DEVICE_OPERATING_STATE,
    DEVICE_STATE_COMMAND,
    DEVICE_ENERGY,
    HAND_WRENCH,
    STATE,
    JOINT_STATES,
    POINT_POSE,
    POINT_TWIST,
    POINT_FORCE,
    POINT_JOINTS,
    POINT_COMMAND,
    POINT_OPERATING_STATE,
    POINT_STATE_COMMAND,
    EXTERNAL_WRENCH,
    SET_OPERATIONAL_POINT,
    OPERATIONAL_POINT,
    CLOSURES,
    ENERGY,
    CONTACTS,
    POINT_MODEL,
    INVERSE_INERTIA,
    TRANSMISSION,
    PROJECTOR,
    CONSTRAINT_WRENCHES,
    SPECTRUM,
    COUNT,
    IMPEDANCE_PART,
    CONSTRAINT_PART,
    CHANNEL_PART,
    CONTROLLER_ENERGY,
    DIAGNOSTICS,
    *VIEW_TOPICS,
)


def topic_of(absolute: str) -> Topic | None:
    """Return the topic of an absolute name, in any namespace, or None."""
    found = [topic for topic in TOPICS if topic.names(absolute)]
    return max(found, key=lambda topic: topic.name.count("/"), default=None)


FEEDS = ("hand", "device", "external")


def check_feeds(kinds: Sequence[str]) -> None:
    """Refuse unknown kinds of feeds.

    Raises:
        InvalidInputError: not one of :data:`FEEDS`.
    """
    for kind in kinds:
        check_one_of("feed", kind, FEEDS)
