# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shipped five-bar as people would bring it: URDF, MJCF, SDF, and scene files beside them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from hapticmech_ros import load_scene
from hapticmech_ros.simulation import Simulator

BARS = ((1.0, 0.0225, 0.0021), (1.0, 0.0225, 0.0021), (1.0, 0.0225, 0.0021), (0.5, 0.03, 0.00105))
ENDS = (0.0, 0.045, 0.045, 0.045)
# Closed to rounding, as files say it that draw the linkage there.
START = tuple(Simulator(load_scene("five_bar")).initial_state().q.tolist())
REST = """
format: hapticmech-scene/1
name: five_bar
task_space: planar
gravity: [0.0, 0.0, 0.0]
operational_points:
  - {name: handle, link: link2, origin: {xyz: [0.045, 0, 0]}}
simulation: {period: 0.001, integrator: rk4}
"""
PIN = """
closures:
  - name: ground_pin
    kind: planar_pin
    a: {link: link4, origin: {xyz: [0.06, 0, 0]}}
    b: {link: world, origin: {xyz: [0.09, 0, 0]}}
"""


def urdf() -> str:
    parts = ['<robot name="five bar"><link name="base"/>']
    for k, ((mass, com, moment), end) in enumerate(zip(BARS, ENDS, strict=True), start=1):
        parent = f"link{k - 1}" if k > 1 else "base"
        parts.append(
            f"""<link name="link{k}"><inertial><origin xyz="{com} 0 0"/><mass value="{mass}"/>
            <inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/>
            </inertial></link>
            <joint name="joint{k}" type="continuous">
            <parent link="{parent}"/><child link="link{k}"/>
            <origin xyz="{end} 0 0"/><axis xyz="0 0 1"/><dynamics damping="0.005"/></joint>"""
        )
    return "".join([*parts, "</robot>"])


def mjcf() -> str:
    text = ""
    for k in range(4, 0, -1):
        mass, com, moment = BARS[k - 1]
        text = f"""<body name="link{k}" pos="{ENDS[k - 1]} 0 0">
            <joint name="joint{k}" type="hinge" axis="0 0 1"/>
            <inertial mass="{mass}" pos="{com} 0 0" diaginertia="{moment} {moment} {moment}"/>
            {text}</body>"""
    return f"""<mujoco model="five_bar"><compiler angle="radian"/><option gravity="0 0 0"/>
        <default><joint damping="0.005"/></default><worldbody>
        <body name="anchor" pos="0.09 0 0"><site name="pin" pos="0 0 0"/></body>{text}</worldbody>
        <equality><connect name="ground_pin" site1="end" site2="pin"/></equality>
        </mujoco>""".replace(
        '<inertial mass="0.5"', '<site name="end" pos="0.06 0 0"/><inertial mass="0.5"'
    )


def sdf() -> str:
    """Poses are of the closed linkage: in SDF these are where its joints are at zero."""
    parts, at, turned = [], np.zeros(2), 0.0
    for k, ((mass, com, moment), end) in enumerate(zip(BARS, ENDS, strict=True), start=1):
        at = at + end * np.array((np.cos(turned), np.sin(turned)))
        turned += START[k - 1]
        parent = f"link{k - 1}" if k > 1 else "world"
        parts.append(
            f"""<link name="link{k}">
            <pose>{float(at[0])} {float(at[1])} 0 0 0 {float(turned)}</pose>
            <inertial><pose>{com} 0 0 0 0 0</pose><mass>{mass}</mass>
            <inertia><ixx>{moment}</ixx><iyy>{moment}</iyy><izz>{moment}</izz>
            <ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial></link>
            <joint name="joint{k}" type="revolute"><parent>{parent}</parent><child>link{k}</child>
            <axis><xyz>0 0 1</xyz><dynamics><damping>0.005</damping></dynamics></axis></joint>"""
        )
    return f"""<?xml version="1.0"?><sdf version="1.9"><model name="five_bar">{"".join(parts)}
        <link name="post"><pose>0.09 0 0 0 0 0</pose></link>
        <joint name="post_stands" type="fixed"><parent>world</parent><child>post</child></joint>
        <joint name="ground_pin" type="revolute"><parent>link4</parent><child>post</child>
        <axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""


def written(folder: Path, kind: str) -> Path:
    """Write a model and its scene file; return the latter."""
    text = {"urdf": urdf, "xml": mjcf, "sdf": sdf}[kind]()
    (folder / f"five_bar.{kind}").write_text(text)
    scene = folder / f"five_bar_{kind}.yaml"
    pin = PIN if kind == "urdf" else ""
    q = {} if kind == "sdf" else {f"joint{k}": at for k, at in enumerate(START, start=1)}
    start = f"initial_state: {json.dumps({'q': q})}"
    scene.write_text(f"{REST}{pin}{start}\nmodel: five_bar.{kind}\n")
    return scene
