# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands corrected for other hands: by how much, for which hands, and from which samples."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.other_hands import (
    REMEMBERED,
    OtherHands,
    coupling_gain,
    received_directly,
)
from hapticmech_ros.control.other_hands_kernels import FARTHEST, SILENT
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.scene import scene_from_document
from oracles.users import two_points

PERIOD_NS = 1_000_000
GAIN = {"b": np.diag([2.0, 0.0, 0.0, 0.0, 0.0, 3.0])}


def told(force, ticks, first=0):
    """Return what is known after samples of a force over time (in periods)."""
    others = OtherHands(["b"], PERIOD_NS)
    for tick in range(first, ticks):
        others.measured("b", np.full(6, force(tick)), tick * PERIOD_NS)
    return others


def correction(others, answered, now, gains=GAIN):
    others.couple(gains, round(now * PERIOD_NS))
    found = others.correction(round(answered * PERIOD_NS), round(now * PERIOD_NS))
    assert found[18] == len(gains)
    return found[:18].reshape(3, 6).sum(axis=0)


def test_a_steady_wrench_changes_nothing():
    assert not correction(told(lambda tick: 4.0, 10), 8, 9).any()


@pytest.mark.parametrize(("answered", "now"), [(8, 9), (7, 9), (9, 9)])
def test_a_wrench_that_rises_evenly_is_corrected_to_the_middle_of_the_period(answered, now):
    rate = 0.25
    found = correction(told(lambda tick: 1.0 + rate * tick, 10), answered, now)
    wanted = rate * (now + 0.5 - (answered - 1))
    assert found == pytest.approx(wanted * np.array([2.0, 0.0, 0.0, 0.0, 0.0, 3.0]), rel=1e-12)


def test_samples_that_come_later_are_not_used_and_old_ones_are_carried_on_so_far():
    def rising(tick):
        return float(tick)

    # The device's own newest sample is of time 5: what came after it is the next period's.
    assert correction(told(rising, 10), 4, 5)[0] == pytest.approx(2.0 * 2.5)
    # A hand that is heard a period late, and one that is late by more.
    assert correction(told(rising, 9), 8, 9)[0] == pytest.approx(2.0 * (8 + 1.5 - 7))
    assert correction(told(rising, 7), 8, 9)[0] == pytest.approx(2.0 * (6 + FARTHEST + 0.5 - 6))
    assert not correction(told(rising, 9), 8 + SILENT, 9 + SILENT).any()
    assert not correction(OtherHands(["b"], PERIOD_NS), 8, 9).any()
    assert not correction(told(rising, 10), 8, 9, gains={}).any()


@pytest.mark.parametrize("count", [1, 2, 3, REMEMBERED + 5])
def test_hands_are_carried_on_by_the_parabola_through_their_last_three_samples(count):
    rng = np.random.default_rng(count)
    names = ["a", "b", "c"]
    others = OtherHands(names, PERIOD_NS)
    gains = {name: rng.normal(size=(6, 6)) for name in names[1:]}
    now, answered, expected = 200, 197, np.zeros((3, 6))
    for name in names:
        # One to two periods apart; the last one is up to a period old.
        ticks = now - np.append(0.0, np.cumsum(rng.uniform(1.0, 2.0, count - 1)))[::-1]
        stamps = np.round((ticks - rng.uniform()) * PERIOD_NS)
        wrenches = rng.normal(size=(count, 6))
        for stamp, wrench in zip(stamps.astype(int).tolist(), wrenches, strict=True):
            others.measured(name, wrench, stamp)
        # In periods from now.
        times = stamps / PERIOD_NS - now
        nearest = int(np.abs(times - (answered - 1 - now))[-REMEMBERED:].argmin())
        changes = [wrenches[-1] - wrenches[-REMEMBERED:][nearest]]
        means = [wrenches[-1]]
        for order in (1, 2):
            least = min(order, count - 1)
            through = np.polyfit(times[-least - 1 :], wrenches[-least - 1 :], least)
            whole = [np.polyint(one) for one in through.T]
            means.append(np.array([np.polyval(one, 1.0) - np.polyval(one, 0.0) for one in whole]))
        changes += [means[1] - means[0], means[2] - means[1]]
        if name in gains:
            expected += np.array(changes) @ gains[name].T
    others.couple(gains, 0)
    found = others.correction(answered * PERIOD_NS, now * PERIOD_NS)
    assert found[18] == len(gains)
    assert found[:18].reshape(3, 6) == pytest.approx(expected, rel=1e-9, abs=1e-10)


def test_what_was_overtaken_is_dropped_and_what_is_old_forgotten():
    others = told(float, 10)
    others.measured("b", np.full(6, 100.0), 4 * PERIOD_NS)
    assert correction(others, 8, 9)[0] == pytest.approx(2.0 * 2.5)
    assert others.known_at("b", 9 * PERIOD_NS)
    assert not others.known_at("b", 9 * PERIOD_NS + 1)
    many = told(float, 3 * REMEMBERED)
    # The oldest that is remembered stands for all before it.
    oldest, last = 2 * REMEMBERED, 3 * REMEMBERED - 1
    assert correction(many, 5, last)[0] == pytest.approx(2.0 * (last + 0.5 - oldest))
    others.forget("b")
    assert not others.known_at("b", 0)


def test_a_hand_is_heard_as_long_as_it_is_carried_on():
    others = told(float, 10)
    others.couple(GAIN, 0)
    notes = others.data.notes

    def is_heard(now_ns):
        corrected, uncorrected = notes.corrected, notes.uncorrected
        others.correction(now_ns - PERIOD_NS, now_ns)
        assert notes.corrected + notes.uncorrected == corrected + uncorrected + 1
        return notes.corrected > corrected

    assert not is_heard(-1)
    assert is_heard(5 * PERIOD_NS)
    assert is_heard((9 + SILENT) * PERIOD_NS)
    assert not is_heard((9 + SILENT) * PERIOD_NS + 1)
    others.forget("b")
    assert not is_heard(9 * PERIOD_NS)
    # Where nobody holds, there is nothing to correct for.
    others.couple({}, 0)
    others.correction(8 * PERIOD_NS, 9 * PERIOD_NS)
    assert (notes.corrected, notes.uncorrected) == (2, 3)


def held(*connections, **changes):
    """Return a body held at a, b and, it may be, c, behind these connections."""
    document = two_points(**changes)
    far = document["operational_points"][0] | {"name": "c", "origin": {"xyz": [0.0, 0.05, 0.0]}}
    document["operational_points"].append(far)
    entries = zip("abc", connections, strict=False)
    hands = [{"point": point, "connection": one} for point, one in entries]
    return scene_from_document(document | {"hands": hands})


def test_heard_are_those_with_nothing_between():
    scene = held({}, {}, {"expected": 0.01})
    assert received_directly(scene, "a", "abc") == {"b": 1.0}
    assert received_directly(scene, "c", "abc") == {}
    assert received_directly(held({}, {"delay": 0.01}), "a", "ab") == {}
    assert received_directly(held({}, {"loss": 0.1}), "a", "ab") == {}
    half = {"force_channel": {"hand": 0.5}}
    assert received_directly(held({}, {}, controller=half), "a", "ab") == {"b": 0.5}
    remote = {"force_channel": {"local": False}}
    assert received_directly(held({}, {}, controller=remote), "a", "ab") == {}


@pytest.mark.parametrize("name", ["five_bar", "door", "spatial_arm", "ur5e"])
def test_the_gain_is_how_a_command_changes_with_the_contact_wrench(name):
    """By differences of the compiled control itself, along every axis of F_c."""
    far = dict.fromkeys(("force_limit", "torque_limit"), 1e12)
    scene = load_scene(name)
    scene = scene.with_(
        device=scene.device.model_dump() | far,
        controller={"force_channel": {"contact": 0.7}, "engagement_ramp": 0.2},
    )
    session, control = Session(scene), ControlArchitecture(scene)
    for _ in range(150):
        sample = session.tick()
    device, model = sample.device.published[:19].copy(), session._parts.observation.copy()
    model = model[: OperationalModelSample.layout.size]
    clutch, contact = session.clutch, OperationalModelSample.layout.start("contact")
    # While the clutch is still closing, and later.
    for time in (sample.time - 0.05, sample.time + 1.0):
        settings = control.settings_at(time, clutch)
        wanted = np.empty((6, 6))
        for axis in range(6):
            found = []
            for change in (-0.5, 0.5):
                moved = model.copy()
                moved[contact + axis] += change
                found.append(control.answer(time, clutch, device, moved, 0.0)[0])
            wanted[:, axis] = found[1] - found[0]
        assert np.abs(wanted).max() > 0.01
        share = np.random.default_rng(3).normal(size=(6, 6))
        gain = coupling_gain(settings, model, time, share, 0.5)
        assert gain == pytest.approx(0.5 * wanted @ share, abs=1e-11 * np.abs(wanted).max())
