# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech device``: real devices that a scene can name."""

from __future__ import annotations

import math
import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from hapticmech_ros.cli.commands import Commands
from hapticmech_ros.cli.console import console, say, seconds_of, vector_of
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.system.installation import refuse_without_ros

if TYPE_CHECKING:
    from hapticmech_ros.haply.emulator import Press

app = Commands("List, emulate, calibrate and test real devices.", "device list", "device test")


@app.command("list", "device list")
def list_devices() -> None:
    """List the device presets of the package and their main values."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from hapticmech_ros.scene.device import Device, device_presets

    table = Table(box=SIMPLE_HEAD)
    table.add_column("preset", no_wrap=True)
    table.add_column("device")
    for heading in ("kg", "N", "N m", "friction, N", "reach, m"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, preset in device_presets().items():
        device = Device(preset=name)
        torque = f"{device.torque_limit:g}" if device.actuated == "all" else "-"
        mass, force = f"{device.mass:g}", f"{device.force_limit:g}"
        friction, reach = f"{device.coulomb_friction:g}", f"{device.workspace.radius:g}"
        table.add_row(name, preset.description, mass, force, torque, friction, reach)
    console.print(table)


Model = Annotated[Literal["inverse3"], typer.Argument(help="inverse3")]
MountingOption = Annotated[
    str, typer.Option(help="roll, pitch, yaw of the device's base in the world, rad")
]
UriOption = Annotated[str, typer.Option(help="address of Haply's Inverse service")]


@app.command(
    "emulate", "device emulate inverse3", "device emulate inverse3 --scene door --delay 2ms"
)
def emulate(
    model: Model,
    scene: Annotated[
        str, typer.Option(help="scene whose hand holds it, and whose device it is if that fits")
    ] = "five_bar",
    point: Annotated[
        str, typer.Option(help="of several hands of the scene, the one at this point")
    ] = "",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free")] = 10001,
    host: Annotated[str, typer.Option(help="address to listen at")] = "127.0.0.1",
    mounting: MountingOption = "0 0 0",
    idle_after: Annotated[
        str, typer.Option(help="after the last message, no force any more")
    ] = "10ms",
    delay: Annotated[str, typer.Option(help="of each answer")] = "0ms",
    jitter: Annotated[str, typer.Option(help="further, at random up to this")] = "0ms",
    garbage: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="share of answers that are spoilt")
    ] = 0.0,
    silent: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="share of messages without an answer")
    ] = 0.0,
    trace: Annotated[
        Path | None, typer.Option(help="CSV of position and forces, a row per ms")
    ] = None,
    press: Annotated[
        list[str] | None,
        typer.Option(
            help="button of the handle, and when it is pressed and released after the first "
            "message, such as 'a 2s 3s'; any number"
        ),
    ] = None,
) -> None:
    """Serve as the service of a real device does, with a simulated one behind it, until Ctrl-C."""
    import asyncio
    from contextlib import ExitStack, suppress

    import numpy as np
    import pinocchio as pin

    from hapticmech_ros.haply.emulator import EmulatedInverse3, Faults, Service
    from hapticmech_ros.loading import load_scene

    del model
    loaded = load_scene(scene).held_at(point)
    if loaded.device.actuated != "translation":
        loaded = loaded.with_(device={"preset": "inverse3"})
    faults = Faults(seconds_of("--delay", delay), seconds_of("--jitter", jitter), garbage, silent)
    rule = "must be three numbers, such as '0 0 1.5708'"
    angles = vector_of("--mounting", mounting, mounting.split(), rule)
    rotation = np.asarray(pin.rpy.rpyToMatrix(*angles))
    with ExitStack() as stack:
        rows = stack.enter_context(trace.open("w", encoding="utf-8")) if trace else None
        idle = seconds_of("--idle-after", idle_after)
        presses = [_press(text) for text in press or ()]
        device = EmulatedInverse3(loaded, rotation, idle, rows, presses=presses)
        service = Service(device, faults)

        def ready(found: int) -> None:
            say(f"ws://{host}:{found}; Ctrl-C ends it")

        with suppress(KeyboardInterrupt):
            asyncio.run(service.serve(host, port, ready))


@app.command("calibrate", "device calibrate inverse3 haply.yaml")
def calibrate(
    model: Model,
    out: Annotated[Path, typer.Argument(help="parameter file of haply_device to make")],
    uri: UriOption = "ws://127.0.0.1:10001",
    device_id: Annotated[str, typer.Option(help="empty: the only one there is")] = "",
    seconds: Annotated[float, typer.Option(min=1.0, help="for moving it about")] = 15.0,
) -> None:
    """Find how a device's base stands in the world, and how far it reaches; writes parameters."""
    from hapticmech_ros.haply.reader import CursorReader, mounting_of, reach_of

    del model
    if out.exists():
        raise InvalidInputError("parameter file", str(out), "must not be there yet")
    with closing(CursorReader(uri, device_id)) as reader:
        for name, value in reader.known.items():
            say(f"{name}: {value}")
        places = []
        for what in (
            "Hold the handle still in the middle of its reach",
            "Move it 10 cm along x of the world, and hold it still",
            "Go back, move it 10 cm along y of the world, and hold it still",
        ):
            typer.prompt(f"{what}; then Enter", default="", show_default=False)
            places.append(reader.mean(0.2))
        mounting = mounting_of(*places)
        question = f"Then move it about through all of its reach for {seconds:g} s; Enter begins"
        typer.prompt(question, default="", show_default=False)
        _, radius = reach_of(reader.path(seconds))
        identity = reader.device_id
    roll, pitch, yaw = mounting.angles
    out.write_text(
        "/**/haply_device:\n  ros__parameters:\n"
        f'    uri: {uri}\n    device_id: "{identity}"\n'
        f"    mounting_roll: {roll:.4f}\n    mounting_pitch: {pitch:.4f}\n"
        f"    mounting_yaw: {yaw:.4f}\n    workspace_radius: {0.9 * radius:.3f}\n",
        encoding="utf-8",
    )
    skew = math.degrees(abs(mounting.skew))
    say(f"the movements were {skew:.1f}° off a right angle")
    say(f"{out}: workspace_radius is 0.9 of the reach, {radius:.3f} m")


@app.command("test", "device test", "device test --force 0.3 --rate 500")
def check_driver(
    namespace: Annotated[str, typer.Option(help="of the driver's topics device/...")] = "",
    force: Annotated[float, typer.Option(min=0.05, max=5.0, help="to command, N")] = 0.5,
    rate: Annotated[
        float, typer.Option(min=10.0, max=10000.0, help="control rate, by which a force ends, Hz")
    ] = 1000.0,
) -> None:
    """Test a running driver of a device by its topics, with the controller ended. Hold the handle.

    A force is commanded along x of the world for half a second, four times.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    refuse_without_ros(os.environ)
    from hapticmech_ros.nodes.conformance import DriverTest

    table = Table(box=SIMPLE_HEAD)
    for heading in ("rule", "found", "kept"):
        table.add_column(heading, overflow="fold")
    words = {True: "yes", False: "NO", None: "not seen"}
    test, broken = DriverTest(namespace, force, rate), 0
    try:
        with console.status("testing"):
            for check in test.run():
                table.add_row(check.rule, check.found, words[check.kept])
                broken += check.kept is False
    finally:
        test.close()
    console.print(table)
    if broken:
        raise typer.Exit(1)


def _press(text: str) -> Press:
    """Return the contents of ``BUTTON START END``.

    Raises:
        InvalidInputError: other words.
    """
    from hapticmech_ros.haply.emulator import Press

    words = text.split()
    if len(words) != 3:
        raise InvalidInputError("--press", text, "must be a button and two times, as in a 2s 3s")
    return Press(words[0], seconds_of("--press", words[1]), seconds_of("--press", words[2]))
