# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The library of compiled kernels: found, built once, and loaded without Numba.

It is a file of objects, machine code for this processor, which LLVM (through llvmlite) puts into
memory in some milliseconds. Kernels are called through :mod:`ctypes`: a quarter of a microsecond,
and some tens of nanoseconds for each array.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import functools
import hashlib
import io
import os
import re
import signal
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from hapticmech_ros.compilation.cache import (
    IDENTITY,
    TAG,
    folder,
    is_own,
    put_in_place,
    read_own,
    warn,
)
from hapticmech_ros.compilation.records import Record
from hapticmech_ros.compilation.structures import Structure
from hapticmech_ros.errors import HapticMechError

NAME = "hapticmech_kernels"
# A slow machine, or one that is busy, takes minutes.
COMPILE_TIMEOUT_S, PROGRESS_S = 600.0, 5.0
# Shares of a build's steps, and of its time until then, as measured on two processors.
_STEPS, _TIME = (0.0, 0.01, 0.2, 0.35, 0.5, 0.6, 1.0), (0.2, 0.24, 0.36, 0.6, 0.84, 0.95, 1.0)
# Where NumPy's C interface has the start of an array's data, and of its shape (PyArrayObject).
DATA_AT, SHAPE_AT = 16, 32
BUILDER = "hapticmech_ros.compilation.builder"
# Where an object's slots are, one after the other, in the order of their names.
SLOTS_AT = 16
# How the name of a file begins that is being built.
_MADE = "being-built-"
_PACKAGE = Path(__file__).parent.parent
# Machine code that `make wheel` puts into the package, and what it needs of a processor.
SHIPPED = Path(__file__).with_name("x86-64-v3.zip")
_OF_X86_64_V3 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
_SCALARS: dict[str, Any] = {
    "void": None,
    "boolean": ctypes.c_bool,
    "int64": ctypes.c_int64,
    "i8": ctypes.c_int64,
    "float64": ctypes.c_double,
    "f8": ctypes.c_double,
}
_SIGNATURE = re.compile(r"(\w+)\((.*)\)", re.DOTALL)
# A comma that is in no brackets.
_COMMA = re.compile(r",\s*(?![^\[(]*[\])])")
_ARRAY = re.compile(r"(?:Array\()?(float64|int64|f8|i8)\b(.*)", re.DOTALL)


class LibraryError(HapticMechError):
    """The kernels cannot be compiled or loaded."""


class Library(NamedTuple):
    """Loaded kernels.

    Attributes:
        addresses: of the kernels' functions, by name.
        engine: LLVM's, to which the memory belongs.
    """

    addresses: dict[str, int]
    engine: object


def function_of(
    name: str,
    signature: str,
    function: Callable[..., object],
    waits: bool = False,
    gathered: bool = False,
) -> Callable[..., Any]:
    """Return a kernel of the library as a function of NumPy arrays and numbers.

    Args:
        name: in the library.
        signature: types of result and arguments, as Numba writes them.
        function: that was compiled, for its name and documentation.
        waits: whether other threads run Python meanwhile.
        gathered: whether its arguments come in one array of objects.

    Raises:
        LibraryError: there is no library, or no such kernel in it.
    """
    loaded = library()
    found = loaded.addresses.get(name)
    if found is None:
        raise LibraryError(f"no kernel {name} in the library: is it among the builder's modules?")
    result, arguments = _parted(signature)
    kinds = [_SCALARS.get(argument, ctypes.py_object) for argument in arguments]
    prototype = ctypes.CFUNCTYPE if waits else ctypes.PYFUNCTYPE
    called: Any = prototype(_SCALARS[result], *kinds[: 1 if gathered else None])(found)
    # The memory that it is in goes with the library.
    called.library = loaded
    if os.environ.get("HAPTICMECH_ROS_KERNELS") == "checked":
        called = _checked(name, arguments, called, gathered)
    called.__name__, called.__doc__ = function.__name__, function.__doc__
    called.__wrapped__ = function
    return called  # type: ignore[no-any-return]


@functools.cache
def library() -> Library:
    """Return the loaded library, built if need be.

    Raises:
        LibraryError: it cannot be built, or not be loaded.
    """
    return _loaded(_objects())


def compile_ahead() -> None:
    """Compile all kernels, unless that was done before; takes a minute or more.

    Nodes that start together would otherwise wait for each other.

    Raises:
        LibraryError: they cannot be compiled.
    """
    _objects()


def library_path() -> Path:
    """Return where the library is for this Python and processor, whether built or not."""
    return folder() / f"{NAME}-{_processor()[1]}-{TAG}.zip"


def _objects() -> Mapping[str, bytes]:
    """Return the library's objects by name, built now if need be."""
    if shipped := _shipped():
        return shipped
    try:
        path = library_path()
        if is_own(path.parent):
            return _read(path, warns=True) or _built(path)
    except OSError as error:
        # No folder that can be written, or a disk that is full.
        warn(f"kernels are compiled for this process alone: {error}")
    return _unpacked(_made())


def _shipped() -> Mapping[str, bytes]:
    """Return the objects of the library in this installation, if it has one that fits; else none.

    Raises:
        LibraryError: it is damaged.
    """
    if not SHIPPED.exists():
        return {}
    # Imported here: many commands need no kernel.
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    if not all(features.get(name) for name in _OF_X86_64_V3):
        return {}
    try:
        return _unpacked(SHIPPED.read_bytes(), IDENTITY)
    except LibraryError as error:
        raise LibraryError(f"{SHIPPED}: {error}: install the package again") from None


def _read(path: Path, warns: bool = False) -> Mapping[str, bytes]:
    """Return the library's objects if it is there, the user's, and whole; else nothing."""
    try:
        return _unpacked(read_own(path))
    except FileNotFoundError:
        return {}
    except OSError as error:
        if warns:
            warn(f"{path}: {error}: it is not loaded")
        return {}


def _unpacked(content: bytes, identity: bytes = b"") -> Mapping[str, bytes]:
    """Return a library's objects by name; none of a library that lacks a wanted identity.

    Raises:
        LibraryError: it is none.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            fits = identity in (b"", archive.comment)
            return {name: archive.read(name) for name in archive.namelist() if fits}
    except zipfile.BadZipFile as error:
        raise LibraryError(f"this is no library of kernels: {error}") from None


def _built(path: Path) -> Mapping[str, bytes]:
    """Build the library, unless another process does so already, and return its objects."""
    lock = os.open(
        path.parent / "lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644
    )
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        # While this one waited, another may have built it.
        if found := _read(path):
            return found
        # Left by builders that were killed: only one at a time is at work.
        for left in path.parent.glob(f"{_MADE}*"):
            left.unlink(missing_ok=True)
        content = _made()
        try:
            put_in_place(content, path, path.with_name(f"{_MADE}{path.name}"))
        except OSError as error:
            warn(f"the kernels are not kept, every start compiles them again: {error}")
        return _unpacked(content)
    finally:
        os.close(lock)


def _made() -> bytes:
    """Return the library, built in a separate process.

    Raises:
        LibraryError: that failed, or there is no room for it.
    """
    try:
        with TemporaryDirectory(prefix=NAME) as place:
            return _built_at(Path(place, NAME))
    except OSError as error:
        raise LibraryError(f"kernels cannot be compiled: {error}") from None


def _built_at(made: Path) -> bytes:
    """Let a builder write the library to a path, and return it.

    Raises:
        LibraryError: it did not.
    """
    paths = [str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    with subprocess.Popen(
        [sys.executable, "-m", BUILDER, _processor()[0], str(made), str(os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        # A separate process group, which is ended as a whole: the builder has helpers.
        start_new_session=True,
    ) as process:
        late = threading.Event()

        def give_up() -> None:
            late.set()
            _kill_group(process.pid)

        timer = threading.Timer(COMPILE_TIMEOUT_S, give_up)
        timer.start()
        try:
            last = _followed(process.stdout or ())
        except BaseException:
            _kill_group(process.pid)
            raise
        finally:
            timer.cancel()
    if late.is_set():
        raise LibraryError(f"kernels: not done after {COMPILE_TIMEOUT_S:g} s")
    if process.returncode < 0:
        raise LibraryError(f"kernels: the build was ended by signal {-process.returncode}")
    if process.returncode or not made.exists():
        raise LibraryError(f"kernels cannot be compiled: {last or 'nothing was written'}")
    return made.read_bytes()


def _kill_group(leader: int) -> None:
    """End a process and all that it started, at once."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(leader, signal.SIGKILL)


def _followed(lines: Iterable[str]) -> str:
    """Show the time left of a build, from its lines "3 of 18"; return the last other line."""
    last, begun = "", time.monotonic()
    shown_at = begun
    warn("compiling kernels, once: a minute or more")
    for line in lines:
        done, of, total = line.strip().partition(" of ")
        if not (of and done.isdigit() and total.isdigit()):
            last = line.strip() or last
        elif (now := time.monotonic()) - shown_at > PROGRESS_S:
            shown_at, share = now, np.interp(int(done) / int(total), _STEPS, _TIME)
            warn(f"compiling kernels: about {(now - begun) * (1.0 / share - 1.0):.0f} s left")
    return last


def _loaded(objects: Mapping[str, bytes]) -> Library:
    """Put a library's objects into memory.

    Raises:
        LibraryError: they are invalid, or need a missing symbol.
    """
    # Imported here: many commands need no kernel.
    import llvmlite.binding as llvm

    _check_interface()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(opt=3, jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    try:
        for data in objects.values():
            engine.add_object_file(llvm.ObjectFileRef.from_data(data))
        engine.finalize_object()
    except (RuntimeError, ValueError) as error:
        raise LibraryError(f"the kernels cannot be loaded: {error}") from None
    return Library({name: engine.get_function_address(name) for name in objects}, engine)


def _check_interface() -> None:
    """Check the memory layout of arrays against NumPy's C interface, and of slots.

    Raises:
        LibraryError: they are not.
    """
    for one in (Record(), Structure(np.zeros(1), np.zeros(1))):
        slots = (ctypes.c_size_t * len(one.__slots__)).from_address(id(one) + SLOTS_AT)
        if list(slots) != [id(getattr(one, name)) for name in sorted(one.__slots__)]:
            raise LibraryError("kernels do not know how this Python stores objects")
    probe = np.zeros((3, 5))
    words = (ctypes.c_size_t * 3).from_address(id(probe) + DATA_AT)
    # The shape is read only where the data pointer is right.
    if words[0] == probe.ctypes.data:
        shape = words[(SHAPE_AT - DATA_AT) // ctypes.sizeof(ctypes.c_size_t)]
        if shape and ctypes.c_int64.from_address(shape).value == len(probe):
            return
    raise LibraryError("kernels do not know how this NumPy stores arrays")


def _parted(signature: str) -> tuple[str, list[str]]:
    """Return the types of result and arguments of a signature."""
    found = _SIGNATURE.fullmatch(signature)
    if found is None:
        raise LibraryError(f"no signature of a kernel: {signature}")
    return found[1], _COMMA.split(found[2])


def _checked(name: str, arguments: list[str], called: Any, gathered: bool = False) -> Any:
    """Return a kernel that checks its arguments first, given one by one or in one array."""
    wanted = [_ARRAY.fullmatch(argument) for argument in arguments]

    def check(*given: Any) -> Any:
        values = given[0].tolist() if gathered else given
        for number, (value, found) in enumerate(zip(values, wanted, strict=True)):
            argument = arguments[number]
            if argument in _SCALARS:
                continue
            if found is None:
                fits = argument in (kind.__name__ for kind in type(value).__mro__)
            else:
                whole = found[1] in ("int64", "i8")
                order: Any = "F_CONTIGUOUS" if "::1," in found[2] else "C_CONTIGUOUS"
                written = "Array" in argument
                dimensions = int(found[2].split(",")[1]) if written else found[2].count(",") + 1
                kind = np.dtype(np.int64 if whole else np.float64)
                fits = isinstance(value, np.ndarray) and value.dtype == kind
                fits = fits and value.flags[order] and value.ndim == dimensions
            if not fits:
                raise LibraryError(f"{name}: argument {number} must be {argument}")
        return called(*given)

    return check


@functools.cache
def _processor() -> tuple[str, str]:
    """Return LLVM's description of the processor, and a name for it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    features = [line for line in lines if line.startswith(("model name", "flags", "Features"))]
    if not features:
        return "", "generic"
    first = dict.fromkeys(line.split(":")[0] for line in features)
    enabled = "".join(next(x for x in features if x.startswith(name)) for name in first)
    return "host", hashlib.sha256(enabled.encode()).hexdigest()[:12]
