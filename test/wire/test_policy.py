# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The policy for SROS2: an enclave for each process, and what it allows."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

from hapticmech_ros.cli import app
from hapticmech_ros.wire.table import (
    NODES,
    ONLOOKERS,
    REAL_DEVICES,
    answered,
    published,
    requested,
    subscribed,
)
from hapticmech_ros.wire.topics import DEVICE, TOPICS


def enclaves(*options):
    done = CliRunner().invoke(app, ["policy", *options])
    assert done.exit_code == 0
    root = ElementTree.fromstring(done.stdout)
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    return {one.attrib["path"]: one for one in root.iter("enclave")}


def allowed(profile, kind, what):
    return {
        one.text for part in profile.findall(kind) if part.attrib == {what: "ALLOW"} for one in part
    }


def test_every_process_has_an_enclave():
    found = enclaves("--namespace", "/left", "--enclaves", "/lab")
    assert set(found) == {f"/lab/{name}" for name in (*NODES, "composed", "operator")}
    for path, enclave in found.items():
        profiles = list(enclave.iter("profile"))
        assert all(one.attrib["ns"] == "/left" for one in profiles)
        nodes = [one.attrib["node"] for one in profiles]
        name = path.rsplit("/", 1)[-1]
        together = [node for node in NODES if node not in ONLOOKERS]
        assert nodes == (together if name == "composed" else [name])


def of_all(node, names):
    """Return names, and for who looks on those of several users, each in a namespace."""
    looks_on = node in ("scene_viewer", "live_page")
    own = ("device", "analysis", "teleoperation_controller")
    of_users = {n for n in names if n.removeprefix("view/").split("/")[0] in own}
    return set(names) | {f"*/{name}" for name in of_users if looks_on}


@pytest.mark.parametrize("node", NODES)
def test_a_node_may_do_what_its_tables_say_and_nothing_else(node):
    (profile,) = enclaves()[f"/hapticmech/{node}"].iter("profile")
    assert allowed(profile, "topics", "publish") == of_all(node, published(node))
    assert allowed(profile, "topics", "subscribe") == of_all(node, subscribed(node))
    assert allowed(profile, "services", "reply") == set(answered(node))
    assert allowed(profile, "services", "request") == of_all(node, requested(node))
    # Drivers of real devices speak in the simulated one's place.
    role = DEVICE if node in REAL_DEVICES else node
    others = {t.name for t in TOPICS if t.publisher not in (role, "every node")}
    assert not others & set(published(node))


def test_nobody_but_the_controller_may_command_the_device():
    found = enclaves()
    may = {
        path
        for path, enclave in found.items()
        for profile in enclave.iter("profile")
        if "device/servo_cf" in allowed(profile, "topics", "publish")
    }
    assert may == {"/hapticmech/teleoperation_controller", "/hapticmech/composed"}


def test_the_operator_pushes_records_and_calls_services():
    (profile,) = enclaves()["/hapticmech/operator"].iter("profile")
    pushes = allowed(profile, "topics", "publish")
    assert {"device/hand_cf", "device/hand_cf/*", "mechanism/*/external_cf"} <= pushes
    heard_of = allowed(profile, "topics", "subscribe")
    assert {t.name.replace("{point}", "*") for t in TOPICS} <= heard_of
    asked = allowed(profile, "services", "request")
    assert {"device/emergency_stop", "haptic_device/change_state"} <= asked
