# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a ``with`` block closes at its end."""

from __future__ import annotations

from abc import abstractmethod
from contextlib import AbstractContextManager
from typing import TypeVar

Opened = TypeVar("Opened")


class Closing(AbstractContextManager[Opened]):
    """A context that closes itself; its parameter is its own class."""

    @abstractmethod
    def close(self) -> None:
        """Close it."""

    def __exit__(self, *_: object) -> None:
        self.close()
