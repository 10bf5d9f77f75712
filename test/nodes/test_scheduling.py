"""Real-time scheduling of a process: all its threads, not its children; and what a refusal says."""

import os
import subprocess
import sys

import pytest

from hapticmech_ros.nodes import scheduling
from hapticmech_ros.nodes.parameters import ControllerParameters, DeviceParameters
from real_time import grants_real_time

ASKING = """
import os, subprocess, sys, threading
from hapticmech_ros.nodes.scheduling import ask_for_real_time, scheduling
waiting = threading.Event()
other = threading.Thread(target=waiting.wait)
other.start()
refusal = ask_for_real_time(7)
policies = [os.sched_getscheduler(int(name)) for name in os.listdir("/proc/self/task")]
threads = {policy & ~os.SCHED_RESET_ON_FORK for policy in policies}
show = "import os; print(os.sched_getscheduler(0))"
child = int(subprocess.run([sys.executable, "-c", show], stdout=subprocess.PIPE).stdout)
waiting.set()
print(repr((refusal, scheduling(), threads, child)))
"""


def test_all_threads_are_in_real_time_and_children_are_not():
    said = subprocess.run(
        [sys.executable, "-c", ASKING], stdout=subprocess.PIPE, text=True, check=True
    ).stdout
    refusal, told, threads, child = eval(said)
    assert child == os.SCHED_OTHER
    if grants_real_time(7):
        assert (refusal, told, threads) == ("", "SCHED_FIFO 7", {os.SCHED_FIFO})
    else:
        assert "real-time priority 7 is not granted" in refusal
        assert (told, threads) == ("SCHED_OTHER", {os.SCHED_OTHER})


STARTING = """
import os, subprocess, sys
from hapticmech_ros.nodes.scheduling import QuickStart, scheduling
starting = QuickStart(sys.argv[1:])
show = "import os; print(os.sched_getscheduler(0))"
child = int(subprocess.run([sys.executable, "-c", show], stdout=subprocess.PIPE).stdout)
quick = scheduling()
starting.end()
print(repr((quick, child, scheduling())))
"""


@pytest.mark.parametrize("argument", ["thread_priority:=20", "device.thread_priority:=0"])
def test_a_start_comes_before_what_is_ordinary_and_after_nodes(argument):
    command = [sys.executable, "-c", STARTING, "-p", argument]
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    wanted = grants_real_time(1) and not argument.endswith("=0")
    quick = "SCHED_FIFO 1" if wanted else "SCHED_OTHER"
    assert eval(said) == (quick, os.SCHED_OTHER, "SCHED_OTHER")


def test_a_start_leaves_alone_what_somebody_has_chosen():
    if not grants_real_time(5):
        pytest.skip("no real-time priority here")
    code = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))" + STARTING
    command = [sys.executable, "-c", code, "-p", "thread_priority:=50"]
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    assert eval(said) == ("SCHED_FIFO 5", os.SCHED_FIFO, "SCHED_FIFO 5")


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (PermissionError(1, "no"), "real-time priority 50 is not granted to this user"),
        (OSError(22, "Invalid argument"), "real-time priority 50 cannot be had here: Invalid arg"),
    ],
)
def test_a_refusal_changes_nothing_and_is_a_sentence(monkeypatch, error, sentence):
    def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    before = scheduling.scheduling()
    assert scheduling.ask_for_real_time(50).startswith(sentence)
    assert scheduling.scheduling() == before


def test_a_process_has_the_priority_of_its_most_urgent_node():
    nodes = [DeviceParameters(thread_priority=20), ControllerParameters(thread_priority=0)]
    assert scheduling.priority_of(nodes, in_sim_time=False) == 20
    assert scheduling.priority_of(nodes, in_sim_time=True) == 0
    assert scheduling.priority_of([DeviceParameters()], in_sim_time=False) == 0
