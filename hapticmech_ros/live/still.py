# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A page's backend for a scene that cannot move, since no link has a mass."""

from __future__ import annotations

import time

from hapticmech_ros.live.commands import Command, LiveState, Open, Opened, Report
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.inertia import NO_MASS
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.view.still import weighed


class StillScene:
    """A scene without any mass, as written, its loops open; it is drawn only.

    Args:
        asked: the scene.

    Raises:
        SceneError: the scene is refused.
    """

    takes: frozenset[type] = frozenset()

    def __init__(self, asked: Open) -> None:
        scene = weighed(load_scene(asked.scene, changes=asked.changes))
        mechanism = Mechanism(scene)
        q, _ = authored_state(scene, mechanism.tree)
        active = (False,) * len(mechanism.closures)
        state = LiveState(1, 0.0, True, 0.0, q, active, (), error=NO_MASS)
        self._news: list[Report] = [Opened(1, asked, scene, ()), state]

    def send(self, command: Command) -> None:
        """Do nothing: nothing can be done to it."""

    def news(self, timeout_s: float) -> list[Report]:
        """Return the scene and its state once, and nothing after that.

        Args:
            timeout_s: how long to wait then, s.
        """
        if not self._news:
            time.sleep(timeout_s)
        news, self._news = self._news, []
        return news
