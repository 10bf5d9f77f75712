# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ_h⁻¹ and its null space at the mechanism's state, once per state received."""

from __future__ import annotations

import numpy as np
from std_msgs.msg import Float64MultiArray, UInt8

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.compensated_delay import compensated_loop_delay, periods_before
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.grasp import flat_grasp, grasp_of
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.nodes.parameters import AnalyserParameters
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.counter import ConstraintCounter
from hapticmech_ros.operational.coupling import coupling, transmission
from hapticmech_ros.operational.past_rates import PastRates
from hapticmech_ros.operational.spectrum import rank_of
from hapticmech_ros.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.cdr import FlatArray, encode_byte, encode_matrix
from hapticmech_ros.wire.coupling_wire import CouplingMatrices, CouplingWire
from hapticmech_ros.wire.layouts import (
    COMMANDED,
    OPERATIONAL_MODEL_FIELDS,
    operational_model_bounds,
)
from hapticmech_ros.wire.operational_model_wire import OperationalModelWriter
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.topics import (
    CONSTRAINT_WRENCHES,
    COUNT,
    INVERSE_INERTIA,
    POINT_MODEL,
    PROJECTOR,
    SPECTRUM,
    STATE,
    TRANSMISSION,
)

# A pause in states longer than this starts the count anew: the mechanism may be elsewhere.
RESTART_PAUSE_NS = NANOSECONDS // 4


class NullspaceAnalyser(Actor[AnalyserParameters]):
    """Runs an :class:`Analyser` on every state of the mechanism."""

    name = "nullspace_analyser"
    parameters_type = AnalyserParameters

    def __init__(self, node: Host, parameters: AnalyserParameters) -> None:
        super().__init__(node, parameters)
        self._mechanism = Mechanism(self.scene)
        # Of the loop: a command computed from a state acts a period later.
        self._compensated_delay = compensated_loop_delay(self.scene)
        self._analyser = Analyser(self._mechanism, self.point, self._compensated_delay)
        self._layout = StateLayout(self._mechanism)
        self._counter = ConstraintCounter(self.scene.perception)
        self._count: int | None = None
        self._last_ns = 0
        self._first_ns = 0
        self.analyses = 0
        periods, period_ns = periods_before(self.scene), nanoseconds(self.scene.simulation.period)
        self._past = PastRates(periods, period_ns, self._mechanism.nv)
        self._model = OperationalModelWriter(self._analyser, self._past)
        self._grasp = flat_grasp(self.scene, self._analyser.point).tobytes()
        self._encoder = FlatArray(OPERATIONAL_MODEL_FIELDS, operational_model_bounds(self.limits))
        self._publish_model = self.output(POINT_MODEL, Float64MultiArray)
        self._coupling = CouplingWire(self.other_points, self.limits)
        self._transmission_encoder = FlatArray(self._coupling.fields, self._coupling.bounds)
        self._publish_transmission: Outlet | None = None
        if self.other_points:
            self._publish_transmission = self.output(TRANSMISSION, Float64MultiArray)
        self._publish_inertia = self.view(INVERSE_INERTIA, Float64MultiArray)
        self._publish_projector = self.view(PROJECTOR, Float64MultiArray)
        self._publish_wrenches = self.view(CONSTRAINT_WRENCHES, Float64MultiArray)
        self._publish_spectrum = self.view(SPECTRUM, Float64MultiArray)
        self._publish_count = self.view(COUNT, UInt8)
        self._mechanisms = self.sources(STATE.name)
        self._silenced = False
        self.input_array(
            STATE.name, self.control_input, self._on_state, self._layout.fields, self._mechanisms
        )

    def activate(self) -> None:
        """Start the count anew."""
        self._count = None
        self._mechanisms.forget()

    def reseat(self) -> None:
        """Forget what was found of states so far."""
        self._past.forget()
        self._model = OperationalModelWriter(self._analyser, self._past)
        self.activate()

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return what was analysed and how often."""
        now = self.now_ns()
        fault = self._mechanisms.fault(now)
        fresh = now - self._last_ns < RESTART_PAUSE_NS and not fault
        span_s = (self._last_ns - self._first_ns) / NANOSECONDS
        rate = (self.analyses - 1) / span_s if span_s > 0.0 else 0.0
        count = "unknown" if self._count is None else str(self._count)
        sentence = f"{count} joint constraints" if fresh else fault or "no states of the mechanism"
        figures = {
            "fault": fault,
            "analyses": str(self.analyses),
            "achieved_rate_hz": f"{rate:.1f}",
            "count": count,
            "inverse_inertia_rank": str(rank_of(self._model.s)),
        }
        return fresh, sentence, figures

    def _on_state(self, values: Array, now_ns: int) -> None:
        state = self._layout.unpack(values)
        check_age(state.stamp_ns, now_ns, self.age_limit_ns)
        self.ages.add(now_ns - state.stamp_ns)
        grasp = state.grasps[self._analyser.index]
        if grasp.tobytes() != self._grasp:
            self._follow(grasp)
        model = self._model
        if fault := self._mechanisms.fault(now_ns):
            self._fall_silent(fault)
            return
        self._silenced = False
        try:
            found = model.evaluate(state)
        except (HapticMechError, ArithmeticError, ValueError) as error:
            rule = f"must be a state that can be analysed: {error}"
            raise InvalidInputError("joint positions", state.q.tolist(), rule) from None
        count = self._counted(model.s, state.stamp_ns)
        model.count(count)
        if self.lockstep or self.analyses % self.view_every == 0:
            # Before the model, which is answered when it comes.
            self._transmit(state, found.analysis)
        self._publish_model.publish(self._encoder.encode(model.values))
        if self.analyses % self.view_every == 0:
            self._publish_view(found.analysis, count)
        self.analyses += 1

    def _transmit(self, state: WireState, found: OperationalAnalysis) -> None:
        """Publish what other hands do to the point."""
        if self._publish_transmission is None:
            return
        mechanism, own = self._mechanism, self._analyser.index
        places = {name: mechanism.point_index(name) for name in self.other_points}
        holding = {name: at for name, at in places.items() if state.commanded[at]}
        matrices: dict[str, Array] = {}
        if holding:
            for name, at in holding.items():
                self._place(name, state.grasps[at])
            row = coupling(mechanism.evaluate(state.q, state.v, state.active))[own]
            matrices = {name: transmission(found, row[at]) for name, at in holding.items()}
        told = CouplingMatrices(state.stamp_ns, matrices)
        self._publish_transmission.publish(
            self._transmission_encoder.encode(self._coupling.pack(told))
        )

    def _place(self, name: str, grasp: Array) -> None:
        """Let another operational point be where the mechanism says that it is."""
        point = grasp_of(self._mechanism.scene, name, grasp)
        if self._mechanism.scene.operational_point(name) != point:
            self._mechanism.set_operational_point(point)

    def _fall_silent(self, fault: str) -> None:
        """Tell the controller at once that no mechanism hears it, and then say nothing.

        Of two mechanisms neither is the one that the hand holds.
        """
        if self._silenced:
            return
        self._silenced = True
        self._count = None
        self.node.get_logger().warning(f"{fault}: no operational model is published")
        if not self._model.values[0]:
            return  # nobody was told anything
        self._model.values[COMMANDED] = 0.0
        self._publish_model.publish(self._encoder.encode(self._model.values))

    def _follow(self, grasp: Array) -> None:
        """Analyse the point where the mechanism says that it is from now on."""
        self._mechanism.set_operational_point(grasp_of(self._mechanism.scene, self.point, grasp))
        self._analyser = Analyser(self._mechanism, self.point, self._compensated_delay)
        self._model = OperationalModelWriter(self._analyser, self._past)
        self._grasp = grasp.tobytes()
        self._count = None

    def _counted(self, s: Array, time_ns: int) -> int:
        if self._count is None or not 0 <= time_ns - self._last_ns < RESTART_PAUSE_NS:
            self._counter.begin()
            self._first_ns = time_ns
            self.analyses = 0
        self._count = self._counter.update(s, (time_ns - self._first_ns) / NANOSECONDS)
        self._last_ns = time_ns
        return self._count

    def _publish_view(self, found: OperationalAnalysis, count: int) -> None:
        for outlet, matrix in (
            (self._publish_inertia, found.inverse_inertia),
            (self._publish_projector, found.constraint_projector),
        ):
            if outlet.wanted:
                outlet.publish(encode_matrix("row", "column", matrix))
        if self._publish_wrenches.wanted:
            wrenches = np.zeros((6, count))
            if count:
                wrenches[found.rows] = found.spectrum.wrenches[:, -count:]
            self._publish_wrenches.publish(encode_matrix("wrench", "constraint", wrenches))
        if self._publish_spectrum.wanted:
            mu = found.spectrum.mu.reshape(-1, 1)
            self._publish_spectrum.publish(encode_matrix("mu", "value", mu))
        if self._publish_count.wanted:
            self._publish_count.publish(encode_byte(count))
