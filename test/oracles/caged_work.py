# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a child is told to do: little, and what breaks each of its limits."""

import os
import signal
import sys
from pathlib import Path


def work(item):
    match item:
        case "echo":
            return {"pid": os.getpid(), "text": "größer"}
        case "memory":
            return len(bytearray(400_000_000))
        case "segment":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "turn":
            while True:
                pass
        case "wait":
            signal.pause()
        case "output":
            return "x" * 20_000
        case "error":
            raise ValueError("two\nlines")
        case "exit":
            os._exit(0)
        case "file":
            Path("large").write_bytes(b"x" * 20_000)
        case "print":
            print("x" * 100_000)
            sys.stderr.write("x" * 100_000)
    return item
