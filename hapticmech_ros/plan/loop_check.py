"""Whether a scene's rendering bears the delay of its loop, said in a sentence if not."""

from __future__ import annotations

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import loop_margins, needed_periods
from hapticmech_ros.control.rendering_model import rendering_model
from hapticmech_ros.mechanism import Simulator
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Scene


def loop_warning(scene: Scene, point: str, gains: Controller) -> str:
    """Return what is wrong with a loop where its scene starts; empty if nothing is.

    Args:
        scene: whose device, period and connection.
        point: operational point that is held.
        gains: of the controllers.
    """
    # Once, at a start: not worth the time that compiled kernels take to load.
    simulator = Simulator(scene, compiled=False)
    terms = simulator.evaluate(simulator.initial_state())
    analysis = Analyser(simulator.mechanism, point).analyse(terms)
    control = ControlArchitecture(scene)
    control.adopt(gains)
    period, needed = scene.simulation.period, needed_periods(scene)
    model = rendering_model(analysis)
    margins = loop_margins(control, model, analysis.rows, period, most_periods=needed)
    return margins.warning(point, period, needed) or ""
