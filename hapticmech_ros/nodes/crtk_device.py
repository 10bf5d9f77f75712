"""A device that speaks CRTK only: its samples, put together from three messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import DeviceMeasurement
from hapticmech_ros.control.flat import flat_device
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.inputs import Latest
from hapticmech_ros.nodes.messages import checked_stamp, read_pose, read_twist, read_wrench
from hapticmech_ros.nodes.parameters import ControllerParameters
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER
from hapticmech_ros.nodes.sources import Sources
from hapticmech_ros.wire.bounds import SixBounds
from hapticmech_ros.wire.topics import DEVICE_FORCE, DEVICE_POSE, DEVICE_TWIST


class CrtkDevice:
    """Hears measured_cv and measured_cf, and makes a sample with each measured_cp.

    Args:
        actor: that listens.
        bounds: of a twist.
        timeout_ns: returns how long twist and wrench stand, ns.
        watch: returns what tells the publishers of a topic apart.
        wanted: whether samples are wanted at a time, ns.
        answer: gets each sample (19,), its stamp and the time, ns.
        lost: gets the topics that are not fresh, instead.

    """

    def __init__(
        self,
        actor: Actor[ControllerParameters],
        bounds: SixBounds,
        timeout_ns: Callable[[], int],
        watch: Callable[[str], Sources],
        wanted: Callable[[int], bool],
        answer: Callable[[Array, int, int], None],
        lost: Callable[[Sequence[str]], None],
    ) -> None:
        self._actor, self._bounds, self._timeout_ns, self._watch = actor, bounds, timeout_ns, watch
        self._wanted, self._answer, self._lost = wanted, answer, lost
        self.forget()
        self._listen(DEVICE_FORCE.name, WrenchStamped, self._on_force)
        self._listen(DEVICE_TWIST.name, TwistStamped, self._on_twist)

    def listen(self) -> None:
        """Hear measured_cp, which comes last of a sample's three."""
        self._listen(DEVICE_POSE.name, PoseStamped, self._on_pose)

    def _listen(self, name: str, kind: Any, accept: Callable[[Any, int], None]) -> None:
        sources = self._watch(name)
        self._actor.input(name, kind, CONTROL_SUBSCRIBER, accept, sources, self._wanted)

    def forget(self) -> None:
        """Wait for both anew."""
        self._twist: Latest[Array] = Latest()
        self._hand: Latest[Array] = Latest()

    def _stamp(self, message: Any, now_ns: int) -> int:
        limit_ns = self._actor.age_limit_ns
        return checked_stamp(message.header, now_ns, limit_ns, unstamped_is_now=False)

    def _on_pose(self, message: PoseStamped, now_ns: int) -> None:
        stamp = self._stamp(message, now_ns)
        pose = read_pose(message, self._actor.limits)
        twist, hand = self._twist.value, self._hand.value
        lost = [
            topic.name
            for topic, held in ((DEVICE_TWIST, self._twist), (DEVICE_FORCE, self._hand))
            if not held.fresh(now_ns, self._timeout_ns())
        ]
        if lost or twist is None or hand is None:
            self._lost(lost)
            return
        self._answer(flat_device(DeviceMeasurement(pose, twist, hand)), stamp, now_ns)

    def _on_force(self, message: WrenchStamped, now_ns: int) -> None:
        self._stamp(message, now_ns)
        self._hand.put(read_wrench(message, self._actor.wrenches), now_ns)

    def _on_twist(self, message: TwistStamped, now_ns: int) -> None:
        self._stamp(message, now_ns)
        self._twist.put(read_twist(message, self._bounds), now_ns)
