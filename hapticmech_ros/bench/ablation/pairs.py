"""Pairs of scenes, with and without something that the one with it does not use."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.bench.ablation.ladder import second_point
from hapticmech_ros.bench.ablation.variant import Document, Variant
from hapticmech_ros.scene import document_of, load_scene


@dataclass(frozen=True, slots=True)
class Pair:
    """Two scenes that move alike.

    Attributes:
        name: what the second one has.
        without: the first one.
        having: the second one.
    """

    name: str
    without: Variant
    having: Variant


def pairs() -> tuple[Pair, ...]:
    """Return all pairs. The first one is a scene beside itself: what timing alone gives."""
    five_bar, two_link = _pushed_at_once("five_bar"), _pushed_at_once("two_link")
    return (
        Pair("nothing (the same scene)", five_bar, five_bar.changed("five_bar again")),
        Pair("open closure", five_bar, five_bar.changed("five_bar + open pin", _open_pin)),
        Pair("open closure, serial arm", two_link, two_link.changed("two_link + open pin", _pin)),
        Pair("point nobody holds", two_link, two_link.changed("two_link + point", second_point)),
        Pair("damping (used)", _undamped(five_bar), five_bar),
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


def _open_pin(document: Document) -> None:
    ends = {"a": {"link": "link2"}, "b": {"link": "world", "origin": {"xyz": [0.03, 0.03, 0.0]}}}
    document["closures"].append({"name": "open", "kind": "planar_pin", "active": False, **ends})


def _pin(document: Document) -> None:
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
