# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stability test of a session: the response to a short push must decay.

The device is pushed for one period ("touched"). The response of the same session without the push
is subtracted, which removes motion that is not caused by it. The remaining signal is divided into
two halves, each weighted with a Hann window: neither an oscillation's phase nor the place of the
division is then mistaken for growth:

    stable if  rms of the second half < 0.98 rms of the first half,  or below the floor

A run is stopped and counted as unstable if the signal exceeds a bound that no stable response
reaches. The bound is below the actuators' limits, and is exceeded before rounding errors of the run
without a push grow to the same size.

Over ten cycles a linear loop with 0.1 % of critical damping passes the test; a diverging loop and a
limit cycle do not.

The hand of a measurement pushes smoothly, as a hand's wrench varies within a period. A wrench that
is held over each period and steps at the samples would act, on average, half a period later than
the device measures it; one that is linear between samples has corners there, which are felt at 10
Hz on a mass a thousand times the device's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.device import NO_WRENCH, DeviceState, ImpedanceDevice
from hapticmech_ros.errors import HapticMechError, InvalidInputError, check_not_negative
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import COLUMNS, ScriptedHand
from hapticmech_ros.session import Sample, Session

Observe = Callable[[Sample], Array]
# Bound of the rounding errors of a session at rest, m/s or N; far below perception.
FLOOR = 1e-9
# Largest ratio of the second half's rms to the first's.
LEFT = 0.98
# Share of the signal that is skipped at its start, with the push itself.
PASSED = 0.2


@dataclass(frozen=True, slots=True)
class Setup:
    """Configuration of sessions.

    Attributes:
        scene: to run.
        point: operational point that the device holds; the scene's first one if empty.
        delay: whole periods from measuring to acting.
        control: factory of controllers other than the scene's.
        device: factory of a device other than the scene's.
    """

    scene: Scene
    point: str = ""
    delay: int = 1
    control: Callable[[Scene], ControlArchitecture] | None = None
    device: Callable[[Scene], ImpedanceDevice] | None = None

    def __str__(self) -> str:
        return f"{self.scene.name}, {self.delay} periods of delay"

    def session(self) -> Session:
        """Return a new session."""
        control = None if self.control is None else self.control(self.scene)
        device = None if self.device is None else self.device(self.scene)
        return Session(self.scene, self.point, self.delay, control, device)


def comes_to_rest(
    setup: Setup, push: Array, observe: Observe, ticks: int, lost: float, floor: float = FLOOR
) -> bool:
    """Touch a session, and return whether its response decays.

    Args:
        setup: of the session.
        push: (6,) on the device for one period, world axes, N and N m.
        observe: function of a sample that returns the signal, (k,).
        ticks: length of the signal, 20 or more.
        lost: magnitude of the signal from which the session counts as lost.
        floor: rms below which it counts as rest.

    Returns:
        Whether the rms of the second half of the response is below that of the first, or at rest;
        False if the session ended by itself or was lost.

    Raises:
        InvalidInputError: fewer than 20 ticks.
    """
    if ticks < 20:
        raise InvalidInputError("ticks", ticks, "must be 20 or more")
    calm = _watched(setup, np.zeros(6), observe, ticks)
    seen = None if calm is None else _watched(setup, push, observe, ticks, calm, lost)
    if calm is None or seen is None:
        return False
    left = (seen - calm)[round(PASSED * ticks) :]
    half = len(left) // 2
    return decays(_rms(left[:half]), _rms(left[-half:]), floor)


def decays(early: float, late: float, floor: float = FLOOR) -> bool:
    """Return whether a response dies away.

    Args:
        early: rms of its first half, in units of the signal.
        late: of its second half, likewise.
        floor: rms below which it counts as rest.
    """
    return late < max(LEFT * early, floor)


def _watched(
    setup: Setup,
    push: Array,
    observe: Observe,
    ticks: int,
    calm: Array | None = None,
    lost: float = np.inf,
) -> Array | None:
    """Return the signal (ticks, k), or None if the session is lost or ended by itself."""
    session, rows = setup.session(), []
    try:
        # Until the first command arrives the device is not controlled.
        session.run(setup.delay)
        for tick in range(ticks):
            rows.append(observe(session.tick(hand_wrench=push if tick == 0 else None)))
            if calm is not None and not float(np.abs(rows[tick] - calm[tick]).max()) <= lost:
                return None
    except HapticMechError:
        return None
    return np.array(rows)


def relative_speeds(normals: Array) -> Observe:
    """Return the signal of speeds n_iᵀ ė of the device relative to the operational point.

    Args:
        normals: (6, k) n_i, for m/s scaled to 1 N at a link's centre of mass, world axes.
    """
    return lambda sample: np.asarray(normals.T @ (sample.device.twist - sample.point.twist))


def _rms(rows: Array) -> float:
    window = np.hanning(len(rows) + 2)[1:-1]
    return float(np.sqrt(window @ np.sum(rows**2, axis=1) / window.sum()))


class MassHeldDevice(ImpedanceDevice):
    """A scene's device with a mass fixed to it on the hand's side of the force sensor.

        (Λ_d + M_a) ẍ = F_o + u - D ẋ,      F_h = -M_a ẍ,      M_a = share Λ_d

    F_h of a period is measured at its end and used in the next one. The scene's own hand is absent.

    Args:
        scene: whose device is used.
        share: M_a over Λ_d, 0 or more.

    Raises:
        InvalidInputError: a negative share.
    """

    def __init__(self, scene: Scene, share: float) -> None:
        check_not_negative(share=share)
        device = scene.device
        whole = {"mass": (1.0 + share) * device.mass, "inertia": (1.0 + share) * device.inertia}
        both = device.model_copy(update=whole)
        super().__init__(both, scene.simulation.period, scene.task_space == "planar")
        self._own = share * np.array(device.inertias)

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Advance one period.

        Args:
            state: at the start of the period.
            command: (6,) servo_cf, held over the period; None for actuators off.
            held: not used: the scene's own hand is absent.
            ticks: whole periods since the hand took hold; not used.
            push: (6,) further wrench on the device, world axes, N and N m.

        Returns:
            State at the end of the period.
        """
        new = super().step(state, command, None, ticks, push)
        inert = -self._own * (new.twist - state.twist) / self.period
        return new.replaced(hand_wrench=inert, reported=inert)


# Rows of a script in a period, between which its wrench goes in straight lines.
ROWS = 8


def fine_times(period: float, periods: int, rows: int = ROWS) -> Array:
    """Return times (rows n + 1,) of a script's rows in n periods, s.

    Args:
        period: s.
        periods: n.
        rows: in a period.
    """
    return period / rows * np.arange(rows * periods + 1)


def samples_of(fine: Array, rows: int = ROWS) -> Array:
    """Return a push at the start of each of its periods, (n, ...).

    Args:
        fine: (rows n + 1, ...) by rows of a script.
        rows: in a period.
    """
    return fine[:-1:rows]


def means_of(fine: Array) -> Array:
    """Return the means of a push over each of its periods, (n, ...).

    Args:
        fine: (ROWS n + 1, ...) by rows of a script.
    """
    middles = 0.5 * (fine[:-1] + fine[1:])
    return np.asarray(middles.reshape(-1, ROWS, *fine.shape[1:]).mean(axis=1))


def write_script(path: Path, times: Array, pushes: Array) -> None:
    """Write a script of a scripted hand.

    Args:
        path: of the file.
        times: (n,) s, increasing.
        pushes: (n, 6) N and N m, world axes at the point held.
    """
    rows = np.column_stack((times, pushes))
    # With fewer digits a script of five seconds at 4 kHz is within the size limit.
    digits = ["%.9g"] + ["%.8g"] * 6
    np.savetxt(path, rows, digits, ",", header=",".join(COLUMNS), comments="")


@contextmanager
def scripted(times: Array, pushes: Array) -> Iterator[ScriptedHand]:
    """Yield a hand that pushes from its start on, whose script exists meanwhile.

    Args:
        times: (n,) s after the start, increasing.
        pushes: (n, 6) N and N m, world axes at the point held.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "push.csv"
        write_script(path, times, pushes)
        yield ScriptedHand(kind="scripted", file=str(path), start_delay=0.0)
