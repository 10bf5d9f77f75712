# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels: what they may do, what is compiled of them, and that a change in any file is seen."""

import ast
from pathlib import Path

import numpy as np
import pytest

import hapticmech_ros
from commands import printed_by
from hapticmech_ros.compilation import (
    Part,
    Size,
    Structure,
    arrays_of,
    cache,
    kernel,
    library,
    local,
    local_whole,
    put,
    shaped,
)
from hapticmech_ros.compilation.builder import BuildError, compiled, packed
from hapticmech_ros.compilation.decorators import Kernel
from hapticmech_ros.compilation.library import LibraryError
from hapticmech_ros.compilation.records import Number, Record, Vector

PACKAGE = Path(hapticmech_ros.__file__).parent


def tried(numbers, whole, factor, order):
    """Use everything that kernels have beside arithmetic."""
    room, places = shaped(local(6), (2, 3)), local_whole(3)
    wide = local(numbers.size)
    put(wide, numbers)
    for i in range(3):
        # Room of a size that is written out, in a loop, is the same room.
        again = local(2)
        again[0] = float(i)
        places[i] = whole[i] + 1
        room[0, i], room[1, i] = wide[i], again[0]
    total = 0.0
    for i in range(3):
        total += factor * room[0, places[i]] + 10.0 * room[1, i] + 100.0 * order[1, i]
    return total


SIGNATURE = "float64(float64[::1], int64[::1], float64, float64[::1,:])"


def arguments():
    order = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    return np.array([1.0, 2.0, 4.0, 8.0]), np.array([0, 1, -1]), 0.5, order


def found(*kernels):
    """Return kernels compiled, loaded, and found in the library."""
    content = packed({one.name: compiled(one, "host") for one in kernels})
    loaded = library._loaded(library._unpacked(content))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(library, "library", lambda: loaded)
        return [
            library.function_of(one.name, one.signature, one.function, gathered=one.gathered)
            for one in kernels
        ]


@pytest.fixture(scope="module")
def made():
    """Return a function as a kernel."""
    return found(Kernel("tried", SIGNATURE, tried))[0]


def test_a_kernel_does_what_its_function_does(made):
    assert made(*arguments()) == tried(*arguments()) == 0.5 * 7.0 + 30.0 + 1200.0
    assert made.__name__ == "tried"
    assert made.__doc__ == tried.__doc__


def test_arrays_and_numbers_are_looked_at_when_asked_to(made, monkeypatch):
    monkeypatch.setenv("HAPTICMECH_ROS_KERNELS", "checked")
    loaded = library.Library({"tried": 0}, None)
    monkeypatch.setattr(library, "library", lambda: loaded)
    checked = library.function_of("tried", SIGNATURE, tried)
    numbers, whole, factor, order = arguments()
    for number, wrong in (
        (0, numbers.astype(np.float32)),
        (0, numbers[::2]),
        (0, numbers.reshape(2, 2)),
        (0, numbers.tolist()),
        (1, numbers),
        (3, np.ascontiguousarray(order)),
    ):
        given = [numbers, whole, factor, order]
        given[number] = wrong
        with pytest.raises(LibraryError, match=f"tried: argument {number} must be"):
            checked(*given)


def added(numbers, whole):
    return numbers.sum() + 10.0 * whole[0]


def test_arguments_may_come_in_one_array(monkeypatch):
    kernel = Kernel("added", "float64(float64[::1], int64[::1])", added, gathered=True)
    gathered = np.empty(2, dtype=object)
    gathered[0], gathered[1] = np.array([1.0, 2.0, 4.0]), np.array([3, 5])
    (plain,) = found(kernel)
    assert plain(gathered) == 37.0
    gathered[1] = np.array([7])
    assert plain(gathered) == 77.0
    monkeypatch.setenv("HAPTICMECH_ROS_KERNELS", "checked")
    (checked,) = found(kernel)
    assert checked(gathered) == 77.0
    gathered[1] = np.array([7.0])
    with pytest.raises(LibraryError, match="added: argument 1 must be"):
        checked(gathered)


class Pulled(Record):
    """A record, and one with more behind."""

    force, place = Number(), Vector(2)


class Sprung(Pulled):
    rate = Number()


class Table(Structure):
    __slots__ = ()
    rows, weights = Size(), Part(1)


def pulled(one, table, by):
    one.place[1] += by
    table.weights[1] = one.force
    return one.force * by + table.rows


def test_records_and_structures_are_arguments(monkeypatch):
    from hapticmech_ros.compilation.numba_types import teach_record, teach_structure

    teach_record(Pulled)
    teach_structure(Table)
    kernel = Kernel("pulled", "float64(Pulled, Table, float64)", pulled)
    left = []
    for function in (pulled, *found(kernel)):
        # In the middle of an array, and of a class below.
        one = Sprung(np.arange(9.0)[2:])
        table = Table(*arrays_of(Table, {"rows": 7}, {"weights": np.ones(3)}))
        left.append((function(one, table, 0.5), one.values.tolist(), table.data.tolist()))
    assert left[0] == left[1] == (8.0, [2.0, 3.0, 4.5, 5.0], [1.0, 2.0, 1.0])
    monkeypatch.setenv("HAPTICMECH_ROS_KERNELS", "checked")
    (checked,) = found(kernel)
    assert checked(one, table, 0.5) == 8.0
    for number, given in enumerate(((one.values, table, 0.5), (one, one, 0.5))):
        with pytest.raises(LibraryError, match=f"pulled: argument {number} must be"):
            checked(*given)


def allocates(numbers):
    return np.empty(numbers.size)[0]


def raises(numbers):
    numbers[:2] = numbers[1:]
    return numbers[0]


@pytest.mark.parametrize("function", [allocates, raises])
def test_a_kernel_that_allocates_or_may_raise_is_not_built(function):
    with pytest.raises(BuildError, match=f"kernel {function.__name__} allocates or may raise"):
        compiled(Kernel(function.__name__, "float64(float64[::1])", function), "host")


def scaled(number, factor):
    return factor * number


def test_what_a_kernel_calls_is_translated_for_each_combination_of_types():
    from hapticmech_ros.compilation.inner_functions import translated

    inner, outer = (
        translated(scaled),
        translated(lambda x, n: inner(factor=n, number=x) + inner(n, 3)),
    )
    signature = "float64(float64, int64)"
    (calling,) = found(Kernel("calling", signature, lambda x, n: outer(x, n) + inner(x, 0.25)))
    assert calling(0.5, 7) == 0.5 * 7 + 7 * 3 + 0.5 * 0.25


def summed(numbers):
    return numbers[0] + numbers[1] * numbers[2]


def test_a_linked_kernel_is_called_by_others_and_contained_in_none():
    from hapticmech_ros.compilation.inner_functions import called_by_name

    signature = "float64(float64[::1])"
    linked = called_by_name(summed, "summed", signature)

    def twice(numbers):
        numbers[0] = linked(numbers)
        return linked(numbers[1:]) + linked(numbers)

    one, other = found(Kernel("summed", signature, summed, True), Kernel("twice", signature, twice))
    numbers = np.array([1.0, 2.0, 3.0, 4.0])
    assert one(numbers) == 7.0
    assert other(numbers) == 14.0 + 13.0
    assert numbers[0] == 7.0


@pytest.mark.parametrize("in_place", [False, True])
@pytest.mark.parametrize("function", [allocates, raises])
def test_neither_may_what_a_kernel_calls(function, in_place):
    from hapticmech_ros.compilation.inner_functions import translated

    inner = translated(function, in_place)
    calling = Kernel("calling", "float64(float64[::1])", lambda numbers: inner(numbers) + 1.0)
    with pytest.raises(BuildError, match="kernel calling allocates or may raise"):
        compiled(calling, "host")


def test_what_is_not_in_the_library_is_told():
    with pytest.raises(LibraryError, match=r"no kernel .*tried in the library"):
        kernel(SIGNATURE)(tried)


def test_the_same_kernel_makes_the_same_file():
    parts = {"b": b"2", "a": b"1"}
    assert packed(parts) == packed(dict(reversed(parts.items())))


def test_the_users_folder_is_the_default(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder().parent == tmp_path / "hapticmech_ros"


PROCESS = """
import sys
import numpy as np
from hapticmech_ros.wire.kernels import sound_stamp
values = np.zeros(27)
values[0], values[1], values[5] = 3.0, 7.0, 1.0
print(sound_stamp(values, np.full(27, 10.0), 5, 1e-6), "numba" in sys.modules)
"""


@pytest.mark.parametrize("kernels", ["library", "checked"])
def test_the_library_needs_no_numba(monkeypatch, kernels):
    library.compile_ahead()
    monkeypatch.setenv("HAPTICMECH_ROS_KERNELS", kernels)
    assert printed_by("-c", PROCESS).split() == ["3000000007", "False"]


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
    # Builder and decorators say how; numerics gives kernels nothing but the name of a type.
    how = ("arrays", "builder", "decorators", "inner_functions", "numba_types", "structures")
    parts |= {f"compilation/{name}.py" for name in how}
    assert parts - {"numerics.py", "compilation.py"} == set(cache._SOURCES)
