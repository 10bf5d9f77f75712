# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A film of a scene's experiment, moved by the scene's own hands, without a browser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import Failed, Hold, Open
from hapticmech_ros.live.live_picture import LivePicture
from hapticmech_ros.live.live_session import LiveSession
from hapticmech_ros.view.drawn import draw_film
from hapticmech_ros.view.palette import looks
from hapticmech_ros.view.picture import count_words

# Endings of the names of such files.
FILMS = (".gif", ".webp")
# Pictures a second.
RATE = 10
FILM_PIXELS = 480


def draw_experiment(
    scene: str,
    path: Path,
    changes: Sequence[str] = (),
    point: str = "",
    side_pixels: int = FILM_PIXELS,
    progress: Callable[[int, int], None] = lambda done, every: None,
) -> None:
    """Write what the page shows of a scene's experiment as a GIF or WebP file, in real time.

    Args:
        scene: name of a shipped one, or path.
        path: of the file; its folder is made.
        changes: of the scene, ``key=value`` each.
        point: operational point, or link, that the first user holds; as in the scene if empty.
        side_pixels: width and height.
        progress: called with the steps done, and all: each picture takes two.

    Raises:
        HapticMechError: the scene is refused; or an error ended it, and the film until then was
            written.
    """
    session = LiveSession(Open(scene, tuple(changes)), 0.0)
    if point:
        report = session.take(Hold(session.opened.users[0], point), 0.0)
        if isinstance(report, Failed):
            raise HapticMechError(report.reason)
    picture = LivePicture(session.opened)
    of = session.opened.scene
    look_of, pictures = looks(picture.users), []
    frames = round((of.hand.start_delay + of.experiment.duration) * RATE) + 1
    for frame in range(frames):
        session.advance(frame / RATE)
        while session.is_behind:
            session.advance(frame / RATE)
        state = session.state()
        words = [look_of[user.point].words(count_words(user.count)) for user in state.users]
        title = "  ·  ".join((of.name, f"{state.time:.1f} s", *words))
        pictures.append((title, picture.draw(state).shapes))
        progress(frame + 1, 2 * frames)
        if state.error:
            break
    path.parent.mkdir(parents=True, exist_ok=True)
    draw_film(
        pictures,
        path,
        picture.planar,
        RATE,
        side_pixels,
        picture.hues,
        lambda done, every: progress(every + done, 2 * every),
    )
    if state.error:
        raise HapticMechError(f"at {state.time:g} s: {state.error}; the film until then: {path}")
