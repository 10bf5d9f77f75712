# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a run: they pass what is right, and each wrong is found by one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from benchmarks.graph.checks import Check, Expected, check_recording, check_run, expected
from benchmarks.graph.recorded import Recorded
from benchmarks.graph.statuses import RATE, Status
from hapticmech_ros.loading import load_scene
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, DEVICE, MECHANISM

SESSION = Expected((1, 2), (("ground_pin",),), True)
BEFORE: Mapping[str, tuple[str, dict[str, float]]] = {
    DEVICE: ("rendering", {"periods": 10.0, "missed_deadlines": 1.0}),
    MECHANISM: (
        "closed loops: ground_pin",
        {"periods": 10.0, "missed_deadlines": 0.0, "failures": 0.0, "closure_error": 1e-12},
    ),
    ANALYSER: ("2 joint constraints", {"analyses": 5.0}),
    CONTROLLER: ("engaged", {"answers": 5.0, "engagements": 1.0}),
}
COUNTERS = ("periods", "analyses", "answers")


def ends() -> dict[str, tuple[Status, Status]]:
    found = {}
    for node, (message, figures) in BEFORE.items():
        before = Status(node, 0, message, {**figures, "refused_messages": 2.0})
        grown = {key: value + 1000.0 * (key in COUNTERS) for key, value in before.figures.items()}
        found[node] = before, replace(before, stamp_ns=1_000_000_000, figures=grown)
    return found


def broken(
    node: str = "",
    message: str = "",
    session: Expected = SESSION,
    kind: str = "real",
    **figures: float,
) -> list[Check]:
    """Return the checks that do not hold where a node's last status is changed."""
    pairs = ends()
    if node:
        first, last = pairs[node]
        changed = {**last.figures, **figures}
        pairs[node] = first, replace(last, message=message or last.message, figures=changed)
    within = [status for pair in pairs.values() for status in pair]
    return [check for check in check_run(kind, pairs, within, session) if not check.held]


def test_a_graph_that_does_its_work_passes() -> None:
    assert broken() == []
    assert broken(kind="bare") == []


@pytest.mark.parametrize(
    ("node", "message", "figures", "rule"),
    [
        (CONTROLLER, "waiting for device/state", {}, "engaged"),
        (CONTROLLER, "", {"engagements": 2.0}, "engaged"),
        (CONTROLLER, "", {"answers": 5.0}, "answer"),
        (ANALYSER, "", {"analyses": 5.0}, "answer"),
        (DEVICE, "", {"periods": 10.0}, "publish"),
        (DEVICE, "", {"refused_messages": 3.0}, "refused"),
        (MECHANISM, "", {"failures": 1.0}, "fails"),
        (MECHANISM, "", {"closure_error": 1e-6}, "stay closed"),
        (MECHANISM, "closed loops: none", {}, "closed in the session"),
        (ANALYSER, "3 joint constraints", {}, "constraints"),
        (ANALYSER, "1 joint constraints", {}, "constraints"),
        (ANALYSER, "unknown joint constraints", {}, None),
    ],
)
def test_each_wrong_is_found(
    node: str, message: str, figures: dict[str, float], rule: str | None
) -> None:
    found = broken(node, message, **figures)
    if rule is None:
        # Nothing said now, but the right count before: no reason to fail.
        assert found == []
        return
    (check,) = found
    assert rule in check.rule


def test_a_count_that_may_still_change_is_not_held_against_the_graph() -> None:
    changing = replace(SESSION, settled=False)
    assert broken(ANALYSER, "1 joint constraints", changing) == []
    assert len(broken(ANALYSER, "3 joint constraints", changing)) == 1


def test_the_bare_graph_need_not_feel_anything() -> None:
    assert broken(ANALYSER, "engaged", kind="bare") == []
    assert len(broken(CONTROLLER, "waiting for messages", kind="bare")) == 1


def test_the_session_says_what_to_expect() -> None:
    scene = load_scene("five_bar")
    short = expected(scene, 0.05)
    assert short == Expected((1,), (("ground_pin",),), False)
    # Links 3 and 4 pull taut once, at about 2.5 s.
    assert expected(scene, 4.0) == Expected((1, 2), (("ground_pin",),) * 2, True)


def test_a_recorder_that_comes_late_or_leaves_early_is_found() -> None:
    rates = {f"{node}: {RATE}": 1000.0 for node in (DEVICE, MECHANISM)}

    def received(device: int, mechanism: int) -> bool:
        published = {"/device/state": device, "/mechanism/state": mechanism}
        return check_recording(Recorded({}, published, {}), rates, 20.0, "handle").held

    assert received(20_000, 20_000)
    assert received(19_990, 20_010)
    assert not received(19_000, 20_000)
    assert not received(20_000, 0)
