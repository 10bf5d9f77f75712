# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where tests of graphs are, and that no role has a second body.

What may import what is in pyproject.toml, for ``lint-imports``.
"""

import ast
import re
from inspect import cleandoc
from pathlib import Path

import hapticmech_ros

ROOT = Path(__file__).parents[1]
# Parts of what each role does at a tick (Fig. 3), by the only functions that call them: a body, or
# the body's callers in a session, in a node's compiled loop, and in Python.
CALLERS = {
    # Analyser.
    "observe_point": {"observe", "answer_states", "_observe", "feel_state"},
    "count_rigid": {"receive_sample", "answer_states", "update"},
    # Controller.
    "account_for_motion": {"control_sample"},
    "account_for_hand": {"control_sample"},
    "give_answer": {"control_sample"},
    "conclude": {"control_sample"},
    "passive_wrench": {"control_sample"},
    "queue_wrench": {"command_mechanism"},
    "remember_commanded": {"command_mechanism"},
    "control_sample": {"render", "answer_samples", "_control_sample"},
    "command_mechanism": {"render", "answer_samples", "_control_sample"},
    # Device.
    "account_for_actuators": {"allow_command"},
    "take_energy": {"allow_command"},
    "enforce": {"allow_command"},
    "stay_within": {"allow_command"},
    "correct": {"act", "drive_at_deadlines", "corrected", "_standing_command"},
    "lead": {"correct"},
    "allow_command": {"act", "drive_at_deadlines", "allow"},
    "command_device": {"move_hand", "drive_at_deadlines", "step"},
    "move_device": {"move_hand", "drive_at_deadlines", "step"},
    # Mechanism.
    "move_mechanism": {"run_ticks", "move_at_deadlines"},
    "advance_period": {"move_mechanism", "_call"},
}


def test_graphs_of_nodes_are_tested_in_the_folders_that_make_collects_them_from():
    folder = Path(__file__).parent
    marked = {
        path.relative_to(folder).parts[0]
        for path in folder.rglob("*.py")
        if re.search(r"pytest\.mark\.(ros|alone)\b", path.read_text(encoding="utf-8"))
    }
    makefile = (folder.parent / "Makefile").read_text(encoding="utf-8")
    named = re.search(r"^GRAPHS := (.*)$", makefile, re.MULTILINE)
    assert marked == {Path(name).name for name in named.group(1).split()}
    assert len(re.findall(r"pytest \$\(GRAPHS\) -m '?(?:ros and not )?alone", makefile)) == 2


def test_the_map_of_the_parts_is_the_same_wherever_it_is_shown():
    about = cleandoc(hapticmech_ros.__doc__ or "")
    parts = re.findall(r"^    (.*)$", about, re.MULTILINE)
    assert len(parts) == 10
    for page in ("CONTRIBUTING.md", "docs/index.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert "\n".join(["```text", *parts, "```"]) in text
        assert about.split("\n\n")[-1] in text
    for part in parts:
        assert (ROOT / "hapticmech_ros" / part.split()[0]).is_dir()


def test_no_role_has_a_second_body():
    """A function that calls parts of a body by itself would be one."""
    found = {part: set() for part in CALLERS}
    for path in (ROOT / "hapticmech_ros").rglob("*.py"):
        for function in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(function, ast.FunctionDef):
                for call in ast.walk(function):
                    name = getattr(call, "func", None)
                    part = getattr(name, "id", getattr(name, "attr", None))
                    if part in found:
                        found[part].add(function.name)
    assert found == CALLERS
