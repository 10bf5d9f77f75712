"""The library of compiled kernels: found, built once if it can be, and loaded without Numba."""

from __future__ import annotations

import fcntl
import functools
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType

import numpy as np

from hapticmech_ros.compilation.cache import folder

MODULE = "hapticmech_kernels"
# A slow machine takes two minutes.
COMPILE_TIMEOUT_S = 600.0
_PACKAGE = Path(__file__).parent.parent


@functools.cache
def library() -> ModuleType | None:
    """Return the loaded library, built if need be; None where that is impossible or not wanted."""
    path = _provided()
    if path is None:
        return None
    spec = importlib.util.spec_from_file_location(MODULE, path)
    if spec is None or spec.loader is None:
        return None
    try:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except ImportError as error:
        sys.stderr.write(f"hapticmech_ros: {path} cannot be loaded: {error}\n")
        return None
    return module


def compile_ahead() -> None:
    """Compile all kernels, unless that was done before; takes a minute or two.

    Nodes that start together would otherwise wait for each other.
    """
    if _provided() is None:
        _compile_just_in_time()


def library_path() -> Path:
    """Return where the library is for this Python, NumPy and processor, whether built or not."""
    numpy_generation = np.__version__.split(".", maxsplit=1)[0]
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    return folder() / f"{MODULE}-{_processor()[1]}-numpy{numpy_generation}{suffix}"


def _provided() -> Path | None:
    """Return the library's file, built now if need be; None if there is none."""
    if os.environ.get("HAPTICMECH_ROS_KERNELS", "library") == "jit":
        return None
    path = library_path()
    if not path.exists() and not _build(path):
        return None
    return path


def _build(path: Path) -> bool:
    """Build the library, unless another process does so already, and return whether it is there."""
    failed = path.with_suffix(".failed")
    if failed.exists() or not _can_build():
        return False
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with (path.parent / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            # While this one waited, another may have built it, or failed to.
            if path.exists() or failed.exists():
                return path.exists()
            sys.stderr.write("hapticmech_ros: compiling kernels, once: a minute or two\n")
            sys.stderr.flush()
            reason = _run_builder(path)
            if reason:
                failed.write_text(reason)
                sys.stderr.write(f"hapticmech_ros: no library of kernels, see {failed}\n")
            return not reason
    except OSError:
        # No folder that can be written.
        return False


def _run_builder(path: Path) -> str:
    """Build the library in a process of its own; return why it failed, or nothing."""
    made = path.with_name(f"{os.getpid()}-{path.name}")
    command = [
        sys.executable,
        "-m",
        "hapticmech_ros.compilation.builder",
        str(made),
        _processor()[0],
    ]
    try:
        done = _run(command)
    except subprocess.TimeoutExpired:
        return f"not done after {COMPILE_TIMEOUT_S:g} s"
    if done.returncode or not made.exists():
        return done.stderr or "the builder wrote nothing"
    made.replace(path)
    return ""


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
    if compiled.returncode == 0 and done.parent.is_dir():
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


def _can_build() -> bool:
    """Return whether there are a C compiler and Python's headers."""
    compiler = (sysconfig.get_config_var("CC") or "cc").split()[0]
    header = Path(sysconfig.get_path("include")) / "Python.h"
    return bool(os.environ.get("CC") or shutil.which(compiler)) and header.exists()


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
