# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes' parameters as Markdown; docs/nodes.md holds it, and a test holds the two together."""

from __future__ import annotations

from hapticmech_ros.nodes.parameters import (
    AnalyserParameters,
    ControllerParameters,
    DeviceParameters,
    HaplyParameters,
    LiveParameters,
    MechanismParameters,
    NodeParameters,
    RelayParameters,
    ViewerParameters,
    changes_of,
    choices_of,
    range_of,
)
from hapticmech_ros.nodes.robot_parameters import FollowerParameters, SimulatedRobotParameters

MODELS: dict[str, type[NodeParameters]] = {
    "haptic_device": DeviceParameters,
    "haply_device": HaplyParameters,
    "relay_device": RelayParameters,
    "mechanism_simulator": MechanismParameters,
    "nullspace_analyser": AnalyserParameters,
    "teleoperation_controller": ControllerParameters,
    "robot_follower": FollowerParameters,
    "simulated_robot": SimulatedRobotParameters,
    "scene_viewer": ViewerParameters,
    "live_page": LiveParameters,
}
CHANGES = {"any": "yes", "unconfigured": "while unconfigured", "never": "no"}


def markdown() -> str:
    """Return one table row per parameter: first those that all nodes have."""
    lines = [
        "| node | parameter | default | range | can change | meaning |",
        "|---|---|---|---|---|---|",
    ]
    common = list(NodeParameters.model_fields)
    lines += [_row("every node", NodeParameters, name) for name in common]
    for node, model in MODELS.items():
        own = [name for name in model.model_fields if _differs(model, name)]
        lines += [_row(node, model, name) for name in own]
    return "\n".join(lines) + "\n"


def _differs(model: type[NodeParameters], name: str) -> bool:
    """Return whether a node has a parameter alone, or with another default than all the others."""
    common = NodeParameters.model_fields.get(name)
    return common is None or common.default != model.model_fields[name].default


def _row(node: str, model: type[NodeParameters], name: str) -> str:
    field = model.model_fields[name]
    bounds = range_of(model, name)
    span = f"{bounds[0]:g} … {bounds[1]:g}" if bounds else ", ".join(choices_of(model, name))
    default = str(field.default).lower() if isinstance(field.default, bool) else field.default
    cells = (
        node,
        f"`{name}`",
        f"`{default}`" if default != "" else "empty",
        span,
        CHANGES[changes_of(model, name)],
        field.description or "",
    )
    return "| " + " | ".join(cells) + " |"
