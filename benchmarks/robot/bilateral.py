# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand, a device, a mechanism, a robot and a wall: what the hand feels of the wall.

The session is that of the package, with a simulated device and hand; the robot is MuJoCo's and
follows the operational point. Samples and wrenches take a period each way, as over topics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.robot.driven import STEPS, DrivenRobot
from benchmarks.robot.tasks import IIWA, IIWA_LIMITS
from benchmarks.robot.trial import PERIOD
from hapticmech_ros import Mechanism, Session, load_scene
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.interfaces import FeedbackPort, FeedbackSettings, Interface
from hapticmech_ros.robot.law import Gains, OperationalLaw
from hapticmech_ros.robot.mujoco_robot import Around, MujocoRobot, Wall

SCENE = "two_link"
# A hand that goes 30 mm through where the wall is 10 mm away, and stays; N/m, N s/m.
HAND = (
    "hand={kind: spring_damper, stiffness: 300.0, damping: 5.0, angular_stiffness: 0.001, "
    "angular_damping: 0.001, waypoints: [{time: 0.0}, {time: 1.5, xyz: [-0.03, 0.0, 0.0]}]}"
)
GAP, RADIUS = 0.010, 0.01
INTO = np.array([-1.0, 0.0, 0.0])
# s in all, and of these at the end at rest on the wall.
SECONDS, RESTING = 4.0, 0.5
# J that a port may give beyond what it took: what rounding and sampling make of motions of mJ.
ALLOWED_J = 1e-3
# Force and torque of a contact that the mechanism is given at most, N and N m.
MOST = 20.0, 2.0


@dataclass(frozen=True)
class Felt:
    """What was felt of a wall.

    Attributes:
        interface: of the robot.
        feedback: share of the contact that acts on the mechanism.
        wall_n: mean force of the robot on the wall at rest.
        hand_n: mean force of the hand at rest.
        swing_n: half of the range of the wall's force at rest.
        peak_n: largest force on the wall.
        lag_mm: largest distance between the mechanism's motion and the robot's, before the wall.
        hand_j: least energy that the hand has given so far.
        coupling_j: most energy that the robot's side has given to the mechanism beyond what the
            mechanism's motion gave it.
        held: whether the feedback was held to passivity.
        changed: periods in which that changed it.
    """

    interface: str
    feedback: float
    wall_n: float
    hand_n: float
    swing_n: float
    peak_n: float
    lag_mm: float
    hand_j: float
    coupling_j: float
    held: bool
    changed: int

    @property
    def passive(self) -> bool:
        """Whether the hand has never been given energy by a loop that had none."""
        return self.hand_j >= -ALLOWED_J


class _Robot(DrivenRobot):
    """An iiwa in MuJoCo, which a wall is before."""

    def __init__(self, interface: Interface, rate: float, with_rates: bool) -> None:
        scene = load_scene(IIWA)
        law = OperationalLaw(
            Mechanism(scene),
            gains=Gains(linear_rate=rate, angular_rate=rate),
            torque_limits=np.array(IIWA_LIMITS),
        )
        at_rest = law.state(law.posture, 0.0 * law.posture)
        self.start = at_rest.point.pose.translation.copy()
        wall = Wall(self.start + (GAP + RADIUS) * INTO, -INTO)
        robot = MujocoRobot(scene, around=Around(wall, RADIUS), step=PERIOD / STEPS)
        super().__init__(robot, law, interface, with_rates, PERIOD)


def felt(
    interface: Interface,
    feedback: float,
    with_rates: bool = False,
    rate: float = 40.0,
    passive: bool = True,
) -> Felt:
    """Return what a hand feels of a wall that the robot touches.

    Args:
        interface: of the robot.
        feedback: share of the contact that acts on the mechanism.
        with_rates: whether positions come with their rates, as in a trajectory.
        rate: of the law's errors, 1/s.
        passive: whether the feedback is held to passivity.
    """
    session = Session(load_scene(SCENE, changes=[HAND]))
    robot = _Robot(interface, rate, with_rates)
    port = FeedbackPort(FeedbackSettings(PERIOD, feedback, *MOST, passive))
    given = acted = before = np.zeros(6)
    handle: Array | None = None
    forces, hands, lag = [], [], 0.0
    hand_j = least = coupling = most = 0.0
    for tick in range(round(SECONDS / PERIOD)):
        sample = session.tick(external_wrench=given)
        point = sample.seen.point
        if handle is None:
            handle = point.pose.translation.copy()
        hand_j += PERIOD * float(sample.hand_wrench @ sample.device.twist)
        # What acted from the last sample to this one.
        coupling += 0.5 * PERIOD * float(acted @ (before + point.twist))
        acted, before = given, point.twist.copy()
        least, most = min(least, hand_j), max(most, coupling)
        robot.follower.update_target(point.pose, point.twist, PERIOD * tick)
        contact = robot.move(PERIOD * tick, robot.robot.contact_wrench())
        given = port.wrench(contact, point.twist)
        forces.append(-float(INTO @ contact[:3]))
        hands.append(float(INTO @ sample.hand_wrench[:3]))
        if max(forces) == 0.0:
            moved = robot.robot.pose.translation - robot.start
            lag = max(lag, float(np.linalg.norm(moved - (point.pose.translation - handle))))
    resting = slice(-round(RESTING / PERIOD), None)
    at_rest = np.array(forces[resting])
    return Felt(
        f"{interface}, rates" if with_rates else interface,
        feedback,
        float(at_rest.mean()),
        float(np.mean(hands[resting])),
        0.5 * float(np.ptp(at_rest)),
        max(forces),
        1e3 * lag,
        least,
        most,
        passive,
        port.changed,
    )
