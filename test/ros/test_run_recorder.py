# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech run --record``: the recorder may die, the graph goes on, and both are said."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from std_msgs.msg import Float64MultiArray

from benchmarks.children import wait_until
from benchmarks.reliability.full_disk import FullDisk, NoDiskError
from hapticmech_ros.cli.graph import HEARS_WITHIN_S, _receives
from hapticmech_ros.graph.demo import DemoError, record_graph
from hapticmech_ros.graph.processes import start_process
from ros.harness import RATE, WAIT_S, Peer, Statuses, child_of, program

COMMAND = [sys.executable, "-c", "from hapticmech_ros.cli import main; main()"]


@contextmanager
def run(domain: int, bag: Path, log: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run a graph in one process and record it; what it tells people is in ``bag.told``."""
    command = [*COMMAND, "run", "two_link", "--composed", "--record", str(bag)]
    command += ["--control-rate", f"{RATE:g}"]
    with (
        (log or bag.with_suffix(".told")).open("w") as told,
        program(domain, *command, stderr=told, stdout=told) as process,
    ):
        yield process


def told(bag: Path) -> list[str]:
    return [line for line in bag.with_suffix(".told").read_text().splitlines() if "bag" in line]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_graph_outlives_its_recorder(
    domain: int, peer: Peer, tmp_path: Path, number: signal.Signals
) -> None:
    bag = tmp_path / "bag"
    states = peer.listen("device/state", Float64MultiArray)
    with run(domain, bag) as process:
        peer.until(lambda: states and (bag / "metadata.yaml").exists(), "a recording", 3 * WAIT_S)
        recorder = child_of(process.pid, b"--all")
        assert recorder
        os.kill(recorder, number)
        wait_until(
            lambda: any("the graph goes on" in line for line in told(bag)), WAIT_S, "a sentence"
        )
        states.clear()
        peer.until(lambda: len(states) > 200, "a graph that goes on")
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        # The bag is not what was asked for: no success.
        assert process.wait(WAIT_S) == 1
    about = [line for line in told(bag) if "ended by itself" in line]
    assert len(about) == 1
    how = "signal 9" if number == signal.SIGKILL else "exit code 0"
    assert f"the recorder ended by itself: {how}: the graph goes on" in about[0]
    assert f"the bag {bag} is incomplete" in about[0]


def test_the_graph_goes_on_where_the_disk_is_full(domain: int, peer: Peer, tmp_path: Path) -> None:
    states = peer.listen("device/state", Float64MultiArray)
    bag = tmp_path / "disk" / "bag"
    try:
        with FullDisk(bag.parent, 1), run(domain, bag, tmp_path / "told") as process:
            said = (tmp_path / "told").read_text
            wait_until(lambda: "the graph goes on" in said(), 3 * WAIT_S, "a sentence")
            states.clear()
            peer.until(lambda: len(states) > 200, "a graph that goes on")
            process.send_signal(signal.SIGINT)
            assert process.wait(WAIT_S) == 1
    except NoDiskError as error:
        pytest.skip(str(error))
    # The reason once, and what it means once.
    assert said().count("No space left on device") == 1
    assert said().count(f"the bag {bag} is incomplete") == 1
    assert "Traceback" not in said()


def test_a_bag_that_is_recorded_to_the_end_is_a_success(
    domain: int, peer: Peer, statuses: Statuses, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    with run(domain, bag) as process:
        # Of what was never rendered the end is no success.
        peer.until(
            lambda: statuses.well("haptic_device") and (bag / "metadata.yaml").exists(),
            "a recording of what is rendered",
            3 * WAIT_S,
        )
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) == 0
    assert not any("incomplete" in line for line in told(bag))


def test_nothing_is_started_where_there_is_a_bag(domain: int, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    with run(domain, bag) as process:
        assert process.wait(WAIT_S) == 1
    # Broken into lines as wide as a terminal.
    said = " ".join(bag.with_suffix(".told").read_text().split())
    assert said == f"error: {bag} exists: choose another place for --record"


def test_a_demo_says_how_its_recorder_ended(
    in_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A demo is what was recorded: it ends with its recorder, at once."""
    begun: list[subprocess.Popen[str]] = []

    def start(*arguments: object, **options: object) -> subprocess.Popen[str]:
        begun.append(start_process(*arguments, **options))  # type: ignore[arg-type]
        return begun[-1]

    monkeypatch.setattr("hapticmech_ros.graph.demo.start_process", start)

    def show(stage: str, done: float | None) -> None:
        if stage == "starting the graph":
            begun[0].kill()

    bag = tmp_path / "bag"
    with pytest.raises(DemoError, match=f"ended by itself: signal 9: {bag} is incomplete"):
        record_graph("two_link", bag, composed=True, seconds=1.0, show=show)


def test_a_recorder_that_hears_nothing_is_not_waited_for_without_an_end(
    capsys: pytest.CaptureFixture[str],
) -> None:
    recorder, now = SimpleNamespace(has_ended=False, process=None), time.monotonic()
    deaf, receives = (SimpleNamespace(is_up=lambda _, up=up: up) for up in (False, True))
    assert _receives(recorder, receives, now)
    assert not _receives(recorder, deaf, now)
    assert not capsys.readouterr().err
    assert _receives(recorder, deaf, now - HEARS_WITHIN_S)
    assert "after 20 s the recorder does not receive every topic" in capsys.readouterr().err
    assert _receives(SimpleNamespace(has_ended=True), deaf, now)
    assert _receives(None, deaf, now)
