# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which integrator takes the least time at a wanted error."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import Session, load_scene
from hapticmech_ros.errors import HapticMechError, InvalidInputError, SceneError
from hapticmech_ros.plan import step_accuracy
from hapticmech_ros.plan.step_accuracy import StepChoice, StepChoices, experiment_run, step_choices

SHORT = "experiment.duration=0.4"
COMMAND = ("scene", "steps", "two_link", "--set", SHORT)


def clock():
    """Return no time at all: what is tried does not depend on it."""
    return 0.0


def test_of_each_integrator_the_fewest_steps_that_are_accurate_enough():
    scene = load_scene("two_link", changes=[SHORT])
    shares: list[float] = []
    found = step_choices(scene, 1e-7, clock, lambda _, share: shares.append(share))
    assert 0.0 == shares[0] < shares[-1] < 1.0
    assert shares == sorted(shares)
    assert found.reference_m < 1e-8
    assert [one.integrator for one in found.tried] == [
        *("rk4", "tsit5", "rk2", "semi_implicit_euler", "linearly_implicit")
    ]
    # The same errors by sessions that are put side by side here, with a finer reference.
    ticks = round((scene.hand.start_delay + 0.4) / scene.simulation.period)
    exact = Session(scene.stepped(integrator="rk4", substeps=64)).run(ticks)["position"]
    for one in found.tried:
        assert one.failed == ""

        def error(substeps, one=one):
            run = Session(scene.stepped(integrator=one.integrator, substeps=substeps)).run(ticks)
            return np.linalg.norm(run["position"] - exact, axis=1).max()

        # The error counts rotation as well.
        assert error(one.substeps) <= one.error_m * 1.01 + 1e-12
        if one.error_m > found.wanted_m:
            assert one.substeps == 32
        else:
            assert one.substeps == 1 or one.substeps & (one.substeps - 1) == 0
    by_name = {one.integrator: one for one in found.tried}
    assert by_name["rk4"].substeps == by_name["tsit5"].substeps == 1
    assert by_name["semi_implicit_euler"].substeps > by_name["rk2"].substeps


def test_the_cheapest_of_those_that_are_accurate_enough_is_the_best():
    one = StepChoice("rk4", 1, 1e-9, 3.0)
    others = replace(one, integrator="rk2", substeps=4, error_m=9e-7, time_s=2.0)
    cheap = replace(one, integrator="semi_implicit_euler", error_m=2e-6, time_s=1.0)
    failed = StepChoice("tsit5", 32, failed="came apart")
    assert StepChoices(1e-6, 0.0, (one, others, cheap, failed)).best is others
    assert StepChoices(1e-12, 0.0, (one, failed)).best is None


@pytest.mark.parametrize("error", [0.0, -1.0, float("nan"), float("inf"), 1e-17])
def test_errors_that_cannot_be_told_are_refused(error):
    with pytest.raises(InvalidInputError, match="error"):
        step_choices(load_scene("two_link", changes=[SHORT]), error, time.process_time)


def test_json_has_no_numbers_that_json_has_not(monkeypatch):
    def run(scene):
        if scene.simulation.integrator == "rk2":
            raise HapticMechError("it cannot")
        return experiment_run(scene)

    monkeypatch.setattr(step_accuracy, "experiment_run", run)
    found = json.loads(ran(*COMMAND, "--error", "1e-5", "--json"), parse_constant=pytest.fail)
    (failed,) = (one for one in found["tried"] if one["failed"])
    assert failed["integrator"] == "rk2"
    assert failed["error_m"] is failed["time_s"] is None


def test_the_command_says_what_to_set():
    shown = ran(*COMMAND, "--error", "1e-5")
    assert "--set simulation.integrator=" in shown
    # A scene with it does what was promised.
    changes = [word for word in shown.split() if word.startswith("simulation.")]
    assert len(changes) == 2
    load_scene("two_link", changes=changes)


def test_a_copy_of_the_scene_has_what_takes_the_least_time(tmp_path):
    command = [*COMMAND, "--error", "1e-5", "--out", tmp_path / "mine.yaml"]
    best = json.loads(ran(*command, "--json"))["best"]
    mine = load_scene(tmp_path / "mine.yaml")
    assert best["error_m"] <= 1e-5
    assert mine.simulation.integrator == best["integrator"]
    assert mine.simulation.substeps == best["substeps"]
    assert mine.experiment.duration == 0.4
    # A file that exists is not written over.
    with pytest.raises(SceneError, match="exists"):
        ran(*command)


def test_no_copy_is_made_where_nothing_is_accurate_enough(tmp_path, monkeypatch):
    monkeypatch.setattr(step_accuracy, "MOST_SUBSTEPS", 1)
    monkeypatch.setattr(step_accuracy, "get_args", lambda _: ["semi_implicit_euler"])
    ran(*COMMAND, "--error", "1e-7", "--out", tmp_path / "mine.yaml", code=1)
    assert not list(tmp_path.iterdir())
