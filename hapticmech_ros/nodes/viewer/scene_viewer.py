# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scene viewer: an optional node that turns what the others say into what people look at.

It draws at its own rate, and only what somebody subscribes to; while nobody does it does not even
listen. The other nodes neither know nor need it.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.grasp import flat_grasps, grasp_of
from hapticmech_ros.nodes.actor import ClockedActor
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.parameters import FROM_NAMESPACE, ViewerParameters
from hapticmech_ros.nodes.viewer.scene_inputs import Heard, SceneInputs
from hapticmech_ros.nodes.viewer.scene_outputs import SceneOutputs, installed_tf_type
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.counter import rigid_count
from hapticmech_ros.times import NANOSECONDS, nanoseconds
from hapticmech_ros.view import Picture, Placement, Placer, Shape, Snapshot, moving_frames
from hapticmech_ros.view.contact_shapes import Hulls, touch_shapes
from hapticmech_ros.view.wrench_shapes import Scales
from hapticmech_ros.wire.topics import STATE

# A marker vanishes when this, or three periods, went by without a new one, s.
SHORTEST_LIFETIME_S = 1.0


class SceneViewer(ClockedActor[ViewerParameters]):
    """Draws the newest of what it hears, at ``marker_rate``."""

    name = "scene_viewer"
    parameters_type = ViewerParameters

    def __init__(self, node: Host, parameters: ViewerParameters) -> None:
        self._drawn_rate = parameters.marker_rate
        super().__init__(node, parameters)
        mechanism = Mechanism(self.scene)
        self._mechanism = mechanism
        self._analyser = Analyser(mechanism, self.point)
        self._placer = Placer(mechanism)
        self._hulls = Hulls(self.scene)
        self._grasps = flat_grasps(mechanism.scene)
        self._inputs = SceneInputs(self, mechanism)
        tf_type = installed_tf_type() if parameters.tf else None
        self._outputs = SceneOutputs(self, mechanism, self._prefix(), tf_type)
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
        self._timeout_ns = nanoseconds(parameters.input_timeout)
        if parameters.marker_rate != self._drawn_rate:
            self._drawn_rate = parameters.marker_rate
            if self.clock is not None:
                self.begin(self.now_ns())

    def activate(self) -> None:
        """Begin with what comes from now on."""
        self._inputs.forget()

    def deactivate(self) -> None:
        """Leave an empty picture, and listen to nobody."""
        self._wanted = False
        self._inputs.listen(False)
        self._outputs.clear_markers(self.now_ns())

    def ready(self, deadline_ns: int) -> bool:
        """Return whether a picture can be drawn: always, of what there is."""
        del deadline_ns
        return True

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
        self._inputs.listen(self._wanted)
        now = self.now_ns()
        heard = self._inputs.now(now, self._timeout_ns)
        if heard is None:
            return
        state, outputs = heard.state, self._outputs
        time_ns = state.stamp_ns
        if (state.grasps != self._grasps).any():
            try:
                self._follow(state.grasps)
            except InvalidInputError as error:
                self.node.refuse(STATE.name, error)
                return
        self.ages.add(now - time_ns)
        self._last_ns = now
        placement = self._placer.at(state.q)
        outputs.show_frames(moving_frames(self.scene, placement, heard.device), time_ns)
        outputs.show_joints(state.q, state.v, time_ns)
        outputs.show_wrenches(heard, time_ns)
        if outputs.wants_markers():
            try:
                shapes = self._draw(heard, placement)
            except HapticMechError as error:
                problem = InvalidInputError("state", state.q.tolist(), f"cannot be drawn: {error}")
                self.node.refuse(STATE.name, problem)
                return
            lifetime = max(SHORTEST_LIFETIME_S, 3.0 * self.period_s)
            outputs.show_markers(shapes, time_ns, lifetime)
            self.pictures += 1

    def _follow(self, grasps: Array) -> None:
        """Draw operational points where the mechanism says that they are from now on."""
        mechanism = self._mechanism
        for name, numbers in zip(mechanism.point_names, grasps, strict=True):
            mechanism.set_operational_point(grasp_of(mechanism.scene, name, numbers))
        self._analyser = Analyser(mechanism, self.point)
        self._placer = Placer(mechanism)
        self._outputs.show_fixed_frames(self.now_ns())
        self._grasps = grasps

    def _draw(self, heard: Heard, placement: Placement) -> list[Shape]:
        state, parameters = heard.state, self.parameters
        found = self._analyser.analyse(self._mechanism.evaluate(state.q, state.v, state.active))
        count = heard.count
        if count is None:
            count = rigid_count(found.spectrum.s, self.scene.perception)
        picture = Picture(self._mechanism, parameters.force_scale, parameters.torque_scale)
        snapshot = Snapshot(
            active=state.active,
            device=heard.device,
            hand_wrench=heard.hand_wrench,
            device_command=heard.device_command,
            contacts=dict(zip(self._mechanism.point_names, state.contacts, strict=True)),
            point_commands=heard.point_commands,
            held=self.point,
            analysis=found,
            count=count,
        )
        shapes = [*picture.draw(snapshot, placement), *self._hulls.draw(placement)]
        if heard.touching is not None:
            length = self._mechanism.length
            scales = Scales(length, parameters.force_scale, parameters.torque_scale)
            shapes += touch_shapes(heard.touching, scales)
        return shapes
