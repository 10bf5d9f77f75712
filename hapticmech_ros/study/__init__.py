# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene's keys varied over ranges, and measures of each resulting scene.

The names below are loaded when first used: workers measure, and draw nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hapticmech_ros.study.design import Design, Variation
    from hapticmech_ros.study.parameter_study import ParameterStudy, run_study

_HOMES = {
    "Design": "design",
    "ParameterStudy": "parameter_study",
    "Variation": "design",
    "run_study": "parameter_study",
}

__all__ = ["Design", "ParameterStudy", "Variation", "run_study"]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
