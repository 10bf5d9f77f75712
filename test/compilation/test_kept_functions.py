"""What Numba compiled earlier is run only as it was written."""

import os

import pytest

from hapticmech_ros.compilation import custody, kernel


def doubled(x: float) -> float:
    return 2.0 * x


@pytest.fixture(autouse=True)
def without_library(monkeypatch):
    monkeypatch.setenv("HAPTICMECH_ROS_KERNELS", "jit")


@pytest.fixture
def kept(alone):
    """Return the file of a function that was compiled and kept."""
    assert kernel("float64(float64)")(doubled)(3.0) == 6.0
    (file,) = alone.rglob("*doubled*.kernel")
    return file


def again():
    """Return whether the function had to be compiled once more; it works in any case."""
    found = kernel("float64(float64)")(doubled)
    assert found(3.0) == 6.0
    return bool(found.stats.cache_misses)


def test_what_is_kept_is_not_compiled_again(kept):
    assert not again()


def test_half_a_file_or_a_hole_or_an_empty_file_is_compiled_again(kept):
    whole = kept.read_bytes()
    middle = len(whole) // 2
    holed = whole[:middle] + bytes(64) + whole[middle + 64 :]
    for content in (whole[:middle], holed, b"", whole[:40], whole + b"\0"):
        kept.write_bytes(content)
        assert again()
        assert not again()


def test_what_others_could_have_written_is_compiled_again(kept):
    kept.chmod(0o666)
    assert again()
    assert not again()


def test_a_disk_that_is_full_means_to_compile_again(alone, monkeypatch):
    def full(self, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hapticmech_ros.compilation.kept.Path.write_bytes", full)
    assert again()
    assert not list(alone.rglob("*.kernel*"))


def test_nothing_is_kept_where_others_can_write(alone, capfd):
    alone.chmod(0o777)
    assert again()
    assert again()
    assert os.listdir(alone) == []  # noqa: PTH208
    assert custody.is_safe.cache_info().hits == 1
    assert capfd.readouterr().err.count("can be written by others") == 1
