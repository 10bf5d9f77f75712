# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controls of the page, and its numbers and plots. To be called in viser's event loop.

Also the last seconds of plotted values, and the page's HTML: what to do and the numbers at its top,
the legend, and quicker timers.
"""

from __future__ import annotations

import html
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np
import viser
import viser.uplot
from matplotlib.colors import to_hex

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import (
    Backend,
    Command,
    Drag,
    Draggable,
    DragStiffness,
    Hold,
    LiveState,
    Open,
    Opened,
    Pause,
    Record,
    Reset,
    Step,
    SwitchClosure,
    Tune,
    UserState,
)
from hapticmech_ros.live.grip import DRAG_TIMEOUT_S, SOFTEST, STIFFEST
from hapticmech_ros.live.live_picture import (
    AROUND,
    AROUND_LARGE,
    LAYERS,
    Drawn,
    Ground,
    InstanceArrays,
    LiveFrame,
    LivePicture,
    NodeKey,
    unit_body,
)
from hapticmech_ros.live.settings import (
    HANDS,
    LONGEST_DELAY_MS,
    MOUSE_ALONE,
    changes_of,
    gain_sliders,
)
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.view import palette
from hapticmech_ros.view.palette import Colour
from hapticmech_ros.view.shapes import MASS

_SMALL, _LARGE = "margin:0.5em 1.2em;font-size:0.85em", "margin:0.5em 1em;font-weight:bold"
# A factor below this is shown as slower than real time.
_SLOW = 0.98
# viser's page sends moves of the mouse, and of sliders, every 50 ms at most, and has no setting for
# that: its timers of so long are made shorter.
QUICK_TIMERS = """<img hidden src="data:," onerror="if (!window.unhurried) {
  window.unhurried = setTimeout;
  window.setTimeout = (f, ms, ...more) => unhurried(f, ms === 50 ? 5 : ms, ...more); }">"""


def browser(client: int) -> str:
    """Return a client's name on the page."""
    return f"browser {client + 1}"


def words(body: Draggable, several: bool) -> str:
    """Return a body's name on the page; of several users hands have their points' names."""
    if body.kind == "link":
        return body.name
    return f"hand {body.name}" if several else "hand"


def you_html(client: int, said: str) -> str:
    """Return the text for one browser: its name to others, and why its drag was refused.

    Args:
        client: its number.
        said: why its drag was refused; empty for nothing.
    """
    problem = f'<br><b id="live-refused">{html.escape(said)}</b>' if said else ""
    you = f'<b id="live-you">{browser(client)}</b>'
    return f'<div style="{_SMALL}">you are {you}, of those that show this page{problem}</div>'


def hint_html(points: Sequence[str]) -> str:
    """Return what to do, with the points that users hold."""
    ball = "a ball (a user's hand)" if len(points) > 1 else "the yellow ball (your hand)"
    return f'<div style="{_LARGE}" id="live-hint">Drag {ball} or any link.</div>'


# Drawn at times only.
_ANYTIME = ("hand_force", "device_command", "contact_force", "point_command")
_WORDS = {
    "device": "ball: your hand, on the device; drag it",
    "links": "link; drag it",
    **{key: palette.LEGEND[key] for key in ("joints", "closures", "open_closures", "springs")},
    "solids": "shape that may touch",
    "hulls": "mesh that may touch, as its convex hull",
    "hand_force": "arrow: force by your hand on the device",
    "device_command": "arrow: force that you feel, by the device on your hand",
    "contact_force": "arrow: force by the surroundings on the mechanism",
    "point_command": "arrow: force that the controller passes on to the mechanism",
    "rigid_directions": "double arrow and ring: rigid direction; this force and this torque "
    "together move nothing",
    "free_directions": "thin double arrow and ring: free direction",
    MASS: "ellipsoid: mass felt at the point held; longest where it is heaviest; where it is rigid "
    "it ends at a largest length",
}
# Those of one user.
COLOUR_WORDS = {
    "device": "yellow",
    "hand_force": "orange",
    "device_command": "red",
    "contact_force": "magenta",
    "point_command": "blue",
    "rigid_directions": "violet",
    "free_directions": "teal",
    MASS: "pale blue",
}
_HELP = (
    "An arrow is a force, a ring a torque about its axis. The thick axes in the ball are the "
    "device's.",
    f"Your pull ends when you release the button, or when this browser sends nothing for "
    f"{DRAG_TIMEOUT_S:g} s.",
    "Mass felt is that along each axis of the ellipsoid; <i>rigid</i>: you cannot move the point "
    "that way.",
    "Λ<sub>h</sub><sup>-1</sup>, the inverse inertia of the mechanism at the point that you hold, "
    "is the acceleration of that point by a unit force, for each direction. It is 0 in directions "
    "that joints or loops block, which you feel as stiff springs: the joint constraints. "
    "Responses are square roots of that acceleration relative to the link alone, rotation "
    "included, the freest direction first.",
    "Mouse: drag elsewhere to turn the view, with the right button to move it; the wheel zooms. "
    "Keys: arrows turn the view, W, A, S, D, Q and E move it. On a touch screen one finger drags "
    "or turns the view, and two move it.",
)


def legend_html(seen: Collection[str], cell: str, hues: Mapping[str, Colour]) -> str:
    """Return what is drawn, with its colours, and help.

    Args:
        seen: meanings of shapes that are drawn.
        cell: side of a square of the ground, with its unit.
        hues: of the users, by the operational point held, where there are several.
    """
    common = palette.LEGEND.keys() - palette.FELT
    rows = [
        text
        if hues and meaning not in common
        else f"{_swatch(palette.MEANING[meaning])}{COLOUR_WORDS.get(meaning, '')} {text}"
        for meaning, text in _WORDS.items()
        if meaning in seen or meaning in _ANYTIME
    ]
    if hues:
        rows.append("what has no colour here has shades of its user's hue, which the table shows")
    axes = "".join(
        f'<b style="color:{to_hex(colour)}">{name}</b> '
        for name, colour in zip("xyz", palette.AXES, strict=True)
    )
    rows += [f"{axes}axes of the world, at its origin", f"a square of the ground is {cell} wide"]
    text = "".join(f"<p>{one}</p>" for one in _HELP)
    return f'<div style="{_SMALL}" id="live-legend">{"<br>".join(rows)}{text}</div>'


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
        said: refused request; empty for none.
    """
    columns = len(state.users)
    rows = [f"<tr><td>scene</td>{_cell(_bold('scene', scene), columns=columns)}</tr>"]
    if hues:
        cells = "".join(_cell(_swatch(hues[user.point]), user.point) for user in state.users)
        rows.append(f"<tr><td>held at</td>{cells}</tr>")
    of_users = [_of_user(user, frame, state.paused) for user in state.users]
    for label, name in of_users[0] if of_users else ():
        ids = [f"{name}-{user.point}" if hues else name for user in state.users]
        texts = [one[label, name] for one in of_users]
        cells = "".join(_cell(_bold(*one)) for one in zip(ids, texts, strict=True))
        rows.append(f"<tr><td>{label}</td>{cells}</tr>")
    dragged = [drag.body for drag in state.drags]
    by = ", ".join(browser(holders[one]) for one in dragged if one in holders)
    slow = "" if state.paused or state.factor >= _SLOW else " (slower than real time)"
    rate = "paused" if state.paused else f"{state.factor:.2f} × real time{slow}"
    common = {
        ("speed", "rate"): state.told or rate,
        ("time, s", "time"): f"{state.time:.2f}",
        ("dragged", "dragged"): ", ".join(words(one, bool(hues)) for one in dragged) or "nothing",
        ("changed", "changed"): ", ".join(state.changed),
        ("recording", "recording"): state.recording,
        ("ended" if state.error else "refused", "problem"): state.error or said,
    }
    more = {"dragged": f" by {_bold('holders', by)}"} if by else {}
    rows += [
        f"<tr><td>{label}</td>{_cell(_bold(name, text) + more.get(name, ''), columns=columns)}</tr>"
        for (label, name), text in common.items()
        if text
    ]
    return f'<table style="margin:0.5em 1em;font-size:0.85em">{"".join(rows)}</table>'


def _of_user(user: UserState, frame: LiveFrame, paused: bool) -> dict[tuple[str, str], str]:
    """Return a user's values, by label and the id of their elements."""
    masses, s = frame.masses[user.point], frame.analyses[user.point].spectrum.s
    waits = "; nothing moves while paused" if paused else ""
    immovable = f"cannot be dragged: {user.immovable}"
    return {
        ("joint constraints felt", "count"): str(user.count),
        ("mass felt along the ellipsoid's axes, kg", "mass"): ", ".join(
            _digits(mass) if np.isfinite(mass) else "rigid" for mass in masses
        ),
        (RESPONSE, "s"): ", ".join(map(_digits, s)),
        ("force of the hand, N", "force"): _digits(float(np.linalg.norm(user.hand_wrench[:3]))),
        (HELD_BY, "holding"): immovable if user.immovable else user.holding + waits,
    }


def _digits(value: float) -> str:
    """Return a number with three significant digits, and at most three decimals."""
    found = np.format_float_positional(value, precision=3, fractional=False, trim="-")
    return np.format_float_positional(round(float(found), 3), trim="-")


def _bold(name: str, value: str) -> str:
    return f'<b id="live-{name}">{html.escape(value)}</b>'


def _cell(content: str, text: str = "", columns: int = 1) -> str:
    span = f' colspan="{columns}"' if columns > 1 else ""
    return f'<td{span} style="padding-left:1em">{content}{html.escape(text)}</td>'


def _swatch(hue: Colour) -> str:
    """Return a square of a user's hue."""
    return f'<span style="color:{to_hex(hue)}">■</span> '


HELD_BY = "device held by"
# Of the singular values s_i, for people.
RESPONSE = "response (0: rigid, 1: as the link alone)"
# How long plots look back, s, and how often a value is kept.
SECONDS, PERIOD_S = 10.0, 0.05
# Smaller forces (N) do not fill a plot; steps of its axes, as viser's page has three decimals.
_LEAST_N = 0.1
_STEPS = tuple(float(f"{step}e{power}") for power in range(-3, 7) for step in (1, 2, 5))


class Plot(NamedTuple):
    """A plot over time.

    Attributes:
        title: above it.
        unit: of its values, beside their axis.
        top: the axis goes from 0 to this at least.
        names: of its lines.
        columns: returns times and values (n,) of each line.
    """

    title: str
    unit: str
    top: float
    names: tuple[str, ...]
    columns: Callable[[], tuple[Array, ...]]


class History:
    """Rate, and every user's count, spectrum and forces, over the session's time."""

    def __init__(self) -> None:
        self._users: tuple[str, ...] = ()
        self._directions = 0
        self._rows: deque[Array] = deque()

    def begin(self, users: Sequence[str], directions: int) -> None:
        """Forget all; from now on it is of these users, whose spectra have so many directions."""
        self._users, self._directions = tuple(users), directions
        self._rows.clear()

    def add(self, state: LiveState) -> None:
        """Add a state, unless the last one is too near; one of an earlier time begins anew."""
        if self._rows and state.time < self._rows[-1][0]:
            self._rows.clear()
        if self._rows and state.time - self._rows[-1][0] < PERIOD_S:
            return
        while self._rows and state.time - self._rows[0][0] > SECONDS:
            self._rows.popleft()
        row = [state.time, state.factor]
        for user in state.users:
            forces = (user.hand_wrench[:3], user.on_hand[:3])
            row += [user.count, *(float(np.linalg.norm(force)) for force in forces)]
            row += user.observation[: self._directions].tolist()
        self._rows.append(np.array(row))

    def plots(self) -> Iterator[Plot]:
        """Yield every plot.

        Of each user the number of joint constraints felt, s_i in as many directions as there are,
        and the norms of F_h and of the device's force; then the real-time factor.
        """
        most = self._directions
        spectrum = tuple(f"direction {i + 1}" for i in range(most))
        several = len(self._users) > 1
        for index, user in enumerate(self._users):
            of, first = f" ({user})" if several else "", self._first(index)
            felt = partial(self._columns, first)
            yield Plot(f"joint constraints felt{of}", "number", most, ("number",), felt)
            s = partial(self._columns, *range(first + 3, first + 3 + most))
            yield Plot(f"response{of}", "0: rigid, 1: as the link alone", 1.0, spectrum, s)
            forces = partial(self._columns, first + 1, first + 2)
            yield Plot(f"force{of}", "N", _LEAST_N, ("by the hand", "by the device"), forces)
        speed = partial(self._columns, 1)
        yield Plot("speed", "times real time", 1.0, ("speed",), speed)

    def _first(self, user: int) -> int:
        """Return the column in which a user's values begin."""
        return 2 + user * (3 + self._directions)

    def _columns(self, *columns: int) -> tuple[Array, ...]:
        width = self._first(len(self._users))
        rows = np.array(self._rows) if self._rows else np.zeros((1, width))
        return tuple(np.ascontiguousarray(rows[:, column]) for column in (0, *columns))


_LINE_WIDTH = 2.0
_CELLS, _SECTIONS = (188, 195, 205), (150, 160, 173)


class SceneNodes:
    """Viser's nodes of a scene.

    Args:
        server: of the page.
        on_drag: called with viser's event of a drag, and the dragged link, if any.
    """

    def __init__(
        self, server: viser.ViserServer, on_drag: Callable[[Any, str | None], None]
    ) -> None:
        self._server, self._on_drag = server, on_drag
        self._shown: Drawn | None = None
        self._nodes: dict[NodeKey, Any] = {}
        self._lines: Any = None
        self._solids: dict[int, Any] = {}
        self._labels: dict[str, Any] = {}

    def stand_on(self, ground: Ground) -> None:
        """Show the ground, and the world's axes at its origin."""
        cell, scene = ground.cell, self._server.scene
        # Lines: viser's grid computes its own at every pixel, which takes as long as all else.
        ends, fifth = ground.lines
        colours = np.where(fifth[:, None, None], _SECTIONS, _CELLS).repeat(2, axis=1)
        scene.add_line_segments("/ground", ends, colours, thickness=1.0, thickness_units="screen")
        axes = scene.world_axes
        axes.axes_length, axes.axes_radius, axes.origin_radius = cell, 0.02 * cell, 0.0
        axes.visible = True

    def clear(self) -> None:
        """Show nothing."""
        kinds: tuple[dict[Any, Any], ...] = (self._nodes, self._solids, self._labels)
        for node in (*(one for kind in kinds for one in kind.values()), self._lines):
            if node is not None:
                node.remove()
        for kind in kinds:
            kind.clear()
        self._shown = self._lines = None

    def show(self, new: Drawn, holders: Mapping[Draggable, int]) -> None:
        """Show a picture.

        Args:
            new: the picture.
            holders: which client drags a body.
        """
        picture, old, self._shown = new.picture, self._shown, new
        with self._server.atomic():
            for key, arrays in new.instances.items():
                self._show_instances(key, arrays, None if old is None else old.instances.get(key))
            self._show_lines(*new.lines)
            for number, pose in new.frame.solids.items():
                node = self._solids.get(number) or self._made_solid(picture, number)
                turned = np.roll(quaternion_of(pose.rotation), 1)
                node.position, node.wxyz = pose.translation, turned
            for number, node in self._solids.items():
                node.visible = number in new.frame.solids
            self._show_labels(new, holders)

    def _show_labels(self, new: Drawn, holders: Mapping[Draggable, int]) -> None:
        """Label the hands of several users, with the browser that drags each."""
        for user in new.state.users if new.picture.hues else ():
            holder = holders.get(Draggable("hand", user.point))
            text = user.point if holder is None else f"{user.point}: {browser(holder)}"
            # Above the ball, which it would hide.
            place = user.device[:, 3].copy()
            place[1 if new.picture.planar else 2] += new.picture.ball
            label = self._labels.get(user.point)
            if label is None:
                label = self._server.scene.add_label(
                    f"/users/{user.point}", text, position=place, anchor="bottom-center"
                )
                self._labels[user.point] = label
            if label.text != text:
                label.text = text
            label.position = place

    def _show_lines(self, ends: Array, colours: Array) -> None:
        if self._lines is not None and len(ends) == len(self._lines.points):
            self._lines.points, self._lines.colors = ends, colours
            return
        if self._lines is not None:
            self._lines.remove()
        self._lines = self._server.scene.add_line_segments(
            "/lines", ends, colours, thickness=_LINE_WIDTH, thickness_units="screen"
        )

    def _show_instances(
        self, key: NodeKey, new: InstanceArrays, old: InstanceArrays | None
    ) -> None:
        node = self._nodes.get(key)
        if node is None or old is None or len(old.shapes) != len(new.shapes):
            if node is not None:
                node.remove()
            self._nodes[key] = self._made_instances(key, new)
            return
        # Nodes without shapes take time, too.
        seen = any(shape is not None for shape in new.shapes)
        if node.visible != seen:
            node.visible = seen
        for name, before, now in (
            ("batched_positions", old.positions, new.positions),
            ("batched_wxyzs", old.quaternions, new.quaternions),
            ("batched_scales", old.scales, new.scales),
            ("batched_colors", old.colours, new.colours),
            ("batched_opacities", old.opacities, new.opacities),
        ):
            opaque = key.opaque and name == "batched_opacities"
            if not (opaque or np.array_equal(before, now)):
                setattr(node, name, now)

    def _made_instances(self, key: NodeKey, arrays: InstanceArrays) -> Any:
        body, grabbed, opaque = key
        # Those that cover much of the picture, such as the ellipsoid: smooth, in a material that is
        # quickly computed, and by their inside, so that nothing within is hidden.
        large = body == "sphere" and not (grabbed or opaque)
        corners, triangles = unit_body(body, AROUND_LARGE if large else AROUND)
        kind = "opaque" if opaque else "translucent"
        node = self._server.scene.add_batched_meshes_simple(
            f"/{'grabbed' if grabbed else 'seen'}/{kind}/{body}",
            corners,
            triangles,
            arrays.quaternions,
            arrays.positions,
            batched_scales=arrays.scales,
            batched_colors=arrays.colours,
            # With opacities viser draws them after what is opaque, even where all are 1.
            batched_opacities=None if opaque else arrays.opacities,
            material="toon3" if large else "standard",
            side="back" if large else "front",
            lod="off",
            flat_shading=body == "box",
            cast_shadow=False,
            receive_shadow=False,
        )
        if grabbed:

            async def dragged(event: Any) -> None:
                shown, at = self._shown, event.instance_index
                self._on_drag(event, None if shown is None else shown.link_at(key, at))

            node.on_drag("left")(dragged)
        return node

    def _made_solid(self, picture: LivePicture, number: int) -> Any:
        solid = picture.solids[number]
        node = self._server.scene.add_mesh_simple(
            f"/solids/{number}",
            solid.corners,
            solid.triangles,
            color=tuple(round(255 * part) for part in solid.colour[:3]),
            opacity=None if solid.colour[3] == 1.0 else solid.colour[3],
            flat_shading=True,
            side="double",  # files are not sure to have their triangles outwards
            cast_shadow=False,
            receive_shadow=False,
        )

        async def dragged(event: Any) -> None:
            self._on_drag(event, picture.link_of(solid))

        node.on_drag("left")(dragged)
        self._solids[number] = node
        return node


# Layers that are not seen at first.
HIDDEN = frozenset({"axes"})
# So many closures are shown initially.
_FEW = 4
# Above, right, below and left of a plot: numbers at the ends of axes need it.
_PADDING_PX = (12, 24, 0, 0)
# Of axes, as a panel is narrow: height of labels; height of numbers of times, and width of values.
_LABEL_PX, _NUMBERS_PX = 18, (28, 44)
_STROKES = ("#7a4fd0", "#1a7f86", "#d9534f", "#2f6fd0", "#c79a2a", "#5a5a5a")


class Controls:
    """The page's controls and messages.

    Args:
        server: of the page.
        backend: session or graph to show and move.
        first: scene with which it begins.
        given: changes of that scene, ``key=value`` each.
        scenes: that can be chosen.
        history: of plotted values.
        save: sends the present picture to the client of viser's event.

    Attributes:
        hidden: layers that are not drawn.
        said: why a request was refused; empty for none.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        backend: Backend,
        first: str,
        given: Sequence[str],
        scenes: Sequence[str],
        history: History,
        save: Callable[[Any], None],
    ) -> None:
        self._gui, self._backend, self._history = server.gui, backend, history
        self._first, self._given = first, tuple(given)
        self.hidden, self.said = HIDDEN, ""
        self._of_scene: list[Any] = []
        self._one_period: Any = None
        self._closures: dict[str, Any] = {}
        self._hands: list[Any] = []
        # Boxes that show values of a state.
        self._shown: list[tuple[Any, Callable[[LiveState], bool]]] = []
        self._plots: list[tuple[Any, Callable[[], tuple[Array, ...]]]] = []
        self._make(scenes, save)

    def tell(self, new: Drawn, scene: str, holders: Mapping[Draggable, int]) -> None:
        """Show the numbers of a picture.

        Args:
            new: the picture.
            scene: name of its scene.
            holders: which client drags a body.
        """
        state = new.state
        self._numbers.content = numbers_html(
            state, new.frame, scene, new.picture.hues, holders, self.said
        )
        shown = [(box, of(state)) for box, of in self._shown]
        if self._closures:
            shown += zip(self._closures.values(), state.active, strict=True)
        for box, wanted in shown:
            if box.value != wanted:
                box.value = wanted

    def plot(self) -> None:
        """Draw the plots anew, if they are wanted."""
        if self._with_plots.value:
            for plot, columns in self._plots:
                plot.data = columns()

    def open(self, opened: Opened, closures: Sequence[str]) -> None:
        """Make the controls that are of a scene anew.

        Args:
            opened: the scene.
            closures: names of its loops, as a state has them.
        """
        for control in self._of_scene:
            control.remove()
        gui, scene = self._gui, opened.scene
        prefixes = {user: f"{user} " if len(opened.users) > 1 else "" for user in opened.users}
        points = [point.name for point in scene.operational_points]
        frames = [*points, *(link.name for link in scene.links if link.name not in points)]
        self._of_scene = []
        if self._one_period is not None:
            self._one_period.label = (
                f"step one period ({_digits(1e3 * scene.simulation.period)} ms)"
            )
        if Drag in self._backend.takes:
            self._hint.content = hint_html(opened.users)
        self._closures = {}
        with self._feel:
            for user, prefix in prefixes.items():
                held = gui.add_dropdown(f"{prefix}point held", frames, initial_value=user)
                self._when(held, partial(Hold, user))
                self._of_scene.append(held)
            if closures and SwitchClosure in self._backend.takes:
                folder = gui.add_folder(
                    "closed loops (untick to open)", expand_by_default=len(closures) < _FEW
                )
                self._of_scene.append(folder)
                with folder:
                    for name in closures:
                        box = gui.add_checkbox(name, initial_value=True)
                        self._when(box, partial(SwitchClosure, name))
                        self._closures[name] = box
        if Open in self._backend.takes:
            with self._next_start:
                self._of_scene += self._make_hands(prefixes.values())
        with self._tune:
            gains = gui.add_folder("gains", expand_by_default=False)
        with gains:
            for user, prefix in prefixes.items():
                for one in gain_sliders(scene.held_at(user)):
                    label = f"{prefix}{one.label}"
                    slider = gui.add_slider(label, 0.0, one.highest, one.step, one.value)
                    self._when(slider, partial(Tune, user, one.key))
        with self._look:
            plots = gui.add_folder("plots", expand_by_default=False)
        with plots:
            self._make_plots()
        self._of_scene += [gains, plots]

    def explain(self, seen: Collection[str], cell: str, hues: Mapping[str, Colour]) -> None:
        """Show the legend of a scene; see :func:`legend_html`."""
        self._legend.content = legend_html(seen, cell, hues)

    def _when(self, handle: Any, command: Callable[[Any], Command | None]) -> None:
        """Send a command when a user changes a control; changes by the program send none."""

        async def changed(event: Any) -> None:
            if event.client is not None:
                self.said = ""
                wanted = command(event.target.value)
                if wanted is not None:
                    self._backend.send(wanted)

        handle.on_update(changed)

    def _pressed(self, button: Any, command: Callable[[], Command | None]) -> None:
        async def pressed(_event: Any) -> None:
            self.said = ""
            wanted = command()
            if wanted is not None:
                self._backend.send(wanted)

        button.on_click(pressed)

    def _make(self, scenes: Sequence[str], save: Callable[[Any], None]) -> None:
        gui, takes = self._gui, self._backend.takes
        gui.add_html(QUICK_TIMERS)
        self._hint = gui.add_html("", order=-2.0)
        self._numbers = gui.add_html("")
        with gui.add_folder("legend and help", expand_by_default=False):
            self._legend = gui.add_html("")
        self._feel = gui.add_folder("feel")
        self._look = gui.add_folder("look", expand_by_default=False)
        self._tune = gui.add_folder("tune", expand_by_default=False)
        with self._feel:
            if Open in takes:
                self._make_scene_picker(scenes)
            if Pause in takes:
                paused = gui.add_checkbox("pause", initial_value=False)
                self._shown.append((paused, lambda state: state.paused))
                self._when(paused, Pause)
                self._one_period = gui.add_button("step one period")
                self._pressed(self._one_period, Step)
                self._pressed(gui.add_button("reset"), Reset)
        with self._look:
            self._make_look(save)
        with self._tune:
            if DragStiffness in takes:
                label = "stiffness of the mouse's pull (1: default)"
                spring = gui.add_slider(label, SOFTEST, STIFFEST, 0.1, 1.0)
                self._when(spring, DragStiffness)
            if Open in takes:
                self._next_start = gui.add_folder("restart with", expand_by_default=False)
                with self._next_start:
                    label = "delay each way, ms"
                    self._delay = gui.add_slider(label, 0.0, LONGEST_DELAY_MS, 1.0, 0.0)
                    anew = gui.add_button("restart")
                    self._pressed(anew, lambda: self._opening(self._scene.value))
            if Record in takes:
                recording = gui.add_checkbox("record a bag (rosbag2)", initial_value=False)
                self._shown.append((recording, lambda state: bool(state.recording)))
                self._when(recording, self._recorded)

    def _make_look(self, save: Callable[[Any], None]) -> None:
        gui = self._gui
        with gui.add_folder("show", expand_by_default=False):
            boxes = {
                name: gui.add_checkbox(name, initial_value=name not in HIDDEN) for name in LAYERS
            }
            self._with_plots = gui.add_checkbox("plots", initial_value=True)

        async def layered(_event: Any) -> None:
            self.hidden = frozenset(name for name, box in boxes.items() if not box.value)

        for box in boxes.values():
            box.on_update(layered)
        gui.add_button("save a picture").on_click(save)

    def _make_scene_picker(self, scenes: Sequence[str]) -> None:
        names = list(dict.fromkeys((self._first, *scenes)))
        self._scene = self._gui.add_dropdown("scene", names, initial_value=self._first)
        # A client could send any name, and so have any file read.
        self._when(self._scene, lambda name: self._opening(name) if name in names else None)

    def _make_plots(self) -> None:
        self._plots = []
        for one in self._history.plots():
            lines = (
                viser.uplot.Series(label=name, stroke=_STROKES[i % len(_STROKES)], width=2)
                for i, name in enumerate(one.names)
            )
            least, most = ({"pad": 0.1, "soft": soft, "mode": 1} for soft in (0.0, one.top))
            plot = self._gui.add_uplot(
                one.columns(),
                (viser.uplot.Series(label="time, s"), *lines),
                title=one.title,
                scales={
                    "x": viser.uplot.Scale(time=False, auto=True),
                    "y": viser.uplot.Scale(range={"min": least, "max": most}),
                },
                axes=tuple(
                    viser.uplot.Axis(label=label, labelSize=_LABEL_PX, size=size, incrs=_STEPS)
                    for label, size in zip(("time, s", one.unit), _NUMBERS_PX, strict=True)
                ),
                aspect=1.6,
                padding=_PADDING_PX,
            )
            self._plots.append((plot, one.columns))

    def _make_hands(self, prefixes: Iterable[str]) -> list[Any]:
        """Make the choices of each device's hand for the next start."""
        chosen = [box.value for box in self._hands]
        self._hands = [
            self._gui.add_dropdown(f"{prefix}{HELD_BY}", list(HANDS), initial_value=one, order=0.0)
            for prefix, one in zip(prefixes, chain(chosen, repeat(MOUSE_ALONE)))  # noqa: B905
        ]
        return self._hands

    def _opening(self, name: str) -> Open | None:
        """Return the command that opens the chosen scene; None, with ``said``, if refused."""
        try:
            scene = load_scene(name)
        except HapticMechError as error:
            self.said = str(error)
            return None
        held_by = [box.value for box in self._hands] or [MOUSE_ALONE]
        # Changes given at the start are for its scene alone.
        given = self._given if name == self._first else ()
        return Open(name, (*changes_of(scene, held_by, self._delay.value), *given))

    def _recorded(self, wanted: bool) -> Record:
        name = f"live_{time.strftime('%Y%m%d_%H%M%S')}" if wanted else ""
        return Record(name)
