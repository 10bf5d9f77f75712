# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers that do to their process what a damaged text could."""

import os
import signal

from hapticmech_ros.errors import FileError


def parser(item):
    match item:
        case "pid":
            return os.getpid()
        case "segment":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "memory":
            return len(bytearray(1_000_000_000))
        case "refuse":
            raise FileError("a.yaml", ["x", 1], "must be a number", "line 3")
    return item
