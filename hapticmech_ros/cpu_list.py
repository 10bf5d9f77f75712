# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of processors as Linux writes them: ``0,2-3``."""

from __future__ import annotations

import re
from collections.abc import Iterable

from hapticmech_ros.errors import InvalidInputError

ANY = "any"
_RULE = "must be numbers and ranges of CPUs, such as 0,2-3, or 'any'"
_PART = re.compile(r"(\d{1,4})(?:-(\d{1,4}))?")


def cpus_of(text: str) -> frozenset[int]:
    """Return the processors that a list names; none for an empty one, and for :data:`ANY`.

    Raises:
        InvalidInputError: no such list.
    """
    found: set[int] = set()
    for part in text.split(",") if text.strip() not in ("", ANY) else ():
        match = _PART.fullmatch(part.strip())
        if match is None:
            raise InvalidInputError("cpu_affinity", text, _RULE)
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise InvalidInputError("cpu_affinity", text, _RULE)
        found.update(range(first, last + 1))
    return frozenset(found)


def listed(cpus: Iterable[int]) -> str:
    """Return processors as a list, neighbours as ranges."""
    runs: list[list[int]] = []
    for cpu in sorted(cpus):
        if runs and cpu == runs[-1][1] + 1:
            runs[-1][1] = cpu
        else:
            runs.append([cpu, cpu])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in runs)
