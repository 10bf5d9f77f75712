# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: described, checked as a whole, refused with value and rule, and obeyed."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
import yaml
from rcl_interfaces.srv import DescribeParameters, ListParameters
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.files import shared
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.managed import descriptor_of
from hapticmech_ros.nodes.parameter_table import MODELS
from hapticmech_ros.nodes.runtime import actor_type
from ros.harness import Peer, refused, running

GAIN_UNITS = ("1", "N/m", "N s/m", "N m/rad", "N m s/rad")
UNITS = ("Hz", "s", "m", "N", "N m", "N/s", "N m/s", *GAIN_UNITS)
DEVICE = "haptic_device"


def test_every_parameter_describes_itself(domain: int, peer: Peer) -> None:
    with running(",".join(NODES), domain, autostart=False, control_rate=0.0):
        for node in NODES:
            fields = actor_type(node).parameters_type.model_fields
            listed = peer.call(ListParameters, f"{node}/list_parameters", ListParameters.Request())
            assert set(fields) <= set(listed.result.names)
            request = DescribeParameters.Request(names=list(fields))
            found = peer.call(DescribeParameters, f"{node}/describe_parameters", request)
            values = peer.parameters_of(node, *fields)
            for descriptor, value in zip(found.descriptors, values, strict=True):
                field = fields[descriptor.name]
                assert len(descriptor.description) > 10, descriptor.name
                if isinstance(field.default, float):
                    (span,) = descriptor.floating_point_range
                    assert span.from_value <= field.default <= span.to_value
                    assert descriptor.description.rsplit(", ", 1)[1] in UNITS, descriptor
                if descriptor.name not in ("scene", "autostart"):
                    assert value == field.default
                assert descriptor.dynamic_typing is (descriptor.name == "cpu_affinity")


@pytest.mark.parametrize("node", list(MODELS))
def test_parameter_file_names_all_parameters_and_their_defaults(node: str) -> None:
    path = shared(f"config/{node}.yaml")
    text = Path(path).read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    assert list(document) == [f"/**/{node}"]
    model = MODELS[node]
    given = document[f"/**/{node}"]["ros__parameters"]
    assert given == {name: field.default for name, field in model.model_fields.items()}
    # A number without a decimal point would be an integer to other tools.
    assert all(
        type(given[name]) is type(field.default) for name, field in model.model_fields.items()
    )
    for name, field in model.model_fields.items():
        (line,) = re.findall(rf"^ +{name}: .*$", text, re.MULTILINE)
        if isinstance(field.default, float):
            unit = descriptor_of(model, name).description.rsplit(", ", 1)[1]
            assert f"# {unit}, " in line


def test_a_change_against_the_rules_changes_nothing(domain: int, peer: Peer) -> None:
    samples = peer.listen("device/state", Float64MultiArray)
    names = list(actor_type(DEVICE).parameters_type.model_fields)
    with running(DEVICE, domain):
        peer.until(lambda: samples, "the device")
        before = peer.parameters_of(DEVICE, "use_sim_time", *names)
        for name, value, reasons in (
            ("view_rate", 5000.0, ("view_rate", "5000", "1000")),
            ("view_rate", 0.5, ("view_rate", "0.5", "1.0")),
            ("command_timeout", math.nan, ("command_timeout", "nan", "0.0")),
            ("hand_timeout", -1.0, ("hand_timeout", "-1", "0.0")),
            ("message_age_limit", math.inf, ("message_age_limit", "inf", "3600")),
            ("view_rate", "fast", ("DOUBLE", "STRING")),
            ("scene", "two_link", ("scene", "unconfigured")),
            ("operational_point", "handle", ("operational_point", "unconfigured")),
            ("hand", "commanded", ("hand", "unconfigured")),
            ("use_sim_time", True, ("use_sim_time", "unconfigured")),
            ("lockstep", True, ("lockstep", "at the start")),
            ("autostart", False, ("autostart", "at the start")),
            ("no_such_parameter", 1.0, ("undeclared",)),
        ):
            refused(peer, DEVICE, reasons, **{name: value})
        for bad, good in (
            ({"hand_timeout": -1.0}, {"view_rate": 20.0}),
            ({"scene": "two_link"}, {"view_rate": 20.0}),
            ({"use_sim_time": True}, {"hand_timeout": 0.3}),
        ):
            result = peer.set_atomically(DEVICE, **good, **bad)
            assert not result.successful
            assert next(iter(bad)) in result.reason
        assert peer.parameters_of(DEVICE, "use_sim_time", *names) == before
        peer.until_more(samples, 100, "the device to go on by the machine's clock")

        assert peer.transition(DEVICE, "deactivate", "cleanup")
        refused(peer, DEVICE, ("hand", "octopus", "commanded"), hand="octopus")
        assert peer.set_atomically(DEVICE, scene="two_link", hand="commanded").successful
        assert peer.transition(DEVICE, "configure", "activate")
        assert peer.parameters_of(DEVICE, "scene", "hand") == ["two_link", "commanded"]


def test_nodes_take_their_own_dump_and_whole_numbers(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    """As `ros2 param dump` writes it and `param load` sets it; rclpy's own parameters apart."""
    path, dumps = tmp_path / "dump.yaml", {}
    with running(",".join(NODES), domain, view_rate=40):
        for node in NODES:
            names = list(actor_type(node).parameters_type.model_fields)
            dumped = dict(zip(names, peer.parameters_of(node, *names), strict=True))
            assert (dumped["view_rate"], type(dumped["view_rate"])) == (40.0, float)
            result = peer.set_parameters(node, **dumped)
            assert result.successful, result.reason
            assert peer.set_parameters(node, view_rate=20).successful
            assert peer.parameters_of(node, "view_rate") == [20.0]
            # The same as a file at the start, with a whole number in it.
            dumps[f"/{node}"] = {"ros__parameters": {**dumped, "view_rate": 40}}
    path.write_text(yaml.safe_dump(dumps))
    # After the shipped ones, which are taken too.
    paths = [*(shared(f"config/{node}.yaml") for node in NODES), path]
    files = [word for one in paths for word in ("--params-file", str(one))]
    with running(",".join(NODES), domain, arguments=files):
        for node in NODES:
            assert peer.parameters_of(node, "view_rate") == [40.0]


def test_files_set_parameters_and_slips_are_named(
    domain: int, peer: Peer, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    common, special = tmp_path / "common.yaml", tmp_path / "special.yaml"
    everyone = {"view_rate": 40.0, "message_age_limit": 0.5, "veiw_rate": 30.0}
    common.write_text(yaml.safe_dump({"/**": {"ros__parameters": everyone}}))
    theirs = {"ros__parameters": {"hand_timeout": 0.4, "view_rate": 25.0}}
    others = {"ros__parameters": {"view_rate": 11.0}}
    special.write_text(yaml.safe_dump({DEVICE: theirs, "mechanism_simulator": others}))
    files = ("--params-file", str(common), "--params-file", str(special))
    one = "-p", f"{DEVICE}:force_limit:=2.0"
    with running(DEVICE, domain, arguments=(*files, *one)):
        given = "view_rate", "message_age_limit", "hand_timeout", "force_limit"
        found = peer.parameters_of(DEVICE, *given)
    assert found == [25.0, 0.5, 0.4, 2.0]
    error = capfd.readouterr().err
    assert "'veiw_rate'" in error
    assert "view_rate, " in error
    assert error.count("unknown parameter") == 1
