"""The readable mechanism that kernels are compared with, from the tests of a source tree."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import Simulator


def readable_simulator(scene: Scene) -> Simulator:
    """Return a simulator whose mechanism Pinocchio and NumPy evaluate, ``test/oracles/mechanism``.

    Raises:
        HapticMechError: there are no tests beside the package, nor where this was started.
    """
    for root in (Path(__file__).parents[2], Path.cwd()):
        if (root / "test/oracles/mechanism").is_dir() and str(root / "test") not in sys.path:
            sys.path.append(str(root / "test"))
    try:
        found = importlib.import_module("oracles.mechanism.stepping")
    except ImportError:
        message = "the readable mechanism is in test/oracles of a source tree: start there"
        raise HapticMechError(message) from None
    simulator: Simulator = found.ReadableSimulator(scene)
    return simulator
