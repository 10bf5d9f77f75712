# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Films of experiments: in real time, from one place, with the words of the page."""

import numpy as np
import pytest
from PIL import Image, ImageSequence
from typer.testing import CliRunner

from hapticmech_ros.cli import app
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.film import RATE, draw_experiment
from hapticmech_ros.view.palette import CLOSED

SHORT = ("experiment.duration=0.5", "hand.start_delay=0", "hand.force=[-3.0,0.0,0.0]")


def frames(path):
    """Return the pictures (n, rows, columns, 3) of a film."""
    with Image.open(path) as film:
        return np.array([np.array(one.convert("RGB")) for one in ImageSequence.Iterator(film)])


def ground_pin(picture):
    """Return the mean row and column of the closed loop's pin: right of the axes and the legend."""
    right = picture[40:200, 150:] / 255.0
    near = np.abs(right - np.array(CLOSED[:3])).max(axis=2) < 0.08
    return np.array(np.nonzero(near)).mean(axis=1)


@pytest.mark.parametrize("name", ["five_bar.gif", "five_bar.webp"])
def test_a_hand_moves_what_is_seen_and_the_world_stays(tmp_path, name):
    path = tmp_path / "made" / name
    changes = [word for change in SHORT for word in ("--set", change)]
    arguments = ["scene", "show", "five_bar", "--out", str(path), "--pixels", "240", *changes]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    found = frames(path)
    assert found.shape == (0.5 * RATE + 1, 240, 240, 3)
    with Image.open(path) as film:
        film.seek(1)
        film.load()
        assert film.info["duration"] == 1000 / RATE
    pins = np.array([ground_pin(one) for one in found])
    assert np.ptp(pins, axis=0).max() < 1.5
    moved = np.abs(np.diff(found.astype(float), axis=0)).max(axis=3) > 40.0
    assert all(moved.sum(axis=(1, 2)) > 20)


def test_what_ends_the_experiment_ends_the_film_and_is_said(tmp_path):
    # A spring that is too stiff for the step, and nothing that watches it.
    changes = (
        "links[0].joint.stiffness=1e5",
        "simulation.accuracy={tolerance: 0.0}",
        "simulation.integrator=rk4",
    )
    path = tmp_path / "a.gif"
    with pytest.raises(HapticMechError, match=r"at [0-9.]+ s: .*; the film until then: .*gif"):
        draw_experiment("two_link", path, changes)
    assert 0 < len(frames(path)) < 5.0 * RATE


def test_another_point_is_held(tmp_path):
    path = tmp_path / "a.gif"
    with pytest.raises(HapticMechError, match="nowhere"):
        draw_experiment("five_bar", path, SHORT, "nowhere")
    assert not path.exists()
