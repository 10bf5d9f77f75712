# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The layout's promises: a core without ROS and without clocks, small files, errors not asserts."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import hapticmech_ros

PACKAGE = Path(hapticmech_ros.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
# Beside the package, and not installed with it.
BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
ALL_FILES = [*FILES, *sorted(BENCHMARKS.rglob("*.py"))]
CORE = (
    *("scene", "mechanism", "operational", "control", "device", "wire", "session", "errors"),
    *("formats", "loading", "plan", "contact", "simulation", "robot"),
)
# Above the core, still without ROS: they run sessions and read files.
TOOLS = ("experiment", "bag", "view")
# Above these: they measure what a scene's loop does, and may start a graph.
STUDIES = ("analysis", "offline")
CLOCKS = {"time", "datetime", "random", "secrets", "uuid", "sched", "timeit"}
# A bag says when it was recorded; that is data, and may be formatted for people.
MAY_SPEAK_OF_DATES = {"bag"}
ROS = {"rclpy", "rosidl_runtime_py", "launch", "launch_ros", "tf2_ros", "ament_index_python"}
MESSAGES = ("_msgs", "_srvs", "_interfaces")
LONGEST_FILE = 500
# REP 2004 asks for a statement of licence and of copyright in every source file.
HEADER = [
    "# Copyright 2026 The hapticmech_ros authors",
    "# SPDX-License-Identifier: Apache-2.0",
]
SOURCES = ("benchmarks", "examples", "hapticmech_ros", "launch", "test")


def part_of(path):
    """Return the first folder or module below the package: ``scene``, ``session``, ``nodes``..."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@cache
def imports(path):
    """Return every module that a file imports, anywhere in it; a relative one by its full name."""
    found = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = ["hapticmech_ros", *path.relative_to(PACKAGE).parts[:-1]]
                kept = package[: len(package) - node.level + 1]
                base = ".".join([*kept, base] if base else kept)
            found |= {base} | {f"{base}.{name.name}" for name in node.names}
    return found


def roots(path):
    return {name.split(".")[0] for name in imports(path)}


def inside(path):
    """Return the parts of the package that a file imports."""
    return {name.split(".")[1] for name in imports(path) if name.startswith("hapticmech_ros.")}


@cache
def called(path):
    """Return every dotted name that is called, such as ``np.random.default_rng``."""
    return {ast.unparse(n.func) for n in ast.walk(tree(path)) if isinstance(n, ast.Call)}


def _name(path):
    folder = PACKAGE if PACKAGE in path.parents else BENCHMARKS.parent
    return str(path.relative_to(folder))


def found(rule, paths):
    """Return by file what breaks a rule."""
    return {_name(path): broken for path in paths if (broken := rule(path))}


QUIET = [path for path in FILES if part_of(path) in CORE + TOOLS]


def test_every_python_file_says_who_wrote_it_and_its_licence():
    root = BENCHMARKS.parent
    inside = (path for name in SOURCES for path in (root / name).rglob("*.py"))
    files = [*root.glob("*.py"), *inside]
    assert len(files) > 900
    bare = []
    for path in files:
        lines = path.read_text(encoding="utf-8").splitlines()
        if lines and lines[lines[0].startswith("#!") :][:2] != HEADER:
            bare.append(path.relative_to(root).as_posix())
    assert not bare


def test_the_walk_sees_the_package():
    seen = {part_of(path) for path in FILES}
    assert set(CORE) <= seen
    assert "rclpy" not in roots(PACKAGE / "session/session.py")
    assert "hapticmech_ros.control" in imports(PACKAGE / "session/loop.py")


def test_only_nodes_import_ros():
    def ros(path):
        return {name for name in roots(path) if name in ROS or name.endswith(MESSAGES)}

    assert found(ros, [path for path in FILES if part_of(path) != "nodes"]) == {}


def test_the_core_knows_no_clock_and_no_chance():
    """Time is an argument, and same inputs must give the same bits."""
    telling = ("time.time", "monotonic", "perf_counter", ".now", ".utcnow", ".today")

    def asked(path):
        allowed = {"datetime"} if part_of(path) in MAY_SPEAK_OF_DATES else set()
        calls = {name for name in called(path) if name.endswith(telling) or "np.random" in name}
        return roots(path) & (CLOCKS - allowed) | calls

    assert found(asked, QUIET) == {}


def test_the_core_does_not_depend_on_what_is_above_it():
    core = [path for path in FILES if part_of(path) in CORE]
    assert found(lambda path: inside(path) & {*TOOLS, *STUDIES, "nodes", "cli"}, core) == {}


def test_the_package_knows_nothing_of_benchmarks_and_tests():
    assert found(lambda path: roots(path) & {"benchmarks", "test", "oracles"}, FILES) == {}


@cache
def graph_of(folder):
    """Return what each module of a package imports of it, by names without the package's.

    A module of a package counts, not the package that it is in: that imports what it offers.
    What is imported by its name as text counts like any other.
    """
    modules = {
        ".".join(path.relative_to(folder.parent).with_suffix("").parts).removesuffix(
            ".__init__"
        ): path
        for path in folder.rglob("*.py")
    }
    found = {}
    for module, path in modules.items():
        names = set()
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Import):
                names |= {name.name for name in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                inner = {f"{node.module}.{name.name}": node.module for name in node.names}
                names |= {name if name in modules else base for name, base in inner.items()}
            elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
                names |= {one.value for one in node.args if isinstance(one, ast.Constant)}
        found[module] = (names & modules.keys()) - {module}
    start = len(folder.name) + 1
    return {name[start:]: {other[start:] for other in seen} for name, seen in found.items()}


def circles(graph):
    """Return the sets of modules of which each imports, over others, itself."""
    reached = {}
    for start in graph:
        seen, ahead = set(), [start]
        while ahead:
            for following in graph[ahead.pop()] - seen:
                seen.add(following)
                ahead.append(following)
        reached[start] = seen
    found = []
    for module, seen in reached.items():
        if module in seen and not any(module in circle for circle in found):
            found.append({other for other in seen if module in reached[other]})
    return found


def test_a_circle_is_seen():
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}
    assert circles(graph) == [{"a", "b", "c"}]


@pytest.mark.parametrize("folder", [PACKAGE, BENCHMARKS], ids=lambda folder: folder.name)
def test_imports_go_one_way(folder):
    graph = graph_of(folder)
    assert sum(map(len, graph.values())) > len(graph)
    assert not circles(graph)


def test_an_import_by_text_is_seen(tmp_path):
    folder = tmp_path / "house"
    folder.mkdir()
    (folder / "a.py").write_text("from house.b import one\n")
    (folder / "b.py").write_text("import importlib\nimportlib.import_module('house.a').one\n")
    assert circles(graph_of(folder)) == [{"a", "b"}]


def test_rooms_know_each_other_one_way():
    rooms = {}
    for module, seen in graph_of(PACKAGE).items():
        room = module.split(".")[0]
        rooms.setdefault(room, set()).update(other.split(".")[0] for other in seen)
    assert not circles({room: (seen & rooms.keys()) - {room} for room, seen in rooms.items()})


# From below: each knows only those before it.
MOTION = ("mechanism", "contact", "simulation", "operational")


def test_what_moves_a_mechanism_is_in_layers():
    def above(path):
        return inside(path) & {*MOTION[MOTION.index(part_of(path)) + 1 :]}

    assert found(above, [path for path in FILES if part_of(path) in MOTION]) == {}


def test_the_model_does_not_depend_on_device_or_control():
    model = [path for path in FILES if part_of(path) in ("scene", *MOTION)]
    assert found(lambda path: inside(path) & {"control", "device", "session", "wire"}, model) == {}


def test_library_errors_are_exceptions_not_asserts():
    def asserts(path):
        return [node.lineno for node in ast.walk(tree(path)) if isinstance(node, ast.Assert)]

    assert found(asserts, ALL_FILES) == {}


def test_files_stay_small():
    def lines(path):
        return len(path.read_text(encoding="utf-8").splitlines())

    assert found(lambda path: lines(path) > LONGEST_FILE, ALL_FILES) == {}


def test_every_module_and_public_name_says_what_it_is():
    def silent(path):
        module = tree(path)
        public = [
            node
            for node in module.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        ]
        return [
            getattr(node, "name", "module")
            for node in (module, *public)
            if not ast.get_docstring(node)
        ]

    assert found(silent, ALL_FILES) == {}


def test_the_core_prints_nothing():
    assert found(lambda path: called(path) & {"print"}, QUIET) == {}


def test_graphs_of_nodes_are_tested_in_the_folders_that_make_collects_them_from():
    folder = Path(__file__).parent
    marked = {
        path.relative_to(folder).parts[0]
        for path in folder.rglob("*.py")
        if re.search(r"pytest\.mark\.(ros|alone)\b", path.read_text(encoding="utf-8"))
    }
    makefile = (folder.parent / "Makefile").read_text(encoding="utf-8")
    named = re.search(r"^GRAPHS := (.*)$", makefile, re.MULTILINE)
    assert marked == {Path(name).name for name in named.group(1).split()}
    assert len(re.findall(r"pytest \$\(GRAPHS\) -m '?(?:ros and not )?alone", makefile)) == 2
