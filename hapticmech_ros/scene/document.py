"""What a scene may say: the frozen, validated description of one haptic simulation.

All quantities are SI. Frames and origins follow the conventions of URDF: ``origin.xyz`` in metres
and ``origin.rpy`` in radians (fixed-axis roll, pitch, yaw) place a child frame in its parent's.
Unknown keys, NaN, wrong sizes and wrong types are refused; nothing is converted silently.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag

from hapticmech_ros.errors import InvalidInputError

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Real, Field(gt=0.0)]
NonNegative = Annotated[Real, Field(ge=0.0)]
Name = Annotated[str, StringConstraints(strict=True, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Flag = Annotated[bool, Field(strict=True)]
Vector3 = tuple[Real, Real, Real]
# One number or a list; told apart by what is written, so that an error is about one of the two.
Coordinates = Annotated[
    Annotated[Real, Tag("number")] | Annotated[tuple[Real, ...], Tag("list")],
    Discriminator(lambda given: "list" if isinstance(given, list | tuple) else "number"),
]

JointType = Literal["revolute", "prismatic", "fixed", "spherical", "free", "planar"]
ClosureKind = Literal["spherical", "weld", "revolute", "planar_pin"]
TaskSpace = Literal["planar", "spatial"]


class Part(BaseModel):
    """Base of every part of a scene: frozen, and closed to keys that nobody defined."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Origin(Part):
    """A frame in its parent frame (URDF's ``origin``): xyz in m, rpy in rad."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)


class Joint(Part):
    """Joint that carries a link.

    Attributes:
        axis: unit vector in the joint frame, for ``revolute`` and ``prismatic``.
        origin: joint frame in the frame of the parent link.
        damping: viscous damping per degree of freedom, N m s/rad or N s/m.
    """

    name: Name
    type: JointType
    axis: Vector3 = (0.0, 0.0, 1.0)
    origin: Origin = Origin()
    damping: NonNegative = 0.0


class Inertia(Part):
    """Rotational inertia about the centre of mass in the axes of the link frame, kg m^2."""

    ixx: NonNegative
    iyy: NonNegative
    izz: NonNegative
    ixy: Real = 0.0
    ixz: Real = 0.0
    iyz: Real = 0.0


class Inertial(Part):
    """Mass in kg, centre of mass in the link frame in m, inertia about the centre of mass."""

    mass: NonNegative
    com: Vector3 = (0.0, 0.0, 0.0)
    inertia: Inertia


class Link(Part):
    """Rigid body, carried by ``joint`` from ``parent`` (another link or ``world``)."""

    name: Name
    parent: Name = "world"
    joint: Joint
    inertial: Inertial


class LinkFrame(Part):
    """A frame fixed in a link, or in ``world``."""

    link: Name
    origin: Origin = Origin()


class Closure(Part):
    """Loop closure between frames a and b (Eq. 1's W).

    ``spherical``: origins coincide (3 rows). ``revolute``: origins and z axes coincide (5 rows).
    ``weld``: frames coincide (6 rows). ``planar_pin``: origins coincide in world x and y (2 rows).

    Attributes:
        active: whether the loop is closed when the simulation starts.
        latch_distance: m; an open closure closes by itself once its residual is below this.
    """

    name: Name
    kind: ClosureKind
    a: LinkFrame
    b: LinkFrame
    active: Flag = True
    latch_distance: Positive | None = None


class Metric(Part):
    """Inertia that measures directions where a link has none: mass (kg), radius of gyration (m)."""

    mass: Positive
    length: Positive


class OperationalPoint(Part):
    """Where the user holds the mechanism. ``metric`` replaces the link's own inertia as metric."""

    name: Name
    link: Name
    origin: Origin = Origin()
    metric: Metric | None = None


class InitialState(Part):
    """Authored joint positions and velocities by joint name; joints left out start at zero.

    A revolute or prismatic joint takes one number, the others take Pinocchio's configuration:
    ``spherical`` x, y, z, w; ``free`` position, then x, y, z, w; ``planar`` x, y, cos, sin.
    """

    q: dict[Name, Coordinates] = {}
    v: dict[Name, Coordinates] = {}


class Simulation(Part):
    """Fixed step in s and the integrator that takes it."""

    period: Annotated[Positive, Field(le=0.1)] = 0.001
    integrator: Literal["rk4", "rk2", "semi_implicit_euler"] = "rk4"


class Perception(Part):
    """Which directions count as rigid, in s = sqrt(mu) (docs/notation.md).

    Control weighs directions smoothly from 1 at ``s_on`` to 0 at ``s_off``; the reported count
    switches on below ``s_on`` and off above ``s_off``, each after ``dwell`` seconds.
    """

    s_on: Annotated[Positive, Field(lt=1.0)] = 0.02
    s_off: Annotated[Positive, Field(lt=1.0)] = 0.05
    dwell: NonNegative = 0.005


class Device(Part):
    """Impedance-type haptic device, as a rigid body driven by hand and actuators.

    Attributes:
        mass: kg.
        inertia: principal moments about the point held, kg m^2, isotropic.
        damping: N s/m.
        angular_damping: N m s/rad.
        force_limit: N, saturation of the actuators' force (norm).
        torque_limit: N m, saturation of the actuators' torque (norm).
        position_resolution: m, encoder step per axis; 0 is ideal.
        angle_resolution: rad, encoder step of the rotation vector per axis; 0 is ideal.
        velocity_filter: Hz, cut-off of the velocity estimate when an encoder step is set.
        substeps: integration steps per sample period.
    """

    mass: Positive = 0.3
    inertia: Positive = 3.0e-4
    damping: NonNegative = 0.0
    angular_damping: NonNegative = 0.0
    force_limit: Positive = 20.0
    torque_limit: Positive = 1.0
    position_resolution: NonNegative = 0.0
    angle_resolution: NonNegative = 0.0
    velocity_filter: Positive = 100.0
    substeps: Annotated[int, Field(strict=True, ge=1, le=100)] = 4


class ConstantWrenchHand(Part):
    """Hand that pushes with a constant wrench, world axes, at the point held (N, N m)."""

    kind: Literal["constant_wrench"]
    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)
    start_delay: NonNegative = 0.25


class Waypoint(Part):
    """Target of the hand from where it took hold: displacement (m) and rotation vector (rad)."""

    time: NonNegative
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rotation: Vector3 = (0.0, 0.0, 0.0)


class SpringDamperHand(Part):
    """Hand as a spring and damper between the point held and a target that visits waypoints."""

    kind: Literal["spring_damper"]
    stiffness: Positive = 300.0
    damping: NonNegative = 5.0
    angular_stiffness: Positive = 1.0
    angular_damping: NonNegative = 0.01
    waypoints: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    start_delay: NonNegative = 0.25


Hand = Annotated[ConstantWrenchHand | SpringDamperHand, Field(discriminator="kind")]


class JointConstraintGains(Part):
    """Finite stiffness that stands for rigid joints.

    Along a constrained direction n, normalised in the metric, the gain is per unit of the metric's
    mass: pure translation of the link meets ``stiffness`` N/m and ``damping`` N s/m.
    ``feedforward`` is beta, the share of what the hand pushes along n that is cancelled ahead.
    """

    stiffness: NonNegative = 2000.0
    damping: NonNegative = 40.0
    force_limit: Positive = 15.0
    torque_limit: Positive = 0.8
    feedforward: Annotated[Real, Field(ge=0.0, le=1.0)] = 0.0


class PositionChannelGains(Part):
    """Local position controllers C_m = C_s of the four-channel architecture: spring and damper."""

    stiffness: NonNegative = 300.0
    damping: NonNegative = 10.0
    angular_stiffness: NonNegative = 0.3
    angular_damping: NonNegative = 0.01


class ForceChannelGains(Part):
    """Force channels: ``contact`` (C2, contact to hand), ``hand`` (C3, hand to mechanism)."""

    contact: Annotated[Real, Field(ge=0.0, le=1.0)] = 1.0
    hand: Annotated[Real, Field(ge=0.0, le=1.0)] = 1.0


class Controller(Part):
    """Gains of the three controllers of Fig. 3, and the ramp of the wrench after engagement (s)."""

    joint_constraint: JointConstraintGains = JointConstraintGains()
    position_channel: PositionChannelGains = PositionChannelGains()
    force_channel: ForceChannelGains = ForceChannelGains()
    engagement_ramp: NonNegative = 0.1


class Experiment(Part):
    """How long the experiment lasts after the hand starts, in s."""

    duration: Positive = 5.0


class Scene(Part):
    """One virtual mechanism, the device that renders it, the hand that moves it, and the gains."""

    format: Literal["hapticmech-scene/1"]
    name: Name
    description: str = ""
    task_space: TaskSpace = "spatial"
    gravity: Vector3 = (0.0, 0.0, 0.0)
    links: Annotated[tuple[Link, ...], Field(min_length=1)]
    closures: tuple[Closure, ...] = ()
    operational_points: Annotated[tuple[OperationalPoint, ...], Field(min_length=1)]
    initial_state: InitialState = InitialState()
    simulation: Simulation = Simulation()
    perception: Perception = Perception()
    device: Device = Device()
    hand: Hand
    controller: Controller = Controller()
    experiment: Experiment = Experiment()

    def operational_point(self, name: str = "") -> OperationalPoint:
        """Return the operational point ``name``; the first one if ``name`` is empty.

        Raises:
            InvalidInputError: no such point; the message lists those there are.
        """
        if not name:
            return self.operational_points[0]
        for point in self.operational_points:
            if point.name == name:
                return point
        known = [point.name for point in self.operational_points]
        raise InvalidInputError("operational point", name, f"must be one of {known}")
