# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiles an MJCF text by MuJoCo, in the child process that reads such files.

It loads little, as every reading of a file waits for it. MuJoCo resolves classes of defaults,
frames, replicas, orientations, angles and inertias. Before it compiles the description, this is
changed: meshes that no inertia comes from are left out, as their files may be missing; bodies stay
where the file has them; and joints without travel and bodies without mass, which MuJoCo refuses,
are accepted.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan
from pathlib import Path
from typing import Any

from hapticmech_ros.errors import FileError
from hapticmech_ros.files import check_file

MESH_SIZE_LIMIT = 200_000_000
# kg and kg m², in place of smaller values in bodies that move.
TINY = 1e-14
GIVE = "give the body an <inertial>"
# Arrays of a compiled model that are returned, a row an element.
ARRAYS = (
    *("body_parentid", "body_pos", "body_quat", "body_gravcomp"),
    *("body_mass", "body_inertia", "body_ipos", "body_iquat"),
    *("jnt_bodyid", "jnt_qposadr", "jnt_dofadr", "jnt_pos", "jnt_axis", "jnt_range"),
    *("jnt_limited", "jnt_stiffness", "jnt_stiffnesspoly", "qpos0", "qpos_spring"),
    *("dof_damping", "dof_dampingpoly", "dof_frictionloss", "dof_armature"),
    *("geom_bodyid", "geom_dataid", "geom_size", "geom_pos", "geom_quat", "mesh_pos", "mesh_quat"),
    *("geom_group", "geom_rgba", "geom_matid", "mat_rgba"),
    *("site_bodyid", "site_pos", "site_quat"),
    *("eq_obj1id", "eq_obj2id", "eq_active0", "eq_data"),
    *("tendon_adr", "tendon_num", "tendon_armature", "wrap_objid", "wrap_prm"),
    *("key_qpos", "key_qvel"),
)


def compiled(item: Mapping[str, str]) -> dict[str, Any]:
    """Return the compiled model of a text; or, under ``refused``, why MuJoCo refuses it.

    ``elements``: name, line and type of each, by kind, in the model's order. By their names
    ``ARRAYS``, in SI units and rad, poses in the parent body, quaternions w first. ``geoms``: type
    as written, mesh and whether it collides. ``rotors``: joint, gear and armature of actuators.
    ``moving``, ``bare``, ``locked``: numbers of bodies that joints move, of those without mass, and
    of joints without travel.

    Args:
        item: ``text``, and ``folder``, from which meshes are named.
    """
    import mujoco

    # It would write them into a file in the folder where a user happens to be.
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        spec = mujoco.MjSpec.from_string(item["text"])
        said = _Description(mujoco, spec, Path(item["folder"]))
        model = spec.compile()
    except ValueError as error:
        return {"refused": str(error)}
    elements = {
        "body": spec.bodies,
        "joint": spec.joints,
        "geom": spec.geoms,
        "site": spec.sites,
        "equality": spec.equalities,
        "tendon": spec.tendons,
        "key": spec.keys,
    }
    option = spec.option
    gravity = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    off = int(option.disableflags)
    return {
        **{name: getattr(model, name).tolist() for name in ARRAYS},
        **said.written,
        "elements": {
            kind: [[one.name, _line(one), _type(one)] for one in sorted(many, key=_number)]
            for kind, many in elements.items()
        },
        "geoms": [geom for _, geom in sorted(said.geoms, key=lambda one: _number(one[0]))],
        **{key: [one.id for one in many] for key, many in said.chosen.items()},
        "names": [name.decode(errors="replace") for name in model.names.split(b"\0")],
        "gravity": [0.0] * 3 if off & gravity else option.gravity.tolist(),
        "flag": (off & ~gravity).bit_count(),
        "fluid": bool(any(option.wind) or option.density or option.viscosity),
        "by sites": (model.eq_objtype == int(mujoco.mjtObj.mjOBJ_SITE)).tolist(),
        "of joints": (model.wrap_type == int(mujoco.mjtWrap.mjWRAP_JOINT)).tolist(),
        "mocap": int(model.nmocap),
    }


def _number(element: Any) -> int:
    return int(element.id)


def _line(element: Any) -> int:
    return int(element.info.rpartition(" ")[2] or 0)


def _type(element: Any) -> str:
    """Return the type of an element as it is written; empty for one that has none."""
    kind = getattr(element, "type", None)
    return "" if kind is None else str(kind.name).rpartition("_")[2].lower()


class _Description:
    """A description, changed in place, and its data that the compiled model lacks.

    Attributes:
        chosen: bodies that joints move, bodies without mass, joints without travel.
        geoms: each with its type as written, its mesh, and whether it collides.
        written: the rest, by name.
    """

    def __init__(self, mujoco: Any, spec: Any, folder: Path) -> None:
        self._mujoco, self._spec, self._compiler = mujoco, spec, spec.compiler
        self._compiler.fusestatic = self._compiler.discardvisual = False
        self.chosen: dict[str, list[Any]] = {"moving": [], "bare": [], "locked": []}
        self.geoms: list[tuple[Any, tuple[str, str, bool]]] = []
        meshes = {mesh.name or Path(mesh.file).stem: mesh for mesh in spec.meshes}
        self._folder, self._needed = folder, set[str]()
        self._files = {name: self._file(mesh.file) for name, mesh in meshes.items()}
        self.written: dict[str, Any] = {
            "align": 0,
            "rotors": [self._rotor(one) for one in spec.actuators if one.armature],
            "keys": [[len(one.qpos) > 0, len(one.qvel) > 0] for one in spec.keys],
            "referring": [_line(x) for x in (*spec.equalities, *spec.tendons, *spec.actuators)],
            "meshes": {name: self._mesh(name, mesh) for name, mesh in meshes.items()},
        }
        self._visit(spec.worldbody, moving=False)
        spec.strippath, spec.meshdir = False, ""
        for name, mesh in meshes.items():
            if name not in self._needed:
                spec.delete(mesh)
            elif mesh.file:
                mesh.file = str(folder / self._files[name])
        for actuator in list(spec.actuators):
            spec.delete(actuator)

    def _file(self, file: str) -> str:
        """Return a mesh's file from the folder of the main file; empty if it has none."""
        return file and str(
            Path(self._spec.meshdir) / (Path(file).name if self._spec.strippath else file)
        )

    def _mesh(self, name: str, mesh: Any) -> dict[str, Any]:
        numbers = {key: getattr(mesh, key).tolist() for key in ("scale", "refpos", "refquat")}
        return {"line": _line(mesh), "file": self._files[name], **numbers}

    def _rotor(self, actuator: Any) -> tuple[str, float, float]:
        kinds = self._mujoco.mjtTrn
        alone = actuator.trntype in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
        return actuator.target if alone else "", float(actuator.gear[0]), float(actuator.armature)

    def _visit(self, body: Any, moving: bool) -> None:
        """Change a body and all in it."""
        joints = list(body.joints)
        for joint in joints:
            self._joint(joint)
        if moving := moving or bool(joints):
            self.chosen["moving"].append(body)
        policy, policies = self._compiler.inertiafromgeom, self._mujoco.mjtInertiaFromGeom
        given = body.explicitinertial and policy != policies.mjINERTIAFROMGEOM_TRUE
        weighed = not given and policy != policies.mjINERTIAFROMGEOM_FALSE
        weight = False
        for geom in body.geoms:
            counts = weighed and self._counts(geom)
            weight |= counts
            self._geom(geom, counts and (moving or self._compiler.settotalmass > 0.0))
        if joints and not weight:
            self._raise(body, given)
        for child in body.bodies:
            self._visit(child, moving)

    def _counts(self, geom: Any) -> bool:
        """Return whether a geom adds to the inertia of its body, if that is that of its geoms."""
        first, last = self._compiler.inertiagrouprange
        weight = geom.density if isnan(geom.mass) else geom.mass
        return bool(first <= geom.group <= last and weight != 0.0)

    def _geom(self, geom: Any, needed: bool) -> None:
        """Leave the shape of a geom out if it is of a file that is not needed; it stays a place."""
        kind, mesh = _type(geom), geom.meshname
        self.geoms.append((geom, (kind, mesh, bool(geom.contype or geom.conaffinity))))
        if not mesh and kind not in ("mesh", "sdf", "hfield"):
            return
        # MuJoCo makes no hull of a geom that does not collide.
        geom.contype = geom.conaffinity = 0
        if needed and kind != "hfield":
            self._needed.add(mesh)
            self._check(mesh, geom)
            return
        geom.type = self._mujoco.mjtGeom.mjGEOM_SPHERE
        geom.meshname = geom.hfieldname = ""
        geom.size, geom.fromto, geom.mass = [1.0, 0.0, 0.0], [nan] * 6, 0.0

    def _check(self, mesh: str, geom: Any) -> None:
        """Refuse a mesh that is needed and no regular file: MuJoCo would wait for a pipe."""
        if mesh not in self._files:
            raise _refusal(f"mesh {mesh!r} not found: {GIVE}", geom)
        try:
            if self._files[mesh]:
                check_file(self._folder / self._files[mesh], MESH_SIZE_LIMIT)
        except FileError as error:
            raise _refusal(f"{error}: {GIVE}", geom) from None

    def _joint(self, joint: Any) -> None:
        """Keep a free body where it is, and a joint without travel in a range that MuJoCo takes."""
        kinds, limited = self._mujoco.mjtJoint, self._mujoco.mjtLimited
        if joint.type == kinds.mjJNT_FREE:
            always = joint.align == self._mujoco.mjtAlignFree.mjALIGNFREE_TRUE
            self.written["align"] += always
            joint.align = self._mujoco.mjtAlignFree.mjALIGNFREE_FALSE
        if joint.type in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE):
            lower, upper = joint.range
            if joint.limited == limited.mjLIMITED_AUTO and self._compiler.autolimits:
                if lower > upper:
                    raise _refusal("range[0] must not be above range[1]", joint)
                has_stops = lower == upper != 0.0
            else:
                has_stops = joint.limited == limited.mjLIMITED_TRUE and lower == upper
            if has_stops:
                self.chosen["locked"].append(joint)
                joint.limited, joint.range = limited.mjLIMITED_TRUE, (lower, lower + 1.0)

    def _raise(self, body: Any, given: bool) -> None:
        """Raise the mass and moments of a body that moves to MuJoCo's minimum."""
        full = given and not isnan(body.fullinertia[0])
        if given and body.mass > TINY and (full or min(body.inertia) > TINY):
            return
        self.chosen["bare"].append(body)
        if not given:
            body.explicitinertial, body.ipos = True, (0.0, 0.0, 0.0)
        body.mass = max(body.mass, TINY)
        if not full:
            body.inertia = [max(moment, TINY) for moment in body.inertia]


def _refusal(rule: str, element: Any) -> ValueError:
    """Return an error in the form that MuJoCo's have."""
    return ValueError(f"{rule}\nElement name '{element.name}', {element.info}")
