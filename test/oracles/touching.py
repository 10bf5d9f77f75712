# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of bodies that touch a floor and each other."""

from __future__ import annotations

from copy import deepcopy

import numpy as np

from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles import running

G = 9.81
FLOOR = {"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}
SHAPES = {
    "sphere": {"kind": "sphere", "radius": 0.05},
    "box": {"kind": "box", "size": [0.1, 0.1, 0.1]},
    "cylinder": {"kind": "cylinder", "radius": 0.05, "length": 0.1},
    "capsule": {"kind": "capsule", "radius": 0.03, "length": 0.04},
}
UPRIGHT = [0.0, 0.0, 0.0, 1.0]


def body(name, mass=1.0, joint="free"):
    """Return a link with the inertia of a cube of 0.1 m."""
    moment = mass * 0.1**2 / 6.0
    inertia = {"ixx": moment, "iyy": moment, "izz": moment}
    return {
        "name": name,
        "joint": {"name": f"of_{name}", "type": joint},
        "inertial": {"mass": mass, "inertia": inertia},
    }


def shape(link, geometry, **more):
    return {"name": f"{link}_shape", "link": link, "geometry": deepcopy(geometry)} | more


def valley():
    """Return two half-spaces that make a V of two slopes of 45°, along x: left and right."""
    return [
        {
            "name": name,
            "link": "world",
            "origin": {"rpy": [sign * np.pi / 4, 0.0, 0.0]},
            "geometry": {"kind": "half_space"},
        }
        for name, sign in (("left", -1.0), ("right", 1.0))
    ]


def pair(a, b="floor", stiffness=1e5, damping=0.0, friction=0.0):
    values = {"stiffness": stiffness, "damping": damping, "friction": friction}
    return {"name": f"{a}_{b}", "a": a, "b": b} | values


def scene(links, shapes, contacts, q=None, v=None, gravity=(0.0, 0.0, -G), **simulation):
    """Return a scene's document; ``q`` and ``v`` by name of the link."""
    return {
        "format": "hapticmech-scene/1",
        "name": "touching",
        "gravity": [float(g) for g in gravity],
        "links": links,
        "operational_points": [{"name": "held", "link": links[0]["name"]}],
        "shapes": shapes,
        "contacts": contacts,
        "initial_state": {
            "q": {f"of_{name}": [float(x) for x in at] for name, at in (q or {}).items()},
            "v": {f"of_{name}": [float(x) for x in at] for name, at in (v or {}).items()},
        },
        "hand": {"kind": "constant_wrench"},
        "simulation": simulation,
    }


def on_floor(kind="box", height=0.05, speed=(0.0, 0.0, 0.0), mass=1.0, law=None, **more):
    """Return the document of one body above the floor."""
    return scene(
        [body("one", mass)],
        [FLOOR, shape("one", SHAPES[kind])],
        [pair("one_shape", **(law or {}))],
        {"one": [0.0, 0.0, height, *UPRIGHT]},
        {"one": [*speed, 0.0, 0.0, 0.0]},
        **more,
    )


def run(document, duration, every=1, wrenches=None):
    """Return the simulator, and the states on the way."""
    sim = Simulator(scene_from_document(document))
    return sim, running.run(sim, duration, wrenches)[::every]


def run_with_energies(document, duration, every=1):
    """Return the simulator, the states on the way, and what is held at each (n,), J."""
    sim, states = run(document, duration, every)
    return sim, states, np.array([held(sim, state) for state in states])


def on_links(sim, before, after):
    """Return what contacts do to links in a step, at their origins, by points and forces alone."""
    links, found, wrenches = {one.name: one.link for one in sim.scene.shapes}, after.touching, {}
    for point, force, index in zip(found.points, found.forces, found.pairs.tolist(), strict=True):
        contact = sim.scene.contacts[index]
        for link, sign in ((links[contact.a], 1.0), (links[contact.b], -1.0)):
            if link != "world":
                arm = point - sim.mechanism.frame_pose(before.q, link).translation
                wrench = sign * np.concatenate((force, np.cross(arm, force)))
                wrenches[link] = wrenches.get(link, np.zeros(6)) + wrench
    return wrenches


def held(sim, state):
    """Return kinetic, potential and contacts' energy, J."""
    return sum(sim.mechanism.energy(state.q, state.v)) + state.account.contact_energy


def rate_of(sim, state, link, place):
    """Return the velocity (3,), m/s, of the point of a link that is at a place (3,), world axes."""
    if link == "world":
        return np.zeros(3)
    mechanism = sim.mechanism
    twist = mechanism.link_jacobian(state.q, link) @ state.v
    arm = place - mechanism.frame_pose(state.q, link).translation
    return np.asarray(twist[:3] + np.cross(twist[3:], arm))


def mean_push(law, depth, start, end, period):
    """Return the mean of the law over a step, N, between two rates of parting, by quadrature."""
    way = -0.5 * period * (start + end)
    depths = depth + way * (np.arange(20_000) + 0.5) / 20_000
    inside = np.maximum(depths, 0.0)
    held = law.stiffness * inside.mean()
    damping = law.damping * (depths > 0.0).mean() + law.dissipation * held
    return max(0.0, held + damping * way / period)


def broken_law(sim, before, after):
    """Return by how much forces and rates of a step of rk2 or rk4 break the law, N.

    That of rest or that of impacts; nothing can be said of a step that was divided.

    Rates at the end are those of the links there, so that a body that turns by ω h in the step is
    off by as much of its rates.
    """
    shapes = {shape.name: shape.link for shape in sim.scene.shapes}
    found, worst = after.touching, 0.0
    if found.divided > 1:
        return worst
    for point, pair in enumerate(found.pairs.tolist()):
        law = sim.scene.contacts[pair]
        links, normal = (shapes[law.a], shapes[law.b]), found.normals[point]
        start, end = (
            np.subtract(*(rate_of(sim, state, link, found.points[point]) for link in links))
            for state in (before, after)
        )
        external = found.forces[point] @ normal
        friction = found.forces[point] - external * normal
        ahead = found.depths[point] - 0.5 * sim.period * (start @ normal)
        damping = law.damping + law.dissipation * law.stiffness * max(0.0, ahead)
        resistance = max(damping, law.stiffness * sim.period)
        wanted = max(0.0, law.stiffness * ahead - resistance * (end @ normal))
        impact = mean_push(law, found.depths[point], start @ normal, end @ normal, sim.period)
        if abs(impact - external) < abs(wanted - external):
            wanted = impact
        slip = end - (end @ normal) * normal
        most = law.friction * external
        worst = max(worst, abs(external - wanted), np.linalg.norm(friction) - most)
        # Slip of so many m/s has its direction from rounding.
        if np.linalg.norm(slip) > 1e-6:
            against = -most * slip / np.linalg.norm(slip)
            worst = max(worst, np.linalg.norm(friction - against))
    return worst
