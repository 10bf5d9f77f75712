"""The launch file, with stand-ins for launch: neither launch nor launch_ros is on PyPI."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from hapticmech_ros.nodes.parameters import NodeParameters

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "launch" / "hapticmech.launch.py"
STAND_INS = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "ExecuteProcess"],
    "launch.conditions": ["IfCondition", "UnlessCondition"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution", "PythonExpression"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


class Made:
    """What a launch file made: the name of the class, and what it was given."""

    def __init__(self, kind: str, given: tuple[Any, ...], named: dict[str, Any]) -> None:
        self.kind, self.given, self.named = kind, given, named


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Made]:
    for name, kinds in STAND_INS.items():
        module = ModuleType(name)
        for kind in kinds:
            maker = lambda *given, _kind=kind, **named: Made(_kind, given, named)  # noqa: E731
            setattr(module, kind, maker)
        monkeypatch.setitem(sys.modules, name, module)
    specification = importlib.util.spec_from_file_location("launch_file", FILE)
    assert specification is not None
    assert specification.loader is not None
    file = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(file)
    (entities,) = file.generate_launch_description().given
    return list(entities)


def test_it_starts_executables_of_the_package_with_parameters_that_exist(made: list[Made]) -> None:
    ours = [e for e in made if e.kind == "Node" and e.named["package"] == "hapticmech_ros"]
    executables = {e.named["executable"] for e in ours}
    installed = {path.name for path in (ROOT / "resource" / "executables").iterdir()}
    assert executables == installed
    for entity in ours:
        (parameters,) = entity.named["parameters"]
        assert set(parameters) <= {*NodeParameters.model_fields, "use_sim_time"}


def test_every_argument_is_declared_with_a_meaning_and_used(made: list[Made]) -> None:
    declared = {e.given[0]: e.named for e in made if e.kind == "DeclareLaunchArgument"}
    assert {"scene", "control_rate", "composed", "namespace", "record", "rviz"} <= set(declared)
    assert all(named["description"] for named in declared.values())
    used = {m.given[0] for m in _all(made) if m.kind == "LaunchConfiguration"}
    assert used == set(declared)


def test_separate_and_composed_exclude_each_other(made: list[Made]) -> None:
    conditions = {
        e.named["executable"]: e.named["condition"].kind
        for e in made
        if e.kind == "Node" and e.named["executable"] not in ("scene_viewer", "rviz2")
    }
    assert conditions.pop("composed") == "IfCondition"
    assert set(conditions.values()) == {"UnlessCondition"}


def _all(found: Any) -> list[Made]:
    """Return everything made, nested ones too."""
    if isinstance(found, Made):
        return [found, *_all(list(found.given)), *_all(found.named)]
    if isinstance(found, dict):
        return [m for value in found.values() for m in _all(value)]
    if isinstance(found, list | tuple):
        return [m for value in found for m in _all(value)]
    return []
