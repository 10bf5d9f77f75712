# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scene viewer: an optional node that converts other nodes' messages to visualisation.

It draws at its own rate, and only topics with subscribers; without any it subscribes to nothing
itself. The other nodes do not depend on it.

It publishes messages for viewers such as RViz, only while they have subscribers.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pinocchio as pin
from geometry_msgs.msg import Point, Pose, TransformStamped, WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.actor import Actor, Host
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.messages import LATCHED, WORLD, fill_pose, set_stamp, wrench_message
from hapticmech_ros.nodes.parameters import FROM_NAMESPACE, ViewerParameters
from hapticmech_ros.nodes.viewer.scene_inputs import Received, SceneSubscriber
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.view import (
    JointStates,
    Picture,
    Placement,
    Placer,
    Snapshot,
    UserSnapshot,
    fixed_frames,
    moving_frames,
    urdf_of,
    vanished,
)
from hapticmech_ros.view.placement import DEVICE, NamedTransform, at_world, frame_names
from hapticmech_ros.view.shapes import Hulls, Key, Scales, Shape, touch_shapes
from hapticmech_ros.wire.topics import (
    FRAMES,
    MARKERS,
    ROBOT_DESCRIPTION,
    SEEN_DEVICE_COMMAND,
    SEEN_HAND_FORCE,
    SEEN_POINT_COMMAND,
    SEEN_POINT_FORCE,
    STATE,
    URDF_JOINTS,
)

_TYPES = {
    "cylinder": Marker.CYLINDER,
    "sphere": Marker.SPHERE,
    "box": Marker.CUBE,
    "arrow": Marker.ARROW,
    "strip": Marker.LINE_STRIP,
    "text": Marker.TEXT_VIEW_FACING,
    "triangles": Marker.TRIANGLE_LIST,
}


def marker_array(
    shapes: Iterable[Shape],
    gone: Iterable[Key],
    time_ns: int,
    lifetime_s: float,
    afresh: bool = False,
) -> MarkerArray:
    """Return a picture as markers in ``world``.

    Args:
        shapes: to show.
        gone: shapes to delete.
        time_ns: stamp.
        lifetime_s: a shape that is not renewed vanishes after this.
        afresh: remove everything first, other nodes' markers too.
    """
    message = MarkerArray()
    if afresh:
        message.markers.append(_header(Marker(action=Marker.DELETEALL), time_ns))
    for namespace, number in gone:
        marker = Marker(ns=namespace, id=number, action=Marker.DELETE)
        message.markers.append(_header(marker, time_ns))
    for shape in shapes:
        marker = _header(marker_of(shape), time_ns)
        set_stamp(marker.lifetime, nanoseconds(lifetime_s))
        message.markers.append(marker)
    return message


def marker_of(shape: Shape) -> Marker:
    """Return a shape as a marker without a header."""
    red, green, blue, opacity = shape.colour
    marker = Marker(
        ns=shape.namespace,
        id=shape.number,
        type=_TYPES[shape.kind],
        action=Marker.ADD,
        pose=_pose(shape.pose),
        color=ColorRGBA(r=red, g=green, b=blue, a=opacity),
        points=[Point(x=x, y=y, z=z) for x, y, z in shape.points.tolist()],
        text=shape.text,
    )
    # Message fields take nothing but floats, and an int silently becomes a wrong number.
    marker.scale.x, marker.scale.y, marker.scale.z = map(float, shape.size)
    return marker


def transform_message(frame: NamedTransform, time_ns: int, prefix: str = "") -> TransformStamped:
    """Return a frame in its parent; every frame but ``world`` has ``prefix`` before its name."""
    message = TransformStamped(child_frame_id=prefixed(frame.child, prefix))
    message.header.frame_id = prefixed(frame.parent, prefix)
    set_stamp(message.header.stamp, time_ns)
    pose = _pose(frame.pose)
    moved = message.transform.translation
    moved.x, moved.y, moved.z = pose.position.x, pose.position.y, pose.position.z
    message.transform.rotation = pose.orientation
    return message


def prefixed(name: str, prefix: str) -> str:
    """Return the frame's name with ``prefix``; ``world`` has no prefix."""
    return name if name == WORLD else prefix + name


def _header(marker: Marker, time_ns: int) -> Marker:
    marker.header.frame_id = WORLD
    set_stamp(marker.header.stamp, time_ns)
    return marker


def _pose(pose: pin.SE3) -> Pose:
    message = Pose()
    fill_pose(message, pose)
    return message


# One message per frame goes out at once: a reader has to get all of them.
BURST_PUBLISHER = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
TF, TF_STATIC = "/tf", "/tf_static"


class SceneOutputs:
    """Publishers of one viewer; topics that seldom change are published at once.

    Args:
        actor: whose publishers they are.
        mechanism: to show.
        users: prefixes of the names of a user's topics and frames, by the point held.
        prefix: before the name of every frame but ``world``.
        tf_type: class of tf's messages; None: no tf.
    """

    def __init__(
        self,
        actor: Actor[Any],
        mechanism: Mechanism,
        users: Mapping[str, str],
        prefix: str,
        tf_type: Any | None,
    ) -> None:
        self._actor = actor
        self._mechanism = mechanism
        self._users = users
        self._prefix = prefix
        names = frame_names(mechanism.scene, list(users.values()))
        self._names = {name: prefixed(frame, prefix) for name, frame in names.items()}
        self._joints = JointStates(mechanism)
        # None: shown markers are from other nodes, or from an earlier activation.
        self._shown: list[Key] | None = None
        self._publish_markers = actor.output(MARKERS, MarkerArray)
        self._publish_frames = actor.output(FRAMES, TransformStamped, BURST_PUBLISHER)
        self._publish_joints = actor.output(URDF_JOINTS, JointState)
        self._wrenches: dict[tuple[str, str], Outlet] = {}
        for topic in (SEEN_DEVICE_COMMAND, SEEN_HAND_FORCE):
            for point, user in users.items():
                name = user + topic.name
                self._wrenches[topic.name, point] = actor.output_named(
                    name, WrenchStamped, actor.output_qos
                )
        for topic in (SEEN_POINT_COMMAND, SEEN_POINT_FORCE):
            for point in mechanism.point_names:
                self._wrenches[topic.name, point] = actor.output(topic, WrenchStamped, point=point)
        self._publish_description = actor.output(ROBOT_DESCRIPTION, String, LATCHED)
        self._publish_description.publish(String(data=urdf_of(mechanism)))
        self._tf_type: Any = tf_type
        self._publish_tf: Outlet | None = None
        if tf_type is not None:
            self._publish_tf = actor.output_named(TF, tf_type, BURST_PUBLISHER)
            # tf's listeners expect the last value, also late ones.
            self._publish_tf_static = actor.output_named(TF_STATIC, tf_type, LATCHED)
        self.show_fixed_frames(actor.now_ns())

    def looked_at(self) -> bool:
        """Return whether any moving topic has subscribers."""
        moving = [self._publish_markers, self._publish_frames, self._publish_joints]
        moving += self._wrenches.values()
        if self._publish_tf is not None:
            moving.append(self._publish_tf)
        return any(outlet.wanted for outlet in moving)

    def wants_markers(self) -> bool:
        """Return whether markers have subscribers; without any, the shown ones are forgotten."""
        wanted = self._publish_markers.wanted
        if not wanted:
            self._shown = None
        return wanted

    def show_markers(self, shapes: Sequence[Shape], time_ns: int, lifetime_s: float) -> None:
        """Publish a picture; shapes of the last one that are not in this one are deleted."""
        gone = vanished(self._shown or (), shapes)
        afresh = self._shown is None
        message = marker_array(shapes, gone, time_ns, lifetime_s, afresh)
        self._shown = [shape.key for shape in shapes]
        self._publish_markers.publish(message)

    def clear_markers(self, time_ns: int) -> None:
        """Publish an empty picture."""
        self._shown = None
        self._publish_markers.publish(marker_array((), (), time_ns, 0.0, afresh=True))

    def show_fixed_frames(self, time_ns: int) -> None:
        """Find the frames that stay where they are in a link, and publish them on /tf_static."""
        self._fixed = fixed_frames(self._mechanism.scene)
        if self._tf_type is not None:
            fixed = self._transforms(self._fixed, time_ns)
            self._publish_tf_static.publish(self._tf_type(transforms=fixed))

    def show_frames(self, moving: Sequence[NamedTransform], time_ns: int) -> None:
        """Publish all frames by name, and on /tf those that move."""
        if self._publish_frames.wanted:
            for message in self._transforms([*moving, *self._fixed], time_ns):
                self._publish_frames.publish(message)
        if self._publish_tf is not None and self._publish_tf.wanted:
            transforms = self._transforms(moving, time_ns)
            self._publish_tf.publish(self._tf_type(transforms=transforms))

    def show_joints(self, q: Array, v: Array, time_ns: int) -> None:
        """Publish positions and rates of the joints of the URDF text.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
            time_ns: its stamp, ns.
        """
        if self._publish_joints.wanted:
            message = JointState(name=list(self._joints.names))
            message.position = self._joints.at(q).tolist()
            message.velocity = self._joints.rates(q, v).tolist()
            set_stamp(message.header.stamp, time_ns)
            self._publish_joints.publish(message)

    def show_wrenches(self, received: Received, time_ns: int) -> None:
        """Publish wrenches in frames at whose origin they act."""
        for point, user in received.users.items():
            frame = self._names[at_world(self._users[point] + DEVICE)]
            for topic, wrench in (
                (SEEN_DEVICE_COMMAND, user.device_command),
                (SEEN_HAND_FORCE, user.hand_wrench),
            ):
                self._show_wrench(topic.name, point, frame, wrench, time_ns)
        for index, point in enumerate(self._mechanism.point_names):
            frame = self._names[at_world(point)]
            command = received.point_commands.get(point)
            self._show_wrench(SEEN_POINT_COMMAND.name, point, frame, command, time_ns)
            contact = received.state.contacts[index]
            self._show_wrench(SEEN_POINT_FORCE.name, point, frame, contact, time_ns)

    def _show_wrench(
        self, topic: str, point: str, frame: str, wrench: Array | None, time_ns: int
    ) -> None:
        if wrench is not None:
            self._wrenches[topic, point].offer(wrench_message, wrench, time_ns, frame)

    def _transforms(self, frames: Sequence[NamedTransform], time_ns: int) -> list[TransformStamped]:
        return [transform_message(frame, time_ns, self._prefix) for frame in frames]


def installed_tf_type() -> Any | None:
    """Return tf2_msgs' TFMessage, or None where tf2_msgs is not installed."""
    if importlib.util.find_spec("tf2_msgs") is None:
        return None
    return importlib.import_module("tf2_msgs.msg").TFMessage


# A marker vanishes when this, or three periods, went by without a new one, s.
SHORTEST_LIFETIME_S = 1.0


class SceneViewer(SceneSubscriber[ViewerParameters]):
    """Draws the newest messages, at ``marker_rate``."""

    name = "scene_viewer"
    parameters_type = ViewerParameters

    def __init__(self, node: Host, parameters: ViewerParameters) -> None:
        super().__init__(node, parameters)
        self._placer = Placer(self.mechanism)
        self._hulls = Hulls(self.scene)
        tf_type = installed_tf_type() if parameters.tf else None
        self._outputs = SceneOutputs(self, self.mechanism, self.prefixes, self._prefix(), tf_type)
        self._wanted = False
        self._last_ns = 0
        self.pictures = 0

    def _prefix(self) -> str:
        """Return the prefix of frames' names: without it two graphs would use the same ones."""
        if self.parameters.frame_prefix != FROM_NAMESPACE:
            return self.parameters.frame_prefix
        topic: str = self.node.resolve_topic_name("frames")
        return topic.strip("/").removesuffix("frames")

    @property
    def period_s(self) -> float:
        """Time between pictures, s."""
        return 1.0 / self.parameters.marker_rate

    def apply_parameters(self, parameters: ViewerParameters) -> None:
        """Take new parameters; a new rate counts from now on."""
        is_new_rate = parameters.marker_rate != self.parameters.marker_rate
        super().apply_parameters(parameters)
        if is_new_rate and self.clock is not None:
            self.begin(self.now_ns())

    def deactivate(self) -> None:
        """Leave an empty picture, and unsubscribe."""
        self._wanted = False
        self.inputs.listen(False)
        self._outputs.clear_markers(self.now_ns())

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether all topics with subscribers can be drawn."""
        fresh = self.now_ns() - self._last_ns < self.timeout_ns + NANOSECONDS
        sentence = "drawing" if fresh else f"nothing on {STATE.name}"
        if not self._wanted:
            sentence = "no subscribers"
        figures = {"pictures": str(self.pictures), **self.clock_figures()}
        return fresh or not self._wanted, sentence, figures

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Publish the present state, if there are subscribers."""
        del periods, deadline_ns
        self._wanted = self._outputs.looked_at()
        self.inputs.listen(self._wanted)
        now = self.now_ns()
        received = self.inputs.now(now, self.timeout_ns)
        if received is None:
            return
        state, outputs = received.state, self._outputs
        time_ns = state.stamp_ns
        try:
            if self.followed(state.grasps):
                self._placer = Placer(self.mechanism)
                outputs.show_fixed_frames(now)
        except InvalidInputError as error:
            self.node.refuse(STATE.name, error)
            return
        self.ages.add(now - time_ns)
        self._last_ns = now
        placement = self._placer.at(state.q)
        devices = {
            self.prefixes[point]: user.device
            for point, user in received.users.items()
            if user.device is not None
        }
        frames = moving_frames(
            self.mechanism.scene, placement, devices, list(self.prefixes.values())
        )
        outputs.show_frames(frames, time_ns)
        outputs.show_joints(state.q, state.v, time_ns)
        outputs.show_wrenches(received, time_ns)
        if outputs.wants_markers():
            try:
                shapes = self._draw(received, placement)
            except HapticMechError as error:
                problem = InvalidInputError("state", state.q.tolist(), f"cannot be drawn: {error}")
                self.node.refuse(STATE.name, problem)
                return
            lifetime = max(SHORTEST_LIFETIME_S, 3.0 * self.period_s)
            outputs.show_markers(shapes, time_ns, lifetime)
            self.pictures += 1

    def _draw(self, received: Received, placement: Placement) -> list[Shape]:
        state, parameters = received.state, self.parameters
        terms = self.mechanism.evaluate(state.q, state.v, state.active)
        users = []
        for point, user in received.users.items():
            found = self.analysers[point].analyse(terms)
            count = self.count(point, received, found.spectrum.s)
            given = user.device, user.hand_wrench, user.device_command
            users.append(UserSnapshot(point, *given, found, count))
        picture = Picture(self.mechanism, parameters.force_scale, parameters.torque_scale)
        snapshot = Snapshot(
            active=state.active,
            users=tuple(users),
            contacts=dict(zip(self.mechanism.point_names, state.contacts, strict=True)),
            point_commands=received.point_commands,
        )
        shapes = [*picture.draw(snapshot, placement), *self._hulls.draw(placement)]
        if received.touching is not None:
            length = self.mechanism.length
            scales = Scales(length, parameters.force_scale, parameters.torque_scale)
            shapes += touch_shapes(received.touching, scales)
        return shapes
