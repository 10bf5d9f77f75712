# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Before anything is timed: kernels and the readable implementation give the same, to rounding."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.ablation.loop import PARTS
from benchmarks.accuracy.watch import unwatched
from benchmarks.oracle import oracle, readable_simulator
from hapticmech_ros.arrays import Array
from hapticmech_ros.control import PointMeasurement
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.loop_delay import compensated_loop_delay, periods_before
from hapticmech_ros.control.measurements import flat_operational_model
from hapticmech_ros.device import DeviceState
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Evaluation
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, Session
from hapticmech_ros.simulation import MechanismState, Simulator

# Relative to a field's size. Rounding is 1e-16; conditions of D and W, and differences of
# velocities over a period of 1 ms, take the rest.
ROUNDING = 1e-9
# A field that is smaller than this has no size of its own: m, N, s and their products.
FLOOR = 1e-3


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far kernels are from the readable implementation.

    Attributes:
        ticks: that were compared, each from the same state.
        apart: largest relative difference of each part of the tick.
    """

    ticks: int
    apart: dict[str, float]

    @property
    def held(self) -> bool:
        """Whether all parts agree to rounding."""
        return all(value <= ROUNDING for value in self.apart.values())


def agreement(scene: Scene, ticks: int) -> Agreement:
    """Compare every tick of a session with the readable implementation, part by part.

    Both start a tick from the same state, so that differences do not add up.
    """
    # Steps that are done again in smaller ones are the kernels' alone.
    scene = unwatched(scene)
    session = Session(scene)
    readable = _Readable(scene, session)
    apart = dict.fromkeys(PARTS, 0.0)
    sample = session.tick()
    readable.engage(sample)
    for number in range(1, ticks + 1):
        following = session.tick()
        for part, value in readable.compare(sample, following, number - 1).items():
            apart[part] = max(apart[part], value)
        sample = following
    return Agreement(ticks, apart)


class _Readable:
    def __init__(self, scene: Scene, session: Session) -> None:
        # Contacts are kernels' alone: their forces, found per substep, push on links instead.
        plan, found = scene.simulation, scene
        if scene.contacts:
            found = scene.stepped(period=plan.period / plan.substeps, substeps=1)
        self._finder = Simulator(found)
        self._substeps = plan.substeps if scene.contacts else 1
        without = found.model_copy(update={"contacts": ()})
        self._simulator = readable_simulator(without)
        links = {shape.name: shape.link for shape in scene.shapes}
        self._touching_links = [(links[pair.a], links[pair.b]) for pair in scene.contacts]
        self._kernels = Simulator(scene)
        mechanism, compensated_delay = self._simulator.mechanism, compensated_loop_delay(scene)
        self._analyser = oracle("operational").ReadableAnalyser(
            mechanism, compensated_delay=compensated_delay
        )
        # Rates of the last states, with the same closures closed, the newest one last.
        self._past: list[tuple[Active, Array]] = []
        self._wanted, self._period = periods_before(scene), scene.simulation.period
        self._control = oracle("control").ReadableControl(scene)
        self._device = oracle("devices").readable_device_for(scene)
        self._index = self._analyser.index
        self._held: DeviceState | None = None
        self._loop = oracle("rendering_loop").RenderingLoop(scene, self._control)
        self._loop.envelope.place(session.device.published[:3])
        self._points = len(session.simulator.mechanism.point_names)

    def engage(self, first: Sample) -> None:
        """Take hold where the session did."""
        start = first.point.pose
        self._clutch = engage(0.0, start, start, self._control.gains.engagement_ramp)
        self._held = first.device

    def _moved(self, state: MechanismState, wrenches: Array) -> MechanismState:
        """Return the state a period later, by the readable implementation."""
        for _ in range(self._substeps):
            found = self._finder.step(state, wrenches) if self._touching_links else state
            on_links = self._contact_wrenches(state, found)
            state = self._simulator.step(state, wrenches, on_links)
            state = replace(state, touching=found.touching)
        return state

    def _contact_wrenches(self, state: MechanismState, after: MechanismState) -> dict[str, Array]:
        """Return what contacts do to links in a step, at the origins of the links' frames."""
        wrenches: dict[str, Array] = {}
        if after.touching is None:
            return wrenches
        for pair, links in enumerate(self._touching_links):
            for link, sign in zip(links, (1.0, -1.0), strict=True):
                if link != "world":
                    origin = self._simulator.mechanism.frame_pose(state.q, link).translation
                    wrench = sign * after.touching.wrench(pair, origin)
                    wrenches[link] = wrenches.get(link, np.zeros(6)) + wrench
        return wrenches

    def _before(self, state: MechanismState) -> Array | None:
        """Return how long ago (s), and which rates were, if known; remember those of now."""
        past, wanted = self._past, self._wanted
        if past and past[-1][0] != state.active:
            past.clear()
        past.append((state.active, state.v.copy()))
        if len(past) <= wanted:
            return None
        return np.concatenate(((wanted * self._period,), past[-1 - wanted][1]))

    def compare(self, sample: Sample, following: Sample, tick: int) -> dict[str, float]:
        """Return the relative difference of each part of one tick."""
        terms = self._simulator.evaluate(sample.mechanism)
        analysis = self._analyser.analyse(terms)
        state = sample.mechanism
        before = self._before(state)
        compensated = self._analyser.compensated(
            terms, state.q, state.v, state.active, analysis, before
        )
        device, point, model = sample.device, sample.point, sample.model
        environment = sample.external_wrench + sample.contact_wrench
        seen = PointMeasurement(point.pose, point.twist, environment)
        measured = np.concatenate((device.published[:13], sample.hand_wrench))
        operational_model = flat_operational_model(model, seen)
        self._clutch = self._control.with_slip(
            sample.time, self._clutch, measured, operational_model
        )
        acting = self._loop.tick(
            sample.time, self._clutch, measured, device.applied, operational_model
        )
        output = self._loop.output
        wrenches = np.zeros((self._points, 6))
        wrenches[self._index] = acting.mechanism
        moved = self._moved(state, wrenches)
        held = self._device.step(device, acting.device, self._held, tick)
        return {
            "observe": max(
                _terms_apart(self._kernels.evaluate(sample.mechanism), terms),
                _analysis_apart(sample.analysis, analysis),
                _apart(model.inverse_inertia, compensated.inverse_inertia),
                _apart(model.free_acceleration, compensated.free_acceleration),
            ),
            "control": max(
                _apart(sample.output.device, output.device),
                _apart(sample.output.mechanism, output.mechanism),
                _apart(sample.acting, np.array(acting)),
            ),
            "step": _states_apart(following.mechanism, moved),
            "device": _apart(following.device.published, held.published),
        }


def _terms_apart(found: Evaluation, expected: Evaluation) -> float:
    point, other = found.points, expected.points
    fields = [
        (found.bias_force, expected.bias_force),
        (found.passive_force, expected.passive_force),
        (found.closure_jacobian, expected.closure_jacobian),
        (found.closure_bias, expected.closure_bias),
        (found.inertia, expected.inertia),
        *((a.jacobian, b.jacobian) for a, b in zip(point, other, strict=True)),
        *((a.drift, b.drift) for a, b in zip(point, other, strict=True)),
    ]
    return max(_apart(one, two) for one, two in fields)


def _analysis_apart(found: OperationalAnalysis, expected: OperationalAnalysis) -> float:
    return max(
        _apart(found.inverse_inertia, expected.inverse_inertia),
        _apart(found.constraint_projector, expected.constraint_projector),
        _apart(found.wrench_projector, expected.wrench_projector),
        _apart(found.free_acceleration, expected.free_acceleration),
    )


def _states_apart(found: MechanismState, expected: MechanismState) -> float:
    return max(_apart(found.q, expected.q), _apart(found.v, expected.v))


def _apart(found: Array, expected: Array) -> float:
    if expected.size == 0:
        return 0.0
    size = max(float(np.abs(expected).max()), FLOOR)
    return float(np.abs(found - expected).max()) / size
