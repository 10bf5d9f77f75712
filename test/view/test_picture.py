# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole picture: everything is where it belongs, under a name that it keeps."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Mechanism, Session, analyse, load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.scene import document_of
from hapticmech_ros.view import Picture, Placer, Snapshot, UserSnapshot, palette, vanished
from oracles.kinematics import link_poses

FORCE_SCALE, TORQUE_SCALE = 0.05, 4.0
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "visualization.md"


OF_USER = UserSnapshot.__dataclass_fields__.keys()


class Drawn:
    """A scene at its start, ready to be drawn."""

    def __init__(self, name="five_bar"):
        self.mechanism = Mechanism(load_scene(name))
        self.q, _ = consistent_initial_state(self.mechanism)
        self.placement = Placer(self.mechanism).at(self.q)
        self.picture = Picture(self.mechanism, FORCE_SCALE, TORQUE_SCALE)
        self.bare = Snapshot(active=self.mechanism.initially_active)

    def shapes(self, **known):
        of_user = {name: known.pop(name) for name in list(known) if name in OF_USER}
        user = UserSnapshot(self.mechanism.point_names[0], **of_user)
        return self.picture.draw(replace(self.bare, users=(user,), **known), self.placement)

    def in_namespace(self, namespace, **known):
        return [s for s in self.shapes(**known) if s.namespace == namespace]


def snapshot_of(sample, held):
    return Snapshot(
        active=sample.mechanism.active,
        users=(
            UserSnapshot(
                held,
                sample.device.pose,
                sample.hand_wrench,
                sample.output.device,
                sample.analysis,
                sample.count,
            ),
        ),
        contacts={held: np.array((0.3, 0.0, 0.1, 0.0, 0.0, 0.01))},
        point_commands={held: sample.output.mechanism},
    )


@pytest.mark.parametrize("name", list(shipped_scenes()))
def test_names_are_given_once_and_parts_keep_theirs(name):
    session = Session(load_scene(name))
    mechanism = session.simulator.mechanism
    picture, placer = Picture(mechanism, FORCE_SCALE, TORQUE_SCALE), Placer(mechanism)
    held = mechanism.point_names[0]
    parts = []
    for tick in range(601):
        sample = session.tick()
        if tick % 200 == 0:
            shapes = picture.draw(snapshot_of(sample, held), placer.at(sample.mechanism.q))
            keys = [shape.key for shape in shapes]
            assert len(set(keys)) == len(keys)
            parts.append([k for k in keys if k[0] in ("links", "joints", "solids", "device")])
    assert parts[0]
    assert all(found == parts[0] for found in parts)


def test_limbs_go_from_joint_to_joint():
    drawn = Drawn("spatial_arm")
    ends = dict(drawn.placement.limbs)
    links = drawn.placement.links
    assert ends["upper_arm"][0] == pytest.approx(links["upper_arm"].translation, abs=1e-15)
    assert ends["upper_arm"][1] == pytest.approx(links["elbow"].translation, abs=1e-15)
    assert ends["hand"][1] == pytest.approx(drawn.placement.points["handle"].translation, abs=1e-15)
    reach = [np.linalg.norm(end - start) for start, end in ends.values()]
    assert reach == pytest.approx([0.2, 0.2, 0.06], rel=1e-12)


def test_hinges_lie_along_their_axes():
    drawn = Drawn("spatial_arm")
    document = document_of(drawn.mechanism.scene)
    poses = link_poses(document, drawn.q)
    hinges = drawn.in_namespace("joints")
    for hinge, link in zip(hinges, document["links"], strict=True):
        rotation, place = poses[link["name"]]
        # A hinge's axis is the same in the frames before and behind it.
        cosine = hinge.pose.rotation[:, 2] @ rotation @ np.array(link["joint"]["axis"])
        assert abs(cosine) == pytest.approx(1.0, abs=1e-12)
        assert hinge.pose.translation == pytest.approx(place, abs=1e-12)


def test_a_closed_loop_is_green_and_an_open_one_shows_its_gap():
    drawn = Drawn("five_bar")
    (ball,) = drawn.in_namespace("closures")
    assert ball.colour == palette.CLOSED
    assert ball.pose.translation == pytest.approx((0.09, 0.0, 0.0), abs=1e-9)
    opened = drawn.in_namespace("open_closures", active=(False,))
    assert [shape.kind for shape in opened] == ["sphere", "sphere", "strip"]
    assert {shape.colour for shape in opened} == {palette.OPEN}
    a, b = drawn.placement.closures["ground_pin"]
    assert np.array_equal(opened[2].points, (a.translation, b.translation))
    assert drawn.in_namespace("closures", active=(False,)) == []


def test_two_open_loops_have_names_of_their_own():
    scene = load_scene("five_bar")
    again = scene.closures[0].model_copy(update={"name": "again"})
    mechanism = Mechanism(scene.model_copy(update={"closures": (*scene.closures, again)}))
    placement = Placer(mechanism).at(np.zeros(4))
    picture = Picture(mechanism, FORCE_SCALE, TORQUE_SCALE)

    def keys(*active):
        shapes = picture.draw(Snapshot(active), placement)
        return [s.key for s in shapes if s.namespace.endswith("closures")]

    assert len(set(keys(False, False))) == 6
    assert set(keys(True, False)) - {keys(True, True)[0]} < set(keys(False, False))


def test_what_an_open_loop_showed_vanishes_when_it_closes():
    drawn = Drawn("five_bar")
    before = [shape.key for shape in drawn.shapes(active=(False,))]
    assert vanished(before, drawn.shapes()) == [("open_closures", i) for i in range(3)]


@pytest.mark.parametrize(
    ("namespace", "known"),
    [
        ("hand_force", lambda w: {"hand_wrench": w}),
        ("device_command", lambda w: {"device_command": w}),
        ("contact_force", lambda w: {"contacts": {"handle": w}}),
        ("point_command", lambda w: {"point_commands": {"handle": w}}),
    ],
)
def test_a_wrench_is_an_arrow_and_a_ring_where_it_acts(namespace, known):
    drawn = Drawn()
    device = pin.SE3(np.eye(3), np.array((0.2, 0.1, 0.05)))
    wrench = np.array((0.6, -0.3, 0.2, 0.0, 0.01, 0.02))
    of_device = namespace in ("hand_force", "device_command")
    place = (device if of_device else drawn.placement.points["handle"]).translation
    (arrow,) = drawn.in_namespace(namespace, device=device, **known(wrench))
    assert arrow.points[0] == pytest.approx(place, abs=1e-15)
    assert arrow.points[1] - place == pytest.approx(FORCE_SCALE * wrench[:3], abs=1e-15)
    assert arrow.colour == palette.MEANING[namespace]
    line, _ = drawn.in_namespace(f"{namespace}/torque", device=device, **known(wrench))
    radii = np.linalg.norm(line.points - place, axis=1)
    expected = TORQUE_SCALE * np.linalg.norm(wrench[3:])
    assert radii == pytest.approx(np.full(len(radii), expected), rel=1e-12)
    assert np.abs((line.points - place) @ wrench[3:]).max() < 1e-15


@pytest.fixture(scope="module")
def two_points():
    """Return a five-bar with two operational points, and where it is at the start."""
    scene = load_scene("five_bar")
    point = scene.operational_points[0]
    other = point.model_copy(update={"name": "other", "link": "link3"})
    mechanism = Mechanism(scene.model_copy(update={"operational_points": (point, other)}))
    return mechanism, consistent_initial_state(mechanism)[0]


def test_a_wrench_keeps_its_name_when_another_point_has_one(two_points):
    mechanism, q = two_points
    wrench = np.array((1.0, 0.0, 0.0, 0.0, 0.0, 0.05))
    picture, placement = Picture(mechanism, FORCE_SCALE, TORQUE_SCALE), Placer(mechanism).at(q)
    one = picture.draw(Snapshot((True,), contacts={"other": wrench}), placement)
    both = {"handle": wrench, "other": wrench}
    two = {s.key: s for s in picture.draw(Snapshot((True,), contacts=both), placement)}
    assert all(np.array_equal(s.points, two[s.key].points) for s in one)


def test_what_is_not_known_or_too_small_is_not_drawn():
    drawn = Drawn()
    known = {shape.namespace for shape in drawn.shapes()}
    assert known == {"links", "joints", "closures", "point/handle", "point/handle_world"}
    device = pin.SE3.Identity()
    assert drawn.in_namespace("hand_force", device=device, hand_wrench=np.full(6, 1e-6)) == []
    assert drawn.in_namespace("hand_force", hand_wrench=np.ones(6)) == []


def test_the_count_is_written_and_its_directions_are_drawn():
    drawn = Drawn("five_bar")
    found = analyse(drawn.mechanism, drawn.q)
    for count, words in ((0, "0 joint constraints"), (1, "1 joint constraint")):
        known = {"analysis": found, "count": count}
        (letters,) = drawn.in_namespace("count", **known)
        assert letters.text == words
        rigid = drawn.in_namespace("rigid_directions", **known)
        assert len(rigid) == 2 * count
    place = drawn.placement.points["handle"].translation
    along = rigid[0].points[1] - place
    wrench = found.constraint_wrenches[:3, 0]
    assert np.linalg.norm(np.cross(along, wrench)) < 1e-12 * np.linalg.norm(wrench)


def test_body_axes_turn_with_the_body_and_those_of_the_world_do_not():
    drawn = Drawn()
    pose = drawn.placement.points["handle"]
    body = drawn.in_namespace("point/handle")
    world = drawn.in_namespace("point/handle_world")
    for index in range(3):
        assert body[index].pose.rotation[:, 2] == pytest.approx(pose.rotation[:, index], abs=1e-14)
        assert world[index].pose.rotation[:, 2] == pytest.approx(np.eye(3)[index], abs=1e-15)


def test_the_document_explains_every_namespace_and_no_other():
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z_]+)[^`]*`.*\| (\d+), (\d+), (\d+) \|", text, re.MULTILINE)
    said = {name: tuple(int(part) for part in colour) for name, *colour in rows}
    meant = {
        name: tuple(round(255 * part) for part in colour[:3])
        for name, colour in palette.MEANING.items()
    }
    assert said == meant


def test_of_several_users_each_has_names_and_a_hue_of_its_own(two_points):
    mechanism, q = two_points
    picture = Picture(mechanism, FORCE_SCALE, TORQUE_SCALE)
    wrench = np.array((1.0, 0.5, 0.0, 0.0, 0.0, 0.02))

    def drawn(*points):
        users = tuple(
            UserSnapshot(
                name,
                pin.SE3(np.eye(3), np.full(3, float(i))),
                wrench,
                -wrench,
                analyse(mechanism, q, point=name),
                1,
            )
            for i, name in enumerate(points)
        )
        given = dict.fromkeys(("handle", "other"), wrench)
        snapshot = Snapshot((True,), users, given, given)
        return picture.draw(snapshot, Placer(mechanism).at(q))

    both, alone = drawn("handle", "other"), drawn("handle")
    assert len({shape.key for shape in both}) == len(both)
    felt = ("hand_force", "device_command", "contact_force", "point_command", "free_directions")
    colours = {}
    for name in ("handle", "other"):
        for meaning in (*felt, "rigid_directions", "device", "count"):
            mine = [s for s in both if s.namespace.startswith(f"{meaning}/{name}")]
            assert mine, (name, meaning)
            colours[name, meaning] = mine[0].colour
    for meaning in felt:
        assert colours["handle", meaning][:3] != colours["other", meaning][:3]
    # What pushes and what is felt are told apart as well.
    assert len({colours["other", meaning] for meaning in felt}) == len(felt)
    (letters,) = [s.text for s in both if s.namespace == "count/other"]
    assert letters == "other: 1 joint constraint"
    # One user has the colours that the document explains, whatever other points there are.
    for meaning in ("hand_force", "contact_force"):
        assert {s.colour for s in alone if s.namespace == meaning} == {palette.MEANING[meaning]}
