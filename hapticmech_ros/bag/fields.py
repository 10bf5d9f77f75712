# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A decoded message as named rows of numbers, whatever its type, and how far two of them differ."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticmech_ros.bag.stamps import flat_fields

Array = NDArray[np.float64]
Row = Array | str


def rows_of(message: Any) -> dict[str, Row]:
    """Return name -> numbers (n,), or text, of every field but the stamp.

    Names are joined by dots, such as ``wrench.force.x``. The data of a flat array have the names of
    its label.
    """
    if type(message).__name__.endswith("Float64MultiArray"):
        found = _labelled(message)
        if found:
            return found
    return dict(_walk(message, ""))


def deviation(a: Row, b: Row) -> Array:
    """Return absolute differences (n,) of two rows.

    Infinite where one is not a number and the other is, and (1,) infinite for rows of different
    length or different texts. NaN equals NaN, infinity equals itself.
    """
    if isinstance(a, str) or isinstance(b, str):
        same = isinstance(a, str) and isinstance(b, str) and a == b
        return np.array([0.0 if same else np.inf])
    if a.shape != b.shape:
        return np.array([np.inf])
    with np.errstate(invalid="ignore"):
        difference = np.abs(a - b)
    difference[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    difference[np.isnan(difference)] = np.inf
    return difference


def _labelled(message: Any) -> dict[str, Row]:
    dimensions = message.layout.dim
    data = np.asarray(message.data, dtype=float)
    if len(dimensions) != 1:
        return {}
    sizes = flat_fields(dimensions[0].label)
    if not sizes or sum(sizes.values()) != data.size:
        return {}
    found: dict[str, Row] = {}
    at = 0
    for name, size in sizes.items():
        if name != "stamp":
            found[name] = data[at : at + size]
        at += size
    return found


def _walk(value: Any, name: str) -> Iterator[tuple[str, Row]]:
    if is_dataclass(value) and not isinstance(value, type):
        for item in fields(value):
            is_stamp = item.name == "stamp" and name in ("", "header")
            # Names of rosbags' own.
            if is_stamp or item.name.startswith("__"):
                continue
            path = f"{name}.{item.name}" if name else item.name
            yield from _walk(getattr(value, item.name), path)
    elif isinstance(value, str):
        yield name, value
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield name, np.array(value, dtype=float).ravel()
    elif isinstance(value, (list, tuple, np.ndarray)):
        # Says so itself if two messages have lists of different lengths.
        yield f"{name}.size", np.array([float(len(value))])
        for index, item in enumerate(value):
            yield from _walk(item, f"{name}[{index}]")
    else:
        yield name, np.array([float(value)])
