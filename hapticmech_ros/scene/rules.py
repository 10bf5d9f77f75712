# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules that concern more than one value of a scene: names, tree, plane, sizes, physics.

Rule of a scene's limits: the scene's own numbers lie within them.

Rules of shapes and contacts that concern more than one value of a scene.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from hapticmech_ros.errors import FileError, SceneError, SceneProblem, listed, nearest
from hapticmech_ros.files import check_file, is_file
from hapticmech_ros.scene.contacts import ContactPair, Shape
from hapticmech_ros.scene.document import SceneDocument
from hapticmech_ros.scene.holding_rules import broken_holding_rules, hand_vectors
from hapticmech_ros.scene.mechanism import Closure, Inertia, Joint, Link, Origin, Spring

# Formats that coal reads safely, even broken files: a PLY file with an empty face ends the process.
MESH_SUFFIXES = (".stl", ".obj", ".dae", ".off")
MESH_SIZE_LIMIT = 32_000_000


def broken_contact_rules(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Yield every rule of shapes and contacts that ``scene`` breaks."""
    yield from _names_twice(
        (
            ("shapes[{}].name", [shape.name for shape in scene.shapes]),
            ("contacts[{}].name", [contact.name for contact in scene.contacts]),
        )
    )
    yield from _shapes(scene)
    shapes = {shape.name: shape for shape in scene.shapes}
    for index, contact in enumerate(scene.contacts):
        yield from _pair(scene, f"contacts[{index}]", contact, shapes)
        yield from _law(f"contacts[{index}]", contact)


def _names_twice(groups: Iterable[tuple[str, Sequence[str]]]) -> Iterator[SceneProblem]:
    """Yield names that occur before under the same key."""
    for key, names in groups:
        for index, name in enumerate(names):
            if name in names[:index]:
                yield SceneProblem(key.format(index), name, "names must be unique")


def _shapes(scene: SceneDocument) -> Iterator[SceneProblem]:
    links = {link.name for link in scene.links}
    for index, shape in enumerate(scene.shapes):
        if shape.link != "world" and shape.link not in links:
            yield _unknown(f"shapes[{index}].link", "frame", shape.link, links, "'world' or ")
        if shape.geometry.kind == "mesh":
            yield from _mesh_file(f"shapes[{index}].geometry.file", shape.geometry.file)


def _unknown(
    key: str, what: str, name: str, known: Collection[str], besides: str = ""
) -> SceneProblem:
    """Return the problem of a name that nothing in the scene has."""
    rule = f"unknown {what}: must be {besides}one of {listed(sorted(known))}{nearest(name, known)}"
    return SceneProblem(key, name, rule)


def _mesh_file(key: str, file: str) -> Iterator[SceneProblem]:
    """Yield problems of a mesh's file before it is read."""
    path = Path(file)
    if not is_file(path):
        yield SceneProblem(key, file, "no such file")
    elif path.suffix.lower() not in MESH_SUFFIXES:
        yield SceneProblem(key, file, f"a mesh's file must end in one of {listed(MESH_SUFFIXES)}")
    else:
        try:
            check_file(path, MESH_SIZE_LIMIT)
        except FileError as error:
            yield SceneProblem(key, file, f"a mesh's file {error.rule} ({error.value})")


def _pair(
    scene: SceneDocument, key: str, contact: ContactPair, shapes: Mapping[str, Shape]
) -> Iterator[SceneProblem]:
    """Yield problems of the two shapes that a contact joins."""
    unknown = [side for side in ("a", "b") if getattr(contact, side) not in shapes]
    for side in unknown:
        yield _unknown(f"{key}.{side}", "shape", getattr(contact, side), shapes)
    if unknown:
        return
    a, b = shapes[contact.a], shapes[contact.b]
    if _carrier(scene, a.link) == _carrier(scene, b.link):
        rule = "a contact joins shapes that move against each other, not on one body"
        yield SceneProblem(f"{key}.b", contact.b, rule)
    elif a.geometry.kind == b.geometry.kind == "half_space":
        rule = "two half-spaces do not touch in points: one of the two must be bounded"
        yield SceneProblem(f"{key}.b", contact.b, rule)


def _law(key: str, contact: ContactPair) -> Iterator[SceneProblem]:
    """Yield a coefficient that the contact's law has not."""
    law, other = contact.law, "dissipation" if contact.law == "kelvin_voigt" else "damping"
    value = getattr(contact, other)
    if value:
        yield SceneProblem(f"{key}.{other}", value, f"must be 0 with the law {law}")


def _carrier(scene: SceneDocument, link: str) -> str:
    """Return the first link towards the world that a joint moves; ``world`` if none does."""
    links = {one.name: one for one in scene.links}
    for _ in scene.links:
        held = links.get(link)
        if held is None or not (held.joint.type == "fixed" or held.joint.locked):
            return link
        link = held.parent
    return link


def check_limits(scene: SceneDocument) -> None:
    """Refuse a scene whose own figures its nodes would refuse in messages.

    Without messages a scene may go beyond: its limits bound nothing else.

    Raises:
        SceneError: names each figure, its value and its limit.
    """
    problems = tuple(_broken(scene))
    if problems:
        raise SceneError(scene.name, problems)


def _broken(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Yield each figure whose messages the scene's own nodes would refuse."""
    device, joint = scene.device, scene.controller.joint_constraint
    figures = (
        ("device.force_limit", device.force_limit, "force"),
        ("device.torque_limit", device.torque_limit, "torque"),
        ("controller.joint_constraint.stiffness", joint.stiffness, "stiffness"),
        ("controller.joint_constraint.damping", joint.damping, "damping"),
    )
    speeds = (
        (f"initial_state.v.{name}", speed, "joint_velocity")
        for name, given in scene.initial_state.v.items()
        for speed in (given if isinstance(given, tuple) else (given,))
    )
    for key, value, name in (*figures, *speeds):
        most = getattr(scene.limits, name)
        if abs(value) > most:
            yield SceneProblem(key, value, f"must be at most limits.{name}, {most:g}, in size")


POSITION_SIZE = {
    "revolute": 1,
    "prismatic": 1,
    "fixed": 0,
    "spherical": 4,
    "free": 7,
    "planar": 4,
}
VELOCITY_SIZE = {
    "revolute": 1,
    "prismatic": 1,
    "fixed": 0,
    "spherical": 3,
    "free": 6,
    "planar": 3,
}
# Slice of the configuration vector that is a unit quaternion or (cos, sin) pair.
UNIT_PART = {"spherical": slice(0, 4), "free": slice(3, 7), "planar": slice(2, 4)}
UNIT_TOLERANCE = 1e-6
ALIGNMENT_TOLERANCE = 1e-9
IN_PLANE = "a planar scene moves in the world's x-y plane: "


def broken_rules(scene: SceneDocument) -> list[SceneProblem]:
    """Return every rule across values that ``scene`` breaks; an empty list if none."""
    return [
        *_names(scene),
        *_tree(scene),
        *_bodies(scene),
        *_references(scene),
        *_joint_elements(scene),
        *_couplings(scene),
        *_initial_state(scene),
        *_plane(scene),
        *_thresholds(scene),
        *broken_holding_rules(scene),
        *_hands(scene),
        *broken_contact_rules(scene),
    ]


def _names(scene: SceneDocument) -> Iterator[SceneProblem]:
    groups: tuple[tuple[str, Sequence[str]], ...] = (
        ("links[{}].name", [link.name for link in scene.links]),
        ("links[{}].joint.name", [link.joint.name for link in scene.links]),
        ("closures[{}].name", [closure.name for closure in scene.closures]),
        ("couplings[{}].name", [coupling.name for coupling in scene.couplings]),
        ("springs[{}].name", [spring.name for spring in scene.springs]),
        ("operational_points[{}].name", [point.name for point in scene.operational_points]),
    )
    yield from _names_twice(groups)
    for index, link in enumerate(scene.links):
        if link.name in {point.name for point in scene.operational_points}:
            rule = "must differ from the operational points' names: both name frames"
            yield SceneProblem(f"links[{index}].name", link.name, rule)
        if link.name == "world":
            yield SceneProblem(f"links[{index}].name", "world", "'world' is the fixed root")


def _tree(scene: SceneDocument) -> Iterator[SceneProblem]:
    known = {"world"}
    for index, link in enumerate(scene.links):
        if link.parent not in known:
            rule = f"parent must be 'world' or a link listed before, one of {listed(sorted(known))}"
            rule += nearest(link.parent, known)
            yield SceneProblem(f"links[{index}].parent", link.parent, rule)
        if link.parent == "world" and link.joint.type == "fixed":
            rule = "a link fixed to the world does not move: leave it out"
            yield SceneProblem(f"links[{index}].joint.type", "fixed", rule)
        known.add(link.name)


def _bodies(scene: SceneDocument) -> Iterator[SceneProblem]:
    for index, link in enumerate(scene.links):
        axis = np.linalg.norm(link.joint.axis)
        if link.joint.type in ("revolute", "prismatic") and abs(axis - 1.0) > UNIT_TOLERANCE:
            key = f"links[{index}].joint.axis"
            yield SceneProblem(key, link.joint.axis, "must be a unit vector")
        moments = np.linalg.eigvalsh(inertia_matrix(link.inertial.inertia))
        key = f"links[{index}].inertial.inertia"
        slack = 1e-9 * max(moments.max(), 0.0)
        if moments.min() < -slack:
            yield SceneProblem(key, moments.tolist(), "principal moments must not be negative")
        elif scene.task_space != "planar" and moments[0] + moments[1] < moments[2] - slack:
            rule = "each principal moment must not exceed the sum of the other two"
            yield SceneProblem(key, moments.tolist(), rule)
        if link.inertial.mass == 0.0 and moments.max() > 0.0:
            rule = "a link without mass cannot have rotational inertia"
            yield SceneProblem(f"links[{index}].inertial.mass", 0.0, rule)


def _references(scene: SceneDocument) -> Iterator[SceneProblem]:
    links = {link.name: link for link in scene.links}
    for index, closure in enumerate(scene.closures):
        yield from _ends(f"closures[{index}]", closure, links)
        if (closure.kind == "rod") != (closure.length is not None):
            rule = "a rod needs its length (m)" if closure.kind == "rod" else "only a rod has one"
            yield SceneProblem(f"closures[{index}].length", closure.length, rule)
        if closure.kind == "planar_pin" and scene.task_space != "planar":
            rule = "planar_pin needs task_space: planar; use spherical or revolute"
            yield SceneProblem(f"closures[{index}].kind", closure.kind, rule)
        if closure.active and closure.latch_distance is not None:
            rule = "only a closure with active: false can latch"
            yield SceneProblem(f"closures[{index}].latch_distance", closure.latch_distance, rule)
    for index, spring in enumerate(scene.springs):
        yield from _ends(f"springs[{index}]", spring, links)
    for index, point in enumerate(scene.operational_points):
        key = f"operational_points[{index}]"
        if point.link not in links:
            yield _unknown(f"{key}.link", "frame", point.link, links)
        elif point.metric is None and not has_own_metric(links[point.link]):
            rule = "the link has no full inertia of its own: give metric: {mass, length}"
            yield SceneProblem(f"{key}.metric", None, rule)


def _ends(key: str, part: Closure | Spring, links: Collection[str]) -> Iterator[SceneProblem]:
    """Yield problems of the two frames that a closure or spring joins."""
    for side, frame in (("a", part.a), ("b", part.b)):
        if frame.link not in links and frame.link != "world":
            yield _unknown(f"{key}.{side}.link", "frame", frame.link, links, "'world' or ")
    if part.a.link == part.b.link:
        rule = f"a {type(part).__name__.lower()} joins two different links"
        yield SceneProblem(f"{key}.b.link", part.b.link, rule)


def _joint_elements(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Springs, stops, friction and efforts are along the one coordinate of a joint."""
    for index, link in enumerate(scene.links):
        joint, key = link.joint, f"links[{index}].joint"
        if joint.type not in ("revolute", "prismatic"):
            given = {
                "stiffness": joint.stiffness,
                "friction": joint.friction,
                "effort": joint.effort,
            }
            if joint.limits is not None:
                given["limits"] = joint.limits.stiffness
            for field, value in given.items():
                if value:
                    rule = f"only revolute and prismatic joints have one, not {joint.type} ones"
                    yield SceneProblem(f"{key}.{field}", value, rule)
        if joint.armature and joint.type not in ("revolute", "prismatic", "spherical"):
            rule = f"only revolute, prismatic and spherical joints have one, not {joint.type} ones"
            yield SceneProblem(f"{key}.armature", joint.armature, rule)
        limits = joint.limits
        if limits is not None and limits.upper <= limits.lower:
            rule = f"must be above lower = {limits.lower}"
            yield SceneProblem(f"{key}.limits.upper", limits.upper, rule)
    if all(link.joint.locked or link.joint.type == "fixed" for link in scene.links):
        locked = [link.joint.name for link in scene.links if link.joint.locked]
        rule = "at least one joint must move"
        if locked:
            rule += f"; locked, as by stops without travel (lower = upper), are {', '.join(locked)}"
        yield SceneProblem("links", len(scene.links), rule)


def _couplings(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Couplings are between two joints that turn or slide."""
    joints = {link.joint.name: link.joint for link in scene.links}
    closures = {closure.name for closure in scene.closures}
    for index, coupling in enumerate(scene.couplings):
        key = f"couplings[{index}]"
        for end, name in (("joint", coupling.joint), ("leader", coupling.leader)):
            joint = joints.get(name)
            if joint is None:
                yield _unknown(f"{key}.{end}", "joint", name, joints)
            elif joint.type not in ("revolute", "prismatic") or joint.locked:
                kind = "locked" if joint.locked else joint.type
                rule = "only revolute and prismatic joints that are not locked can be coupled: "
                rule += f"joint {name!r} is {kind}"
                yield SceneProblem(f"{key}.{end}", name, rule)
        if coupling.joint == coupling.leader:
            yield SceneProblem(f"{key}.leader", coupling.leader, "must be another joint")
        if coupling.polycoef is not None:
            for old, place in (("offset", 0), ("ratio", 1)):
                if old in coupling.model_fields_set:
                    rule = f"leave it out beside polycoef, and write it as polycoef[{place}]"
                    yield SceneProblem(f"{key}.{old}", getattr(coupling, old), rule)
        if coupling.name in closures:
            yield SceneProblem(f"{key}.name", coupling.name, "must differ from closures' names")


def _initial_state(scene: SceneDocument) -> Iterator[SceneProblem]:
    joints = {link.joint.name: link.joint for link in scene.links}
    fields = (
        ("q", scene.initial_state.q, POSITION_SIZE),
        ("v", scene.initial_state.v, VELOCITY_SIZE),
    )
    for field, given, sizes in fields:
        for name, value in given.items():
            key = f"initial_state.{field}.{name}"
            if name not in joints:
                rule = (
                    f"unknown joint: must be one of {listed(sorted(joints))}{nearest(name, joints)}"
                )
                yield SceneProblem(key, value, rule)
                continue
            size = sizes[joints[name].type]
            length = len(value) if isinstance(value, tuple) else 1
            if length != size:
                rule = f"a {joints[name].type} joint takes {size} number(s) here"
                yield SceneProblem(key, value, rule)
            elif field == "q" and not _unit_part_ok(joints[name], value):
                rule = "the quaternion or (cos, sin) part must have unit length"
                yield SceneProblem(key, value, rule)
            elif field == "v" and joints[name].locked and np.any(value):
                rule = "a locked joint does not move: leave it out, or unlock the joint"
                yield SceneProblem(key, value, rule)


def _plane(scene: SceneDocument) -> Iterator[SceneProblem]:
    if scene.task_space != "planar":
        return
    rule = IN_PLANE
    for index, link in enumerate(scene.links):
        joint = link.joint
        key = f"links[{index}].joint"
        if joint.type in ("spherical", "free"):
            yield SceneProblem(f"{key}.type", joint.type, rule + "use a planar joint")
        if joint.type == "revolute" and abs(abs(joint.axis[2]) - 1.0) > ALIGNMENT_TOLERANCE:
            yield SceneProblem(f"{key}.axis", joint.axis, rule + "revolute axes are along z")
        if joint.type == "prismatic" and abs(joint.axis[2]) > ALIGNMENT_TOLERANCE:
            yield SceneProblem(f"{key}.axis", joint.axis, rule + "prismatic axes have no z part")
        if not _turns_about_z(joint.origin):
            yield SceneProblem(f"{key}.origin.rpy", joint.origin.rpy, rule + "roll = pitch = 0")
    if scene.gravity[2] != 0.0:
        yield SceneProblem("gravity[2]", scene.gravity[2], rule + "gravity has no z part")
    yield from _hand_in_plane(scene)


def _hand_in_plane(scene: SceneDocument) -> Iterator[SceneProblem]:
    for key, linear, angular in hand_vectors(scene):
        if linear[2] != 0.0 or angular[0] != 0.0 or angular[1] != 0.0:
            rule = f"{IN_PLANE}the hand has x, y and turns about z only"
            yield SceneProblem(key, (*linear, *angular), rule)


def _hands(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Yield problems of each of several hands, by the rules of a scene's own."""
    known, held = [point.name for point in scene.operational_points], set[str]()
    for index, entry in enumerate(scene.hands):
        key = f"hands[{index}]"
        if entry.point not in known:
            rule = (
                f"must be an operational point, one of {listed(known)}{nearest(entry.point, known)}"
            )
            yield SceneProblem(f"{key}.point", entry.point, rule)
        if entry.point in held:
            yield SceneProblem(f"{key}.point", entry.point, "each point can be held once")
        held.add(entry.point)
        own = scene.held_by(entry)
        problems = list(broken_holding_rules(own))
        if scene.task_space == "planar":
            problems += _hand_in_plane(own)
        given = {name for name in ("hand", "device") if getattr(entry, name) is not None}
        for problem in problems:
            # Problems of the scene's own hand or device are reported there.
            if problem.key_path.partition(".")[0].partition("[")[0] in given:
                yield SceneProblem(f"{key}.{problem.key_path}", problem.value, problem.rule)


def _thresholds(scene: SceneDocument) -> Iterator[SceneProblem]:
    perception = scene.perception
    if perception.s_on >= perception.s_off:
        rule = f"must be above s_on = {perception.s_on}"
        yield SceneProblem("perception.s_off", perception.s_off, rule)


def inertia_matrix(inertia: Inertia) -> np.ndarray:
    """Return the inertia (3, 3), kg m², about the centre of mass in the link's axes."""
    i = inertia
    return np.array([[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]])


def has_own_metric(link: Link) -> bool:
    """Return whether a link's own inertia can define the unit of each direction."""
    moments = np.linalg.eigvalsh(inertia_matrix(link.inertial.inertia))
    return link.inertial.mass > 0.0 and bool(moments.min() > 0.0)


def _turns_about_z(origin: Origin) -> bool:
    return abs(origin.rpy[0]) < ALIGNMENT_TOLERANCE and abs(origin.rpy[1]) < ALIGNMENT_TOLERANCE


def _unit_part_ok(joint: Joint, value: float | tuple[float, ...]) -> bool:
    part = UNIT_PART.get(joint.type)
    if part is None or not isinstance(value, tuple):
        return True
    return bool(abs(np.linalg.norm(value[part]) - 1.0) <= UNIT_TOLERANCE)
