# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiles kernels into objects of machine code, several at once.

Numba translates each kernel, as a callback for C (``numba.cfunc``), and each function that kernels
call (:mod:`~hapticmech_ros.compilation.inner_functions`) to LLVM's intermediate language. LLVM
joins, optimises and compiles them. No C compiler and no linker is needed, nor Numba's runtime
library, since kernels allocate nothing and raise nothing. Where one does, the build fails.

``python -m hapticmech_ros.compilation.builder TARGET FILE PARENT``: TARGET is LLVM's name of the
processor to compile for, ``host`` for this one; FILE is written by :func:`packed`; PARENT is the
waiting process: the builder ends with it. It prints a line for each kernel that is done.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import io
import multiprocessing
import os
import signal
import sys
import warnings
import zipfile
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

from hapticmech_ros.compilation import decorators
from hapticmech_ros.compilation.cache import IDENTITY
from hapticmech_ros.compilation.decorators import Kernel
from hapticmech_ros.compilation.records import Record
from hapticmech_ros.compilation.structures import Structure, kinds_of
from hapticmech_ros.errors import HapticMechError

# Import every kernel, directly or not.
_HOMES = ("mechanism.stepping", "operational.analysis", "control.architecture")
_MORE_HOMES = (
    *("device.impedance_device", "wire.layouts", "contact.stepping"),
    *("session.session", "nodes.lane_kernels"),
    *("nodes.analysis_kernels", "nodes.control_kernels"),
    *("nodes.device_kernels", "nodes.mechanism_kernels"),
)
# Of the C library, which every process has.
_C_LIBRARY = frozenset(
    (
        *("sqrt", "sin", "cos", "tan", "tanh", "atan2", "exp", "log", "pow", "memset", "memcpy"),
        *("usleep", "poll", "write", "abort", "_exit"),
        *("ppoll", "recv", "send", "memcmp", "clock_gettime"),
    )
)
# Kernels with much in common, by the prefixes of their names; all others are one more family.
_FAMILIES: tuple[tuple[str, ...], ...] = (("mechanism_", "operational_", "contact_step"),)
# Those that take longest begin first.
_LONG = ("tick_kernels", "run_kernels", "observe_kernels", "kernels_factor", "contact_step")
# Beyond the families only LLVM's part is faster.
_MOST_LANES = 8
_PR_SET_PDEATHSIG = 1
_kernels: dict[str, Kernel] = {}


class BuildError(HapticMechError):
    """A kernel that cannot become part of the library."""


def import_all() -> dict[str, Kernel]:
    """Import all modules with kernels, for compilation, and return these by their names."""
    found = decorators.collect()
    for name in _HOMES + _MORE_HOMES:
        importlib.import_module(f"hapticmech_ros.{name}")
    from hapticmech_ros.compilation.numba_types import teach_record, teach_structure

    for structure in kinds_of(Structure):
        teach_structure(structure)
    for record in kinds_of(Record):
        teach_record(record)
    return {one.name: one for one in found}


def build(target: str, path: Path) -> None:
    """Compile all kernels, with all processors, and write them into a file.

    Numba, which is Python, takes most of the time. The same process translates kernels that have
    much in common, each function once; any free process then runs LLVM.

    Raises:
        BuildError: as :func:`compiled`.
    """
    # Numba's own code is not run: LLVM optimises kernels once, as a whole.
    os.environ["NUMBA_OPT"] = "0"
    # Started anew: Numba's extensions of one process do not survive a fork.
    context = multiprocessing.get_context("spawn")
    with contextlib.ExitStack() as stack:
        lanes = [
            stack.enter_context(ProcessPoolExecutor(1, context, _begin))
            for _ in range(min(_processors(), _MOST_LANES))
        ]
        # All begin now; only the first one's list is used.
        listed = [lane.submit(_names) for lane in lanes]
        names = listed[0].result()
        waiting = _shared_out(names, len(lanes))
        translated: set[str] = set()
        modules: dict[str, bytes] = {}
        objects: dict[str, bytes] = {}
        working: dict[Future[bytes], tuple[int, str]] = {}
        while len(objects) < len(names):
            for number in set(range(len(lanes))) - {lane for lane, _ in working.values()}:
                if waiting[number]:
                    name = waiting[number].pop(0)
                    job = lanes[number].submit(_translated, name)
                elif modules:
                    name = max(modules, key=lambda one: len(modules[one]))
                    job = lanes[number].submit(machine_code, modules.pop(name), name, target)
                else:
                    continue
                working[job] = (number, name)
            for job in wait(working, return_when=FIRST_COMPLETED).done:
                _, name = working.pop(job)
                made = objects if name in translated else modules
                made[name] = job.result()
                translated.add(name)
                print(f"{len(translated) + len(objects)} of {2 * len(names)}", flush=True)
    path.write_bytes(packed(objects))


def packed(objects: dict[str, bytes]) -> bytes:
    """Return objects by name as one file."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.comment = IDENTITY
        for name in sorted(objects):
            # Of no time: the same kernels make the same file.
            archive.writestr(zipfile.ZipInfo(name), objects[name])
    return file.getvalue()


def compiled(kernel: Kernel, target: str) -> bytes:
    """Return the machine code of a kernel: an object file with one symbol, its name.

    Args:
        kernel: to compile.
        target: processor.

    Raises:
        BuildError: it needs a symbol that the library lacks: it allocates, or may raise.
    """
    return machine_code(intermediate(kernel), kernel.name, target)


def machine_code(code: bytes, name: str, target: str) -> bytes:
    """Return the machine code of a kernel's module, as :func:`intermediate` makes it.

    Args:
        code: the module.
        name: the kernel's.
        target: processor.

    Raises:
        BuildError: as :func:`compiled`.
    """
    import llvmlite.binding as llvm

    from hapticmech_ros.compilation.inner_functions import LINKED

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_bitcode(code)
    host = target == "host"
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name() if host else target,
        features=llvm.get_host_cpu_features().flatten() if host else "",
        opt=3,
        reloc="pic",
        codemodel="small",
    )
    _optimise(llvm, module, machine)
    needed = {one.name for one in module.functions if one.is_declaration}
    needed = {one for one in needed if not one.startswith("llvm.") and one not in _C_LIBRARY}
    needed = {one for one in needed if not one.endswith(LINKED)}
    if needed:
        raise BuildError(f"kernel {name} allocates or may raise: {_some(needed)}")
    return bytes(machine.emit_object(module))


def intermediate(kernel: Kernel) -> bytes:
    """Return a kernel in LLVM's intermediate language, as a callback and all that it calls."""
    import numba

    from hapticmech_ros.compilation.inner_functions import (
        OPTIONS,
        joined,
        signature_of,
        translated,
    )
    from hapticmech_ros.compilation.numba_types import argument_of, object_at

    types: Any = numba.types
    signature = signature_of(kernel.signature)
    names = [f"a{index}" for index in range(len(signature.args))]
    known: dict[str, Any] = {"kernel": translated(kernel.function)}
    given, kinds = [], []
    for name, typed in zip(names, signature.args, strict=True):
        if isinstance(typed, types.Number | types.Boolean):
            given.append(name)
            kinds.append(typed)
        else:
            known[f"of_{name}"] = argument_of(typed)
            given.append(f"of_{name}({name})")
            kinds.append(types.int64)
    if kernel.gathered:
        known |= {f"find_{name}": object_at(index) for index, name in enumerate(names)}
        given = [f"of_{name}(find_{name}(all))" for name in names]
        names, kinds = ["all"], kinds[:1]
    source = f"def entry({', '.join(names)}):\n    return kernel({', '.join(given)})\n"
    exec(source, known)
    entry = numba.cfunc(signature.return_type(*kinds), **OPTIONS)(known["entry"])
    return joined(entry.inspect_llvm(), kernel.name, kernel.function if kernel.linked else None)


def _optimise(llvm: Any, module: Any, machine: Any) -> None:
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    # As in Numba.
    options.loop_vectorization, options.slp_vectorization = True, False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    # Remove Numba's error handling where LLVM proves that no error occurs.
    passes = llvm.create_new_module_pass_manager()
    passes.add_ipsccp_pass()
    passes.add_simplify_cfg_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(0)))


def _some(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)[:5])


def _names() -> list[str]:
    return list(_kernels)


def _translated(name: str) -> bytes:
    return intermediate(_kernels[name])


def _shared_out(names: list[str], count: int) -> list[list[str]]:
    """Return which kernels each of so many processes translates, one after the other."""
    families: list[list[str]] = [[] for _ in range(len(_FAMILIES) + 1)]
    for name in sorted(names, key=lambda name: not any(part in name for part in _LONG)):
        of = (i for i, family in enumerate(_FAMILIES) if name.startswith(family))
        families[next(of, len(_FAMILIES))].append(name)
    shares: list[list[str]] = [[] for _ in range(count)]
    for number, family in enumerate(families):
        shares[min(number, count - 1)] += family
    return shares


def _begin() -> None:
    # The reader of the builder's output waits until all writers have closed it, and helpers would
    # outlive a killed builder.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    _end_with_parent()
    warnings.simplefilter("ignore")
    _kernels.update(import_all())
    # Numba makes millions of small objects, few of them in circles, and these processes end soon.
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


if __name__ == "__main__":
    # Without its parent no process waits for it: the next one that needs the library builds it.
    _end_with_parent()
    if os.getppid() != int(sys.argv[3]):
        sys.exit("who asked for the library is gone")
    warnings.simplefilter("ignore")
    build(sys.argv[1], Path(sys.argv[2]))
