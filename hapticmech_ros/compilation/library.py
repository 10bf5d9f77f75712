"""The library of compiled kernels: found, built once if it can be, and loaded without Numba."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import importlib.util
import os
import subprocess
import sys
import sysconfig
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from pathlib import Path
from types import ModuleType

import numpy as np

from hapticmech_ros.compilation.attempt import BUSY_S, REFUSED_S, obstacle, remember, remembered
from hapticmech_ros.compilation.cache import folder
from hapticmech_ros.compilation.custody import is_safe, warn
from hapticmech_ros.compilation.sealed import BrokenSealError, open_sealed, put_in_place

MODULE = "hapticmech_kernels"
# A slow machine takes two minutes.
COMPILE_TIMEOUT_S = 600.0
# How the name of a file begins that is being built.
_MADE = "being-built-"
_PACKAGE = Path(__file__).parent.parent


@functools.cache
def library() -> ModuleType | None:
    """Return the loaded library, built if need be; None where that is impossible or not wanted."""
    file = _provided()
    if file is None:
        return None
    path = library_path()
    # The very file that was looked at, whatever is at its path by now. The descriptor stays open:
    # the interpreter knows modules by their paths, and would take the next one for this.
    # Its path has no suffix by which an extension could be known: the loader is named.
    loader = ExtensionFileLoader(MODULE, f"/proc/self/fd/{file}")
    try:
        module = importlib.util.module_from_spec(ModuleSpec(MODULE, loader, origin=loader.path))
        loader.exec_module(module)
    except ImportError as error:
        warn(f"{path} cannot be loaded: {error}")
        return None
    module.__file__ = str(path)
    return module


def compile_ahead() -> None:
    """Compile all kernels, unless that was done before; takes a minute or two.

    Nodes that start together would otherwise wait for each other.
    """
    file = _provided()
    if file is None:
        _compile_just_in_time()
    else:
        os.close(file)


def library_path() -> Path:
    """Return where the library is for this Python, NumPy and processor, whether built or not."""
    numpy_generation = np.__version__.split(".", maxsplit=1)[0]
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    return folder() / f"{MODULE}-{_processor()[1]}-numpy{numpy_generation}{suffix}"


def _provided() -> int | None:
    """Return a descriptor of the library's file, built now if need be; None if there is none."""
    if os.environ.get("HAPTICMECH_ROS_KERNELS", "library") == "jit":
        return None
    path = library_path()
    try:
        if not is_safe(path.parent):
            return None
        file = _opened(path, tell=True)
        return _built(path) if file is None else file
    except OSError as error:
        # No folder that can be written, or a disk that is full.
        warn(f"no library of kernels: {error}")
        return None


def _opened(path: Path, tell: bool = False) -> int | None:
    """Return a descriptor of the library if it is there as it was written."""
    try:
        return open_sealed(path, _origin(path))
    except FileNotFoundError:
        return None
    except BrokenSealError as error:
        if tell:
            warn(f"{error}: it is not loaded")
        return None


def _origin(path: Path) -> dict[str, str]:
    """Return what a library is made from: the kernels' files, and what its name tells."""
    return {"kernels": path.parent.name, "for": path.name}


def _built(path: Path) -> int | None:
    """Build the library, unless another process does so already, and return its descriptor."""
    failed = path.with_suffix(".failed")
    if remembered(failed):
        return None
    missing = obstacle(path.parent)
    if missing:
        warn(f"no library of kernels, every start takes longer: {missing}")
        return None
    lock = os.open(
        path.parent / "lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644
    )
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        # While this one waited, another may have built it, or failed to.
        file = _opened(path)
        if file is not None or remembered(failed):
            return file
        warn("compiling kernels, once: a minute or two")
        reason, counts_s = _run_builder(path)
        if not reason:
            failed.unlink(missing_ok=True)
            return _opened(path, tell=True)
        where = f"see {failed}" if remember(failed, reason, counts_s) else reason.splitlines()[-1]
        warn(f"no library of kernels, {where}")
        return None
    finally:
        os.close(lock)


def _run_builder(path: Path) -> tuple[str, float]:
    """Build the library in a process of its own; return why it failed, and for how long, s."""
    # Left by builders that were killed: only one at a time is at work.
    for left in path.parent.glob(f"{_MADE}*"):
        left.unlink(missing_ok=True)
    made = path.with_name(f"{_MADE}{path.name}")
    builder = "hapticmech_ros.compilation.builder"
    try:
        done = _run([sys.executable, "-m", builder, str(made), _processor()[0]])
        if done.returncode < 0:
            return f"the builder was ended by signal {-done.returncode}", BUSY_S
        if done.returncode or not made.exists():
            return done.stderr.strip() or "the builder wrote nothing", REFUSED_S
        put_in_place(made, path, _origin(path))
    except subprocess.TimeoutExpired:
        return f"not done after {COMPILE_TIMEOUT_S:g} s", BUSY_S
    finally:
        made.unlink(missing_ok=True)
    return "", 0.0


def _compile_just_in_time() -> None:
    """Let another process compile what Numba keeps, unless that was done before."""
    # Numba keeps apart what is for another interpreter, or another place of the package.
    place = hashlib.sha256(f"{sys.executable}{_PACKAGE}".encode()).hexdigest()[:16]
    done = folder() / f"compiled-{place}"
    if done.exists():
        return
    try:
        compiled = _run([sys.executable, "-m", "hapticmech_ros.compilation.builder"])
    except subprocess.TimeoutExpired:
        # Each process then compiles for itself what it needs.
        return
    if compiled.returncode == 0:
        # Where nothing can be kept, there is nothing to be remembered.
        with contextlib.suppress(OSError):
            done.touch()


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    paths = [str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        command,
        check=False,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        timeout=COMPILE_TIMEOUT_S,
    )


@functools.cache
def _processor() -> tuple[str, str]:
    """Return what to compile for, in LLVM's words, and a name for it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    features = [line for line in lines if line.startswith(("model name", "flags", "Features"))]
    if not features:
        return "", "generic"
    first = dict.fromkeys(line.split(":")[0] for line in features)
    told = "".join(next(x for x in features if x.startswith(name)) for name in first)
    return "host", hashlib.sha256(told.encode()).hexdigest()[:12]
