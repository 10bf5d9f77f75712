# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism in a scene: links, joints with their forces, closures, points held.

The part of a scene file that names the file which its links come from.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from hapticmech_ros.scene.part import (
    Angles3,
    Coordinates,
    Flag,
    Name,
    NonNegative,
    Part,
    Positive,
    Real,
    Vector3,
)

FileName = Annotated[str, StringConstraints(strict=True, min_length=1)]


class JointForces(Part):
    """What acts in a joint.

    Attributes:
        damping: viscous damping per degree of freedom, N m s/rad or N s/m.
        armature: inertia of a rotor as the joint feels it, kg m² or kg.
        stiffness: of a spring in the joint, N m/rad or N/m.
        rest: position at which that spring is slack, rad or m.
        friction: Coulomb friction, N m or N.
        friction_speed: rad/s or m/s, at which friction is nearly full.
        effort: constant torque or force on the link, N m or N.
        limits: where the joint stops; ``null`` for nowhere.
        locked: whether the joint is held where it starts.
    """

    damping: NonNegative = 0.0
    armature: NonNegative = 0.0
    stiffness: NonNegative = 0.0
    rest: Real = 0.0
    friction: NonNegative = 0.0
    friction_speed: Positive = 0.01
    effort: Real = 0.0
    limits: JointLimits | None = None
    locked: Flag = False


class JointChange(JointForces):
    """Changes to a joint of the scene's file; keys left out stay as in the file.

    ``limits: null`` takes the stops away.
    """


class ModelPart(Part):
    """Where a scene's links come from.

    Attributes:
        file: URDF, MJCF or SDF, relative to the scene's own file.
        name: of the model, in an SDF file with several.
        base: ``fixed``: a body that nothing carries is the world; ``free``: it floats.
        joints: changes, by the file's names of joints.
    """

    file: FileName
    name: Annotated[str, StringConstraints(strict=True, max_length=1000)] = ""
    base: Literal["fixed", "free"] = "fixed"
    joints: dict[str, JointChange] = Field(default_factory=dict)


JointType = Literal["revolute", "prismatic", "fixed", "spherical", "free", "planar"]
ClosureKind = Literal["spherical", "weld", "revolute", "planar_pin", "rod"]
# Constraints between joints: closures, and couplings, which are treated alike.
LoopKind = Literal[ClosureKind, "coupling"]
IntegratorName = Literal["rk4", "tsit5", "rk2", "semi_implicit_euler", "linearly_implicit"]
IntegratorChoice = Literal["auto", IntegratorName]


class Origin(Part):
    """A frame in its parent frame (URDF's ``origin``).

    Attributes:
        xyz: m, of the frame's origin.
        rpy: rad, fixed-axis roll, pitch, yaw.
    """

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Angles3 = (0.0, 0.0, 0.0)


class JointLimits(Part):
    """Stops of a joint, each a spring and damper that pushes inwards only.

    Attributes:
        lower: rad or m, below which the stop pushes.
        upper: rad or m, above which it does.
        stiffness: N m/rad or N/m.
        damping: N m s/rad or N s/m at a penetration of ``depth``; less before, by Hunt and
            Crossley's law: the stop neither sticks nor jumps.
        depth: rad or m.
    """

    lower: Real
    upper: Real
    stiffness: Positive
    damping: NonNegative = 0.0
    depth: Positive = 0.01


class JointFrame(Part):
    """Where a joint is, and how it moves.

    Attributes:
        name: of the joint, unique in the scene.
        type: its degrees of freedom.
        axis: unit vector in the joint frame, for ``revolute`` and ``prismatic``.
        origin: joint frame in the frame of the parent link.
    """

    name: Name
    type: JointType
    axis: Vector3 = (0.0, 0.0, 1.0)
    origin: Origin = Origin()


class Joint(JointForces, JointFrame):
    """Joint that carries a link.

    Attributes:
        armature: inertia of a rotor geared to the joint, as the joint feels it (gear ratio squared
            times the rotor's own), per degree of freedom, kg m² or kg: it is added to the diagonal
            of D. Of revolute, prismatic and spherical joints.
        friction_speed: rad/s or m/s; friction is ``friction`` times tanh(speed / friction_speed).
        effort: constant torque or force on the link, from its parent, N m or N.
        limits: where the joint stops.
        locked: whether the joint is held where it starts; it then is no degree of freedom.
    """


class Inertia(Part):
    """Rotational inertia about the centre of mass in the axes of the link frame.

    Attributes:
        ixx: kg m².
        iyy: kg m².
        izz: kg m².
        ixy: kg m², minus the integral of x y over the mass, as in URDF.
        ixz: kg m², likewise.
        iyz: kg m², likewise.
    """

    ixx: NonNegative
    iyy: NonNegative
    izz: NonNegative
    ixy: Real = 0.0
    ixz: Real = 0.0
    iyz: Real = 0.0


# Where each of an inertia's keys is in the matrix.
MOMENTS = {
    "ixx": (0, 0),
    "iyy": (1, 1),
    "izz": (2, 2),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyz": (1, 2),
}


class Inertial(Part):
    """A link's mass properties.

    Attributes:
        mass: kg.
        com: m, centre of mass in the link frame.
        inertia: about the centre of mass.
    """

    mass: NonNegative
    com: Vector3 = (0.0, 0.0, 0.0)
    inertia: Inertia


class Link(Part):
    """Rigid body.

    Attributes:
        name: of the link, unique in the scene.
        parent: the link that carries it, or ``world``.
        joint: between the two.
        inertial: mass and inertia.
        gravcomp: share of its weight that something outside carries: 1 for a link on which gravity
            does not act, more for one that is drawn upwards.
    """

    name: Name
    parent: Name = "world"
    joint: Joint
    inertial: Inertial
    gravcomp: NonNegative = 0.0


class LinkFrame(Part):
    """A frame fixed in a link, or in ``world``.

    Attributes:
        link: that it is fixed in, or ``world``.
        origin: in the link's frame.
    """

    link: Name
    origin: Origin = Origin()


class Closure(Part):
    """Loop closure between frames a and b (Eq. 1's W).

    ``spherical``: origins coincide (3 rows). ``revolute``: origins and z axes coincide (5 rows).
    ``weld``: frames coincide (6 rows). ``planar_pin``: origins coincide in world x and y (2 rows).
    ``rod``: origins keep a distance (1 row).

    Attributes:
        name: of the closure, unique in the scene.
        kind: the relative motion that it blocks.
        a: one frame.
        b: the other.
        length: m, of a rod; of no other kind.
        active: whether the loop is closed when the simulation starts.
        latch_distance: m; an open closure closes by itself once its residual is below this.
    """

    name: Name
    kind: ClosureKind
    a: LinkFrame
    b: LinkFrame
    length: Positive | None = None
    active: Flag = True
    latch_distance: Positive | None = None


class Coupling(Part):
    """A gear or cam: position of ``joint`` = ratio · position of ``leader`` + offset.

    Or, with x the position of ``leader``, a0 + a1 x + a2 x² + a3 x³ + a4 x⁴ of ``polycoef``.

    Attributes:
        name: of the coupling, unique in the scene.
        joint: that follows; revolute or prismatic.
        leader: that it follows.
        ratio: of rad or m to rad or m, not zero.
        offset: rad or m.
        polycoef: a0 to a4, powers of rad or m to rad or m, in place of ``ratio`` and ``offset``.
    """

    name: Name
    joint: Name
    leader: Name
    ratio: Real = 1.0
    offset: Real = 0.0
    polycoef: tuple[Real, Real, Real, Real, Real] | None = None

    @property
    def curve(self) -> tuple[float, float, float, float, float]:
        """a0 to a4, from ``polycoef``, or from ``ratio`` and ``offset``."""
        return self.polycoef or (self.offset, self.ratio, 0.0, 0.0, 0.0)


class Spring(Part):
    """Spring and damper along the line between the origins of two frames.

    Attributes:
        name: of the spring, unique in the scene.
        a: one end.
        b: the other.
        stiffness: N/m.
        damping: N s/m.
        rest_length: m, at which the spring is slack.
    """

    name: Name
    a: LinkFrame
    b: LinkFrame
    stiffness: NonNegative = 0.0
    damping: NonNegative = 0.0
    rest_length: NonNegative = 0.0


class Metric(Part):
    """Inertia that measures directions where a link has none.

    Attributes:
        mass: kg.
        length: m, radius of gyration.
    """

    mass: Positive
    length: Positive


class OperationalPoint(Part):
    """Where the user holds the mechanism.

    Attributes:
        name: of the point, unique in the scene; part of its topics' names.
        link: that is held.
        origin: of the point's frame in the link's.
        metric: in place of the link's own inertia, which is the metric otherwise.
    """

    name: Name
    link: Name
    origin: Origin = Origin()
    metric: Metric | None = None


class InitialState(Part):
    """Authored joint positions and velocities by joint name; joints left out start at zero.

    A revolute or prismatic joint takes one number, the others take Pinocchio's configuration:
    ``spherical`` x, y, z, w; ``free`` position, then x, y, z, w; ``planar`` x, y, cos, sin.

    Attributes:
        q: rad or m, positions by joint.
        v: rad/s or m/s, velocities by joint.
    """

    q: dict[Name, Coordinates] = Field(default_factory=dict)
    v: dict[Name, Coordinates] = Field(default_factory=dict)


class Accuracy(Part):
    """Required accuracy of a step's energy account, and the most substeps for it.

    Attributes:
        tolerance: share of the energy that a step exchanges by which its account may be off; the
            integrator's own if left out, 0 for steps that are not checked.
        max_substeps: a step that is off by more is repeated in 2, 4, ... up to so many.
    """

    tolerance: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] | None = None
    max_substeps: Annotated[int, Field(strict=True, ge=1, le=1024)] = 32


class Simulation(Part):
    """Fixed step in s, its integrator, and the method that keeps loops closed.

    Attributes:
        period: s, of control and simulation.
        integrator: ``linearly_implicit`` for stiff springs, dampers, friction and stops; ``auto``
            is that where one of them is too stiff for ``rk4`` as the scene starts, else ``rk4``.
        substeps: steps of the integrator in a period.
        stabilisation: ``projection`` puts the state back on the closures after each step;
            ``baumgarte`` pulls it back by forces.
        baumgarte_rate: 1/s, at which errors then decay.
        accuracy: of each step.
    """

    period: Annotated[Positive, Field(le=0.1)] = 0.001
    integrator: IntegratorChoice = "auto"
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 1
    stabilisation: Literal["projection", "baumgarte"] = "projection"
    baumgarte_rate: Positive = 20.0
    accuracy: Accuracy = Accuracy()
