# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that waits for a loop to stand still. It needs neither Python nor its lock."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import c_function, kernel

# Numbers shared with the loop: how often it went round, and whether it has ended.
ROUNDS, ENDED = 0, 1
LOOK_US = 250_000
_STANDARD_ERROR = 2
# struct pollfd: standard error, whether it takes what is written (POLLOUT), and the answer.
_POLLED, _TAKES = 2 | 4 << 32, 4 << 48
_STATUS = 134

_usleep = c_function("usleep", "int32(uint32)")
_write = c_function("write", "int64(int32, intp, int64)")
_poll = c_function("poll", "int32(intp, uint64, int32)")
_abort = c_function("abort", "void()")
_exit = c_function("_exit", "void(int32)")


@kernel("void(int64[:], int64[:], int64[:], int64)", waits=True)
def abort_when_still(shared: Array, text: Array, polled: Array, looks: int) -> None:
    """Abort the process when its loop has not gone round for so many looks.

    Looks are counted, not time: while the whole process is stopped there are none. Where standard
    error takes nothing, a terminal that is held for instance, the process ends without a word.

    Args:
        shared: (2,), [:data:`ROUNDS`, :data:`ENDED`]; the loop writes them.
        text: (n,), what is written to standard error, eight bytes a number.
        polled: (1,), a struct pollfd to work with.
        looks: how many, :data:`LOOK_US` apart.
    """
    still, last = 0, shared[ROUNDS]
    while shared[ENDED] == 0:
        _usleep(LOOK_US)
        if shared[ROUNDS] != last:
            still, last = 0, shared[ROUNDS]
            continue
        still += 1
        if still >= looks and shared[ENDED] == 0:
            polled[0] = _POLLED
            if _poll(polled.ctypes.data, 1, 0) != 1 or polled[0] & _TAKES == 0:
                _exit(_STATUS)
            _write(_STANDARD_ERROR, text.ctypes.data, 8 * text.size)
            # It may have gone on while that waited.
            if shared[ROUNDS] == last:
                _abort()
