"""MJCF: the tree as Pinocchio reads it, and the equalities that close its loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import WORLD, Body, Coupling, Hinge, Model, Note, Point, Tie
from hapticmech_ros.formats.xml_nodes import Node, Source, written

SHAPE = "say shapes and contacts in a scene file"
WHY = {
    "geom": f"its inertia is taken where the file says so; {SHAPE}",
    "actuator": "nothing drives a joint but the hand and what the scene says",
    "sensor": "nothing is sensed but poses and wrenches",
    "tendon": "say springs between two frames in a scene file",
    "contact": SHAPE,
    "keyframe": "say initial_state in a scene file",
    "deformable": "bodies are rigid",
    "camera": "pictures are drawn from the joints",
    "light": "pictures are drawn from the joints",
    "joint armature": "say the rotor's inertia in that of the link",
    "equality solref or solimp": "loops are closed exactly",
}
IGNORED = ("actuator", "sensor", "tendon", "contact", "keyframe", "deformable")
SOFT = ("solref", "solimp")
# The body that is the world, in what Pinocchio is given.
BASE = "hapticmech_world"


def read_mjcf(source: Source) -> Model:
    """Read an MJCF file.

    Raises:
        SceneError: it breaks a rule, or Pinocchio cannot read it.
    """
    _refuse_includes(source)
    try:
        tree = _tree(source)
    except (ValueError, RuntimeError, KeyError, IndexError, TypeError) as error:
        raise source.error(source.root, str(error), "Pinocchio cannot read it") from None
    if not np.isfinite([inertia.mass for inertia in tree.inertias]).all():
        raise source.error(source.root, "mass", "masses must be finite")
    notes = _notes(source, tree)
    bodies, hinges = _bodies(tree), list(_hinges(source, tree))
    places = _places(tree)
    equalities = _Equalities(source, tree, places)
    equalities.read()
    gravity = tuple(float(value) for value in tree.gravity.linear)
    return Model(
        source.root.attributes.get("model") or source.path.stem,
        bodies,
        hinges,
        equalities.ties,
        equalities.couplings,
        [Point(name, *place) for name, place in places.items() if name not in bodies],
        (gravity[0], gravity[1], gravity[2]),
        notes=notes,
    )


def _tree(source: Source) -> pin.Model:
    """Return what Pinocchio reads, which is the first body of the world and what that carries.

    So it is given a file in which one body, fixed to the world, carries all others.
    """
    root = source.root
    world = root.first("worldbody")
    if world is None:
        raise source.error(root, None, "needs a <worldbody>")
    own = root.first("compiler")
    given = dict(own.attributes) if own is not None else {}
    for key in ("meshdir", "texturedir", "assetdir"):
        if key in given or key == "meshdir":
            given[key] = str((source.path.parent / given.get(key, "")).resolve())
    everything = Node("body", {"name": BASE}, world.line, world.children)
    kept = [node for node in root.children if node.tag in ("default", "option", "asset", "size")]
    compiler = Node("compiler", given, root.line)
    whole = Node(
        root.tag,
        root.attributes,
        root.line,
        [compiler, *kept, Node(world.tag, {}, world.line, [everything])],
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(written(whole), encoding="utf-8")
        return pin.buildModelFromMJCF(str(path))


def _refuse_includes(source: Source) -> None:
    for node in source.root.walk():
        if node.tag == "include":
            rule = "includes are not followed: give the file that has the bodies"
            raise source.error(node, node.attributes.get("file"), rule)


def _notes(source: Source, tree: pin.Model) -> list[Note]:
    counts: Counter[str] = Counter()
    for node in source.root.children:
        if node.tag in IGNORED:
            counts[node.tag] += max(len(node.children), 1)
    world = source.root.first("worldbody")
    for node in world.walk() if world is not None else ():
        if node.tag in ("geom", "camera", "light"):
            counts[node.tag] += 1
    armature = int(np.count_nonzero(tree.armature))
    if armature:
        counts["joint armature"] = armature
    for equality in source.root.all("equality"):
        for node in equality.children:
            counts["equality solref or solimp"] += any(key in node.attributes for key in SOFT)
    return [Note(what, count, WHY[what]) for what, count in counts.items() if count]


def _body_name(tree: pin.Model, joint: int) -> str:
    """Return the body that a joint of Pinocchio carries."""
    if joint == 0:
        return WORLD
    for frame in tree.frames:
        carried = frame.type == pin.FrameType.BODY and frame.parentJoint == joint
        if carried and frame.placement.isIdentity(0.0):
            return str(frame.name)
    return f"{tree.names[joint]}_body"


def _bodies(tree: pin.Model) -> dict[str, Body]:
    found = {}
    for joint in range(1, tree.njoints):
        inertia = tree.inertias[joint]
        body = Body(
            _body_name(tree, joint),
            float(inertia.mass),
            np.array(inertia.lever),
            np.array(inertia.inertia),
        )
        found[body.name] = body
        for step in range(len(_parts(tree, joint)) - 1):
            found[f"{body.name}_{step}"] = Body(f"{body.name}_{step}")
    return found


def _parts(tree: pin.Model, joint: int) -> Sequence[tuple[pin.JointModel, pin.SE3]]:
    """Return the joints in a body, one after the other, each where it is in the one before."""
    shape = tree.joints[joint]
    if shape.shortname() != "JointModelComposite":
        return [(shape, tree.jointPlacements[joint])]
    composite = shape.extract()
    inner, places = list(composite.joints), list(composite.jointPlacements)
    places[0] = tree.jointPlacements[joint] * places[0]
    return list(zip(inner, places, strict=True))


def _hinges(source: Source, tree: pin.Model) -> Iterator[Hinge]:
    names = _joint_names(source)
    for joint in range(1, tree.njoints):
        parts = _parts(tree, joint)
        body = _body_name(tree, joint)
        own = names.get(body, [])
        if len(own) != len(parts):
            own = [f"{tree.names[joint]}_{k}" for k in range(len(parts))]
            own = [str(tree.names[joint])] if len(parts) == 1 else own
        parent, at = _body_name(tree, tree.parents[joint]), tree.joints[joint].idx_v
        q_at = tree.joints[joint].idx_q
        for step, (shape, place) in enumerate(parts):
            last = step == len(parts) - 1
            child = body if last else f"{body}_{step}"
            kind, axis = _kind(source, shape)
            scalar = kind in ("revolute", "prismatic")
            limits = None
            if scalar:
                lower = float(tree.lowerPositionLimit[q_at])
                upper = float(tree.upperPositionLimit[q_at])
                if np.isfinite((lower, upper)).all() and lower < upper:
                    limits = (lower, upper)
            yield Hinge(
                own[step],
                kind,
                parent,
                child,
                place,
                axis=axis,
                damping=float(tree.damping[at]),
                friction=float(tree.upperDryFrictionLimit[at]) if scalar else 0.0,
                limits=limits,
            )
            parent, at, q_at = child, at + shape.nv, q_at + shape.nq


def _kind(source: Source, shape: pin.JointModel) -> tuple[str, np.ndarray]:
    """Return the type of a joint of Pinocchio, and its axis."""
    if shape.nv == 1 and shape.nq == 1:
        data = shape.createData()
        shape.calc(data, np.zeros(shape.nq), np.zeros(shape.nv))
        column = np.asarray(data.S).reshape(6)
        if np.any(column[3:]):
            return "revolute", column[3:].copy()
        return "prismatic", column[:3].copy()
    up = np.array((0.0, 0.0, 1.0))
    if shape.shortname() == "JointModelSpherical":
        return "spherical", up
    if shape.shortname() == "JointModelFreeFlyer":
        return "free", up
    raise source.error(source.root, shape.shortname(), "a kind of joint that scenes do not have")


def _joint_names(source: Source) -> dict[str, list[str]]:
    """Return the joints that the file names, by body."""
    found = {}
    for node in source.root.walk():
        if node.tag == "body" and "name" in node.attributes:
            joints = [n for n in node.children if n.tag in ("joint", "freejoint")]
            names = [joint.attributes.get("name", "") for joint in joints]
            if all(names):
                found[node.attributes["name"]] = names
    return found


def _places(tree: pin.Model) -> dict[str, tuple[str, pin.SE3]]:
    """Return frames that the file names: the body of a joint, or the world, and where in it."""
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    return {
        str(frame.name): (_body_name(tree, frame.parentJoint), frame.placement)
        for frame in tree.frames
        if frame.type in kinds and frame.name != BASE
    }


@dataclass
class _Equalities:
    """The equality constraints of a file, as closures and couplings."""

    source: Source
    tree: pin.Model
    places: dict[str, tuple[str, pin.SE3]]
    ties: list[Tie] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)

    def read(self) -> None:
        """Read them all."""
        data = self.tree.createData()
        pin.framesForwardKinematics(self.tree, data, pin.neutral(self.tree))
        self._poses = {str(f.name): data.oMf[i] for i, f in enumerate(self.tree.frames)}
        for equality in self.source.root.all("equality"):
            for count, node in enumerate(equality.children):
                name = node.attributes.get("name") or f"{node.tag}{count}"
                if node.tag == "connect":
                    self._connect(node, name)
                elif node.tag == "weld":
                    self._weld(node, name)
                elif node.tag == "joint":
                    self._joint(node, name)
                else:
                    rule = "an equality must be connect, weld or joint"
                    raise self.source.error(node, node.tag, rule)

    def _ends(self, node: Node) -> tuple[str, str]:
        if "site1" in node.attributes:
            names = [self.source.text(node, key) for key in ("site1", "site2")]
        else:
            names = [self.source.text(node, "body1"), node.attributes.get("body2", WORLD)]
        for name in names:
            if name != WORLD and name not in self.places:
                raise self.source.error(node, name, "no such body or site")
        return names[0], names[1]

    def _pose(self, name: str) -> pin.SE3:
        return pin.SE3.Identity() if name == WORLD else self._poses[name]

    def _end(self, name: str, place: pin.SE3) -> tuple[str, pin.SE3]:
        """Return a frame of the file's body or site as one of the body that carries it."""
        if name == WORLD:
            return WORLD, place
        body, own = self.places[name]
        return body, own * place

    def _connect(self, node: Node, name: str) -> None:
        one, other = self._ends(node)
        anchor = pin.SE3.Identity()
        anchor.translation = np.array(self.source.values(node, "anchor", (0.0, 0.0, 0.0)))
        there = pin.SE3.Identity()
        if "site1" not in node.attributes:
            point = self._pose(one).act(anchor.translation)
            there.translation = self._pose(other).actInv(point)
        self._add(Tie(name, "spherical", self._end(one, anchor), self._end(other, there)), node)

    def _weld(self, node: Node, name: str) -> None:
        one, other = self._ends(node)
        relative = self._pose(one).actInv(self._pose(other))
        given = self.source.values(node, "relpose", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        if "site1" in node.attributes:
            relative = pin.SE3.Identity()
        elif any(given[3:]):
            w, x, y, z = given[3:]
            turn = pin.Quaternion(w, x, y, z)
            turn.normalize()
            relative = pin.SE3(turn.matrix(), np.array(given[:3]))
        self._add(
            Tie(name, "weld", self._end(one, relative), self._end(other, pin.SE3.Identity())), node
        )

    def _joint(self, node: Node, name: str) -> None:
        joint = self.source.text(node, "joint1")
        leader = node.attributes.get("joint2", "")
        offset, ratio, *bent = self.source.values(node, "polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader or any(bent):
            rule = "a joint equality needs joint2 and a straight line: polycoef='a b 0 0 0'"
            raise self.source.error(node, node.attributes.get("polycoef"), rule)
        if node.attributes.get("active", "true") == "true":
            self.couplings.append(Coupling(name, joint, leader, ratio, offset))

    def _add(self, tie: Tie, node: Node) -> None:
        active = node.attributes.get("active", "true") == "true"
        self.ties.append(tie if active else Tie(tie.name, tie.kind, tie.a, tie.b, False))
