# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ablation's scenes, its check, its sums, its files and its command; no times."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.ablation.agreement import agreement
from benchmarks.ablation.benchmark import Settings
from benchmarks.ablation.findings import Times, ablation_steps, time_in_turn, time_pair, unused
from benchmarks.ablation.loop import PARTS, Loop
from benchmarks.ablation.scenes import Variant, ladder, pairs
from hapticmech_ros.control.loop_layout import Answer
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.plan.scene_plan import ScenePlan, plan_scene
from hapticmech_ros.session import Session
from hapticmech_ros.session import session as session_module
from hapticmech_ros.session.tick_kernels import SessionData
from sampling import sampled

LADDER, PAIRS = ladder(), pairs()
SIDES = [side for pair in PAIRS for side in (pair.without, pair.having)]


def computed(plan: ScenePlan) -> set[str]:
    return {part.what for part in plan.tick if part.computed}


def plain(variant: Variant) -> ScenePlan:
    return plan_scene(variant.scene())


@pytest.mark.parametrize(
    # The last one of the ladder has everything.
    "variant",
    [*sampled((*LADDER[:-1], *SIDES)), LADDER[-1]],
    ids=lambda variant: variant.name,
)
def test_kernels_and_their_python_agree(variant: Variant) -> None:
    agreed = agreement(variant.scene(), 30)
    assert agreed.held
    assert set(agreed.apart) == set(PARTS)


def test_what_does_not_agree_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    right = session_module.run_ticks

    def wrong(arguments):  # type: ignore[no-untyped-def]
        code = right(arguments)
        answers = SessionData(*arguments[4:6]).answers
        Answer(answers[-1]).wrenches.on_hand[0] += 1e-6
        return code

    monkeypatch.setattr(session_module, "run_ticks", wrong)
    agreed = agreement(LADDER[0].scene(), 3)
    assert not agreed.held
    assert max(agreed.apart, key=agreed.apart.__getitem__) == "control"


@pytest.mark.parametrize("variant", LADDER, ids=lambda variant: variant.name)
def test_the_loop_that_is_timed_is_the_session(variant: Variant) -> None:
    session, loop, taken = Session(variant.scene()), Loop(variant.scene()), np.zeros(len(PARTS))
    for _ in range(60):
        session.tick()
        loop.timed_tick(taken)
    sample, loop_sample = session.tick(), loop.tick()
    assert sample.mechanism.q.tobytes() == loop_sample.mechanism.q.tobytes()
    assert sample.mechanism.v.tobytes() == loop_sample.mechanism.v.tobytes()
    assert sample.device.published.tobytes() == loop_sample.device.published.tobytes()
    assert (taken > 0.0).all()


def test_the_first_scene_has_nothing_that_can_be_left_out() -> None:
    plan = plain(LADDER[0])
    assert (plan.nv, plan.task_rows, plan.substeps) == (1, 3, 1)
    assert not any((any(plan.gravity), plan.rows, any(plan.elements.values())))
    assert all(computed(plan) <= computed(plain(step)) for step in LADDER[1:])


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
def test_pairs_move_alike(pair) -> None:  # type: ignore[no-untyped-def]
    without, having = Session(pair.without.scene()), Session(pair.having.scene())
    for _ in range(200):
        one, other = without.tick(), having.tick()
    assert np.linalg.norm(one.mechanism.v) > 1e-3
    if pair.name != "damping (used)":
        assert one.mechanism.q == pytest.approx(other.mechanism.q, abs=1e-12)


def test_variants_leave_their_origin_alone() -> None:
    before = json.dumps(LADDER[0].document)
    LADDER[0].changed("other", lambda document: document["links"].clear())
    assert json.dumps(LADDER[0].document) == before


def test_times_have_a_row_for_each_round() -> None:
    (times,) = time_in_turn([LADDER[0]], 2, 3)
    assert times.ticks_us.shape == (2, 3)
    assert times.parts_us.shape == (2, 3, len(PARTS))
    assert (times.ticks_us > 0.0).all()
    assert (times.parts_us > 0.0).all()
    for side in time_pair(LADDER[0], LADDER[1], 2, 3):
        assert side.shape == (2, 3)
        assert (side > 0.0).all()


def made(level_us: float, rounds: int = 9, ticks: int = 11) -> Times:
    """Times around a level, with a slow spell that all scenes meet."""
    drift = np.linspace(0.0, 50.0, rounds)[:, None] + np.linspace(-1.0, 1.0, ticks)
    return Times(level_us + drift, np.full((rounds, ticks, len(PARTS)), level_us / 4))


def test_increments_are_paired_so_that_drift_cancels() -> None:
    plan, agreed = plain(LADDER[0]), agreement(LADDER[0].scene(), 2)
    first, second = ablation_steps(["a", "b"], [plan] * 2, [agreed] * 2, [made(100.0), made(107.0)])
    assert (first.ratio, first.increment_us, first.error_us) == (1.0, 0.0, 0.0)
    assert second.increment_us == pytest.approx(7.0)
    assert second.error_us == pytest.approx(0.0)
    assert second.ratio == pytest.approx(132.0 / 125.0)
    assert second.parts_us == pytest.approx(dict.fromkeys(PARTS, 26.75))


@pytest.mark.parametrize(
    ("increment", "noise", "costs", "words"),
    [(0.0, 1.0, False, "nothing that"), (0.5, 0.0, False, "next to"), (5.0, 0.1, True, "costs")],
)
def test_verdicts(increment: float, noise: float, costs: bool, words: str) -> None:
    without = made(100.0).ticks_us
    jitter = noise * np.where(np.arange(len(without)) % 2, 1.0, -1.0)[:, None]
    found = unused(PAIRS[0], True, without, without + increment + jitter)
    assert found.costs is costs
    assert found.verdict.startswith(words)


@pytest.mark.parametrize("bad", [{"rounds": 1}, {"ticks": 0}, {"checked": 0}])
def test_settings_refuse_what_says_nothing(bad: dict[str, int]) -> None:
    with pytest.raises(InvalidInputError, match="must be"):
        Settings(**bad)


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
    assert (tmp_path / "bench_ablation.png").stat().st_size > 10_000
    text = CliRunner().invoke(app_of(), arguments).stdout
    assert "what is not used" in text
