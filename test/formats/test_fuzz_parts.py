# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of what a scene takes from a model's files: its shapes, its includes, its meshes."""

from __future__ import annotations

import json
from itertools import cycle

import numpy as np

from formats.children import outcomes
from formats.meshes import TETRAHEDRON, TEXTS, stl
from formats.test_fuzz import NUMBERS, mutated
from formats.test_mjcf_include import FILES
from formats.test_sdf_nested import NESTED
from formats.test_shapes import GEOMETRIES, MJCF, SDF_GEOMETRIES, URDF, collision, sdf_collision
from formats.test_urdf import inertial_of
from hapticmech_ros.scene.rules import MESH_SUFFIXES
from sampling import sampled

MUTANTS = len(sampled(range(160), every=8))
SHAPES = {
    "urdf": URDF.format(
        a=collision(GEOMETRIES["box"]),
        b=collision(GEOMETRIES["mesh"].replace("file://{folder}/", "package://parts/")),
        c=collision(GEOMETRIES["sphere"]),
        d=collision(GEOMETRIES["cylinder"], name="rod"),
        inertial=inertial_of(1),
    ),
    "xml": MJCF,
    "sdf": '<sdf version="1.9"><model name="m">{}</model></sdf>'.format(
        "".join(NESTED).replace(
            '<link name="upper">',
            '<link name="upper">'
            + "".join(
                sdf_collision(kind, text.replace("body.stl", "parts/body.stl"))
                for kind, (text, _) in SDF_GEOMETRIES.items()
            ),
        )
    ),
}
NAMED = {
    "urdf": ("base_collision", "post_collision", "arm_collision", "rod"),
    "xml": ("floor", "ball", "pill", "rod", "log", "block", "beam", "piece", "turned"),
    "sdf": (*SDF_GEOMETRIES, "c"),
}
ON_WORLD = ("base_collision", "post_collision", "floor", "ball")
PROBE = {"kind": "sphere", "radius": 0.1}
PROBES = {"urdf": "tool", "xml": "b", "sdf": "arm::hand::palm"}


def naming(kind, model):
    """Return a scene that names shapes of a model."""
    shapes = [
        {"name": name, "link": link, "geometry": PROBE}
        for name, link in (("here", "world"), ("there", PROBES[kind]))
    ]
    contacts = [
        {"name": f"c{k}", "a": name, "b": "there" if name in ON_WORLD else "here", "stiffness": 1.0}
        for k, name in enumerate(NAMED[kind])
    ]
    document = {"format": "hapticmech-scene/1", "model": model, "shapes": shapes}
    return json.dumps({**document, "contacts": contacts})


def assert_no_bugs(paths, good):
    """Read files in a child, of which the first few are good ones."""
    found = outcomes(paths, evaluated=True)
    assert found[:good] == ["loads"] * good
    bugs = [(str(p), one) for p, one in zip(paths, found, strict=True) if one.startswith("bug")]
    assert not bugs
    assert 0.05 * len(paths) < found.count("loads") < 0.9 * len(paths)


def test_models_whose_shapes_are_mutants_load_or_are_refused(tmp_path):
    rng = np.random.default_rng(8)
    (tmp_path / "parts").mkdir()
    for name in ("body.stl", "turned.stl"):
        stl(tmp_path / "parts" / name, TETRAHEDRON)
    paths = []
    for number, (kind, text) in zip(range(MUTANTS), cycle(SHAPES.items()), strict=False):
        written = mutated(text, rng, NUMBERS) if number >= len(SHAPES) else text
        (tmp_path / f"{number}.{kind}").write_text(written, encoding="utf-8")
        paths.append(tmp_path / f"{number}.yaml")
        paths[-1].write_text(naming(kind, f"{number}.{kind}"))
    assert_no_bugs(paths, len(SHAPES))


def test_models_whose_includes_are_mutants_load_or_are_refused(tmp_path):
    """One of the files is a mutant each time."""
    rng = np.random.default_rng(9)
    paths = []
    for number in range(MUTANTS):
        folder = tmp_path / str(number)
        (folder / "arm").mkdir(parents=True)
        changed = str(rng.choice(list(FILES))) if number else ""
        for name, text in FILES.items():
            written = mutated(text, rng, NUMBERS) if name == changed else text
            (folder / name).write_text(written, encoding="utf-8")
        paths.append(folder / "model.xml")
    assert_no_bugs(paths, 1)


def test_meshes_that_are_mutants_load_or_are_refused(tmp_path):
    """What reads them is not ours: it must not take us down with it."""
    rng = np.random.default_rng(10)
    data = {"stl": stl(tmp_path / "body.stl", TETRAHEDRON).read_bytes().decode("latin-1"), **TEXTS}
    assert {f".{kind}" for kind in data} == set(MESH_SUFFIXES)
    paths = []
    for number, (kind, text) in zip(range(MUTANTS), cycle(data.items()), strict=False):
        written = mutated(text, rng, NUMBERS) if number >= len(data) else text
        (tmp_path / f"{number}.{kind}").write_bytes(written.encode("latin-1", "replace"))
        model = SHAPES["urdf"].replace("package://parts/body.stl", f"{number}.{kind}")
        (tmp_path / f"{number}.urdf").write_text(model)
        paths.append(tmp_path / f"{number}.yaml")
        paths[-1].write_text(naming("urdf", f"{number}.urdf"))
    assert_no_bugs(paths, len(data))
