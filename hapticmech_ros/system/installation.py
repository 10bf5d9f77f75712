# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the Python packages that this one needs are installed, and new enough.

pip ensures it; colcon and rosdep do not, and distributions have older versions of some. Without
this check a node ends with a traceback from another package's code.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution, requires
from importlib.util import find_spec
from pathlib import Path

from packaging.requirements import Requirement

from hapticmech_ros.errors import HapticMechError, InstallationError

PACKAGE = "hapticmech_ros"
# Modules that packages of other names may bring: ROS has Pinocchio and Coal without pip's metadata.
MODULES = {"pin": "pinocchio", "pyyaml": "yaml"}
NO_RCLPY = (
    "rclpy, ROS 2 for Python, is not installed: source ROS 2 Jazzy, or install it from PyPI in the"
    f" clone with {sys.executable} -m pip install '.[ros]' (docs/install.md);"
    " hapticmech experiment and hapticmech live run without ROS"
)
# No node needs these.
OF_COMMANDS = frozenset({"matplotlib", "mcap", "rich", "rosbags", "typer"})


def refuse_unmet(
    requirements: Iterable[str] | None = None, without: Container[str] = frozenset()
) -> None:
    """Refuse an installation without this package's requirements.

    Args:
        requirements: in the form of PEP 508; those of the installed package if None.
        without: names of packages that are not needed.

    Raises:
        InstallationError: some are missing or too old; it names all, and how to install them.
    """
    if requirements is None:
        try:
            requirements = requires(PACKAGE) or ()
        except PackageNotFoundError:
            # Run from its sources.
            return
    needed = [one for one in map(Requirement, requirements) if one.name not in without]
    unmet = dict(_unmet(needed))
    if unmet:
        raise InstallationError(list(unmet.values()), list(unmet), sys.executable)


def refuse_without_ros(environment: Mapping[str, str]) -> None:
    """Refuse an installation without rclpy, or without the middleware that is selected.

    rcl would end the process as it is loaded, with neither the variable's name nor a remedy.

    Args:
        environment: of the process that is to load rclpy.

    Raises:
        HapticMechError: there is no rclpy; or no prefix has an index entry of
            ``RMW_IMPLEMENTATION``.
    """
    rclpy = None
    with suppress(ImportError):  # of a finder that forbids it
        rclpy = find_spec("rclpy")
    if rclpy is None:
        raise HapticMechError(NO_RCLPY)
    asked = environment.get("RMW_IMPLEMENTATION", "")
    prefixes = (*environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix)
    index = "share/ament_index/resource_index/rmw_typesupport"
    found = {
        entry.name
        for prefix in filter(None, prefixes)
        for entry in Path(prefix, index).glob("rmw_*")
        if entry.name != "rmw_implementation"
    }
    if asked and found and asked not in found:
        raise HapticMechError(
            f"RMW_IMPLEMENTATION is {asked}, which is not installed (there is"
            f" {', '.join(sorted(found))}): unset RMW_IMPLEMENTATION, or install {asked}"
        )


def _unmet(requirements: Iterable[Requirement]) -> Iterator[tuple[str, str]]:
    """Yield each unmet requirement, in pip's form, and the installed version."""
    for requirement in requirements:
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        name, wanted = requirement.name, f"{requirement.name}{requirement.specifier}"
        try:
            found = distribution(name)
        except PackageNotFoundError:
            if find_spec(MODULES.get(name.lower(), name)) is None:
                yield wanted, f"{name} is not installed"
            continue
        if not requirement.specifier.contains(found.version, prereleases=True):
            where = found.locate_file("")
            yield wanted, f"{name} is {found.version} in {where}"
