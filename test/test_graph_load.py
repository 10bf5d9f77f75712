# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a graph fits its machine, by what its nodes report."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from hapticmech_ros.graph.processes import SHARING_NICE, Graph, GraphLoad, LoadWatch
from hapticmech_ros.system import cpu_list
from hapticmech_ros.system.readiness import Report
from real_time import grants_nice

IDLE = GraphLoad(rate_hz=1000.0, cores=2.0, used=0.8, missed=0.0)


def report(
    name: str, pid: int, cpu: float, at: float, periods: int = -1, missed: int = 0
) -> Report:
    figures = {"pid": str(pid), "cpu_s": str(cpu), "monotonic_s": str(at)}
    if periods >= 0:
        figures |= {"periods": str(periods), "missed_deadlines": str(missed)}
    return Report(name, True, "", figures)


def reports(*found: Report) -> dict[str, Report]:
    return {one.node: one for one in found}


def test_load_is_what_happened_between_two_reports() -> None:
    watch = LoadWatch(1000.0, 2.0, settles_s=0.0)
    device = report("/device", 1, 5.0, 100.0, 4000, 900)
    analyser = report("/analyser", 2, 3.0, 100.2)
    assert watch.look(reports(device, analyser)) is None
    later = report("/device", 1, 5.4, 101.0, 5000, 920)
    # The other one has not reported again.
    assert watch.look(reports(later, analyser)) is None
    load = watch.look(reports(later, report("/analyser", 2, 3.6, 101.4)))
    assert load is not None
    assert load.used == pytest.approx(0.4 / 1.0 + 0.6 / 1.2)
    assert load.missed == pytest.approx(0.02)
    assert load.fits


DEVICE = "/device"


@pytest.mark.parametrize(
    ("options", "looks", "used"),
    [
        (
            {"composed": True, "settles_s": 0.0},
            [[(name, 7, 1.0, 10.0) for name in "ab"], [(name, 7, 1.5, 11.0) for name in "ab"]],
            0.5,
        ),
        (
            {"settles_s": 0.0},
            [
                [(DEVICE, 1, 50.0, 10.0, 9000)],
                [(DEVICE, 2, 0.5, 20.0, 100)],
                [(DEVICE, 2, 0.9, 21.0, 1100)],
            ],
            0.4,
        ),
        (
            {},
            [
                [(DEVICE, 1, 1.0, 10.0, 100)],
                [(DEVICE, 1, 2.0, 10.9, 100)],
                [(DEVICE, 1, 3.0, 11.2, 100)],
                [(DEVICE, 1, 3.5, 12.2, 1100)],
            ],
            0.5,
        ),
    ],
    ids=["several nodes of a process count once", "started again", "first second"],
)
def test_load_is_known_with_the_last_report(options, looks, used) -> None:
    """Of a process with several nodes, of one that was started again, after its first second."""
    watch = LoadWatch(1000.0, 2.0, **options)
    *before, load = [watch.look(reports(*(report(*one) for one in look))) for look in looks]
    assert before == [None] * len(before)
    assert load is not None
    assert load.used == pytest.approx(used)


def test_nothing_is_known_of_a_graph_with_a_node_that_is_not_configured() -> None:
    watch, made = LoadWatch(1000.0, 2.0), Report("/new", False, "unconfigured", {})
    for at in (10.0, 11.0, 12.0):
        assert watch.look(reports(report(DEVICE, 1, at, at, 100), made)) is None


@pytest.mark.parametrize(
    ("change", "fits"),
    [({}, True), ({"missed": 0.05}, False), ({"used": 1.1}, False), ({"cores": 0.9}, False)],
)
def test_a_graph_fits_that_keeps_its_deadlines_and_leaves_something(change, fits) -> None:
    load = replace(IDLE, **change)
    assert load.fits == fits
    assert len(load.sentences()) == (1 if fits else 2)


@pytest.mark.parametrize(
    ("used", "missed", "saturates"),
    [(1.7, 0.3, True), (1.7, 0.05, False), (1.2, 0.3, False), (0.8, 0.6, True)],
)
def test_a_graph_saturates_that_takes_all_and_misses_deadlines_all_the_same(
    used, missed, saturates
) -> None:
    assert replace(IDLE, used=used, missed=missed).saturates == saturates


@pytest.mark.skipif(not grants_nice(-20), reason="nice -20 is not granted to this user")
def test_all_threads_of_the_nodes_give_up_their_precedence_once() -> None:
    waits = """
import os, threading
os.setpriority(os.PRIO_PROCESS, 0, -20)
threading.Thread(target=threading.Event().wait, daemon=True).start()
print("up", flush=True)
threading.Event().wait()
"""
    command = [sys.executable, "-c", waits]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        graph = Graph.__new__(Graph)
        graph.processes = {"node": process}
        threads = [int(one.name) for one in Path(f"/proc/{process.pid}/task").iterdir()]
        assert len(threads) == 2
        assert graph.leave_share()
        found = {os.getpriority(os.PRIO_PROCESS, thread) for thread in threads}
        assert found == {SHARING_NICE}
        assert not graph.leave_share()
        process.kill()
    assert not graph.leave_share()


def test_the_rate_that_is_proposed_fits_by_what_a_period_costs() -> None:
    # 1.6 ms of processor time a period: 0.8 cores at 500 Hz.
    heavy = replace(IDLE, used=1.6, missed=0.0)
    assert heavy.period_us == pytest.approx(1600.0)
    assert replace(heavy, cores=2.1).fitting_rate_hz == 500.0
    assert replace(heavy, cores=1.1).fitting_rate_hz == 250.0
    # None does: something else takes the processors, and the lowest is the best that there is.
    assert replace(heavy, cores=0.2).fitting_rate_hz == 250.0
    assert replace(heavy, rate_hz=250.0).fitting_rate_hz is None
    # What was done in the periods that were kept.
    assert replace(heavy, missed=0.5).period_us == pytest.approx(3200.0)


def test_advice_names_what_helps() -> None:
    busy = replace(IDLE, missed=0.2, users=2)
    assert "--control-rate 500, --composed, fewer users, ending other programs" in busy.advice()
    least = replace(busy, rate_hz=250.0, composed=True, users=1)
    assert "try ending other programs" in least.advice()
    assert "does not keep up with 250 Hz" in least.advice()
    assert "leaves too little time to other programs" in replace(IDLE, used=1.1).advice()


@pytest.mark.parametrize("version", [1, 2])
def test_a_quota_of_a_group_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: int
) -> None:
    groups, own = tmp_path / "groups", tmp_path / "own"
    inner = groups / ("cpu/outer/inner" if version == 1 else "outer/inner")
    inner.mkdir(parents=True)
    lines = {1: "5:cpu,cpuacct:/outer/inner\n3:memory:/m\n", 2: "0::/outer/inner\n"}
    own.write_text(lines[version])
    monkeypatch.setattr(cpu_list, "GROUPS", groups)
    monkeypatch.setattr(cpu_list, "OWN_GROUPS", own)
    monkeypatch.setattr(cpu_list.os, "sched_getaffinity", lambda _: range(8))

    def limit(folder: Path, most: int, period: int) -> None:
        if version == 2:
            (folder / "cpu.max").write_text(f"{most if most > 0 else 'max'} {period}\n")
        else:
            (folder / "cpu.cfs_quota_us").write_text(f"{most}\n")
            (folder / "cpu.cfs_period_us").write_text(f"{period}\n")

    assert cpu_list.available_cores() == 8.0
    limit(inner, -1, 100_000)
    assert cpu_list.available_cores() == 8.0
    limit(inner.parent, 6000, 5000)
    assert cpu_list.available_cores() == pytest.approx(1.2)
    limit(inner, 3000, 5000)
    assert cpu_list.available_cores() == pytest.approx(0.6)
    own.unlink()
    assert cpu_list.available_cores() == 8.0
