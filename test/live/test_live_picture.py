"""The picture of a live session: what belongs to which link, what the hand is, what is hidden."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros.live.commands import Open
from hapticmech_ros.live.history import History
from hapticmech_ros.live.live_picture import LAYERS, LivePicture, first_view
from hapticmech_ros.live.live_session import LiveSession
from hapticmech_ros.live.numbers import numbers_html
from hapticmech_ros.live.settings import HANDS, MOUSE_ALONE, changes_of, gain_sliders
from hapticmech_ros.live.shape_links import shape_links
from hapticmech_ros.scene import load_scene, shipped_scenes
from oracles.touching import FLOOR, body, pair, scene, shape


def begun(name):
    session = LiveSession(Open(name, changes_of(MOUSE_ALONE, 0.0)), 0.0)
    return session, LivePicture(session.opened)


def moved(session, seconds):
    for now in np.arange(0.0, seconds, 0.005):
        session.advance(now)
    return session.state()


@pytest.mark.parametrize("name", shipped_scenes())
def test_what_is_said_to_be_of_a_link_moves_with_it(name):
    """By its pose in the link's frame, which is the same wherever the mechanism is."""
    session, picture = begun(name)
    scenes_links = session.session.scene.links
    seen = []
    rng = np.random.default_rng(3)
    mechanism = session.session.simulator.mechanism
    for _ in range(2):
        q = mechanism.integrate(session.state().q, rng.uniform(-0.3, 0.3, mechanism.nv))
        state = session.state()
        object.__setattr__(state, "q", q)
        frame = picture.draw(state)
        links = shape_links(session.session.scene, frame.placement)
        found = {}
        for one in frame.shapes:
            link = links.get(one.key)
            if link is not None and one.kind != "strip" and not one.namespace.endswith("_world"):
                local = frame.placement.links[link].inverse() * one.pose
                axis = None if one.kind == "sphere" else local.rotation[:, 2]
                found[one.key] = (local.translation, axis)
        seen.append(found)
        assert {link.name for link in scenes_links} <= set(links.values())
        assert all(picture.link_of(one, frame) == links.get(one.key) for one in frame.shapes)
    first, second = seen
    assert first.keys() == second.keys()
    for key, (place, axis) in first.items():
        assert second[key][0] == pytest.approx(place, abs=1e-9), key
        # What is drawn between two points may be turned about the line through them.
        if axis is not None:
            assert abs(second[key][1] @ axis) == pytest.approx(1.0, abs=1e-9), key


def test_all_layers_can_be_hidden():
    session, picture = begun("five_bar")
    state = moved(session, 0.8)
    whole = {one.namespace.split("/")[0] for one in picture.draw(state).shapes}
    assert {"rigid_directions", "free_directions", "mass", "point", "links", "device"} <= whole
    bare = {one.namespace.split("/")[0] for one in picture.draw(state, frozenset(LAYERS)).shapes}
    assert bare == whole - {"rigid_directions", "free_directions", "mass", "point"}


def test_the_hand_is_meant_where_its_ball_is_seen_whatever_is_in_front():
    session, picture = begun("five_bar")
    device = session.state().device[:, 3]
    eye = device + np.array((0.0, 0.0, 1.0))
    in_front = device + np.array((0.0, 0.0, 0.3 * picture.unit))
    assert picture.is_hand(device, eye, in_front)
    assert not picture.is_hand(device, eye, in_front + np.array((0.2 * picture.unit, 0.0, 0.0)))


@pytest.mark.parametrize("name", ["five_bar", "spatial_arm"])
def test_the_first_view_sees_everything(name):
    session, picture = begun(name)
    shapes = picture.draw(session.state()).shapes
    eye, centre, up = first_view(shapes, picture.planar)
    near = (eye - centre) / np.linalg.norm(eye - centre)
    assert abs(near @ up) < 0.9
    half = np.deg2rad(0.5 * 45.0)
    for one in shapes:
        to = one.pose.translation - eye if not len(one.points) else one.points[0] - eye
        assert -to @ near / np.linalg.norm(to) > np.cos(half)


def test_a_mesh_is_drawn_as_its_hull(tmp_path):
    corners = 0.05 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    rows = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    file = tmp_path / "cube.obj"
    file.write_text("\n".join([*rows, "f 1 2 3", "f 4 5 6", "f 6 7 8"]) + "\n", encoding="utf-8")
    mesh = shape("one", {"kind": "mesh", "file": str(file)})
    document = scene(
        [body("one")], [FLOOR, mesh], [pair("one_shape")], {"one": [0, 0, 1, 0, 0, 0, 1]}
    )
    import yaml

    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    session, picture = begun(str(path))
    (hull,) = picture.hulls.values()
    assert np.abs(hull.vertices) == pytest.approx(np.full((8, 3), 0.05))
    frame = picture.draw(session.state())
    (number,) = frame.hulls
    assert frame.hulls[number].translation == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)
    assert picture.link_of_hull(number) == "one"
    assert picture.link_of_hull(1 - number) is None


def test_numbers_are_told_by_name():
    session, picture = begun("five_bar")
    state = moved(session, 1.0)
    frame = picture.draw(state)
    text = numbers_html(state, "five_bar", frame.analysis.spectrum.s, frame.masses, "")
    assert '<b id="live-count">1</b>' in text
    assert "problem" not in text
    refused = numbers_html(state, "five_bar", frame.analysis.spectrum.s, frame.masses, "a < b")
    assert '<b id="live-problem">a &lt; b</b>' in refused
    assert "slower than real time" in numbers_html(
        session_at(state, 0.5), "x", frame.analysis.spectrum.s, np.array((1.0, np.inf)), ""
    )


def session_at(state, factor):
    object.__setattr__(state, "factor", factor)
    return state


def test_history_keeps_ten_seconds_and_begins_anew_with_time():
    session, _ = begun("five_bar")
    history = History()
    history.begin(3)
    assert [len(column) for column in history.count()] == [1, 1]
    state = session.state()
    for time in np.arange(0.0, 20.0, 0.02):
        object.__setattr__(state, "time", float(time))
        history.add(state)
    times, *s = history.spectrum()
    assert len(s) == 3
    assert s[0][-1] == state.observation[0]
    assert times[-1] - times[0] == pytest.approx(10.0, abs=0.6)
    assert np.diff(times).min() >= 0.05
    object.__setattr__(state, "time", 3.0)
    history.add(state)
    assert history.count()[0].tolist() == [3.0]


@pytest.mark.parametrize("name", shipped_scenes())
def test_sliders_hold_what_the_scene_has_and_hands_are_scenes(name):
    for slider in gain_sliders(load_scene(name)):
        assert 0.0 <= slider.value <= slider.highest
        assert slider.step > 0.0
    for hand in HANDS:
        changed = load_scene(name, changes=changes_of(hand, 20.0))
        assert changed.connection.delay == pytest.approx(0.02)
