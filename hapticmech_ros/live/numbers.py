# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page has as HTML: the numbers at its top, and quicker timers."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

import numpy as np

from hapticmech_ros.live.commands import Draggable, LiveState, UserState
from hapticmech_ros.live.live_picture import LiveFrame
from hapticmech_ros.view.palette import Colour

# A factor below this is told as one that is not real time.
_SLOW = 0.98
# viser's page sends moves of the mouse, and of sliders, every 50 ms at most, and has no setting for
# that: its timers of so long are made shorter.
QUICK_TIMERS = """<img hidden src="data:," onerror="if (!window.unhurried) {
  window.unhurried = setTimeout;
  window.setTimeout = (f, ms, ...more) => unhurried(f, ms === 50 ? 5 : ms, ...more); }">"""


def browser(client: int) -> str:
    """Return what a client is called on the page."""
    return f"browser {client + 1}"


def words(body: Draggable, several: bool) -> str:
    """Return what a body is called on the page; of several users hands have their points' names."""
    if body.kind == "link":
        return body.name
    return f"hand {body.name}" if several else "hand"


def you_html(client: int, said: str) -> str:
    """Return what a browser alone is told: which one it is, and why it drags nothing.

    Args:
        client: its number.
        said: why what it grabbed is not dragged; empty for nothing.
    """
    problem = f'; <b id="live-refused">{html.escape(said)}</b>' if said else ""
    style = "margin:0.5em 1.2em;font-size:0.85em"
    return f'<div style="{style}">this is <b id="live-you">{browser(client)}</b>{problem}</div>'


def numbers_html(
    state: LiveState,
    frame: LiveFrame,
    scene: str,
    hues: Mapping[str, Colour],
    holders: Mapping[Draggable, int],
    said: str,
) -> str:
    """Return the numbers of a state; each value is in an element whose id begins with ``live-``.

    Of several users each has a column, headed by its hue, and ids that end with its point's name.

    Args:
        state: of the session.
        frame: its picture.
        scene: its name.
        hues: of the users, by the operational point held, where there are several.
        holders: which client drags a body.
        said: what was refused; empty for nothing.
    """
    columns = len(state.users)
    rows = [_row("scene", [("scene", scene)], columns)]
    if hues:
        cells = "".join(_cell(_swatch(hues[user.point]), user.point) for user in state.users)
        rows.append(f"<tr><td>held at</td>{cells}</tr>")
    of_users = [_of_user(user, frame, state.paused) for user in state.users]
    for label, name in _OF_USERS if of_users else ():
        ids = [f"{name}-{user.point}" if hues else name for user in state.users]
        rows.append(_row(label, list(zip(ids, [one[name] for one in of_users], strict=True))))
    dragged = [drag.body for drag in state.drags]
    slow = "" if state.paused or state.factor >= _SLOW else " (slower than real time)"
    rate = "paused" if state.paused else f"{state.factor:.2f} × real time{slow}"
    common = {
        ("rate", "rate"): state.told or rate,
        ("time, s", "time"): f"{state.time:.2f}",
        ("dragged", "dragged"): ", ".join(words(one, bool(hues)) for one in dragged) or "nothing",
        ("by", "holders"): ", ".join(browser(holders[one]) for one in dragged if one in holders),
        ("changed", "changed"): ", ".join(state.changed),
        ("recording", "recording"): state.recording,
        ("ended" if state.error else "refused", "problem"): state.error or said,
    }
    rows += [_row(label, [(name, text)], columns) for (label, name), text in common.items() if text]
    return f'<table style="margin:0.5em 1em;font-size:0.85em">{"".join(rows)}</table>'


# Rows of the users: what is told, and the id of its element.
_OF_USERS = (
    ("joint constraints felt", "count"),
    ("mass felt, kg", "mass"),
    ("s", "s"),
    ("force of the hand, N", "force"),
    ("held by", "holding"),
)


def _of_user(user: UserState, frame: LiveFrame, paused: bool) -> dict[str, str]:
    """Return what is told of a user, by the id of its element."""
    masses, s = frame.masses[user.point], frame.analyses[user.point].spectrum.s
    waits = "; nothing moves while paused" if paused else ""
    immovable = f"cannot be dragged: {user.immovable}"
    return {
        "count": str(user.count),
        "mass": ", ".join(f"{mass:.3g}" if np.isfinite(mass) else "rigid" for mass in masses),
        "s": ", ".join(f"{value:.3f}" for value in s),
        "force": f"{np.linalg.norm(user.hand_wrench[:3]):.2f}",
        "holding": immovable if user.immovable else user.holding + waits,
    }


def _row(label: str, values: Sequence[tuple[str, str]], columns: int = 1) -> str:
    """Return a row with values by the ids of their elements; one alone spans so many columns."""
    cells = "".join(
        _cell(f'<b id="live-{name}">{html.escape(value)}</b>', columns=columns)
        for name, value in values
    )
    return f"<tr><td>{label}</td>{cells}</tr>"


def _cell(content: str, text: str = "", columns: int = 1) -> str:
    span = f' colspan="{columns}"' if columns > 1 else ""
    return f'<td{span} style="padding-left:1em">{content}{html.escape(text)}</td>'


def _swatch(hue: Colour) -> str:
    """Return a square of a user's hue."""
    return f'<span style="color:{css(hue)}">■</span> '


def css(colour: Colour) -> str:
    """Return a colour as CSS has it, opaque."""
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour[:3])
