# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech device``: real devices that a scene can name."""

from __future__ import annotations

import typer

app = typer.Typer(help="Real devices that a scene can name.", no_args_is_help=True)


@app.callback()
def _options() -> None:
    """Real devices that a scene can name."""


@app.command("list")
def list_devices() -> None:
    """List the device presets of the package and their main values."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from hapticmech_ros.cli.console import console
    from hapticmech_ros.scene.device import Device
    from hapticmech_ros.scene.device_presets import device_presets

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
