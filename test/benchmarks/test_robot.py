# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of robots: the same robot in MuJoCo, tasks that can be done, honest choices."""

import numpy as np
import pytest

from benchmarks.robot.benchmark import EQUAL, choose, difference
from benchmarks.robot.bilateral import felt
from benchmarks.robot.laws import IMPEDANCE, others, ours
from benchmarks.robot.other_paths import FAR, PATHS, UNKNOWN
from benchmarks.robot.tasks import PATH_S, TASKS, wrist_path
from benchmarks.robot.trial import Measured, Stage
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.robot.law import OperationalLaw
from sampling import long_ones, sampled


@pytest.mark.parametrize("name", sorted(TASKS))
def test_mujoco_has_the_same_inertia_weight_and_jacobian(name):
    task = TASKS[name]()
    assert difference(OperationalLaw(Mechanism(task.scene)), poses=20) <= EQUAL


@pytest.mark.parametrize("name", sorted(TASKS))
def test_targets_have_the_twist_and_acceleration_of_their_motion(name):
    task, h = TASKS[name](), 1e-4
    for time in np.linspace(0.2, PATH_S - 0.2, 9):
        before, at, after = (task.path(float(time + k * h)) for k in (-1, 0, 1))
        # Central differences: an error of h² of the third derivative, some 10 m/s³, over 6.
        moved = (after.pose.translation - before.pose.translation) / (2.0 * h)
        np.testing.assert_allclose(moved, at.twist[:3], atol=1e-6)
        np.testing.assert_allclose(
            (after.twist - before.twist) / (2.0 * h), at.acceleration, atol=1e-5
        )


@long_ones
def test_from_where_directions_count_as_rigid_changes_little():
    """s_off from 0.1 to 0.4, with friction on the path that this law was once behind on."""
    task = wrist_path(*(np.array(end) for end in PATHS[3]))
    stage = Stage(task, UNKNOWN[1])
    errors = [stage.path_error(ours(task, True, 0.0, s_off)) for s_off in (0.1, 0.2, 0.4)]
    assert max(errors) < 1.25 * min(errors)
    assert max(errors) < stage.path_error(ours(task, True, FAR))


class Scripted:
    """A stage whose results are given by the setting's value."""

    def run(self, setting, most):
        kind = setting.values["kind"]
        if kind == "lost":
            raise HapticMechError("lost")
        drift = 2.0 if kind == "flipped" else 0.0
        if setting.values["error"] > most:
            raise HapticMechError("worse")
        saturated = 5 if kind == "saturated" else 0
        error = setting.values["error"]
        return Measured(error, error, 0.0, 0.0, 0.0, 0.0, 0.0, drift, saturated)


def test_the_best_setting_is_chosen_and_failures_do_not_count():
    setting = others(quick=True)[IMPEDANCE][0]
    kinds = [("lost", 0.0), ("flipped", 0.1), ("saturated", 0.2), ("kept", 2.0), ("kept", 1.0)]
    tried = [setting._replace(values={"kind": kind, "error": error}) for kind, error in kinds]
    shown = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("benchmarks.robot.benchmark.setting_text", str)
        found, best = choose(
            "robot", "as modelled", "law", tried, [Scripted(), Scripted()], shown.append
        )
    assert best is tried[4]
    assert found.tried == 5
    assert len(shown) == 5
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("benchmarks.robot.benchmark.setting_text", str)
        assert (
            choose("robot", "as modelled", "law", tried[:3], [Scripted()], shown.append)[1] is None
        )


@pytest.mark.parametrize(
    ("interface", "with_rates"),
    sampled([("effort", False), ("velocity", False), ("position", True)], every=3),
)
def test_at_rest_the_hand_carries_what_the_robot_pushes_on_the_wall(interface, with_rates):
    """The mechanism at rest is in balance: what acts on one end is what acts on the other."""
    found = felt(interface, 1.0, with_rates)
    assert found.wall_n > 3.0
    # Half of the force's range, 2.5 s after the hand has stopped, and the spring that turns the
    # hand, 1 mN m/rad, up to π rad away on a lever of 45 mm.
    left = found.swing_n + 1e-3 * np.pi / 0.045
    assert found.hand_n == pytest.approx(found.wall_n, abs=left)
    assert found.passive
    assert found.coupling_j <= 0.0
    assert felt(interface, 0.0, with_rates).hand_n < 0.05 * found.hand_n
