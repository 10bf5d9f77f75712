"""Every topic of the graph: name, type, rate, direction of the wrench, and why its QoS is as it is.

Names are relative, so that namespaces and remapping work; ``{point}`` stands for the name of an
operational point of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Rate = Literal["control", "view", "change", "1 Hz", "caller's"]
Qos = Literal["stream", "latched", "command"]


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic.

    Attributes:
        name: relative name, with ``{point}`` where an operational point's name goes.
        type: ROS message type.
        publisher: node that publishes it, or ``any``.
        subscribers: nodes that subscribe.
        rate: ``control`` is the scene's control rate, ``view`` is for people and slower.
        qos: name of the profile in nodes/qos.py.
        meaning: what it carries; for wrenches by whom, on whom, at which point, in which axes.
    """

    name: str
    type: str
    publisher: str
    meaning: str
    subscribers: tuple[str, ...] = ()
    rate: Rate = "view"
    qos: Qos = "stream"

    def of(self, point: str) -> str:
        """Return the relative name for an operational point."""
        return self.name.format(point=point)


POSE, TWIST, WRENCH = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/WrenchStamped",
)
ARRAY = "std_msgs/msg/Float64MultiArray"
DEVICE, MECHANISM = "haptic_device", "mechanism_simulator"
ANALYSER, CONTROLLER = "nullspace_analyser", "teleoperation_controller"

DEVICE_STATE = Topic(
    "device/state",
    ARRAY,
    DEVICE,
    "measured_cp, measured_cv and measured_cf of one sample in one message; a device without "
    "it is rendered from those three",
    (CONTROLLER,),
    rate="control",
)
DEVICE_POSE = Topic(
    "device/measured_cp",
    POSE,
    DEVICE,
    "pose of the point held, in `world`",
    (CONTROLLER,),
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
    "F_h: by the hand, on the device, at the point held, axes of `world`",
    (CONTROLLER,),
)
DEVICE_COMMAND = Topic(
    "device/servo_cf",
    WRENCH,
    CONTROLLER,
    "by the device, on the hand, at the point held, axes of `world`; stamp of the device "
    "measurement it answers",
    (DEVICE,),
    rate="control",
)
HAND_WRENCH = Topic(
    "device/hand_cf",
    WRENCH,
    "any",
    "extra hand wrench: by the hand, on the simulated device, at the point held, axes of `world`",
    (DEVICE,),
    rate="caller's",
    qos="command",
)
STATE = Topic(
    "mechanism/state",
    ARRAY,
    MECHANISM,
    "all that the analyser needs in one message: stamp, closed loops, joint positions and "
    "velocities, F_c at every operational point",
    (ANALYSER,),
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
)
POINT_TWIST = Topic(
    "mechanism/{point}/measured_cv",
    TWIST,
    MECHANISM,
    "twist of the operational point, at that point, axes of `world`",
)
CONTACT_FORCE = Topic(
    "mechanism/{point}/contact_cf",
    WRENCH,
    MECHANISM,
    "F_c: by the environment (contacts and `external_cf`), on the mechanism, at the "
    "operational point, axes of `world`",
)
POINT_COMMAND = Topic(
    "mechanism/{point}/servo_cf",
    WRENCH,
    CONTROLLER,
    "by the hand through the controller, on the mechanism, at the operational point, axes of "
    "`world`",
    (MECHANISM,),
    rate="control",
)
EXTERNAL_WRENCH = Topic(
    "mechanism/{point}/external_cf",
    WRENCH,
    "any",
    "by anyone, on the mechanism, at the operational point, axes of `world`",
    (MECHANISM,),
    rate="caller's",
    qos="command",
)
CLOSURES = Topic(
    "mechanism/closures",
    "std_msgs/msg/UInt8MultiArray",
    MECHANISM,
    "1 where a loop closure is closed; names in the layout's labels",
    rate="change",
    qos="latched",
)
ENERGY = Topic(
    "mechanism/energy",
    ARRAY,
    MECHANISM,
    "stamp, kinetic and potential energy, work by wrenches, losses (J), closure error (m, rad)",
)
RENDERING = Topic(
    "analysis/{point}/rendering",
    ARRAY,
    ANALYSER,
    "all that the controller needs in one message: stamp, count, s, Λ_h⁻¹, P_c, Π, a_0, pose,"
    " twist and F_c of the operational point; axes of `world`, at the operational point",
    (CONTROLLER,),
    rate="control",
)
INVERSE_INERTIA = Topic(
    "analysis/{point}/inverse_inertia",
    ARRAY,
    ANALYSER,
    "Λ_h⁻¹, 6 x 6, force rows first; 1/kg, 1/(kg m), 1/(kg m²)",
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
    "6 x count: wrenches at the hand that the joints balance, a column each",
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
# Service of the simulated device, std_srvs/srv/Trigger: a hand that waits takes hold.
START_HAND = "device/start_hand"

TOPICS: tuple[Topic, ...] = (
    DEVICE_STATE,
    DEVICE_POSE,
    DEVICE_TWIST,
    DEVICE_FORCE,
    DEVICE_COMMAND,
    HAND_WRENCH,
    STATE,
    JOINT_STATES,
    POINT_POSE,
    POINT_TWIST,
    CONTACT_FORCE,
    POINT_COMMAND,
    EXTERNAL_WRENCH,
    CLOSURES,
    ENERGY,
    RENDERING,
    INVERSE_INERTIA,
    PROJECTOR,
    CONSTRAINT_WRENCHES,
    SPECTRUM,
    COUNT,
    IMPEDANCE_PART,
    CONSTRAINT_PART,
    CHANNEL_PART,
    DIAGNOSTICS,
)
