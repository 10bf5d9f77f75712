"""Linear laws of a controller at a position: what it answers to force, error and its rate.

u = G F_h - K e - B ė   on the device,      C3 F_h + K_m e + B_m ė   on the mechanism

Of K and B the device closes N_k and N_b itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.force_gain import force_gain
from hapticmech_ros.control.measurements import RenderingModel


@dataclass(frozen=True, slots=True)
class Law:
    """Gains of a controller at a position, (6, 6) each, world axes at the point held.

    Attributes:
        force: G, from F_h to the device's wrench.
        stiffness, damping: K and B, from e and ė to the device's wrench; N/m, N s/m and their like
            in rotation.
        hand: C3, from F_h to the mechanism's wrench.
        pull, drag: K_m and B_m, from e and ė to the mechanism's wrench.
        local: whether the device corrects G F_h by what F_h has become.
        near: N_k and N_b.
    """

    force: Array
    stiffness: Array
    damping: Array
    hand: Array
    pull: Array
    drag: Array
    local: bool
    near: tuple[Array, Array] = (np.zeros((6, 6)), np.zeros((6, 6)))


def law_of(control: ControlArchitecture, model: RenderingModel) -> Law:
    """Return the law of a scene's controllers, limits and ramps left out.

    Args:
        control: whose gains.
        model: what the analysis reports at the position.
    """
    joint, channels = control.gains.joint_constraint, control.channels
    x, share, projector = model.inverse_inertia, model.balanced_share, model.constraint_projector
    free = np.eye(6) - share
    position, feedback = control.gains.position_channel, channels.force.device_feedback
    rigid = joint.stiffness * projector, joint.damping * projector
    held = position.to_device * free
    nothing = np.zeros((6, 6))
    return Law(
        force=force_gain(control.device_inertia, x, share, joint.feedforward, feedback),
        stiffness=rigid[0] + held * channels.held_stiffness,
        damping=rigid[1] + held * channels.held_damping,
        hand=channels.force.hand * np.eye(6),
        pull=position.to_mechanism * np.diag(channels.stiffness),
        drag=position.to_mechanism * np.diag(channels.damping),
        local=control.gains.force_channel.local,
        near=rigid if joint.local else (nothing, nothing),
    )
