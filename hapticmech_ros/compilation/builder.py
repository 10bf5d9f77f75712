"""Compiles kernels into objects of machine code, several at once.

Numba makes LLVM's intermediate language of each kernel, as of a callback for C (``numba.cfunc``),
and LLVM makes machine code of that. Nothing else takes part: no C compiler, no linker, and nothing
of what Numba's own library has for running programs, since kernels allocate nothing and raise
nothing. Where one does, the build says so.

``python -m hapticmech_ros.compilation.builder TARGET FILE``: TARGET is the processor to compile
for, as LLVM calls it, ``host`` for this one; FILE is written as :func:`packed` says. A line is
printed for each kernel that is done.
"""

from __future__ import annotations

import ctypes
import importlib
import io
import multiprocessing
import os
import re
import signal
import sys
import warnings
import zipfile
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from hapticmech_ros.compilation import decorators
from hapticmech_ros.compilation.decorators import OPTIONS, Kernel
from hapticmech_ros.errors import HapticMechError

# Import every kernel, directly or not.
_HOMES = ("mechanism.compiled.stepping", "operational.compiled", "control.compiled")
_MORE_HOMES = (
    *("device.compiled", "wire.readings", "contact.stepping"),
    "control.rendering_loop",
)
# Of the C library, which every process has.
_C_LIBRARY = frozenset(
    ("sqrt", "sin", "cos", "tan", "tanh", "atan2", "exp", "log", "pow", "memset", "memcpy")
)
# Who counts who looks at an array: nobody has to, since nobody owns one.
_COUNTING = re.compile(r"^ *(?:tail )?call void @NRT_(?:in|de)cref\(.*\n", re.MULTILINE)
_CALLBACK = re.compile(r"^define [^@]*@(cfunc\.[^( ]+)\(", re.MULTILINE)
# Those that take longest begin first.
_LONG = ("run_kernels", "observe_kernels", "mechanism_compiled_kernels_factor", "contact_step")
_PR_SET_PDEATHSIG = 1
_kernels: dict[str, Kernel] = {}


class BuildError(HapticMechError):
    """A kernel that cannot become part of the library."""


def import_all() -> dict[str, Kernel]:
    """Import all modules with kernels, for compilation, and return these by their names."""
    found = decorators.collect()
    for name in _HOMES + _MORE_HOMES:
        importlib.import_module(f"hapticmech_ros.{name}")
    return {one.name: one for one in found}


def build(target: str, path: Path) -> None:
    """Compile all kernels, with all processors, and write them into a file.

    Raises:
        BuildError: as :func:`compiled`.
    """
    names = sorted(import_all(), key=lambda name: not any(part in name for part in _LONG))
    objects: dict[str, bytes] = {}
    # From their own start: what Numba was taught in one process does not outlive a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(_processors(), context, _begin) as pool:
        jobs = {pool.submit(compiled_by_name, name, target): name for name in names}
        for number, job in enumerate(as_completed(jobs), 1):
            objects[jobs[job]] = job.result()
            print(f"{number} of {len(names)}", flush=True)
    path.write_bytes(packed(objects))


def packed(objects: dict[str, bytes]) -> bytes:
    """Return objects by name as one file."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in sorted(objects):
            # Of no time: the same kernels make the same file.
            archive.writestr(zipfile.ZipInfo(name), objects[name])
    return file.getvalue()


def compiled_by_name(name: str, target: str) -> bytes:
    """Return the machine code of a kernel, in a process that has imported them."""
    return compiled(_kernels[name], target)


def compiled(kernel: Kernel, target: str) -> bytes:
    """Return the machine code of a kernel: an object file with one symbol, its name.

    Args:
        kernel: to compile.
        target: processor.

    Raises:
        BuildError: it needs what the library has not: it allocates, or may raise.
    """
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    code = intermediate(kernel)
    (callback,) = _CALLBACK.findall(code)
    module = llvm.parse_assembly(_COUNTING.sub("", code).replace(callback, kernel.name))
    for function in module.functions:
        if not function.is_declaration and function.name != kernel.name:
            function.linkage = "internal"
    host = target == "host"
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name() if host else target,
        features=llvm.get_host_cpu_features().flatten() if host else "",
        opt=3,
        reloc="pic",
        codemodel="small",
    )
    _without_what_never_happens(llvm, module, machine)
    needed = {one.name for one in module.functions if one.is_declaration}
    needed = {one for one in needed if not one.startswith("llvm.")} - _C_LIBRARY
    if needed:
        raise BuildError(f"kernel {kernel.name} allocates or may raise: {_some(needed)}")
    return bytes(machine.emit_object(module))


def intermediate(kernel: Kernel) -> str:
    """Return a kernel in LLVM's intermediate language, as a callback and all that this calls."""
    import numba

    from hapticmech_ros.compilation.numba_types import array_of

    types: Any = numba.types
    words = {**vars(types), "Array": types.Array}
    signature = eval(kernel.signature, words)
    names = [f"a{index}" for index in range(len(signature.args))]
    known: dict[str, Any] = {"kernel": numba.njit(**OPTIONS)(kernel.function)}
    given, kinds = [], []
    for name, typed in zip(names, signature.args, strict=True):
        if isinstance(typed, types.Array):
            known[f"of_{name}"] = array_of(typed)
            given.append(f"of_{name}({name})")
            kinds.append(types.int64)
        else:
            given.append(name)
            kinds.append(typed)
    source = f"def entry({', '.join(names)}):\n    return kernel({', '.join(given)})\n"
    exec(source, known)
    entry = numba.cfunc(signature.return_type(*kinds), **OPTIONS)(known["entry"])
    return str(entry.inspect_llvm())


def _without_what_never_happens(llvm: Any, module: Any, machine: Any) -> None:
    """Leave out what Numba has put in for errors, where LLVM sees that there are none."""
    passes = llvm.create_new_module_pass_manager()
    passes.add_ipsccp_pass()
    passes.add_simplify_cfg_pass()
    passes.add_global_dead_code_eliminate_pass()
    options = llvm.create_pipeline_tuning_options(speed_level=0)
    passes.run(module, llvm.create_pass_builder(machine, options))


def _some(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)[:5])


def _begin() -> None:
    # Whoever reads what the builder says waits until nobody can say more, and helpers would outlive
    # a builder that is killed.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    warnings.simplefilter("ignore")
    _kernels.update(import_all())


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    build(sys.argv[1], Path(sys.argv[2]))
