# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loop's kernels: what a sample is answered with, and what accounts of energy let through."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.account_kernels import remember
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.loop_layout import HandMemory
from hapticmech_ros.control.measurements import InFlight
from hapticmech_ros.control.passivity import DeviceSide, corrected
from hapticmech_ros.control.rendering_controller import ControllerInput, RenderingController
from hapticmech_ros.device.safety import Reason
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.scene.controller import Connection, Passivity
from oracles.controllers import Account
from oracles.running import varied

PERIOD, PERIOD_NS = 1e-3, 1_000_000
INERTIA = np.array([0.2] * 3 + [4e-4] * 3)
TWIST, PUSH = DeviceSample.layout.slice("twist"), DeviceSample.layout.slice("hand_wrench")
MOVED, CONTACT = (
    OperationalModelSample.layout.slice("twist"),
    OperationalModelSample.layout.slice("contact"),
)


def wrench(rng):
    return rng.normal(size=6) * ([1.0] * 3 + [0.02] * 3)


def sample_of(rng):
    """Return a device's sample (19,) some millimetres and a turn away."""
    turn = pin.Quaternion(pin.exp3(0.4 * rng.normal(size=3)))
    place = *(1e-3 * rng.normal(size=3)), *turn.coeffs()
    return np.array((*place, *(0.05 * rng.normal(size=6)), *wrench(rng)))


def way_of(start, end):
    """Return the way (6,) between two samples."""
    one, other = (pin.XYZQUATToSE3(sample[:7]) for sample in (start, end))
    turn = pin.log3(other.rotation @ one.rotation.T)
    return np.concatenate((other.translation - one.translation, turn))


def model_of(rng):
    """Return an operational model (139,): random, but for a place that is one."""
    model = rng.normal(size=OperationalModelSample.layout.size)
    place = slice(OperationalModelSample.layout.start("position"), MOVED.start)
    model[place] = sample_of(rng)[:7]
    return model


def rendering(delay, slack=0.0):
    scene = load_scene("five_bar")
    control = ControlArchitecture(varied(scene, controller={"passivity": {"slack": slack}}))
    return RenderingController(control, PERIOD, scene.connection, delay)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("time", [0.03, 5.0])
def test_a_sample_is_answered_once_what_is_in_flight_has_acted(delay, time):
    """And half a period of what measured forces command now."""
    side, rng = rendering(delay), np.random.default_rng(3)
    clutch = engage(0.0, pin.SE3.Identity(), pin.SE3.Identity(), 0.04, wrench(rng))
    force, task = side.control.gains.force_channel, side.control.task
    sample, model = sample_of(rng), model_of(rng)
    side.queue[:] = rng.normal(size=(delay, 6))
    commanded = force.hand * sample[PUSH] + force.mechanism_feedback * model[CONTACT]
    now = 0.5 * clutch.force_ramp(time) * task * commanded
    flying = InFlight((delay + 0.5) * PERIOD, PERIOD * (side.queue.sum(axis=0) + now))
    inputs = ControllerInput(time, 7, sample, model, 0, PERIOD_NS)
    for corrects, in_flight in ((True, flying), (False, None)):
        found = side.tick(inputs, clutch, corrects)
        expected = side.control.answer(time, clutch, sample, model, 0.0, in_flight)
        assert np.abs(found.wrenches - expected).max() < 1e-12 * np.abs(expected).max()
        assert np.array_equal(found.numbers.sample.values, sample)
        assert (found.numbers.modelled != 0.0) == corrects


def test_the_mechanism_gets_no_more_than_the_hand_has_put_in():
    rng, limited = np.random.default_rng(4), 0
    side = rendering(0, slack=1e-3)
    here = pin.SE3.Identity()
    clutch, inertia = engage(0.0, here, here), np.diag(side.control.device_inertia)
    gave = got = 0.0
    before = acted = moved = None
    for tick in range(200):
        sample, model = sample_of(rng), model_of(rng)
        model[MOVED] *= 0.01
        inputs = ControllerInput(tick * PERIOD, tick, sample, model, 0, PERIOD_NS)
        answer = side.tick(inputs, clutch, corrects=True)
        if before is not None:
            gave += 0.5 * (before[PUSH] + sample[PUSH]) @ way_of(before, sample)
            got += 0.5 * PERIOD * acted @ (moved + model[MOVED])
        before, moved = sample, model[MOVED]
        assert side.account.from_hand == pytest.approx(gave, abs=1e-12)
        assert side.account.energies.to_mechanism == pytest.approx(got, abs=1e-12)
        assert answer.numbers.to_mechanism == side.account.energies.to_mechanism
        told = answer.wrenches[1]
        sent, acted = side.commanded.copy()
        # Without a delay.
        assert np.array_equal(sent, acted)
        if got - gave > 1e-3 and told @ moved > 0.0:
            limited += 1
            assert abs(sent @ moved) < 1e-12 * np.linalg.norm(told)
            share = (told - sent) / (inertia * moved)
            # A damper's on the device's inertia, against the motion.
            assert share == pytest.approx(np.full(6, share[0]), rel=1e-6)
            assert share[0] > 0.0
        else:
            assert np.array_equal(sent, told)
    assert side.account.changed == limited
    assert 20 < limited < 180


def test_what_is_commanded_acts_later_by_the_delay():
    side, rng = rendering(2), np.random.default_rng(5)
    clutch = engage(0.0, pin.SE3.Identity(), pin.SE3.Identity())
    sent = []
    for tick in range(8):
        side.tick(
            ControllerInput(0.0, tick, sample_of(rng), model_of(rng), 0, PERIOD_NS), clutch, True
        )
        now, acting = side.commanded.copy()
        sent.append(now)
        assert np.array_equal(acting, sent[tick - 2] if tick > 1 else np.zeros(6))
        assert np.array_equal(side.past[: tick + 1], sent[::-1])


def given_by(command, twist, hand, ahead):
    """Return what a held command gives, J, on a body that moves freely for ``ahead`` s."""
    return command @ (ahead * twist + 0.5 * ahead**2 * (command + hand) / INERTIA)


def parabola(function):
    """Return the coefficients of a quadratic function, highest first."""
    start, half, end = (function(share) for share in (0.0, 0.5, 1.0))
    return np.array([2.0 * (start - 2.0 * half + end), 4.0 * half - 3.0 * start - end, start])


def lowest(found):
    """Return where in [0, 1] a convex parabola is lowest."""
    return min(max(-0.5 * found[1] / found[0], 0.0), 1.0) if found[0] > 0.0 else 0.0


def held_to(there, acting, twist, *motion):
    """Return what is left of a command, and whether damping alone was enough of a change."""
    hardest = 0.4 / PERIOD * INERTIA * twist
    damped = parabola(lambda share: given_by(acting - share * hardest, twist, *motion))
    roots = np.roots(damped - (0.0, 0.0, there))
    roots = [root.real for root in roots if abs(root.imag) < 1e-9 and 0.0 < root.real <= 1.0]
    if roots:
        return acting - min(roots) * hardest, True
    least = acting - lowest(damped) * hardest
    shared = parabola(lambda share: given_by(share * least, twist, *motion))
    share = lowest(shared)
    if there > 0.0:
        share = min(max(np.roots(shared - (0.0, 0.0, there)).real), 1.0)
    return share * least, False


@pytest.mark.parametrize("lag", [0.0, 2e-3])
@pytest.mark.parametrize("filtered", [False, True])
def test_commands_are_held_to_what_there_is_by_the_least_damping(lag, filtered):
    """With actuators that lag, and miss a direction; and twists that lag."""
    rng, acts, limits = np.random.default_rng(4), np.array([1.0, 1, 1, 1, 1, 0]), (3.0, 0.1)
    kept = lag / PERIOD * -np.expm1(-PERIOD / lag) if lag else 0.0
    ahead, exact, shortened = PERIOD + lag, 0, 0
    for _ in range(20):
        bounds = Passivity(allowance=10.0 ** rng.uniform(-6, -3), slack=10.0 ** rng.uniform(-4, 0))
        account = Account(bounds, INERTIA, PERIOD, limits, acts, filtered, lag)
        applied, added, before, work, spent = *np.zeros((2, 6)), None, 0.0, 0.0
        account.receive(0.0)
        for _ in range(100):
            sample, command = sample_of(rng), wrench(rng)
            hand, twist = sample[PUSH], sample[TWIST]
            rate, driven = np.zeros(6), applied - added
            if before is not None:
                way = way_of(before, sample)
                work -= driven @ way
                rate = way / PERIOD + 0.5 * PERIOD * (driven + hand) / INERTIA
            account.record(sample, applied)
            before, told = sample, work + 1e-3 * rng.normal()
            account.receive(told)
            least = max(min(0.0, told) - bounds.allowance, told - bounds.slack)
            assert account.actuators == pytest.approx(work, rel=1e-9, abs=1e-12)
            assert account.available == pytest.approx(work - least, rel=1e-9, abs=1e-12)
            added = wrench(rng)
            changed, held = account.changed, account.enforce(command, sample, added)
            acting = np.concatenate(
                [
                    part * min(1.0, most / np.linalg.norm(part))
                    for part, most in zip((acts * command).reshape(2, 3), limits, strict=True)
                ]
            )
            acting += kept * (driven - acting)
            given = given_by(acting, twist, hand, ahead)
            seen, other = twist, given_by(acting, rate, hand, ahead)
            if filtered and other > given:
                seen, given = rate, other
            applied = held
            if given <= account.available:
                assert np.array_equal(held, command)
                continue
            assert account.changed == changed + 1
            left = given_by(held, seen, hand, ahead)
            spent += given - left
            assert account.dissipated == pytest.approx(spent, rel=1e-9, abs=1e-12)
            expected, damped = held_to(account.available, acting, seen, hand, ahead)
            exact, shortened = exact + damped, shortened + (not damped)
            # Roots of a difference lose digits where it is near zero.
            assert held == pytest.approx(expected, rel=1e-7, abs=1e-10)
    assert exact > 20
    assert shortened > 20


class Composed(Session):
    """A session, and the same of its parts, as the nodes of a graph put them together."""

    def __init__(self, scene, delay=1):
        super().__init__(scene, command_delay=delay)
        control = ControlArchitecture(scene)
        self.side = RenderingController(control, self.period, scene.connection, delay)
        self.end, self.hand = DeviceSide(scene), HandMemory().values
        self.end.envelope.place(self.device.published[:3])
        self.waiting, self.arrived, self.ticks, self.most = [None] * delay, None, 0, 0.0

    def tick(self, external_wrench=None, hand_wrench=None):
        added = self.compensation
        sample = super().tick(external_wrench, hand_wrench)
        own = sample.device.published
        seen = np.concatenate((own[:13], sample.hand_wrench))
        stamp = round(self.ticks * self.period * 1e9)
        inputs = ControllerInput(sample.time, stamp, seen, sample.seen.model, 0, PERIOD_NS)
        self.arrived = self.side.tick(inputs, self.clutch, corrects=True) or self.arrived
        self.waiting.append(self.arrived)
        on_mechanism = self.side.commanded[1].copy()
        now, command, told = self.waiting.pop(0), np.zeros(6), None
        remember(HandMemory(self.hand), self.period, seen[PUSH])
        if now is not None:
            command, told = now.wrenches[0], now.numbers.to_mechanism
            if now.numbers.modelled != 0.0:
                numbers = now.numbers
                model = numbers.model.values, numbers.sample.values, seen, self.hand, self.period
                command = corrected(command, *model)
        on_hand = self.end.allow(command, seen, own[19:], told, added)
        assert np.abs(sample.acting - (on_hand, on_mechanism)).max() < 1e-11
        pairs = [
            *zip(self.energies.values, self.side.account.energies.values, strict=True),
            (self.controller.account.from_hand, self.side.account.from_hand),
            (self.passivity.actuators, self.end.passivity.actuators),
            (self.passivity.dissipated, self.end.passivity.dissipated),
        ]
        assert max(abs(one - other) for one, other in pairs) < 1e-13
        assert self.passivity.changed == self.end.passivity.changed
        assert self.envelope.counts == self.end.envelope.counts
        self.ticks, self.most = self.ticks + 1, max(self.most, np.abs(on_hand).max())
        return sample


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize("connection", [{}, {"delay": 0.03, "jitter": 0.3, "loss": 0.1, "seed": 3}])
def test_a_session_is_its_parts_put_together(delay, local, connection):
    gains = {part: {"local": local} for part in ("joint_constraint", "force_channel")}
    gains["passivity"] = {"allowance": 1e-5, "slack": 1e-3}
    scene = varied(load_scene("five_bar"), controller=gains, connection=Connection(**connection))
    session = Composed(scene, delay)
    push = np.array([0.8, -0.3, 0.1, 0.01, 0.0, 0.02])
    for tick in range(500):
        session.tick(hand_wrench=push if tick % 200 < 100 else -push)
    assert session.most > 0.1
    assert local or not connection or session.passivity.changed > 20


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
