# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of docs/install.md for Ubuntu 24.04, where only its packages can be imported.

The system's folder has ROS 2 and what else Ubuntu and ROS have packages of, as links to this
environment, and the versions of Ubuntu 24.04 of those that are too old. Not emulated: apt, rosdep,
``source /opt/ros/jazzy/setup.bash``, and the versions of what is compiled (NumPy, SciPy).
"""

from __future__ import annotations

import os
import re
import sys
import sysconfig
from importlib.metadata import distributions
from pathlib import Path

import pytest

import test_packaging
from test_packaging import EXECUTABLES, PACKAGE, ROOT, copy_sources, own_world

# Beside others it would take their processors.
TIMEOUT_S = 300.0
# Ubuntu 24.04 has these, of these versions.
OLD = ["pydantic==1.10.14", "rich==13.7.1", "setuptools==68.1.2", "typer==0.9.0"]
# It has none of these, or nobody there needs them.
MISSING = {"apsw", "backports-zstd", "llvmlite", "lz4", "mcap", "numba", "rosbags"}
NEWER = {"annotated-doc", "annotated-types", "pydantic-core", "shellingham", "typing-inspection"}
NOT_RUN = ("source /opt", "sudo ", "rosdep ")
CLONE = "git clone <this repository> "
PYTHON = Path(sys.base_prefix) / "bin" / "python{}.{}".format(*sys.version_info)
SEE_SYSTEM = "import site; site.addsitedir({!r})"


def commands() -> list[str]:
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    section = page[page.index("<!-- noble: begin -->") : page.index("<!-- noble: end -->")]
    (block,) = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)
    return block.splitlines()


def run(*command: str | Path, cwd: Path, **extra: str) -> str:
    """Return what a command printed, which has to end well."""
    cache = os.environ.get("XDG_CACHE_HOME", str(Path("~/.cache").expanduser()))
    search = os.pathsep.join(["/usr/local/bin", "/usr/bin", "/bin"])
    # What sourcing ROS 2 does: its libraries are found. The wheels' own search knows one place.
    sourced = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}
    env = own_world(PATH=search, XDG_CACHE_HOME=cache) | sourced | extra
    return test_packaging.run(*command, cwd=cwd, env=env, timeout=TIMEOUT_S)


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the packages of Ubuntu and ROS."""
    place, packages = tmp_path_factory.mktemp("system"), Path(sysconfig.get_path("purelib"))
    left_out = MISSING | NEWER | {"pip", PACKAGE.replace("_", "-")}
    left_out |= {one.split("==")[0] for one in OLD}
    for distribution in distributions(path=[str(packages)]):
        if re.sub(r"[-_.]+", "-", distribution.name).lower() in left_out:
            continue
        for name in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            if (packages / name).exists() and not (place / name).exists():
                (place / name).symlink_to(packages / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    run(*pip, "--no-deps", "--target", place, *OLD, cwd=place)
    return place


@pytest.fixture(scope="module")
def workspace(system: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands make."""
    home = tmp_path_factory.mktemp("home")
    script = ["set -e"]
    for line in commands():
        if line.startswith(CLONE):
            copied = copy_sources(home / "sources")
            script.append(f"cp -r {copied} {line.removeprefix(CLONE)}")
        elif line.startswith("python3 -m venv"):
            script.append(line.replace("python3", str(PYTHON), 1))
            see = SEE_SYSTEM.format(str(system))
            script.append("packages=$(echo .venv/lib/python3*/site-packages)")
            script.append(f'echo "{see}" > $packages/system.pth')
            # Python 3.12, which Ubuntu 24.04 has, puts none into an environment.
            script.append("rm -rf $packages/setuptools* $packages/*distutils*")
        elif not line.startswith(NOT_RUN):
            script.append(line)
    run("bash", "-c", "\n".join(script), cwd=home, HOME=str(home))
    return home / "ws"


def test_the_system_alone_has_what_is_too_old(system: Path) -> None:
    """Otherwise the commands would prove nothing."""
    program = SEE_SYSTEM.format(str(system)) + (
        "\nimport importlib.util, pydantic, rclpy"
        "\nprint(pydantic.VERSION, rclpy.__file__)"
        "\nprint(*map(importlib.util.find_spec, ['mcap', 'numba', 'rosbags']))"
    )
    versions, missing = run(PYTHON, "-c", program, cwd=system).splitlines()
    assert versions.startswith(f"1.10.14 {system}")
    assert missing == "None None None"


def in_terminal(workspace: Path, command: str, **extra: str) -> str:
    """Return what a command prints in a terminal in which the workspace is sourced."""
    return run("bash", "-c", f". install/setup.bash; {command}", cwd=workspace, **extra)


def test_the_commands_install_executables_that_use_the_environment(workspace: Path) -> None:
    base = workspace / "install" / PACKAGE
    for node in EXECUTABLES:
        first = (base / "bin" / node).read_text(encoding="utf-8").splitlines()[0]
        assert first == f"#!{workspace}/.venv/bin/python"
        # What `ros2 run` starts.
        usage = in_terminal(workspace, f"install/{PACKAGE}/lib/{PACKAGE}/{node} --help")
        assert f"usage: {node}" in usage
    assert (workspace / "session" / "summary.json").is_file()


def test_a_graph_runs_from_there(workspace: Path, domain: int) -> None:
    """With ROS 2 of the system, and the newer packages of the environment."""
    live = "hapticmech run five_bar --record bag --duration 3"
    in_terminal(workspace, live, ROS_DOMAIN_ID=str(domain))
    assert "/device/state" in in_terminal(workspace, "hapticmech bag info bag")
