"""Whether a scene's rendering bears the delay of its loop, said in a sentence if not.

What the graph itself takes is found exactly, see :mod:`~hapticmech_ros.control.loop_stability`: two
periods are to be borne. Over a connection goes, on the device's side only, the position channel,
which is scaled to it, and the joint constraint where the device does not close it: that one is held
to the rule ω τ <= 0.3, of which three times as much is the end.
"""

from __future__ import annotations

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import ENOUGH_PERIODS, loop_margins
from hapticmech_ros.control.operational_model import operational_model_of
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.gain_rule import BORNE, lag_of
from hapticmech_ros.simulation import Simulator

# Of ω τ = 0.3, at which a late spring becomes unstable.
MARGIN = 3.0


def loop_warning(scene: Scene, point: str, gains: Controller) -> str:
    """Return what is wrong with a loop where its scene starts; empty if nothing is.

    Args:
        scene: whose device, period and connection.
        point: operational point that is held.
        gains: of the controllers.
    """
    simulator = Simulator(scene)
    terms = simulator.evaluate(simulator.initial_state())
    analysis = Analyser(simulator.mechanism, point).analyse(terms)
    control = ControlArchitecture(scene)
    control.apply_gains(gains)
    period = scene.simulation.period
    model = operational_model_of(analysis)
    margins = loop_margins(control, model, analysis.rows, period, most_periods=ENOUGH_PERIODS)
    return margins.warning(point, period, ENOUGH_PERIODS) or connection_warning(scene, gains)


def connection_warning(scene: Scene, gains: Controller) -> str:
    """Return what a scene's connection, simulated or declared, does not bear; empty if nothing.

    Args:
        scene: whose device, period and connection.
        gains: of the controllers.
    """
    joint, delay = gains.joint_constraint, scene.connection.designed
    if delay == 0.0 or joint.local:
        return ""
    lag = lag_of(scene.device, scene.connection, scene.simulation.period, local=False)
    borne = scene.device.mass * (BORNE / lag) ** 2
    if joint.stiffness <= MARGIN**2 * borne:
        return ""
    return (
        f"over a connection of {1e3 * delay:g} ms each way a joint constraint that the device does "
        f"not close itself bears {borne:.3g} N/m with a margin of three, and has "
        f"{joint.stiffness:g} N/m: set controller.joint_constraint.local, or leave it to the rule"
    )
