# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment over real nodes agrees with the session, in four processes and in one."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from hapticmech_ros.experiment.demo import run_demo
from hapticmech_ros.graph import private_environment

pytestmark = [pytest.mark.ros, pytest.mark.alone]

# How far the graph may be from the session on five_bar: what the project promises.
POSITION_MM, ROTATION_DEG = 0.5, 0.5
# A shared machine may stop a process for longer than the control loop can bear, and then the hand
# has let go on purpose. The promise is about runs that were given the time they need.
TRIES = 3
# A command held for longer than this leads away from the session, as it would a real device.
LONGEST_PAUSE_S = 0.012
# At 500 Hz, half the scenes' rate, the constraint's damper changes sign with every sample and grows
# by half each time (docs/nodes.md): a graph starved so for 30 ms need not follow the session.
SLOWEST_RATE_HZ = 400.0


FIGURES = ("fig5a.png", "fig5b.png", "fig5c.png")
POINTS = ("left", "right")


def run(scene: str, out: Path, composed: bool) -> dict[str, Any]:
    stages: list[str] = []
    run_demo(scene, out, composed, show=lambda stage, done: stages.append(stage))
    assert "pushing and recording" in stages
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    assert (out / "bag").is_dir()
    assert all((out / name).is_file() for name in summary["figures"])
    return summary


def was_given_time(summary: dict[str, Any], user: str = "") -> bool:
    nodes = summary["graph"]["nodes"]
    device, controller = f"{user}haptic_device", f"{user}teleoperation_controller"
    if not {device, controller} <= set(nodes):
        # The recorder never heard a node's diagnostics, which says nothing of the motion either.
        return False
    unbroken = nodes[device]["times_held"] == 1 and summary["coverage"]["complete"]
    unbroken = unbroken and nodes[controller]["engagements"] == 1
    motion = summary["coverage"]["groups"]["device and point"]
    even = motion["longest_pause_s"] < LONGEST_PAUSE_S
    return unbroken and even and motion["slowest_rate_hz"] >= SLOWEST_RATE_HZ


@pytest.mark.parametrize(
    ("scene", "composed"),
    [("five_bar", False), ("five_bar", True), ("four_bar_closing", False)],
    ids=["five_bar", "five_bar_composed", "four_bar_closing"],
)
def test_graph_and_session_agree(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: str, composed: bool
) -> None:
    for name, value in private_environment(domain).items():
        monkeypatch.setitem(os.environ, name, value)
    for attempt in range(TRIES):
        summary = run(scene, tmp_path / str(attempt), composed)
        if was_given_time(summary):
            break
    else:
        pytest.skip(f"the machine stopped the graph each time: {summary['coverage']['groups']}")
    assert summary["figures"] == list(FIGURES)
    changes = summary["constraints"]["changes"]
    assert [(change["from"], change["to"]) for change in changes] == [(1, 2)]
    for held in summary["constraints"]["while_held"]:
        # Not the ratio of rms values: of the eighty samples of the constraint part, one that lies
        # beside the change of count, or rings after a late command, is as much as is allowed.
        assert held["force_gain_median"] == pytest.approx(1.0, abs=0.02)
    agreement = summary["agreement"]
    # A loop that latches a few ms later or earlier than the session's moves on from elsewhere.
    assert agreement["count_change_difference_max_s"] < 0.05
    if scene == "five_bar":
        assert agreement["device_deviation_max_mm"] < POSITION_MM
        assert agreement["point_deviation_max_mm"] < POSITION_MM
        assert agreement["device_deviation_max_deg"] < ROTATION_DEG
        assert agreement["point_deviation_max_deg"] < ROTATION_DEG


def test_two_users_agree_with_the_session(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In rms: where left lets go, a period more or less is much."""
    for name, value in private_environment(domain).items():
        monkeypatch.setitem(os.environ, name, value)
    for attempt in range(TRIES):
        summary = run("two_users", tmp_path / str(attempt), composed=True)
        users = summary["users"]
        if all(was_given_time(users[point], f"{point}/") for point in POINTS):
            break
    else:
        covered = {point: user["coverage"]["groups"] for point, user in users.items()}
        pytest.skip(f"the machine stopped the graph each time: {covered}")
    own = [f"{point}/{name}" for point in POINTS for name in FIGURES]
    assert summary["figures"] == ["users.png", "coupling.png", *own]
    assert users["left"]["constraints"]["counts_seen"] == [1]
    changes = users["right"]["constraints"]["changes"]
    assert [(change["from"], change["to"]) for change in changes] == [(1, 2)]
    held, free = summary["spans"]
    assert (
        free["users"]["left"]["hand_force_rms_n"] < 0.05 * held["users"]["left"]["hand_force_rms_n"]
    )
    for point in POINTS:
        agreement = users[point]["agreement"]
        assert agreement["device_deviation_rms_mm"] < POSITION_MM
        assert agreement["point_deviation_rms_mm"] < POSITION_MM
        assert agreement["device_deviation_rms_deg"] < ROTATION_DEG
