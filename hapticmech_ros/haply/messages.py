# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of Haply's Inverse service on its simulation channel, JSON of version 3.1.

On connection the service sends a full report of every device, configuration included. From then on
it answers each message with one frame, of states only (docs.haply.co/inverseSDK/service/realtime,
pages websocket-protocol and control-commands, version 3.5 of the service). Lengths are in m, forces
in N, quaternions w, x, y, z. Forces act until the next message; without one the device idles.

A WebSocket to a service that answers each message once, without a thread and without waiting.

The protocol is websockets' own, without its input and output; the caller polls the socket. At most
one message is unanswered: a stalled service must not find a queue of old forces when it resumes.
"""

from __future__ import annotations

import json
import math
import os
import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar
from urllib.parse import urlsplit

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.real_device import MOST_BUTTONS
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.system.installation import refuse_unmet

# The same as the extra ``haply`` in setup.py.
WEBSOCKETS = "websockets>=13"
# s between attempts to connect, and for one of them.
RETRY_S, CONNECT_S = 0.5, 2.0
_CHUNK = 1 << 16


class LinkError(HapticMechError):
    """A connection that cannot be made, or has ended."""


class Link:
    """One connection at a time, made again when it is lost.

    Args:
        uri: of the service, ``ws://HOST:PORT``.

    Raises:
        InstallationError: websockets is not installed.
        InvalidInputError: no such address.

    Attributes:
        is_open: whether messages can be sent.
        problem: why there is no connection; empty if there is one.
        unanswered: whether a message waits for its answer.
        connections: how many have been made.
    """

    def __init__(self, uri: str) -> None:
        refuse_unmet([WEBSOCKETS])
        self._uri = uri
        self._place = _place(uri)
        self._socket: socket.socket | None = None
        self._protocol = _protocol(uri)
        self._frames: list[str] = []
        self._parts = bytearray()
        self.is_open, self._greeted = False, False
        self._again = self._until = 0.0
        self.problem = "not connected yet"
        self.unanswered = False
        self.connections = 0

    def look(self) -> None:
        """Receive without waiting, and go on connecting if there is no connection."""
        try:
            if self._socket is None:
                self._begin()
            else:
                self._go_on(self._socket, 0.0)
        except (OSError, LinkError) as error:
            self.close(str(error))

    def send(self, text: str) -> bool:
        """Send a message, if the last one has been answered; return whether it was sent."""
        if self._socket is None or not self.is_open or self.unanswered:
            return False
        self._protocol.send_text(text.encode())
        self.unanswered = True
        try:
            self._flush(self._socket)
        except (OSError, LinkError) as error:
            self.close(str(error))
            return False
        return True

    def answers(self, wait: float) -> list[str]:
        """Return the frames that have come, the newest last.

        Args:
            wait: s, for the answer to the last message, or for a first frame if there was none.
        """
        end = time.monotonic() + wait
        while self._socket is not None and (self.unanswered or not self._frames):
            left = end - time.monotonic()
            try:
                self._go_on(self._socket, max(left, 0.0))
            except (OSError, LinkError) as error:
                self.close(str(error))
            if left <= 0.0:
                break
        found = list(self._frames)
        self._frames.clear()
        return found

    def close(self, reason: str = "closed") -> None:
        """End the connection now; the next is not tried before a while."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self.is_open, self.unanswered = None, False, False
        self.problem = f"{self._uri}: {reason}"
        self._again = max(self._again, time.monotonic() + RETRY_S)

    def _begin(self) -> None:
        """Try to connect, now and then."""
        now = time.monotonic()
        if now < self._again:
            return
        self._again, self._until = now + RETRY_S, now + CONNECT_S
        host, port = self._place
        known = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, kind, number, _, address = known[0]
        found = socket.socket(family, kind, number)
        found.setblocking(False)
        found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket, self._greeted = found, False
        self._protocol = _protocol(self._uri)
        self._frames.clear()
        self._parts.clear()
        found.connect_ex(address)

    def _go_on(self, link: socket.socket, wait: float) -> None:
        """Receive for up to ``wait`` s.

        Raises:
            LinkError: the connection has ended.
        """
        if not self._greeted:
            self._greet(link)
            return
        readable, _, _ = select.select([link], [], [], wait)
        if not readable:
            if not self.is_open and time.monotonic() > self._until:
                raise LinkError("it does not answer")
            return
        data = link.recv(_CHUNK)
        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
        self._take()
        self._flush(link)
        if not data:
            raise LinkError("it has ended the connection")

    def _greet(self, link: socket.socket) -> None:
        """Request a WebSocket once the connection is there."""
        _, writable, _ = select.select([], [link], [], 0.0)
        if not writable:
            if time.monotonic() > self._until:
                raise LinkError("it cannot be reached")
            return
        code = link.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            raise OSError(code, os.strerror(code))
        self._protocol.send_request(self._protocol.connect())
        self._greeted = True
        self._flush(link)

    def _take(self) -> None:
        """Process the protocol's events of received bytes."""
        from websockets.frames import Frame, Opcode

        for event in self._protocol.events_received():
            if not isinstance(event, Frame):
                if self._protocol.handshake_exc is not None:
                    raise LinkError(f"no such service: {self._protocol.handshake_exc}")
                self.is_open, self.unanswered, self.problem = True, False, ""
                self.connections += 1
            elif event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
                self._parts += event.data
                if len(self._parts) > LONGEST_FRAME:
                    raise LinkError(f"a message of more than {LONGEST_FRAME} bytes")
                if event.fin:
                    # Invalid UTF-8 is refused as invalid JSON.
                    self._frames.append(self._parts.decode(errors="replace"))
                    self._parts.clear()
                    self.unanswered = False

    def _flush(self, link: socket.socket) -> None:
        """Send the protocol's pending bytes.

        Raises:
            LinkError: it was not taken whole.
        """
        for data in self._protocol.data_to_send():
            if not data:
                link.shutdown(socket.SHUT_WR)
            elif link.send(data) < len(data):
                raise LinkError("it takes no more messages")


def _place(uri: str) -> tuple[str, int]:
    parts = urlsplit(uri)
    rule = "must be ws://HOST:PORT"
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        raise InvalidInputError("uri", uri, rule) from None
    if parts.scheme != "ws" or not host or port is None:
        raise InvalidInputError("uri", uri, rule)
    return host, port


def _protocol(uri: str) -> Any:
    # Here, as it takes 30 ms, and only this driver needs it.
    from websockets.client import ClientProtocol
    from websockets.uri import parse_uri

    return ClientProtocol(parse_uri(uri), max_size=LONGEST_FRAME)


SERVICE = "ws://127.0.0.1:10001"
# Name of this driver's session in Haply's Hub.
PROFILE = "hapticmech_ros:haply_device"
# Longest frame, bytes; those of one device are 2 kB long.
LONGEST_FRAME = 1 << 20
# Limits of a device of this size, m and m/s.
FARTHEST, FASTEST = 1.0, 20.0
INVERSE3 = "inverse3"
# Groups of handles that report their orientation, and their buttons.
_GRIPS = ("wireless_verse_grip", "verse_grip", "custom_verse_grip")
_IDENTITY = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "rotation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
    "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
}
_KINDS: dict[type, str] = {dict: "an object", list: "a list", str: "a text"}
Kind = TypeVar("Kind", dict[str, Any], list[Any], str)
# Tolerance of a quaternion's norm, in single precision.
_NORM = 1e-2
# Faults of a status, by the flag that is false.
_STATUS = {
    "started": "it has not started",
    "power_supply": "its power supply is off: its motors give no force",
    "calibrated": "it is not calibrated: put its handle where its manual says",
    "ready": "it is not ready",
}


class Cursor(NamedTuple):
    """An Inverse3's part of a frame, along the axes of its base.

    Attributes:
        position: (3,) m, from the base's origin.
        velocity: (3,) m/s.
        orientation: (3, 3) of the handle, in the handle's own reference axes; None without one.
        refusal: why it gives no force; empty if it does.
        buttons: of the handle, whether each is pressed: a, b and c of a wireless VerseGrip, the
            only one of a wired one.
    """

    position: Array
    velocity: Array
    orientation: Array | None
    refusal: str
    buttons: tuple[bool, ...] = ()


def parsed(text: str | bytes) -> Mapping[str, Any]:
    """Return a frame.

    Raises:
        InvalidInputError: it is no JSON object.
    """
    try:
        frame = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidInputError("frame", text[:80], f"must be JSON: {error}") from None
    return _object(frame, "frame")


class Found(NamedTuple):
    """An Inverse3 in the service's first report.

    Attributes:
        device_id: of it.
        known: notes on its configuration.
        cursor: its position.
    """

    device_id: str
    known: Mapping[str, str]
    cursor: Cursor


def found_in(frame: Mapping[str, Any], wanted: str) -> Found | None:
    """Return the wanted Inverse3, from the service's first report.

    Args:
        frame: from the service.
        wanted: its ``device_id``; empty: the only one there is.

    Returns:
        The device; None if there is none such.

    Raises:
        InvalidInputError: a frame of another form; several devices, and none is named; or lengths
            or axes that are not the device's own, by Haply's Hub for instance: masses felt and
            limits of stiffness would be wrong.
    """
    device = _device_of(frame, wanted)
    if device is None:
        return None
    identity = _checked(str, device.get("device_id"), "device_id")
    known = _checked_configuration(device)
    return Found(identity, known, _cursor(frame, device))


def _device_of(frame: Mapping[str, Any], wanted: str) -> Mapping[str, Any] | None:
    """Return the wanted Inverse3's part of a frame; None if it has none."""
    listed = _checked(list, frame.get(INVERSE3, []), INVERSE3)
    devices = [_object(one, INVERSE3) for one in listed]
    names = [_checked(str, one.get("device_id"), "device_id") for one in devices]
    if not wanted and len(devices) > 1:
        raise InvalidInputError("device_id", wanted, f"must be one of {', '.join(names)}")
    found = (one for one, name in zip(devices, names, strict=True) if wanted in ("", name))
    return next(found, None)


def _checked_configuration(device: Mapping[str, Any]) -> dict[str, str]:
    """Return notes on a device's configuration, if it is as delivered."""
    config = _object(device.get("config", {}), "config")
    basis = _object(config.get("basis", {}), "basis").get("permutation", "XYZ")
    if basis != "XYZ":
        raise InvalidInputError("basis of the device", basis, "must be XYZ: set it in Haply's Hub")
    state = _object(device.get("state", {}), "state")
    for name, owner in (("mount", config), ("transform", state)):
        given = _object(owner.get(name, {}), name)
        for part, neutral in _IDENTITY.items():
            found = _object(given.get(part, neutral), part)
            if any(found.get(key, value) != value for key, value in neutral.items()):
                rule = "must be as delivered: set it back in Haply's Hub"
                raise InvalidInputError(f"{name}.{part} of the device", found, rule)
    filters = _object(config.get("filters", {}), "filters")
    figures = {"handedness": config.get("handedness", ""), "type": config.get("type", INVERSE3)}
    for name, given in filters.items():
        figures[f"filter {name}"] = given
    return {name: str(value) for name, value in figures.items()}


def cursor_of(frame: Mapping[str, Any], wanted: str) -> Cursor | None:
    """Return the wanted Inverse3's part of a frame; None if it has none.

    Args:
        frame: from the service.
        wanted: its ``device_id``.

    Raises:
        InvalidInputError: a frame of another form, numbers that are not finite, or larger than
            any of such a device.
    """
    device = _device_of(frame, wanted)
    return None if device is None else _cursor(frame, device)


def _cursor(frame: Mapping[str, Any], device: Mapping[str, Any]) -> Cursor:
    state = _object(device.get("state"), "state")
    position = _vector(state, "cursor_position", FARTHEST)
    velocity = _vector(state, "cursor_velocity", FASTEST)
    status = _object(device.get("status", {}), "status")
    refused = [why for name, why in _STATUS.items() if status.get(name, True) is not True]
    grip = _grip_of(frame)
    return Cursor(position, velocity, _orientation(grip), "; ".join(refused), _buttons(grip))


def force_command(device_id: str, force: Sequence[float]) -> str:
    """Return the message that commands a force.

    Args:
        device_id: of the Inverse3.
        force: (3,) N, on the hand, along the axes of the device's base; finite.
    """
    x, y, z = (float(value) for value in force)
    vector = f'{{"x":{x!r},"y":{y!r},"z":{z!r}}}'
    command = f'"commands":{{"set_cursor_force":{{"vector":{vector}}}}}'
    return f'{{"{INVERSE3}":[{{"device_id":{json.dumps(device_id)},{command}}}]}}'


def greeting(device_id: str) -> str:
    """Return the first message: the session's name, and no force."""
    message = json.loads(force_command(device_id, (0.0, 0.0, 0.0)))
    return json.dumps({"session": {"configure": {"profile": {"name": PROFILE}}}, **message})


def whole_state() -> str:
    """Return the message that requests the service's first report again."""
    return json.dumps({"session": {"force_render_full_state": {}}})


def _grip_of(frame: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the state of the first handle in a frame; without one nothing."""
    for group in _GRIPS:
        for grip in _checked(list, frame.get(group, []), group):
            state = _object(_object(grip, group).get("state", {}), "state")
            if "orientation" in state or "buttons" in state or "button" in state:
                return state
    return {}


def _orientation(grip: Mapping[str, Any]) -> Array | None:
    """Return the orientation (3, 3) in the state of a handle, if it has one."""
    if "orientation" not in grip:
        return None
    given = _numbers(grip["orientation"], "orientation", "wxyz", 1.0 + _NORM)
    norm = math.sqrt(sum(value * value for value in given))
    if abs(norm - 1.0) > _NORM:
        raise InvalidInputError("orientation", given, "must have a norm of 1")
    w, x, y, z = (value / norm for value in given)
    return np.asarray(pin.Quaternion(w, x, y, z).toRotationMatrix())


def _buttons(grip: Mapping[str, Any]) -> tuple[bool, ...]:
    """Return which buttons in the state of a handle are pressed, in the order of their names."""
    given = _object(grip.get("buttons", {}), "buttons")
    found = [given[name] for name in sorted(given)] or [grip[k] for k in ("button",) if k in grip]
    for pressed in found:
        if not isinstance(pressed, bool):
            raise InvalidInputError("buttons", pressed, "must be true or false")
    if len(found) > MOST_BUTTONS:
        raise InvalidInputError("buttons", len(found), f"must be at most {MOST_BUTTONS}")
    return tuple(found)


def _vector(state: Mapping[str, Any], name: str, largest: float) -> Array:
    return np.array(_numbers(state.get(name), name, "xyz", largest))


def _numbers(given: Any, name: str, keys: str, largest: float) -> list[float]:
    """Return numbers by their keys, each of a magnitude up to ``largest``."""
    owner = _object(given, name)
    found = [owner.get(key) for key in keys]
    for value in found:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InvalidInputError(name, given, f"must have numbers {', '.join(keys)}")
        if not abs(value) <= largest:
            raise InvalidInputError(name, value, f"must be within ±{largest:g}")
    return [float(value) for value in found if value is not None]


def _checked(kind: type[Kind], given: Any, name: str) -> Kind:
    """Return the value in a frame, if it is of a kind; an empty text is none."""
    if not isinstance(given, kind) or given == "":
        raise InvalidInputError(name, given, f"must be {_KINDS[kind]}")
    return given


def _object(given: Any, name: str) -> dict[str, Any]:
    return _checked(dict, given, name)
