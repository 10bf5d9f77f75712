# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanisms whose motion through a crossing of branches is one equation for one angle.

Each has its crossing at angle 0. None has gravity. What they have in common is ``passed``.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev

from benchmarks.accuracy.n_four_bar import document as windows
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import MechanismState, Simulator
from oracles.generator import blank
from oracles.jacobians import Jacobians
from oracles.kinematics import Array, Document, rotation_of_rpy
from oracles.planar_linkages import chain, pin_end
from oracles.running import with_start, wrenches_on
from oracles.touching import pair, shape

# rad/s, at the crossing.
SPEED = 5.0
# Motions are known within so many rad of the crossing, by a polynomial of so high a degree.
AROUND, DEGREE, ROUNDS = 0.4, 40, 6
# What is simulated for comparison has steps that are so many times shorter.
FINER = 20
# Steps before the sample at the crossing, and after it.
BEFORE, AFTER = 3, 6
# Scenes start here, rad, where closures are well determined.
AWAY = 0.3
# A rule's own error is that of as many steps around here, on both sides: the longest steps neither
# come near the crossing nor leave what is known of a motion.
APART = 0.2


class Step(NamedTuple):
    """What steps a mechanism: s, the name of a rule, and how often it is done in a period."""

    period: float
    integrator: str
    substeps: int = 1


class Mechanism:
    """One of them: without forces, unless it says otherwise."""

    def document(self) -> Document:
        """Return its document, which starts at ``AWAY``."""
        raise NotImplementedError

    def configuration(self, angle: float) -> Array:
        """Return q (nq,) at an angle (rad)."""
        raise NotImplementedError

    def slope(self, angle: float) -> Array:
        """Return dq / d angle (nv,)."""
        raise NotImplementedError

    def inertia(self, angle: float) -> float:
        """Return M of the angle, kg m²."""
        raise NotImplementedError

    def held(self, q: Array) -> float:
        """Return what contacts hold at q, J."""
        return 0.0

    @cached_property
    def _root(self) -> Chebyshev:
        """√M of the angle."""
        roots = np.vectorize(lambda angle: np.sqrt(self.inertia(angle)))
        return Chebyshev.interpolate(roots, DEGREE, (-AROUND, AROUND))

    @cached_property
    def _way(self) -> Chebyshev:
        """Its integral from 0 on, which grows evenly."""
        return self._root.integ(lbnd=0.0)

    def motion(self, angle: float, speed: float, times: Array) -> tuple[Array, Array]:
        """Return angle and speed at times (s) from a start (rad, rad/s): √M u̇ is constant."""
        root, way = self._root, self._way
        constant = float(root(angle)) * speed
        reached, angles = way(angle) + constant * times, angle + speed * times
        for _ in range(ROUNDS):
            angles = angles - (way(angles) - reached) / root(angles)
        return angles, constant / root(angles)

    def own_error(self, distance: float, step: Step) -> tuple[float, float]:
        """Return the errors of a rule and a step as such, as :class:`Passed` has them."""
        return _away(self, step)

    def start(self, distance: float, before: int, step: Step) -> tuple[float, float]:
        """Return angle and speed from which so many steps lead to ``distance`` (rad)."""
        back = self.motion(distance, -SPEED, np.array([before * step.period]))
        return float(back[0][0]), -float(back[1][0])

    def samples(self, angle: float, speed: float, steps: int, step: Step) -> tuple[Array, Array]:
        """Return angle and speed (steps + 1,) at samples of a motion from a start."""
        return self.motion(angle, speed, step.period * np.arange(steps + 1.0))


class Parallelograms(Mechanism):
    """A row of parallelograms of uniform rods, 1 kg and 1 m: all uprights at one angle.

    Args:
        count: how many.
        stiffness: of a spring in the first upright's joint, N m/rad, slack at ``rest`` (rad).
        rest: of that spring.
    """

    def __init__(self, count: int, stiffness: float = 0.0, rest: float = 0.0) -> None:
        self.count, self._stiffness, self._rest = count, stiffness, rest

    def document(self) -> Document:
        """Return its document."""
        found = windows(self.count)
        found["links"][0]["joint"] |= {"stiffness": self._stiffness, "rest": self._rest}
        uprights = {f"j_upright{k}": AWAY for k in range(self.count + 1)}
        q = uprights | {f"j_top{k}": -AWAY for k in range(self.count)}
        return found | {"gravity": [0.0, 0.0, 0.0], "initial_state": {"q": q}}

    def configuration(self, angle: float) -> Array:
        """Return q."""
        return np.array([angle, -angle] * self.count + [angle])

    def slope(self, angle: float) -> Array:
        """Return dq / d angle."""
        return self.configuration(1.0)

    def inertia(self, angle: float = 0.0) -> float:
        """Return M: uprights turn, tops move along a circle."""
        return (self.count + 1.0) / 3.0 + self.count

    def motion(self, angle: float, speed: float, times: Array) -> tuple[Array, Array]:
        """Return angle and speed: even, or a spring's."""
        if not self._stiffness:
            return angle + speed * times, np.full(times.size, speed)
        omega = np.sqrt(self._stiffness / self.inertia())
        away, cosine, sine = angle - self._rest, np.cos(omega * times), np.sin(omega * times)
        return (
            self._rest + away * cosine + speed / omega * sine,
            speed * cosine - omega * away * sine,
        )


class BesideFast(Parallelograms):
    """A parallelogram, and a balanced wheel that turns so many times as fast, evenly as it does.

    Args:
        times: by how much the wheel is faster.
        carried: whether its axle is on the link that moves, rather than beside the parallelogram.
    """

    mass, _moment = 0.1, 1e-5

    def __init__(self, times: float, carried: bool) -> None:
        super().__init__(1)
        self._times, self._carried = times, carried

    def document(self) -> Document:
        """Return its document."""
        found = super().document()
        inertia = dict.fromkeys(("ixx", "iyy", "izz"), self._moment)
        origin = {"xyz": [0.4, 0.0, 0.0] if self._carried else [0.0, 3.0, 0.0]}
        wheel = {
            "name": "wheel",
            "parent": "top0" if self._carried else "world",
            "joint": {"name": "axle", "type": "revolute", "origin": origin},
            "inertial": {"mass": self.mass, "com": [0.0, 0.0, 0.0], "inertia": inertia},
        }
        found["links"].append(wheel)
        found["initial_state"]["q"]["axle"] = self._times * AWAY
        return found

    def configuration(self, angle: float) -> Array:
        """Return q, depth first."""
        plain = super().configuration(angle)
        return np.insert(plain, 2 if self._carried else 3, self._times * angle)

    def inertia(self, angle: float = 0.0) -> float:
        """Return M."""
        carried = self.mass if self._carried else 0.0
        return super().inertia(angle) + carried + self._moment * self._times**2


class OnFloor(Parallelograms):
    """Parallelograms whose first upright's tip is in a floor below it, with friction.

    The motion is that of one link of the same inertia with the same contact, by short steps of rk4:
    a body of one joint, which has no branches. The first tip goes along the same circle.

    Args:
        count: how many.
        depth: of the tip's contact at the crossing, m.
        stiffness: of the contact, N/m.
    """

    _law: ClassVar[dict[str, float]] = {"damping": 0.3, "friction": 0.3}
    _radius = 0.05

    def __init__(self, count: int, depth: float, stiffness: float) -> None:
        super().__init__(count)
        self._depth, self._pressed = depth, stiffness

    def document(self) -> Document:
        """Return its document."""
        return super().document() | self._touching("upright0")

    def held(self, q: Array) -> float:
        """Return what the contact holds, J."""
        return 0.5 * self._pressed * max(0.0, self._depth - np.sin(q[0])) ** 2

    def start(self, distance: float, before: int, step: Step) -> tuple[float, float]:
        """Return angle and speed, found by secants, for the rule's own motion."""
        angles = [distance - SPEED * before * step.period * share for share in (1.0, 1.001)]
        off = [self._alone(a, before, step) - distance for a in angles]
        while abs(off[1]) > 1e-15 and off[1] != off[0]:
            better = angles[1] - off[1] * (angles[1] - angles[0]) / (off[1] - off[0])
            angles = [angles[1], better]
            off = [off[1], self._alone(better, before, step) - distance]
            if abs(off[1]) >= abs(off[0]):
                break
        return angles[int(abs(off[1]) < abs(off[0]))], SPEED

    def samples(self, angle: float, speed: float, steps: int, step: Step) -> tuple[Array, Array]:
        """Return angle and speed of the single link, by shorter steps."""
        exact = step._replace(integrator="rk4", substeps=FINER)
        states = _run(self._single, exact, np.array([angle]), np.array([speed]), steps)
        return np.array([s.q[0] for s in states]), np.array([s.v[0] for s in states])

    def own_error(self, distance: float, step: Step) -> tuple[float, float]:
        """Return the errors of the single link: larger ones of the same phase and of another."""
        found = [self._own_error(at, step) for at in (distance, SPEED * step.period / 3.0)]
        return max(one[0] for one in found), max(one[1] for one in found)

    def _own_error(self, distance: float, step: Step) -> tuple[float, float]:
        angle, speed = self.start(distance, BEFORE, step)
        found = _run(self._single, step, np.array([angle]), np.array([speed]), BEFORE + AFTER)
        angles, speeds = self.samples(angle, speed, BEFORE + AFTER, step)
        wanted = self._energy(angles, speeds)
        ours = [np.array([one[0] for one in (s.q, s.v)]) for s in found]
        reached, rates = np.array(ours).T
        lost = np.abs(self._energy(reached, rates) - wanted).max() / wanted[0]
        return float(lost), float(np.abs(reached - angles).max())

    def _energy(self, angles: Array, speeds: Array) -> Array:
        """Return kinetic energy and that of the contact, J."""
        held = np.array([self.held(np.array([angle])) for angle in angles])
        return np.asarray(0.5 * self.inertia() * speeds**2 + held)

    def apart_from_one_link(self, distance: float, period: float) -> float:
        """Return the largest difference (rad) from the single link by the same steps of rk4."""
        step = Step(period, "rk4")
        angle, speed = self.start(distance, BEFORE, step)
        begun = self.configuration(angle), speed * self.slope(angle)
        ours = _run(self, step, *begun, BEFORE + AFTER)
        theirs = _run(self._single, step, begun[0][:1], begun[1][:1], BEFORE + AFTER)
        return max(abs(a.q[0] - b.q[0]) for a, b in zip(ours, theirs, strict=True))

    def _alone(self, angle: float, steps: int, step: Step) -> float:
        """Return where the single link is after so many steps by the same rule, rad."""
        return float(_run(self._single, step, np.array([angle]), np.array([SPEED]), steps)[-1].q[0])

    @cached_property
    def _single(self) -> Single:
        return Single(self.inertia(), self._touching("arm"))

    def _touching(self, link: str) -> Document:
        floor = shape("world", {"kind": "half_space"}, name="floor")
        # Its normal is its z axis.
        floor["origin"] = {
            "xyz": [0.0, self._depth - self._radius, 0.0],
            "rpy": [-np.pi / 2.0, 0.0, 0.0],
        }
        tip = shape(link, {"kind": "sphere", "radius": self._radius}, name="tip")
        tip["origin"] = {"xyz": [1.0, 0.0, 0.0]}
        law = pair("tip", "floor", self._pressed, **self._law)
        return {"shapes": [floor, tip], "contacts": [law]}


class Single:
    """A link on a joint in the origin.

    Args:
        inertia: about the joint, kg m².
        touching: shapes and contacts.
    """

    def __init__(self, inertia: float, touching: Document) -> None:
        self._inertia, self._touching = inertia, touching

    def document(self) -> Document:
        """Return its document."""
        found = chain(np.ones(1), np.ones(1), np.ones(1))
        moments = dict.fromkeys(("ixx", "iyy", "izz"), self._inertia)
        link = {"name": "arm", "inertial": {"mass": 1.0, "com": [0.0] * 3, "inertia": moments}}
        found["links"] = [found["links"][0] | link]
        found["operational_points"] = [{"name": "end", "link": "arm"}]
        return found | self._touching


class Rhombus(Mechanism):
    """Three bars of equal length, and the ground as the fourth: three branches cross in line."""

    def document(self) -> Document:
        """Return its document."""
        masses = np.array([1.0, 2.0, 0.7])
        found = pin_end(chain(np.ones(3), masses, masses / 12.0), np.array([1.0, 0.0]))
        return with_start(found, self.configuration(AWAY))

    def configuration(self, angle: float) -> Array:
        """Return q."""
        return np.array([angle, -angle, angle + np.pi])

    def slope(self, angle: float) -> Array:
        """Return dq / d angle."""
        return np.array([1.0, -1.0, 1.0])

    def inertia(self, angle: float) -> float:
        """Return M: the same at all angles, so that it does not matter."""
        return 1.0


class Linkage(Mechanism):
    """One whose inertia is that of a tree in plain NumPy."""

    def inertia(self, angle: float) -> float:
        """Return M."""
        along = self.slope(angle)
        return float(
            along @ Jacobians(self.document(), self.configuration(angle)).inertia() @ along
        )


class SliderCrank(Linkage):
    """A crank and a rod of equal length: where the slider is at the crank's pivot, both may turn as
    one. The angle is θ − π/2, of the crank's θ."""

    def document(self) -> Document:
        """Return its document."""
        found = chain(np.ones(2), np.array([1.0, 0.8]), np.array([1.0, 0.8]) / 12.0)
        rail = {"name": "rail", "type": "prismatic", "axis": [1.0, 0.0, 0.0]}
        inertia = {"ixx": 0.1, "iyy": 0.1, "izz": 0.1}
        found["links"].append(
            {
                "name": "slider",
                "parent": "world",
                "joint": rail,
                "inertial": {"mass": 0.5, "com": [0.0, 0.0, 0.0], "inertia": inertia},
            }
        )
        ends = {"a": {"link": "link2", "origin": {"xyz": [1.0, 0.0, 0.0]}}, "b": {"link": "slider"}}
        found["closures"] = [{"name": "pin", "kind": "planar_pin"} | ends]
        return with_start(found, self.configuration(AWAY))

    def configuration(self, angle: float) -> Array:
        """Return q."""
        theta = angle + np.pi / 2.0
        return np.array([theta, -2.0 * theta, 2.0 * np.cos(theta)])

    def slope(self, angle: float) -> Array:
        """Return dq / d angle."""
        return np.array([1.0, -2.0, -2.0 * np.sin(angle + np.pi / 2.0)])


class SphericalParallelogram(Linkage):
    """Four hinges whose axes meet in a point, opposite arcs alike: flat at 0, where two branches
    cross. By Napier's analogies the half tangents of its angles keep their ratio."""

    crank, ground = 0.7, 1.0

    def document(self) -> Document:
        """Return its document."""
        found = blank()
        for name, parent, at, arc, mass in (
            ("crank", "world", 0.0, self.crank, 1.0),
            ("coupler", "crank", self.crank, self.ground, 0.8),
            ("follower", "world", self.ground, self.crank, 0.6),
        ):
            joint = {"name": f"of_{name}", "type": "revolute", "origin": _arc(at)}
            middle = 0.5 * rotation_of_rpy(_arc(0.5 * arc)["rpy"])[:, 2]
            inertial = {
                "mass": mass,
                "com": [float(x) for x in middle],
                "inertia": dict.fromkeys(("ixx", "iyy", "izz"), 0.02 * mass),
            }
            link = {"name": name, "parent": parent, "joint": joint, "inertial": inertial}
            found["links"].append(link)
        ends = {
            "a": {"link": "coupler", "origin": _arc(self.ground)},
            "b": {"link": "follower", "origin": _arc(self.crank)},
        }
        found["closures"] = [{"name": "hinge", "kind": "revolute"} | ends]
        found["operational_points"] = [{"name": "held", "link": "coupler"}]
        return with_start(found, self.configuration(AWAY))

    def configuration(self, angle: float) -> Array:
        """Return q."""
        other = 2.0 * np.arctan(self._ratio * np.tan(0.5 * angle))
        return np.array([angle, -other, other])

    def slope(self, angle: float) -> Array:
        """Return dq / d angle."""
        tangent, ratio = np.tan(0.5 * angle), self._ratio
        grows = ratio * (1.0 + tangent**2) / (1.0 + (ratio * tangent) ** 2)
        return np.array([1.0, -grows, grows])

    @property
    def _ratio(self) -> float:
        half, apart = 0.5 * (self.crank + self.ground), 0.5 * (self.crank - self.ground)
        return float(np.cos(half) / np.cos(apart))


class Bricard(Linkage):
    """Bricard's mechanism with threefold symmetry, twists of 60° and 1 m from hinge to hinge.

    Hinges 1, 3, 5 are at π + x and 2, 4, 6 at π + y. With half tangents x, y its closure (Chen, You
    and Tarnai 2005) is 3 x² y² - x² - y² - 4 x y = 0: two branches cross where all are folded.
    """

    twist = np.pi / 3.0

    def document(self) -> Document:
        """Return its document; the sixth link is the ground."""
        found = blank()
        for k in range(5):
            joint = {"name": f"hinge{k + 1}", "type": "revolute"}
            if k:
                joint["origin"] = self._beyond(k - 1)
            inertia = {"ixx": 0.01, "iyy": 1.0 / 12.0, "izz": 1.0 / 12.0}
            inertial = {"mass": 1.0 + 0.1 * k, "com": [0.5, 0.0, 0.0], "inertia": inertia}
            link = {"name": f"rod{k + 1}", "joint": joint, "inertial": inertial}
            found["links"].append(link | {"parent": f"rod{k}" if k else "world"})
        back = self._beyond(5)
        axes = rotation_of_rpy(back["rpy"]).T
        sixth = {
            "xyz": [float(x) for x in -axes @ np.array(back["xyz"])],
            "rpy": [-back["rpy"][0], 0.0, 0.0],
        }
        ends = {
            "a": {"link": "rod5", "origin": self._beyond(4)},
            "b": {"link": "world", "origin": sixth},
        }
        found["closures"] = [{"name": "hinge6", "kind": "revolute"} | ends]
        found["operational_points"] = [{"name": "held", "link": "rod3"}]
        return with_start(found, self.configuration(AWAY))

    def configuration(self, angle: float) -> Array:
        """Return q."""
        x = np.tan(0.5 * angle)
        root = np.sqrt(3.0 + 3.0 * x**2)
        even = np.pi + 2.0 * np.arctan(x * (2.0 - root) / (3.0 * x**2 - 1.0))
        odd = np.pi + angle
        return np.array([odd, even, odd, even, odd])

    def slope(self, angle: float) -> Array:
        """Return dq / d angle."""
        x = np.tan(0.5 * angle)
        root, under = np.sqrt(3.0 + 3.0 * x**2), 3.0 * x**2 - 1.0
        y = x * (2.0 - root) / under
        # d y / d x, by the quotient's rule.
        over = (2.0 - root) - 3.0 * x**2 / root
        steep = (over * under - x * (2.0 - root) * 6.0 * x) / under**2
        even = steep * (1.0 + x**2) / (1.0 + y**2)
        return np.array([1.0, even, 1.0, even, 1.0])

    def _beyond(self, k: int) -> Document:
        """Return the next hinge in the link after hinge k."""
        return {"xyz": [1.0, 0.0, 0.0], "rpy": [self.twist * (-1.0) ** k, 0.0, 0.0]}


MECHANISMS = {
    "one parallelogram": Parallelograms(1),
    "two parallelograms": Parallelograms(2),
    "five parallelograms": Parallelograms(5),
    "twenty parallelograms": Parallelograms(20),
    "two parallelograms with a spring": Parallelograms(2, stiffness=300.0, rest=0.5),
    "parallelogram beside a spinner": BesideFast(60.0, carried=False),
    "parallelogram with a flywheel": BesideFast(200.0, carried=True),
    "parallelogram pressed into a floor": OnFloor(1, depth=0.3, stiffness=500.0),
    "two parallelograms that leave a floor": OnFloor(2, depth=2e-3, stiffness=1e4),
    "rhombus": Rhombus(),
    "slider-crank": SliderCrank(),
    "spherical parallelogram": SphericalParallelogram(),
    "Bricard's": Bricard(),
}


class Passed(NamedTuple):
    """How a crossing was passed.

    Attributes:
        lost: largest difference of the energy from the motion's at a sample, over the energy.
        apart: largest difference of q from the motion, rad or m.
        untold: by how much the state's account is off by more than its ``surplus`` says, likewise.
        led: number of steps that were done with care, or again.
        by_care: largest change of ``lost`` in one of these that the account calls accurate, and at
            neither end of which anything touched: with contacts the parts are the scene's rule's.
    """

    lost: float
    apart: float
    untold: float
    led: int
    by_care: float = 0.0


def passed(
    mechanism: Mechanism,
    distance: float,
    period: float,
    integrator: str = "rk4",
    after: int = AFTER,
) -> Passed:
    """Return the largest relative error of the energy, and of the configuration, at samples.

    The sample after ``BEFORE`` steps is ``distance`` (rad) beyond the crossing.
    """
    step, steps = Step(period, integrator), BEFORE + after
    angles, speeds = mechanism.samples(*mechanism.start(distance, BEFORE, step), steps, step)
    wanted = [mechanism.configuration(angle) for angle in angles]
    rates = [speed * mechanism.slope(angle) for angle, speed in zip(angles, speeds, strict=True)]
    states = _run(mechanism, step, wanted[0], rates[0], steps)
    mechanics = _prepared(mechanism, step)[0].mechanism

    def energy(q: Array, v: Array) -> float:
        return sum(mechanics.energy(q, v)) + mechanism.held(q)

    lost = [
        energy(state.q, state.v) - energy(q, v)
        for state, q, v in zip(states, wanted, rates, strict=True)
    ]
    counts = np.diff([(s.account.refined, s.account.inaccurate) for s in states], axis=0)
    away = np.array([s.touching is None or not s.touching.pairs.size for s in states])
    with_care = (counts[:, 0] > 0) & (counts[:, 1] == 0) & away[1:] & away[:-1]
    by_care = np.abs(np.diff(lost)[with_care]).max(initial=0.0)
    apart = np.array([state.q for state in states]) - np.array(wanted)
    whole = energy(wanted[0], rates[0])
    end, account = states[-1], states[-1].account
    paid = account.damping_loss - account.work_in + account.contact_loss
    held = account.contact_energy - states[0].account.contact_energy
    now = sum(mechanics.energy(end.q, end.v)) + held
    untold = now - sum(mechanics.energy(wanted[0], rates[0])) + paid - account.surplus
    return Passed(
        float(np.abs(lost).max()) / whole,
        float(np.abs(apart).max()),
        abs(untold) / whole,
        account.refined,
        float(by_care) / whole,
    )


@cache
def _away(mechanism: Mechanism, step: Step) -> tuple[float, float]:
    """Return both errors far from the crossing, the larger ones of its two sides."""
    found = [passed(mechanism, at, step.period, step.integrator) for at in (APART, -APART)]
    return max(one.lost for one in found), max(one.apart for one in found)


@cache
def _prepared(mechanism: Mechanism | Single, step: Step) -> tuple[Simulator, MechanismState]:
    """Return a simulator of a mechanism and its scene's start, made once."""
    simulation = step._asdict()
    sim = Simulator(scene_from_document(mechanism.document() | {"simulation": simulation}))
    return sim, sim.initial_state()


def _run(
    mechanism: Mechanism | Single, step: Step, q: Array, v: Array, steps: int
) -> list[MechanismState]:
    """Return the states from (q, v) on."""
    sim, start = _prepared(mechanism, step)
    states = [replace(start, q=q, v=v)]
    for _ in range(steps):
        states.append(sim.step(states[-1], wrenches_on(sim)))
    return states


def _arc(angle: float) -> Document:
    """Return the frame whose z axis is so far (rad) along an arc in the x-z plane."""
    return {"rpy": [0.0, float(angle), 0.0]}
