# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands of ``hapticmech``, run in this process; programs of Python, each in one of its own."""

import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from hapticmech_ros.cli import app


def ran(*words: object, code: int = 0) -> str:
    """Run a command, which ends with a code; return what it prints."""
    found = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert found.exit_code == code, found.output
    return found.stdout


def printed_by(*words: object, cwd: Path | None = None, timeout: float = 120.0) -> str:
    """Run Python with words, to its end and without an error; return what it prints."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
