# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The virtual mechanism as a node: moves under wrenches at its operational points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, UInt8MultiArray

from hapticmech_ros.compilation import arrays_of
from hapticmech_ros.contact.step_kernels import MORE_WORKSPACE
from hapticmech_ros.mechanism.closures import grasp_written
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace, PointKinematics
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.nodes import lane_kernels as kernels
from hapticmech_ros.nodes import mechanism_kernels as own
from hapticmech_ros.nodes.actor import ClockedActor, Host, LastValidState
from hapticmech_ros.nodes.buttons import ButtonInput
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.external_wrenches import ExternalWrenches
from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.nodes.mechanism_ports import (
    ContactPort,
    OperationalPoints,
    PointPort,
    closure_button,
    offer_closures,
)
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.nodes.operating_state import OperatingState
from hapticmech_ros.nodes.parameters import MechanismParameters
from hapticmech_ros.nodes.plain_messages import (
    PlainCommand,
    PlainMessages,
    Publication,
    stacked,
)
from hapticmech_ros.nodes.sources import first_fault
from hapticmech_ros.nodes.timeouts import MECHANISM_COMMAND, timeout_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.operational.analysis import Analyser, ContactWrenches, by_others
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint
from hapticmech_ros.session.sample import begin_totals, state_of
from hapticmech_ros.session.tick_kernels import (
    AT,
    CLOCK_SIZE,
    KNOWN,
    WHY,
    SessionData,
    SessionTimes,
    SessionTotals,
)
from hapticmech_ros.simulation import MechanismState, Simulator
from hapticmech_ros.wire.bounds import pose_bounds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import MechanismEnergy
from hapticmech_ros.wire.stamped import JointStateWriter
from hapticmech_ros.wire.state import StateLayout, WireState, coordinate_names
from hapticmech_ros.wire.topics import (
    CLOSURES,
    ENERGY,
    EXTERNAL_WRENCH,
    JOINT_STATES,
    POINT_COMMAND,
    POINT_OPERATING_STATE,
    POINT_STATE_COMMAND,
    STATE,
    user_prefixes,
)

_NO_CONTACTS = np.zeros(0, dtype=np.int64), np.zeros(0)


class MechanismTicks(PlainMessages):
    """Steps a simulator's mechanism by a compiled kernel, which receives commands and publishes.

    Args:
        actor: the simulator.
        layout: of its state messages.
        outlet: of the state messages.
    """

    def __init__(self, actor: MechanismSimulator, layout: StateLayout, outlet: Outlet) -> None:
        command, state, ports = PlainCommand(actor.wrenches), FlatArray(layout.fields), actor.held
        received = []
        for port in ports:
            topic = actor.lane_topic(POINT_COMMAND.of(port.name), WrenchStamped)
            one = command.received(topic, port.controllers)
            # One hand may feel the mechanism while nobody holds the other points.
            received.append(one._replace(may_lack=len(ports) > 1))
        published = Publication(outlet, state.prefix, layout.bounds.most)
        self.link = link = own.MechanismLink()
        super().__init__(actor, received, [published], link)
        self._simulator, self._out = actor, self.outputs[0].values
        self._topics = stacked(self.inputs)
        mechanism, simulation = actor.simulator.mechanism, actor.scene.simulation
        stepper, points = actor.simulator.stepper, mechanism.point_names
        self._ports = np.zeros((len(ports), kernels.CommandPort.layout.size), dtype=np.int64)
        self._points = np.array([mechanism.point_index(port.name) for port in ports])
        self._commands = np.zeros((2 * len(ports), 6))
        self._acting = np.zeros((len(points), 6))
        sizes = {
            "index": self._points[0],
            "steps": simulation.substeps,
            "stages": stepper.stages,
            "implicit": stepper.implicit,
        }
        parts = {name: np.zeros(0) for name in SessionData.parts} | {
            "times": SessionTimes().values,
            "q": np.zeros(mechanism.nq),
            "v": np.zeros(mechanism.nv),
            "totals": SessionTotals().values,
        }
        self._contacts = actor.simulator.contact_memory()
        self._metrics, self._latches = np.zeros((0, 0)), actor.simulator.latches(actor.state)
        self._feels = self._contacts is not None or len(ports) > 1
        if self._feels:
            analyser = Analyser(mechanism, points[0])
            parts |= {
                "rows": analyser.rows,
                "observation": np.zeros(analyser.observation_size),
                "before": np.zeros(1 + mechanism.nv),
            }
        self._data = SessionData(*arrays_of(SessionData, sizes, parts))
        self._data.times.fill(period=actor.period_s, length=mechanism.length)
        self._packed = np.zeros((4, 0))
        self._clock = np.zeros(CLOCK_SIZE, dtype=np.int64)
        self._known: MechanismState | None = None
        self._scene: Scene | None = None
        self._closed, self._grasp = layout.at["closed"], layout.at["grasp"]
        self._felt = layout.at["contact"]
        link.fill(**{part: layout.at[part].start for part in ("position", "velocity")})
        link.contact = layout.at["contact"].start
        link.commanded = layout.at["commanded"].start
        link.period = nanoseconds(actor.period_s)

    def ready(self) -> bool:
        """Set the kernel's inputs from the simulator; return whether the kernel may run."""
        actor, link = self._simulator, self.link
        if not actor.steps_plainly or actor.clock is None:
            return False
        link.next = actor.clock.next_ns
        link.done = link.missed = 0
        for port, command, row in self._each_port():
            link.timeout, link.ramp = port.command.timeout_ns, port.command.ramp_ns
            row.since = port.since_ns
            row.received, row.received_before = port.command.put_into(command)
            row.newest, row.arrived = port.order.last
        link.until_view = actor.until_view
        state, simulator, scene = actor.state, actor.simulator, actor.simulator.scene
        # The kernel's terms depend on the operational point's place; moving that makes a new scene.
        if scene is not self._scene:
            self._scene, self._known = scene, None
            if self._feels:
                names = simulator.mechanism.point_names
                every = [Analyser(simulator.mechanism, name).constants for name in names]
                self._metrics = np.array(every)
        if state is not self._known:
            self._load(state)
        self._out[self._grasp] = actor.places
        return True

    def _each_port(self) -> Iterator[tuple[PointPort, Array, kernels.CommandPort]]:
        """Yield each held point's port, and its commands (2, 6) and state in the kernel."""
        commands = self._commands.reshape(-1, 2, 6)
        for port, command, row in zip(self._simulator.held, commands, self._ports, strict=True):
            yield port, command, kernels.CommandPort(row)

    def _load(self, state: MechanismState) -> None:
        """Set the kernel's state."""
        simulator, data = self._simulator.simulator, self._data
        active_set = simulator.mechanism.active_set(state.active)
        if self._packed.shape[1] != active_set.size:
            self._packed = np.zeros((4, active_set.size))
        self._latches = simulator.latches(state)
        data.q[:], data.v[:] = state.q, state.v
        begin_totals(data.totals, state)
        if self._contacts is not None:
            if self._clock[WHY] == MORE_WORKSPACE:
                self._contacts.enlarge()
                self._clock[WHY] = 0
            self._contacts.begin_with(state.touching)
        closing = simulator.closing(state)
        self._clock[AT], self._clock[KNOWN] = 0, closing.active_set is active_set
        if self._clock[KNOWN]:
            self._packed[0] = closing.packed
        self._out[self._closed] = state.active
        self._known = state

    def kernel(self) -> Callable[[], int]:
        """Return the kernel with its arguments bound."""
        simulator, data = self._simulator.simulator, self._data
        active_set = simulator.mechanism.active_set(self._simulator.state.active)
        simulator.stepper.prepare()
        contacts: tuple[Array, Array] = _NO_CONTACTS
        if self._contacts is not None:
            contacts = self._contacts.arrays
        return partial(
            own.move_at_deadlines,
            self.link,
            *self._topics,
            self.outputs[0],
            self.polled,
            self._ports,
            self._points,
            self._commands,
            self._acting,
            *active_set.constants,
            self._packed,
            simulator.stepper.work,
            data,
            self._metrics,
            *contacts,
            *self._latches,
            self._clock,
            self.ages,
        )

    def did(self, code: int, reads: int) -> None:
        """Update the simulator with the results of the kernel's run."""
        actor, link = self._simulator, self.link
        if reads or link.done:
            for port, command, row in self._each_port():
                port.command.take_from(command, row.received, row.received_before)
                port.order.last = row.newest, row.arrived
        if link.done:
            self._known = state = self._state
            actor.moved(state, link, code != kernels.TO_SAY)

    @property
    def _state(self) -> MechanismState:
        """The state to which the kernel has moved the mechanism."""
        known, data = self._known or self._simulator.state, self._data
        touching = None if self._contacts is None else self._contacts.touching()
        return state_of(known, data.totals, data.q.copy(), data.v.copy(), touching)

    def view(self) -> Callable[[], None]:
        """Return a function that publishes the views of the kernel's state."""
        stamp_ns, felt = self.link.next - self.link.period, self._out[self._felt]
        return self._simulator.prepare_view(self._state, felt.reshape(-1, 6).copy(), stamp_ns)


class MechanismSimulator(ClockedActor[MechanismParameters]):
    """Drives a :class:`Simulator` at the control rate.

    In lockstep the command that acts over a period answers the sample one period before it.

    Attributes:
        calm: (points, 6) no wrenches, read-only.
    """

    name = "mechanism_simulator"
    parameters_type = MechanismParameters
    # Half a period after the device, so that a command computed from the device's measurement has
    # arrived when the mechanism's next step begins.
    phase = 0.5

    def __init__(self, node: Host, parameters: MechanismParameters) -> None:
        super().__init__(node, parameters)
        self.simulator = Simulator(self.scene)
        self._mechanism = self.simulator.mechanism
        self._closures = [closure.name for closure in self._mechanism.closures]
        self.state: MechanismState = self.simulator.initial_state()
        names = self._mechanism.point_names
        self._commands = np.zeros((len(names), 6))
        self.calm = np.zeros((len(names), 6))
        self.calm.flags.writeable = False
        self._external = self.calm
        acted_on = bool(self.scene.contacts) or len(names) > 1
        self._contact_wrenches = ContactWrenches(self._mechanism) if acted_on else None
        # Wrenches by the controllers in the period that begins.
        self._commanded_wrenches = self.calm
        held = parameters.held_points.split(",") if parameters.held_points else [self.point]
        held = [self.scene.operational_point(name.strip()).name for name in held]
        self._held = [self._mechanism.point_index(name) for name in held]
        for prefix in user_prefixes(held).values():
            ButtonInput(self, prefix, self._pressed)
        self._on_links: dict[str, Array] = {}
        self._last_valid = LastValidState(self.state, self.period_s)
        self._ticks = self._sampled_ns = 0
        self._inaccurate_ns = NEVER
        self._joints = JointStateWriter(coordinate_names(self._mechanism))
        self._layout = StateLayout(self._mechanism)
        self._wire = FlatArray(self._layout.fields, self._layout.bounds)
        self._energy = FlatArray(MechanismEnergy.layout)
        self._publish_wire = self.output(STATE, Float64MultiArray)
        self._publish_joints = self.view(JOINT_STATES, JointState)
        self._publish_energy = self.view(ENERGY, Float64MultiArray)
        self._publish_closures = self.output(CLOSURES, UInt8MultiArray, LATCHED)
        self._ports = [PointPort(self, name, self.act) for name in names]
        self._contact_port = ContactPort(self, [contact.name for contact in self.scene.contacts])
        self._listened: ExternalWrenches | None = None
        if not parameters.require_external_wrench:
            self._listened = self._listen_to_wrenches(names)
        self._grasps = OperationalPoints(
            self, self._mechanism, lambda: self.state.q, self._commanded_grasp
        )
        self._asked = ""
        self.validate_parameters(parameters)
        self.apply_parameters(parameters)
        self._grasps.announce()
        self._announced = self.state.active
        self._announce_closures()
        self._operating = OperatingState(
            self,
            (POINT_OPERATING_STATE, POINT_STATE_COMMAND),
            fault=self._fault,
            at_zero=self._rest,
        )
        offer_closures(self, self._closures, self._switch)
        self._plain: MechanismTicks | None = None
        # If a kernel can step this mechanism without Python.
        if not parameters.require_external_wrench:
            self._plain = MechanismTicks(self, self._layout, self._publish_wire)

    def apply_parameters(self, parameters: MechanismParameters) -> None:
        """Replace the parameters; new timeouts apply from now on."""
        super().apply_parameters(parameters)
        self._timeout_ns = nanoseconds(self._command_timeout(parameters))
        for port in self._ports:
            port.set_timeout(self._timeout_ns)
        if self._listened is not None:
            self._listened.set_timeout(nanoseconds(parameters.external_timeout))
        if parameters.grasp != self._asked:
            self._asked = parameters.grasp
            self._grasp(self._asked_for(parameters))

    def validate_parameters(self, parameters: MechanismParameters) -> None:
        """Raise for parameters that do not fit the scene, or that are not allowed in lockstep."""
        self._command_timeout(parameters)
        if parameters.closure_button:
            self.refuse_in_lockstep("closure_button", parameters.closure_button)
            closure_button(parameters.closure_button, self._closures)
        point = self._asked_for(parameters)
        if parameters.grasp != self._asked:
            if self._ticks:
                self.refuse_in_lockstep("grasp", point.link)
            self._check_within_reach(point)

    def _command_timeout(self, parameters: MechanismParameters) -> float:
        """Return how long (s) the mechanism acts on a command."""
        return timeout_of(parameters, "command_timeout", MECHANISM_COMMAND, self.period_s)

    def activate(self) -> None:
        """Continue from the present state; commands and wrenches received before are discarded."""
        for port in self._ports:
            port.forget()
        if self._listened is not None:
            self._listened.forget()
        self._commands = np.zeros_like(self._commands)
        self._external = self.calm
        self._on_links = {}
        self._commanded_wrenches = self.calm
        self._inaccurate_ns = NEVER
        self._operating.publish(active=True)
        self.wait_by(self._plain)

    @property
    def held(self) -> list[PointPort]:
        """The ports of the operational points that are held."""
        return [self._ports[index] for index in self._held]

    @property
    def places(self) -> Array:
        """(7 points,) The places of all operational points, as in the state message."""
        return np.ravel(self._grasps.numbers)

    @property
    def steps_plainly(self) -> bool:
        """Whether a step needs no input but :attr:`held`'s; see :class:`MechanismTicks`."""
        now, held = self.now_ns(), self._held
        commanded = any(
            port.command.stands(now) for i, port in enumerate(self._ports) if i not in held
        )
        pushed = self._external is not self.calm or self._on_links or self._is_pushed
        waits = self.backlog.owed or self._last_valid.resting or self._operating.withheld
        state = self.state
        # One that was opened does not latch again before it has left its reach.
        changed = state.active != self._announced or (
            state.released and self.simulator.may_latch(state)
        )
        return not (commanded or pushed or waits or changed)

    @property
    def _is_pushed(self) -> bool:
        return self._listened is not None and self._listened.pushes(self.now_ns())

    @property
    def until_view(self) -> int:
        """Number of steps until the next view is due."""
        return 1 + -self._ticks % self.view_every

    def moved(self, state: MechanismState, link: kernels.DeadlineLink, published: bool) -> None:
        """Take over the state to which the kernel has moved the mechanism.

        Args:
            state: the mechanism's state.
            link: number of steps done, and when the next one is due.
            published: whether the last state was published.
        """
        if self.clock is None:
            return
        before, self.state = self.state.account.inaccurate, state
        self.clock.next_ns = link.next
        self.clock.periods += link.done
        self.clock.missed += link.missed
        self._note_inaccurate(before)
        self._sampled_ns = self.clock.last_deadline_ns
        for index, port in zip(self._held, self.held, strict=True):
            self._commands[index] = port.command.at(self._sampled_ns)
        self._commanded_wrenches = self._to_act(self._sampled_ns)
        self._ticks += link.done - link.missed - (not published)
        if self.simulator.may_latch(state):
            self.failures.run("tick", self._latch)
        if self._last_valid.resting:
            return
        if not published:
            self.failures.run("tick", self._publish, self._sampled_ns)
            return
        self._last_valid.keep(self.state, link.done)

    def deactivate(self) -> None:
        """Bring the mechanism to rest; on activation it continues from this position."""
        self.wait_by(None)
        self._rest()
        self._operating.publish(active=False)

    def _rest(self) -> None:
        self.state = replace(self.state, v=np.zeros_like(self.state.v))

    def reset(self) -> None:
        """Return to the last valid state, at rest, without wrenches; be silent for SILENCE_NS."""
        self.state = self._last_valid.go_back(self.now_ns())
        self._rest()
        self.activate()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether the commands for the next step, and required wrenches, have arrived."""
        if self.parameters.require_external_wrench and not all(
            deadline_ns in port.awaited for port in self._ports
        ):
            return False
        needed = [self.answered_ns(deadline_ns)] if self._ticks > 1 else []
        # With several hands, each feels the others' newest commands.
        if self._ticks and len(self._held) > 1:
            needed.append(deadline_ns - self.period_ns)
        return all(time in self._ports[i].commands for i in self._held for time in needed)

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Step the mechanism under the valid wrenches, and publish its state."""
        if self._last_valid.rests(deadline_ns, self.activate):
            return
        if self._ticks or not self.lockstep:
            for known_ns, _ in self.steps(periods, deadline_ns):
                self._commands = self._commanded(known_ns, deadline_ns)
                if not self._operating.withheld:
                    self._move()
            if not self.backlog.owed:
                for port in self._ports:
                    port.command.sampled()
        self._external = self._pushing(deadline_ns)
        self._commanded_wrenches = self._to_act(deadline_ns)
        self._publish(deadline_ns)

    def _to_act(self, deadline_ns: int) -> Array:
        """Return the wrenches (points, 6), N and N m, of two or more controllers that act next."""
        held, answered = self._held, deadline_ns - self.period_ns
        if not self.lockstep:
            held = [i for i, port in enumerate(self._ports) if port.command.stands(deadline_ns)]
        if len(held) < 2:
            return self.calm
        wrenches = np.zeros_like(self.calm)
        for index in held:
            port = self._ports[index]
            if not self.lockstep:
                wrenches[index] = port.command.at(deadline_ns)
            elif answered in port.commands:
                wrenches[index] = port.commands[answered]
        return wrenches

    def _publish(self, deadline_ns: int) -> None:
        state, external = self.state, self._by_all()
        self._sampled_ns = deadline_ns
        late = self._is_behind or bool(self._operating.withheld)
        if self.lockstep:
            received = tuple([index in self._held for index in range(len(self._ports))])
        else:
            received = tuple([not late and port.received(deadline_ns) for port in self._ports])
        wire = WireState(
            deadline_ns, state.active, state.q, state.v, external, self._grasps.numbers, received
        )
        self._publish_wire.publish(self._wire.encode(self._layout.pack(wire)))
        self._last_valid.keep(state)
        if state.active != self._announced:
            self._announce_closures()
        if self._ticks % self.view_every == 0:
            self.node.exchange.turn.publish_views()
            self.prepare_view(state, external, deadline_ns)()
        self._ticks += 1

    @property
    def _is_behind(self) -> bool:
        """Whether, after a stall, more steps are owed than fit into the command timeout.

        Several steps are then made per period, and the mechanism must not be held meanwhile.
        """
        return self.backlog.owed * self.period_ns > self._timeout_ns

    def _by_all(self) -> Array:
        """Return F_c (points, 6), N and N m: external, of contacts, and of other hands."""
        touching = self.state.touching
        touched = touching is not None and bool(touching.joint_force.any())
        if self._contact_wrenches is None or not (touched or self._commanded_wrenches.any()):
            return self._external
        terms = self.simulator.evaluate(self.state)
        forces = by_others(terms, self._commanded_wrenches)
        if touching is not None:
            forces += touching.joint_force
        return np.asarray(self._external + self._contact_wrenches.at(terms, forces))

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether all is well, a sentence, and the mechanism's figures."""
        closed = ", ".join(self._mechanism.names_of(self.state.active)) or "none"
        pushing = {} if self._listened is None else self._listened.figures(self.now_ns())
        space = self.simulator.evaluate(self.state).space
        energy = energy_of(self.state, space, 0)
        drift = self.state.account.drift(energy.kinetic)
        figures = {
            **self.clock_figures(),
            **pushing,
            "closures": closed,
            "closure_rank": str(space.rank),
            "closure_error": f"{self.state.closure_error:.3e}",
            "kinetic_energy_j": f"{energy.kinetic:.6g}",
            "potential_energy_j": f"{energy.potential:.6g}",
            "energy_balance_j": f"{energy.balance:.9g}",
            "energy_surplus_j": f"{self.state.account.surplus:.3e}",
            "energy_drift": f"{drift:.1e}",
            "steps_refined": str(self.state.account.refined),
            "steps_inaccurate": str(self.state.account.inaccurate),
            "overtaken_commands": str(sum(port.order.overtaken for port in self._ports)),
        }
        now = self.now_ns()
        figures["fault"] = self._two_command(now)
        fault = self._fault() or self._operating.withheld
        if not fault and drift > SCHEMES[self._mechanism.scene.simulation.integrator].drift:
            fault = f"energy has drifted by {drift:.1%} of the energy exchanged: shorten the period"
        if not fault and now - self._inaccurate_ns < NANOSECONDS:
            fault = self._inaccuracy()
        well = not fault
        return well, fault or f"closed loops: {closed}", figures

    def _two_command(self, now_ns: int) -> str:
        return first_fault((port.controllers for port in self._ports), now_ns)

    def _fault(self) -> str:
        """Return the fault for which the mechanism must not be held; empty if there is none."""
        resting = self._last_valid.resting
        failed = f"restarting after an error: {self.failures.last}" if resting else ""
        return self._two_command(self.now_ns()) or failed

    def _move(self) -> None:
        wrenches, before = self._commands + self._external, self.state.account.inaccurate
        self.state = self.simulator.step(self.state, wrenches, self._on_links)
        self._note_inaccurate(before)

    def _latch(self) -> None:
        self.state = self.simulator.latch(self.state)

    def _note_inaccurate(self, before: int) -> None:
        """Log inaccurate steps if there are more than ``before``, at most once per second."""
        if self.state.account.inaccurate > before:
            now = self.now_ns()
            # Once for a series of them.
            if now - self._inaccurate_ns >= NANOSECONDS:
                self.node.get_logger().warning(self._inaccuracy())
            self._inaccurate_ns = now

    def _inaccuracy(self) -> str:
        account = self.state.account
        return (
            f"{account.inaccurate} steps so far have an energy error above the scene's tolerance "
            f"({account.surplus:.3g} J in all): shorten the period, or add substeps"
        )

    def _commanded(self, known_ns: int, deadline_ns: int) -> Array:
        """Return the controllers' wrenches (points, 6), N and N m, that act over a step.

        Args:
            known_ns: by when the commands must have arrived, ns; not used in lockstep.
            deadline_ns: of the step, ns; used in lockstep only.
        """
        if not self.lockstep:
            commands = self._commands
            for index, port in enumerate(self._ports):
                commands[index] = port.command.at(known_ns)
            return commands
        wrenches = np.zeros_like(self._external)
        if self._ticks >= 2:
            answered = self.answered_ns(deadline_ns)
            for index in self._held:
                wrenches[index] = self._ports[index].commands.pop(answered)
        return wrenches

    def _pushing(self, now_ns: int) -> Array:
        """Return the external wrenches (points, 6), N and N m, from now on; keep those on links."""
        if self._listened is None:
            return np.array([port.awaited.pop(now_ns) for port in self._ports])
        pushed = self._listened.at(now_ns, self._rotation_of)
        if not pushed:
            self._on_links = pushed
            return self.calm
        mechanism = self._mechanism
        external = np.zeros_like(self._external)
        for index, name in enumerate(mechanism.point_names):
            if name in pushed:
                external[index] = pushed.pop(name)
        self._on_links = pushed
        return external

    def _rotation_of(self, frame: str) -> Array:
        return np.asarray(self._mechanism.frame_pose(self.state.q, frame).rotation)

    def prepare_view(
        self, state: MechanismState, external: Array, time_ns: int
    ) -> Callable[[], None]:
        """Return a function that publishes the views of a state.

        It may run while a kernel does. So all that evaluates the mechanism is done here: a
        mechanism's workspace belongs to one thread at a time.

        Args:
            state: of the mechanism.
            external: (points, 6) F_c, N and N m, world axes at each operational point.
            time_ns: stamp of the state, ns.
        """
        terms = self.simulator.evaluate(state)
        q = self._mechanism.coordinates(state.q).tolist()
        wanted = self._publish_energy.wanted
        energies = energy_of(state, terms.space, time_ns) if wanted else None
        return lambda: self._publish_view(state, q, terms.points, external, energies, time_ns)

    def _publish_view(
        self,
        state: MechanismState,
        q: list[float],
        points: Sequence[PointKinematics],
        external: Array,
        energies: MechanismEnergy | None,
        time_ns: int,
    ) -> None:
        self._operating.publish(self.node.active)
        # Encoded once for all outlets, if any.
        joints = cache(partial(self._joints.encode, q, state.v.tolist(), (), time_ns))
        self._publish_joints.offer(joints)
        for port, point, force in zip(self._ports, points, external, strict=True):
            # Joints may be within their limits while a point far out on a link is beyond those of
            # messages: this raises, as its state could not be published.
            port.check(point)
            port.publish(point, force, joints, time_ns)
        self._contact_port.publish(state.touching, time_ns)
        if energies is not None:
            self._publish_energy.publish(self._energy.encode(energies.values))

    def _asked_for(self, parameters: MechanismParameters) -> OperationalPoint:
        """Return the operational point at the parameter ``grasp``; if empty, as in the scene."""
        if not parameters.grasp:
            return self.scene.operational_point(self.point)
        return grasp_written(self.scene, self.point, parameters.grasp)

    def _commanded_grasp(self, point: OperationalPoint) -> None:
        self.refuse_in_lockstep("grasp", point.link)
        self._check_within_reach(point)
        self._grasp(point)

    def _grasp(self, point: OperationalPoint) -> None:
        """Move an operational point; the controller's wrench at the old place ends."""
        self.simulator.set_operational_point(point)
        if self._contact_wrenches is not None:
            self._contact_wrenches = ContactWrenches(self._mechanism)
        port = self._ports[self._mechanism.point_index(point.name)]
        port.let_go(self._sampled_ns)
        self._grasps.moved(point)

    def _check_within_reach(self, point: OperationalPoint) -> None:
        """Raise for a grasp beyond ``limits.position``, where no message could report the point."""
        link = self._mechanism.frame_pose(self.state.q, point.link)
        pose_bounds(self.limits).check((*link.act(se3(point.origin).translation), 0.0, 0.0, 0.0))

    def _pressed(self, number: int) -> None:
        """Open or close the loop of the closure button, if that has this number."""
        found = closure_button(self.parameters.closure_button, self._closures)
        if found is not None and found[1] == number:
            self._switch(found[0], not self.state.active[self._closures.index(found[0])])

    def _switch(self, closure: str, on: bool) -> None:
        self.refuse_in_lockstep(f"closure {closure}", on)
        self.state = self.simulator.switch(self.state, {closure: on})

    def _announce_closures(self) -> None:
        self._announced = self.state.active
        message = UInt8MultiArray(data=[int(on) for on in self.state.active])
        label = ",".join(self._closures)
        size = len(self.state.active)
        message.layout.dim = [MultiArrayDimension(label=label, size=size, stride=size)]
        self._publish_closures.publish(message)

    def _listen_to_wrenches(self, points: Sequence[str]) -> ExternalWrenches:
        bodies = [*points, *(link.name for link in self.scene.links)]
        listened = ExternalWrenches(
            self,
            {body: f"mechanism/{body}" for body in bodies},
            "external_cf",
            [*bodies, *(f"{name}_world" for name in points)],
            root="mechanism",
        )
        for name in points:
            listened.listen(EXTERNAL_WRENCH.of(name))
        return listened


def energy_of(state: MechanismState, space: ConstraintSpace, time_ns: int) -> MechanismEnergy:
    """Return the energies of a mechanism at a state, at a time (ns).

    Energy stored in contacts counts as potential energy, energy lost there as lost by damping.

    Args:
        state: of the mechanism.
        space: its terms there.
        time_ns: ns.
    """
    kinetic, potential = 0.5 * space.size(state.v) ** 2, space.closing.potential_energy
    account = state.account
    return MechanismEnergy.of(
        time_ns,
        kinetic=kinetic,
        potential=potential + account.contact_energy,
        work_in=account.work_in,
        damping_loss=account.damping_loss + account.contact_loss,
        latch_loss=account.latch_loss,
        closure_error=state.closure_error,
        surplus=account.surplus,
        refined=account.refined,
        inaccurate=account.inaccurate,
    )
