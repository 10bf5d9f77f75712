# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is written for the IFToMM library says what the runs did."""

import numpy as np
from typer.testing import CliRunner

from benchmarks.accuracy import submission
from benchmarks.accuracy.cases import cases
from benchmarks.accuracy.submission import app, solved

BY_NAME = {case.name: case for case in cases()}


def test_rows_are_of_the_motion_and_the_accuracy_is_their_energys():
    """The pendulum's rows are on its circle, and its speed is that of its height."""
    found = solved(BY_NAME["pendulum"], 1.5)
    assert found.columns == ("time (s)", "p1 x (m)", "p1 y (m)", "energy (J)")
    times, x, y, energy = found.rows.T
    assert np.abs(times - np.linspace(0.0, 1.5, len(times))).max() < 1e-12
    assert len(times) > 1000
    assert np.abs(np.hypot(x, y) - 1.0).max() < 1e-14
    assert np.abs(energy - energy[0]).max() <= found.energy_error < 1e-10
    # The reference is at 1 s and 5 s; the latter is not reached.
    assert 0.0 < found.position_error < 1e-9
    assert found.cpu_s > 0.0


def test_the_command_writes_a_results_file_and_a_form(tmp_path, monkeypatch):
    monkeypatch.setitem(submission.DURATIONS, "A01", 1.0)
    said = CliRunner().invoke(app, ["pendulum", "--out", str(tmp_path)])
    assert said.exit_code == 0, said.output
    lines = (tmp_path / "A01_pendulum.txt").read_text().splitlines()
    assert lines[0].split("\t")[0] == "time (s)"
    numbers = np.array([[float(word) for word in line.split("\t")] for line in lines[1:]])
    assert numbers.shape == (1001, 4)
    form = (tmp_path / "A01_pendulum.md").read_text()
    for entry in ("Accuracy", "CPU time", "CPU / GPU", "Operating system", "Method description"):
        assert f"**{entry}**: " in form
    assert "rk4" in form
