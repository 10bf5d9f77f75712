# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of good files: each loads and evaluates to finite numbers, or is refused in our words.

Of models and scene files, and of what a scene takes from a model's files: shapes, includes, meshes.
"""

from __future__ import annotations

import json
from itertools import cycle
from random import Random

import pytest

from benchmarks.reliability.mutants import mutated
from formats.children import outcomes
from formats.five_bars import PIN, REST, mjcf, sdf, urdf
from formats.meshes import TETRAHEDRON, TEXTS, stl
from formats.test_mjcf import EQUALITIES, INERTIAL, LOOPS, TREES
from formats.test_mjcf_include import FILES
from formats.test_sdf_gears import GEARS
from formats.test_sdf_nested import NESTED
from formats.test_shapes import GEOMETRIES, MJCF, SDF_GEOMETRIES, URDF, collision, sdf_collision
from formats.test_urdf import inertial_of, random_urdf
from formats.test_urdf_mimic import MIMICS
from hapticmech_ros.scene.rules import MESH_SUFFIXES
from sampling import sampled

MUTANTS = len(sampled(range(200), every=8))
SIDECAR = f"""{REST}{PIN}
springs: [{{name: s, a: {{link: world}}, b: {{link: link3}}, stiffness: 10.0}}]
initial_state: {{q: {{joint1: 0.1, joint4: 0.2}}, v: {{joint2: 0.1}}}}
model:
  file: five_bar.urdf
  base: fixed
  joints:
    joint1: {{damping: 0.1, limits: {{lower: -1.0, upper: 2.0, stiffness: 50.0}}}}
    joint2: {{friction: 0.1, locked: false}}
    joint3: {{limits: null}}
"""
LOOP = LOOPS.format(inertial=INERTIAL, equality="".join(EQUALITIES.values()))
SEEDS = {
    "urdf": [urdf(), *(random_urdf(seed)[0] for seed in range(3)), MIMICS],
    "xml": [
        mjcf(),
        *(f"<mujoco>{text}</mujoco>" for text in (LOOP, TREES["ref"], TREES["classes"])),
        *(f"<mujoco>{TREES[name]}</mujoco>" for name in ("frames", "several joints", "shapes")),
    ],
    "sdf": [
        sdf(),
        sdf().replace('type="revolute"', 'type="ball"', 1),
        *(f"<sdf><model name='m'>{''.join(parts)}</model></sdf>" for parts in (NESTED, GEARS)),
    ],
    "yaml": [SIDECAR],
}
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


def written(path, data, number, good):
    """Write a file as it is if its number is among the first few, or else a mutant of it."""
    content = data if isinstance(data, bytes) else data.encode()
    path.write_bytes(content if number < good else mutated(content, Random(number)))
    return path


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
    loaded = found.count("loads")
    assert 0.05 * len(paths) < loaded < 0.9 * len(paths), "mutants all alike test nothing"


@pytest.mark.parametrize("kind", SEEDS)
def test_models_and_scene_files(tmp_path, kind):
    (tmp_path / "five_bar.urdf").write_text(urdf())
    seeds = SEEDS[kind]
    paths = [
        written(tmp_path / f"{number}.{kind}", seed, number, len(seeds))
        for number, seed in zip(range(MUTANTS), cycle(seeds), strict=False)
    ]
    assert_no_bugs(paths, len(seeds))


def test_models_whose_shapes_are_named(tmp_path):
    (tmp_path / "parts").mkdir()
    for name in ("body.stl", "turned.stl"):
        stl(tmp_path / "parts" / name, TETRAHEDRON)
    paths = []
    for number, (kind, text) in zip(range(MUTANTS), cycle(SHAPES.items()), strict=False):
        model = written(tmp_path / f"{number}.{kind}", text, number, len(SHAPES))
        paths.append(model.with_suffix(".yaml"))
        paths[-1].write_text(naming(kind, model.name))
    assert_no_bugs(paths, len(SHAPES))


def test_included_files(tmp_path):
    """One of the files is a mutant each time."""
    for number, changed in zip(range(MUTANTS), cycle(FILES), strict=False):
        folder = tmp_path / str(number)
        (folder / "arm").mkdir(parents=True)
        for name, text in FILES.items():
            written(folder / name, text, number if name == changed else 0, 1)
    assert_no_bugs([tmp_path / str(number) / "model.xml" for number in range(MUTANTS)], 1)


def test_meshes(tmp_path):
    """What reads them is not ours: it must not take us down with it."""
    data = {"stl": stl(tmp_path / "body.stl", TETRAHEDRON).read_bytes(), **TEXTS}
    assert {f".{kind}" for kind in data} == set(MESH_SUFFIXES)
    paths = []
    for number, (kind, text) in zip(range(MUTANTS), cycle(data.items()), strict=False):
        mesh = written(tmp_path / f"{number}.{kind}", text, number, len(data))
        model = SHAPES["urdf"].replace("package://parts/body.stl", mesh.name)
        (tmp_path / f"{number}.urdf").write_text(model)
        paths.append(tmp_path / f"{number}.yaml")
        paths[-1].write_text(naming("urdf", f"{number}.urdf"))
    assert_no_bugs(paths, len(data))
