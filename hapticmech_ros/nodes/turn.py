# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which of a process's threads may run the Python code of its nodes; see :mod:`.loop`.

The loop's thread may, except while it waits for messages or runs a kernel, which works on the
nodes' data. Another thread may then; for callbacks the kernel is stopped first.
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
# How long a thread sleeps at a time to let others take the turn or Python's lock first, s.
LETS_S = 20e-6
# How long a callback's thread lets the loop's start the kernel again that was stopped for it, s:
# Python's lock changes hands each half millisecond, which would be added to the kernel's pause.
RESUMES_S = 1e-3


class Turn:
    """The turn, which a thread needs to run nodes' Python code; with one thread, it does nothing.

    Attributes:
        kernel_runs: whether a kernel works on the nodes' data.
        bell: file descriptor that can be read when the loop's thread is to stop waiting.
        rope: file descriptor that is written to for that.
        listened: (1,) when the middleware was last listened to, ns of the monotonic clock.
    """

    def __init__(self) -> None:
        self.bell, self.rope = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._turn, self._kernel = threading.RLock(), threading.Lock()
        self._loop, self.kernel_runs = 0, False
        # Threads that wait for the turn: with a lock alone, a busy loop could starve them.
        self._wanting: set[int] = set()
        # How many nested contexts have the turn.
        self._depth = 0
        # Until when callbacks let the loop start the kernel again, s of the monotonic clock.
        self._resumes = 0.0
        self.listened = np.array([FOR_EVER])
        # Views to publish, and what the publishing thread awaits.
        self._views: deque[Callable[[], None]] = deque()
        self._has_views = threading.Semaphore(0)

    def close(self) -> None:
        """Close both files."""
        os.close(self.bell)
        os.close(self.rope)

    def share(self) -> None:
        """Let other threads take turns with the calling one, which is the loop's."""
        self._turn.acquire()
        self._loop = threading.get_ident()
        self.listen()

    def listen(self) -> None:
        """Note that the middleware was listened to now."""
        self.listened[0] = time.monotonic_ns()

    @property
    def is_deaf(self) -> bool:
        """Whether the middleware was not listened to for longer than :data:`DEAF_NS`."""
        return time.monotonic_ns() - int(self.listened[0]) > DEAF_NS

    def end(self) -> None:
        """Stop sharing the turn."""
        self._loop, self.listened[0] = 0, FOR_EVER
        self._turn.release()
        self._has_views.release()

    @property
    def is_shared(self) -> bool:
        """Whether other threads take turns."""
        return self._loop != 0

    @property
    def is_of_loop(self) -> bool:
        """Whether the calling thread is the loop's, or the only one."""
        return self._loop in (0, threading.get_ident())

    def ring(self) -> None:
        """Make the loop's thread stop waiting."""
        with suppress(BlockingIOError):
            os.write(self.rope, b"\0")

    def hear(self) -> None:
        """Clear the request to stop waiting."""
        with suppress(BlockingIOError):
            os.read(self.bell, 1024)

    @contextmanager
    def given(self) -> Iterator[None]:
        """Return a context that frees the turn for other threads while the loop's waits."""
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
        """Return a context that frees the turn for other threads while a kernel runs."""
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
        """Return a context that holds the turn, and in which no kernel runs."""
        if not self.is_shared:
            yield
            return
        self._let_resume()
        self._wanting.add(threading.get_ident())
        with self._turn:
            self._wanting.discard(threading.get_ident())
            if has_stopped := self.kernel_runs:
                self.ring()
                # Wait until it has ended. No other starts: the loop's thread needs the turn for it.
                with self._kernel:
                    pass
            self._depth += 1
            try:
                yield
            finally:
                self._depth -= 1
                is_over = self._depth == 0
        if is_over and not self.is_of_loop:
            if has_stopped:
                self._resumes = time.monotonic() + RESUMES_S
            # The loop's thread needs Python's lock, too.
            time.sleep(LETS_S)

    def _let_resume(self) -> None:
        """Let the loop start the kernel again that this thread's last callback was stopped for.

        Before the next callback, not after the last: a service's response does not wait for it.
        """
        if self._depth == 0 and not self.is_of_loop:
            while not self.kernel_runs and time.monotonic() < self._resumes:
                time.sleep(RESUMES_S / 4)

    def view(self, publish: Callable[[], None]) -> bool:
        """Have another thread publish a view, if the turn is shared; return whether it is.

        Args:
            publish: publishes the view of copies, while a kernel may run; dropped if another view
                is still to be published.
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
        """Publish the views that there are, after one that is being published.

        With the turn, since callbacks publish too, but without stopping a kernel: a view is of
        copies. Views that the caller publishes next are newer.
        """
        with self._turn:
            while self._views:
                self._views.popleft()()
