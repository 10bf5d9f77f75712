# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which of a process's threads may run the Python of its nodes; see :mod:`.loop`.

The loop's thread may, but while it waits: for messages, or in a kernel, which works on what the
nodes have. Another one that wants to then does; for callbacks the kernel is stopped first.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from hapticmech_ros.nodes.lane_kernels import DEAF_NS

FOR_EVER = 1 << 62
# For how long the loop lets those who wait for their turn go first, at a time, s.
LETS_S = 20e-6


class Turn:
    """Whose turn it is. As long as there is one thread only, all of this does nothing.

    Attributes:
        kernel_runs: whether a kernel works on what the nodes have.
        bell: file that can be read when the loop's thread is to stop waiting.
        rope: file by which it is rung.
        listened: (1,) until when the middleware was last listened to, ns of the monotonic clock.
    """

    def __init__(self) -> None:
        self.bell, self.rope = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._turn, self._kernel = threading.RLock(), threading.Lock()
        self._loop, self.kernel_runs = 0, False
        # Threads that wait for their turn: a lock alone lets a busy loop have it again and again.
        self._wanting: set[int] = set()
        # Of contexts that have the turn, one within another.
        self._depth = 0
        self.listened = np.array([FOR_EVER])
        # Of what people see: whose it is to publish that, and what there is to be published.
        self._publishing = threading.Lock()
        self._views: deque[Callable[[], None]] = deque()
        self._has_views = threading.Semaphore(0)

    def close(self) -> None:
        """Give back both files."""
        os.close(self.bell)
        os.close(self.rope)

    def share(self) -> None:
        """Let other threads take turns with the one that calls, which is the loop's."""
        self._turn.acquire()
        self._loop = threading.get_ident()
        self.listen()

    def listen(self) -> None:
        """Note that the middleware was listened to until now."""
        self.listened[0] = time.monotonic_ns()

    @property
    def is_deaf(self) -> bool:
        """Whether nobody has listened to it for longer than :data:`DEAF_NS`."""
        return time.monotonic_ns() - int(self.listened[0]) > DEAF_NS

    def end(self) -> None:
        """Share no more."""
        self._loop, self.listened[0] = 0, FOR_EVER
        self._turn.release()
        self._has_views.release()

    @property
    def is_shared(self) -> bool:
        """Whether there are other threads."""
        return self._loop != 0

    @property
    def is_of_loop(self) -> bool:
        """Whether the thread that asks is the loop's, or the only one."""
        return self._loop in (0, threading.get_ident())

    def ring(self) -> None:
        """Have the loop's thread stop waiting."""
        with suppress(BlockingIOError):
            os.write(self.rope, b"\0")

    def hear(self) -> None:
        """Note that it has stopped."""
        with suppress(BlockingIOError):
            os.read(self.bell, 1024)

    @contextmanager
    def given(self) -> Iterator[None]:
        """Return a context in which the turn is given away, while the loop's thread waits."""
        if not self.is_shared:
            yield
            return
        self._turn.release()
        try:
            yield
        finally:
            self._take_back()

    def _take_back(self) -> None:
        while self._wanting:
            time.sleep(LETS_S)
        self._turn.acquire()

    @contextmanager
    def given_to_kernel(self) -> Iterator[None]:
        """Return a context in which it is given away while a kernel runs."""
        if not self.is_shared:
            yield
            return
        try:
            with self._kernel:
                self.kernel_runs = True
                self._turn.release()
                try:
                    yield
                finally:
                    self.kernel_runs = False
        finally:
            self._take_back()

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Return a context that has the turn, and in which no kernel runs."""
        if not self.is_shared:
            yield
            return
        self._wanting.add(threading.get_ident())
        with self._turn:
            self._wanting.discard(threading.get_ident())
            if self.kernel_runs:
                self.ring()
                # No other one begins: for that the loop's thread needs the turn.
                with self._kernel:
                    pass
            self._depth += 1
            try:
                yield
            finally:
                self._depth -= 1
                is_over = self._depth == 0
        if is_over and not self.is_of_loop:
            # The loop's thread needs Python's lock as well.
            time.sleep(LETS_S)

    def view(self, publish: Callable[[], None]) -> bool:
        """Have a view published while a kernel goes on; return whether the turn is shared.

        Args:
            publish: publishes it, from copies, without a turn. It is dropped if the one before is
                still to be done.
        """
        if not self.is_shared:
            return False
        if not self._views:
            self._views.append(publish)
            self._has_views.release()
        return True

    def wait_for_view(self) -> bool:
        """Wait until there is a view to publish; return whether the turn is still shared."""
        self._has_views.acquire()
        return self.is_shared

    def publish_views(self) -> None:
        """Publish those that there are, and wait for one that is being published.

        What is published next is newer.
        """
        with self._publishing:
            while self._views:
                self._views.popleft()()
