# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed benchmark's first question: do all simulators compute the same motion?"""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from benchmarks.accuracy import cases
from benchmarks.accuracy.cases import Output
from benchmarks.speed import benchmark, mujoco_peer, reference
from benchmarks.speed.benchmark import plan
from benchmarks.speed.contender import (
    Method,
    Peer,
    UnsuitableError,
    initial_state,
    refuse_what_no_peer_has,
)
from benchmarks.speed.equality import Check, bound_of, check
from benchmarks.speed.mujoco_peer import MUJOCO, MujocoScene
from benchmarks.speed.own_peer import own_peer
from benchmarks.speed.pinocchio_peer import LOOPS, PINOCCHIO
from benchmarks.speed.problems import ASKED, Problem, problems
from benchmarks.speed.result import run_once
from benchmarks.speed.scaling import chain
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene, document_of, scene_from_document
from sampling import sampled

PROBLEMS = {problem.name: problem for problem in problems()}
# Of large ones a second takes too long for a test; the same generator makes the small ones.
SMALL = [name for name, problem in PROBLEMS.items() if not problem.large]
PEERS = plan().peers


def of(problem: Problem, peer: Peer, method: str) -> Check:
    chosen = next(one for one in peer.methods if one.name == method)
    return check(problem, peer, chosen)


@pytest.mark.parametrize("name", sampled(SMALL, every=2))
@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
def test_all_simulators_compute_the_same_motion(peer: Peer, name: str) -> None:
    found = {one.method: one for one in (check(PROBLEMS[name], peer, m) for m in peer.methods)}
    # lcaba needs loops, and does not give the accelerations of a rod on a ball.
    lcaba = found.pop(LOOPS, None)
    if lcaba is not None:
        loops = any(closure.active for closure in PROBLEMS[name].scene.closures)
        assert lcaba.passed == (loops and name != "spatial_four_bar"), lcaba.reason
    assert found
    assert all(one.passed for one in found.values()), [one.reason for one in found.values()]


def test_by_the_same_rule_we_and_others_have_the_same_error() -> None:
    # Without closures nothing differs but rounding.
    ours = of(PROBLEMS["spatial_arm"], own_peer(), "rk4")
    for peer in (MUJOCO, PINOCCHIO):
        theirs = of(PROBLEMS["spatial_arm"], peer, "rk4")
        assert theirs.coarse == pytest.approx(ours.coarse, rel=1e-2)
    assert ours.fine is not None
    assert ours.coarse is not None
    # Order 4: half the step leaves a sixteenth.
    assert ours.coarse / ours.fine == pytest.approx(16.0, rel=0.1)


def test_references_agree_with_published_values() -> None:
    compared = 0
    for case in cases():
        problem = PROBLEMS.get(case.name)
        for output in case.outputs if problem is not None else ():
            for other in problem.outputs:
                if other.name != output.name:
                    continue
                for time, values in zip(output.times, output.values, strict=True):
                    if time in other.times:
                        mine = other.values[other.times.index(time)]
                        assert np.abs(np.array(mine) - values).max() < output.tolerance
                        compared += 1
    # Two of the pendulum, three and one of A02, two of Bricard's mechanism, seven of Andrews'.
    assert compared >= 13


def test_the_stored_reference_is_what_its_command_computes() -> None:
    asked = next(one for one in ASKED if one.name == "pendulum")
    readings, _ = reference.reference(asked.scene, asked.outputs)
    assert PROBLEMS["pendulum"].error(readings) < 1e-12
    windows = reference.parallelograms(10, PROBLEMS["n_four_bar_10"].times)
    assert PROBLEMS["n_four_bar_10"].error(windows) < 1e-12


@pytest.mark.parametrize("name", ["five_bar", "bricard", "andrews", "spatial_arm"])
def test_a_converted_scene_has_our_inertia(name: str) -> None:
    scene = PROBLEMS[name].scene
    converted, start = MujocoScene(scene), initial_state(scene)
    model = converted.spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = converted.state(start)
    mujoco.mj_forward(model, data)
    theirs = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, theirs)
    ours = pin.crba(converted.tree.pinocchio, converted.tree.pinocchio.createData(), start.q)
    ours = np.triu(ours) + np.triu(ours, 1).T
    assert np.abs(theirs - ours).max() < 1e-9 * np.abs(ours).max()


def test_a_peer_that_is_not_there_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "find_spec", lambda name: name != "mujoco")
    found = plan(["pendulum"])
    assert [peer.name for peer in found.peers] == ["hapticmech", "pinocchio"]
    assert set(found.absent) == {"mujoco"}
    assert "pip install '.[bench]'" in found.absent["mujoco"]


def test_what_simulators_do_not_agree_on_is_refused() -> None:
    document = document_of(chain(1))
    document["links"][0]["joint"]["friction"] = 1.0
    rubbing = scene_from_document(document)
    with pytest.raises(UnsuitableError, match="friction in hinge0"):
        refuse_what_no_peer_has(rubbing, "mujoco")
    result, contender = run_once(
        PROBLEMS["pendulum"], initial_state(rubbing), MUJOCO, Method("rk4", 4), 1e-3, {}
    )
    assert result.error is not None
    assert contender is not None
    document["links"][0]["joint"] |= {
        "friction": 0.0,
        "limits": {"lower": -1.0, "upper": 1.0, "stiffness": 100.0},
    }
    with pytest.raises(UnsuitableError, match="stops of hinge0"):
        MujocoScene(scene_from_document(document))


# What has loops of kinds that no problem has, and which peers take it.
TIED: dict[str, set[str]] = {"rod": set(), "weld": {"mujoco", "pinocchio"}, "gear": set()}


def tied(kind: str) -> Scene:
    """Return a chain of two rods that are geared to each other, or whose end holds a third one."""
    document = document_of(chain(2)) | {"task_space": "spatial"}
    if kind == "gear":
        gear = {"name": "gear", "joint": "hinge1", "leader": "hinge0", "ratio": -2.0}
        document["couplings"] = [gear]
        return scene_from_document(document)
    third = document["links"][0] | {"name": "third", "joint": {"name": "loose", "type": "free"}}
    document["links"].append(third)
    end = {"link": "rod1", "origin": {"xyz": [1.0, 0.0, 0.0]}}
    tie = {"name": "tie", "kind": kind, "a": end, "b": {"link": "third"}}
    document["closures"] = [tie | ({"length": 0.5} if kind == "rod" else {})]
    document["initial_state"]["q"]["loose"] = [2.5, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0]
    return scene_from_document(document)


@pytest.mark.parametrize("kind", TIED)
def test_loops_of_other_kinds_are_done_right_or_refused(kind: str) -> None:
    scene, tip = tied(kind), Output("point", "tip", (0, 1), (0.1,), (), 0.0)
    start, step = initial_state(scene), 1e-4

    def end(peer: Peer, method: Method) -> np.ndarray:
        contender = peer.contender(scene, start, method, step, method.settings_for(scene)[0])
        contender.advance(round(tip.times[0] / step))
        return np.array(contender.read((tip,))[0])

    ours, did = end(own_peer(), Method("rk4", 4)), set()
    for peer in PEERS[1:]:
        for method in peer.methods:
            try:
                theirs = end(peer, method)
            except UnsuitableError:
                continue
            assert np.abs(theirs - ours).max() < bound_of(peer.name, Method("", 2)), method.name
            did.add(peer.name)
    assert did == TIED[kind]


def test_joints_that_peers_have_not_are_refused() -> None:
    document = document_of(chain(1))
    document["links"][0]["joint"] |= {"type": "planar"}
    document["initial_state"] = {}
    scene = scene_from_document(document)
    for peer in PEERS[1:]:
        with pytest.raises(UnsuitableError, match="a planar joint"):
            peer.contender(scene, initial_state(scene), peer.methods[0], 1e-3, {})


def test_a_motion_that_is_lost_is_a_line_not_a_crash() -> None:
    problem = PROBLEMS["n_four_bar_2"]
    start = initial_state(problem.scene)
    method = Method("rk4", 4)
    setting = {mujoco_peer.CONSTANT: 0.01, mujoco_peer.EXACT: 1.0}
    result, contender = run_once(problem, start, MUJOCO, method, 0.05, setting)
    assert result.error is None
    assert "lost" in result.failure
    assert contender is None


def test_a_step_that_misses_a_time_is_refused() -> None:
    output = Output("point", "tip", (0,), (0.5, 1.0), (), 0.0)
    assert output.numbers(0.25) == [2, 4]
    with pytest.raises(InvalidInputError, match=r"must divide 0\.5 s"):
        output.numbers(0.3)
