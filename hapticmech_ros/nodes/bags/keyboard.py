# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keys pressed in the terminal, one by one and without waiting."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from types import TracebackType
from typing import Any


class Keyboard:
    """Reads single keys while its block lasts; without a terminal there are none."""

    def __init__(self) -> None:
        self._saved: list[Any] | None = None

    @property
    def is_there(self) -> bool:
        """Whether there is a terminal to read from."""
        return self._saved is not None

    def pressed(self) -> str:
        """Return what was pressed since the last time."""
        if self._saved is None or not select.select([sys.stdin], [], [], 0.0)[0]:
            return ""
        return os.read(sys.stdin.fileno(), 64).decode(errors="replace")

    def __enter__(self) -> Keyboard:
        # A job in the background is stopped by the terminal if it changes the terminal.
        if sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp():
            self._saved = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._saved is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._saved)
