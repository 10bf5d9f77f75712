# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks.users``: what one user feels while another holds the mechanism.

Of three shipped scenes, held at two links or at both ends of one: a free hand pushes at one, a firm
arm holds the other: its mass behind a grip, rigidly on its device, or without mass; see
``analysis/users.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
import typer

from hapticmech_ros import load_scene
from hapticmech_ros.analysis.study import Sheet
from hapticmech_ros.analysis.users import FREQUENCIES_HZ, Row, felt_beside_others
from hapticmech_ros.cli import run_app
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import ArmHand, SpringDamperHand

PERIODS_S = (1e-3, 5e-4, 2.5e-4)
PUSHER, HOLDER = "a", "b"
# Of two links, or of both ends of one: (link, place in it, m).
POINTS = {
    "shared_payload": (("payload", (0.04, 0.0, 0.0)), ("payload", (-0.04, 0.0, 0.0))),
    "spatial_arm": (("hand", (0.0, 0.0, 0.06)), ("upper_arm", (0.0, 0.0, 0.2))),
    "stewart_platform": None,
}

# Declared of a connection, s: nothing next to a period, and enough for devices not to exchange.
BARELY = 1e-9


# Of the grip, assumed: about twice the firm arm's stiffness, so that its mass of 0.55 kg swings at
# 8 Hz between them, and with its lever in rotation (``scene/hand.py``).
GRIP = {"stiffness": 1000.0, "damping": 10.0, "angular_stiffness": 0.9, "angular_damping": 9e-3}


# Who holds the other point.
Holder = Literal["grip", "rigid", "massless", "nobody"]


def held_scene(
    name: str, period: float, holder: Holder = "grip", late: bool = False, stiffness: float = 0.0
) -> Scene:
    """Return a scene held at two points, by nobody and by an arm.

    Args:
        name: of the shipped scene.
        period: s.
        holder: an arm whose mass is behind a grip, one whose mass is rigidly on its device, one
            that is the spring and the damper alone, or nobody, whose device moves along.
        late: without exchange of the hands' wrenches.
        stiffness: of the joint constraints, N/m, their damping with its root; 0: the scene's own.
    """
    scene = load_scene(name)
    point, places = scene.operational_points[0], POINTS[name]
    if places is None:
        x, y, z = point.origin.xyz
        places = ((point.link, (x + 0.05, y, z)), (point.link, (x - 0.05, y, z)))
    points = [
        {"name": label, "link": link, "origin": {"xyz": list(xyz)}}
        for label, (link, xyz) in zip((PUSHER, HOLDER), places, strict=True)
    ]
    arm: dict[str, object] = {"kind": "arm", "impedance": "firm", "waypoints": [{"time": 0}]}
    if holder == "massless":
        firm = ArmHand.model_validate(arm).model_dump()
        arm = {key: firm[key] for key in SpringDamperHand.model_fields} | {"kind": "spring_damper"}
    nobody = {"kind": "constant_wrench"}
    holders = {"grip": arm | {"grip": GRIP}, "nobody": nobody}
    hands: list[dict[str, object]] = [
        {"point": PUSHER, "hand": nobody},
        {"point": HOLDER, "hand": holders.get(holder, arm)},
    ]
    if stiffness:
        own = scene.controller.joint_constraint
        damping = own.damping * float(np.sqrt(stiffness / own.stiffness))
        stiff = own.model_copy(update={"stiffness": stiffness, "damping": damping})
        controller = scene.controller.model_copy(update={"joint_constraint": stiff})
        hands = [hand | {"controller": controller} for hand in hands]
    if late:
        hands = [hand | {"connection": {"expected": BARELY}} for hand in hands]
    return scene.with_(operational_points=points, hands=hands, simulation={"period": period})


def table(rows: Sequence[Row]) -> str:
    """Return the largest errors of each scene and period as a table for a document."""
    lines = []
    for scene, period in dict.fromkeys((row.scene, row.period) for row in rows):
        found = [row.felt for row in rows if (row.scene, row.period) == (scene, period)]
        worst = np.max([np.abs(one.ratio - 1.0) for one in found], axis=0)
        shares = [100.0 * one.share for one in found]
        errors = (f"{100.0 * error:.2g} %" for error in worst)
        matters = f"{np.min(shares):.0f} to {np.max(shares):.0f} %"
        lines.append((f"`{scene}`", f"{1e3 * period:g}", f"{len(found)}", *errors, matters))
    headings = ("scene", "period, ms", "directions", *(f"{f:g} Hz" for f in FREQUENCIES_HZ))
    return Sheet("felt is off by", (*headings, "arm matters by"), tuple(lines)).markdown()


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def users(
    scenes: Annotated[
        list[str] | None, typer.Argument(help="of the three; all of them if none", metavar="SCENES")
    ] = None,
    late: Annotated[
        bool, typer.Option("--late", help="devices do not hear each other's hands; 1 kHz only")
    ] = False,
    holder: Annotated[
        Holder, typer.Option(help="whose mass is behind a grip, rigidly on its device, or nothing")
    ] = "grip",
    stiffness: Annotated[
        float, typer.Option(min=0.0, help="of joint constraints, N/m; 0: the scene's own")
    ] = 0.0,
) -> None:
    """Push beside another user's arm, and print by how much what is felt is off."""
    for name in scenes or ():
        if name not in POINTS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(POINTS)}")
    rows = [
        Row(name, period, one)
        for name in scenes or POINTS
        for period in (PERIODS_S[:1] if late else PERIODS_S)
        for one in felt_beside_others(held_scene(name, period, holder, late, stiffness), PUSHER)
    ]
    print(table(rows))


if __name__ == "__main__":
    run_app(app)
