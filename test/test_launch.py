# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The launch file, with stand-ins for launch: neither launch nor launch_ros is on PyPI."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer.main
import yaml

from hapticmech_ros.cli import app
from hapticmech_ros.cli.console import seconds_of
from hapticmech_ros.nodes.parameters import LiveParameters, NodeParameters, ViewerParameters
from oracles.users import two_points

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "launch" / "hapticmech.launch.py"
STAND_INS = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
    "launch_ros.substitutions": ["FindPackageShare"],
}
FOUR = ["haptic_device", "mechanism_simulator", "nullspace_analyser", "teleoperation_controller"]


class Made:
    """What a launch file made: the name of the class, and what it was given."""

    def __init__(self, kind: str, given: tuple[Any, ...], named: dict[str, Any]) -> None:
        self.kind, self.given, self.named = kind, given, named

    def perform(self, context: dict[str, str]) -> str:
        """As of a LaunchConfiguration."""
        value: str = context[self.given[0]]
        return value


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Made]]:
    """Return what is started with arguments, and the declarations of all without."""
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
    declared = {e.given[0]: e for e in entities if e.kind == "DeclareLaunchArgument"}
    (opaque,) = [e for e in entities if e.kind == "OpaqueFunction"]

    def launch(**arguments: str) -> list[Made]:
        if not arguments:
            return list(declared.values())
        assert set(arguments) <= set(declared)
        defaults = {name: made.named["default_value"] for name, made in declared.items()}
        return list(opaque.named["function"]({**defaults, **arguments}))

    return launch


Launch = Callable[..., list[Made]]


def test_every_argument_is_declared_with_a_meaning(launched: Launch) -> None:
    declared = {made.given[0]: made.named for made in launched()}
    assert all(named["description"] for named in declared.values())
    # Whatever `hapticmech run` has for a graph that goes on, but what launch has itself.
    run = {option.name for option in commands_of(typer.main.get_command(app))["run"].params}
    other = {"only", "settings", "discovery", "rate", "help"}
    assert run - other <= set(declared)


def test_the_nodes_are_executables_with_parameters_that_exist(launched: Launch) -> None:
    nodes = launched(scene="1e3", params_file="mine.yaml", namespace="arm")
    assert [made.named["executable"] for made in nodes] == [*FOUR, "scene_viewer"]
    installed = {path.name for path in (ROOT / "resource" / "executables").iterdir()}
    fields = {*NodeParameters.model_fields, "use_sim_time"}
    for made in nodes:
        assert made.named["package"] == "hapticmech_ros"
        assert made.named["executable"] in installed
        assert made.named["namespace"] == "arm"
        parameters, file = made.named["parameters"]
        assert file == "mine.yaml"
        viewer = made.named["executable"] == "scene_viewer"
        assert set(parameters) <= fields | (set(ViewerParameters.model_fields) if viewer else set())
        # What YAML would read as a number stays a name.
        assert parameters["scene"].given == ("1e3",)
        assert parameters["scene"].named == {"value_type": str}


def test_composed_and_without_a_viewer_is_one_process(launched: Launch) -> None:
    (made,) = launched(composed="True", view="false", respawn="true")
    assert made.named["executable"] == "composed"
    assert made.named["respawn"] is True


def test_a_live_page_has_a_process_of_its_own(launched: Launch) -> None:
    page = launched(live="true", composed="true", view="false")[1]
    assert page.named["executable"] == "live_page"
    assert set(page.named["parameters"][0]) <= {*LiveParameters.model_fields, "use_sim_time"}


def test_rviz_comes_first_and_a_recorder_last(launched: Launch) -> None:
    made = launched(rviz="true", record="out", storage="sqlite3")
    assert made[0].named["package"] == "rviz2"
    assert made[-1].kind == "ExecuteProcess"
    command = made[-1].named["cmd"]
    assert command[:6] == ["hapticmech", "bag", "record", "--all", "--out", "out"]
    assert command[command.index("--storage") + 1] == "sqlite3"
    understood(command)


def test_one_point_to_hold_is_the_operational_point(launched: Launch) -> None:
    made = launched(hold="tip", view="false")
    assert [one.named["executable"] for one in made] == FOUR
    assert all(one.named["parameters"][0]["operational_point"].given == ("tip",) for one in made)


def test_the_hands_of_a_scene_are_held_unless_another_point_is(
    launched: Launch, tmp_path: Path
) -> None:
    path = tmp_path / "scene.yaml"
    hands = [{"point": "b"}, {"point": "a"}]
    path.write_text(yaml.safe_dump(two_points(hands=hands)), encoding="utf-8")
    (made,) = launched(scene=str(path))
    assert understood(made.named["cmd"])["hold"] == ["b", "a"]
    made = launched(scene=str(path), operational_point="a", view="false")
    assert [one.named["executable"] for one in made] == FOUR


@pytest.mark.parametrize(
    "arguments",
    [
        {"hold": "left, right", "respawn": "true", "record": "out", "frame_prefix": "a/"},
        {"hold": "left,right", "composed": "true", "view": "false", "live": "true"},
        {"hold": "left,right", "device": "relay, right=haply"},
        {"device": "handle=haply"},
        {"lockstep": "true", "duration": "5.0", "record": "out", "control_rate": "500.0"},
        {"lockstep": "true", "network_delay": "0.05", "params_file": str(ROOT / "setup.cfg")},
    ],
)
def test_what_launch_has_no_nodes_for_is_a_command_that_exists(
    launched: Launch, arguments: dict[str, str]
) -> None:
    (made,) = launched(**arguments)
    assert made.kind == "ExecuteProcess"
    options = understood(made.named["cmd"])
    assert options["scene"] == "five_bar"
    for name, word in arguments.items():
        if name == "hold":
            assert options["hold"] == ["left", "right"]
        elif name == "device":
            assert options["device"] == word.split(", ")
        elif name == "frame_prefix":
            assert options["settings"] == [f"scene_viewer.frame_prefix={word}"]
        elif name == "network_delay":
            assert seconds_of("delay", options["network_delay"]) == float(word)
        else:
            kind = {"true": True, "false": False}
            expected = kind.get(word, word)
            found = options[name]
            assert type(found)(expected) == found


def test_a_real_device_s_driver_is_a_node_in_the_simulated_one_s_place(launched: Launch) -> None:
    made = launched(device="haply", view="false")
    assert [one.named["executable"] for one in made] == ["haply_device", *FOUR[1:]]
    with pytest.raises(ValueError, match="device:=handle=haplly: must be one of simulated, haply"):
        launched(device="handle=haplly")


@pytest.mark.parametrize("name", ["composed", "rviz", "lockstep", "respawn"])
def test_a_flag_that_is_none_is_refused(launched: Launch, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}:=perhaps: must be true or false"):
        launched(**{name: "perhaps"})


def understood(words: list[str]) -> dict[str, Any]:
    """Return the options of a `hapticmech` command as its own parser reads them."""
    assert words[0] == "hapticmech"
    command: Any = typer.main.get_command(app)
    rest = words[1:]
    while inside := commands_of(command):
        command = inside[rest[0]]
        rest = rest[1:]
    with command.make_context(words[0], list(rest)) as context:
        return dict(context.params)


def commands_of(command: Any) -> dict[str, Any]:
    """Return the commands in a group of them; none of a single one."""
    return dict(getattr(command, "commands", {}))
