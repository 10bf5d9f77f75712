# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Delay and gain margins of the sampled loop: closed forms, and sessions that diverge."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis.impedance import alone
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import LoopTerms, loop_margins, spectral_radius
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.plan.scene_plan import check_scene
from oracles.running import varied

T = 1e-3


def radius(stiffness, damping, delay=0, local=False):
    springs = np.array([[stiffness]]), np.array([[damping]])
    nothing = np.zeros((1, 1)), np.zeros((1, 1))
    terms = LoopTerms(nothing, springs) if local else LoopTerms(springs, nothing)
    return spectral_radius(terms, T, delay)


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e5])
def test_without_delay_a_spring_needs_the_damping_of_half_a_period(stiffness):
    """Jury's test of z² + z (T b + T² k / 2 - 2) + 1 - T b + T² k / 2: k T / 2 < b < 2 / T."""
    least = stiffness * T / 2
    assert radius(stiffness, 1.001 * least) < 1.0 < radius(stiffness, 0.999 * least)
    assert radius(stiffness, 0.999 * 2 / T) < 1.0 < radius(stiffness, 1.001 * 2 / T)


@pytest.mark.parametrize("delay", [1, 2, 5])
def test_the_stability_limit_of_a_damper_alone_follows_from_its_delay(delay):
    """z^(d+1) - z^d + T b = 0 has a root on the circle at T b = 2 sin(π / (4 d + 2))."""
    largest = 2.0 * np.sin(np.pi / (4 * delay + 2)) / T
    # A spring of next to nothing, which leaves no root at 1.
    assert radius(1e-6, 0.999 * largest, delay) < 1.0 + 1e-9
    assert radius(1e-6, 1.001 * largest, delay) > 1.0 + 1e-6


@pytest.mark.parametrize(
    ("stiffness", "damping"), [(1e4, 4.9), (1e4, 5.1), (1e4, 1.9e3), (1e4, 2.1e3)]
)
@pytest.mark.parametrize("delay", [1, 5, 50])
def test_what_is_closed_in_the_device_does_not_mind_the_delay(delay, stiffness, damping):
    # What is late is nothing, and its memory adds eigenvalues at 0 only.
    assert radius(stiffness, damping, delay, local=True) == pytest.approx(
        radius(stiffness, damping), rel=1e-9
    )


def with_gains(scene, factor, local=True):
    """Return a scene with springs and dampers so many times as strong, and nothing that bounds."""
    free = {"force_limit": 1e3, "torque_limit": 1e3}
    joint, channel = scene.controller.joint_constraint, scene.controller.position_channel
    springs = ("stiffness", "damping")
    gains = {
        "joint_constraint": {name: factor * getattr(joint, name) for name in springs}
        | {"local": local, **free},
        "position_channel": {
            name: factor * getattr(channel, name)
            for name in (*springs, "angular_stiffness", "angular_damping")
        },
        "passivity": {"control": False},
    }
    return varied(scene, controller=gains, device=free)


def errors_after_a_touch(scene, delay):
    """Return the size of the error, sample by sample."""
    session = Session(scene, command_delay=delay)
    touch = np.array([1e-4, 2e-4, 0.0, 0.0, 0.0, 1e-6])
    samples = [session.tick(hand_wrench=touch if tick < 3 else None) for tick in range(1000)]
    return np.array([np.abs(sample.output.error).max() for sample in samples])


@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize("delay", [1, 2, 3])
@pytest.mark.parametrize("name", ["five_bar", "two_link"])
def test_sessions_diverge_where_it_says(name, delay, local):
    scene = with_gains(alone(load_scene(name)), 1.0, local)
    analysis = Session(scene).tick().analysis
    control, model = ControlArchitecture(scene), operational_model_of(analysis)
    margin = loop_margins(control, model, analysis.rows, scene.simulation.period, delay).gain
    calm = errors_after_a_touch(with_gains(scene, 0.95 * margin, local), delay)
    wild = errors_after_a_touch(with_gains(scene, 1.05 * margin, local), delay)
    assert calm[800:].max() < 0.1 * calm.max()
    # Until limits hold it: some modes grow by little in a second, others reach the limits at once.
    assert wild.max() > 2.0 * calm.max()
    assert wild[800:].max() > 10.0 * calm[800:].max()


def test_scene_check_warns_of_a_loop_without_delay_margin():
    scene = load_scene("five_bar")
    assert check_scene(scene).points[0].loop.periods == 21
    assert check_scene(scene).warnings == ()
    warning, *others = check_scene(with_gains(scene, 8.0)).warnings
    # In such a loop nothing is told of steps but that they do not lead to one motion.
    assert all("ten times shorter steps" in other for other in others)
    assert "at handle the loop is unstable even without delay" in warning
    margin = check_scene(scene).points[0].loop.gain
    assert f"limit is {margin / 8.0:.2g} times" in warning
