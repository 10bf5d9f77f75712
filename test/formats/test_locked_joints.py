# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joints whose stops leave no travel: locked there, whatever kind of file says it."""

from __future__ import annotations

import numpy as np
import pytest

from formats.imports import saved
from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.formats.reading import read_model

URDF = """<robot name="lock">
<link name="upper"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.0075" izz="0.0075" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.125 0 0"/><mass value="0.6"/>
<inertia ixx="0.0006" iyy="0.0031" izz="0.0031" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="world"/><child link="upper"/>
<axis xyz="0 0 1"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
<limit lower="{at}" upper="{at}" effort="0" velocity="0"/></joint></robot>"""
SDF = """<sdf version="1.7"><model name="lock">
<link name="upper"><inertial><pose>0.15 0 0 0 0 0</pose><mass>1</mass>
<inertia><ixx>0.001</ixx><iyy>0.0075</iyy><izz>0.0075</izz></inertia></inertial></link>
<link name="fore"><pose>0.3 0 0 0 0 0</pose><inertial><pose>0.125 0 0 0 0 0</pose><mass>0.6</mass>
<inertia><ixx>0.0006</ixx><iyy>0.0031</iyy><izz>0.0031</izz></inertia></inertial></link>
<joint name="shoulder" type="revolute"><parent>world</parent><child>upper</child>
<axis><xyz>0 0 1</xyz></axis></joint>
<joint name="elbow" type="revolute"><parent>upper</parent><child>fore</child><axis><xyz>0 0 1</xyz>
<limit><lower>{at}</lower><upper>{at}</upper></limit></axis></joint></model></sdf>"""
MJCF = """<mujoco model="lock"><compiler angle="radian"/><worldbody>
<body name="upper"><joint name="shoulder" axis="0 0 1"/>
<inertial mass="1" pos="0.15 0 0" diaginertia="0.001 0.0075 0.0075"/>
<body name="fore" pos="0.3 0 0"><joint name="elbow" axis="0 0 1" limited="true" range="{at} {at}"/>
<inertial mass="0.6" pos="0.125 0 0" diaginertia="0.0006 0.0031 0.0031"/></body></body>
</worldbody></mujoco>"""


def assert_turns_as_one_body(path, away, error):
    """Check the moment about the shoulder of both bodies in one, the other's centre there (m)."""
    mechanism = Mechanism(load_scene(str(path)))
    assert mechanism.nv == 1
    about_shoulder = 0.0075 + 0.0225 + 0.0031 + 0.6 * (away[0] ** 2 + away[1] ** 2)
    kinetic, _ = mechanism.energy(np.zeros(1), np.ones(1))
    assert 2.0 * kinetic == pytest.approx(about_shoulder, rel=error)
    return about_shoulder


@pytest.mark.parametrize("kind", ["urdf", "sdf", "xml"])
@pytest.mark.parametrize("at", [0.5, 0.0, -1.25])
def test_it_is_one_body_with_what_carries_it(tmp_path, kind, at):
    text = {"urdf": URDF, "sdf": SDF, "xml": MJCF}[kind].format(at=at)
    path = saved(tmp_path, f"lock.{kind}", text)
    note = read_model(path).notes[0]
    assert str(note) == f"joint elbow: lower = upper (1 x): locked at {at:g}"
    away = 0.3 + 0.125 * np.cos(at), 0.125 * np.sin(at)
    assert_turns_as_one_body(path, away, 1e-13)
