# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands of ``hapticmech``, run in this process."""

from typer.testing import CliRunner

from hapticmech_ros.cli import app


def ran(*words: object, code: int = 0) -> str:
    """Run a command, which ends with a code; return what it prints."""
    found = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert found.exit_code == code, found.output
    return found.stdout
