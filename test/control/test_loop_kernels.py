# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loop's kernels do what readable implementations do, to rounding: every wrench and account."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.kernels import displacement
from hapticmech_ros.control.passivity import DeviceSide, PassivityController
from hapticmech_ros.device.safety import Reason
from hapticmech_ros.scene.controller import Connection, Passivity
from hapticmech_ros.scene.mechanism import Origin
from oracles.local_model import displacement as readable_displacement
from oracles.passivity import PassivityController as ReadablePassivity
from oracles.rendering_loop import RenderingLoop as ReadableLoop

# Of wrenches of some N and N m, and energies of some mJ: sums in another order.
APART, ENERGY_APART = 1e-11, 1e-13
PUSH = np.array([0.8, -0.3, 0.1, 0.01, 0.0, 0.02])


class Compared(Session):
    """A session, and the readable loop, given the same."""

    def __init__(self, scene, delay=1):
        super().__init__(scene, command_delay=delay)
        self.readable = ReadableLoop(scene, ControlArchitecture(scene), delay)
        self.readable.envelope.place(self.device.published[:3])
        self.ticks, self.most, self.apart, self.energies_apart = 0, 0.0, 0.0, 0.0

    def set_operational_point(self, frame, origin=None):
        super().set_operational_point(frame, origin)
        self.readable.side.held_elsewhere()

    def tune(self, gains):
        super().tune(gains)
        self.readable.side.control.tune(self.time, gains)

    def tick(self, external_wrench=None, hand_wrench=None):
        added = self.compensation
        sample = super().tick(external_wrench, hand_wrench)
        readable, own = self.readable, sample.device.published
        measured = np.concatenate((own[:13], sample.hand_wrench))
        expected = readable.tick(
            sample.time, self.clutch, measured, own[19:], sample.seen.model, added
        )
        apart = np.abs(sample.acting - np.array(expected)).max()
        rows = np.abs(sample.wrenches - readable.output.rows()).max()
        self.apart = max(self.apart, rows, apart)
        self.most = max(self.most, np.abs(sample.acting[0]).max())
        pairs = [
            *zip(self.energies, readable.side.ledger.entry, strict=True),
            (self.controller.from_hand, readable.side.port.from_hand),
            (self.passivity.actuators, readable.passivity.actuators),
            (self.passivity.dissipated, readable.passivity.dissipated),
        ]
        self.energies_apart = max(self.energies_apart, *(abs(a - b) for a, b in pairs))
        assert self.passivity.changed == readable.passivity.changed
        assert self.controller.changed == readable.side.port.changed
        assert self.envelope.counts == readable.envelope.counts
        assert self.passivity.mechanism is None or readable.passivity.mechanism is not None
        self.ticks += 1
        return sample


def with_controller(scene, **parts):
    old = scene.controller
    changed = {name: getattr(old, name).model_copy(update=to) for name, to in parts.items()}
    return scene.model_copy(update={"controller": old.model_copy(update=changed)})


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("name", ["five_bar", "door", "spatial_arm", "shared_payload"])
def test_every_wrench_and_energy_is_that_of_the_readable_loop(name, delay):
    session = Compared(load_scene(name), delay)
    for tick in range(600):
        session.tick(hand_wrench=PUSH if tick > 300 else None)
    assert session.ticks == 600
    assert session.most > 0.1
    assert session.apart < APART
    assert session.energies_apart < ENERGY_APART


@pytest.mark.parametrize("force", [True, False])
@pytest.mark.parametrize("joint", [True, False])
def test_whatever_the_device_closes(force, joint):
    local = {"force_channel": {"local": force}, "joint_constraint": {"local": joint}}
    session = Compared(with_controller(load_scene("five_bar"), **local), 2)
    for _ in range(400):
        session.tick(hand_wrench=PUSH)
    assert session.apart < APART
    assert session.energies_apart < ENERGY_APART


@pytest.mark.parametrize("slack", [0.0, 1e-3])
def test_over_a_connection_where_passivity_control_acts(slack):
    scene = with_controller(
        load_scene("five_bar"),
        force_channel={"local": False},
        joint_constraint={"local": False},
        passivity={"allowance": 1e-5, "slack": slack},
    )
    connection = Connection(delay=0.03, jitter=0.3, loss=0.1, seed=3)
    session = Compared(scene.model_copy(update={"connection": connection}))
    for tick in range(800):
        session.tick(hand_wrench=PUSH if tick % 200 < 100 else -PUSH)
    assert session.passivity.changed > 20
    assert session.apart < APART
    assert session.energies_apart < ENERGY_APART


def test_while_the_grasp_passes_and_gains_change():
    session = Compared(load_scene("five_bar"))
    for _ in range(200):
        session.tick(hand_wrench=PUSH)
    link = session.simulator.scene.operational_points[0].link
    session.set_operational_point(link, Origin(xyz=(0.01, 0.02, 0.0)))
    for _ in range(100):
        session.tick(hand_wrench=PUSH)
    softer = with_controller(session.scene, joint_constraint={"stiffness": 200.0}).controller
    session.tune(softer)
    for _ in range(500):
        session.tick(hand_wrench=PUSH)
    assert session.apart < APART
    assert session.energies_apart < ENERGY_APART


@pytest.mark.parametrize("lag", [0.0, 2e-3])
@pytest.mark.parametrize("filtered", [False, True])
def test_commands_are_held_as_by_the_readable_account(lag, filtered):
    rng = np.random.default_rng(4)
    inertia, acts = np.array([0.2] * 3 + [4e-4] * 3), np.array([1.0, 1, 1, 1, 1, 0])
    changed = 0
    for _ in range(20):
        bounds = Passivity(allowance=10.0 ** rng.uniform(-6, -3), slack=10.0 ** rng.uniform(-4, 0))
        constants = (bounds, inertia, 1e-3, (3.0, 0.1), acts, filtered, lag)
        found, expected = PassivityController(*constants), ReadablePassivity(*constants)
        applied = np.zeros(6)
        for _ in range(100):
            turn = rng.normal(size=4)
            place = (*(1e-3 * rng.normal(size=3)), *(turn / np.linalg.norm(turn)))
            sample = np.array((*place, *rng.normal(size=6), *rng.normal(size=6)))
            sample[10:] *= 0.01
            told = None if rng.uniform() < 0.05 else 1e-3 * rng.normal()
            command, added = (rng.normal(size=6) * ([1.0] * 3 + [0.02] * 3) for _ in range(2))
            for account in (found, expected):
                account.record(sample, applied)
                account.set_mechanism_energy(told)
            assert found.available == pytest.approx(expected.available, rel=1e-12)
            one, two = (account.enforce(command, sample, added) for account in (found, expected))
            # Roots of a difference lose digits where it is near zero.
            assert one == pytest.approx(two, rel=1e-7, abs=1e-10)
            applied = one
        assert found.changed == expected.changed
        assert found.hand(sample) == pytest.approx(expected.hand(sample), rel=1e-9)
        changed += found.changed
    assert changed > 100


def test_displacements_are_the_readable_ones():
    rng, way = np.random.default_rng(2), np.empty(6)
    for _ in range(200):
        start, end = rng.normal(size=(2, 7))
        for pose in (start, end):
            pose[3:] /= np.linalg.norm(pose[3:])
        displacement(start, end, way)
        assert way == pytest.approx(readable_displacement(start, end), rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_what_passivity_control_makes_of_a_sample_that_is_none_does_not_leave(bad):
    """The safety envelope comes before it, and looks at what it changed once more."""
    scene = load_scene("five_bar")
    side = DeviceSide(scene)
    sample, command = np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    sample[6] = 1.0
    for _ in range(200):
        side.allow(command, sample, np.zeros(6), 0.0)
    sample[7:13] = bad
    for _ in range(3):
        left = side.allow(command, sample, np.zeros(6), 0.0)
        assert np.isfinite(left).all()
        assert np.linalg.norm(left[:3]) <= scene.device.force_limit
    assert side.envelope.counts[Reason.NOT_FINITE] > 0 or bad == 1e300
