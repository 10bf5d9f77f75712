"""Which implementation of a mechanism and of its steps runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.stepping import Plan, Stepper
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.mechanism import Simulation

if TYPE_CHECKING:
    from hapticmech_ros.contact.stepping import ContactStepper


def build(scene: Scene, compiled: bool = True) -> Mechanism:
    """Return the mechanism of a scene.

    Args:
        scene: what to build.
        compiled: by kernels, several times faster, or by the readable implementation that they are
            compared with. Results agree to rounding, not to the bit: take one for all.
    """
    if not compiled:
        return Mechanism(scene)
    # Here, so that only what runs a mechanism waits for Numba.
    from hapticmech_ros.mechanism.compiled.mechanism import CompiledMechanism

    return CompiledMechanism(scene)


def build_stepper(mechanism: Mechanism, plan: Plan | None = None) -> Stepper:
    """Return what steps a mechanism, compiled if the mechanism is.

    Args:
        mechanism: to step.
        plan: how; as its scene says if left out.
    """
    if plan is None:
        plan = plan_of(mechanism.scene.simulation)
    if not mechanism.compiled:
        return Stepper(mechanism, plan)
    from hapticmech_ros.mechanism.compiled.mechanism import CompiledMechanism
    from hapticmech_ros.mechanism.compiled.stepping import CompiledStepper

    return CompiledStepper(cast(CompiledMechanism, mechanism), plan)


def build_contact_stepper(mechanism: Mechanism) -> ContactStepper | None:
    """Return what steps a compiled mechanism with contacts; None if it is not, or has none.

    Raises:
        SceneError: a mesh that cannot be read.
    """
    if not (mechanism.scene.contacts and mechanism.compiled):
        return None
    # Here, so that a scene without contacts imports nothing of them.
    from hapticmech_ros.contact.stepping import ContactStepper
    from hapticmech_ros.mechanism.compiled.mechanism import CompiledMechanism

    return ContactStepper(cast(CompiledMechanism, mechanism))


def plan_of(simulation: Simulation) -> Plan:
    """Return how a scene's simulation steps through a period."""
    pulled = simulation.stabilisation == "baumgarte"
    rate = simulation.baumgarte_rate if pulled else 0.0
    return Plan(simulation.integrator, simulation.period, simulation.substeps, rate)
