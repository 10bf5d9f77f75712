# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is missing or too old is named at the start, in one sentence; versions agree everywhere."""

import json
import os
import re
import subprocess
import sys
from importlib.metadata import requires, version
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from commands import printed_by, ran
from hapticmech_ros.errors import HapticMechError, InstallationError
from hapticmech_ros.nodes.entry import start
from hapticmech_ros.system.installation import (
    NO_RCLPY,
    OF_COMMANDS,
    PACKAGE,
    refuse_unmet,
    refuse_without_ros,
)

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(sys.prefix) / "bin"
NEEDED = [
    one for one in map(Requirement, requires(PACKAGE) or ()) if "extra" not in str(one.marker)
]
# pip's names of what ROS and Ubuntu have by others.
ELSEWHERE = {
    "pin": "pinocchio",
    "PyYAML": "python3-yaml",
    "lz4": None,
    "mcap": None,
    "rosbags": None,
}
IN_CONDA = {"pin": "pinocchio", "PyYAML": "pyyaml", "matplotlib": "matplotlib-base"}


def lowest(requirement):
    """Return the version that a requirement begins with."""
    (found,) = [one.version for one in requirement.specifier if one.operator == ">="]
    return Version(found)


def test_this_environment_has_what_is_needed():
    refuse_unmet()
    refuse_without_ros(os.environ)


def test_a_middleware_that_is_not_installed_is_named_with_its_variable(tmp_path):
    for command in (["run", "five_bar", "--duration", "1"], ["bag", "record", "-a"]):
        ended = subprocess.run(
            [BIN / "hapticmech", *command],
            env=os.environ | {"RMW_IMPLEMENTATION": "rmw_foo"},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.returncode == 1
        assert ended.stderr.startswith("error: RMW_IMPLEMENTATION is rmw_foo, which is not")
        assert len(ended.stderr.splitlines()) == 1
    # A prefix that was sourced may have others.
    index = tmp_path / "share/ament_index/resource_index/rmw_typesupport"
    index.mkdir(parents=True)
    (index / "rmw_foo").touch()
    known = {"RMW_IMPLEMENTATION": "rmw_foo", "AMENT_PREFIX_PATH": str(tmp_path)}
    refuse_without_ros(known)
    with pytest.raises(HapticMechError, match=r"there is rmw_.*rmw_foo"):
        refuse_without_ros(known | {"RMW_IMPLEMENTATION": "rmw_bar"})


@pytest.mark.parametrize(
    "command",
    ["run", "run --lockstep", "demo", "bag replay BAG -o OUT", "bag record", "device test"],
)
def test_without_rclpy_commands_end_before_anything_is_started(command, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setattr(subprocess, "Popen", None)
    with pytest.raises(HapticMechError) as raised:
        ran(*command.split())
    assert str(raised.value) == NO_RCLPY
    assert not list(tmp_path.iterdir())


def test_without_rclpy_a_node_ends_with_the_same_sentence(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert start(["haptic_device"], []) == 1
    assert capsys.readouterr().err == f"haptic_device: {NO_RCLPY}\n"


def test_all_that_is_missing_or_old_is_named_with_the_command_that_installs_it():
    wanted = ["pydantic>=99", "numpy>=1", "no-such-package>=1.2"]
    with pytest.raises(InstallationError) as raised:
        refuse_unmet(wanted)
    assert raised.value.needed == ("pydantic>=99", "no-such-package>=1.2")
    text = str(raised.value)
    assert f"pydantic is {version('pydantic')} in " in text
    assert "no-such-package is not installed" in text
    assert f"{sys.executable} -m pip install 'pydantic>=99' 'no-such-package>=1.2'" in text
    assert "\n" not in text


def test_extras_are_not_needed_and_modules_do_without_metadata():
    """Pinocchio of ROS is a module, and no distribution of Python."""
    refuse_unmet(['no-such-package>=1; extra == "ros"', "json>=1"])
    refuse_unmet(["pydantic>=99"], without={"pydantic"})


def with_older(folder, name, older):
    """Return an environment in which a package seems to have another version."""
    place = folder / f"{name}-{older}.dist-info"
    place.mkdir()
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {older}\n")
    return os.environ | {"PYTHONPATH": str(folder)}


@pytest.mark.parametrize("command", ["hapticmech", "mechanism_simulator", "composed"])
def test_commands_and_nodes_end_with_one_sentence(tmp_path, command):
    done = subprocess.run(
        [BIN / command, "run" if command == "hapticmech" else "--ros-args"],
        env=with_older(tmp_path, "pydantic", "1.10.14"),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert f"pydantic is 1.10.14 in {tmp_path}" in line
    assert "pip install 'pydantic>=2" in line


def test_a_node_needs_nothing_of_the_commands():
    """It is not refused for a package that it never imports."""
    program = (
        "import sys\nimport hapticmech_ros.nodes.runtime\n"
        "from hapticmech_ros.nodes.entry import NODES\n"
        "from hapticmech_ros.loading import load_scene\nload_scene('five_bar')\n"
        "print(*{name.split('.')[0] for name in sys.modules})\n"
    )
    loaded = printed_by("-c", program)
    assert "numba" in loaded or "numpy" in loaded
    assert not OF_COMMANDS & set(loaded.split())


@pytest.mark.parametrize(
    ("command", "heavy"),
    [("['--help']", {"numpy", "pydantic"}), ("['scene', 'list']", {"pinocchio", "scipy"})],
)
def test_commands_import_what_they_need(command, heavy):
    program = (
        "import sys\nfrom hapticmech_ros.cli import app\n"
        f"app({command}, standalone_mode=False)\nprint(*sys.modules)\n"
    )
    loaded = printed_by("-c", program).splitlines()[-1].split()
    assert "typer" in loaded
    assert not heavy & set(loaded)


def test_nodes_of_small_scenes_start_without_scipy():
    """It takes a tenth of a second to load, which a node that starts again does not have.

    Orders of a sparse factorisation and hulls of meshes need it.
    """
    program = (
        "import sys\nimport hapticmech_ros.nodes.runtime\n"
        "from hapticmech_ros import Simulator\n"
        "from hapticmech_ros.device import device_for\n"
        "from hapticmech_ros.control import ControlArchitecture\n"
        "from hapticmech_ros.loading import load_scene\n"
        "from hapticmech_ros.operational import Analyser\n"
        "for name in ('door', 'five_bar', 'four_bar_closing', 'slider_crank_engine', 'ur5e'):\n"
        "    scene = load_scene(name)\n"
        "    simulator, _ = Simulator(scene), (device_for(scene), ControlArchitecture(scene))\n"
        "    state = simulator.initial_state()\n"
        "    analyser = Analyser(simulator.mechanism)\n"
        "    analyser.observe(state.q, state.v, state.active)\n"
        "    print(name, 'scipy.linalg' in sys.modules)\n"
    )
    started = dict(line.split() for line in printed_by("-c", program).splitlines())
    assert len(started) == 5
    assert set(started.values()) == {"False"}, started


def test_every_requirement_has_a_lowest_version():
    assert len(NEEDED) > 10
    for one in NEEDED:
        assert lowest(one) <= Version(version(one.name))


def test_package_xml_has_the_same_versions():
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    stated = {
        str(entry.text): entry.get("version_gte") for entry in manifest.findall("exec_depend")
    }
    for one in NEEDED:
        key = ELSEWHERE.get(one.name, f"python3-{one.name}" if one.name != "coal" else "coal")
        if key is not None:
            assert Version(stated[key] or "0") == lowest(one), key


def test_pixi_has_the_same_versions():
    text = (ROOT / "pixi.toml").read_text(encoding="utf-8")
    stated = dict(re.findall(r'^"?([\w.-]+)"? = "(.*)"$', text, re.MULTILINE))
    for one in NEEDED:
        found = re.match(r">=([\d.]+)", stated[IN_CONDA.get(one.name, one.name)])
        assert found is not None
        assert Version(found.group(1)) == lowest(one)


def test_the_page_on_installation_has_the_same_versions():
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    table = page[page.index("## What is needed") :]
    rows = re.findall(r"^\| ([a-z][^|]*) \| (≥[^|]*) \|", table, re.MULTILINE)
    stated = {
        re.sub(r" \(.*", "", name).lower(): Version(found.strip(" ≥"))
        for names, versions in rows
        for name, found in zip(names.split(", "), versions.split(", "), strict=True)
    }
    assert stated == {one.name.lower(): lowest(one) for one in NEEDED}


def test_what_comes_from_pypi_on_ubuntu_has_the_same_versions():
    """In the commands of the page, and of the image."""
    by_name = {one.name: lowest(one) for one in NEEDED}
    for name in ("docs/install.md", "docker/Dockerfile"):
        text = (ROOT / name).read_text(encoding="utf-8").replace("\\\n", " ")
        (line,) = re.findall(r"\.venv/bin/pip install .*'numba.*", text)
        wanted = [Requirement(one) for one in re.findall(r"'([^']+)'", line)]
        assert {one.name for one in wanted} == {"mcap", "numba", "pydantic", "rosbags", "typer"}, (
            name
        )
        for one in wanted:
            assert lowest(one) == by_name[one.name], name


def made(folder, target, code=0):
    """Run make in a folder that has a stub of an interpreter; return its errors."""
    done = subprocess.run(
        ["make", "-f", ROOT / "Makefile", target, "PYTHON=./python"],
        env={"PATH": os.environ["PATH"]},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    return done.stderr


def test_make_replaces_its_own_environment_and_no_other(tmp_path):
    """Its own: of another folder, of another interpreter, or begun and not finished."""
    stub = tmp_path / "python"
    stub.write_text('#!/bin/sh\n[ "$1" = -c ] || { touch "$3/new"; [ ! -e broken ]; }\n')
    stub.chmod(0o755)
    place = tmp_path / ".venv"
    note, new = place / "made", place / "new"
    place.mkdir()
    (place / "theirs").touch()
    assert made(tmp_path, "demo", code=2).startswith("error: make did not make .venv")
    made(tmp_path, "clean")
    assert [path.name for path in place.iterdir()] == ["theirs"]

    note.write_text("/elsewhere\npython3\n")
    (tmp_path / "broken").touch()
    made(tmp_path, ".venv/made", code=2)
    assert new.exists()
    assert not (place / "theirs").exists()
    (tmp_path / "broken").unlink()
    for replaced in (True, False):
        new.unlink()
        made(tmp_path, ".venv/made")
        assert new.exists() == replaced
        new.touch()
    note.write_text(f"{tmp_path}\npython3\n")
    new.unlink()
    made(tmp_path, ".venv/made")
    assert new.exists()
    made(tmp_path, "clean")
    assert not place.exists()


def test_the_dev_container_is_built_from_the_image():
    described = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())
    assert (ROOT / ".devcontainer" / described["build"]["dockerfile"]).resolve() == (
        ROOT / "docker" / "Dockerfile"
    )
