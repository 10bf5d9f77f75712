# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of public descriptions of mechanisms: ``python -m benchmarks.descriptions DIR...``.

Each file is read as a scene, its kinetic energy at random rates is compared with that of MuJoCo
(MJCF) or Pinocchio (URDF), and the mechanism moves by itself for a second at the scene's own step.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Annotated

import numpy as np
import pinocchio as pin
import typer

from hapticmech_ros.analysis.study import Sheet, number
from hapticmech_ros.cli import run_app
from hapticmech_ros.errors import HapticMechError, SceneError
from hapticmech_ros.formats import left_out
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics import Array
from hapticmech_ros.simulation import Simulator

# Packages of PyPI, and where in them there are descriptions of mechanisms.
COLLECTIONS = {
    "example-robot-data": ("cmeel.prefix/share/example-robot-data/robots/**/*.urdf",),
    "dm-control": ("dm_control/suite/*.xml", "dm_control/third_party/kinova/*.xml"),
    "gymnasium": ("gymnasium/envs/mujoco/assets/*.xml",),
    "gymnasium-robotics": (
        "gymnasium_robotics/envs/mujoco/assets/*.xml",
        "gymnasium_robotics/envs/assets/hand/*.xml",
        "gymnasium_robotics/envs/assets/fetch/*.xml",
    ),
    "robosuite": (
        "robosuite/models/assets/robots/*/*.xml",
        "robosuite/models/assets/grippers/*.xml",
    ),
}
# Relative difference of energies that is rounding, and rates that are tried.
SAME, TRIED = 1e-9, 5
SECONDS = 1.0

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a file.

    Attributes:
        collection: package that it is from.
        file: path in it.
        freedoms: nv; 0 if it was not read.
        ran: whether it was read, agrees or says where it does not, and moved for a second without
            an inaccurate step.
        why: if not, or where it does not agree.
        difference: of the kinetic energy, relative; None where nothing could be compared.
    """

    collection: str
    file: str
    freedoms: int
    ran: bool
    why: str = ""
    difference: float | None = None


def files_of(collection: str) -> Iterator[tuple[str, Path]]:
    """Yield the descriptions of an installed package: path in it, and file."""
    try:
        root = Path(str(distribution(collection).locate_file("")))
    except PackageNotFoundError:
        return
    for pattern in COLLECTIONS[collection]:
        for path in sorted(root.glob(pattern)):
            yield str(path.relative_to(root)), path


def energies_in_mujoco(path: Path, ours: Mechanism, rng: np.random.Generator) -> float | None:
    """Return the largest relative difference of kinetic energies at a random state; None if none.

    Args:
        path: of the MJCF file.
        ours: read from it.
        rng: of the states.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    if (model.nq, model.nv) != (ours.nq, ours.nv):
        return None
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, 0.3 * rng.normal(size=model.nv), 1.0)
    free, ball = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
    names = list(ours.tree.joint_names)
    # Rates of theirs from ours: of free joints they are along axes of the world.
    q, turn = np.zeros(ours.nq), np.zeros((model.nv, ours.nv))
    for joint in range(model.njnt):
        # Names of scenes have none of MuJoCo's other signs; joints without one keep their order.
        called = re.sub(r"\W", "_", model.joint(joint).name)
        if called and called not in names:
            return None
        index = names.index(called) if called else joint
        place, rates = ours.tree.position_slice(index), ours.tree.velocity_slice(index)
        a, d, kind = model.jnt_qposadr[joint], model.jnt_dofadr[joint], model.jnt_type[joint]
        size = rates.stop - rates.start
        q[place] = data.qpos[a : a + place.stop - place.start]
        turn[d : d + size, rates] = np.eye(size)
        if kind in (free, ball):
            w, x, y, z = q[place][-4:]
            q[place.stop - 4 : place.stop] = x, y, z, w
            if kind == free:
                rotation = pin.Quaternion(w, x, y, z).matrix()
                turn[d : d + 3, rates.start : rates.start + 3] = rotation
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return _largest(ours, q, turn.T @ full @ turn, rng)


def energies_in_pinocchio(path: Path, ours: Mechanism, rng: np.random.Generator) -> float | None:
    """Return the largest relative difference of kinetic energies at zero; None if none.

    Args:
        path: of the URDF file.
        ours: read from it.
        rng: of the rates.
    """
    model = pin.buildModelFromUrdf(str(path))
    names = list(model.names)[1:]
    if model.nv != ours.nv or set(names) != set(ours.tree.joint_names):
        return None
    full = np.triu(pin.crba(model, model.createData(), pin.neutral(model)))
    full = full + np.triu(full, 1).T
    order = np.concatenate(
        [
            np.arange(ours.nv)[ours.tree.velocity_slice(ours.tree.joint_names.index(name))]
            for name in names
        ]
    )
    theirs = np.zeros_like(full)
    theirs[np.ix_(order, order)] = full
    return _largest(ours, pin.neutral(ours.model), theirs, rng)


def _largest(ours: Mechanism, q: Array, inertia: Array, rng: np.random.Generator) -> float:
    found = []
    for _ in range(TRIED):
        v = rng.normal(size=ours.nv)
        expected = 0.5 * v @ inertia @ v
        found.append(abs(ours.energy(q, v)[0] - expected) / expected)
    return float(max(found))


def tried(collection: str, name: str, path: Path) -> Outcome:
    """Return what becomes of a file."""
    rng = np.random.default_rng(0)
    compare: Callable[[Path, Mechanism, np.random.Generator], float | None]
    compare = energies_in_pinocchio if path.suffix == ".urdf" else energies_in_mujoco
    try:
        simulator = Simulator(load_scene(path))
    except SceneError as error:
        first = error.problems[0]
        return Outcome(collection, name, 0, False, f"refused: {first.key_path}: {first.rule}")
    except HapticMechError as error:
        return Outcome(collection, name, 0, False, f"refused: {error}")
    mechanism, difference, ran = simulator.mechanism, None, False
    try:
        difference = compare(path, mechanism, rng)
        start = simulator.initial_state()
        inaccurate = simulator.run(start, round(SECONDS / simulator.period)).end.account.inaccurate
        why = f"{inaccurate} steps of a second are inaccurate" if inaccurate else ""
        ran = not why
    except HapticMechError as error:
        why = str(error)
    if difference is not None and difference > SAME:
        said = [note.what for note in left_out(path).notes if note.felt and "inertia" in note.what]
        ran = bool(said)
        why = f"said: {', '.join(said)}" if said else f"kinetic energy differs by {difference:.1e}"
    return Outcome(collection, name, mechanism.nv, ran, why, difference)


def is_mechanism(path: Path) -> bool:
    """Return whether a file is a whole description in which something moves, by its peer."""
    try:
        if path.suffix == ".urdf":
            return bool(pin.buildModelFromUrdf(str(path)).nv)
        import mujoco

        return bool(mujoco.MjModel.from_xml_path(str(path)).nv)
    except (ValueError, RuntimeError):
        return False


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the outcomes as a table for a document."""
    rows = []
    for one in outcomes:
        became = one.why.replace("|", "\\|").replace("\n", " ")
        if one.ran:
            became = f"ran; {became}" if became else "ran"
        file, freedoms = f"`{one.file}`", f"{one.freedoms or '-'}"
        rows.append((one.collection, file, freedoms, became, number(one.difference, ".0e")))
    return Sheet(
        "descriptions",
        ("collection", "file", "freedoms", "became", "kinetic energy differs by"),
        tuple(rows),
        ("file", "became"),
    ).markdown()


@app.command()
def descriptions(
    collections: Annotated[
        list[str] | None, typer.Argument(help="Packages of PyPI; all known ones if left out.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("bench"),
) -> None:
    """Read, compare and move the descriptions of installed packages."""
    outcomes = []
    for collection in collections or list(COLLECTIONS):
        for name, path in files_of(collection):
            if is_mechanism(path):
                outcomes.append(tried(collection, name, path))
                print(outcomes[-1], flush=True)
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps([asdict(one) for one in outcomes], indent=1)
    (out / "descriptions.json").write_text(text, encoding="utf-8")
    (out / "descriptions.md").write_text(table(outcomes), encoding="utf-8")
    ran = sum(one.ran for one in outcomes)
    print(f"{ran} of {len(outcomes)} ran: {out / 'descriptions.md'}")


if __name__ == "__main__":
    run_app(app)
