# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings if a scene's rendering loop has too small a delay margin.

For the delay of the graph itself the margin is computed exactly, see
:mod:`~hapticmech_ros.control.loop_stability`; two periods are required. Over a connection two loops
of the device are closed: the position channel, whose gains are scaled to the delay, and the joint
constraint unless the device closes it. The latter is compared with the rule ω τ <= 0.3; it becomes
unstable at about three times that.
"""

from __future__ import annotations

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import ENOUGH_PERIODS, loop_margins
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import DESIGN_PHASE_LAG, Controller, lag_of
from hapticmech_ros.simulation import Simulator

# Factor on ω τ = 0.3 at which a delayed spring becomes unstable.
MARGIN = 3.0


def loop_warning(scene: Scene, point: str, gains: Controller) -> str:
    """Return a warning about the loop at the scene's start; empty if its margins suffice.

    Args:
        scene: whose device, period and connection are used.
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
    """Return a warning if a joint constraint is too stiff for the connection; else empty.

    Args:
        scene: whose device, period and connection, simulated or declared, are used.
        gains: of the controllers.
    """
    joint, delay = gains.joint_constraint, scene.connection.designed
    if delay == 0.0 or joint.local:
        return ""
    lag = lag_of(scene.device, scene.connection, scene.simulation.period, local=False)
    admissible = scene.device.mass * (DESIGN_PHASE_LAG / lag) ** 2
    if joint.stiffness <= MARGIN**2 * admissible:
        return ""
    return (
        f"a joint constraint of {joint.stiffness:g} N/m is too stiff for a connection of "
        f"{1e3 * delay:g} ms each way, {admissible:.3g} N/m is not: set "
        "controller.joint_constraint.local to true, or leave stiffness out"
    )
