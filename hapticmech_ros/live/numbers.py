# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page has as HTML: the numbers at its top, and quicker timers."""

from __future__ import annotations

import html

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import LiveState

# A factor below this is told as one that is not real time.
_SLOW = 0.98
# viser's page sends moves of the mouse, and of sliders, every 50 ms at most, and has no setting for
# that: its timers of so long are made shorter.
QUICK_TIMERS = """<img hidden src="data:," onerror="if (!window.unhurried) {
  window.unhurried = setTimeout;
  window.setTimeout = (f, ms, ...more) => unhurried(f, ms === 50 ? 5 : ms, ...more); }">"""


def numbers_html(state: LiveState, scene: str, s: Array, masses: Array, said: str) -> str:
    """Return the numbers of a state; each value is in an element whose id begins with ``live-``.

    Args:
        state: of the session.
        scene: its name.
        s: (t,) of the spectrum, descending.
        masses: (k,) felt, kg, infinite where rigid.
        said: what was refused; empty for nothing.
    """
    slow = "" if state.paused or state.factor >= _SLOW else " (slower than real time)"
    rate = "paused" if state.paused else f"{state.factor:.2f} × real time{slow}"
    rate = state.told or rate
    felt = ", ".join(f"{mass:.3g}" if np.isfinite(mass) else "rigid" for mass in masses)
    rows = [
        ("scene", "scene", scene),
        ("joint constraints felt", "count", str(state.count)),
        ("mass felt, kg", "mass", felt),
        ("s", "s", ", ".join(f"{value:.3f}" for value in s)),
        ("force of the hand, N", "force", f"{np.linalg.norm(state.hand_wrench[:3]):.2f}"),
        ("rate", "rate", rate),
        ("time, s", "time", f"{state.time:.2f}"),
        ("dragged", "dragged", state.dragged or "nothing"),
    ]
    if state.changed:
        rows.append(("changed", "changed", ", ".join(state.changed)))
    if state.recording:
        rows.append(("recording", "recording", state.recording))
    problem = state.error or said
    if problem:
        rows.append(("refused" if not state.error else "ended", "problem", problem))
    cells = "".join(
        f'<tr><td>{label}</td><td style="padding-left:1em">'
        f'<b id="live-{name}">{html.escape(value)}</b></td></tr>'
        for label, name, value in rows
    )
    return f'<table style="margin:0.5em 1em;font-size:0.85em">{cells}</table>'
