# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The C++ header of the flat messages: offsets of the tables, and C++."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hapticmech_ros.cli import app
from hapticmech_ros.wire.table import FLAT_MESSAGES
from hapticmech_ros.wire.topics import TOPICS

NAMES = {
    "device/state": "device_state",
    "device/local_feedback_gain": "device_local_feedback_gain",
    "device/energy": "device_energy",
    "analysis/<point>/operational_model": "operational_model",
    "controller/energy": "controller_energy",
    "mechanism/energy": "mechanism_energy",
}


def header() -> str:
    done = CliRunner().invoke(app, ["topics", "--cpp"])
    assert done.exit_code == 0
    return done.stdout


def test_offsets_are_those_of_the_tables() -> None:
    inner = re.findall(r"^namespace (\w+) \{\n((?:constexpr.*\n)+)\}", header(), re.MULTILINE)
    found = {
        name: {field: int(at) for field, at in re.findall(r"size_t (\w+) = (\d+);", body)}
        for name, body in inner
    }
    assert found == {
        NAMES[topic]: {"size": fields.size, **{name: fields.start(name) for name in fields}}
        for topic, fields in FLAT_MESSAGES.items()
    }


def test_messages_are_topics_of_the_graph() -> None:
    known = {topic.name.replace("{point}", "<point>") for topic in TOPICS}
    assert set(FLAT_MESSAGES) == set(NAMES) <= known


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_a_compiler_takes_it(tmp_path: Path) -> None:
    (tmp_path / "hapticmech_ros.hpp").write_text(header())
    checks = [
        f'static_assert(hapticmech_ros::{NAMES[topic]}::{field} == {fields.start(field)}, "");'
        for topic, fields in FLAT_MESSAGES.items()
        for field in fields
    ]
    program = tmp_path / "check.cpp"
    program.write_text('#include "hapticmech_ros.hpp"\n' + "\n".join(checks) + "\n")
    command = ["g++", "-std=c++17", "-Wall", "-Werror", "-fsyntax-only", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_a_compiler_takes_the_program_of_the_page_on_topics(tmp_path: Path) -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "topics.md"
    (reader,) = re.findall(r"```cpp\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "hapticmech_ros.hpp").write_text(header())
    program = tmp_path / "reader.cpp"
    program.write_text("#include <std_msgs/msg/float64_multi_array.hpp>\n" + reader)
    include = [f"-I{path}" for path in (Path(sys.prefix) / "include").iterdir() if path.is_dir()]
    command = ["g++", "-std=c++17", "-fsyntax-only", *include, str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
