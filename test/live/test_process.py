# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The session's process: it answers, it ends, and it lets go when nothing is heard."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import (
    Drag,
    Draggable,
    Failed,
    LiveState,
    Open,
    Opened,
    Tune,
    newest,
)
from hapticmech_ros.live.process import LiveProcess
from hapticmech_ros.live.settings import changes_of
from hapticmech_ros.loading import load_scene

ASKED = Open("five_bar", changes_of(load_scene("five_bar")))
HAND = Draggable("hand", "handle")
PATIENCE_S = 60.0


def wait_for(process, wanted):
    """Return the first report for which ``wanted`` is true."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        for report in process.news(0.1):
            if wanted(report):
                return report
    raise AssertionError("nothing of the kind was told")


def is_state(report):
    return isinstance(report, LiveState)


@pytest.fixture(scope="module")
def process():
    with LiveProcess(ASKED) as found:
        yield found


def test_it_tells_the_scene_and_then_states(process):
    opened = wait_for(process, lambda report: isinstance(report, Opened))
    assert (opened.asked, opened.scene.name) == (ASKED, "five_bar")
    first = wait_for(process, is_state)
    later = wait_for(process, is_state)
    assert later.time > first.time
    assert (later.number, later.q.shape) == (opened.number, (4,))


def test_a_drag_of_which_nothing_more_is_heard_ends(process):
    place = wait_for(process, is_state).users[0].device[:, 3]
    drag = Drag(HAND, np.zeros(3), place + np.array((0.02, 0.0, 0.0)))
    process.send(drag)
    wait_for(process, lambda report: is_state(report) and report.drags)
    free = wait_for(process, lambda report: is_state(report) and not report.drags)
    assert (free.users[0].hand_wrench == 0.0).all()


def test_what_is_refused_is_told(process):
    process.send(Tune("handle", "device.mass", 1.0))
    failed = wait_for(process, lambda report: isinstance(report, Failed))
    assert "must begin with controller" in failed.reason


def test_a_scene_that_is_refused_is_an_error_of_the_caller():
    with pytest.raises(HapticMechError, match="nor a shipped scene"):
        LiveProcess(Open("nobody"))


def test_news_of_a_process_that_has_ended_are_an_error():
    process = LiveProcess(ASKED)
    process.close()
    process.send(Tune("handle", "controller.gain_ramp", 1.0))
    # What was told before: all of it at once.
    assert process.news(1.0)
    with pytest.raises(HapticMechError, match="has ended"):
        process.news(1.0)


PROGRAM = """
import os
from hapticmech_ros.live.commands import Open
from hapticmech_ros.live.process import LiveProcess

if __name__ == "__main__":
    process = LiveProcess(Open("two_link"))
    os.kill(os.getpid(), 9)
"""


def test_it_ends_with_a_parent_that_is_killed(tmp_path):
    """It has inherited the pipe of the output, which is read until the last one has closed it."""
    script = tmp_path / "parent.py"
    script.write_text(PROGRAM, encoding="utf-8")
    run = subprocess.run(
        [sys.executable, script], stdout=subprocess.PIPE, timeout=PATIENCE_S, check=False
    )
    assert run.returncode == -9


def test_of_states_only_the_newest_is_kept_and_of_others_all():
    def state(time_s):
        return LiveState(1, time_s, False, 1.0, np.zeros(0), (), ())

    one, two, three = Failed("a"), Failed("b"), Failed("c")
    old, new = state(0.1), state(0.2)
    assert newest([one, old, two, new, three]) == [one, two, new, three]
    assert newest([one]) == [one]
    assert newest([]) == []
