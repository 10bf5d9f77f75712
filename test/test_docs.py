"""What the documents say is what the code does."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from hapticmech_ros.wire.table import markdown

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_table_of_topics_is_the_codes() -> None:
    assert markdown() in (ROOT / "docs" / "topics.md").read_text(encoding="utf-8")


def test_the_readme_program_runs(tmp_path: Path) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    script = tmp_path / "program.py"
    script.write_text(program, encoding="utf-8")
    run = subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "rank: 2" in run.stdout
    assert "3.0 s: 2 constraint(s)" in run.stdout


def test_every_command_of_the_environment_that_the_readme_names_exists() -> None:
    words = {word for block in _shell_blocks() for word in shlex.split(block.replace("<", " "))}
    commands = {Path(word).name for word in words if word.startswith(".venv/bin/")}
    assert {"hapticmech", "haptic_device", "python"} <= commands
    missing = [name for name in commands if not (Path(sys.prefix) / "bin" / name).exists()]
    assert not missing


@pytest.mark.parametrize("command", ["demo", "experiment", "run", "topics"])
def test_subcommands_explain_themselves(command: str) -> None:
    run = subprocess.run(
        [Path(sys.prefix) / "bin" / "hapticmech", command, "--help"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 0
    assert "Usage" in run.stdout


def test_links_in_the_documents_lead_somewhere() -> None:
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


def _shell_blocks() -> list[str]:
    return re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
