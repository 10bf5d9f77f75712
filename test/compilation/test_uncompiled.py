# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels do what they do as the Python that they are written in: compilation changes nothing.

In a process of its own: there every kernel is called through what looks at some of its calls.
"""

import copy
import json
import subprocess
import sys
from collections import Counter

import numpy as np

# Calls that are done once more without being compiled; of most kernels the first one is the start.
LOOKED_AT = (1, 2, 3, 7, 20, 60, 200)
# What they call belongs to the graph: memory of others by its address, sockets, clocks.
OF_NODES = "nodes_"
# All of which are parts of others as well.
AS_PARTS = {"device_kernels_estimate_hand", "mechanism_kernels_energy_kernels_judge"}


def same(one, other):
    """Return whether numbers are the same but for a rounding of NumPy's sine, if any."""
    largest = np.max(np.abs(other), initial=0.0, where=np.isfinite(other))
    return np.allclose(one, other, rtol=0.0, atol=1e-13 * largest, equal_nan=True)


def numbers_of(one):
    """Return the numbers of a record or structure; anything else as it is."""
    return one if isinstance(one, np.ndarray) else getattr(one, "values", getattr(one, "data", one))


def recorded(function_of, calls, apart, ever):
    """Return what finds kernels as ``function_of`` does, and compares some of their calls."""

    def found(name, signature, function, waits=False, gathered=False):
        compiled = function_of(name, signature, function, waits, gathered)

        def called(*given):
            calls[name] += 1
            ever.add(name)
            if calls["inside"]:
                return function(*given)
            if calls[name] not in LOOKED_AT:
                return compiled(*given)
            arrays = list(given[0]) if gathered else list(given)
            own = copy.deepcopy(arrays)
            result, calls["inside"] = compiled(*given), 1
            with np.errstate(all="ignore"):
                expected = function(*own)
            calls["inside"] = 0
            pairs = [
                (numbers_of(one), numbers_of(other))
                for one, other in zip((*arrays, result), (*own, expected), strict=True)
            ]
            apart[name] += sum(not same(one, other) for one, other in pairs if one is not None)
            return result

        called.__wrapped__ = function
        return called

    return found


PUSH = np.array([0.3, -0.1, 0.0, 0.0, 0.0, 0.01])


def exercise(calls):
    """Use everything that calls kernels but nodes."""
    from hapticmech_ros import Session, load_scene
    from hapticmech_ros.control import ControlArchitecture
    from hapticmech_ros.device import device_for
    from hapticmech_ros.loading import shipped_scenes
    from hapticmech_ros.scene.controller import Connection
    from hapticmech_ros.session.shared_session import SharedSession

    class Own(ControlArchitecture):
        def answer(self, *given):
            return super().answer(*given)

    late = {"connection": Connection(delay=0.005, jitter=0.3, loss=0.1, seed=3)}
    for name in shipped_scenes():
        calls.clear()
        session = Session(load_scene(name))
        for number in range(1, 61):
            session.run(20 if number in LOOKED_AT else 150)
    calls.clear()
    SharedSession(load_scene("two_users")).run(300)
    for name in ("five_bar", "spatial_arm", "shared_payload"):
        calls.clear()
        scene = load_scene(name)
        late["device"] = scene.device.model_copy(update={"force_sensor": "estimated"})
        for one in (scene, scene.model_copy(update=late)):
            law = device_for(one, law=lambda *_: PUSH)
            session = Session(one, control=Own(one), device=law)
            for _ in range(70):
                session.tick()
            for control in (Own(one), ControlArchitecture(one)):
                use_parts(one, control)


def use_parts(scene, control):
    """Use parts of a graph as its nodes do, and what only answers when asked."""
    import pinocchio as pin

    from hapticmech_ros.control.account_kernels import change_of_mean, remember, respond
    from hapticmech_ros.control.clutch import engage
    from hapticmech_ros.control.kernels import hand_on_mechanism
    from hapticmech_ros.control.loop_layout import ControllerSettings, HandMemory, MeanChange
    from hapticmech_ros.control.passivity import DeviceSide, corrected
    from hapticmech_ros.control.rendering_controller import ControllerInput, RenderingController
    from hapticmech_ros.device import device_for
    from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
    from hapticmech_ros.operational import Analyser
    from hapticmech_ros.operational.analysis import contact_wrench
    from hapticmech_ros.operational.observation import ConstraintCounter
    from hapticmech_ros.simulation import Simulator
    from hapticmech_ros.wire.kernels import sound_stamp

    simulator, body = Simulator(scene), device_for(scene)
    side, device = RenderingController(control, 1e-3, scene.connection, 2), DeviceSide(scene)
    analyser, counter = Analyser(simulator.mechanism), ConstraintCounter(scene.perception)
    here, memory = pin.SE3.Identity(), HandMemory()
    clutch, moving = engage(0.0, here, here), simulator.initial_state()
    state = held = body.at_rest(here, held=True)
    for tick in range(8):
        time = 1e-3 * tick
        state = body.step(state, PUSH, held, tick, PUSH)
        moving = simulator.step(moving, np.zeros((len(simulator.mechanism.point_names), 6)))
        terms = simulator.evaluate(moving)
        terms.space.size(moving.v)
        assert np.isfinite(terms.closing.potential_energy)
        terms.acceleration(moving.v)
        contact_wrench(analyser, terms, np.ones(moving.v.size))
        model = analyser.observe(moving.q, moving.v, moving.active).model.copy()
        counter.update(model[:6], time)
        sample = state.published[:19]
        inputs = ControllerInput(time, round(1e9 * time), sample, model, 0, 1_000_000)
        answer = side.tick(inputs, clutch, corrects=True)
        settings = ControllerSettings(control.settings_at(time, clutch))
        seen = OperationalModelSample(model)
        hand_on_mechanism(settings, DeviceSample(sample), seen, time, np.empty(6))
        respond(settings, seen, time, np.empty((6, 6)))
        remember(memory, 1e-3, PUSH)
        change_of_mean(memory, 0.0, 1e-3, MeanChange())
        command = PUSH
        if answer is not None:
            model, answered = answer.numbers.model.values, answer.numbers.sample.values
            command = corrected(PUSH, model, answered, sample, memory.values, 1e-3)
        device.allow(command, sample, state.applied, 0.01 * tick)
        assert np.isfinite(device.passivity.available)
    sound_stamp(np.ones(27), np.full(27, 10.0), 5, 1e-6)


def main():
    from hapticmech_ros.compilation import decorators, library

    calls, apart, ever = Counter(), Counter(), set()
    decorators.function_of = recorded(decorators.function_of, calls, apart, ever)
    exercise(calls)
    names = [one for one in library.library().addresses if not one.startswith(OF_NODES)]
    report = {"apart": {one: apart[one] for one in names if apart[one]}}
    print(json.dumps(report | {"never": sorted({*names} - ever - AS_PARTS)}))


def test_compiled_and_uncompiled_are_the_same():
    done = subprocess.run(
        [sys.executable, __file__], check=False, capture_output=True, text=True, timeout=300.0
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found == {"apart": {}, "never": []}


if __name__ == "__main__":
    main()
