# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ_h⁻¹ and its null space at the mechanism's state, once per state received."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from std_msgs.msg import Float64MultiArray, UInt8

from hapticmech_ros.control.loop_delay import compensated_loop_delay, periods_before
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import GRASP_SIZE, flat_grasp, grasp_of
from hapticmech_ros.nodes import analysis_kernels as own
from hapticmech_ros.nodes.actor import Actor, Host
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.nodes.parameters import AnalyserParameters
from hapticmech_ros.nodes.plain_messages import PlainMessages, Publication, Received
from hapticmech_ros.nodes.sources import Sources
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.analysis import coupling, transmission
from hapticmech_ros.operational.observation import ConstraintCounter, Observation, PastRates
from hapticmech_ros.operational.results import rank_of
from hapticmech_ros.wire.bounds import Bounds, message_bounds
from hapticmech_ros.wire.cdr import FlatArray, encode_byte, encode_matrix
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire, OperationalModelWriter
from hapticmech_ros.wire.messages import OperationalModelMessage
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
MODEL_COUNT = OperationalModelMessage.layout.start("count")


class StateAnswers(PlainMessages):
    """Answers states for an analyser.

    Args:
        actor: the analyser.
        layout: of the states.
        sources: of the states.
        encoder: of operational models.
        bounds: of these.
        outlet: that they are published through.

    Attributes:
        answer: (151,) data of the last one.
    """

    def __init__(
        self,
        actor: NullspaceAnalyser,
        layout: StateLayout,
        sources: Sources,
        encoder: FlatArray,
        bounds: Bounds,
        outlet: Outlet,
    ) -> None:
        state = FlatArray(layout.fields)
        topic = actor.lane_topic(STATE.name, Float64MultiArray)
        received = Received(topic, sources, state.prefix, layout.bounds.most)
        published = Publication(outlet, encoder.prefix, bounds.most)
        self.link = link = own.AnalyserLink()
        super().__init__(actor, [received], [published], link)
        self._analyser, self._layout = actor, layout
        self.answer = self.outputs[0].values
        nq, nv = actor.mechanism.nq, actor.mechanism.nv
        self._position, self._rates, self._before = np.zeros(nq), np.zeros(nv), np.zeros(1 + nv)
        self._ahead = self._observation = np.zeros(0)
        index, sizes = actor.analyser.index, {"contact": 6, "grasp": GRASP_SIZE, "commanded": 1}
        # The last three have a part for each operational point.
        starts = {part: at.start + index * sizes.get(part, 0) for part, at in layout.at.items()}
        link.fill(**starts, point=index, pause=RESTART_PAUSE_NS)
        link.flags = layout.at["commanded"].start

    def ready(self) -> bool:
        """Give the kernel the analyser's state; return whether it may do anything for it."""
        actor, link = self._analyser, self.link
        link.first, link.last = actor.first_ns, actor.last_ns
        link.until_view = actor.until_view
        return actor.answers_plainly

    def kernel(self) -> Callable[[], int]:
        """Return the kernel with all that it is called with."""
        actor, analyser = self._analyser, self._analyser.analyser
        active_set = actor.mechanism.active_set(actor.closed)
        if self._ahead.size != active_set.size:
            self._ahead = np.empty(active_set.size)
        self._observation = np.empty(analyser.observation_size)
        return partial(
            own.answer_states,
            self.link,
            self.inputs[0],
            self.outputs[0],
            self.polled,
            np.array(actor.closed, dtype=float),
            actor.grasp,
            np.array(actor.commanded, dtype=float),
            *active_set.constants,
            active_set.scratch,
            self._position,
            self._rates,
            analyser.constants,
            analyser.rows,
            actor.mechanism.length,
            analyser.compensated_delay,
            self._before,
            self._ahead,
            self._observation,
            actor.counter.numbers,
            *actor.past.arrays,
            self.ages,
        )

    def did(self, code: int, reads: int) -> None:
        """Update the analyser with the kernel's work."""
        if reads:
            self._analyser.answered(reads, self.link.last, int(self.answer[MODEL_COUNT]))

    def view(self) -> Callable[[], None]:
        """Return a function that publishes the last analysis for people."""
        actor, numbers, count = self._analyser, self._observation.copy(), self.answer[MODEL_COUNT]
        found = Observation(numbers, actor.analyser.rows, actor.mechanism.nv)
        # It has just been answered.
        state = self._layout.unpack(self.inputs[0].values.copy())
        transmitted = actor.transmitted(state, found.analysis)

        def publish() -> None:
            actor.transmit(state.stamp_ns, transmitted)
            actor.publish_view(found.analysis, int(count))

        return publish


class NullspaceAnalyser(Actor[AnalyserParameters]):
    """Runs an :class:`Analyser` on every state of the mechanism.

    Attributes:
        mechanism, analyser: of its scene, at the operational point as it is now.
        counter: of joint constraints.
        past: rates of the last states.
        closed: which closures the last state had closed.
        commanded: which operational points it had commanded: hands hold them.
        grasp: (7,) where it had the operational point.
        last_ns, first_ns: stamps of the last state, and of the first one of the count, ns.
        analyses: since then.
    """

    name = "nullspace_analyser"
    parameters_type = AnalyserParameters

    def __init__(self, node: Host, parameters: AnalyserParameters) -> None:
        super().__init__(node, parameters)
        self.mechanism = Mechanism(self.scene)
        # Of the loop: a command computed from a state acts a period later.
        self._compensated_delay = compensated_loop_delay(self.scene)
        self.analyser = Analyser(self.mechanism, self.point, self._compensated_delay)
        self._layout = StateLayout(self.mechanism)
        self.counter = ConstraintCounter(self.scene.perception)
        self.closed = self.mechanism.initially_active
        self._count: int | None = None
        self.last_ns = 0
        self.first_ns = 0
        self.analyses = 0
        periods, period_ns = periods_before(self.scene), nanoseconds(self.scene.simulation.period)
        self.past = PastRates(periods, period_ns, self.mechanism.nv)
        bounds = message_bounds(OperationalModelMessage, self.limits)
        self._encoder = FlatArray(OperationalModelMessage.layout, bounds)
        self.grasp = flat_grasp(self.scene, self.analyser.point)
        self._publish_model = self.output(POINT_MODEL, Float64MultiArray)
        self._coupling = CouplingWire(self.other_points, self.limits)
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
        self.commanded: tuple[bool, ...] = (False,) * len(self.mechanism.point_names)
        self.input_array(
            STATE.name, self.control_input, self._on_state, self._layout.fields, self._mechanisms
        )
        self._answers = StateAnswers(
            self, self._layout, self._mechanisms, self._encoder, bounds, self._publish_model
        )
        self._model = self._new_model()

    def activate(self) -> None:
        """Start the count anew."""
        self._count = None
        self._mechanisms.forget()
        self.wait_by(self._answers)

    def deactivate(self) -> None:
        """Answer no more."""
        self.wait_by(None)

    def reset(self) -> None:
        """Forget the results of states so far."""
        self.past.forget()
        self._model = self._new_model()
        self.activate()

    def _new_model(self) -> OperationalModelWriter:
        return OperationalModelWriter(self.analyser, self.past, self._answers.answer)

    @property
    def answers_plainly(self) -> bool:
        """Whether plain states are answered as :class:`StateAnswers` does."""
        return self._count is not None and not self._silenced

    @property
    def until_view(self) -> int:
        """After how many more analyses one is to be published for people; 0 for never."""
        views = (self._publish_inertia, self._publish_projector, self._publish_wrenches)
        wanted = (*views, self._publish_spectrum, self._publish_count, self._publish_transmission)
        if not any(outlet is not None and outlet.wanted for outlet in wanted):
            return 0
        return 1 + -self.analyses % self.view_every

    def answered(self, states: int, last_ns: int, count: int) -> None:
        """Note answers by the kernel.

        Args:
            states: how many were answered.
            last_ns: stamp of the last one, ns.
            count: joint constraints then.
        """
        self.analyses += states
        self.last_ns, self._count = last_ns, count

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return the last count, and the number and rate of analyses."""
        now = self.now_ns()
        fault = self._mechanisms.fault(now)
        fresh = now - self.last_ns < RESTART_PAUSE_NS and not fault
        span_s = (self.last_ns - self.first_ns) / NANOSECONDS
        rate = (self.analyses - 1) / span_s if span_s > 0.0 else 0.0
        count = "unknown" if self._count is None else str(self._count)
        sentence = f"{count} joint constraints" if fresh else fault or "no states of the mechanism"
        figures = {
            "fault": fault,
            "analyses": str(self.analyses),
            "achieved_rate_hz": f"{rate:.1f}",
            "count": count,
            "inverse_inertia_rank": str(rank_of(self._model.message.s)),
        }
        return fresh, sentence, figures

    def _on_state(self, values: Array, now_ns: int) -> None:
        state = self._layout.unpack(values)
        check_age(state.stamp_ns, now_ns, self.age_limit_ns)
        self.ages.add(now_ns - state.stamp_ns)
        self.commanded = state.commanded
        grasp = state.grasps[self.analyser.index]
        if grasp.tobytes() != self.grasp.tobytes():
            self._follow(grasp)
        self.closed = state.active
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
        count = self._counted(model.message.s, state.stamp_ns)
        model.message.count = count
        if self.lockstep or self.analyses % self.view_every == 0:
            # Before the model, which is answered when it comes.
            self.transmit(state.stamp_ns, self.transmitted(state, found.analysis))
        self._publish_model.publish(self._encoder.encode(model.message.values))
        if self.analyses % self.view_every == 0:
            self.node.exchange.turn.publish_views()
            self.publish_view(found.analysis, count)
        self.analyses += 1

    def transmitted(self, state: WireState, found: OperationalAnalysis) -> dict[str, Array]:
        """Return how the wrenches of the other hands that hold the mechanism reach the point.

        Args:
            state: of the mechanism.
            found: the point's analysis there.

        Returns:
            Y_ij (6, 6) by operational point; 1, m and 1/m, world axes.
        """
        mechanism, own = self.mechanism, self.analyser.index
        places = {name: mechanism.point_index(name) for name in self.other_points}
        holding = {name: at for name, at in places.items() if state.commanded[at]}
        if not holding:
            return {}
        for name, at in holding.items():
            self._place(name, state.grasps[at])
        row = coupling(mechanism.evaluate(state.q, state.v, state.active))[own]
        return {name: transmission(found, row[at]) for name, at in holding.items()}

    def transmit(self, stamp_ns: int, matrices: Mapping[str, Array]) -> None:
        """Publish how other hands' wrenches reach the point, in a scene with several.

        Args:
            stamp_ns: of the state, ns.
            matrices: Y_ij (6, 6) by operational point; 1, m and 1/m, world axes.
        """
        if self._publish_transmission is not None:
            published = CouplingMatrices(stamp_ns, matrices)
            self._publish_transmission.publish(self._coupling.encode(published))

    def _place(self, name: str, grasp: Array) -> None:
        """Move another operational point to the place published by the mechanism."""
        point = grasp_of(self.mechanism.scene, name, grasp)
        if self.mechanism.scene.operational_point(name) != point:
            self.mechanism.set_operational_point(point)

    def _fall_silent(self, fault: str) -> None:
        """Publish once that no mechanism receives commands, and then nothing.

        With two mechanisms, neither is known to be the one that the hand holds.
        """
        if self._silenced:
            return
        self._silenced = True
        self._count = None
        self.node.get_logger().warning(f"{fault}: no operational model is published")
        message = self._model.message
        if not message.stamp_ns:
            return  # nothing was published before
        message.commanded = False
        self._publish_model.publish(self._encoder.encode(message.values))

    def _follow(self, grasp: Array) -> None:
        """Analyse the point at the place published by the mechanism from now on."""
        self.mechanism.set_operational_point(grasp_of(self.mechanism.scene, self.point, grasp))
        self.analyser = Analyser(self.mechanism, self.point, self._compensated_delay)
        self._model = self._new_model()
        self.grasp = grasp.copy()
        self._count = None

    def _counted(self, s: Array, time_ns: int) -> int:
        if self._count is None or not 0 <= time_ns - self.last_ns < RESTART_PAUSE_NS:
            self.counter.begin()
            self.first_ns = time_ns
            self.analyses = 0
        self._count = self.counter.update(s, (time_ns - self.first_ns) / NANOSECONDS)
        self.last_ns = time_ns
        return self._count

    def publish_view(self, found: OperationalAnalysis, count: int) -> None:
        """Publish, for people, an analysis and the number of joint constraints."""
        for outlet, matrix in (
            (self._publish_inertia, found.inverse_inertia),
            (self._publish_projector, found.constraint_projector),
        ):
            outlet.offer(encode_matrix, "row", "column", matrix)
        if self._publish_wrenches.wanted:
            wrenches = np.zeros((6, count))
            if count:
                wrenches[found.rows] = found.spectrum.wrenches[:, -count:]
            self._publish_wrenches.publish(encode_matrix("wrench", "constraint", wrenches))
        self._publish_spectrum.offer(encode_matrix, "mu", "value", found.spectrum.mu.reshape(-1, 1))
        self._publish_count.offer(encode_byte, count)
