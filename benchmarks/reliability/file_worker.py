# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Makes mutants and reads each as the package would, in a process that a parent may lose.

Which file is changed, and how, follows from the number and the seed: a mutant that ended its
process is made again by its number.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib.util
import os
import random
import resource
import shutil
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil

from benchmarks.reliability.file_seeds import sidecar, write_seeds
from benchmarks.reliability.mutants import mutated
from hapticmech_ros.bag.check import check, inspect_bag
from hapticmech_ros.bag.repair import repair_in_child
from hapticmech_ros.contact.hull import read_mesh
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene.hand import read_script

# Bytes above what this process has once it has loaded everything.
MEMORY_LIMIT = 1_500_000_000
# How often each kind is taken; a mesh takes a process of its own.
SHARES = {
    "scene": 20, "sidecar": 6, "urdf": 14, "xml": 14, "sdf": 14, "csv": 6, "parameters": 4,
    "mcap": 8, "db3": 6, "metadata": 6, "mesh": 2,
}  # fmt: skip


class Mutants:
    """Mutants by number.

    Args:
        folder: that they are written into; it holds the seeds as well.
        seed: of all of them.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self._seed = seed
        self._seeds = write_seeds(folder / "seeds")

    def make(self, number: int) -> tuple[str, Path]:
        """Write a mutant; return its kind and path."""
        chance = random.Random(f"{self._seed}/{number}")
        (kind,) = chance.choices(list(SHARES), list(SHARES.values()))
        seed = chance.choice(self._seeds[kind])
        whole_bag = kind == "metadata" or (kind in ("mcap", "db3") and chance.random() < 0.5)
        return kind, self._write(kind, seed, mutated(seed.read_bytes(), chance), whole_bag)

    def read_seeds(self) -> None:
        """Read each of the files that mutants are made of."""
        for kind, seeds in self._seeds.items():
            for seed in seeds:
                whole_bag = READERS[kind] is read_bag
                outcome(kind, self._write(kind, seed, seed.read_bytes(), whole_bag))

    def _write(self, kind: str, seed: Path, content: bytes, whole_bag: bool) -> Path:
        """Write a file in a seed's place, with what belongs to it; return its path."""
        place = self.folder / "mutant"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        path = place / seed.name
        if whole_bag:
            shutil.copytree(seed.parent, place / "bag")
            path = place / "bag" / seed.name
        if kind == "sidecar":
            shutil.copy(seed.with_suffix(".urdf"), place)
        path.write_bytes(content)
        return path


def read_scene(path: Path) -> None:
    """Load a scene, and evaluate its mechanism once."""
    mechanism = Mechanism(load_scene(path))
    q, v = np.asarray(mechanism._neutral), np.full(mechanism.nv, 0.1)
    terms = mechanism.evaluate(q, v, mechanism.initially_active)
    for value in (terms.inertia, terms.bias_force, terms.passive_force):
        if not np.isfinite(value).all():
            raise FloatingPointError("not finite")


def read_model(path: Path) -> None:
    """Load a model's file, and a scene beside it."""
    beside = path.with_suffix(".yaml")
    beside.write_text(sidecar(path.name), encoding="utf-8")
    with contextlib.suppress(HapticMechError):
        load_scene(beside)
    read_scene(path)


def read_bag(path: Path) -> None:
    """Check, inspect and repair a bag."""
    bag = path.parent if path.parent.name == "bag" else path
    scratch = bag.parent / "scratch"
    scratch.mkdir()
    found = check(bag)
    item = {"source": str(bag), "target": str(scratch / "repaired"), "scratch": str(scratch)}
    said = repair_in_child(item)
    inspect_bag(bag)
    if not found.is_sound or "error" in said:
        raise HapticMechError("; ".join(found.damage) or said["error"])


def read_parameters(path: Path) -> None:
    """Let ROS read a parameter file, where there is ROS."""
    if importlib.util.find_spec("rclpy") is None:
        return
    import rclpy
    from rclpy.context import Context

    context = Context()
    try:
        rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    except Exception as error:
        if type(error).__name__ != "RCLError":
            raise
        raise HapticMechError(str(error)) from None
    context.try_shutdown()


READERS: dict[str, Callable[[Path], Any]] = {
    "scene": read_scene,
    "sidecar": read_scene,
    "urdf": read_model,
    "xml": read_model,
    "sdf": read_model,
    "csv": lambda path: read_script(str(path)),
    "mesh": lambda path: read_mesh(str(path), (1.0, 1.0, 1.0), "file"),
    "parameters": read_parameters,
    "mcap": read_bag,
    "db3": read_bag,
    "metadata": read_bag,
}


def outcome(kind: str, path: Path) -> str:
    """Return ``read``, ``refused``, or what went wrong in the package."""
    try:
        READERS[kind](path)
    except HapticMechError as error:
        return "refused" if str(error) else "foreign: an error without a word"
    except (Exception, RecursionError) as error:  # noqa: BLE001 - what is looked for
        return f"foreign: {type(error).__name__}: {str(error)[:200]}"
    return "read"


def _processor_s() -> float:
    return sum(os.times()[:4])


def _queued_s() -> float:
    """Return how long this process was ready to run and others ran; zero if Linux counts it not."""
    try:
        return int(Path("/proc/self/schedstat").read_text(encoding="ascii").split()[1]) / 1e9
    except (OSError, IndexError):
        return 0.0


class Case(NamedTuple):
    """A mutant, made in a folder by its number and a seed, and how long (s) it may take."""

    folder: Path
    seed: int
    number: int
    patience_s: float

    @property
    def hang(self) -> Path:
        """Where it is written what this process did when patience ended."""
        return self.folder / f"hang_{self.number}"


@cache
def _prepared(folder: Path, seed: int) -> tuple[Mutants, int]:
    """Prepare this process once; return mutants, and the most memory that it had until then, kB."""
    # What libraries print goes nowhere.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    mutants = Mutants(folder / str(os.getpid()), seed)
    read_scene(Path("five_bar"))
    # Libraries are loaded by the first file that needs one: no growth of this process.
    mutants.read_seeds()
    limit = psutil.Process().memory_info().vms + MEMORY_LIMIT
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    return mutants, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def read_mutant(case: Case) -> dict[str, Any]:
    """Make a mutant and read it as the package would; return what became of it."""
    mutants, before = _prepared(case.folder, case.seed)
    kind, path = mutants.make(case.number)
    with case.hang.open("w") as told:
        faulthandler.dump_traceback_later(case.patience_s, exit=True, file=told)
        begun, since, queued = _processor_s(), time.monotonic(), _queued_s()
        found = outcome(kind, path)
        real, queued = time.monotonic() - since, _queued_s() - queued
        seconds = _processor_s() - begun
        faulthandler.cancel_dump_traceback_later()
    case.hang.unlink()
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return {
        "kind": kind,
        "outcome": found,
        "seconds": seconds,
        "real_s": real,
        "blocked_s": max(0.0, real - seconds - queued),
        "memory_mb": max(own, child) / 1e3,
        "resident_mb": psutil.Process().memory_info().rss / 1e6,
        "process": os.getpid(),
    }
