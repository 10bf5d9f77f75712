"""What researchers use from Python: joints by name, columns of runs, changed scenes, reprs."""

from __future__ import annotations

import numpy as np
import pytest

import hapticmech_ros
from hapticmech_ros import (
    InvalidInputError,
    Mechanism,
    SceneError,
    Session,
    changed_scene,
    load_scene,
)
from hapticmech_ros.scene import shipped_scenes


def test_every_public_name_is_there() -> None:
    for name in hapticmech_ros.__all__:
        assert getattr(hapticmech_ros, name).__doc__


@pytest.mark.parametrize("name", shipped_scenes())
def test_joints_are_found_by_name_and_cover_all_coordinates(name: str) -> None:
    mechanism = Mechanism(load_scene(name))
    q, v = np.zeros(mechanism.nq), np.zeros(mechanism.nv)
    for joint in mechanism.tree.joint_names:
        in_q, in_v = mechanism.joint_slices(joint)
        q[in_q] += 1.0
        v[in_v] += 1.0
    assert (q == 1.0).all()
    assert (v == 1.0).all()
    with pytest.raises(InvalidInputError, match="must be one of"):
        mechanism.joint_slices("nobody")


def test_columns_of_a_run_are_its_rows() -> None:
    run = Session(load_scene("two_link")).run(20)
    columns = run.columns()
    assert len(columns) == run.rows.shape[1]
    np.testing.assert_array_equal(np.column_stack(list(columns.values())), run.rows)
    np.testing.assert_array_equal(columns["twist_1"], run["twist"][:, 1])
    np.testing.assert_array_equal(columns["time"], run["time"])


def test_a_changed_scene_is_validated_and_the_first_one_stays() -> None:
    scene = load_scene("two_link")
    heavier = changed_scene(scene, "links[0].inertial.mass=2.5", "device.mass=0.4")
    assert heavier.links[0].inertial.mass == 2.5
    assert heavier.device.mass == 0.4
    assert scene == load_scene("two_link")
    assert changed_scene(scene) == scene
    with pytest.raises(SceneError, match=r"device\.mass"):
        changed_scene(scene, "device.mass=-1")
    with pytest.raises(SceneError, match="unknown key"):
        changed_scene(scene, "device.masss=1")


def test_objects_say_what_they_are_in_a_line() -> None:
    session = Session(load_scene("five_bar"))
    run = session.run(5)
    for thing, words in (
        (session.scene, ["five_bar", "links"]),
        (session, ["five_bar", "0.005 s"]),
        (session.simulator.mechanism, ["five_bar", "nv 4", "ground_pin", "handle"]),
        (run, ["5 ticks", "twist"]),
    ):
        shown = repr(thing)
        assert "\n" not in shown
        assert len(shown) < 600
        assert all(word in shown for word in words), shown
