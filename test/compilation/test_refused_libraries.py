# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is not the library as it was written is not loaded, said in one sentence, built anew."""

import gc
import os
import stat

import numpy as np
import pytest

from hapticmech_ros.compilation import library
from hapticmech_ros.compilation.custody import seal_of


def half(path):
    os.truncate(path, path.stat().st_size // 2)


def hole(path):
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 4)
        file.write(bytes(path.stat().st_size // 2))


def one_bit(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def link(path):
    elsewhere = path.with_name("elsewhere.zip")
    path.rename(elsewhere)
    path.symlink_to(elsewhere)


def pipe(path):
    path.unlink()
    os.mkfifo(path)


def other_kernels(path):
    seal = seal_of(path)
    text = seal.read_text()
    seal.write_text(text.replace(path.parent.name, "kernels-0123456789abcdef"))


FAULTS = {
    "half": (half, "bytes, not"),
    "hole": (hole, "has changed"),
    "one bit": (one_bit, "has changed"),
    "empty": (lambda path: os.truncate(path, 0), "0 bytes, not"),
    "group-writable": (lambda path: path.chmod(0o775), "can be written by others (mode 0775)"),
    "world-writable": (lambda path: path.chmod(0o757), "can be written by others (mode 0757)"),
    "link": (link, "is a symbolic link"),
    "pipe": (pipe, "is no regular file"),
    "no seal": (lambda path: seal_of(path).unlink(), ".seal is missing"),
    "half a seal": (lambda path: half(seal_of(path)), ".seal is no seal"),
    "a seal of others": (lambda path: seal_of(path).chmod(0o666), "mode 0666"),
    "a long seal": (lambda path: seal_of(path).write_text("[" * 10**6), ".seal is no seal"),
    "other kernels": (other_kernels, "was made from"),
}


def loaded_well():
    assert library.library().addresses["wire_kernels_stamp_if_sound"]
    return True


def sentences(capfd):
    return [line for line in capfd.readouterr().err.splitlines() if "compiling kernels" not in line]


def test_a_library_as_it_was_written_is_loaded_without_a_word(place, builds, capfd):
    assert loaded_well()
    assert sentences(capfd) == []
    assert builds == []


@pytest.mark.parametrize("name", FAULTS)
def test_a_library_that_is_not_as_it_was_written_is_built_anew(name, place, builds, capfd):
    spoil, words = FAULTS[name]
    spoil(place)
    assert loaded_well()
    told = sentences(capfd)
    assert len(told) == 1, told
    assert words in told[0]
    assert str(place) in told[0]
    assert len(builds) == 1
    library.library.cache_clear()
    # And is well from then on.
    assert loaded_well()
    assert sentences(capfd) == []
    assert len(builds) == 1


@pytest.mark.parametrize("which", ["library", "seal"])
def test_the_library_of_another_user_is_not_loaded(which, place, builds, foreign, capfd):
    foreign(place if which == "library" else seal_of(place))
    library.library()
    assert "belongs to user" in sentences(capfd)[0]
    # Where the file could be given away, and so can be made anew.
    assert len(builds) == (os.geteuid() == 0)


def test_the_folder_of_another_user_is_not_used(place, builds, foreign, capfd):
    foreign(place.parent)
    before = place.read_bytes()
    assert loaded_well()
    (told,) = sentences(capfd)
    assert "belongs to user" in told
    assert "NUMBA_CACHE_DIR" in told
    # For this process alone.
    assert len(builds) == 1
    assert place.read_bytes() == before


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o1777])
def test_what_is_in_a_folder_that_others_can_write_is_given_up(mode, place, builds, capfd):
    planted = place.with_name("planted")
    planted.write_text("")
    place.parent.chmod(mode)
    assert loaded_well()
    (told,) = sentences(capfd)
    assert f"mode {mode:04o}" in told
    assert len(builds) == 1
    assert stat.S_IMODE(place.parent.stat().st_mode) == 0o755
    assert not planted.exists()
    assert [path.name for path in place.parent.parent.iterdir()] == [place.parent.name]


@pytest.mark.parametrize(("mode", "safe"), [(0o777, False), (0o1777, True), (0o755, True)])
def test_names_above_must_be_safe_from_others(mode, safe, place, builds, alone, capfd):
    alone.chmod(mode)
    assert loaded_well()
    told = sentences(capfd)
    assert len(told) == len(builds) == (not safe)
    assert all(f"{alone} can be written by others (mode 0777)" in line for line in told)


def test_a_folder_that_is_a_link_is_not_used(place, builds, capfd):
    elsewhere = place.parent.with_name("elsewhere")
    place.parent.rename(elsewhere)
    place.parent.symlink_to(elsewhere)
    assert loaded_well()
    assert "is no folder of its own" in sentences(capfd)[0]
    assert len(builds) == 1


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077])
def test_what_is_built_can_be_written_by_its_user_alone(umask, good, alone, builds):
    before = os.umask(umask)
    try:
        assert loaded_well()
    finally:
        os.umask(before)
    kept = [library.library_path(), seal_of(library.library_path()), library.library_path().parent]
    assert not any(path.stat().st_mode & 0o022 for path in kept)
    library.library.cache_clear()
    assert loaded_well()
    assert len(builds) == 1


def test_kernels_outlive_the_library_that_they_came_from(place, builds):
    found = library.function_of(
        "wire_kernels_stamp_if_sound", "int64(float64[::1], float64[::1], int64, float64)", half
    )
    library.library.cache_clear()
    gc.collect()
    # Others take the place in memory, if it is free.
    others = [library._loaded(place.read_bytes()) for _ in range(3)]
    values = np.array([3.0, 7.0])
    assert found(values, np.full(2, 10.0), -1, 1e-6) == 3_000_000_007
    assert len(others) == 3
