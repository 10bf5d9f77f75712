# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many ticks in a call: the same numbers as one by one; and what is written in Python."""

from contextlib import suppress

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis.scene_variants import with_loop
from hapticmech_ros.control import ControlArchitecture, control_for
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.control.measurements import device_of, point_ahead
from hapticmech_ros.device import NO_WRENCH, DeviceState, ImpedanceDevice, device_for
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.numerics.saturation import limited
from hapticmech_ros.scene.controller import Connection
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.session.sample import CONTROL
from hapticmech_ros.simulation import Simulator
from oracles.devices import law_of
from oracles.running import varied

PUSH = np.array([0.4, -0.2, 0.1, 0.0, 0.01, 0.02])
UNEVEN = Connection(delay=0.004, jitter=0.5, loss=0.1, seed=2)
# What a row has from a sample of a tick.
FIELDS = {
    "time": lambda sample: sample.time,
    "q": lambda sample: sample.mechanism.q,
    "v": lambda sample: sample.mechanism.v,
    "device_position": lambda sample: sample.device.published[:3],
    "device_twist": lambda sample: sample.device.measured_twist,
    "device_hand_wrench": lambda sample: sample.hand_wrench,
    "device_applied": lambda sample: sample.device.applied,
    "device_true_position": lambda sample: sample.device.pose.translation,
    "device_true_rotation": lambda sample: sample.device.pose.rotation.ravel(),
    "device_true_twist": lambda sample: sample.device.twist,
    "s": lambda sample: sample.seen.model[:6],
    "inverse_inertia": lambda sample: sample.model.inverse_inertia.ravel(),
    "contact": lambda sample: sample.external_wrench + sample.contact_wrench,
    "device_command": lambda sample: sample.output.device,
    "mechanism_command": lambda sample: sample.output.mechanism,
    "impedance": lambda sample: sample.output.impedance,
    "joint_constraint": lambda sample: sample.output.joint_constraint,
    "four_channel": lambda sample: sample.output.four_channel,
    "pose_error": lambda sample: sample.output.error,
    "on_hand": lambda sample: sample.acting[0],
    "on_mechanism": lambda sample: sample.acting[1],
    "external": lambda sample: sample.external_wrench,
    "count": lambda sample: sample.count,
}


def rows_of(samples):
    return {name: np.array([read(sample) for sample in samples]) for name, read in FIELDS.items()}


def same(run, samples):
    for name, expected in rows_of(samples).items():
        assert np.array_equal(run[name], expected), name


def connected(name):
    return load_scene(name).model_copy(update={"connection": UNEVEN})


@pytest.mark.parametrize(
    "scene",
    [
        *map(load_scene, ("five_bar", "spatial_arm", "stewart_platform", "crane")),
        *map(load_scene, ("door", "peg_in_hole")),
        # A loop that latches on the way, and one whose steps are led past a singular position.
        load_scene("four_bar_closing"),
        load_scene("scissor_lift"),
        connected("two_link"),
    ],
    ids=lambda scene: scene.name,
)
def test_a_run_is_its_ticks_to_the_bit(scene):
    one, many = Session(scene), Session(scene)
    ticks = 900
    rng = np.random.default_rng(3)
    pushes = 0.2 * rng.normal(size=(ticks, 6)) * np.array([1, 1, 1, 0.01, 0.01, 0.01])
    samples = [one.tick(0.1 * push, push) for push in pushes]
    run = many.run(ticks, 0.1 * pushes, pushes)
    same(run, samples)
    assert many.time == one.time
    assert many.energies.values.tolist() == one.energies.values.tolist()
    assert np.array_equal(many.mechanism.q, one.mechanism.q)
    assert many.mechanism.account == one.mechanism.account
    assert np.array_equal(many.device.published, one.device.published)


@pytest.mark.parametrize("name", ["crane", "peg_in_hole"])
def test_contacts_of_a_session_are_those_of_the_simulator(name):
    """To the bit, energies included, also where the kernel gives a step back to be done again."""
    scene = load_scene(name)
    session, simulator = Session(scene), Simulator(scene)
    state, touched, index = simulator.initial_state(), 0, 0
    wrenches = np.zeros((len(scene.operational_points), 6))
    for _ in range(25):
        run = session.run(100)
        for acting, external in zip(run["on_mechanism"], run["external"], strict=True):
            wrenches[index] = acting + external
            state = simulator.step(state, wrenches)
            touched += state.touching.pairs.size > 0
        left = session.mechanism
        assert np.array_equal(left.q, state.q)
        assert np.array_equal(left.v, state.v)
        assert left.account == state.account
        assert left.touching.sweeps == state.touching.sweeps
        for part in ("pairs", "points", "normals", "depths", "forces", "origins", "joint_force"):
            assert np.array_equal(getattr(left.touching, part), getattr(state.touching, part)), part
    assert touched > 100


def test_grasps_gains_and_closures_change_between_runs_as_between_ticks():
    one, many = (Session(load_scene("four_bar_closing")) for _ in range(2))
    softer = one.scene.controller.model_copy(update={"gain_ramp": 0.05})
    link = one.scene.operational_points[0].link
    name = one.scene.closures[0].name
    changes = (
        lambda session: session.set_operational_point(link, Origin(xyz=(0.01, 0.0, 0.0))),
        lambda session: session.tune(softer),
        lambda session: session.mechanism.active[0] and session.switch_closure(name, False),
    )
    for change in changes:
        samples = [one.tick(hand_wrench=PUSH) for _ in range(300)]
        same(many.run(300, hand_wrench=PUSH), samples)
        for session in (one, many):
            change(session)
    assert many.mechanism.active == one.mechanism.active


def test_rows_are_as_far_apart_as_asked_whatever_the_calls():
    scene = load_scene("five_bar")
    whole = Session(scene).run(100)
    session = Session(scene)
    parts = [session.run(ticks, every=7) for ticks in (10, 0, 25, 65)]
    assert [len(part) for part in parts] == [2, 0, 3, 10]
    assert np.array_equal(np.vstack([part.rows for part in parts]), whole.rows[::7])


def test_long_runs_are_shown_by_and_by_and_fill_a_file(tmp_path):
    scene = load_scene("five_bar")
    whole, shown = Session(scene).run(230, every=2), []
    last = Session(scene).run(
        230, every=2, show=lambda part: shown.append(part.rows.copy()), chunk=50
    )
    assert [len(rows) for rows in shown] == [25, 25, 25, 25, 15]
    assert np.array_equal(np.vstack(shown), whole.rows)
    assert np.array_equal(last.rows, shown[-1])
    session = Session(scene)
    shape = (115, session.layout.size)
    file = np.memmap(tmp_path / "run", dtype=np.float64, mode="w+", shape=shape)
    counted = []
    run = session.run(
        230, every=2, into=file, show=lambda part: counted.append(len(part)), chunk=50
    )
    file.flush()
    assert counted == [25, 25, 25, 25, 15]
    assert np.array_equal(np.fromfile(tmp_path / "run").reshape(shape), whole.rows)
    assert np.shares_memory(run.rows, file)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"ticks": -1}, r"ticks: must be a whole number, 0 or more \(got -1\)"),
        ({"ticks": 1.5}, r"ticks: must be a whole number, 0 or more \(got 1.5\)"),
        ({"every": 0}, r"every: must be a whole number, 1 or more \(got 0\)"),
        ({"chunk": 0}, r"chunk: must be a whole number, 1 or more \(got 0\)"),
        ({"hand_wrench": np.zeros((9, 6))}, r"hand_wrench: must be \(6,\) or \(10, 6\)"),
        ({"external_wrench": np.zeros(3)}, r"external_wrench: must be \(6,\) or \(10, 6\)"),
        ({"into": np.zeros((9, 5))}, r"into: must be \(10 or more, \d+\) of float64"),
    ],
)
def test_what_cannot_be_run_is_refused_and_nothing_has_moved(given, words):
    session = Session(load_scene("two_link"))
    with pytest.raises(InvalidInputError, match=words):
        session.run(**({"ticks": 10} | given))
    assert session.time == 0.0


@pytest.mark.parametrize("name", ["external_wrench", "hand_wrench"])
@pytest.mark.parametrize("given", [1.0, np.zeros(3), np.zeros((1, 6))])
def test_a_tick_takes_wrenches_of_six_numbers_only(name, given):
    session = Session(load_scene("two_link"))
    with pytest.raises(InvalidInputError, match=rf"shape of {name}: must be \(6,\)"):
        session.tick(**{name: given})
    assert session.time == 0.0


def test_an_unknown_field_names_those_that_there_are():
    with pytest.raises(KeyError, match="must be one of time, q, v"):
        Session(load_scene("two_link")).run(1)["speed"]


class Same(ControlArchitecture):
    """A control law of one's own that is the scene's."""

    def answer(self, time, clutch, device, operational_model, ahead, in_flight=None):
        return super().answer(time, clutch, device, operational_model, ahead, in_flight)


class Halved(ControlArchitecture):
    """A control law of one's own: the scene's, with half the wrench on the hand."""

    def answer(self, time, clutch, device, operational_model, ahead, in_flight=None):
        found = super().answer(time, clutch, device, operational_model, ahead, in_flight)
        found[0] *= 0.5
        return found


@pytest.mark.parametrize("scene", [load_scene("five_bar"), connected("five_bar")])
def test_a_control_law_in_python_takes_the_place_of_the_scenes(scene):
    given, own = Session(scene), Session(scene, control=Same(scene))
    expected, run = given.run(400, hand_wrench=PUSH), own.run(400, hand_wrench=PUSH)
    assert np.abs(run["on_hand"] - expected["on_hand"]).max() < 1e-9
    assert np.abs(run["q"] - expected["q"]).max() < 1e-12
    # Nothing but the wrench itself differs in the second tick: the first one's is zero.
    halved = Session(scene, control=Halved(scene)).run(2, hand_wrench=PUSH)
    second = halved["device_command"][1]
    assert np.array_equal(second, 0.5 * run["device_command"][1])


def test_a_law_of_ones_own_is_asked_for_each_sample_with_the_gains_of_the_time():
    """And what it was given it may not change: the session goes on with its own numbers."""
    scene, seen = load_scene("two_link"), []

    class Own(ControlArchitecture):
        def answer(self, time, clutch, device, operational_model, ahead, in_flight=None):
            self.apply_gains_at(time)
            seen.append((time, self.gains.position_channel.stiffness))
            device[:] = operational_model[:] = 0.0
            return np.zeros((6, 6))

    session = Session(scene, control=Own(scene))
    first = session.run(20, hand_wrench=PUSH)
    assert [time for time, _ in seen] == pytest.approx(first["time"])
    assert not any(first[name].any() for name in (*CONTROL, "pose_error"))
    assert first["device_hand_wrench"].any()
    assert first["inverse_inertia"].any()
    stiffness = {"stiffness": 50.0}
    session.tune(varied(scene.controller, position_channel=stiffness, gain_ramp=0))
    session.run(2)
    assert seen[-1][1] == 50.0 != seen[0][1]


class Spring(ControlArchitecture):
    """A spring and damper between device and operational point, all by hand."""

    STIFFNESS, DAMPING = np.array([200.0] * 3 + [1.0] * 3), np.array([4.0] * 3 + [0.01] * 3)

    def answer(self, time, clutch, device, operational_model, ahead, in_flight=None):
        own, point = device_of(device), point_ahead(operational_model, ahead, in_flight)
        error = self.task * pose_error(point.pose, clutch.mapped(own.pose))
        rate = self.task * (own.twist - point.twist)
        pull = clutch.ramp(time) * (self.STIFFNESS * error + self.DAMPING * rate)
        wrenches = np.zeros((6, 6))
        wrenches[0] = self.joined(time, clutch, limited(-pull, *self.limits))
        wrenches[1] = limited(pull, *self.limits)
        wrenches[5] = error
        return wrenches


@pytest.mark.parametrize("scene", [load_scene("five_bar"), connected("five_bar")])
def test_a_law_as_a_function_is_the_subclass_of_the_same_law(scene):
    """In a scene whose device closes nothing by itself, and in one where the law sees to that."""

    def law(seen):
        pull = Spring.STIFFNESS * seen.error + Spring.DAMPING * seen.rate
        return -pull, pull

    expected = Session(with_loop(scene, False), control=Spring(with_loop(scene, False)))
    own = Session(scene, control=control_for(scene, law))
    expected, run = expected.run(400, hand_wrench=PUSH), own.run(400, hand_wrench=PUSH)
    for name in ("on_hand", "on_mechanism", "q", "pose_error", "stored"):
        assert np.abs(run[name] - expected[name]).max() < 1e-12, name
    assert np.abs(run["on_hand"]).max() > 0.01


def test_a_law_s_wrenches_are_limited_and_what_is_none_is_refused():
    scene = load_scene("two_link")
    seen, given = [], [(np.full(6, 1e6), np.full(6, -1e6))]

    def law(one):
        seen.append(one)
        return given[0]

    session = Session(scene, control=control_for(scene, law))
    run = session.run(600)
    commands = run["mechanism_command"]
    limit, most = scene.device.force_limit, np.linalg.norm(commands[:, :3], axis=1)
    assert np.abs(most[-1] / limit - 1.0) < 1e-12
    # In the plane, and not at once.
    assert not commands[:, 2:5].any()
    assert most[0] == 0.0
    assert seen[0].model.inverse_inertia.shape == (6, 6)
    assert np.array_equal(seen[0].error[2:5], np.zeros(3))
    for wrong in ((np.zeros(6), np.full(6, np.nan)), np.zeros(6), (np.zeros(3), np.zeros(3))):
        given[0] = wrong
        begun = session.time
        with pytest.raises(InvalidInputError, match="two finite wrenches"):
            session.tick()
        assert session.time == begun


def own_hand(scene, calls):
    """Return the scene's device, and its hand's law as one of one's own."""
    law = law_of(scene.hand)

    def own_law(elapsed, pose, twist, held):
        calls.append(elapsed)
        return law(elapsed, pose, twist, held)

    return device_for(scene, law=own_law)


class Lent:
    """A device of one's own: nothing but what a session asks of it, around a scene's."""

    def __init__(self, scene):
        self._device = device_for(scene)
        self.at_rest, self.step = self._device.at_rest, self._device.step
        self.compensation, self.sensed = self._device.compensation, self._device.sensed


@pytest.mark.parametrize(
    "scene", [*map(load_scene, ("five_bar", "spatial_arm")), connected("spatial_arm")]
)
def test_hands_and_devices_in_python_take_the_place_of_the_scenes(scene):
    calls = []
    expected = Session(scene).run(400, hand_wrench=PUSH)
    for device in (own_hand(scene, calls), Lent(scene)):
        session = Session(scene, device=device)
        run = session.run(400, hand_wrench=PUSH)
        assert np.abs(run["device_position"] - expected["device_position"]).max() < 1e-12
        assert np.abs(run["on_hand"] - expected["on_hand"]).max() < 1e-9
        assert session.compensation.shape == (6,)
    # Once in every substep, and at the end of every period, from the hand's start on.
    held = 400 - round(scene.hand.start_delay / scene.simulation.period)
    assert len(calls) >= held * (scene.device.substeps + 1)


class Doubled(ImpedanceDevice):
    """A scene's device that obeys twice the command."""

    def step(self, state, command, held, ticks, push=NO_WRENCH):
        return super().step(state, 2.0 * command, held, ticks, push)


def test_what_a_subclass_of_the_device_does_is_done():
    scene = load_scene("five_bar")
    device = Doubled(scene.device, scene.simulation.period, True, scene.hand)
    run = Session(scene, device=device).run(400)
    moving = run["on_hand"][:-1]
    assert np.abs(moving).max() > 0.1
    assert np.array_equal(run["device_applied"][1:], 2.0 * moving)


def test_states_of_a_device_of_ones_own_are_handed_back_to_it():
    scene = load_scene("two_link")

    class Marked(DeviceState):
        __slots__ = ("mark",)

    class Marking(Lent):
        def __init__(self, scene):
            super().__init__(scene)
            self.at_rest, self.step = self._begin, self._next

        def _begin(self, *arguments, **keys):
            state = Marked(self._device.at_rest(*arguments, **keys).flat)
            state.mark = 0
            return state

        def _next(self, state, *arguments):
            after = Marked(self._device.step(state, *arguments).flat)
            after.mark = state.mark + 1
            return after

    session = Session(scene, device=Marking(scene))
    samples = [session.tick() for _ in range(5)]
    assert [sample.device.mark for sample in samples] == list(range(5))
    assert session.device.mark == 5


def test_the_largest_wrench_moves_all_by_finite_numbers():
    session, most = Session(load_scene("five_bar")), np.full(6, 1e6)
    with suppress(HapticMechError):
        for _ in range(20):
            sample = session.tick(external_wrench=most, hand_wrench=most)
            assert np.isfinite(sample.mechanism.q).all()
            assert np.isfinite(sample.device.flat).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e160, -1.001e6])
@pytest.mark.parametrize("name", ["external_wrench", "hand_wrench"])
def test_wrenches_that_are_no_numbers_are_refused_and_move_nothing(name, bad):
    session, other = Session(load_scene("five_bar")), Session(load_scene("five_bar"))
    session.run(3)
    other.run(3)
    wrench = np.array([0.0, 0.1, 0.0, bad, 0.0, 0.0])
    with pytest.raises(InvalidInputError, match=f"{name}: must be finite numbers"):
        session.tick(**{name: wrench})
    rows = np.zeros((5, 6))
    rows[4] = wrench
    with pytest.raises(InvalidInputError, match=f"{name}: must be finite numbers"):
        session.run(5, **{name: rows})
    assert session.tick().time == other.tick().time
    assert (session.mechanism.q == other.mechanism.q).all()
    assert (session.device.flat == other.device.flat).all()
