# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A picture or a film as a file: shapes in parallel projection, the nearer ones last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from scipy.spatial import ConvexHull, QhullError

from hapticmech_ros.numerics import Array
from hapticmech_ros.view.palette import AXES, FELT, LEGEND, MEANING, Colour
from hapticmech_ros.view.shapes import Shape, rotation_to

SIDE_INCHES, SIDE_PIXELS = 7.0, 1050
# Views: planar scenes from above, in the world's plane; others from the side.
ABOVE = np.array((0.0, 0.0, 1.0))
ASIDE = np.array((1.0, -1.6, 0.9))
MARGIN = 0.08
CORNERS = 48
LETTERS_PT, SMALL_PT, LINE_PT = 11.0, 9.5, 1.5
# As shares of the side: lower left corner and side of the square in which shapes are, left end and
# height of the scale bar, its greatest length, and origin and length of the world's axes.
SQUARE = (0.065, 0.115, 0.87)
BAR_AT, LONGEST_BAR = (0.05, 0.105), 0.25
AXES_AT, AXES_LENGTH = (0.88, 0.87), 0.06
LEGEND_COLUMNS = 5


def view_from(towards: Array) -> Array:
    """Return (3, 3) rows right, up and towards the viewer, who is in that direction (3,).

    Args:
        towards: (3,) direction, world axes.
    """
    near = towards / np.linalg.norm(towards)
    up = ABOVE if abs(near[2]) < 0.99 else np.array((0.0, 1.0, 0.0))
    right = np.cross(up, near)
    right /= np.linalg.norm(right)
    return np.array((right, np.cross(near, right), near))


def draw_shapes(
    shapes: Sequence[Shape],
    path: Path,
    planar: bool,
    title: str = "",
    side_pixels: int = SIDE_PIXELS,
    users: Mapping[str, Colour] = MappingProxyType({}),
) -> None:
    """Write a picture of shapes as a PNG file, with a scale bar, the world's axes and a legend.

    Args:
        shapes: to draw.
        path: of the file.
        planar: whether it is seen from above, else from aside.
        title: above it.
        side_pixels: width and height.
        users: hue of each, where there are several; the legend has these, and no shades of them.
    """
    view = view_from(ABOVE if planar else ASIDE)
    figure = _figure(side_pixels)
    parts, meanings = _parts(shapes, view), {shape.meaning for shape in shapes}
    _compose(figure, view, parts, np.vstack([part[0] for part in parts]), meanings, users)
    _title(figure, title, shapes)
    figure.savefig(path)


def draw_film(
    pictures: Sequence[tuple[str, Sequence[Shape]]],
    path: Path,
    planar: bool,
    rate: int,
    side_pixels: int = SIDE_PIXELS,
    users: Mapping[str, Colour] = MappingProxyType({}),
    progress: Callable[[int, int], None] = lambda done, every: None,
) -> None:
    """Write pictures one after the other, all seen from the same place, as a GIF or WebP file.

    Args:
        pictures: title and shapes of each.
        path: of the file.
        planar: as of :func:`draw_shapes`.
        rate: pictures a second.
        side_pixels: likewise.
        users: likewise.
        progress: called with the pictures drawn, and all, after each.
    """
    view = view_from(ABOVE if planar else ASIDE)
    figure = _figure(side_pixels)
    parts = [_parts(shapes, view) for _, shapes in pictures]
    # Corners of what is seen in any of them.
    places = np.vstack([part[0] for picture in parts for part in picture])
    seen = np.vstack((places.min(axis=0), places.max(axis=0)))
    meanings = {shape.meaning for _, shapes in pictures for shape in shapes}
    writer = PillowWriter(fps=rate)
    with writer.saving(figure, str(path), figure.dpi):
        for done, ((title, shapes), picture) in enumerate(zip(pictures, parts, strict=True), 1):
            figure.clear()
            _compose(figure, view, picture, seen, meanings, users)
            _title(figure, title, shapes)
            writer.grab_frame()
            progress(done, len(pictures))


def _figure(side_pixels: int) -> Figure:
    figure = Figure(figsize=(SIDE_INCHES, SIDE_INCHES), dpi=side_pixels / SIDE_INCHES)
    FigureCanvasAgg(figure)
    return figure


def _parts(shapes: Sequence[Shape], view: Array) -> list[tuple[Array, Colour]]:
    """Return points (k, 3) as they are seen, whose hulls are drawn, and colours; the far first."""
    found = [
        (outline @ view.T, shape.colour)
        for shape in shapes
        if shape.kind != "text"
        for outline in _outlines(shape, view)
    ]
    # In a plane all are as near but for rounding, and keep their order.
    return sorted(found, key=lambda part: round(float(part[0][:, 2].mean()), 9))


def _compose(
    figure: Figure,
    view: Array,
    parts: Sequence[tuple[Array, Colour]],
    seen: Array,
    meanings: set[str],
    users: Mapping[str, Colour],
) -> None:
    """Draw parts where points (n, 3) are seen, with the scale bar, the axes and a legend."""
    axes = figure.add_axes((*SQUARE, SQUARE[2]))
    axes.set_aspect("equal")
    axes.set_axis_off()
    for outline, colour in parts:
        _fill(axes, outline[:, :2], colour)
    _bar(figure, _frame(axes, seen))
    _world(figure, view)
    _legend(figure, meanings, users)


def _title(figure: Figure, title: str, shapes: Sequence[Shape]) -> None:
    words = [shape.text for shape in shapes if shape.kind == "text"]
    figure.text(0.02, 0.97, "  ·  ".join([title, *words]), fontsize=LETTERS_PT, va="top")


def _outlines(shape: Shape, view: Array) -> list[Array]:
    """Return (k, 3) points of the world whose hull is drawn, one array for each part."""
    if shape.kind == "sphere":  # or an ellipsoid: its rim, as it is seen
        turn = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
        normals = np.column_stack((np.cos(turn), np.sin(turn))) @ view[:2]
        axes = 0.5 * shape.pose.rotation * np.array(shape.size)
        support = normals @ axes
        rim = support @ axes.T / np.linalg.norm(support, axis=1, keepdims=True)
        return [shape.pose.translation + rim]
    if shape.kind == "box":
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = 0.5 * signs * np.array(shape.size)
        return [shape.pose.translation + corners @ shape.pose.rotation.T]
    if shape.kind == "cylinder":
        half = 0.5 * shape.size[2] * shape.pose.rotation[:, 2]
        centre, (first, last, _) = shape.pose.translation, shape.size
        return [_tube(centre - half, centre + half, first, last)]
    if shape.kind == "triangles":  # of a convex hull
        return [shape.points]
    if shape.kind == "strip":
        ends = zip(shape.points[:-1], shape.points[1:], strict=True)
        return [_tube(start, end, shape.size[0], shape.size[0]) for start, end in ends]
    tail, tip = shape.points
    along = (tip - tail) / np.linalg.norm(tip - tail)
    neck = tip - shape.size[2] * along
    return [_tube(tail, neck, shape.size[0], shape.size[0]), _tube(neck, tip, shape.size[1], 0.0)]


def _tube(start: Array, end: Array, first: float, last: float) -> Array:
    """Return points on the rims, of these diameters, of a round body from start to end."""
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    rim = np.column_stack((np.cos(turn), np.sin(turn))) @ rotation_to(end - start)[:, :2].T
    return np.vstack((start + 0.5 * first * rim, end + 0.5 * last * rim))


def _fill(axes: Axes, points: Array, colour: Colour) -> None:
    """Fill the hull of points (k, 2)."""
    edge = (*(0.7 * part for part in colour[:3]), colour[3])
    try:
        hull = points[ConvexHull(points).vertices]
    except QhullError:  # all on one line
        axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=1.0)
        return
    axes.add_patch(Polygon(hull, closed=True, facecolor=colour, edgecolor=edge, linewidth=0.5))


def _frame(axes: Axes, points: Array) -> float:
    """Put points in the middle of axes; return the length of their side, m."""
    low, high = points.min(axis=0)[:2], points.max(axis=0)[:2]
    half = (0.5 + MARGIN) * max(float((high - low).max()), 1e-6)
    centre = 0.5 * (low + high)
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    return 2.0 * half


def scale_of(longest: float) -> tuple[float, str]:
    """Return the length of a scale bar, 1, 2 or 5 times a power of ten, and its label.

    Args:
        longest: m, which it may have.
    """
    power = 10.0 ** np.floor(np.log10(longest))
    length = float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest))
    return length, f"{length:g} m" if length >= 1.0 else f"{1e3 * length:g} mm"


def _bar(figure: Figure, shown: float) -> None:
    """Draw a scale bar; ``shown`` (m) is the length of the square's side."""
    share = SQUARE[2] / shown
    length, words = scale_of(LONGEST_BAR / share)
    (left, height), right = BAR_AT, BAR_AT[0] + share * length
    _line(figure, (left, height), (right, height), "black")
    for end in (left, right):
        _line(figure, (end, height - 0.006), (end, height + 0.006), "black")
    figure.text(right + 0.01, height, words, fontsize=SMALL_PT, va="center")


def _world(figure: Figure, view: Array) -> None:
    """Draw the world's axes as they are seen; none of one that points at the viewer."""
    origin = np.array(AXES_AT)
    for name, colour, seen in zip("xyz", AXES, view[:2].T, strict=True):
        if np.linalg.norm(seen) > 1e-6:
            tip, letter = (origin + share * AXES_LENGTH * seen for share in (1.0, 1.3))
            _line(figure, origin, tip, colour)
            figure.text(letter[0], letter[1], name, fontsize=SMALL_PT, ha="center", va="center")


def _line(
    figure: Figure, start: Sequence[float] | Array, end: Sequence[float] | Array, colour: Any
) -> None:
    """Draw a line between two places (2,), as shares of the figure's side."""
    x, y = zip(start, end, strict=True)
    line = Line2D(x, y, color=colour, linewidth=LINE_PT, transform=figure.transFigure)
    figure.add_artist(line)


def _legend(figure: Figure, meanings: set[str], users: Mapping[str, Colour]) -> None:
    """Name the colours of the shapes drawn."""
    named = {LEGEND[m]: MEANING[m] for m in LEGEND if m in meanings and not (users and m in FELT)}
    named |= {f"user {name}": hue for name, hue in users.items()}
    found = [Patch(color=colour, label=label) for label, colour in named.items()]
    if found:
        figure.legend(
            handles=found,
            loc="lower left",
            ncols=LEGEND_COLUMNS,
            fontsize=SMALL_PT,
            frameon=False,
            handlelength=1.2,
            columnspacing=1.4,
        )
