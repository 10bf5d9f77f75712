# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks leave nothing behind: what a tick allocates is freed by the next ones, and is little.

``tracemalloc`` sees what Python and NumPy allocate; what kernels allocate inside is theirs, and is
seen as resident size by ``python -m benchmarks memory``.
"""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.ablation.scenes import ladder
from hapticmech_ros import load_scene
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.device import device_for
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.numerics.layout import DeviceSample
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import PastRates
from hapticmech_ros.plan.scene_plan import plan_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import OperationalModelWriter
from hapticmech_ros.wire.messages import OperationalModelMessage
from hapticmech_ros.wire.state import StateLayout, WireState
from sampling import sampled

WARM_UP, TICKS = 500, 5000
# A reference kept by every tick takes 8 bytes of a list, and what it refers to 24 or more: 160 kB.
# Python's own lists of freed numbers and tuples breathe by a few kB.
LEFT_BEHIND = 16_384
# Objects that the collector tracks: ticks keep none, what looks at them has a few.
OBJECTS = 50
# In a tick: arrays of the plan come more than once (a start, stages, rounds, an end), and each is
# wrapped in views of some 100 bytes.
TIMES_ARRAYS, WRAPPING = 4, 16_384

# A closed loop, one that latches meanwhile, and every feature at once.
SCENES = [load_scene("five_bar"), load_scene("four_bar_closing"), ladder()[-1].scene()]
Tick = Callable[[], object]


def session(scene: Scene) -> Tick:
    return Session(scene).tick


def nodes(scene: Scene) -> Tick:
    """Do what the four nodes do in a period, without their messages' way between them."""
    simulator = Simulator(scene)
    analyser = Analyser(Mechanism(scene))
    layout = StateLayout(simulator.mechanism)
    past = PastRates(3, 1_000_000, simulator.mechanism.nv)
    operational_model = OperationalModelWriter(analyser, past)
    state_wire, rendering_wire = FlatArray(layout.fields), FlatArray(OperationalModelMessage.layout)
    control, device = ControlArchitecture(scene), device_for(scene)
    points, index = len(scene.operational_points), analyser.index
    state = simulator.initial_state()
    start = simulator.evaluate(state).points[index].pose
    held = device.at_rest(start, held=True)
    clutch = engage(0.0, start, start)
    now = {"state": state, "device": held, "ticks": 0}
    received, grasps = (True,) * points, flat_grasps(scene)

    def tick() -> object:
        mechanism, own, ticks = now["state"], now["device"], now["ticks"]
        wire = WireState(
            ticks * 1_000_000,
            mechanism.active,
            mechanism.q,
            mechanism.v,
            np.zeros((points, 6)),
            grasps,
            received,
        )
        sent = state_wire.encode(layout.pack(wire))
        operational_model.evaluate(layout.unpack(state_wire.decode(sent)))
        operational_model.message.count = 1
        seen = rendering_wire.decode(rendering_wire.encode(operational_model.message.values))
        model = OperationalModelMessage(seen).operational_model.values.copy()
        measured = own.published[: DeviceSample.layout.size]
        answer = control.answer(1e-3 * ticks, clutch, measured, model, 0.0)
        wrenches = np.zeros((points, 6))
        wrenches[index] = answer[1]
        now["state"] = simulator.step(mechanism, wrenches)
        now["device"] = device.step(own, answer[0], held, ticks)
        now["ticks"] = ticks + 1
        return answer

    return tick


CASES = [
    pytest.param(make, scene, id=f"{make.__name__}-{scene.name}-{index}")
    for make in (session, nodes)
    for index, scene in enumerate(SCENES)
]


def repeated(tick: Tick, times: int) -> int:
    """Tick so many times; return by how many bytes what is traced has grown."""
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(times):
        tick()
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    return after - before


def arrays_now() -> int:
    """Return how many blocks of NumPy are allocated and were traced."""
    domain = tracemalloc.DomainFilter(True, np.lib.tracemalloc_domain)
    return len(tracemalloc.take_snapshot().filter_traces([domain]).traces)


@pytest.fixture
def traced():
    tracemalloc.start()
    yield
    tracemalloc.stop()


@pytest.fixture
def traced_later():
    """Tracing makes ticks several times as long: what only warms up is not traced."""
    yield tracemalloc.start
    tracemalloc.stop()


@pytest.mark.parametrize(("make", "scene"), sampled(CASES, "behind", 2))
def test_ticks_leave_nothing_behind(
    make: Callable[[Scene], Tick], scene: Scene, traced_later: Callable[[], None]
) -> None:
    tick = make(scene)
    # A set of closures has tables of its own, once, and what touches has terms that are remembered:
    # loops latch, and contacts come, before it counts.
    changes = any(closure.latch_distance for closure in scene.closures) or scene.contacts
    if changes:
        repeated(tick, TICKS)
    traced_later()
    # What comes again and again is made anew, and traced from then on.
    repeated(tick, WARM_UP)
    arrays = arrays_now()
    gc.collect()
    objects = len(gc.get_objects())
    # A table of the interpreter grows once, for whatever test came before; what ticks leave behind
    # they leave behind again.
    left: list[int] = []
    while not left or (left[-1] >= LEFT_BEHIND and len(left) < 2):
        left.append(repeated(tick, TICKS))
    assert left[-1] < LEFT_BEHIND, left
    assert len(gc.get_objects()) - objects < OBJECTS
    assert arrays_now() <= arrays


@pytest.mark.parametrize(("make", "scene"), sampled(CASES, "collector", 2))
def test_ticks_leave_nothing_for_the_collector(make: Callable[[Scene], Tick], scene: Scene) -> None:
    """Nothing refers to itself: the collector, which would stop a tick, finds nothing to free."""
    tick = make(scene)
    repeated(tick, WARM_UP)
    gc.disable()
    try:
        for _ in range(200):
            tick()
        assert gc.collect() < OBJECTS
    finally:
        gc.enable()


@pytest.mark.usefixtures("traced")
@pytest.mark.parametrize(("make", "scene"), sampled(CASES, "arrays", 2))
def test_a_tick_takes_no_more_than_its_arrays(make: Callable[[Scene], Tick], scene: Scene) -> None:
    tick = make(scene)
    repeated(tick, WARM_UP)
    before, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    for _ in range(50):
        tick()
    _, peak = tracemalloc.get_traced_memory()
    arrays = sum(array.size_bytes for array in plan_scene(scene).arrays)
    assert peak - before < TIMES_ARRAYS * arrays + WRAPPING


@pytest.mark.usefixtures("traced")
def test_what_is_kept_is_seen() -> None:
    """The bounds above are not met by a tick that keeps one number."""
    tick, kept = session(load_scene("two_link")), []
    kept.extend(tick() for _ in range(WARM_UP))
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(TICKS):
        tick()
        kept.append(float(len(kept)))
    after, _ = tracemalloc.get_traced_memory()
    assert after - before > LEFT_BEHIND
