"""A device held by a mass: the simplest hand that pushes back at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH, DeviceState, ImpedanceDevice
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.document import Scene


class MassHeldDevice(ImpedanceDevice):
    """A scene's device with a mass fixed to it where a force sensor sees it.

        (Λ_d + M_a) ẍ = F_o + u - D ẋ,      F_h = -M_a ẍ,      M_a = share Λ_d

    F_h of a period is measured at its end, and so is known to the next one. The scene's own hand
    is not there.

    Args:
        scene: whose device.
        share: M_a over Λ_d, 0 or more.

    Raises:
        InvalidInputError: a negative share.
    """

    def __init__(self, scene: Scene, share: float) -> None:
        if not (np.isfinite(share) and share >= 0.0):
            raise InvalidInputError("hand over device mass", share, "must be 0 or more")
        device = scene.device
        whole = {"mass": (1.0 + share) * device.mass, "inertia": (1.0 + share) * device.inertia}
        both = device.model_copy(update=whole)
        super().__init__(both, scene.simulation.period, scene.task_space == "planar")
        self._own = share * np.array([device.mass] * 3 + [device.inertia] * 3)

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Advance one period; see :meth:`ImpedanceDevice.step`."""
        new = super().step(state, command, None, ticks, push)
        inert = -self._own * (new.twist - state.twist) / self.period
        return replace(new, hand_wrench=inert, reported=inert)
