# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ablation's scenes, its check, its sums, its files and its command; no times."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.ablation.findings import ablation_steps, moves_alike, unused
from benchmarks.ablation.loop import PARTS, Loop
from benchmarks.ablation.scenes import Pair, Variant, ladder, pairs
from hapticmech_ros.plan.scene_plan import ScenePlan, plan_scene
from hapticmech_ros.session import Session

LADDER, PAIRS = ladder(), pairs()


def plain(variant: Variant) -> ScenePlan:
    return plan_scene(variant.scene())


@pytest.mark.parametrize("variant", LADDER, ids=lambda variant: variant.name)
def test_the_loop_that_is_timed_is_the_session(variant: Variant) -> None:
    session, loop = Session(variant.scene()), Loop(variant.scene())
    for _ in range(60):
        session.tick()
    taken = loop.timed(60)
    sample, loop_sample = session.tick(), loop.tick()
    assert sample.mechanism.q.tobytes() == loop_sample.mechanism.q.tobytes()
    assert sample.mechanism.v.tobytes() == loop_sample.mechanism.v.tobytes()
    assert sample.device.published.tobytes() == loop_sample.device.published.tobytes()
    assert (taken > 0.0).all()
    assert taken.shape == (60, len(PARTS))


def test_the_first_scene_has_nothing_that_can_be_left_out() -> None:
    plan = plain(LADDER[0])
    assert (plan.nv, plan.task_rows, plan.substeps) == (1, 3, 1)
    assert not any((any(plan.gravity), plan.rows, any(plan.elements.values())))


def test_each_scene_has_one_feature_more() -> None:
    plans = {step.name: plain(step) for step in LADDER}
    assert any(plans["+ gravity"].gravity)
    assert plans["+ spatial task"].task_rows == 6
    assert plans["+ five joints"].nv == 6
    assert len(plans["+ second point"].points) == 2
    assert plans["+ damping"].elements["dampers"] == 6
    friction = plans["+ friction and stops"].elements
    assert friction["friction"] == friction["stops"] == 6
    assert plans["+ spring between points"].elements["springs between points"] == 1
    opened, latching = plans["+ open closure"], plans["+ that can latch"]
    assert (opened.rows, opened.active_rows) == (3, 0)
    assert not opened.closures[0].can_latch
    assert latching.closures[0].can_latch
    active, redundant = plans["+ that is active"], plans["+ redundant closure"]
    assert (active.active_rows, active.rank) == (3, 3)
    assert (redundant.active_rows, redundant.rank) == (6, 3)
    floating = plans["+ free-flying base"]
    assert floating.nq == floating.nv + 1
    assert plans["+ two substeps"].substeps == 2


def test_nothing_latches_while_it_is_timed() -> None:
    latching = next(step for step in LADDER if step.name == "+ that can latch")
    session = Session(latching.scene())
    assert not any(any(session.tick().mechanism.active) for _ in range(300))


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair.name)
def test_pairs_move_alike_unless_the_thing_is_used(pair: Pair) -> None:
    assert moves_alike(pair, 200)
    session = Session(pair.having.scene())
    session.run(200)
    assert np.linalg.norm(session.mechanism.v) > 1e-3
    if not pair.alike:
        assert not moves_alike(replace(pair, alike=True), 200)


def made(level_us: float, rounds: int = 9, ticks: int = 11) -> np.ndarray:
    """Return times around a level, with a slow spell that all scenes meet."""
    drift = np.linspace(0.0, 50.0, rounds)[:, None] + np.linspace(-1.0, 1.0, ticks)
    return level_us + drift


def test_increments_are_paired_so_that_drift_cancels() -> None:
    whole = np.array([made(100.0), made(107.0)])
    parts = np.repeat(whole[..., None] / 4.0, len(PARTS), axis=-1)
    first, second = ablation_steps(LADDER[:2], whole, parts)
    assert (first.ratio, first.increment_us, first.error_us) == (1.0, 0.0, 0.0)
    assert second.increment_us == pytest.approx(7.0)
    assert second.error_us == pytest.approx(0.0)
    assert second.ratio == pytest.approx(132.0 / 125.0)
    assert second.parts_us == pytest.approx(dict.fromkeys(PARTS, 33.0))


@pytest.mark.parametrize(
    ("increment", "noise", "costs", "words"),
    [(0.0, 1.0, False, "nothing that"), (0.5, 0.0, False, "next to"), (5.0, 0.1, True, "costs")],
)
def test_verdicts(increment: float, noise: float, costs: bool, words: str) -> None:
    without = made(100.0)
    jitter = noise * np.where(np.arange(len(without)) % 2, 1.0, -1.0)[:, None]
    found = unused(PAIRS[0], True, without, without + increment + jitter)
    assert found.costs is costs
    assert found.verdict.startswith(words)


def test_the_command_writes_files_and_prints_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["ablation", "--rounds", "2", "--ticks", "2", "--checked", "2"]
    arguments += ["--out", str(tmp_path)]
    run = CliRunner().invoke(app_of(), [*arguments, "--json"])
    assert run.exit_code == 0
    document = json.loads(run.stdout)
    assert document == json.loads((tmp_path / "bench_ablation.json").read_text(encoding="utf-8"))
    assert [step["name"] for step in document["ladder"]] == [step.name for step in LADDER]
    assert [pair["name"] for pair in document["unused"]] == [pair.name for pair in PAIRS]
    assert document["sound"] is True
    text = CliRunner().invoke(app_of(), arguments).stdout
    assert "what is not used" in text
