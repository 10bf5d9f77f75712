# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names as scenes have them: letters, digits, underscores, no two alike."""

from __future__ import annotations

import re
from collections import Counter

from hapticmech_ros.formats.model import WORLD


class Names:
    """Names that are taken."""

    def __init__(self) -> None:
        self._taken = {WORLD}
        self._tried: Counter[str] = Counter()

    def new(self, name: str) -> str:
        """Return the name, or the nearest that is allowed and not taken."""
        cleaned = found = clean(name)
        while found in self._taken:
            self._tried[cleaned] += 1
            found = f"{cleaned}_{self._tried[cleaned] + 1}"
        self._taken.add(found)
        return found


def clean(name: str) -> str:
    """Return a name of letters, digits and underscores that begins with a letter."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return found if re.match(r"[A-Za-z]", found) else f"n{found}"
