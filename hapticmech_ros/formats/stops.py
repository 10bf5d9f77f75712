# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Adds what files lack and scenes need, by a rule: starts, stops, friction and metrics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import Document
from hapticmech_ros.mechanism.inertia import SingularInertiaError, cholesky_of_upper
from hapticmech_ros.mechanism.model import authored_state, build_tree
from hapticmech_ros.scene import Scene, scene_from_document
from hapticmech_ros.scene.mechanism import Inertia
from hapticmech_ros.scene.rules import inertia_matrix

# A stop and its joint's inertia oscillate at this over the step, rad: explicit rules allow 2.8, and
# so the inertia may fall to a hundredth.
SWING = 0.3
# Of critical damping.
DAMPING_RATIO = 0.5
# Depth at which a stop has that damping, rad or m.
DEPTH = 0.01
# Friction slows its joint by at most this share in a step: explicit rules allow 2.
SLOWED = 0.3
FRICTION_SPEED = 0.01


def with_stops(document: Document, source: str) -> Document:
    """Return a document whose stops have a stiffness, and whose friction does not chatter.

    With m the inertia that a joint meets where the scene starts, 1 / (D⁻¹)_cc, and T the step:
    stiffness (0.3 / T)² m, damping 2 · 0.5 √(k m) at a depth of 0.01, and Coulomb friction f
    reverses within f T / (0.3 m), at least 0.01. The document's own values stay.
    """
    without = [_bared(link) for link in document["links"]]
    scene = scene_from_document({**document, "links": without}, source)
    bare = any(_is_bare(link["joint"]) for link in document["links"])
    if not bare and not any(_is_rough(link["joint"]) for link in document["links"]):
        return document
    met = _inertia_met(scene)
    period = scene.simulation.period / scene.simulation.substeps
    links = []
    for link in document["links"]:
        joint = dict(link["joint"])
        inertia = met.get(joint["name"])
        if inertia is None:
            if _is_bare(joint):
                del joint["limits"]
        else:
            if _is_bare(joint):
                joint["limits"] = _stop(joint["limits"], inertia, period)
            if _is_rough(joint):
                slow = joint["friction"] * period / (SLOWED * inertia)
                joint["friction_speed"] = float(max(FRICTION_SPEED, slow))
        links.append({**link, "joint": joint})
    return {**document, "links": links}


def with_start(document: Document) -> Document:
    """Return a document in which joints whose zero is beyond a stop start at that stop.

    A start in the document is kept.
    """
    state = document.get("initial_state", {})
    if not isinstance(state, dict) or not isinstance(state.get("q", {}), dict):
        return document
    start = {}
    for link in document["links"]:
        limits = link["joint"].get("limits")
        if isinstance(limits, dict) and not limits["lower"] <= 0.0 <= limits["upper"]:
            start[link["joint"]["name"]] = min(limits["lower"], limits["upper"], key=abs)
    if not start:
        return document
    return {**document, "initial_state": {**state, "q": {**start, **state.get("q", {})}}}


def with_metrics(document: Document) -> Document:
    """Return a document in which every operational point on a body has a metric.

    A link of no inertia of its own, such as a tool's frame, is given that of the mechanism: its
    mass, and the mean radius of gyration of its links about their own centres.
    """
    points = document.get("operational_points")
    if not isinstance(points, list):
        return document
    links = {link["name"]: link for link in document["links"]}
    return {**document, "operational_points": [_measured(point, links) for point in points]}


def _measured(point: object, links: dict[str, Document]) -> object:
    """Return an operational point with a metric, its own or its link's where there is one."""
    if not isinstance(point, dict) or "metric" in point:
        return point
    link = links.get(point["link"]) if isinstance(point.get("link"), str) else None
    if link is None or _has_inertia(link):
        return point
    return {**point, "metric": _whole_metric(list(links.values()))}


def _is_bare(joint: Document) -> bool:
    limits = joint.get("limits")
    return isinstance(limits, dict) and "stiffness" not in limits


def _is_rough(joint: Document) -> bool:
    return joint.get("friction", 0.0) > 0.0 and "friction_speed" not in joint


def _bared(link: Document) -> Document:
    """Return a link without a stop that has no stiffness yet."""
    left_out = "limits" if _is_bare(link["joint"]) else ""
    joint = {key: value for key, value in link["joint"].items() if key != left_out}
    return {**link, "joint": joint}


def _stop(limits: dict[str, Any], inertia: float, period: float) -> Document:
    rate = SWING / period
    stiffness = rate * rate * inertia
    damping = 2.0 * DAMPING_RATIO * float(np.sqrt(stiffness * inertia))
    return {**limits, "stiffness": float(stiffness), "damping": damping, "depth": DEPTH}


def _inertia_met(scene: Scene) -> dict[str, float]:
    """Return the inertia that each joint moves, by its name, with the others free."""
    tree = build_tree(scene)
    model, (q, _) = tree.pinocchio, authored_state(scene, tree)
    inertia = pin.crba(model, model.createData(), q).reshape(model.nv, model.nv)
    try:
        factor = cholesky_of_upper(inertia)
    except SingularInertiaError:
        return {}  # a joint moves no mass: the mechanism refuses that with advice
    mobile = np.square(np.linalg.inv(factor)).sum(axis=0)  # diagonal of D⁻¹ = L⁻ᵀ L⁻¹
    return {
        name: 1.0 / float(mobile[tree.velocity_slice(i)][0])
        for i, name in enumerate(tree.joint_names)
    }


def _has_inertia(link: Document) -> bool:
    inertia = Inertia.model_construct(**link["inertial"]["inertia"])
    moments = np.linalg.eigvalsh(inertia_matrix(inertia))
    return bool(link["inertial"]["mass"] > 0.0 and moments.min() > 0.0)


def _whole_metric(links: list[Document]) -> Document:
    mass = sum(link["inertial"]["mass"] for link in links)
    moments = [link["inertial"]["inertia"] for link in links]
    total = sum(i["ixx"] + i["iyy"] + i["izz"] for i in moments)
    length = float(np.sqrt(total / (3.0 * mass))) if mass > 0.0 and total > 0.0 else 0.1
    return {"mass": float(mass) or 1.0, "length": length}
