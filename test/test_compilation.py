"""Where compiled kernels are kept, and that a change in any of their files is seen."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import hapticmech_ros
from hapticmech_ros.compilation import attempt, cache, custody, kernel, library
from hapticmech_ros.compilation.sealed import put_in_place

PACKAGE = Path(hapticmech_ros.__file__).parent


def doubled(x: float) -> float:
    return 2.0 * x


@pytest.fixture
def folder(tmp_path, monkeypatch):
    # Loaded before, it is not built once more in the folder.
    library.library()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def alone(folder, monkeypatch):
    """Let every question for the library be asked anew, in a folder of its own."""
    library.library.cache_clear()
    custody.is_safe.cache_clear()
    yield folder
    library.library.cache_clear()


def refuse(command, **options):
    raise AssertionError(f"nothing must be started, but: {command}")


def test_what_is_not_in_the_library_is_kept_in_the_folder_that_was_chosen(folder):
    numba.config.reload_config()
    chosen = numba.config.CACHE_DIR
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0
    kept = list(folder.rglob("*doubled*.kernel"))
    assert len(kept) == 1
    assert kept[0].relative_to(folder).parts[0].startswith("kernels-")
    assert chosen == numba.config.CACHE_DIR


def test_a_second_start_compiles_nothing(folder):
    first = kernel("float64(float64)")(doubled)
    second = kernel("float64(float64)")(doubled)
    assert sum(first.stats.cache_misses.values()) == 1
    assert sum(second.stats.cache_hits.values()) == 1
    assert not second.stats.cache_misses


def test_another_content_has_another_folder(folder, monkeypatch):
    kernel("float64(float64)")(doubled)
    monkeypatch.setattr(cache, "_FINGERPRINT", "0" * 16)
    assert kernel("float64(float64)")(doubled).stats.cache_misses
    assert len(list(folder.iterdir())) == 2


def test_a_folder_that_cannot_be_written_is_no_error(alone, monkeypatch, capfd):
    (alone / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(alone / "file"))
    assert library.library() is None
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0


def test_without_any_folder_kernels_are_compiled_each_time(monkeypatch, folder):
    def no_folder(self, path):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(numba.core.caching.FunctionCache, "__init__", no_folder)
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0


def test_the_users_folder_is_the_default(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder().parent == tmp_path / "hapticmech_ros"


PROCESS = """
import os, sys
import numpy as np
from hapticmech_ros.wire.kernels import stamp_if_sound
from hapticmech_ros.saturation_kernels import limit
values = np.zeros(27)
values[0], values[1], values[5] = 3.0, 7.0, 1.0
stamp = stamp_if_sound(values, np.full(27, 10.0), 5, 1e-6)
print(stamp, "numba" in sys.modules, type(limit).__name__)
"""


def in_process(kernels):
    done = subprocess.run(
        [sys.executable, "-c", PROCESS],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "HAPTICMECH_ROS_KERNELS": kernels},
        timeout=120.0,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_the_library_needs_no_numba_and_gives_what_numba_gives():
    library.compile_ahead()
    if library.library() is None:
        pytest.skip("no compiler or headers here: the library cannot be built")
    assert in_process("library") == ["3000000007", "False", "function"]
    assert in_process("jit") == ["3000000007", "True", "CPUDispatcher"]


def test_who_waited_for_a_build_that_failed_does_not_repeat_it(alone, monkeypatch):
    failed = library.library_path().with_suffix(".failed")
    # Another process holds the lock, and fails meanwhile.
    monkeypatch.setattr(
        library.fcntl, "flock", lambda lock, kind: attempt.remember(failed, "no", 600.0)
    )
    monkeypatch.setattr(library.subprocess, "run", refuse)
    assert library.library() is None


def test_a_build_that_hangs_is_given_up(alone, monkeypatch):
    def run(command, **options):
        raise subprocess.TimeoutExpired(command, options["timeout"])

    monkeypatch.setattr(library.subprocess, "run", run)
    assert library.library() is None
    assert "not done" in library.library_path().with_suffix(".failed").read_text()


def test_a_library_that_cannot_be_loaded_is_told(alone, monkeypatch, capfd):
    path = library.library_path()
    path.parent.mkdir(parents=True)
    made = path.with_name("made")
    made.write_bytes(b"this is no library")
    put_in_place(made, path, library._origin(path))
    assert library.library() is None
    assert str(path) in capfd.readouterr().err


def decorators(module):
    """Return the names of all decorators of functions in a module's tree."""
    return {
        ast.unparse(decorator).split("(")[0]
        for node in ast.walk(module)
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
    }


def test_every_file_that_becomes_part_of_a_kernel_counts():
    parts = set()
    for path in PACKAGE.rglob("*.py"):
        module = ast.parse(path.read_text(encoding="utf-8"))
        if decorators(module) & {"inner", "kernel", "leaf", "structure"}:
            parts.add(path.relative_to(PACKAGE).as_posix())
            names = {n.module for n in ast.walk(module) if isinstance(n, ast.ImportFrom)}
            own = {name.split(".", 1)[1] for name in names if name.startswith("hapticmech_ros.")}
            parts |= {name.replace(".", "/") + ".py" for name in own}
    # Builder and decorators say how; the model gives kernels nothing but the name of a type.
    parts |= {f"compilation/{name}.py" for name in ("builder", "decorators", "structures")}
    assert parts - {"mechanism/model.py", "compilation.py"} == set(cache._SOURCES)


def test_compiling_ahead_without_a_library_is_done_once(folder, monkeypatch):
    monkeypatch.setenv("HAPTICMECH_ROS_KERNELS", "jit")
    started = []

    def run(command, **options):
        started.append(command)
        cache.folder().mkdir(exist_ok=True)
        return subprocess.CompletedProcess(command, len(started) == 1)

    monkeypatch.setattr(library.subprocess, "run", run)
    library.compile_ahead()
    # The first one failed, so it is tried again; the second is remembered.
    library.compile_ahead()
    library.compile_ahead()
    assert len(started) == 2
