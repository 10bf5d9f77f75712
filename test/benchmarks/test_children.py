# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.children import BenchError, ReportingProcess, ids, output_to, wait_until
from hapticmech_ros.graph import start_process, stop_process

# A module of the standard library that ends at once and says nothing in JSON.
SILENT = [sys.executable, "-m", "this"]


def test_a_process_that_ends_before_it_is_ready_is_named() -> None:
    with pytest.raises(BenchError, match="this ended by itself: exit code 0"):
        ReportingProcess(SILENT, {})


def test_waiting_ends_with_a_reason() -> None:
    with pytest.raises(BenchError, match="in vain for the moon"):
        wait_until(lambda: False, 0.0, "the moon")

    def check() -> None:
        raise BenchError("the sky fell")

    with pytest.raises(BenchError, match="the sky fell"):
        wait_until(lambda: False, 60.0, "the moon", check)
    wait_until(lambda: True, 0.0, "nothing", check)


def test_output_of_processes_started_within_goes_to_the_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log"
    for words in ("first", "second"):
        with output_to(log):
            process = start_process([sys.executable, "-c", f"print('{words}')"], {})
        process.wait(30.0)
    subprocess.run([sys.executable, "-c", "print('here')"], check=True)
    assert log.read_text() == "first\nsecond\n"
    assert capfd.readouterr().out == "here\n"


def test_a_process_of_several_nodes_is_called_composed() -> None:
    process = start_process(SILENT, {})
    try:
        assert ids({"a,b": process}) == {"composed": process.pid}
        assert ids({"a": process}) == {"a": process.pid}
    finally:
        stop_process(process)
