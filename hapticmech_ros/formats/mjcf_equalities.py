# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Equalities of MJCF: connect and weld are closures, those of two joints or a tendon couplings.

One of a single joint locks it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats.mjcf_compiled import Compiled, pose
from hapticmech_ros.formats.model import Coupling, Joint, LoopJoint

Place = tuple[str, pin.SE3]
# rad or m, between two places that are one.
SAME = 1e-9
LOCK, FOLLOWS = "an equality without joint2", "follows a joint that is locked"
NOT_BACK = (
    "joint1 is locked, joint2 is not: in place of this equality, lock joint2 at its position by a"
    " joint equality without joint2"
)


class Equalities:
    """The equality constraints of a file.

    Args:
        compiled: the file.
        bodies: names of its bodies, by number.
        hinges: its joints, by number.

    Attributes:
        loop_joints: closures.
        couplings: of joints that are not locked.
        reasons: why joints are locked, by name.
        inactive: how many equalities of joints and tendons are off.

    Raises:
        SceneError: an equality that a scene has not.
    """

    def __init__(self, compiled: Compiled, bodies: Sequence[str], hinges: Sequence[Joint]) -> None:
        self._compiled, self._bodies, self._hinges = compiled, bodies, hinges
        self.loop_joints: list[LoopJoint] = []
        self.couplings: list[Coupling] = []
        self.reasons: dict[str, str] = {}
        self.inactive = 0
        stops = {hinge.name: hinge.limits for hinge in hinges if hinge.limits is not None}
        # Where joints are locked, by their stops or by equalities.
        self._held = {name: lower for name, (lower, upper) in stops.items() if lower == upper}
        # Of couplings.
        self._numbers: dict[str, int] = {}
        for number, (given, _, kind) in enumerate(compiled.elements["equality"]):
            self._read(number, given or f"{kind}{number}", kind)
        self._settle()

    def locked(self, hinge: Joint) -> Joint:
        """Return a joint; with stops that leave no travel if an equality locks it."""
        if hinge.name not in self.reasons:
            return hinge
        return replace(hinge, limits=(self._held[hinge.name],) * 2)

    def _read(self, number: int, name: str, kind: str) -> None:
        compiled, is_active = self._compiled, bool(self._compiled["eq_active0"][number])
        one, other = (int(compiled[f"eq_obj{k}id"][number]) for k in (1, 2))
        if kind in ("connect", "weld"):
            joint = "spherical" if kind == "connect" else "weld"
            ends = self._ends(number, kind, one, other)
            self.loop_joints.append(LoopJoint(name, joint, *ends, is_active))
        elif kind not in ("joint", "tendon"):
            raise self._error(number, kind, "an equality must be connect, weld, joint or tendon")
        elif not is_active:
            self.inactive += 1
        elif kind == "joint" and other < 0:
            joint, ref = self._drawn(one)
            self._lock(number, joint, ref + float(compiled["eq_data"][number][0]), LOCK)
        else:
            self._numbers[name] = number
            found = self._coupled if kind == "joint" else self._held_tendon
            self.couplings.append(found(number, name, one, other))

    def _error(self, number: int, value: object, rule: str) -> SceneError:
        return self._compiled.source.error(self._compiled.node("equality", number), value, rule)

    def _ends(self, number: int, kind: str, one: int, other: int) -> tuple[Place, Place]:
        """Return the frames that are one; MuJoCo has anchors where the file draws the bodies."""
        data = self._compiled["eq_data"][number]
        if self._compiled.said["by sites"][number]:
            return self._site(one), self._site(other)
        here, there = pin.SE3.Identity(), pin.SE3.Identity()
        if kind == "connect":
            here.translation, there.translation = data[:3], data[3:6]
        else:
            here = pose(data[3:6], data[6:10])
            here.translation = here.act(-data[:3])
        return (self._bodies[one], here), (self._bodies[other], there)

    def _site(self, number: int) -> Place:
        body = self._bodies[int(self._compiled["site_bodyid"][number])]
        return body, self._compiled.place("site", number)

    def _lock(self, number: int, joint: str, at: float, reason: str) -> None:
        before = self._held.setdefault(joint, at)
        if abs(before - at) > SAME:
            rule = f"{joint} is locked at {before:g} already: leave one of the two out"
            raise self._error(number, at, rule)
        self.reasons.setdefault(joint, reason)

    def _settle(self) -> None:
        """Lock joints that follow locked joints: no coupling is left there."""
        before = -1
        while before != len(self.couplings):
            before = len(self.couplings)
            for one in [one for one in self.couplings if one.leader in self._held]:
                self.couplings.remove(one)
                p = Polynomial(one.polycoef or (one.offset, one.ratio))
                at = float(p(self._held[one.leader]))
                self._lock(self._numbers[one.name], one.joint, at, FOLLOWS)
        for one in self.couplings:
            if one.joint in self._held:
                raise self._error(self._numbers[one.name], one.joint, NOT_BACK)

    def _coupled(self, number: int, name: str, one: int, other: int) -> Coupling:
        """Return q1 - ref1 = p(q2 - ref2) as q1 = a polynomial of q2."""
        joint, here = self._drawn(one)
        leader, there = self._drawn(other)
        offset, ratio, *bent = (float(x) for x in self._compiled["eq_data"][number][:5])
        if not any(bent):
            return Coupling(name, joint, leader, ratio, offset + here - ratio * there)
        moved = Polynomial((offset + here, ratio, *bent))(Polynomial((-there, 1.0)))
        coefficients = np.zeros(5)
        coefficients[: moved.coef.size] = moved.coef
        return Coupling(name, joint, leader, 0.0, 0.0, tuple(coefficients.tolist()))

    def _drawn(self, joint: int) -> tuple[str, float]:
        """Return the name of a hinge or slide, and its position where the file draws it."""
        at = int(self._compiled["jnt_qposadr"][joint])
        return self._hinges[joint].name, float(self._compiled["qpos0"][at])

    def _held_tendon(self, number: int, name: str, tendon: int, other: int) -> Coupling:
        """Return a tendon of two joints, a q_a + b q_b, that keeps the length it is drawn with."""
        compiled = self._compiled
        start, count = (int(compiled[f"tendon_{part}"][tendon]) for part in ("adr", "num"))
        parts = range(start, start + count)
        if other >= 0 or count != 2 or not all(compiled.said["of joints"][part] for part in parts):
            rule = "a tendon equality needs a fixed tendon of two joints, and no tendon2"
            raise self._error(number, compiled.names("tendon")[tendon], rule)
        (joint, here), (leader, there) = (
            self._drawn(int(compiled["wrap_objid"][part])) for part in parts
        )
        share, rest = (float(compiled["wrap_prm"][part]) for part in parts)
        if not share:
            raise self._error(number, 0.0, "coef must not be zero")
        ratio = -rest / share
        offset = here - ratio * there + float(compiled["eq_data"][number][0]) / share
        return Coupling(name, joint, leader, ratio, offset)
