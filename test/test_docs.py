# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the documents say is what the code does."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from commands import printed_by, ran
from hapticmech_ros import Session, load_scene
from hapticmech_ros.nodes.parameter_table import markdown as parameter_table
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.scene import document_of
from hapticmech_ros.session.sample import run_layout
from hapticmech_ros.wire.table import markdown

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def _commands() -> list[str]:
    """Return the command lines of all documents, continued lines joined."""
    lines = []
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = document.read_text(encoding="utf-8")
        for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL):
            joined = block.replace("\\\n", " ")
            lines += [line.strip() for line in joined.splitlines() if line.strip()]
    return [line for line in lines if not line.startswith(("#", "|"))]


OURS = [line for line in _commands() if Path(line.split()[0]).name == "hapticmech"]
BENCHMARKS = [line for line in _commands() if line.startswith("python -m benchmarks ")]


def test_the_first_page_is_short() -> None:
    assert len(README.split()) <= 1200


def test_the_table_of_topics_is_the_codes() -> None:
    assert markdown() in (ROOT / "docs" / "topics.md").read_text(encoding="utf-8")


def test_the_table_of_parameters_is_the_codes() -> None:
    assert parameter_table() in (ROOT / "docs" / "nodes.md").read_text(encoding="utf-8")


def output_of(program: str, place: Path) -> str:
    """Return what a program prints that ends without an error."""
    script = place / "program.py"
    script.write_text(program, encoding="utf-8")
    return printed_by(script, cwd=place, timeout=60.0)


def test_the_readme_program_runs(tmp_path: Path) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    printed = output_of(program, tmp_path)
    assert "free directions: 2" in printed
    assert "3.0 s: 2 joint constraints" in printed


def test_the_program_of_the_page_on_devices_runs(tmp_path: Path) -> None:
    """It has a hand of one's own, and a device."""
    page = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    hand, device = output_of(program, tmp_path).splitlines()
    assert float(re.findall(r"hand: (.*) mm", hand)[0]) > 1.0
    assert device == "device: 4.0 mm"


def test_programs_of_sessions_run_and_name_fields_that_there_are(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "sessions.md").read_text(encoding="utf-8")
    one, long = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(output_of(one, tmp_path).splitlines()) >= 2
    assert output_of(long, tmp_path).split()[-1] == "9.999"
    width = Session(load_scene("two_link")).layout.size
    assert (tmp_path / "run.f64").stat().st_size == 5000 * 8 * width
    rows = re.findall(r"^\| (`.*?`) \|", text, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named | set(OperationalModelSample.layout) == set(run_layout(2, 2))


# Those of README, devices and sessions are checked above; of bags and wrenches, CONTRIBUTING.md and
# test/ros/test_documented_commands.py tell.
APART = {"devices.md", "sessions.md", "bags.md", "wrenches.md"}
PROGRAMS = [
    pytest.param(program, id=f"{page.stem}-{number}")
    for page in sorted((ROOT / "docs").glob("*.md"))
    if page.name not in APART
    for number, program in enumerate(
        re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    )
]


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_other_programs_run_and_print_something(program: str, tmp_path: Path) -> None:
    assert output_of(program, tmp_path).strip()


PARTS_OF_SCENES = [
    pytest.param(part, id=f"{page.stem}-{number}")
    for page in sorted((ROOT / "docs").glob("*.md"))
    if page.name != "devices.md"  # test_device_docs checks those
    for number, part in enumerate(
        re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    )
    if not part.startswith(("#", "joint:"))  # a comment for editors; a joint by itself
]


@pytest.mark.parametrize("part", PARTS_OF_SCENES)
def test_parts_of_scenes_in_the_documents_are_valid(part: str, tmp_path: Path) -> None:
    said = YAML(typ="safe", pure=True).load(part)
    whole = said if "format" in said else {**document_of(load_scene("five_bar")), **said}
    shutil.copy(ROOT / "examples" / "pantograph.urdf", tmp_path)
    with (tmp_path / "scene.yaml").open("w") as stream:
        YAML(typ="safe", pure=True).dump(whole, stream)
    scene = load_scene(tmp_path / "scene.yaml")
    assert set(said) - {"format", "model", "linkage"} <= scene.model_fields_set


def test_every_command_that_the_readme_names_exists() -> None:
    firsts = {Path(line.split()[0]).name for line in _commands()}
    # The shell's and the system's; a ROS installation's; what installs the package elsewhere.
    others = {"make", "git", "cd", "mkdir", "source", "export", "python3", "sudo"}
    others |= {"ros2", "rviz2", "rosdep", "colcon", "pip", "docker", "pixi"}
    ours = firsts - others
    assert {"hapticmech", "haptic_device", "python"} <= ours
    missing = [name for name in ours if not (Path(sys.prefix) / "bin" / name).exists()]
    assert not missing


GROUPS = ("demo", "experiment", "run", "topics", "parameters", "bag", "feel", "scene", "device")


@pytest.mark.parametrize("line", [*OURS, *(f"hapticmech {group}" for group in GROUPS)])
def test_every_hapticmech_command_of_the_documents_is_understood(line: str) -> None:
    """Options are read up to --help, which then ends the command."""
    assert "Usage" in ran(*shlex.split(line, comments=True)[1:], "--help")


@pytest.mark.parametrize("line", BENCHMARKS)
def test_every_benchmark_of_the_documents_is_understood(line: str) -> None:
    _, _, _, name, *options = shlex.split(line, comments=True)
    said = CliRunner().invoke(app_of([name]), [name, *options, "--help"])
    assert said.exit_code == 0, said.output
    assert "Usage" in said.output


def test_links_in_the_documents_lead_somewhere() -> None:
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
