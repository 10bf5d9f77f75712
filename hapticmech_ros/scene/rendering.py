"""What renders the mechanism in a scene: perception, device, hand, gains."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand, SpringDamperHand, Waypoint
from hapticmech_ros.scene.part import Flag, NonNegative, Part, Positive, Real

__all__ = [
    "ConstantWrenchHand",
    "Controller",
    "Device",
    "Experiment",
    "ForceChannelGains",
    "Hand",
    "JointConstraintGains",
    "Perception",
    "PositionChannelGains",
    "SpringDamperHand",
    "Waypoint",
]


class Perception(Part):
    """Which directions count as rigid, in s = sqrt(mu) (docs/notation.md).

    Control weighs directions smoothly from 1 at ``s_on`` to 0 at ``s_off``; the reported count
    switches on below ``s_on`` and off above ``s_off``, each after ``dwell`` seconds.
    """

    s_on: Annotated[Positive, Field(lt=1.0)] = 0.02
    s_off: Annotated[Positive, Field(lt=1.0)] = 0.05
    dwell: NonNegative = 0.005


class JointConstraintGains(Part):
    """Finite stiffness that stands for rigid joints.

    Along a constrained direction n, normalised in the metric, the gain is per unit of the metric's
    mass: pure translation of the link meets ``stiffness`` N/m and ``damping`` N s/m.
    ``feedforward`` is beta, the share of what the hand pushes along n that is cancelled ahead.
    """

    stiffness: NonNegative = 2000.0
    damping: NonNegative = 40.0
    force_limit: Positive = 15.0
    torque_limit: Positive = 0.8
    feedforward: Annotated[Real, Field(ge=0.0, le=1.0)] = 0.0


class PositionChannelGains(Part):
    """Local position controllers C_m = C_s of the four-channel architecture: spring and damper."""

    stiffness: NonNegative = 300.0
    damping: NonNegative = 10.0
    angular_stiffness: NonNegative = 0.3
    angular_damping: NonNegative = 0.01


class ForceChannelGains(Part):
    """Force channels.

    Attributes:
        contact: C2, contact to hand.
        hand: C3, hand to mechanism.
        local: whether the device corrects each command by what the hand's wrench has changed since
            the sample that the command answers; see docs/feel.md.
    """

    contact: Annotated[Real, Field(ge=0.0, le=1.0)] = 1.0
    hand: Annotated[Real, Field(ge=0.0, le=1.0)] = 1.0
    local: Flag = True


class Controller(Part):
    """Gains of the three controllers of Fig. 3, and how they come in.

    Attributes:
        engagement_ramp: s, over which the wrench comes in when rendering starts.
        grasp_ramp: s, over which it passes from one grasp to another.
    """

    joint_constraint: JointConstraintGains = JointConstraintGains()
    position_channel: PositionChannelGains = PositionChannelGains()
    force_channel: ForceChannelGains = ForceChannelGains()
    engagement_ramp: NonNegative = 0.1
    grasp_ramp: NonNegative = 0.3


class Experiment(Part):
    """How long the experiment lasts after the hand starts, in s."""

    duration: Positive = 5.0
