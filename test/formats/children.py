# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files read in a process of their own, that may neither take long nor much memory."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

from hapticmech_ros import load_scene
from hapticmech_ros.contact.hull import hull
from hapticmech_ros.contact.mesh_corners import corners_of
from hapticmech_ros.errors import HapticMechError, SceneError
from hapticmech_ros.mechanism import Mechanism

# s, after which a child hangs; it takes a few on a busy machine.
PATIENCE = 60
# Bytes above what the imports take; a file of 8 MB at its worst needs a few hundred MB.
ROOM = 1_000_000_000


def outcome(path, evaluated=False):
    """Return the rule that a file breaks, or that it loads, or what went wrong in us."""
    try:
        scene = load_scene(path)
        if evaluated:
            for shape in scene.shapes:
                if shape.geometry.kind == "mesh":
                    # What the child does that reads meshes; this one has limits, too.
                    mesh = {"file": shape.geometry.file, "scale": shape.geometry.scale}
                    said = corners_of(mesh)
                    if "rule" in said:
                        return f"refused: {shape.name}: {said['rule']}"
                    if not np.isfinite(hull(np.array(said["corners"])).vertices).all():
                        return "bug: not finite"
            mechanism = Mechanism(scene)
            q, v = np.asarray(mechanism._neutral), np.full(mechanism.nv, 0.1)
            terms = mechanism.evaluate(q, v, mechanism.initially_active)
            values = (terms.inertia, terms.bias_force, terms.passive_force, *terms[3:5])
            if not all(np.isfinite(value).all() for value in values):
                return "bug: not finite"
    except SceneError as error:
        problem = error.problems[0]
        return f"refused: {problem.key_path}: {problem.rule}"
    except HapticMechError as error:
        return f"refused: {type(error).__name__}"
    except (Exception, RecursionError) as error:  # noqa: BLE001 - what must not be
        return f"bug: {type(error).__name__}: {error}"
    return "loads"


def limit_memory():
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + ROOM
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def outcomes(paths, evaluated=False):
    """Return what becomes of each file, read one after the other in a child."""
    code = (
        "import json, sys; sys.path[:0] = json.loads(sys.argv[1]);"
        "from formats.children import limit_memory, outcome; limit_memory();"
        "[print(json.dumps(outcome(p, bool(int(sys.argv[2])))), flush=True)"
        " for p in sys.stdin.read().split('\\n') if p]"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, json.dumps(sys.path), str(int(evaluated))],
        input="\n".join(map(str, paths)),
        capture_output=True,
        text=True,
        timeout=PATIENCE + len(paths),
        check=False,
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{paths[len(found)]}: {done.stderr[-2000:]}"
    return found
