# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Z-width and M-width of sessions agree with eigenvalues, and penetration with F / k."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.analysis.experience import experience, penetration
from hapticmech_ros.analysis.limits import MPoint, Wall, cases_of, m_width, m_width_figure, z_width
from hapticmech_ros.analysis.scene_variants import with_constraint, with_loop
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.errors import InvalidInputError
from oracles.running import varied
from sampling import sampled


def late(name):
    """Return a scene whose walls are closed by the controller."""
    return with_loop(load_scene(name), False)


@pytest.mark.parametrize("share", sampled([0.3, 0.9]))
def test_a_wall_that_the_device_closes_is_as_stiff_at_any_delay(share):
    """2 %, as below; what the position channel does with the delay is out of it here."""
    found = [z_width(load_scene("five_bar"), delay=delay, shares=[share])[0] for delay in (0, 50)]
    assert found[1].loop == "device"
    for one in found:
        assert one.measured == pytest.approx(one.predicted, rel=0.02)
    assert found[1].measured == pytest.approx(found[0].measured, rel=0.02)
    (over,) = z_width(late("five_bar"), delay=50, shares=[share])
    assert found[1].measured > 100.0 * over.measured


@pytest.mark.parametrize(
    ("delay", "share"), sampled([(0, 0.5), (1, 0.1), (1, 0.7), (5, 0.5)], every=2)
)
def test_stiffness_limits_of_sessions_agree_with_eigenvalues(delay, share):
    """2 %: bisection to 1 %, and a rate of decay that ten cycles still tell from none."""
    (found,) = z_width(late("five_bar"), delay=delay, shares=[share])
    assert found.measured == pytest.approx(found.predicted, rel=0.02)


def test_a_hand_that_holds_makes_walls_stiffer_as_eigenvalues_say():
    scene = late("door")
    (alone,) = z_width(scene, delay=5, shares=[0.1])
    (held,) = z_width(scene, delay=5, hand="still", shares=[0.1])
    # The mechanism gives way a little, which the copy with its frozen position does not know.
    assert held.measured == pytest.approx(held.predicted, rel=0.05)
    assert held.measured > 1.3 * alone.measured


@pytest.mark.parametrize("delay", [1, 2, 5, 10, 20])
def test_the_rule_with_delay_holds_for_little_damping_only(delay):
    """To 10 % at a tenth of the damping that is unstable by itself; too much by half at 0.7."""
    wall = Wall(late("five_bar"))
    most = wall.most_damping(delay)
    latency = (delay + 0.5) * 1e-3
    little = wall.predicted(0.1 * most, delay, "nobody") * latency / (0.1 * most)
    much = wall.predicted(0.7 * most, delay, "nobody") * latency / (0.7 * most)
    assert 0.9 < little < 1.0
    assert 0.4 < much < 0.6


@pytest.mark.parametrize("delay", [1, 2, 10, 30])
def test_without_units_all_walls_are_one(delay):
    """K τ² / m at 0.6 of the largest damping: 0.55, whatever the delay, from one period on."""
    wall = Wall(late("door"))
    tau = (delay + 0.5) * 1e-3
    stiffness = wall.predicted(0.6 * wall.most_damping(delay), delay, "nobody")
    assert stiffness * tau**2 / wall.mass == pytest.approx(0.55, abs=0.02)


@pytest.mark.parametrize(("local", "delay"), [(True, 1), (False, 3)])
def test_the_lightest_mechanism_is_the_rules_whatever_the_delay(local, delay):
    """2 %: bisection takes 1 %, the position channel the rest; 6 % with dampers in the joints.

    Those are in no rule, nor in the linear model. A device that leads adds ½ ∇ + W 5/12 ∇² to what
    it answers. The hand's share is a half.
    """

    def grows(ratio):
        weight = 5.0 / 12.0 * (1.0 - 1.6 * ratio**2) / (1.0 + 2.0 * ratio**2)
        told = 1.5 + weight, -0.5 - 2.0 * weight, weight
        return np.abs(np.roots([1.0, *(0.5 * (ratio - 1.0) * np.array(told))])).max() - 1.0

    damped = with_loop(load_scene("spatial_arm"), local)
    links = tuple(varied(link, joint={"damping": 0.0}) for link in damped.links)
    for scene, near in ((varied(damped, links=links), 0.02), (damped, 0.06)):
        found = m_width(scene, delay=delay, share=1.0)
        assert found.measured == pytest.approx(found.predicted, rel=near)
        lightest = 1.0 / brentq(grows, 1.5, 6.0) if local else found.rule
        assert lightest <= found.rule
        assert found.measured == pytest.approx(lightest, rel=near)
        assert found.heaviest == 300.0


@pytest.mark.parametrize("name", ["five_bar", "door", "bricard"])
def test_a_push_goes_as_deep_as_the_law_of_the_joint_constraint_says(name):
    """0.1 %: what is left of the transient after 0.3 s."""
    held = [one for one in penetration(Setup(load_scene(name))) if one.held]
    assert held
    for one in held:
        assert one.error == pytest.approx(one.expected, rel=1e-3)
        assert one.stiffness == pytest.approx(2000.0, rel=1e-2)


@pytest.mark.parametrize("delay", [5, 20])
def test_the_stiffest_wall_of_the_device_is_as_stiff_at_any_delay(delay):
    """Commands stay within the slew limit, as the push begins when the device is controlled."""
    stiff = with_constraint(load_scene("five_bar"), 1.8e5, 100.0)
    held = [one for one in penetration(Setup(stiff, delay=delay)) if one.held]
    assert [one.stiffness for one in held] == pytest.approx([1.8e5], rel=1e-2)


def test_an_experiment_with_contacts_is_felt_and_makes_next_to_no_energy():
    """0.1 % of F_c; 0.1 mJ of the 30 mJ and more that pass through the hand's port."""
    seen = experience(Setup(load_scene("peg_in_hole")))
    assert seen.kept
    assert seen.steady > 100
    assert seen.contact_error < 1e-3
    assert seen.left_energy > -1e-4


def test_an_experiment_that_diverges_says_so():
    assert not experience(Setup(late("five_bar"), delay=20)).kept


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: z_width(load_scene("peg_in_hole")), r"scene.*joint constraint.*peg_in_hole"),
        (lambda: z_width(load_scene("door"), hand="mine"), r"hand.*nobody, still.*mine"),
        (lambda: z_width(load_scene("door"), delay=-1), r"delay.*0 or more.*-1"),
        (lambda: z_width(load_scene("door"), shares=[1.5]), r"share.*between 0 and 1.*1\.5"),
        (lambda: m_width(load_scene("two_link"), share=None), r"hand.*at a place.*constant"),
        (lambda: m_width(load_scene("door"), share=-1.0), r"-1"),
        (lambda: cases_of([], [-2], []), r"delay.*-2"),
        (lambda: cases_of([], [1], [], ["y"]), r"what.*z, m, loads.*'y'"),
    ],
)
def test_what_cannot_be_measured_is_refused(call, message):
    with pytest.raises(InvalidInputError, match=message):
        call()


def test_the_command_writes_tables_file_and_pictures(tmp_path, monkeypatch):
    # What it measures is another test's.
    for seconds in ("WATCHED_S", "SWINGING_S", "SLOW_S"):
        monkeypatch.setattr(f"hapticmech_ros.analysis.limits.{seconds}", 0.1)
    words = ["feel", "limits", "two_link", "--delays", "1", "--rates", "1000"]
    found = ran(*words, "--processes", "1", "--out", str(tmp_path))
    assert "stiffest stable joint constraint" in found
    written = json.loads((tmp_path / "limits.json").read_text(encoding="utf-8"))
    assert {one["delay"] for one in written["z_width"]} == {1}
    assert len(written["m_width"]) == 4
    (load,) = written["loads"]
    assert np.isfinite(load["experience"]["drift_rms"])
    for name in ("z_width.png", "m_width.png"):
        assert (tmp_path / name).stat().st_size > 5000


def test_marks_that_agree_do_not_hide_each_other():
    points = [
        MPoint(f"scene{n}", 1, local, "mass", 1.0, 2.0, 0.34, 0.33, 0.333, 300.0)
        for n in range(4)
        for local in (True, False)
    ]
    figure = m_width_figure(points)
    figure.canvas.draw()
    (axes,) = figure.axes
    marks = [line for line in axes.get_lines() if line.get_marker() in ("o", "x")]
    places = sorted(axes.transData.transform((line.get_xdata()[0], 0.34))[0] for line in marks)
    assert len(places) == 8
    # Pixels at 150 dpi: a mark of 6 points is 12.5 of them wide; half of each stays free.
    assert np.diff(places).min() > 6.0
    assert figure.texts[0].get_text().startswith("4 scenes. ")
