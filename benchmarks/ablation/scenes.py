# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes from the smallest one upwards, each with one feature more; and pairs, with and without."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.scene import Scene, document_of, scene_from_document

LINK = 0.15
TIP = {"xyz": [LINK, 0.0, 0.0]}
# Bent, so that nothing is singular.
ANGLES = (0.3, -0.7, 0.9, 0.5, -0.8, 0.4)
AXES = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)) * 2
# Where an open closure waits: out of reach, so that nothing latches while it is timed.
FAR_AWAY = 0.3
Document = dict[str, Any]
Change = Callable[[Document], None]


def ladder() -> tuple[Variant, ...]:
    """Return the steps, the smallest scene first."""
    steps = [Variant("one revolute joint, planar", smallest())]
    for name, changes in _steps():
        steps.append(steps[-1].changed(name, *changes))
    return tuple(steps)


def smallest() -> Document:
    """Return the smallest scene: one revolute joint in the plane, without gravity or elements."""
    return {
        "format": "hapticmech-scene/1",
        "name": "ablation",
        "task_space": "planar",
        "links": [_link(0)],
        "operational_points": [{"name": "handle", "link": "link1", "origin": TIP}],
        "initial_state": {"q": {"joint1": ANGLES[0]}},
        "simulation": {"period": 0.001, "integrator": "rk2"},
        "hand": {"kind": "constant_wrench", "force": [-0.3, 0.2, 0.0], "start_delay": 0.0},
    }


def second_point(document: Document) -> None:
    """Add an operational point that nobody holds."""
    point = {"name": "elbow", "link": document["links"][0]["name"]}
    document["operational_points"].append(point)


def _steps() -> tuple[tuple[str, tuple[Change, ...]], ...]:
    return (
        ("+ gravity", (_gravity,)),
        ("+ spatial task", (_spatial,)),
        ("+ five joints", (_further_joints,)),
        ("+ second point", (second_point,)),
        ("+ damping", (_damping,)),
        ("+ friction and stops", (_friction_and_stops,)),
        ("+ spring between points", (_spring,)),
        ("+ open closure", (_open_closure,)),
        ("+ that can latch", (_latch,)),
        ("+ that is active", (_active_closure,)),
        ("+ redundant closure", (_redundant_closure,)),
        ("+ free-flying base", (_free_base,)),
        ("+ two substeps", (_two_substeps,)),
        ("+ contact out of reach", (_floor,)),
        ("+ that rests", (_resting,)),
    )


def _link(index: int) -> Document:
    number = index + 1
    joint: Document = {"name": f"joint{number}", "type": "revolute", "axis": list(AXES[index])}
    if index > 0:
        joint["origin"] = TIP
    return {
        "name": f"link{number}",
        "parent": f"link{index}" if index > 0 else "world",
        "joint": joint,
        "inertial": {
            "mass": 0.5,
            "com": [LINK / 2, 0.0, 0.0],
            "inertia": {"ixx": 0.001, "iyy": 0.0015, "izz": 0.0015},
        },
    }


def _gravity(document: Document) -> None:
    document["gravity"] = [0.0, -9.81, 0.0]


def _spatial(document: Document) -> None:
    document["task_space"] = "spatial"


def _further_joints(document: Document) -> None:
    for index in range(1, len(AXES)):
        document["links"].append(_link(index))
        document["initial_state"]["q"][f"joint{index + 1}"] = ANGLES[index]
    document["operational_points"][0]["link"] = "link4"


def _damping(document: Document) -> None:
    for link in document["links"]:
        link["joint"]["damping"] = 0.01


def _friction_and_stops(document: Document) -> None:
    for link in document["links"]:
        stops = {"lower": -2.5, "upper": 2.5, "stiffness": 100.0, "damping": 1.0}
        link["joint"] |= {"friction": 0.01, "limits": stops}


def _spring(document: Document) -> None:
    ends = {"a": {"link": "link3", "origin": TIP}, "b": {"link": "world"}}
    values = {"stiffness": 20.0, "damping": 0.5, "rest_length": 0.2}
    document["springs"] = [{"name": "spring", **ends, **values}]


def _open_closure(document: Document) -> None:
    document["closures"] = [_pin(document, "pin", FAR_AWAY)]


def _latch(document: Document) -> None:
    document["closures"][0]["latch_distance"] = 1e-6


def _active_closure(document: Document) -> None:
    document["closures"] = [{**_pin(document, "pin", 0.0), "active": True}]


def _redundant_closure(document: Document) -> None:
    document["closures"].append({**document["closures"][0], "name": "pin_again"})


def _free_base(document: Document) -> None:
    base = {**_link(0), "name": "base", "joint": {"name": "float", "type": "free"}}
    first = document["links"][0]
    document["links"] = [base, {**first, "parent": "base"}, *document["links"][1:]]


def _two_substeps(document: Document) -> None:
    document["simulation"]["substeps"] = 2


def _floor(document: Document) -> None:
    """Add a floor far below, and a ball at the base that may touch it."""
    ball = {"name": "ball", "link": "base", "geometry": {"kind": "sphere", "radius": 0.05}}
    below = {"xyz": [0.0, 0.0, -FAR_AWAY]}
    floor = {"name": "floor", "link": "world", "origin": below, "geometry": {"kind": "half_space"}}
    document["shapes"] = [ball, floor]
    law = {"stiffness": 1e4, "damping": 20.0, "friction": 0.5}
    document["contacts"] = [{"name": "touch", "a": "ball", "b": "floor", **law}]


def _resting(document: Document) -> None:
    """Turn the floor against gravity and put it below the ball."""
    document["shapes"][1]["origin"] = {"xyz": [0.0, -0.05, 0.0], "rpy": [-np.pi / 2, 0.0, 0.0]}


def _pin(document: Document, name: str, away: float) -> Document:
    """Return an open ball joint between the last link's tip and the world, ``away`` (m) of it."""
    mechanism = Mechanism(scene_from_document({**document, "closures": []}))
    last = document["links"][-1]["name"]
    pose = mechanism.frame_pose(consistent_initial_state(mechanism)[0], last)
    place = pose.translation + pose.rotation @ np.array(TIP["xyz"]) + (0.0, 0.0, away)
    ends = {
        "a": {"link": last, "origin": TIP},
        "b": {"link": "world", "origin": {"xyz": place.tolist()}},
    }
    return {"name": name, "kind": "spherical", **ends, "active": False}


@dataclass(frozen=True, slots=True)
class Variant:
    """A scene, and what sets it apart.

    Attributes:
        name: for people, such as ``gravity``.
        document: the scene as plain dictionaries, lists and numbers.
    """

    name: str
    document: Document

    def scene(self) -> Scene:
        """Return the validated scene.

        Raises:
            SceneError: the document breaks a rule.
        """
        return scene_from_document(self.document, self.name)

    def changed(self, name: str, *changes: Change) -> Variant:
        """Return a variant with changes, in order; this one stays as it is."""
        document = deepcopy(self.document)
        for change in changes:
            change(document)
        return Variant(name, document)


@dataclass(frozen=True, slots=True)
class Pair:
    """Two scenes, of which the second one has something more.

    Attributes:
        name: what the second one has.
        without: the first one.
        having: the second one.
        alike: whether both move alike, since it is not used.
    """

    name: str
    without: Variant
    having: Variant
    alike: bool = True


def pairs() -> tuple[Pair, ...]:
    """Return all pairs. The first one is a scene beside itself: what timing alone gives."""
    five_bar, two_link = _pushed_at_once("five_bar"), _pushed_at_once("two_link")
    return (
        Pair("nothing (the same scene)", five_bar, five_bar.changed("five_bar again")),
        Pair("open closure", five_bar, five_bar.changed("five_bar + open pin", _open_pin)),
        Pair(
            "open closure, serial arm",
            two_link,
            two_link.changed("two_link + open pin", _serial_pin),
        ),
        Pair("point nobody holds", two_link, two_link.changed("two_link + point", second_point)),
        Pair("damping (used)", _undamped(five_bar), five_bar, alike=False),
        Pair("steps watched (used)", _unwatched(five_bar), five_bar),
        Pair("locked joint", five_bar, five_bar.changed("five_bar + locked link", _locked_link)),
        Pair("spring of stiffness 0", five_bar, five_bar.changed("five_bar + spring", _slack)),
        Pair("stops never met", two_link, two_link.changed("two_link + stops", _stops)),
    )


def _pushed_at_once(name: str) -> Variant:
    """Return a shipped scene whose hand does not wait, so that all that is timed moves."""
    document = document_of(load_scene(name))
    document["hand"]["start_delay"] = 0.0
    return Variant(name, document)


def _undamped(variant: Variant) -> Variant:
    def take_away(document: Document) -> None:
        for link in document["links"]:
            link["joint"]["damping"] = 0.0

    return variant.changed(f"{variant.name}, no damping", take_away)


def _unwatched(variant: Variant) -> Variant:
    def leave_alone(document: Document) -> None:
        document["simulation"]["accuracy"] = {"tolerance": 0.0}

    return variant.changed(f"{variant.name}, no watch", leave_alone)


def _open_pin(document: Document) -> None:
    ends = {"a": {"link": "link2"}, "b": {"link": "world", "origin": {"xyz": [0.03, 0.03, 0.0]}}}
    document["closures"].append({"name": "open", "kind": "planar_pin", "active": False, **ends})


def _serial_pin(document: Document) -> None:
    ends = {"a": {"link": "link2"}, "b": {"link": "world", "origin": {"xyz": [0.03, 0.03, 0.0]}}}
    document["closures"] = [{"name": "open", "kind": "planar_pin", "active": False, **ends}]


def _locked_link(document: Document) -> None:
    still = {"name": "still", "type": "revolute", "locked": True}
    # Without mass, so that the motion is the same.
    nothing = {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}
    link = {"name": "knob", "parent": "link2", "joint": still, "inertial": nothing}
    document["links"].append(link)


def _slack(document: Document) -> None:
    ends = {"a": {"link": "link2"}, "b": {"link": "world"}}
    document["springs"] = [{"name": "slack", "stiffness": 0.0, **ends}]


def _stops(document: Document) -> None:
    for link in document["links"]:
        link["joint"]["limits"] = {"lower": -100.0, "upper": 100.0, "stiffness": 1.0}
