# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node cannot start with is said in a sentence, with exit code 1."""

import json
import os
import subprocess
import sys

import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.scene import document_of

pytestmark = pytest.mark.ros

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
    document = document_of(load_scene("two_link"))
    document["operational_points"][0]["name"] = "p" * 100
    scene = tmp_path / "long.yaml"
    scene.write_text(json.dumps(document))
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
