# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes from the smallest one upwards, each with one feature more; and pairs, with and without."""

from __future__ import annotations

from collections.abc import Callable
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
# What of a document is another, at its outermost level.
Change = Callable[[Document], Document]


def _link(index: int) -> Document:
    number = index + 1
    joint: Document = {"name": f"joint{number}", "type": "revolute", "axis": list(AXES[index])}
    return {
        "name": f"link{number}",
        "parent": f"link{index}" if index > 0 else "world",
        "joint": joint | ({"origin": TIP} if index > 0 else {}),
        "inertial": {
            "mass": 0.5,
            "com": [LINK / 2, 0.0, 0.0],
            "inertia": {"ixx": 0.001, "iyy": 0.0015, "izz": 0.0015},
        },
    }


def _further(key: str, *items: Document) -> Change:
    """Return a change that adds items to one of a document's lists."""
    return lambda document: {key: [*document.get(key, ()), *items]}


def _every_joint(**keys: object) -> Change:
    """Return a change of keys of every joint."""
    return lambda document: {
        "links": [link | {"joint": link["joint"] | keys} for link in document["links"]]
    }


def _stepping(**keys: object) -> Change:
    """Return a change of keys of ``simulation``."""
    return lambda document: {"simulation": document["simulation"] | keys}


def _pin(document: Document, away: float) -> Document:
    """Return an open ball joint between the last link's tip and the world, ``away`` (m) of it."""
    mechanism = Mechanism(scene_from_document({**document, "closures": []}))
    last = document["links"][-1]["name"]
    pose = mechanism.frame_pose(consistent_initial_state(mechanism)[0], last)
    place = pose.translation + pose.rotation @ np.array(TIP["xyz"]) + (0.0, 0.0, away)
    ends = {
        "a": {"link": last, "origin": TIP},
        "b": {"link": "world", "origin": {"xyz": place.tolist()}},
    }
    return {"name": "pin", "kind": "spherical", **ends, "active": False}


# The smallest scene: one revolute joint in the plane, without gravity or elements.
SMALLEST: Document = {
    "format": "hapticmech-scene/1",
    "name": "ablation",
    "task_space": "planar",
    "links": [_link(0)],
    "operational_points": [{"name": "handle", "link": "link1", "origin": TIP}],
    "initial_state": {"q": {"joint1": ANGLES[0]}},
    "simulation": {"period": 0.001, "integrator": "rk2"},
    "hand": {"kind": "constant_wrench", "force": [-0.3, 0.2, 0.0], "start_delay": 0.0},
}
SECOND_POINT = _further("operational_points", {"name": "elbow", "link": "link1"})
# A floor far below, and a ball at the base that may touch it.
BALL: Document = {"name": "ball", "link": "base", "geometry": {"kind": "sphere", "radius": 0.05}}
FLOOR: Document = {"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}
STEPS: dict[str, Change] = {
    "+ gravity": lambda document: {"gravity": [0.0, -9.81, 0.0]},
    "+ spatial task": lambda document: {"task_space": "spatial"},
    "+ five joints": lambda document: {
        "links": [_link(index) for index in range(len(AXES))],
        "initial_state": {"q": {f"joint{k}": angle for k, angle in enumerate(ANGLES, 1)}},
        "operational_points": [document["operational_points"][0] | {"link": "link4"}],
    },
    "+ second point": SECOND_POINT,
    "+ damping": _every_joint(damping=0.01),
    "+ friction and stops": _every_joint(
        friction=0.01, limits={"lower": -2.5, "upper": 2.5, "stiffness": 100.0, "damping": 1.0}
    ),
    "+ spring between points": _further(
        "springs",
        {"name": "spring", "a": {"link": "link3", "origin": TIP}, "b": {"link": "world"}}
        | {"stiffness": 20.0, "damping": 0.5, "rest_length": 0.2},
    ),
    "+ open closure": lambda document: {"closures": [_pin(document, FAR_AWAY)]},
    "+ that can latch": lambda document: {
        "closures": [document["closures"][0] | {"latch_distance": 1e-6}]
    },
    "+ that is active": lambda document: {"closures": [_pin(document, 0.0) | {"active": True}]},
    "+ redundant closure": lambda document: {
        "closures": [document["closures"][0], document["closures"][0] | {"name": "pin_again"}]
    },
    "+ free-flying base": lambda document: {
        "links": [
            _link(0) | {"name": "base", "joint": {"name": "float", "type": "free"}},
            document["links"][0] | {"parent": "base"},
            *document["links"][1:],
        ]
    },
    "+ two substeps": _stepping(substeps=2),
    "+ contact out of reach": lambda document: {
        "shapes": [BALL, FLOOR | {"origin": {"xyz": [0.0, 0.0, -FAR_AWAY]}}],
        "contacts": [
            {"name": "touch", "a": "ball", "b": "floor"}
            | {"stiffness": 1e4, "damping": 20.0, "friction": 0.5}
        ],
    },
    # Against gravity, and below the ball.
    "+ that rests": lambda document: {
        "shapes": [
            BALL,
            FLOOR | {"origin": {"xyz": [0.0, -0.05, 0.0], "rpy": [-np.pi / 2, 0.0, 0.0]}},
        ]
    },
}
OPEN_PIN = _further(
    "closures",
    {"name": "open", "kind": "planar_pin", "active": False, "a": {"link": "link2"}}
    | {"b": {"link": "world", "origin": {"xyz": [0.03, 0.03, 0.0]}}},
)
# Without mass, so that the motion is the same.
LOCKED_LINK = _further(
    "links",
    {"name": "knob", "parent": "link2"}
    | {"joint": {"name": "still", "type": "revolute", "locked": True}}
    | {"inertial": {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}},
)
SLACK = _further(
    "springs",
    {"name": "slack", "stiffness": 0.0, "a": {"link": "link2"}, "b": {"link": "world"}},
)
STOPS = _every_joint(limits={"lower": -100.0, "upper": 100.0, "stiffness": 1.0})


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

    def changed(self, name: str, change: Change) -> Variant:
        """Return a variant with a change; this one stays as it is."""
        return Variant(name, self.document | change(self.document))


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


def ladder() -> tuple[Variant, ...]:
    """Return the steps, the smallest scene first."""
    steps = [Variant("one revolute joint, planar", SMALLEST)]
    for name, change in STEPS.items():
        steps.append(steps[-1].changed(name, change))
    return tuple(steps)


def pairs() -> tuple[Pair, ...]:
    """Return all pairs. The first one is a scene beside itself: what timing alone gives."""
    five_bar, two_link = _pushed_at_once("five_bar"), _pushed_at_once("two_link")
    undamped = five_bar.changed("five_bar, no damping", _every_joint(damping=0.0))
    unwatched = five_bar.changed("five_bar, no watch", _stepping(accuracy={"tolerance": 0.0}))
    return (
        Pair("nothing (the same scene)", five_bar, Variant("five_bar again", five_bar.document)),
        Pair("open closure", five_bar, five_bar.changed("five_bar + open pin", OPEN_PIN)),
        Pair(
            "open closure, serial arm", two_link, two_link.changed("two_link + open pin", OPEN_PIN)
        ),
        Pair("point nobody holds", two_link, two_link.changed("two_link + point", SECOND_POINT)),
        Pair("damping (used)", undamped, five_bar, alike=False),
        Pair("steps watched (used)", unwatched, five_bar),
        Pair("locked joint", five_bar, five_bar.changed("five_bar + locked link", LOCKED_LINK)),
        Pair("spring of stiffness 0", five_bar, five_bar.changed("five_bar + spring", SLACK)),
        Pair("stops never met", two_link, two_link.changed("two_link + stops", STOPS)),
    )


def _pushed_at_once(name: str) -> Variant:
    """Return a shipped scene whose hand does not wait, so that all that is timed moves."""
    return Variant(name, document_of(load_scene(name, changes=["hand.start_delay=0.0"])))
