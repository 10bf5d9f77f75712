# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Configurations that close a scene's loops, from starts that do not."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml

from commands import ran
from hapticmech_ros import InvalidInputError, Simulator, load_scene
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.offline.assembly_search import initial_state, search_assemblies

# Bars of 1, 2, 1.5 and 1.8 m: a four-bar that can turn, with two assemblies at each angle.
BARS = (1.0, 2.0, 1.5, 1.8)


def four_bar(start=(0.5, 0.0, 0.0), bars=BARS, extra=""):
    ground, a, b, c = bars
    links = "".join(
        f"""
  - name: l{k}
    parent: {parent}
    joint: {{name: j{k}, type: revolute, axis: [0, 0, 1], origin: {{xyz: [{x}, 0, 0]}}{extra}}}
    inertial: {{mass: 1.0, com: [{0.5 * length}, 0, 0],
      inertia: {{ixx: 0.01, iyy: 0.1, izz: 0.1}}}}"""
        for k, parent, x, length in ((1, "world", 0, a), (2, "l1", a, b), (3, "l2", b, c))
    )
    return f"""
format: hapticmech-scene/1
name: four_bar
task_space: planar
links:{links}
closures:
  - {{name: pin, kind: planar_pin, a: {{link: l3, origin: {{xyz: [{c}, 0, 0]}}}},
     b: {{link: world, origin: {{xyz: [{ground}, 0, 0]}}}}}}
operational_points:
  - {{name: tip, link: l1}}
initial_state: {{q: {{j1: {start[0]}, j2: {start[1]}, j3: {start[2]}}}}}
hand: {{kind: constant_wrench}}
"""


def written(tmp_path, text):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


def end_of(q, bars=BARS):
    """Where the last bar ends, by plane trigonometry."""
    angles = np.cumsum(q)
    return sum(
        length * np.array([np.cos(angle), np.sin(angle)])
        for length, angle in zip(bars[1:], angles, strict=True)
    )


def test_a_four_bar_is_closed_as_trigonometry_says(tmp_path):
    found = search_assemblies(load_scene(written(tmp_path, four_bar())))
    assert found.closed > 5
    for one in found.found:
        np.testing.assert_allclose(end_of(one.q), [BARS[0], 0.0], atol=1e-11)
    moved = [one.moved for one in found.found]
    assert moved == sorted(moved)
    # Angles are within half a turn of those written.
    assert np.abs(found.found[0].q - [0.5, 0.0, 0.0]).max() <= np.pi
    (loop,) = found.residuals
    assert (loop.name, loop.kind, loop.angle) == ("pin", "planar_pin", None)
    assert loop.distance < 1e-11
    (before,) = found.written
    start = end_of(np.array([0.5, 0.0, 0.0])) - [BARS[0], 0.0]
    assert before.distance == pytest.approx(np.abs(start).max())


def test_one_that_cannot_close_says_by_how_much(tmp_path):
    """Bars of 0.2 m each cannot reach over 1 m: 0.4 m are missing, whatever the start.

    And whoever shares the starts.
    """
    bars = (1.0, 0.2, 0.2, 0.2)
    loaded = load_scene(written(tmp_path, four_bar(bars=bars)))
    found = search_assemblies(loaded, starts=20, processes=1)
    assert not found.found
    shared = search_assemblies(loaded, starts=20, processes=2)
    np.testing.assert_array_equal(found.open_q, shared.open_q)
    assert found.starts == shared.starts == 20
    assert found.residuals[0].distance == pytest.approx(0.4, rel=1e-6)
    with pytest.raises(ClosureError):
        Simulator(loaded).initial_state()


def test_a_configuration_within_stops_comes_first(tmp_path):
    extra = ", limits: {lower: -3.0, upper: -0.1, stiffness: 100.0}"
    text = four_bar(start=(-0.5, -0.2, -0.2), extra=extra)
    found = search_assemblies(load_scene(written(tmp_path, text)))
    assert found.found[0].beyond == ()
    assert (found.found[0].q < -0.1).all()
    for one in found.found:
        outside = tuple(f"j{k + 1}" for k, at in enumerate(one.q) if not -3.0 <= at <= -0.1)
        assert one.beyond == outside


@pytest.mark.parametrize("name", ["stewart_platform", "bricard", "scissor_lift", "crane"])
def test_shipped_scenes_close_from_a_start_that_is_not_theirs(name):
    """From zero angles, which none of them starts at."""
    loaded = load_scene(name)
    state = loaded.initial_state.model_copy(update={"q": {}})
    found = search_assemblies(loaded.model_copy(update={"initial_state": state}), processes=1)
    assert found.found, name
    q = found.found[0].q
    mechanism = Mechanism(loaded)
    residual = mechanism.closing_terms(q, mechanism.initially_active).residual
    assert np.abs(residual).max() <= 1e-12


def test_a_scene_without_loops_has_nothing_to_assemble():
    with pytest.raises(InvalidInputError, match="no closed loop"):
        search_assemblies(load_scene("two_link"))
    with pytest.raises(InvalidInputError, match="1 or more"):
        search_assemblies(load_scene("five_bar"), starts=0)


def test_the_command_writes_a_scene_that_starts_closed(tmp_path):
    path = written(tmp_path, four_bar(start=(2.5, 2.5, 2.5)))
    out, picture = tmp_path / "closed.yaml", tmp_path / "closed.png"
    command = ["scene", "assemble", str(path), "--out", str(out), "--picture", str(picture)]
    done = ran(*command)
    assert picture.stat().st_size > 10_000
    closed = load_scene(out)
    q = [closed.initial_state.q[name] for name in ("j1", "j2", "j3")]
    np.testing.assert_allclose(end_of(q), [BARS[0], 0.0], atol=1e-11)
    shown = next(line for line in done.splitlines() if line.startswith("initial_state:"))
    assert yaml.safe_load(shown)["initial_state"]["q"] == {
        f"j{k + 1}": at for k, at in enumerate(q)
    }
    # Nothing is left to close.
    state = Simulator(closed).initial_state()
    np.testing.assert_allclose(state.q, q, atol=1e-11)


def test_the_command_fails_where_nothing_closes_and_draws_the_open_pose(tmp_path):
    path = written(tmp_path, four_bar(bars=(1.0, 0.2, 0.2, 0.2)))
    out, picture = tmp_path / "closed.yaml", tmp_path / "open.png"
    command = ["scene", "assemble", str(path), "--starts", "8"]
    done = ran(*command, "--out", str(out), "--picture", str(picture), code=1)
    assert "no configuration closes all loops" in done
    assert "0.4 m" in done
    assert picture.exists()
    assert not out.exists()


def test_a_model_file_is_assembled_into_a_scene_beside_it(tmp_path):
    ran("scene", "assemble", "examples/pantograph.yaml", "--out", str(tmp_path / "p.yaml"))
    assert Simulator(load_scene(tmp_path / "p.yaml")).initial_state() is not None


def test_initial_states_keep_velocities_and_locked_joints():
    for name in shipped_scenes():
        loaded = load_scene(name)
        given = json.loads(initial_state(loaded, np.array(Simulator(loaded).initial_state().q)))
        assert given["v"] == {
            k: v if isinstance(v, float) else list(v) for k, v in loaded.initial_state.v.items()
        }
        locked = {link.joint.name for link in loaded.links if link.joint.locked}
        for joint in locked & set(loaded.initial_state.q):
            assert given["q"][joint] == loaded.initial_state.q[joint]
