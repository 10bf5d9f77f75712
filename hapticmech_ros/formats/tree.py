# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From bodies and joints to a scene's links: a tree from the world, and closures for the rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from hapticmech_ros.errors import listed, nearest, scene_error
from hapticmech_ros.formats.cuts import (
    CARRIED,
    LOOP_JOINTS,
    loop_joint_of,
    other_cut,
    universal_of,
)
from hapticmech_ros.formats.model import (
    WORLD,
    Body,
    Coupling,
    Document,
    Imported,
    Joint,
    Keyframe,
    LoopJoint,
    Model,
    Names,
    Note,
    clean,
    origin_of,
)
from hapticmech_ros.formats.shapes import named
from hapticmech_ros.scene.mechanism import MOMENTS
from hapticmech_ros.scene.rules import VELOCITY_SIZE

# Moments this far below zero, as a share of the largest, are rounding of the file.
ROUNDING = 1e-6
# kg m², below which a moment is rounding in any case.
NO_INERTIA = 1e-12


def balanced(inertia: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return a physically possible inertia (3, 3), kg m², and whether it had to be changed.

    No body has a principal moment above the sum of the other two, but files have such. Each of the
    smaller two is raised by half of the difference. Moments clearly below zero are left for the
    scene's rules to refuse.

    Args:
        inertia: (3, 3) about the centre of mass, kg m², any axes; the result has the same.
    """
    moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
    largest = moments[2]
    if moments[0] < 0.0 and np.abs(moments).max() <= NO_INERTIA:
        return np.zeros((3, 3)), False
    missing = largest - moments[0] - moments[1]
    if moments[0] < -ROUNDING * largest or (moments[0] >= 0.0 and missing <= 1e-9 * largest):
        return inertia, False
    raised = moments + np.array((0.5, 0.5, 0.0)) * max(missing, 0.0)
    made = (axes * np.maximum(raised, 0.0)) @ axes.T
    return made, bool(missing > ROUNDING * largest)


LINK_LIMIT = 1000
# Degrees of freedom: Pinocchio's memory for a model grows with their cube, times 64 bytes.
RATE_LIMIT = 200
# rad or m; a stop beyond this is none, as SDFormat has it.
NO_LIMIT = 1e15
NO_CUT = (
    f"closes a loop, but only these types can, and no joint of the loop is one: "
    f"{listed(sorted(LOOP_JOINTS))}; split a link of the loop in two, joined by a fixed joint"
)
NO_SENSE = "they are not used: write springs and dampers in a scene file"
NO_POSITION = "it has no coordinate, so it cannot be coupled or given a start"
RAISED = "a principal moment exceeded the sum of the other two, which were raised equally"
Place = tuple[str, pin.SE3]


def to_scene(model: Model, source: str, free_base: bool = False) -> Imported:
    """Return a model as parts of a scene.

    A body that no hinge carries is the world itself, or floats if the base is free. Frames of links
    are those of their joints: ``places`` has the bodies' own.

    Args:
        model: of a file.
        source: file, for messages.
        free_base: whether such a body floats.

    Raises:
        SceneError: too large, names twice, joints in a circle, or a loop that cannot be closed.
    """
    parts = {
        "bodies": model.bodies,
        "joints": model.hinges,
        "closures": model.loop_joints,
        "couplings": model.couplings,
    }
    for what, found in parts.items():
        if len(found) > LINK_LIMIT:
            raise scene_error(source, what, len(found), f"at most {LINK_LIMIT}")
    rates = sum(VELOCITY_SIZE[hinge.type] for hinge in model.hinges)
    if rates > RATE_LIMIT:
        rule = f"at most {RATE_LIMIT} degrees of freedom"
        raise scene_error(source, "joints", rates, rule)
    return _Builder(model, source, free_base).build()


class _Builder:
    def __init__(
        self, model: Model, source: str, free_base: bool, cut: Sequence[Joint] = ()
    ) -> None:
        self._model, self._source, self._free, self._cut = model, source, free_base, cut
        self._carriers: dict[str, Joint] = {}
        self._links: list[Document] = []
        self._places: dict[str, Place] = {WORLD: (WORLD, pin.SE3.Identity())}
        self._names = Names()
        self._joints: dict[str, str] = {}
        self._closing: list[Joint] = []
        self._floating: list[str] = []
        self._depth = {WORLD: 0}
        self._raised = self._dropped = 0
        self._lines: dict[str, str] = {}

    def build(self) -> Imported:
        if not self._model.bodies:
            raise scene_error(self._source, "bodies", 0, "there must be one at least")
        for base in self._bases():
            self._carry(base)
        self._grow()
        slide = next((hinge for hinge in self._closing if hinge.type not in LOOP_JOINTS), None)
        if slide is not None:
            return self._cut_elsewhere(slide).build()
        self._closing += self._cut
        if not any(link["joint"]["type"] != "fixed" for link in self._links):
            rule = f"no joint moves: {self._model.floating}"
            raise scene_error(self._source, "joints", len(self._model.hinges), rule)
        closed = [one for hinge in tuple(self._closing) for one in self._closed(hinge)]
        closures = [self._loop_joint(one) for one in closed]
        closures += [self._loop_joint(loop_joint) for loop_joint in self._model.loop_joints]
        document: Document = {"links": self._links}
        if closures:
            document["closures"] = closures
        if self._model.couplings:
            document["couplings"] = [self._coupling(one) for one in self._model.couplings]
        if self._model.gravity is not None:
            document["gravity"] = list(self._model.gravity)
        start = {self._joints[name]: at for name, at in self._model.start.items()}
        start |= {self._joints[hinge.name]: _stops(hinge)[0] for hinge in self._locked()}
        if start:
            document["initial_state"] = {"q": start}
        for point in self._model.points:
            if point.body not in self._places:
                raise scene_error(self._source, point.name, point.body, "no such body")
            link, place = self._places[point.body]
            self._places.setdefault(point.name, (link, place * point.origin))
        return Imported(
            {"name": clean(self._model.name), **document},
            self._places,
            self._joints,
            named(self._model.solids),
            self._tips(),
            self._notes(),
            {name: self._keyframe(found) for name, found in self._model.keyframes.items()},
            self._lines,
            self._model.visuals,
            self._absent(),
        )

    def _absent(self) -> dict[str, str]:
        """Return why joints of the file have no position in the scene."""
        found = {
            hinge.name: "is fixed to the world"
            for hinge in self._model.hinges
            if hinge.name not in self._joints
        }
        return found | {hinge.name: "closes a loop" for hinge in self._closing}

    def _where(self, kind: str, name: str) -> str:
        """Return where the file has a link or joint, for errors."""
        line = self._model.where.get((kind, name))
        return f"{kind} {name}" if line is None else f"{line}: {kind} {name}"

    def _keyframe(self, found: Keyframe) -> Keyframe:
        """Return a keyframe with the scene's names; joints that close loops or are locked: none."""
        known = self._joints.keys() - {hinge.name for hinge in self._locked()}
        q, v = (
            {self._joints[name]: at for name, at in part.items() if name in known} for part in found
        )
        return Keyframe(q, v)

    def _bases(self) -> Iterable[Joint]:
        """Yield a hinge to the world for each body that nothing carries."""
        carried = {hinge.child for hinge in self._model.hinges}
        bases = [name for name in self._model.bodies if name not in carried]
        if not bases and not any(hinge.parent == WORLD for hinge in self._model.hinges):
            lost = sorted(self._model.bodies)[:5]
            raise scene_error(
                self._source, self._where("link", lost[0]), lost, "joints go in a circle"
            )
        held = self._joined_to_world()
        for name in bases:
            if name != WORLD:
                free = self._free or name in held
                self._floating += [name] if free and not self._free else []
                place = self._model.bases.get(name, pin.SE3.Identity())
                yield Joint(f"{name}_base", "free" if free else "fixed", WORLD, name, place)

    def _joined_to_world(self) -> set[str]:
        """Return the bodies that joints join to the world, whichever is the parent in each."""
        joined: dict[str, set[str]] = {}
        for hinge in self._model.hinges:
            joined.setdefault(hinge.parent, set()).add(hinge.child)
            joined.setdefault(hinge.child, set()).add(hinge.parent)
        found, waiting = {WORLD}, [WORLD]
        while waiting:
            new = joined.get(waiting.pop(), set()) - found
            found |= new
            waiting += new
        return found

    def _grow(self) -> None:
        """Carry body after body, from the world outwards, in the file's order."""
        below: dict[str, list[Joint]] = {}
        for hinge in self._model.hinges:
            below.setdefault(hinge.parent, []).append(hinge)
        waiting = list(self._places)
        done: set[str] = set()
        while waiting:
            parent = waiting.pop()
            if parent in done:
                continue
            done.add(parent)
            for hinge in below.get(parent, []):
                if hinge.child == WORLD:
                    rule = "a joint carries the world: it must be a parent"
                    where = self._where("joint", hinge.name)
                    raise scene_error(self._source, where, hinge.parent, rule)
                if hinge.child in self._places:
                    self._closing.append(hinge)
                else:
                    self._carry(hinge)
            waiting += [hinge.child for hinge in reversed(below.get(parent, []))]
        lost = sorted(set(self._model.bodies) - set(self._places))
        if lost:
            rule = "joints of these go in a circle"
            raise scene_error(self._source, self._where("link", lost[0]), lost[:5], rule)

    def _cut_elsewhere(self, slide: Joint) -> _Builder:
        """Return a builder that cuts another joint of a loop than the one that closes it.

        Raises:
            SceneError: there is none.
        """
        found = None
        if slide.type in CARRIED:
            found = other_cut(slide, self._carriers, self._cost_of_cut)
        if found is None:
            raise scene_error(self._source, self._where("joint", slide.name), slide.type, NO_CUT)
        cut, changed = found
        by_name = {hinge.name: hinge for hinge in changed}
        hinges = [
            by_name.get(hinge.name, hinge) for hinge in self._model.hinges if hinge is not cut
        ]
        model = replace(self._model, hinges=hinges)
        return _Builder(model, self._source, self._free, [*self._cut, cut])

    def _cost_of_cut(self, hinge: Joint) -> tuple[object, ...]:
        """Return the cost of cutting a joint: by a coupling, a link without mass, forces in it."""
        model = self._model
        known = any(hinge is one for one in model.hinges)
        coupled = any(hinge.name in (one.joint, one.leader) for one in model.couplings)
        named = coupled or hinge.name in model.start
        ends = [model.bodies[end] for end in (hinge.parent, hinge.child) if end != WORLD]
        bare = any(end.mass == 0.0 for end in ends)
        return np.inf if not known or named else 0.0, bare, _acts(hinge), hinge.type == "fixed"

    def _closed(self, hinge: Joint) -> Sequence[LoopJoint]:
        """Return the closures that a joint is; with the one before it, that of a universal joint.

        A body without mass that only these two hold is then left out.
        """
        cross, before = hinge.parent, self._carriers.get(hinge.parent)
        held = [one for one in self._model.hinges if cross in (one.parent, one.child)]
        body = self._model.bodies.get(cross)
        if body is None or before is None or body.mass > 0.0 or len(held) != 2:
            return [loop_joint_of(hinge)]
        found = universal_of(before, hinge)
        if found is None:
            return [loop_joint_of(hinge)]
        link, _ = self._places.pop(cross)
        self._links = [one for one in self._links if one["name"] != link]
        del self._depth[cross], self._joints[before.name]
        self._closing.append(before)
        return found

    def _carry(self, hinge: Joint) -> None:
        link, place = self._places[hinge.parent]
        origin = place * hinge.in_parent
        body = self._model.bodies[hinge.child]
        self._carriers[hinge.child] = hinge
        self._depth[hinge.child] = self._depth[hinge.parent] + 1
        if hinge.type == "fixed" and link == WORLD:
            self._places[hinge.child] = (WORLD, origin * hinge.of_child)
            return
        own = hinge.of_child
        if hinge.type == "fixed":
            origin, own = origin * own, pin.SE3.Identity()
        name = self._names.new(hinge.child)
        self._places[hinge.child] = (name, own)
        if ("link", hinge.child) in self._model.where:
            self._lines[name] = self._model.where["link", hinge.child]
        if hinge.name in self._joints:
            where = self._where("joint", hinge.name)
            raise scene_error(self._source, where, hinge.name, "names must be unique")
        joint = self._joints[hinge.name] = self._names.new(hinge.name)
        if ("joint", hinge.name) in self._model.where:
            self._lines[joint] = self._model.where["joint", hinge.name]
        self._links.append(
            {
                "name": name,
                "parent": link,
                "joint": _joint(hinge, self._joints[hinge.name], origin),
                "inertial": self._inertial(body, own),
            }
        )
        if body.gravcomp:
            self._links[-1]["gravcomp"] = float(body.gravcomp)

    def _inertial(self, body: Body, place: pin.SE3) -> Document:
        turned = place.rotation @ body.inertia @ place.rotation.T
        if body.mass == 0.0:
            self._dropped += bool(turned.any())
            turned = np.zeros((3, 3))
        inertia, raised = balanced(turned)
        self._raised += raised
        return {
            "mass": float(body.mass),
            "com": place.act(body.com).tolist(),
            "inertia": {key: float(inertia[at]) for key, at in MOMENTS.items()},
        }

    def _loop_joint(self, loop_joint: LoopJoint) -> Document:
        ends = {}
        for end, (body, place) in (("a", loop_joint.a), ("b", loop_joint.b)):
            if body not in self._places:
                raise scene_error(self._source, f"closure {loop_joint.name}", body, "no such body")
            link, own = self._places[body]
            ends[end] = {"link": link, "origin": origin_of(own * place)}
        found: Document = {
            "name": self._names.new(loop_joint.name),
            "kind": loop_joint.kind,
            **ends,
        }
        if loop_joint.length is not None:
            found["length"] = loop_joint.length
        return found if loop_joint.active else {**found, "active": False}

    def _coupling(self, coupling: Coupling) -> Document:
        for joint in (coupling.joint, coupling.leader):
            if joint not in self._joints:
                where = f"{self._where('joint', coupling.joint)}: coupling {coupling.name}"
                absent = self._absent().get(joint)
                rule = f"no such joint{nearest(joint, self._joints)}"
                rule = rule if absent is None else f"joint {joint!r} {absent}: {NO_POSITION}"
                raise scene_error(self._source, where, joint, rule)
        found: Document = {
            "name": self._names.new(coupling.name),
            "joint": self._joints[coupling.joint],
            "leader": self._joints[coupling.leader],
        }
        if coupling.polycoef:
            return {**found, "polycoef": list(coupling.polycoef)}
        return {**found, "ratio": coupling.ratio, "offset": coupling.offset}

    def _locked(self) -> list[Joint]:
        """Return the joints whose stops leave no travel, and which close no loop."""
        return [
            hinge
            for hinge in self._model.hinges
            if hinge.name in self._joints and _is_locked(hinge)
        ]

    def _travel(self, coupling: Coupling) -> Note | None:
        """Return the note of a coupling whose joints' stops leave no travel; None otherwise."""
        hinges = {hinge.name: hinge for hinge in self._model.hinges}
        joint, leader = hinges[coupling.joint], hinges[coupling.leader]
        own, (first, last) = _stops(joint), _stops(leader)
        curve = Polynomial(coupling.polycoef or (coupling.offset, coupling.ratio))
        roots = np.asarray(curve.deriv().roots(), dtype=complex)
        turns = np.clip(roots[roots.imag == 0.0].real, first, last)
        reached = [float(curve(at)) for at in (first, last, *turns.tolist())]
        lower, upper = min(reached), max(reached)
        if max(lower, own[0]) < min(upper, own[1]) or _is_locked(joint) or _is_locked(leader):
            return None
        why = f"those of {joint.name} are at {own[0]:g} and {own[1]:g}, those of its leader "
        why += f"{leader.name} have it at {lower:g} and {upper:g}"
        return Note(f"coupling {coupling.name}: stops leave no travel", 1, why)

    def _tips(self) -> list[str]:
        """Return the links that carry no other, the one most joints from the world first."""
        parents = {link["parent"] for link in self._links}
        depth = {self._places[body][0]: depth for body, depth in self._depth.items()}
        tips = [link["name"] for link in self._links if link["name"] not in parents]
        return sorted(tips, key=lambda name: -depth[name])

    def _notes(self) -> list[Note]:
        notes = [
            Note(
                f"joint {hinge.name}: {self._model.locks.get(hinge.name, 'lower = upper')}",
                1,
                f"locked at {_stops(hinge)[0]:g}",
            )
            for hinge in self._locked()
        ]
        notes += [one for one in map(self._travel, self._model.couplings) if one is not None]
        notes += [
            Note(
                f"body {name}: no joint carries it", 1, "it is free: joints of other bodies hold it"
            )
            for name in self._floating
        ]
        notes += self._model.notes
        acting = [hinge for hinge in self._closing if _acts(hinge)]
        if acting:
            notes.append(Note("forces in joints that close loops", len(acting), NO_SENSE))
        if self._dropped:
            notes.append(
                Note("inertia without mass", self._dropped, "a body without mass has none")
            )
        if self._raised:
            notes.append(Note("inertia of no body", self._raised, RAISED))
        return sorted(notes, key=lambda note: note.rank)


def _joint(hinge: Joint, name: str, origin: pin.SE3) -> Document:
    found: Document = {"name": name, "type": hinge.type, "origin": origin_of(origin)}
    if hinge.type in ("revolute", "prismatic"):
        found["axis"] = hinge.axis.tolist()
    values: Mapping[str, Any] = {
        "damping": hinge.damping,
        "armature": hinge.armature,
        "friction": hinge.friction,
        "stiffness": hinge.stiffness,
        "rest": hinge.rest,
    }
    found |= {key: float(value) for key, value in values.items() if value}
    lower, upper = _stops(hinge)
    if _is_locked(hinge):
        found["locked"] = True
    elif lower > -NO_LIMIT or upper < NO_LIMIT:
        found["limits"] = {"lower": lower, "upper": upper}
    return found


def _stops(hinge: Joint) -> tuple[float, float]:
    """Return where a joint's stops are, as far as numbers go where there are none."""
    lower, upper = hinge.limits or (-NO_LIMIT, NO_LIMIT)
    return max(float(lower), -NO_LIMIT), min(float(upper), NO_LIMIT)


def _is_locked(hinge: Joint) -> bool:
    """Return whether a joint's stops leave no travel: exporters mean that it is locked there."""
    lower, upper = _stops(hinge)
    return lower == upper


def _acts(hinge: Joint) -> bool:
    """Return whether anything acts in a joint."""
    acting = hinge.damping or hinge.friction or hinge.stiffness or hinge.armature or hinge.limits
    return bool(acting)
