# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node's process asks of Linux: granted or refused, and told; its children are ordinary."""

import ctypes
import os
import resource
import struct
import subprocess
import sys
from types import SimpleNamespace

import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes import realtime
from hapticmech_ros.nodes.parameters import (
    AnalyserParameters,
    ControllerParameters,
    DeviceParameters,
    MechanismParameters,
    ParameterError,
    ViewerParameters,
    validated,
)
from hapticmech_ros.nodes.realtime import ENOUGH_CPUS, Realtime, Request
from hapticmech_ros.system.cpu_list import cpus_of, listed
from real_time import grants_nice, grants_real_time

ASKING = """
import os, re, subprocess, sys, threading
from pathlib import Path
from hapticmech_ros.nodes.realtime import Realtime, Request
waiting = threading.Event()
other = threading.Thread(target=waiting.wait)
other.start()
first = min(os.sched_getaffinity(0))
asked = Realtime(Request("on", 7, frozenset({first})))
threads = [int(name) for name in os.listdir("/proc/self/task")]
policies = {os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK for thread in threads}
cpus = {frozenset(os.sched_getaffinity(thread)) for thread in threads}
locked = int(re.search(r"VmLck:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
show = "import os; print(os.sched_getscheduler(0))"
child = int(subprocess.run([sys.executable, "-c", show], stdout=subprocess.PIPE).stdout)
waiting.set()
figures = asked.figures()
asked.close()
asked.close()
print(repr((asked.refusals, figures, policies, cpus == {frozenset({first})}, locked, child)))
"""


def output_of(code, *arguments):
    """Return what code prints in a process of its own."""
    run = [sys.executable, "-c", code, *arguments]
    return subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True).stdout


def test_all_threads_are_in_real_time_children_are_not_and_memory_is_locked_or_told():
    refusals, figures, policies, pinned, locked, child = eval(output_of(ASKING))
    assert child == os.SCHED_OTHER
    assert pinned
    assert "," not in figures["cpu_affinity"]
    if grants_real_time(7):
        assert (figures["scheduling"], policies) == ("SCHED_FIFO 7", {os.SCHED_FIFO})
    else:
        assert policies == {os.SCHED_OTHER}
        assert figures["scheduling"].startswith("SCHED_OTHER: real-time priority 7 is not granted")
        assert any("LimitRTPRIO=98" in refusal for refusal in refusals)
    if figures["memory_lock"] == "locked":
        assert locked > 10_000
    else:
        assert locked == 0
        assert figures["memory_lock"] in refusals


ORDINARY = """
import os, resource
resource.setrlimit(resource.RLIMIT_MEMLOCK, (8 << 20, 8 << 20))
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
from hapticmech_ros.nodes.realtime import Realtime, Request, ask_for_share, slice_ns
os.setresuid(65534, 65534, 65534)
print(*Realtime(Request("on", 50)).refusals, ask_for_share(), slice_ns(), sep="\\n")
"""
# Linux has slices of ordinary threads from then on.
HAS_SLICES = tuple(map(int, os.uname().release.split(".")[:2])) >= (6, 12)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs a process that may give up its rights")
def test_an_ordinary_user_gets_the_slice_and_is_told_the_lines_that_allow_the_rest():
    real_time, memory, idle, *_, share, slice_ns = output_of(ORDINARY).splitlines()
    assert real_time.startswith(
        "real-time priority 50 is not granted to this user: '@realtime - rt"
    )
    assert memory.startswith("locked memory is limited to 8192 KiB for this user: '@realtime - me")
    assert idle.startswith("/dev/cpu_dma_latency")
    assert share.startswith("nice -20 is not granted to this user: '@realtime - nice -20'")
    assert not HAS_SLICES or int(slice_ns) == 100_000


@pytest.fixture
def asked(monkeypatch):
    """Notes what is asked for; this process is to stay an ordinary one."""
    found = SimpleNamespace(priorities=[], shares=[], pins=[])
    monkeypatch.setattr(realtime, "ask_for_real_time", lambda p: found.priorities.append(p) or "")
    monkeypatch.setattr(realtime, "ask_for_share", lambda: found.shares.append(True) or "")
    monkeypatch.setattr(realtime, "pin", lambda cpus: found.pins.append(set(cpus)) or "")
    monkeypatch.setattr(realtime, "lock_memory", str)
    return found


@pytest.mark.parametrize(("driver", "most_us"), [("intel_idle", 2), ("haltpoll", 0), ("", 2)])
def test_short_idle_states_are_asked_for_as_long_as_the_process_wants(
    tmp_path, monkeypatch, asked, driver, most_us
):
    place, idle_driver = tmp_path / "cpu_dma_latency", tmp_path / "current_driver"
    place.touch()
    if driver:
        idle_driver.write_text(f"{driver}\n")
    monkeypatch.setattr(realtime, "DMA_LATENCY", place)
    monkeypatch.setattr(realtime, "IDLE_DRIVER", idle_driver)
    process = Realtime(Request("auto", 50))
    assert process.figures()["cpu_dma_latency"] == f"{most_us} us"
    assert struct.unpack("i", place.read_bytes()) == (most_us,)
    process.close()
    place.unlink()
    process = Realtime(Request("auto", 50))
    assert process.figures()["cpu_dma_latency"].endswith("No such file or directory")


@pytest.mark.parametrize("cpus", [ENOUGH_CPUS - 1, ENOUGH_CPUS])
def test_real_time_is_asked_for_by_itself_where_there_are_processors_enough(
    monkeypatch, asked, cpus
):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cpus)))
    figures = Realtime(Request("auto", 50)).figures()
    assert asked.priorities == ([50] if cpus >= ENOUGH_CPUS else [])
    assert asked.shares == ([] if cpus >= ENOUGH_CPUS else [True])
    told = "no SCHED_FIFO with 3 CPUs (from 4 on, or with realtime:=on)"
    assert (told in figures["scheduling"]) == (cpus < ENOUGH_CPUS)
    Realtime(Request("on", 40))
    assert asked.priorities[-1] == 40


SHARING = """
import os, subprocess, sys, threading
from hapticmech_ros.nodes import realtime
waiting = threading.Event()
other = threading.Thread(target=waiting.wait)
other.start()
refusal = realtime.ask_for_share()
threads = [int(name) for name in os.listdir("/proc/self/task")]
nice = {os.getpriority(os.PRIO_PROCESS, thread) for thread in threads}
show = "import os; print(os.getpriority(os.PRIO_PROCESS, 0))"
child = int(subprocess.run([sys.executable, "-c", show], stdout=subprocess.PIPE).stdout)
waiting.set()
print(repr((refusal, realtime.scheduling(), nice, child, realtime.slice_ns())))
"""


def test_all_threads_are_preferred_among_ordinary_ones_and_children_are_not():
    refusal, told, nice, child, slice_ns = eval(output_of(SHARING))
    assert child == 0
    short = ", slice 100 us" if HAS_SLICES else ""
    assert not HAS_SLICES or slice_ns == 100_000
    if grants_nice(realtime.NICE):
        assert (refusal, told, nice) == ("", f"SCHED_OTHER, nice -20{short}", {-20})
    else:
        assert (told, nice) == (f"SCHED_OTHER{short}", {0})
        assert refusal.startswith("nice -20 is not granted to this user: '@realtime - nice -20'")


def test_one_that_is_pinned_to_a_processor_leaves_others_the_rest(monkeypatch, asked):
    allowed = lambda _: set(range(8)).intersection(*asked.pins)  # noqa: E731
    monkeypatch.setattr(os, "sched_getaffinity", allowed)
    Realtime(Request("auto", 50, frozenset({2}))).close()
    assert asked.priorities == [50]
    assert asked.pins == [{2}]


@pytest.mark.parametrize(
    ("cpus", "place", "pinned"),
    [
        ({0, 1}, 0, {0}),
        ({0, 1}, -1, {1}),
        ({2, 5, 7}, -1, {7}),
        ({0, 1}, None, None),
        ({0}, 0, None),
        (set(range(ENOUGH_CPUS)), 0, None),
    ],
)
def test_where_there_are_few_processors_a_part_has_its_own(monkeypatch, asked, cpus, place, pinned):
    pins = asked.pins
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(cpus))
    Realtime(Request("auto", 50, place=place)).close()
    assert pins == ([] if pinned is None else [pinned])
    # What somebody chooses goes before.
    Realtime(Request("auto", 50, frozenset({1}), place)).close()
    assert pins[-1] == {1}
    Realtime(Request("off", place=place)).close()
    assert len(pins) == (1 if pinned is None else 2)


def test_who_sends_and_who_receives_are_on_different_processors():
    kinds = (DeviceParameters, ControllerParameters, MechanismParameters, AnalyserParameters)
    requests = [Request.of([kind()], in_sim_time=False) for kind in kinds]
    device, controller, mechanism, analyser = (request.place for request in requests)
    assert device != controller
    assert controller == mechanism
    assert mechanism != analyser
    # All in one process, or chosen by somebody: nothing by itself.
    assert Request.of([kind() for kind in kinds], in_sim_time=False).place is None
    for given in ("any", "1"):
        chosen = DeviceParameters(cpu_affinity=given)
        assert Request.of([chosen], in_sim_time=False).place is None
    assert Request.of([DeviceParameters()], in_sim_time=True) == Request()


def test_whoever_wants_nothing_changes_nothing(monkeypatch):
    def asked(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(os, "sched_setscheduler", asked)
    monkeypatch.setattr(os, "sched_setaffinity", asked)
    monkeypatch.setattr(os, "setpriority", asked)
    monkeypatch.setattr(realtime, "lock_memory", asked)
    monkeypatch.setattr(realtime, "DMA_LATENCY", None)
    figures = Realtime(Request()).figures()
    assert figures["memory_lock"] == figures["cpu_dma_latency"] == "not requested"


def test_cpus_that_are_not_there_are_refused_and_named():
    highest = max(os.sched_getaffinity(0))
    refusal = realtime.pin({highest, highest + 5, highest + 6})
    assert refusal.endswith(f"there is no CPU {highest + 5}-{highest + 6} for this process")


STARTING = """
import os, subprocess, sys
from hapticmech_ros.nodes.realtime import QuickStart, scheduling
starting = QuickStart(sys.argv[1:])
show = "import os; print(os.sched_getscheduler(0))"
child = int(subprocess.run([sys.executable, "-c", show], stdout=subprocess.PIPE).stdout)
quick = scheduling()
starting.end()
print(repr((quick, child, scheduling())))
"""


@pytest.mark.parametrize(
    "argument", ["realtime:=on", "scene:=five_bar", "device.realtime:=off", "use_sim_time:=true"]
)
def test_a_start_comes_before_what_is_ordinary_and_after_nodes(argument):
    enough = len(os.sched_getaffinity(0)) >= ENOUGH_CPUS
    wanted = grants_real_time(1) and (
        argument == "realtime:=on" or (enough and argument == "scene:=five_bar")
    )
    quick = "SCHED_FIFO 1" if wanted else "SCHED_OTHER"
    found = eval(output_of(STARTING, "-p", argument))
    assert found == (quick, os.SCHED_OTHER, "SCHED_OTHER")


def test_a_start_ends_as_an_ordinary_user_may_end_it(monkeypatch):
    """Once set, the flag that keeps children ordinary is taken away by the privileged only."""
    policies = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_OTHER)
    monkeypatch.setattr(os, "sched_setscheduler", lambda _, policy, __: policies.append(policy))
    realtime.QuickStart(["realtime:=on"]).end()
    flag = os.SCHED_RESET_ON_FORK
    assert policies == [os.SCHED_FIFO | flag, os.SCHED_OTHER | flag]


def test_a_start_leaves_alone_what_somebody_has_chosen():
    if not grants_real_time(5):
        pytest.skip("no real-time priority here")
    code = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))" + STARTING
    found = eval(output_of(code, "-p", "realtime:=on"))
    assert found == ("SCHED_FIFO 5", os.SCHED_FIFO, "SCHED_FIFO 5")


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
    before = realtime.scheduling()
    assert realtime.ask_for_real_time(50).startswith(sentence)
    assert realtime.scheduling() == before


def test_memory_that_cannot_be_locked_is_told(monkeypatch):
    class Refusing:
        @staticmethod
        def mlockall(_: int) -> int:
            ctypes.set_errno(12)
            return -1

    infinite = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    monkeypatch.setattr(resource, "getrlimit", lambda _: infinite)
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: Refusing)
    assert realtime.lock_memory() == "memory cannot be locked here: Cannot allocate memory"


def test_a_process_asks_for_the_most_that_one_of_its_nodes_asks_for():
    device = DeviceParameters(realtime="on", thread_priority=20, cpu_affinity="1")
    controller = ControllerParameters(thread_priority=30, cpu_affinity="2-3")
    both = Request("on", 30, frozenset({1, 2, 3}))
    assert Request.of([device, controller], in_sim_time=False) == both
    assert Request.of([device, controller], in_sim_time=True) == Request()
    assert Request.of([controller], in_sim_time=False).mode == "auto"
    assert Request.of([ViewerParameters()], in_sim_time=False) == Request()


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("", ""),
        ("any", "any"),
        (2, "2"),
        ([0, 2], "0,2"),
        ("0,2-3", "0,2-3"),
        (" 1 , 3 ", " 1 , 3 "),
    ],
)
def test_cpus_are_given_as_a_list_a_number_or_an_array(given, kept):
    assert validated(DeviceParameters, {"cpu_affinity": given}).cpu_affinity == kept


@pytest.mark.parametrize("given", ["a", "3-2", "1,,2", "-1", "0x1", True, 1.5, [True], "99999"])
def test_what_is_no_list_of_cpus_is_refused(given):
    with pytest.raises(ParameterError, match=r"numbers and ranges of CPUs.*\(got"):
        validated(DeviceParameters, {"cpu_affinity": given})


def test_lists_of_cpus_are_as_linux_writes_them():
    assert cpus_of("0,2-4,4") == {0, 2, 3, 4}
    assert listed({4, 0, 3, 2}) == "0,2-4"
    assert listed(()) == ""
    assert cpus_of("") == cpus_of("any") == frozenset()
    with pytest.raises(InvalidInputError, match="ranges of CPUs"):
        cpus_of("1-")
