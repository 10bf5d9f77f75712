# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scene viewer: an optional node that turns what the others say into what people look at.

It draws at its own rate, and only what somebody subscribes to; while nobody does it does not even
listen. The other nodes neither know nor need it.
"""

from __future__ import annotations

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.parameters import FROM_NAMESPACE, ViewerParameters
from hapticmech_ros.nodes.viewer.scene_inputs import Received, SceneSubscriber
from hapticmech_ros.nodes.viewer.scene_outputs import SceneOutputs, installed_tf_type
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.view import (
    Picture,
    Placement,
    Placer,
    Snapshot,
    UserSnapshot,
    moving_frames,
)
from hapticmech_ros.view.shapes import Shape
from hapticmech_ros.view.wrench_shapes import Hulls, Scales, touch_shapes
from hapticmech_ros.wire.topics import STATE

# A marker vanishes when this, or three periods, went by without a new one, s.
SHORTEST_LIFETIME_S = 1.0


class SceneViewer(SceneSubscriber[ViewerParameters]):
    """Draws the newest of what it hears, at ``marker_rate``."""

    name = "scene_viewer"
    parameters_type = ViewerParameters

    def __init__(self, node: Host, parameters: ViewerParameters) -> None:
        self._drawn_rate = parameters.marker_rate
        super().__init__(node, parameters)
        self._placer = Placer(self.mechanism)
        self._hulls = Hulls(self.scene)
        tf_type = installed_tf_type() if parameters.tf else None
        self._outputs = SceneOutputs(self, self.mechanism, self.prefixes, self._prefix(), tf_type)
        self._wanted = False
        self._last_ns = 0
        self.pictures = 0

    def _prefix(self) -> str:
        """Return what is before the names of frames: two graphs would place the same ones."""
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
        super().apply_parameters(parameters)
        if parameters.marker_rate != self._drawn_rate:
            self._drawn_rate = parameters.marker_rate
            if self.clock is not None:
                self.begin(self.now_ns())

    def deactivate(self) -> None:
        """Leave an empty picture, and listen to nobody."""
        self._wanted = False
        self.inputs.listen(False)
        self._outputs.clear_markers(self.now_ns())

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether all that is looked at can be drawn."""
        fresh = self.now_ns() - self._last_ns < self._timeout_ns + NANOSECONDS
        sentence = "drawing" if fresh else f"nothing on {STATE.name}"
        if not self._wanted:
            sentence = "nobody looks"
        figures = {"pictures": str(self.pictures), **self.clock_figures()}
        return fresh or not self._wanted, sentence, figures

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Publish what is known now, to those who look."""
        del periods, deadline_ns
        self._wanted = self._outputs.looked_at()
        self.inputs.listen(self._wanted)
        now = self.now_ns()
        received = self.inputs.now(now, self._timeout_ns)
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
            found = self.analyser(point).analyse(terms)
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
