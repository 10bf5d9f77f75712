# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work on untrusted files in a child process with limits on memory, time and output.

Readers of large formats are libraries that trust what they read: a wrong token can exhaust memory
or time, or crash the process. In a child they crash only that, and an error describes it.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hapticmech_ros.errors import HapticMechError

# Real time that a child may take for each second of the processor's, and s to start it: a machine
# may have other work.
PATIENCE = 30
START = 120
_STATM = Path("/proc/self/statm")
_CODE = "import hapticmech_ros.files.cage as cage; cage.work_in_child()"


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a child.

    Attributes:
        memory: bytes, besides those of the libraries that it loads first.
        seconds: of the processor; in real time ``PATIENCE`` times that.
        output: bytes of its answers, and of each file that it writes.
    """

    memory: int
    seconds: int
    output: int


class CageError(HapticMechError):
    """Work that did not come to its end.

    Attributes:
        done: answers to the items before the one at which it ended.
        rule: why, in words.
    """

    def __init__(self, done: list[Any], rule: str) -> None:
        self.done = done
        self.rule = rule
        super().__init__(rule)


def caged(work: Callable[[Any], Any], items: Sequence[Any], limits: Limits) -> list[Any]:
    """Return what ``work`` returns for each item, done in a child.

    Args:
        work: a function of a module; takes an item and returns an answer, both as JSON has them.
        items: to work on, in order.
        limits: of the child.

    Raises:
        CageError: a limit was reached, the child was ended by a signal, or ``work`` failed.
    """
    name = [work.__module__, work.__qualname__]
    real = PATIENCE * limits.seconds
    task = {"work": name, "items": list(items), "limits": asdict(limits), "real_seconds": real}
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or "." for path in sys.path)}
    # A thread of BLAS takes as much address space as the file's data.
    environment["OPENBLAS_NUM_THREADS"] = "1"
    answers = os.memfd_create("answers")
    try:
        with subprocess.Popen(
            [sys.executable, "-c", _CODE, str(answers)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(answers,),
            env=environment,
        ) as child:
            try:
                child.communicate(json.dumps(task).encode(), timeout=START + real)
            except subprocess.TimeoutExpired:
                child.kill()
            except BaseException:
                child.kill()
                raise
        return _read(answers, len(items), child.returncode, limits)
    finally:
        os.close(answers)


def _read(answers: int, wanted: int, code: int, limits: Limits) -> list[Any]:
    """Return a child's answers, as many as were wanted."""
    found: list[Any] = []
    failed = ""
    for line in os.pread(answers, limits.output, 0).splitlines(keepends=True):
        try:
            answer = json.loads(line) if line.endswith(b"\n") else {}
        except ValueError:
            answer = {}
        if "answer" not in answer:
            failed = str(answer.get("failed", ""))
            break
        found.append(answer["answer"])
    if len(found) == wanted and code == 0:
        return found
    raise CageError(found, failed or _end(code, limits))


def _end(code: int, limits: Limits) -> str:
    """Return why a child ended without an answer."""
    if -code in (signal.SIGXCPU, signal.SIGKILL, signal.SIGALRM):
        return f"takes more than {limits.seconds} s"
    if -code == signal.SIGXFSZ:
        return f"becomes more than {limits.output} bytes"
    if code < 0:
        return f"ends the process that reads it ({signal.Signals(-code).name})"
    return "ends the process that reads it"


def work_in_child() -> None:
    """Do the work that stands in standard input; answers go to the file that is named last."""
    answers = int(sys.argv[1])
    task = json.load(sys.stdin)
    module, name = task["work"]
    work = getattr(importlib.import_module(module), name)
    limits = Limits(**task["limits"])
    _limit(limits, task["real_seconds"])
    for item in task["items"]:
        try:
            answer = {"answer": work(item)}
        except MemoryError:
            answer = {"failed": f"needs more than {limits.memory} bytes of memory"}
        except Exception as error:  # noqa: BLE001 - a library's; the parent reports it
            reason = " ".join(str(error).split()) or type(error).__name__
            answer = {"failed": f"cannot be read: {reason}"}
        line = json.dumps(answer).encode() + b"\n"
        if os.lseek(answers, 0, os.SEEK_END) + len(line) > limits.output:
            line = json.dumps({"failed": f"becomes more than {limits.output} bytes"}).encode()
            line += b"\n"
        os.write(answers, line)
        if b'{"failed"' in line[:9]:
            return


def _limit(limits: Limits, real_seconds: int) -> None:
    """Limit this process; it also ends by itself after ``real_seconds``."""
    size = int(_STATM.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    most = {
        resource.RLIMIT_AS: size + limits.memory,
        resource.RLIMIT_CPU: limits.seconds + int(sum(os.times()[:2])),
        resource.RLIMIT_FSIZE: limits.output,
        resource.RLIMIT_CORE: 0,
    }
    for kind, value in most.items():
        # A lower limit, as by `ulimit -v`, stays.
        set_before = resource.getrlimit(kind)[1]
        if set_before == resource.RLIM_INFINITY or value < set_before:
            resource.setrlimit(kind, (value, value))
    signal.alarm(real_seconds)
