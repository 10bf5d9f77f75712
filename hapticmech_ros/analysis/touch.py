"""Does it come to rest? A session is touched once, and what follows has to die out.

The touch is a push on the device that lasts one period. The same session without the touch is
subtracted, so that what moves by itself does not count. What is left is watched in two halves, each
under a window of Hann's shape, so that neither the phase of an oscillation nor where a half begins
is mistaken for growth:

    stable if  rms of the second half < 0.98 rms of the first half,  or below the floor

A run ends, and is unstable, where something is as large as nothing stable gets: before limits of
forces hold it, and before the rounding of the run without a touch has grown to the same size.

Over ten cycles a linear loop passes that has 0.1 % of critical damping. One that diverges does not,
nor one that has come to a limit cycle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.device import NO_WRENCH, DeviceState, ImpedanceDevice
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.session import Sample, Session

Observe = Callable[[Sample], Array]
# Rounding of a session that is at rest, in m/s or N; far below what anybody feels.
FLOOR = 1e-9
# Of the first half, what is left in the second.
LEFT = 0.98
# Of what is watched before it is, so that the touch itself has passed.
PASSED = 0.2


@dataclass(frozen=True, slots=True)
class Setup:
    """How sessions are made.

    Attributes:
        scene: what to run.
        point: operational point that the device holds; the scene's first one if empty.
        delay: whole periods from measuring to acting.
        control: makes controllers other than the scene's.
        device: makes a device other than the scene's.
    """

    scene: Scene
    point: str = ""
    delay: int = 1
    control: Callable[[Scene], ControlArchitecture] | None = None
    device: Callable[[Scene], ImpedanceDevice] | None = None

    def session(self) -> Session:
        """Return a new session."""
        control = None if self.control is None else self.control(self.scene)
        device = None if self.device is None else self.device(self.scene)
        return Session(self.scene, self.point, self.delay, control, device)


@dataclass(frozen=True, slots=True)
class Touched:
    """What followed a touch.

    Attributes:
        early, late: rms of the first and the second half, in units of what was watched; infinite
            where the session ended by itself or was lost.
        floor: below which it counts as rest.
    """

    early: float
    late: float
    floor: float = FLOOR

    @property
    def stable(self) -> bool:
        """Whether it dies out."""
        return self.late < max(LEFT * self.early, self.floor)


def touched(
    setup: Setup, push: Array, observe: Observe, ticks: int, lost: float, floor: float = FLOOR
) -> Touched:
    """Touch a session and watch what follows.

    Args:
        setup: of the session.
        push: (6,) on the device for one period, world axes, N and N m.
        observe: what of a sample is watched, (k,).
        ticks: that are watched, 20 or more.
        lost: size of what is watched, from which nothing comes back.
        floor: of the rms, below which it counts as rest.

    Raises:
        InvalidInputError: fewer than 20 ticks.
    """
    if ticks < 20:
        raise InvalidInputError("ticks", ticks, "must be 20 or more")
    calm = _watched(setup, np.zeros(6), observe, ticks)
    seen = None if calm is None else _watched(setup, push, observe, ticks, calm, lost)
    if calm is None or seen is None:
        return Touched(np.inf, np.inf, floor)
    left = (seen - calm)[round(PASSED * ticks) :]
    half = len(left) // 2
    return Touched(_rms(left[:half]), _rms(left[-half:]), floor)


def _watched(
    setup: Setup,
    push: Array,
    observe: Observe,
    ticks: int,
    calm: Array | None = None,
    lost: float = np.inf,
) -> Array | None:
    """Return what is watched (ticks, k), or None of a session that is lost or ended by itself."""
    session, rows = setup.session(), []
    try:
        # Until the first command is there, the device is nobody's.
        session.run(setup.delay)
        for tick in range(ticks):
            rows.append(observe(session.tick(hand_wrench=push if tick == 0 else None)))
            if calm is not None and not float(np.abs(rows[tick] - calm[tick]).max()) <= lost:
                return None
    except HapticMechError:
        return None
    return np.array(rows)


def _rms(rows: Array) -> float:
    window = np.hanning(len(rows) + 2)[1:-1]
    return float(np.sqrt(window @ np.sum(rows**2, axis=1) / window.sum()))


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
        return new.replaced(hand_wrench=inert, reported=inert)
