# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands print lines that fit their terminal, without broken words, at any width."""

import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from commands import ran
from hapticmech_ros.cli import app, run_app
from hapticmech_ros.cli.console import console, errors
from hapticmech_ros.cli.scene_tables import show_steps
from hapticmech_ros.plan.step_accuracy import StepChoice, StepChoices

WIDTHS = 80, 120
# No word is broken at this one.
WIDE = 1000


def below(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield a command and those below it, with their names."""
    yield path, command
    for name, one in getattr(command, "commands", {}).items():
        yield from below(one, f"{path} {name}".strip())


COMMANDS = dict(below(typer.main.get_command(app)))
EXAMPLES = [line for one in COMMANDS.values() for line in (one.epilog or "").splitlines()]
OUTPUTS = [f"{path} --help" for path in COMMANDS]
OUTPUTS += ["scene list", "scene check two_link --seconds 0", "scene plan shared_payload"]
OUTPUTS += ["scene show two_link", "device list", "scene check nothing", "run five_bar --hold none"]
OUTPUTS += ["scene check two_link --set links=3", "run --unknown", "bag info nothing", "--version"]
STEPS = "tables of scene steps"


def shown(command: str, width: int, patch: pytest.MonkeyPatch, capsys: Any) -> str:
    """Return what a command prints on a terminal of a width."""
    patch.setenv("COLUMNS", str(width))
    patch.setattr(sys, "argv", ["hapticmech", *shlex.split(command)])
    patch.setattr("hapticmech_ros.cli.choose_discovery", lambda _: None)
    for one in (console, errors):
        patch.setattr(one, "_width", width)
        patch.setattr(one, "_force_terminal", True)
        patch.setattr(one, "_color_system", None)
    if command == STEPS:
        failed = "the step at 0.1 s has an energy that is off by more than it may be"
        tried = StepChoice("semi_implicit_euler", 32, 2e-6, 1e-4), StepChoice("rk4", 1, 1e-8, 2e-5)
        show_steps(StepChoices(1e-6, 1e-9, (*tried, StepChoice("tsit5", 1, failed=failed))))
    else:
        with pytest.raises(SystemExit):
            run_app(app)
    return "".join(capsys.readouterr())


@pytest.mark.parametrize("command", [*OUTPUTS, STEPS])
def test_lines_fit_and_no_word_is_broken(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    wide = shown(command, WIDE, monkeypatch, capsys)
    assert wide.strip()
    assert "Traceback" not in wide
    for width in WIDTHS:
        text = shown(command, width, monkeypatch, capsys)
        assert max(map(len, text.splitlines())) <= width
        assert not {
            word for word in set(text.split()) - set(wide.split()) if set(word) - set("─╭╮╰╯│")
        }


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_of_the_help_are_commands(example: str) -> None:
    """Options are read up to --help, which then ends the command."""
    assert "Usage" in ran(*shlex.split(example)[1:], "--help")


def test_every_command_has_an_example() -> None:
    assert [path for path, one in COMMANDS.items() if not one.epilog] == []
