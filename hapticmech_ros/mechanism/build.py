"""Which implementation of a mechanism runs."""

from __future__ import annotations

from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.scene.document import Scene


def build(scene: Scene, compiled: bool = True) -> Mechanism:
    """Return the mechanism of a scene.

    Args:
        scene: what to build.
        compiled: by kernels, several times faster, or by the readable implementation that they are
            compared with. Results agree to rounding, not to the bit: take one for all.
    """
    if not compiled:
        return Mechanism(scene)
    # Here, so that only what runs a mechanism waits for Numba.
    from hapticmech_ros.mechanism.compiled import CompiledMechanism

    return CompiledMechanism(scene)
