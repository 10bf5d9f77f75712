# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Haply's service says, as its documentation and other people's programs quote it."""

from __future__ import annotations

import json
import random

import numpy as np
import pytest

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.haply.emulator import spoilt
from hapticmech_ros.haply.messages import (
    cursor_of,
    force_command,
    found_in,
    greeting,
    parsed,
    whole_state,
)

POINT = {"x": 0, "y": 0, "z": 0}
# The keys of the page websocket-protocol of docs.haply.co, version 3.5, in their order.
FIRST = {
    "session_id": 7,
    "inverse3": [
        {
            "device_id": "049D",
            "config": {
                "type": "inverse3",
                "port": "COM12",
                "device_info": {"major_version": 7, "minor_version": 4, "id": "049D"},
                "gravity_compensation": {"enabled": True, "scaling_factor": 1.0},
                "handedness": "left",
                "basis": {"permutation": "XYZ"},
                "mount": {
                    "position": POINT,
                    "rotation": {"w": 1, **POINT},
                    "scale": {"x": 1, "y": 1, "z": 1},
                },
                "filters": {"force_gate": {"gain": 0.3}, "damping": {"scalar": 0.0}},
            },
            "state": {
                "cursor_position": {"x": 0.0, "y": -0.12, "z": 0.15},
                "cursor_velocity": {"x": 0.1, "y": 0.2, "z": -0.3},
                "angular_position": {"a0": 0.0, "a1": 0.0, "a2": 0.0},
                "current_cursor_force": POINT,
                "control_domain": "cartesian",
                "control_mode": "idle",
                "transform": {"position": POINT},
            },
            "status": {
                "calibrated": True,
                "in_use": False,
                "power_supply": True,
                "ready": True,
                "started": True,
            },
        }
    ],
    "wireless_verse_grip": [
        {
            "device_id": "61576",
            "state": {"hall": 1, "orientation": {"w": 0.6, "x": 0.0, "y": 0.0, "z": 0.8}},
        }
    ],
}


def changed(path, value):
    """Return the first frame with another value at a path of keys and indices."""
    frame = json.loads(json.dumps(FIRST))
    owner = frame
    for key in path[:-1]:
        owner = owner[key]
    owner[path[-1]] = value
    return frame


def test_the_documented_frame_is_understood():
    found = found_in(FIRST, "")
    assert found.device_id == "049D"
    assert found.known["handedness"] == "left"
    assert found.known["filter force_gate"] == "{'gain': 0.3}"
    cursor = found.cursor
    assert cursor.position.tolist() == [0.0, -0.12, 0.15]
    assert cursor.velocity.tolist() == [0.1, 0.2, -0.3]
    assert cursor.refusal == ""
    # 0.6 and 0.8 are cosine and sine of half the angle about z.
    angle = 2.0 * np.arctan2(0.8, 0.6)
    c, s = np.cos(angle), np.sin(angle)
    assert cursor.orientation == pytest.approx(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))


def test_without_a_handle_there_is_no_orientation():
    frame = {key: value for key, value in FIRST.items() if key != "wireless_verse_grip"}
    assert cursor_of(frame, "049D").orientation is None


def test_another_device_is_not_there():
    assert cursor_of(FIRST, "0000") is None
    assert found_in({"inverse3": []}, "") is None
    assert found_in({}, "049D") is None


def test_of_several_devices_one_is_named():
    two = changed(("inverse3",), [{**FIRST["inverse3"][0], "device_id": n} for n in ("A", "B")])
    with pytest.raises(InvalidInputError, match="must be one of A, B"):
        found_in(two, "")
    assert found_in(two, "B").device_id == "B"


@pytest.mark.parametrize("name", ["calibrated", "power_supply", "ready", "started"])
def test_a_device_that_gives_no_force_says_why(name):
    frame = changed(("inverse3", 0, "status", name), False)
    assert cursor_of(frame, "049D").refusal


def with_grip(group, **state):
    """Return a frame whose only handle tells this of itself."""
    frame = {key: value for key, value in FIRST.items() if "grip" not in key}
    return {**frame, group: [{"device_id": "61548", "state": state}]}


@pytest.mark.parametrize(
    ("group", "state", "pressed"),
    [
        (
            "wireless_verse_grip",
            {"buttons": {"a": True, "b": False, "c": True}},
            (True, False, True),
        ),
        (
            "wireless_verse_grip",
            {"buttons": {"c": True, "a": False, "b": False}},
            (False, False, True),
        ),
        ("verse_grip", {"button": True, "hall": 3}, (True,)),
        ("custom_verse_grip", {"hall": 3}, ()),
    ],
)
def test_buttons_of_a_handle_are_read_in_the_order_of_their_names(group, state, pressed):
    cursor = cursor_of(with_grip(group, **state), "049D")
    assert cursor.buttons == pressed


OF_HANDLE, OF_DEVICE = ("wireless_verse_grip", 0, "state"), ("inverse3", 0)
# Where a frame is changed, to what, and what the error names.
REFUSED = [
    *(
        ((*OF_DEVICE, *path), value, named)
        for path, value, named in (
            # What would scale or turn all that is felt.
            (("config", "basis", "permutation"), "XZY", "basis"),
            (("config", "mount", "scale"), {"x": 2, "y": 2, "z": 2}, "mount.scale"),
            (("config", "mount", "position", "x"), 0.1, "mount.position"),
            (("state", "transform", "rotation"), {"w": 0, "x": 1}, "transform.rotation"),
        )
    ),
    *(
        ((*OF_DEVICE, "state", "cursor_position", "y"), value, "cursor_position")
        for value in (None, True, "1", [], float("nan"), float("inf"), 1.5, -2.0)
    ),
    ((*OF_HANDLE, "orientation"), {}, "orientation"),
    ((*OF_HANDLE, "orientation"), {"w": 0.5, "x": 0.0, "y": 0.0, "z": 0.0}, "orientation"),
    (OF_HANDLE, {"buttons": {"a": 1}}, "buttons: must be true or false"),
    (OF_HANDLE, {"button": "yes"}, "buttons: must be true or false"),
    (OF_HANDLE, {"buttons": [True]}, "buttons: must be an object"),
    (OF_HANDLE, {"buttons": {f"b{i}": True for i in range(33)}}, "buttons: must be at most 32"),
]


@pytest.mark.parametrize(("path", "value", "named"), REFUSED)
def test_what_breaks_a_rule_is_refused(path, value, named):
    with pytest.raises(InvalidInputError, match=named):
        found_in(changed(path, value), "")


def test_a_force_is_written_as_documented():
    message = json.loads(force_command("049D", np.array([0.5, -1e-9, 3.0])))
    force = {"vector": {"x": 0.5, "y": -1e-9, "z": 3.0}}
    command = {"device_id": "049D", "commands": {"set_cursor_force": force}}
    assert message == {"inverse3": [command]}


def test_the_first_message_says_who_it_is_and_asks_for_no_force():
    message = json.loads(greeting('a"b'))
    assert message["session"]["configure"]["profile"]["name"].startswith("hapticmech_ros")
    (device,) = message["inverse3"]
    assert device["device_id"] == 'a"b'
    assert set(device["commands"]["set_cursor_force"]["vector"].values()) == {0.0}
    assert json.loads(whole_state()) == {"session": {"force_render_full_state": {}}}


def test_whatever_comes_is_understood_or_refused():
    text, chance, outcomes = json.dumps(FIRST), random.Random(22), set()
    for _ in range(20_000):
        try:
            frame = parsed(spoilt(text, chance))
            found_in(frame, "")
            cursor = cursor_of(frame, "049D")
            outcomes.add("none" if cursor is None else "read")
            if cursor is not None:
                assert np.abs(cursor.position).max() <= 1.0
                assert np.abs(cursor.velocity).max() <= 20.0
        except HapticMechError:
            outcomes.add("refused")
    assert outcomes == {"none", "read", "refused"}
