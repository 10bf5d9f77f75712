# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech live``: a page on which a scene moves, and is moved with the mouse."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Annotated

import typer

from hapticmech_ros.cli.console import ChangesOption, SceneArgument, say


def live(
    scene: SceneArgument = "five_bar",
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="of the page; the next free one if it is taken")
    ] = 8080,
    host: Annotated[
        str, typer.Option(help="address that is served; 0.0.0.0: to the whole network")
    ] = "127.0.0.1",
    changes: ChangesOption = None,
) -> None:
    """Serve a page to this machine's browser on which SCENE moves, until Ctrl-C."""
    from hapticmech_ros.cli.graph import stop_by_signals
    from hapticmech_ros.live.commands import Backend, Open
    from hapticmech_ros.live.process import LiveProcess
    from hapticmech_ros.live.settings import VISER, changes_of, checked_address
    from hapticmech_ros.live.still import StillScene
    from hapticmech_ros.loading import load_scene, shipped_scenes
    from hapticmech_ros.mechanism.inertia import NO_MASS, is_massless
    from hapticmech_ros.system.installation import refuse_unmet

    address = checked_address("--host", host)
    refuse_unmet([VISER])
    from hapticmech_ros.live.page import LivePage

    given, stop = tuple(changes or ()), stop_by_signals()
    loaded = load_scene(scene)
    with ExitStack() as ends:
        if is_massless(loaded) and is_massless(load_scene(scene, changes=given)):
            say(f"drawn as it is written: {NO_MASS}")
            shown: Backend = StillScene(Open(scene, given))
        else:
            asked = Open(scene, (*changes_of(loaded), *given))
            shown = ends.enter_context(LiveProcess(asked))
        page = LivePage(shown, scene, given, list(shipped_scenes()), host, port)
        say(f"{page.address}; Ctrl-C ends it")
        if not address.is_loopback:
            say("anyone who can reach this address can see and drag the mechanism")
        try:
            page.serve(stop)
        finally:
            page.close()
