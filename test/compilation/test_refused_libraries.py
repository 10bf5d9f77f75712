# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What others could have written, or is damaged, is not loaded but built anew; and that is said."""

import gc
import os

import numpy as np
import pytest

from hapticmech_ros.compilation import library
from hapticmech_ros.compilation.cache import IDENTITY, put_in_place, read_own
from hapticmech_ros.compilation.library import LibraryError


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


def count(path):
    """Change how many kernels the archive says that it has: its own checksums do not cover that."""
    content = bytearray(path.read_bytes())
    content[-12] ^= 1
    path.write_bytes(content)


def other_kernels(path):
    place = path.parent.with_name("kernels-0123456789abcdef") / path.name
    place.parent.mkdir()
    put_in_place(read_own(path), place, place.with_name("made"))
    place.replace(path)


def link(path):
    elsewhere = path.with_name("elsewhere.zip")
    path.rename(elsewhere)
    path.symlink_to(elsewhere)


def pipe(path):
    path.unlink()
    os.mkfifo(path)


FAULTS = {
    "half": (half, "damaged"),
    "hole": (hole, "damaged"),
    "one bit": (one_bit, "damaged"),
    "count": (count, "damaged"),
    "other kernels": (other_kernels, "of other kernels"),
    "empty": (lambda path: os.truncate(path, 0), "damaged"),
    "group-writable": (lambda path: path.chmod(0o775), "can be written by others (mode 0775)"),
    "world-writable": (lambda path: path.chmod(0o757), "can be written by others (mode 0757)"),
    "link": (link, "symbolic link"),
    "pipe": (pipe, "is no regular file"),
}


def loaded_well():
    assert library.library().addresses["wire_kernels_sound_stamp"]
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


@pytest.fixture
def shipped(good, monkeypatch, tmp_path):
    """Return where the library is that came with the package: the good one."""
    path = tmp_path / "shipped.zip"
    path.write_bytes(read_own(good))
    monkeypatch.setattr(library, "SHIPPED", path)
    return path


def test_the_library_of_the_package_is_loaded_and_nothing_built_or_kept(
    shipped, alone, builds, capfd
):
    assert loaded_well()
    assert capfd.readouterr().err == ""
    assert builds == []
    assert list(alone.iterdir()) == [shipped]


def other_identity(path):
    content = path.read_bytes()
    path.write_bytes(content.replace(IDENTITY, IDENTITY[::-1]))


@pytest.mark.parametrize("unfit", ["kernels", "processor"])
def test_where_the_library_of_the_package_does_not_fit_one_is_built(
    unfit, shipped, alone, builds, monkeypatch
):
    if unfit == "kernels":
        other_identity(shipped)
    else:
        monkeypatch.setattr(library, "_OF_X86_64_V3", ("no such feature",))
    assert loaded_well()
    assert len(builds) == 1


def test_a_damaged_library_of_the_package_is_refused(shipped, alone, builds):
    one_bit(shipped)
    with pytest.raises(LibraryError, match=r"shipped\.zip: .*: install the package again"):
        library.library()
    assert builds == []


def test_the_library_of_another_user_is_not_loaded(place, builds, foreign, capfd):
    foreign(place)
    library.library()
    assert "belongs to user" in sentences(capfd)[0]
    # Where the file could be given away, and so can be made anew.
    assert len(builds) == (os.geteuid() == 0)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (None, "belongs to user"),
        (lambda path: path.chmod(0o777), "mode 0777"),
        (lambda path: path.chmod(0o775), "mode 0775"),
        (lambda path: path.chmod(0o1777), "mode 1777"),
        (link, "is no folder, but a link to one"),
    ],
    ids=["another user's", "0777", "0775", "1777", "link"],
)
def test_a_folder_that_others_could_have_changed_is_not_used(
    spoil, words, place, builds, foreign, capfd
):
    (spoil or foreign)(place.parent)
    before = place.read_bytes()
    assert loaded_well()
    (told,) = sentences(capfd)
    assert words in told
    assert "NUMBA_CACHE_DIR" in told
    # For this process alone.
    assert len(builds) == 1
    assert place.read_bytes() == before


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077])
def test_what_is_built_can_be_written_by_its_user_alone(umask, good, alone, builds):
    before = os.umask(umask)
    try:
        assert loaded_well()
    finally:
        os.umask(before)
    kept = [library.library_path(), library.library_path().parent]
    assert not any(path.stat().st_mode & 0o022 for path in kept)
    library.library.cache_clear()
    assert loaded_well()
    assert len(builds) == 1


def test_kernels_outlive_the_library_that_they_came_from(place, builds):
    found = library.function_of(
        "wire_kernels_sound_stamp", "int64(float64[::1], float64[::1], int64, float64)", half
    )
    library.library.cache_clear()
    gc.collect()
    # Others take the place in memory, if it is free.
    others = [library._loaded(library._unpacked(read_own(place))) for _ in range(3)]
    values = np.array([3.0, 7.0])
    assert found(values, np.full(2, 10.0), -1, 1e-6) == 3_000_000_007
    assert len(others) == 3
