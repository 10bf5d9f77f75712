# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package as its users get it: `pip install`, `colcon build`, `ros2 run`, an ament index.

Nothing here is skipped where a tool is missing: without it the package is not known to install.
"""

from __future__ import annotations

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
from datetime import date
from importlib.metadata import Distribution, distributions
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from ament_index_python.resources import get_resource

from sampling import only_long, sampled

PACKAGE = "hapticmech_ros"
EXECUTABLES = [
    "composed",
    "haply_device",
    "haptic_device",
    "live_page",
    "mechanism_simulator",
    "nullspace_analyser",
    "relay_device",
    "robot_follower",
    "scene_viewer",
    "simulated_robot",
    "teleoperation_controller",
]
ROOT = Path(__file__).resolve().parents[1]
# What an installation is made from, and benchmarks, which are not to come along; a fresh clone has
# nothing else of relevance.
SOURCES = [PACKAGE, "benchmarks", "config", "launch", "resource"]
SOURCE_FILES = ["LICENSE", "README.md", "package.xml", "pyproject.toml", "setup.cfg", "setup.py"]
TIMEOUT_S = 120.0
# What brings a module whose name is not its own.
DISTRIBUTIONS = {
    "annotated_types": "pydantic",
    "pinocchio": "pin",
    "pydantic_core": "pydantic",
    "ruamel": "ruamel.yaml",
    "yaml": "pyyaml",
}
# Looked for, and done without where they are not.
NEWER_PYTHON = {"backports", "compression"}


def own_world(**extra: str) -> dict[str, str]:
    """Return this process's environment without what would decide where children find packages.

    The ROS wheels set LD_LIBRARY_PATH by starting Python anew, unless the guard says they did: a
    child must not inherit the guard alone.
    """
    foreign = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_", "PYTHONPATH", "_ROS_WHEELS_")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(foreign)}
    return kept | extra


def run(
    *command: str | Path,
    cwd: Path,
    env: dict[str, str] | None = None,
    timeout: float = TIMEOUT_S,
) -> str:
    """Run ``command`` to its end; return what it printed, fail with all of it if it failed."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=own_world() if env is None else env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, f"{command} exited with {done.returncode}:\n{done.stdout}"
    return done.stdout


def copy_sources(target: Path) -> Path:
    """Copy what is installed to ``target``, so that no build leaves anything in the clone."""
    target.mkdir(parents=True)
    for name in SOURCES:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "*.pyc")
            shutil.copytree(ROOT / name, target / name, ignore=ignored)
    for name in SOURCE_FILES:
        if (ROOT / name).exists():
            shutil.copy2(ROOT / name, target / name)
    return target


def assert_answers_help(executable: Path, cwd: Path, env: dict[str, str]) -> None:
    assert executable.is_file()
    assert os.access(executable, os.X_OK)
    usage = run(executable, "--help", cwd=cwd, env=env)
    assert re.search(rf"usage: {executable.name}\b", usage), usage


def modules(folder: Path) -> set[Path]:
    return {path.relative_to(folder) for path in folder.rglob("*.py")} | {
        path.relative_to(folder) for path in folder.rglob("py.typed")
    }


def shared_files(folder: Path) -> set[Path]:
    files = (path for path in folder.glob("config/**/*") if path.is_file())
    return {path.relative_to(folder) for path in files} | {
        path.relative_to(folder) for path in folder.glob("launch/**/*.py")
    }


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A prefix into which pip installed the package alone."""
    place = tmp_path_factory.mktemp("pip")
    sources = copy_sources(place / "sources")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--ignore-installed", "--no-user"]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-warn-script-location"]
    run(*pip, *options, "--prefix", place / "prefix", sources, cwd=place)
    return place / "prefix"


@pytest.fixture(scope="module")
def site_packages(prefix: Path) -> Path:
    """Where pip put modules and metadata below ``prefix``."""
    (found,) = {path.parent for path in prefix.glob(f"**/*-packages/{PACKAGE}")}
    return found


@pytest.fixture(scope="module")
def installed(site_packages: Path) -> Distribution:
    """Metadata of what pip installed."""
    (found,) = distributions(path=[str(site_packages)])
    return found


@pytest.fixture(scope="module", params=["copied", *only_long("symlinked")])
def workspace(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A colcon workspace with the package built in it, without and with --symlink-install."""
    place = tmp_path_factory.mktemp(request.param)
    copy_sources(place / "src" / PACKAGE)
    options = ["--symlink-install"] if request.param == "symlinked" else []
    options += ["--executor", "sequential", "--event-handlers", "console_direct-"]
    colcon(place, "build", *options)
    return place


def colcon(place: Path, *arguments: str) -> str:
    # colcon gives scripts the interpreter that runs it, in a #! line that allows neither spaces nor
    # more than 127 characters. A link to it makes the test independent of where the clone lives.
    environment = place / "environment"
    if not environment.exists():
        environment.symlink_to(sys.prefix)
    python = environment / "bin" / "python"
    script = Path(sysconfig.get_path("scripts")) / "colcon"
    settings = own_world(COLCON_HOME=str(place / "home"))
    verb, *options = arguments
    command = [python, script, "--log-base", "log", verb, "--base-paths", "src", *options]
    return run(*command, cwd=place, env=settings)


def test_ament_index_finds_what_pip_installed(
    prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    assert Path(get_package_prefix(PACKAGE)) == prefix
    assert get_resource("packages", PACKAGE)[1] == str(prefix)
    share = Path(get_package_share_directory(PACKAGE))
    assert (share / "package.xml").read_bytes() == (ROOT / "package.xml").read_bytes()
    assert list(share.glob("config/scenes/*.yaml"))


def test_pip_installs_every_module_and_every_shared_file(prefix: Path, site_packages: Path) -> None:
    # A folder without __init__.py, or a pattern that is too narrow, would be left out in silence.
    assert modules(site_packages / PACKAGE) == modules(ROOT / PACKAGE)
    assert Path("py.typed") in modules(site_packages / PACKAGE)
    assert [path.name for path in site_packages.iterdir() if path.suffix != ".dist-info"] == [
        PACKAGE
    ]
    assert shared_files(prefix / "share" / PACKAGE) == shared_files(ROOT)


@pytest.mark.parametrize("node", sampled(EXECUTABLES))
def test_executable_that_pip_installed_runs(prefix: Path, site_packages: Path, node: str) -> None:
    env = own_world(PYTHONPATH=str(site_packages))
    assert_answers_help(prefix / "lib" / PACKAGE / node, prefix, env)


@pytest.mark.parametrize("node", EXECUTABLES)
def test_executable_of_this_environment_runs(tmp_path: Path, node: str) -> None:
    # `pip install -e` does not make it: install with `make`, or with `pip install .`.
    executable = Path(sys.prefix) / "lib" / PACKAGE / node
    assert_answers_help(executable, tmp_path, own_world())


def test_colcon_takes_the_package_for_ament_python(tmp_path: Path) -> None:
    copy_sources(tmp_path / "src" / PACKAGE)
    assert colcon(tmp_path, "list").split() == [PACKAGE, f"src/{PACKAGE}", "(ros.ament_python)"]


def test_executables_that_colcon_built_run(workspace: Path) -> None:
    base = workspace / "install" / PACKAGE
    folder = base / "lib" / PACKAGE
    # Exactly ours: scripts that setuptools put here as well would hide the wrappers.
    assert sorted(path.name for path in folder.iterdir()) == EXECUTABLES
    for node in EXECUTABLES:
        assert (folder / node).read_bytes() == (ROOT / "resource/executables" / node).read_bytes()
    assert shared_files(base / "share" / PACKAGE) == shared_files(ROOT)
    sourced = 'set -e; . install/setup.bash; for node in "$@"; do "$node" --help; done'
    # They are the same but for the node's name, as the rest of this file tests.
    some = sampled(EXECUTABLES, every=6)
    usage = run("bash", "-c", sourced, "bash", *(folder / node for node in some), cwd=workspace)
    assert re.findall(r"^usage: (\w+)", usage, flags=re.MULTILINE) == some
    where = f". install/setup.bash; python3 -c 'import {PACKAGE}; print({PACKAGE}.__file__)'"
    env = own_world(PATH=f"{workspace}/environment/bin{os.pathsep}{os.environ['PATH']}")
    imported = Path(run("bash", "-c", where, cwd=workspace, env=env).strip())
    assert workspace in imported.parents, "imported from elsewhere: this build proves nothing"


def test_entry_points_and_wrappers_name_the_same_nodes(
    prefix: Path, installed: Distribution
) -> None:
    scripts = {entry.name for entry in installed.entry_points.select(group="console_scripts")}
    assert scripts == {*EXECUTABLES, "hapticmech"}
    assert {path.name for path in (prefix / "bin").iterdir()} == scripts
    wrappers = sorted((ROOT / "resource" / "executables").iterdir())
    assert [path.name for path in wrappers] == EXECUTABLES
    assert sorted(path.name for path in (prefix / "lib" / PACKAGE).iterdir()) == EXECUTABLES
    # One text for all: a wrapper finds its node by its own name.
    assert len({path.read_bytes() for path in wrappers}) == 1


def test_every_entry_point_can_be_loaded(installed: Distribution) -> None:
    for entry in installed.entry_points.select(group="console_scripts"):
        assert callable(entry.load()), entry


def imported() -> set[str]:
    """Names of all modules that the package imports from outside itself and Python."""
    names: set[str] = set()
    for path in (ROOT / PACKAGE).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names.add(node.module.split(".")[0])
    return names - sys.stdlib_module_names - {PACKAGE}


def test_everything_that_is_imported_is_declared(installed: Distribution) -> None:
    """For pip, or as a package of ROS; coal, which contacts call, is not left to pin to bring."""
    matched = [re.match(r"[\w.-]+", entry) for entry in installed.requires or ()]
    required = {found.group(0).lower() for found in matched if found is not None}
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    depends = {str(entry.text) for entry in manifest.findall("exec_depend")}
    found = {DISTRIBUTIONS.get(name, name) for name in imported() - NEWER_PYTHON}
    assert {"coal", "numba", "rclpy"} <= found
    assert found <= required | depends
    assert {"coal", "pin"} <= required
    assert {"coal", "pinocchio"} <= depends


def test_one_version_everywhere(installed: Distribution) -> None:
    """A released one: no suffix, and the day of its release in the change log."""
    stated = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version")
    assert stated is not None
    assert re.fullmatch(r"\d+\.\d+\.\d+", stated)
    assert installed.version == stated
    site = runpy.run_path(str(ROOT / "conf.py"))
    assert site["version"] == site["release"] == stated
    newest = re.search(r"^## \[(.*)\] - (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert newest.group(1) == stated
    assert date.fromisoformat(newest.group(2)) >= date(2026, 11, 25)
    quality = (ROOT / "QUALITY_DECLARATION.md").read_text(encoding="utf-8")
    assert f"{stated} is below 1.0.0" in quality
