# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a user feels beside others: desired impedance by closed forms, and what is refused."""

import json

import numpy as np
import pytest
import yaml

from commands import ran
from hapticmech_ros.analysis import users
from hapticmech_ros.analysis.users import (
    FREQUENCIES_HZ,
    admittances,
    felt_beside_others,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.users import REACH, inverse_inertia, two_points
from sampling import sampled

PERIOD = 0.002
ARM = {"mass": 0.5, "damping": 8.0, "stiffness": 200.0}
TURNING = {"angular_inertia": 5e-4, "angular_damping": 4e-2, "angular_stiffness": 0.2}
MOVES = [{"time": 0.0}, {"time": 0.5, "xyz": [0.1, 0.0, 0.0]}]
HOLDS = {"kind": "arm", "release_at": [1.0], "waypoints": MOVES, **ARM, **TURNING}
GRIP = {"stiffness": 800.0, "damping": 8.0, "angular_stiffness": 0.7, "angular_damping": 7e-3}
FREQUENCIES = np.array(FREQUENCIES_HZ, dtype=float)
S = 2j * np.pi * FREQUENCIES


def document(other, **changes):
    hands = [{"point": "a"}, {"point": "b", "hand": other}]
    return two_points(hands=hands, simulation={"period": PERIOD}, **changes)


def held(grip=None):
    """Return the closed form's admittances (k, 6, 6): of the body, and with the arm at b on it."""
    a, b = np.array([REACH, 0, 0]), np.array([-REACH, 0, 0])
    own, to, back, there = (inverse_inertia(p, q) for p, q in ((a, a), (a, b), (b, a), (b, b)))
    keys = zip(ARM, TURNING, strict=True)
    mass, damping, stiffness = (
        np.diag([ARM[line]] * 3 + [TURNING[turn]] * 3) for line, turn in keys
    )
    moved = []
    for s in S:
        arm = s * mass + damping + stiffness / s
        if grip is not None:
            # Of the grip and of the arm behind it the admittances add up.
            tissue = np.diag([grip["stiffness"]] * 3 + [grip["angular_stiffness"]] * 3) / s
            tissue += np.diag([grip["damping"]] * 3 + [grip["angular_damping"]] * 3)
            arm = np.linalg.inv(np.linalg.inv(arm) + np.linalg.inv(tissue))
        moved.append((own - to @ arm @ np.linalg.solve(s * np.eye(6) + there @ arm, back)) / s)
    return np.array([own / s for s in S]), np.array(moved)


@pytest.mark.parametrize("grip", [None, GRIP])
def test_the_others_arm_is_on_the_body(grip):
    scene = scene_from_document(document({**HOLDS, "grip": grip}))
    alone, with_arm = held(grip)
    for found, wanted in zip(
        admittances(scene, Simulator(scene), "a", FREQUENCIES), (with_arm, alone), strict=True
    ):
        # The simulator's own step and its differences.
        assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6 * np.abs(wanted).max())


@pytest.fixture
def soon_settled(monkeypatch):
    """A free body on arms has no slow motion, as scenes with joint dampers have."""
    monkeypatch.setattr(users, "SETTLING_S", 4.0)


@pytest.fixture
def some_directions(monkeypatch):
    """Of three translations and three rotations of a round body one each."""
    every = users.free_directions
    monkeypatch.setattr(
        users, "free_directions", lambda analysis: sampled(every(analysis), every=3)
    )


@pytest.mark.usefixtures("soon_settled", "some_directions")
def test_what_is_felt_beside_an_arm_behind_its_grip():
    """The arm holds on and stays where it is, whatever it does in the scene."""
    scene = scene_from_document(document({**HOLDS, "grip": GRIP}))
    found = felt_beside_others(scene.with_(simulation={"period": 0.001}), "a")
    assert len(found) == len(sampled(range(6), every=3))
    alone, with_arm = held(GRIP)
    for one in found:
        wanted = np.einsum("i,kij,j->k", one.direction, with_arm, one.direction)
        free = np.einsum("i,kij,j->k", one.direction, alone, one.direction)
        # The simulator's own step and its differences.
        assert one.desired * wanted == pytest.approx(np.ones(len(S)), abs=1e-6)
        assert one.alone * free == pytest.approx(np.ones(len(S)), abs=1e-6)
        assert one.share == pytest.approx(np.abs(free / wanted - 1.0), rel=1e-3, abs=1e-3)
        assert one.error(10.0) < 0.01


@pytest.mark.usefixtures("some_directions")
def test_a_device_that_nobody_holds_is_nothing_to_feel(monkeypatch):
    """But for half a period of what is lighter than the device, which it does not carry on."""
    # What joins the other's device to its point is all that has to settle.
    monkeypatch.setattr(users, "SETTLING_S", 0.5)
    scene = scene_from_document(document({"kind": "constant_wrench", "force": [1.0, 0.0, 0.0]}))
    for one in felt_beside_others(scene.with_(simulation={"period": 0.001}), "a"):
        assert one.share == pytest.approx(np.zeros(len(S)), abs=1e-12)
        assert one.error(10.0) < np.pi * 10.0 * 0.001


@pytest.mark.parametrize(
    ("changes", "point", "rule"),
    [
        ({}, "c", r"must be one of several.*'c'"),
        ({"hands": [{"point": "a"}]}, "a", "must be one of several points"),
        ({"simulation": {"period": 0.01}}, "a", r"simulation\.period"),
    ],
)
def test_what_cannot_be_measured_is_refused(changes, point, rule):
    with pytest.raises(InvalidInputError, match=rule):
        felt_beside_others(scene_from_document(document(HOLDS)).with_(**changes), point)


def test_a_hand_that_is_no_arm_cannot_be_measured(tmp_path):
    (tmp_path / "push.csv").write_text("time,fx,fy,fz,tx,ty,tz\n0,1,0,0,0,0,0\n", encoding="utf-8")
    scripted = {"kind": "scripted", "file": str(tmp_path / "push.csv")}
    with pytest.raises(InvalidInputError, match=r"must be an arm.*'scripted'"):
        felt_beside_others(scene_from_document(document(scripted)), "a")


def test_the_command_prints_writes_and_draws(tmp_path, monkeypatch):
    # What it measures is another test's.
    monkeypatch.setattr(users, "SETTLING_S", 0.1)
    path, out = tmp_path / "scene.yaml", tmp_path / "out"
    path.write_text(yaml.safe_dump(document(HOLDS)), encoding="utf-8")
    done = ran("feel", "users", str(path), "--out", str(out))
    assert "two_points" in done
    rows = json.loads((out / "users.json").read_text(encoding="utf-8"))
    assert [row["point"] for row in rows] == ["a"] * 6 + ["b"] * 6
    assert rows[0]["frequencies_hz"] == list(FREQUENCIES)
    assert (out / "users.png").stat().st_size > 10_000
