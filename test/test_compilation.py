"""Where compiled kernels are kept, and that a change in any of their files is seen."""

import ast
import subprocess
from pathlib import Path

import numba
import pytest

import hapticmech_ros
from hapticmech_ros import kernel_cache
from hapticmech_ros.compilation import kernel

PACKAGE = Path(hapticmech_ros.__file__).parent


def doubled(x: float) -> float:
    return 2.0 * x


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return tmp_path


def test_kernels_are_kept_in_the_folder_that_was_chosen(folder):
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0
    kept = list(folder.rglob("*doubled*.nbi"))
    assert len(kept) == 1
    assert kept[0].relative_to(folder).parts[0].startswith("kernels-")
    assert str(folder) == numba.config.CACHE_DIR


def test_a_second_start_compiles_nothing(folder):
    first = kernel("float64(float64)")(doubled)
    second = kernel("float64(float64)")(doubled)
    assert sum(first.stats.cache_misses.values()) == 1
    assert sum(second.stats.cache_hits.values()) == 1
    assert not second.stats.cache_misses


def test_another_content_has_another_folder(folder, monkeypatch):
    kernel("float64(float64)")(doubled)
    monkeypatch.setattr(kernel_cache, "_FINGERPRINT", "0" * 16)
    assert kernel("float64(float64)")(doubled).stats.cache_misses
    assert len(list(folder.iterdir())) == 2


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "file"))
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0


def test_without_any_folder_kernels_are_compiled_each_time(monkeypatch, folder):
    def no_folder(self, path):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(numba.core.caching.FunctionCache, "__init__", no_folder)
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0


def test_the_users_folder_is_the_default(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert kernel_cache.folder().parent == tmp_path / "hapticmech_ros"


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
        if decorators(module) & {"inner", "kernel"}:
            parts.add(path.relative_to(PACKAGE).as_posix())
            names = {n.module for n in ast.walk(module) if isinstance(n, ast.ImportFrom)}
            own = {name.split(".", 1)[1] for name in names if name.startswith("hapticmech_ros.")}
            parts |= {name.replace(".", "/") + ".py" for name in own}
    # The model gives kernels nothing but the name of a type.
    assert parts - {"mechanism/model.py"} == set(kernel_cache._SOURCES)


def test_compiling_ahead_is_done_once(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    started = []

    def run(command, **options):
        started.append(command)
        kernel_cache.folder(str(tmp_path)).mkdir(exist_ok=True)
        return subprocess.CompletedProcess(command, len(started) == 1)

    monkeypatch.setattr(kernel_cache.subprocess, "run", run)
    kernel_cache.compile_ahead()
    # The first one failed, so it is tried again; the second is remembered.
    kernel_cache.compile_ahead()
    kernel_cache.compile_ahead()
    assert len(started) == 2
