"""What a session measured and commanded in one tick."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import ControlOutput, OperationalModel
from hapticmech_ros.control.flat import model_of
from hapticmech_ros.device import DeviceState
from hapticmech_ros.mechanism import PointKinematics
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.simulation.state import EnergyAccount, MechanismState

if TYPE_CHECKING:
    from hapticmech_ros.contact.touching import Touching


class LeftState(NamedTuple):
    """A mechanism's state as a kernel left it.

    Attributes:
        known: the last state before that was known as such.
        totals: (7,) see :class:`~hapticmech_ros.session.data.SessionData`.
        q, v: configuration (nq,) and rates (nv,).
        touching: points of contact; None in a scene without.
    """

    known: MechanismState
    totals: Array
    q: Array
    v: Array
    touching: Touching | None = None

    def state(self) -> MechanismState:
        """Return the state; q and v can be written no more."""
        before, account = self.known, self.known.account
        time, work_in, lost, error, _, *in_contact = self.totals.tolist()
        self.q.flags.writeable = self.v.flags.writeable = False
        return MechanismState(
            time,
            self.q,
            self.v,
            before.active,
            error,
            EnergyAccount(work_in, lost, account.latch_loss, *in_contact),
            self.touching,
            before.released,
        )


class Sample:
    """All that was measured and commanded in one tick, at its start.

    Attributes:
        time: s since the session's start; the device is engaged at time 0.
        device: its state at ``time``.
        seen: the operational point there: its motion, Λ_h⁻¹ and what follows.
        hand_wrench: (6,) F_h on the device, by the hand and by others, as the device reports it.
        external_wrench: (6,) on the mechanism at the operational point, by others.
        contact_wrench: (6,) F_c of virtual objects there, of the step that led here; zero without.
        count: joint constraints reported.
        wrenches: (6, 6) of the controllers, from these measurements; rows as in ``output``.
        acting: (2, 6) over the period that begins: on the hand by the device, and on the mechanism
            by the hand.
    """

    __slots__ = (
        *("_mechanism", "acting", "contact_wrench", "count", "device", "external_wrench"),
        *("hand_wrench", "seen", "time", "wrenches"),
    )

    def __init__(
        self,
        time: float,
        device: DeviceState,
        mechanism: MechanismState | LeftState,
        seen: Observation,
        hand_wrench: Array,
        external_wrench: Array,
        contact_wrench: Array,
        count: int,
        wrenches: Array,
        acting: Array,
    ) -> None:
        self.time, self.device, self._mechanism, self.seen = time, device, mechanism, seen
        self.hand_wrench, self.external_wrench = hand_wrench, external_wrench
        self.contact_wrench, self.count = contact_wrench, count
        self.wrenches, self.acting = wrenches, acting

    @property
    def mechanism(self) -> MechanismState:
        """State of the mechanism at ``time``."""
        if isinstance(self._mechanism, LeftState):
            self._mechanism = self._mechanism.state()
        return self._mechanism

    @property
    def point(self) -> PointKinematics:
        """The operational point's kinematics."""
        return self.seen.point

    @property
    def analysis(self) -> OperationalAnalysis:
        """Λ_h⁻¹ and what follows from it."""
        return self.seen.analysis

    @property
    def output(self) -> ControlOutput:
        """The controllers' wrenches."""
        return ControlOutput(*self.wrenches)

    @property
    def model(self) -> OperationalModel:
        """What of the analysis they were computed with: X and a_0 as late as the loop is."""
        return model_of(self.seen.model)
