# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options of `hapticmech run` that are more than a word."""

import pytest

from commands import printed_by, ran
from hapticmech_ros.cli.console import seconds_of
from hapticmech_ros.cli.graph import drivers_of, nodes_of, refuse_one_device_twice
from hapticmech_ros.errors import InvalidInputError


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("50ms", 0.05), ("0.05s", 0.05), ("0.05", 0.05), (" 200 us", 2e-4), (".5 s", 0.5), ("0", 0.0)],
)
def test_durations_are_read_as_people_write_them(text, seconds):
    assert seconds_of("--x", text) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "ms", "-5ms", "50 m", "nan", "1,5s", "50ms each"])
def test_what_is_no_duration_is_refused(text):
    with pytest.raises(InvalidInputError, match="--x: must be a duration"):
        seconds_of("--x", text)


def test_some_nodes_run_here_in_the_order_of_the_graph():
    assert len(nodes_of([])) == 4
    chosen = nodes_of(["teleoperation_controller", "mechanism_simulator"])
    assert chosen == ["mechanism_simulator", "teleoperation_controller"]


HELD = ("left", "right")
OF_ONE = ("haptic_device", "nullspace_analyser", "teleoperation_controller")


@pytest.mark.parametrize(
    ("only", "chosen"),
    [
        (["left/haptic_device"], ["left/haptic_device"]),
        (["haptic_device"], ["left/haptic_device", "right/haptic_device"]),
        (
            ["right", "mechanism_simulator"],
            ["mechanism_simulator", *(f"right/{n}" for n in OF_ONE)],
        ),
        ([], ["mechanism_simulator", *(f"{point}/{n}" for point in HELD for n in OF_ONE)]),
    ],
)
def test_nodes_of_one_of_several_hands_run_here(only, chosen):
    assert sorted(nodes_of(only, held=HELD)) == sorted(chosen)


@pytest.mark.parametrize(
    ("name", "held", "words"),
    [
        ("middle", HELD, "middle"),
        ("left/mechanism_simulator", HELD, "left/mechanism_simulator"),
        ("haply_device", HELD, "haply_device"),
        ("left/", HELD, "left/"),
        ("left/haptic_device", ("left",), "--only"),
        ("scene_viewer", (), "--only"),
    ],
)
def test_what_no_hand_has_is_refused(name, held, words):
    with pytest.raises(InvalidInputError, match=words):
        nodes_of([name], held=held)


def test_a_driver_takes_the_place_of_the_simulated_device():
    assert nodes_of([], drivers_of(["haply"], ["handle"]))[0] == "haply_device"
    assert nodes_of([], drivers_of(["handle=relay"], ["handle"]))[0] == "relay_device"
    assert nodes_of([], {"": "relay"})[1:] == nodes_of([])[1:]


def test_a_driver_takes_the_place_of_one_of_several_devices():
    drivers = drivers_of(["right=haply"], HELD)
    assert drivers == {"left": "simulated", "right": "haply"}
    assert drivers_of(["relay", "right=haply"], HELD) == {"left": "relay", "right": "haply"}
    whole = nodes_of([], drivers, HELD)
    assert {"left/haptic_device", "right/haply_device", "mechanism_simulator"} <= set(whole)
    assert len(whole) == 7
    # --only names the part that it has in the graph, whoever plays it.
    assert nodes_of(["right/haptic_device"], drivers, HELD) == ["right/haply_device"]


@pytest.mark.parametrize("word", ["haplly", "right=haplly", "middle=haply", "=haply"])
def test_a_driver_or_a_place_that_is_none_is_refused(word):
    with pytest.raises(InvalidInputError, match=r"--device: .*must be one of"):
        drivers_of([word], HELD)


def test_one_real_device_is_not_driven_from_two_points():
    several = ("--hold", "load_middle", "--hold", "trolley_grip", "--device", "haply")
    with pytest.raises(InvalidInputError, match="a device of its own"):
        ran("run", "crane", *several)
    refuse_one_device_twice(nodes_of([], drivers_of(["haply", "left=relay"], HELD), HELD))
    both = nodes_of([], drivers_of(["haply"], HELD), HELD)
    told = [f"/{point}/haply_device.device_id" for point in HELD]
    refuse_one_device_twice(both, told)
    with pytest.raises(InvalidInputError, match="a device of its own"):
        refuse_one_device_twice(both, told[:1])
    # The other host has the other one.
    refuse_one_device_twice(nodes_of(["left"], drivers_of(["haply"], HELD), HELD))


INTERRUPTED = """
import signal
from hapticmech_ros.cli.graph import stop_by_signals

stop = stop_by_signals()
print(stop())
signal.raise_signal(signal.SIGTERM)
print(stop())
"""


def test_a_signal_is_seen_and_ends_nothing_by_itself():
    assert printed_by("-c", INTERRUPTED, timeout=60.0) == "False\nTrue\n"
