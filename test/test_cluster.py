# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work shared by a Dask cluster on this machine: same results, and clear words where it cannot."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from socket import socket

import numpy as np
import pytest

from commands import ran
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.study import run_study
from hapticmech_ros.system.workers import ClusterError, cluster, versions
from sampling import long_ones
from study.counting import FOLDER
from study.designs import of

pytestmark = pytest.mark.skipif(
    find_spec("distributed") is None, reason="distributed, of the extra cluster, is not installed"
)
HERE = Path(__file__).parent
WAIT_S = 90.0


def free_port() -> int:
    with closing(socket()) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def process(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process of Dask with our modules, and end it; a test that fails shows what it said."""
    path = os.pathsep.join([str(HERE), *filter(None, sys.path)])
    found = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        env={**os.environ, "PYTHONPATH": path, **environment},
        stdout=subprocess.DEVNULL,
        cwd="/",
        start_new_session=True,
    )
    try:
        yield found
    finally:
        os.killpg(found.pid, signal.SIGKILL)
        found.wait(30.0)


@contextmanager
def boss(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Run a scheduler, and yield where it is."""
    told = folder / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with process("dask_scheduler", *options, "--scheduler-file", str(told)) as found:
        # Dask opens the file before it writes into it.
        wait_until(lambda: told.is_file() and told.read_bytes().rstrip().endswith(b"}"))
        yield json.loads(told.read_text(encoding="utf-8"))["address"], found


@contextmanager
def crew(address: str, folder: Path, number: int, **environment: str) -> Iterator[None]:
    """Run workers of a scheduler, and wait until it knows them, and that they have gone."""
    options = ("--nworkers", str(number), "--nthreads", "1", "--no-dashboard")
    where = ("--local-directory", str(folder / "dask"))
    from distributed import Client

    with Client(address, timeout=WAIT_S, set_as_default=False) as client:
        with process("dask_worker", address, *options, *where, **environment):
            client.wait_for_workers(number, timeout=WAIT_S)
            yield
        wait_until(lambda: not client.scheduler_info()["workers"])


def wait_until(true: Callable[[], object]) -> None:
    end = time.monotonic() + WAIT_S
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory) -> Iterator[str]:
    with boss(tmp_path_factory.mktemp("scheduler")) as (address, _):
        yield address


@pytest.fixture
def workers(scheduler, tmp_path) -> Iterator[str]:
    """Yield the address of a cluster of two workers, whose tasks may end one of them."""
    asked = tmp_path / "asked"
    asked.mkdir()
    with crew(scheduler, tmp_path, 2, **{FOLDER: str(asked)}):
        yield scheduler


def test_rows_are_those_of_this_process_to_the_bit(workers, tmp_path):
    design = of("links[0].inertial.mass=0.05:0.5", "device.mass=0.1:0.4", samples=40, seed=1)
    here = run_study("five_bar", design, ("felt", "limits"))
    with cluster(workers) as executor:
        found = run_study("five_bar", design, ("felt", "limits"), workers=executor)
    assert np.array_equal(found.index, here.index)
    assert found.numbers.tobytes() == here.numbers.tobytes()


@long_ones
def test_a_worker_that_dies_costs_its_scene_alone(workers, tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER, str(tmp_path / "asked"))
    with cluster(workers) as executor:
        found = run_study(
            "two_link",
            of("device.mass=0.1,0.2,0.3,0.4,0.5,0.6"),
            ("study.counting:deadly",),
            workers=executor,
        )
    assert found.lost == (1,)
    assert found.index.tolist() == [0, 2, 3, 5]
    assert found.failed == {4: "half a kilogram"}


def test_commands_take_a_cluster(workers, tmp_path):
    there = ("--cluster", workers)
    out = ("--json", "-o", tmp_path / "out")
    said = ran("study", "two_link", "--vary", "device.mass=0.1:0.4:3", *there, *out)
    assert json.loads(said)["measured"] == 3
    joints = ("--joint", "joint1=-0.5:0.5:9", "--joint", "joint2=1:1.8:9")
    tables = []
    for name, more in (("here", ("--processes", "1")), ("there", there)):
        ran("sweep", "five_bar", *joints, *more, "-o", tmp_path / name)
        tables.append(np.load(tmp_path / name / "sweep.npz")["q"])
    assert tables[0].tobytes() == tables[1].tobytes()
    assert len(tables[0]) > 16
    said = ran("feel", "passivity", "two_link", "--seconds", "0.2", "--delays", "0", *there, *out)
    assert len(json.loads(said)) == 4


@pytest.mark.parametrize(
    ("place", "error", "rule"),
    [
        (lambda _: "localhost:8786", InvalidInputError, "tcp://HOST:PORT"),
        (lambda _: f"tcp://127.0.0.1:{free_port()}", ClusterError, "no scheduler of Dask answers"),
        (lambda scheduler: scheduler, ClusterError, "has no worker"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused_in_a_sentence(scheduler, place, error, rule):
    with pytest.raises(error, match=rule), cluster(place(scheduler), 1.0):
        pass


def test_a_worker_without_this_package_is_refused(scheduler, tmp_path):
    hidden = tmp_path / "hidden"
    (hidden / "hapticmech_ros").mkdir(parents=True)
    (hidden / "hapticmech_ros" / "__init__.py").write_text("raise ImportError('not here')\n")
    with (
        crew(scheduler, tmp_path, 1, PYTHONPATH=str(hidden)),
        pytest.raises(ClusterError, match=r"cannot take work.*not here"),
        cluster(scheduler),
    ):
        pass


def test_a_worker_that_is_frozen_is_not_waited_for_without_an_end(scheduler, tmp_path):
    from distributed import Client

    where = ("--local-directory", str(tmp_path / "dask"), "--no-dashboard", "--no-nanny")
    with Client(scheduler, timeout=WAIT_S, set_as_default=False) as client:
        with process("dask_worker", scheduler, *where) as frozen:
            client.wait_for_workers(1, timeout=WAIT_S)
            os.killpg(frozen.pid, signal.SIGSTOP)
            with pytest.raises(ClusterError, match="does not answer"), cluster(scheduler, 2.0):
                pass
        wait_until(lambda: not client.scheduler_info()["workers"])


def test_workers_with_other_packages_are_refused(workers, monkeypatch):
    monkeypatch.setattr(
        "hapticmech_ros.system.workers.version", lambda name: "9.9" if name == "pin" else "1"
    )
    assert versions()["pin"] == "9.9"
    with pytest.raises(ClusterError, match=r"pin .*, not 9\.9"), cluster(workers):
        pass


def test_a_cluster_that_goes_away_ends_the_study_which_keeps_its_rows(tmp_path):
    out, design = tmp_path / "out", of("device.mass=0.1:0.5:4000")
    where = ("--local-directory", str(tmp_path / "dask"), "--no-dashboard", "--nthreads", "1")
    with boss(tmp_path) as (address, own), process("dask_worker", address, *where):

        def end_it(done: int, total: int) -> None:
            if done >= 64:
                os.killpg(own.pid, signal.SIGKILL)

        with pytest.raises(ClusterError, match="has gone"), cluster(address, WAIT_S) as executor:
            run_study("two_link", design, folder=out, workers=executor, show=end_it)
    with pytest.raises(KeyboardInterrupt):
        run_study("two_link", design, folder=out, show=_stop_after_one)


def _stop_after_one(done: int, total: int) -> None:
    assert 64 <= done < total
    raise KeyboardInterrupt
