# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Still pictures of scenes: everything that is drawn is in them, and seen from the right side."""

import numpy as np
import pinocchio as pin
import pytest
from matplotlib import image
from typer.testing import CliRunner

from hapticmech_ros import load_scene
from hapticmech_ros.cli import app
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.view.drawn import ABOVE, ASIDE, draw_shapes, scale_of, view_from
from hapticmech_ros.view.palette import CLOSED, LINK, OPEN, SOLID
from hapticmech_ros.view.shapes import Shape, arrow, box, cylinder, sphere, strip, text
from hapticmech_ros.view.still import draw_scene

RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)


def pixels(path, colour):
    """Return rows and columns of the pixels that have a colour."""
    picture = image.imread(path)[:, :, :3]
    return np.nonzero(np.abs(picture - np.array(colour[:3])).max(axis=2) < 0.02)


@pytest.mark.parametrize("towards", [ABOVE, ASIDE, np.array((0.0, -1.0, 0.0))])
def test_views_are_right_handed(towards):
    view = view_from(towards)
    assert np.abs(view @ view.T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(view) == pytest.approx(1.0)
    assert view[2] @ towards == pytest.approx(np.linalg.norm(towards))


def test_from_above_x_is_right_and_y_is_up(tmp_path):
    path = tmp_path / "a.png"
    here, right, up = np.zeros(3), np.array((1.0, 0.0, 0.0)), np.array((0.0, 1.0, 0.0))
    shapes = [sphere(here, 0.1, CLOSED), sphere(right, 0.1, RED), sphere(up, 0.1, BLUE)]
    draw_shapes(shapes, path, planar=True)
    rows, columns = pixels(path, CLOSED)
    assert np.median(pixels(path, RED)[1]) > np.median(columns) + 100
    assert np.median(pixels(path, BLUE)[0]) < np.median(rows) - 100


def test_an_ellipsoid_is_as_long_as_its_axes(tmp_path):
    path, turned = tmp_path / "a.png", pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.5, 0.7), np.zeros(3))
    draw_shapes([Shape("mass", 0, "sphere", turned, (4.0, 2.0, 1.0), RED)], path, planar=True)
    rows, columns = pixels(path, RED)
    # Half its width in a direction is |A^T d| of its map A from the unit sphere.
    half = np.linalg.norm(turned.rotation * np.array((2.0, 1.0, 0.5)), axis=1)
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(half[0] / half[1], rel=0.01)


def test_what_is_nearer_hides_what_is_behind(tmp_path):
    path = tmp_path / "a.png"
    near = sphere(np.array((0.0, 0.0, 1.0)), 1.0, RED)
    draw_shapes([near, sphere(np.zeros(3), 0.8, BLUE)], path, planar=True)
    assert pixels(path, BLUE)[0].size == 0
    assert pixels(path, RED)[0].size > 1000


@pytest.mark.parametrize(
    "shapes",
    [
        [box(pin.SE3.Random(), (0.2, 0.3, 0.4), RED)],
        [cylinder(np.zeros(3), np.array((0.1, 0.2, 0.3)), 0.1, RED)],
        [strip(np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0))), 0.05, RED)],
        arrow(np.zeros(3), np.ones(3), 0.05, RED),
    ],
    ids=["box", "cylinder", "strip", "arrow"],
)
@pytest.mark.parametrize("planar", [True, False])
def test_every_kind_of_shape_is_seen(tmp_path, shapes, planar):
    path = tmp_path / "a.png"
    draw_shapes([*shapes, text(np.zeros(3), "words", 0.1, RED)], path, planar)
    assert pixels(path, RED)[0].size > 500


@pytest.mark.parametrize(("name", "closed"), [("five_bar", True), ("spatial_arm", False)])
def test_a_scene_is_drawn_with_its_closures(tmp_path, name, closed):
    path = tmp_path / "new" / "scene.png"
    draw_scene(load_scene(name), path)
    assert (pixels(path, CLOSED)[0].size > 500) == closed
    assert pixels(path, LINK)[0].size > 500


@pytest.mark.parametrize(("options", "side"), [([], 1050), (["--pixels", "400"], 400)])
def test_the_command_names_its_file_and_a_picture_can_be_small(tmp_path, options, side):
    path = tmp_path / "five.png"
    command = ["scene", "show", "five_bar", "--out", str(path), *options]
    found = CliRunner().invoke(app, command)
    assert found.exit_code == 0, found.output
    assert image.imread(path).shape == (side, side, 4)
    assert "five.png" in found.output.replace("\n", "")
    assert pixels(path, CLOSED)[0].size > 500


def test_lengths_of_scale_bars_are_round_and_fit():
    for longest in np.geomspace(1e-5, 1e4, 300):
        length, words = scale_of(longest)
        assert 0.4 * longest <= length <= longest
        number, unit = words.split()
        assert float(number) * {"m": 1.0, "mm": 1e-3}[unit] == pytest.approx(length)
        assert f"{length:e}"[0] in "125"


def test_a_scale_bar_is_as_long_as_it_says(tmp_path):
    """A box of 100 mm beside it: both in pixels."""
    path = tmp_path / "a.png"
    draw_shapes([box(pin.SE3.Identity(), (0.1, 0.02, 0.02), RED)], path, planar=True)
    _, columns = pixels(path, RED)
    black = image.imread(path)[850:980, :400, :3].max(axis=2) < 0.3
    found = np.nonzero(black[black.sum(axis=1).argmax()])[0]
    bar = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1)[0]  # and then its letters
    length, words = scale_of(0.25 / 0.87 * 1.16 * 0.1)
    assert words == "20 mm"
    assert np.ptp(bar) == pytest.approx(np.ptp(columns) * length / 0.1, abs=6.0)


def test_the_legend_has_what_is_seen(tmp_path):
    path = tmp_path / "a.png"
    draw_scene(load_scene("two_link"), path)
    rows, _ = pixels(path, LINK)
    assert (rows > 0.93 * 1050).sum() > 100
    assert pixels(path, CLOSED)[0].size == 0


def test_what_cannot_close_is_drawn_as_it_is_written(tmp_path):
    path = tmp_path / "open.png"
    command = ["scene", "show", "five_bar", "--out", str(path)]
    command += ["--set", "closures.ground_pin.b.origin.xyz=[0.3, 0, 0]"]
    found = CliRunner().invoke(app, command)
    assert isinstance(found.exception, ClosureError)
    assert f"as written: {path}" in found.output.replace("\n", "")
    blended = tuple(0.8 * part + 0.2 for part in OPEN[:3])
    assert pixels(path, blended)[0].size > 500
    assert pixels(path, CLOSED)[0].size == 0


URDF = """<robot name="box"><link name="base"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="body"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="body"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<{kind}><geometry><mesh filename="{mesh}"/></geometry></{kind}></link></robot>"""
CORNERS = [(0, 0, 0), (0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.2)]


@pytest.mark.parametrize("kind", ["collision", "visual"])
def test_meshes_of_a_model_are_drawn_without_a_contact(tmp_path, kind):
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)))
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    (tmp_path / "body.obj").write_text(corners + faces)
    (tmp_path / "bad.obj").write_text("no mesh")
    counts = {}
    for mesh in ("body.obj", "bad.obj"):
        model, path = tmp_path / f"{mesh}.urdf", tmp_path / f"{mesh}.png"
        model.write_text(URDF.replace("{mesh}", mesh).replace("{kind}", kind))
        found = CliRunner().invoke(app, ["scene", "show", str(model), "--out", str(path)])
        assert found.exit_code == 0, found.output
        assert ("not drawn" in found.output) == (mesh == "bad.obj")
        blended = tuple(SOLID[3] * part + 1.0 - SOLID[3] for part in SOLID[:3])
        counts[mesh] = pixels(path, blended)[0].size
    assert counts["body.obj"] > 2000
    assert counts["bad.obj"] == 0
