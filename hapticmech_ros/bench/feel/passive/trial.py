"""One trial: a scene, a device, a hand and a connection, for some time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.bench.feel.passive.hands import HANDS
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.scene import Scene, load_scene
from hapticmech_ros.scene.controller import Connection
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.gain_rule import damping_for
from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand
from hapticmech_ros.session import Session

# Constraint stiffness of every trial, N/m, whatever the rule would give.
STIFFNESS = 2000.0
JITTER, LOSS = 0.2, 0.05
# J: E_h is never to be less, beyond what the mechanism gave of its own.
ALLOWED_J = 1e-3
# A device this fast is out of anybody's hands, m/s or rad/s.
ESCAPED = 1e3


@dataclass(frozen=True, slots=True)
class Trial:
    """What is tried.

    Attributes:
        scene: name or path.
        device: preset, or "scene" for the scene's own.
        hand: of :data:`~hapticmech_ros.bench.feel.passive.hands.HANDS`.
        delay: s, each way.
        local: whether the device closes the loops that it can.
        control: whether passivity is controlled.
        seconds: s.
    """

    scene: str
    device: str = "scene"
    hand: str = "scene"
    delay: float = 0.0
    local: bool = True
    control: bool = True
    seconds: float = 60.0


@dataclass(frozen=True, slots=True)
class Found:
    """What came of a trial.

    Attributes:
        trial: it.
        lowest: J, least of W + ½ vᵀ Λ_d v - min(0, least E_m): what the hand put in, without what
            friction took, and with what the mechanism gave of its own.
        mechanism_gave: J, -min(0, least E_m).
        most_force: N, of the actuators.
        motion: m/s, rms of the device in the last quarter.
        chatter: N, rms of the change of the force from sample to sample in the last quarter.
        changed: share of the samples whose command was changed.
        drift: m, rms from device to operational point in the last quarter.
        ended: what ended it early; empty if nothing did.
    """

    trial: Trial
    lowest: float
    mechanism_gave: float
    most_force: float
    motion: float
    chatter: float
    changed: float
    drift: float
    ended: str

    @property
    def passive(self) -> bool:
        """Whether it was passive to the end."""
        return self.lowest >= -ALLOWED_J and not self.ended


def scene_of(trial: Trial) -> Scene:
    """Return the scene of a trial.

    Raises:
        SceneError: it cannot be loaded.
        InvalidInputError: an unknown hand, or a preset that there is none of.
    """
    if trial.hand not in HANDS:
        raise InvalidInputError("hand", trial.hand, f"must be one of {', '.join(HANDS)}")
    scene = load_scene(trial.scene)
    device = scene.device
    if trial.device != "scene":
        device = Device.model_validate({"preset": trial.device})
    controller = scene.controller
    damping = damping_for(STIFFNESS, device)
    gains = {"stiffness": STIFFNESS, "damping": damping, "local": trial.local}
    updated = {
        "joint_constraint": controller.joint_constraint.model_copy(update=gains),
        "force_channel": controller.force_channel.model_copy(update={"local": trial.local}),
        "passivity": controller.passivity.model_copy(update={"control": trial.control}),
    }
    late = Connection(delay=trial.delay, jitter=JITTER, loss=LOSS, seed=1)
    return scene.model_copy(
        update={
            "device": device,
            "hand": _turning(HANDS[trial.hand](scene, trial.seconds), device),
            "controller": controller.model_copy(update=updated),
            "connection": late,
        }
    )


def _turning(hand: Hand, device: Device) -> Hand:
    """Return a hand that does not spin a handle up that nothing holds against it."""
    if device.actuated == "all" or not isinstance(hand, ConstantWrenchHand):
        return hand
    return hand.model_copy(update={"torque": (0.0, 0.0, 0.0)})


def tried(trial: Trial) -> Found:
    """Run a trial.

    Raises:
        SceneError: it cannot be loaded.
        InvalidInputError: as :func:`scene_of`.
    """
    scene = scene_of(trial)
    session = Session(scene)
    inertia = np.array([scene.device.mass] * 3 + [scene.device.inertia] * 3)
    count = round(trial.seconds / session.period)
    seen = np.zeros((count, 5))
    work, gave, place = 0.0, 0.0, None
    added, ended, ticks = np.zeros(6), "", 0
    last: Array = np.zeros(3)
    for ticks in range(count):
        try:
            sample = session.tick()
        except HapticMechError as error:
            ended = str(error)
            break
        device = sample.device
        if place is not None:
            work -= float((device.applied - added) @ _way(place, device.pose))
        place, added = device.pose, session.compensation
        gave = max(gave, -session.energies.to_mechanism)
        twist, force = device.twist, device.applied[:3]
        drift = device.pose.translation - sample.point.pose.translation
        seen[ticks] = (
            work + 0.5 * float(twist @ (inertia * twist)) + gave,
            np.linalg.norm(force),
            np.linalg.norm(twist[:3]),
            np.linalg.norm(force - last),
            np.linalg.norm(drift),
        )
        last = force.copy()
        if np.abs(twist).max() > ESCAPED:
            ended = f"the device escaped at {sample.time:.3g} s"
            break
    seen = seen[: ticks + 1]
    rest = np.sqrt(np.mean(seen[3 * len(seen) // 4 :] ** 2, axis=0))
    return Found(
        trial,
        lowest=float(seen[:, 0].min()),
        mechanism_gave=gave,
        most_force=float(seen[:, 1].max()),
        motion=float(rest[2]),
        chatter=float(rest[3]),
        changed=session.passivity.changed / len(seen),
        drift=float(rest[4]),
        ended=ended,
    )


def _way(start: pin.SE3, end: pin.SE3) -> Array:
    turn = np.asarray(pin.log3(end.rotation @ start.rotation.T))
    return np.concatenate((end.translation - start.translation, turn))
