# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node cannot start with: it ends with exit code 1 and a sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ros.harness import WAIT_S, running, scene_like

CODE = "from hapticmech_ros.nodes.entry import mechanism_simulator as run; run()"


def ends(*arguments: str) -> str:
    """Return what a node says that must end by itself, without a traceback."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, "--ros-args", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    return done.stderr


def test_a_topic_whose_name_is_too_long_is_said(domain, tmp_path):
    """A point's name and a namespace, each of which is short enough by itself."""
    scene = scene_like(tmp_path, "two_link", f"operational_points[0].name={'p' * 100}")
    said = ends("-p", f"scene:={scene}", "-r", f"__ns:=/{'n' * 150}")
    assert "cannot be configured: InvalidTopicNameException" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-r", f"__ns:=/{'n' * 300}"), "invalid node namespace"),
        (("-r", f"__ns:=/{'n' * 230}"), "topic length should not exceed"),
        (("--params-file", "/nowhere.yaml"), "No such file or directory"),
        (("--params-file", "/dev/zero"), "must be a regular file"),
        (("--params-file", "{pipe}"), "must be a regular file"),
        (("-p", "scene:="), "parameter override"),
        (("-p", f"scene:={'x' * 300}"), "no such file, nor a shipped scene"),
    ],
)
def test_arguments_that_cannot_be_taken_are_said(domain, arguments, words, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert words in ends(*(argument.format(pipe=pipe) for argument in arguments))


ROBOT = str(Path(__file__).resolve().parents[2] / "examples/iiwa14.yaml")
DEVICE, CONTROLLER, FOLLOWER = "haptic_device", "teleoperation_controller", "robot_follower"
RATED = {"linear_rate": -1.0}
TOO_SHORT = "must be 0 or at least 3 periods of 250 Hz, 0.012 s (got 0.011)"


@pytest.mark.parametrize(
    ("node", "given", "words"),
    [
        (DEVICE, {"view_rate": 5000.0}, ("view_rate", "5000")),
        (DEVICE, {"hand": "octopus"}, ("hand", "octopus", "commanded")),
        (DEVICE, {"command_timeout": "soon"}, ("command_timeout", "soon")),
        (DEVICE, {"lockstep": True}, ("lockstep", "use_sim_time")),
        # Less safe than the scene allows; each bound: test/nodes/test_device_limits.py.
        (DEVICE, {"force_limit": 1000.0}, ("force_limit: must be", "got 1000")),
        (DEVICE, {"command_timeout": 1.0}, ("command_timeout: must be", "got 1")),
        (
            CONTROLLER,
            {"input_timeout": 0.5},
            (
                "input_timeout: must be at most the scene's device.safety.command_timeout, 0.1 "
                "(got 0.5)",
            ),
        ),
        # Shorter than any machine keeps.
        (DEVICE, {"command_timeout": 0.011}, (f"command_timeout: {TOO_SHORT}",)),
        ("mechanism_simulator", {"command_timeout": 0.011}, (f"command_timeout: {TOO_SHORT}",)),
        (CONTROLLER, {"input_timeout": 0.011}, (f"input_timeout: {TOO_SHORT}",)),
        (
            "mechanism_simulator",
            {"grasp": "link9 0 0 0"},
            ("grasp: must be one of link1, link2",),
        ),
        (FOLLOWER, {}, ("robot",)),
        (FOLLOWER, {"robot": ROBOT, "robot_point": "nose"}, ("nose",)),
        (FOLLOWER, {"robot": ROBOT, "command_type": "trajectory"}, ("position",)),
        (FOLLOWER, {"robot": ROBOT, "torque_limits": "1 2 x"}, ("torque_limits",)),
        (FOLLOWER, {"robot": "five_bar"}, ("no closures",)),
        (FOLLOWER, {"robot": ROBOT, **RATED}, ("loop_delay",)),
        (FOLLOWER, {"robot": ROBOT, "interface": "velocity", **RATED}, ("-1 is for torques",)),
        (
            FOLLOWER,
            {"robot": ROBOT, "loop_delay": 0.01, "payload_centre": "1", **RATED},
            ("three",),
        ),
    ],
)
def test_parameters_that_cannot_be_taken_are_said(
    domain: int,
    node: str,
    given: dict[str, object],
    words: tuple[str, ...],
    capfd: pytest.CaptureFixture[str],
) -> None:
    with running(node, domain, "two_link" if node == FOLLOWER else "five_bar", **given) as process:
        assert process.wait(WAIT_S) == 1
    told = capfd.readouterr().err
    assert all(word in told for word in words), told
    assert "Traceback" not in told
