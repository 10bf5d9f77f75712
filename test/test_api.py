# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What researchers use from Python: joints by name, columns of runs, changed scenes, reprs."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hapticmech_ros
from hapticmech_ros import InvalidInputError, Mechanism, SceneError, Session, load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.scene.device import Device


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


def test_a_changed_scene_has_the_changes_and_the_first_one_stays() -> None:
    scene = load_scene("two_link")
    heavier = scene.with_("links[0].inertial.mass=2.5", "device.mass=0.4")
    assert heavier.links[0].inertial.mass == 2.5
    assert heavier.device.mass == 0.4
    assert scene == load_scene("two_link")
    assert scene.with_() == scene


def test_objects_say_what_they_are_in_a_line() -> None:
    session = Session(load_scene("five_bar"))
    run = session.run(5)
    sample = Session(session.scene).tick()
    for thing, words in (
        (session.scene, ["five_bar", "links"]),
        (session, ["five_bar", "0.005 s"]),
        (session.simulator.mechanism, ["five_bar", "nv 4", "ground_pin", "handle"]),
        (session.simulator, ["five_bar", "0.001 s"]),
        (session.mechanism, ["0.005 s", "nv 4", "1 of 1 closures"]),
        (sample, ["0 s", "1 joint constraints"]),
        (sample.analysis, ["rank 2 of 3"]),
        (sample.device, ["m"]),
        (run, ["5 ticks", "time, q, v"]),
    ):
        shown = repr(thing)
        assert "\n" not in shown
        assert len(shown) < 130, shown
        assert all(word in shown for word in words), shown


def test_a_scene_with_other_keys_is_validated() -> None:
    scene = load_scene("two_link")
    links = [link.model_copy() for link in scene.links]
    other = scene.with_("device.mass=0.4", gravity=np.array((0.0, -9.81, 0.0)), links=links)
    assert other == scene.with_("device.mass=0.4", "gravity=[0, -9.81, 0]")
    assert other.with_(gravity=scene.gravity, device=scene.device) == scene


@pytest.mark.parametrize(
    ("texts", "keys", "error", "rule"),
    [
        (("device.mass=-1",), {}, SceneError, r"device\.mass"),
        (("device.masss=1",), {}, SceneError, "unknown key"),
        ((), {"gravity": (0.0, 1.0)}, SceneError, "gravity"),
        ((), {"masss": 1.0}, SceneError, "unknown key"),
        ((), {"hand": Device()}, SceneError, "hand"),
        ((), {"name": {1, 2}}, TypeError, "cannot be written into a scene"),
    ],
)
def test_a_change_that_a_scene_cannot_have_is_refused(
    texts: tuple[str, ...], keys: dict[str, Any], error: type[Exception], rule: str
) -> None:
    with pytest.raises(error, match=rule):
        load_scene("two_link").with_(*texts, **keys)


def test_joints_with_one_degree_of_freedom_have_an_index() -> None:
    mechanism = Mechanism(load_scene("five_bar"))
    assert [mechanism.joint_index(f"joint{k}") for k in (1, 2, 3, 4)] == [0, 1, 2, 3]
    floating = Mechanism(load_scene("shared_payload"))
    base = next(name for name in floating.tree.joint_names if _size(floating, name) > 1)
    with pytest.raises(InvalidInputError, match="one degree of freedom"):
        floating.joint_index(base)
    with pytest.raises(InvalidInputError, match="must be one of"):
        floating.joint_index("nobody")


def _size(mechanism: Mechanism, joint: str) -> int:
    _, in_v = mechanism.joint_slices(joint)
    return in_v.stop - in_v.start


@pytest.mark.parametrize("name", ["five_bar", "spatial_arm", "peg_in_hole"])
def test_a_sample_has_the_numbers_of_the_run(name: str) -> None:
    scene = load_scene(name)
    ticked, run = Session(scene), Session(scene).run(30).columns()
    samples = [ticked.tick().columns() for _ in range(30)]
    for column in samples[0]:
        found = np.array([sample[column] for sample in samples])
        np.testing.assert_array_equal(found, run[column], err_msg=column)
    assert len(samples[0]) > 150
    sample = Session(scene).tick()
    np.testing.assert_array_equal(sample.to_numpy(), list(sample.columns().values()))


def test_a_run_is_an_array_and_a_data_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Session(load_scene("two_link")).run(20)
    assert run.to_numpy() is run.rows
    chosen = run.to_numpy("time", "twist")
    np.testing.assert_array_equal(chosen[:, 0], run["time"])
    np.testing.assert_array_equal(chosen[:, 1:], run["twist"])
    with pytest.raises(KeyError, match="must be one of"):
        run.to_numpy("nothing")
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        run.to_dataframe()
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=dict))
    frame = run.to_dataframe()
    assert list(frame) == list(run.columns())
    np.testing.assert_array_equal(frame["twist_1"], run["twist"][:, 1])
