"""Which implementation of the control runs."""

from __future__ import annotations

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.scene.document import Scene


def control_for(scene: Scene, compiled: bool = True) -> ControlArchitecture:
    """Return the controllers of a scene.

    Args:
        scene: whose gains and limits to take.
        compiled: by a kernel, ten times faster, or by the readable implementation that it is
            compared with. Results agree to rounding, not to the bit: take one for all.
    """
    if not compiled:
        return ControlArchitecture(scene)
    # Here, so that only what runs a control waits for Numba.
    from hapticmech_ros.control.compiled import CompiledControl

    return CompiledControl(scene)
