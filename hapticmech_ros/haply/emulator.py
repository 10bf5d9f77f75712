# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An Inverse service with an Inverse3, both simulated: for tests, and for trying without a device.

It answers by the service's documentation, see :mod:`~hapticmech_ros.haply.messages`, with the
mechanics of the scene's device and hand behind it, in real time. How long the real service keeps a
force after the last message is not documented; here it is ``idle_after``.
"""

from __future__ import annotations

import asyncio
import json
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TextIO

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import NO_WRENCH, DeviceState, ImpedanceDevice
from hapticmech_ros.errors import InvalidInputError, check_one_of
from hapticmech_ros.haply.messages import INVERSE3, LONGEST_FRAME, WEBSOCKETS
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.device import Compensation
from hapticmech_ros.system.installation import refuse_unmet

DEVICE_ID, GRIP_ID = "EM03", "EM13"
# Of a wireless VerseGrip.
BUTTONS = ("a", "b", "c")
# Where the cursor is at the start, in the axes of the device's base, m: in the middle of its reach.
START = np.array([0.0, -0.15, 0.2])
# s: a step of the mechanics, the longest stall that is caught up, how often they go on without a
# message, and how long a client may take to acknowledge the end.
STEP, _LONGEST_STALL, _IDLE_ROUND, _CLOSING = 0.00025, 0.2, 0.002, 0.5
_GROUP = "wireless_verse_grip"
TRACE_HEADING = "time,x,y,z,fx,fy,fz,hx,hy,hz\n"


@dataclass(frozen=True, slots=True)
class Press:
    """A button of the handle that is pressed for a while.

    Attributes:
        button: of :data:`BUTTONS`.
        start: s after the first message.
        end: likewise, when it is released.
    """

    button: str
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class Faults:
    """Simulated faults of the service.

    Attributes:
        delay: s by which each answer is late.
        jitter: s, further, evenly distributed from 0.
        garbage: share of answers that are changed at random.
        silent: share of messages that are not answered, and not obeyed.
        seed: of random numbers.
    """

    delay: float = 0.0
    jitter: float = 0.0
    garbage: float = 0.0
    silent: float = 0.0
    seed: int = 0


class EmulatedInverse3:
    """The device and the hand that holds it.

    Args:
        scene: whose device and hand; the hand's time begins with the first message.
        mounting: (3, 3) axes of the device's base in the world.
        idle_after: s after the last message without which there is no force any more.
        trace: takes a row of CSV for each ms: time, s, position, force of the actuators and force
            of the hand in the world's axes, m and N.
        clock: monotonic, s.
        presses: of the handle's buttons.

    Raises:
        InvalidInputError: a button that the handle has not, or that is released before it is
            pressed.
    """

    def __init__(
        self,
        scene: Scene,
        mounting: Array,
        idle_after: float = 0.01,
        trace: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
        presses: Sequence[Press] = (),
    ) -> None:
        for one in presses:
            check_one_of("button", one.button, BUTTONS)
            if not 0.0 <= one.start < one.end:
                rule = "must be pressed at 0 s or later, and released after that"
                raise InvalidInputError(f"press of {one.button}", (one.start, one.end), rule)
        self._presses = tuple(presses)
        # The client's driver adds compensation to commands.
        known = {"compensation": Compensation(), "force_sensor": "measured", "substeps": 1}
        planar = scene.task_space == "planar"
        device = scene.device.model_copy(update=known)
        self._device = ImpedanceDevice(device, STEP, planar, scene.hand)
        self._mounting, self._idle_after, self._clock = mounting, idle_after, clock
        self._state: DeviceState = self._device.at_rest(pin.SE3.Identity())
        self._held: DeviceState | None = None
        self._ticks = 0
        self._force, self._obeyed = np.zeros(3), -np.inf
        self._time = clock()
        self._trace, self._traced = trace, -np.inf
        if trace is not None:
            trace.write(TRACE_HEADING)

    def obey(self, force: Array) -> None:
        """Give a force from now on.

        Args:
            force: (3,) N, on the hand, along the axes of the base.
        """
        self.go_on()
        if self._held is None:
            self._held = self._state
        self._force, self._obeyed = self._mounting @ force, self._time

    def idle(self) -> None:
        """Give no force from now on."""
        self.go_on()
        self._obeyed = -np.inf

    @property
    def gives(self) -> bool:
        """Whether a force is given."""
        return self._time - self._obeyed <= self._idle_after

    def go_on(self) -> None:
        """Move until now."""
        now = self._clock()
        self._time = max(self._time, now - _LONGEST_STALL)
        while self._time + STEP <= now:
            command = np.concatenate((self._force, np.zeros(3))) if self.gives else None
            self._state = self._device.step(self._state, command, self._held, self._ticks)
            self._ticks += self._held is not None
            self._time += STEP
            self._record(NO_WRENCH if command is None else command)

    def state(self) -> dict[str, Any]:
        """Return the cursor's part of a frame."""
        state = self._state
        position = START + self._mounting.T @ state.measured_pose.translation
        velocity = self._mounting.T @ state.measured_twist[:3]
        force = self._mounting.T @ self._force if self.gives else np.zeros(3)
        return {
            "cursor_position": _vector(position),
            "cursor_velocity": _vector(velocity),
            "current_cursor_force": _vector(force),
            "control_domain": "cartesian",
            "control_mode": "force" if self.gives else "idle",
            "transform": {},
        }

    def grip(self) -> dict[str, Any]:
        """Return the handle's part of a frame."""
        since = self._ticks * STEP if self._held is not None else -1.0
        pressed = {one.button for one in self._presses if one.start <= since < one.end}
        buttons = {name: name in pressed for name in BUTTONS}
        return {"orientation": self.orientation(), "buttons": buttons, "hall": 0}

    def orientation(self) -> dict[str, float]:
        """Return the handle's quaternion, in the axes of the base."""
        rotation = self._mounting.T @ self._state.measured_pose.rotation
        x, y, z, w = quaternion_of(np.asarray(rotation)).tolist()
        return {"w": w, "x": x, "y": y, "z": z}

    def _record(self, command: Array) -> None:
        if self._trace is None or self._time < self._traced + 0.001 - 0.5 * STEP:
            return
        self._traced = self._time
        state = self._state
        row = (self._time, *state.pose.translation, *command[:3], *state.hand_wrench[:3])
        self._trace.write(",".join(f"{value:.9g}" for value in row) + "\n")
        self._trace.flush()


class Service:
    """Answers each message with one frame.

    Args:
        device: behind it.
        faults: to simulate; none if left out.
    """

    def __init__(self, device: EmulatedInverse3, faults: Faults | None = None) -> None:
        refuse_unmet([WEBSOCKETS])
        self._device, self._faults = device, faults or Faults()
        self._chance = random.Random(self._faults.seed)
        self._sessions = 0

    async def serve(self, host: str, port: int, ready: Callable[[int], None]) -> None:
        """Serve until cancelled.

        Args:
            host: address to listen at.
            port: to listen at; 0: any that is free.
            ready: called with the port once clients can come.
        """
        from websockets.asyncio.server import serve

        options = {"compression": None, "max_size": LONGEST_FRAME, "close_timeout": _CLOSING}
        server = await serve(self._session, host, port, **options)
        async with server:
            ready(next(iter(server.sockets)).getsockname()[1])
            while True:
                await asyncio.sleep(_IDLE_ROUND)
                self._device.go_on()

    async def _session(self, connection: Any) -> None:
        """Serve one client; with its end ends its force."""
        from websockets.exceptions import ConnectionClosed

        self._sessions += 1
        number = self._sessions
        try:
            await connection.send(self._frame(number, whole=True))
            async for message in connection:
                if self._chance.random() < self._faults.silent:
                    continue
                wanted = self._obey(message)
                late = self._faults.delay + self._chance.random() * self._faults.jitter
                if late > 0.0:
                    await asyncio.sleep(late)
                await connection.send(self._spoilt(self._frame(number, wanted)))
        except ConnectionClosed:
            pass
        finally:
            self._device.idle()

    def _obey(self, message: str | bytes) -> bool:
        """Execute a message; return whether it requests a full report."""
        try:
            document = json.loads(message)
            force = _commanded(document)
        except (ValueError, KeyError, TypeError, AttributeError):
            # Unknown commands are ignored, as by the service.
            return False
        if force is None:
            self._device.go_on()
        else:
            self._device.obey(force)
        return "force_render_full_state" in (document.get("session") or {})

    def _frame(self, session: int, whole: bool = False) -> str:
        self._device.go_on()
        status = {
            "calibrated": True, "in_use": True, "power_supply": True, "ready": True, "started": True
        }  # fmt: skip
        device = {"device_id": DEVICE_ID, "state": self._device.state(), "status": status}
        grip = {"device_id": GRIP_ID, "state": self._device.grip()}
        if whole:
            device["config"] = {
                "type": INVERSE3,
                "handedness": "right",
                "basis": {"permutation": "XYZ"},
                "filters": {"force_gate": {"gain": 0.0}, "damping": {"scalar": 0.0}},
            }
        return json.dumps({"session_id": session, INVERSE3: [device], _GROUP: [grip]})

    def _spoilt(self, text: str) -> str:
        """Return a frame, changed at random now and then."""
        chance = self._chance
        return spoilt(text, chance) if chance.random() < self._faults.garbage else text


def spoilt(text: str, chance: random.Random) -> str:
    """Return a text with characters changed, cut off or repeated, or with other numbers."""
    kind = chance.randrange(5)
    place = chance.randrange(len(text))
    if kind == 0:
        return text[:place]
    if kind == 1:
        return text[:place] + chr(chance.randrange(32, 0x3000)) + text[place + 1 :]
    if kind == 2:
        return text[:place] + text[place // 2 :]
    if kind == 3:
        number = chance.choice(("NaN", "1e999", "-Infinity", "true", "null", '"1"', "[]", "1e6"))
        names = '"x": ', '"y": ', '"z": ', '"w": '
        name = chance.choice(names)
        parts = text.split(name)
        index = chance.randrange(1, len(parts)) if len(parts) > 1 else 0
        if index:
            parts[index] = number + parts[index].lstrip("-0123456789.e+")
        return name.join(parts)
    return chance.choice(("", "[]", "{}", "null", "[" * 5000, '{"inverse3": {}}', "\0" * 10))


def _commanded(document: dict[str, Any]) -> Array | None:
    """Return the force (3,) that a message commands, N; None if it commands none."""
    for device in document.get(INVERSE3, []):
        given = device.get("commands", {}).get("set_cursor_force")
        if given is not None:
            vector = given["vector"]
            force = np.array([float(vector[key]) for key in "xyz"])
            if not np.isfinite(force).all():
                raise InvalidInputError("set_cursor_force", vector, "must be finite")
            return force
    return None


def _vector(values: Array) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))
