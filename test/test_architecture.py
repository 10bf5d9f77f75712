"""The layout's promises: a core without ROS and without clocks, small files, errors not asserts."""

import ast
from pathlib import Path

import pytest

import hapticmech_ros

PACKAGE = Path(hapticmech_ros.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
CORE = (
    *("scene", "mechanism", "operational", "control", "device", "wire", "session", "errors"),
    *("formats", "plan", "contact", "simulation"),
)
# Above the core, still without ROS: they run sessions and read files.
TOOLS = ("experiment", "bag", "view")
CLOCKS = {"time", "datetime", "random", "secrets", "uuid", "sched", "timeit"}
# A bag says when it was recorded; that is data, and may be formatted for people.
MAY_SPEAK_OF_DATES = {"bag"}
ROS = {"rclpy", "rosidl_runtime_py", "launch", "launch_ros", "tf2_ros", "ament_index_python"}
MESSAGES = ("_msgs", "_srvs", "_interfaces")
LONGEST_FILE = 400


def part_of(path):
    """Return the first folder or module below the package: ``scene``, ``session``, ``nodes``..."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


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


def called(path):
    """Return every dotted name that is called, such as ``np.random.default_rng``."""
    return {ast.unparse(n.func) for n in ast.walk(tree(path)) if isinstance(n, ast.Call)}


def named(paths):
    return pytest.mark.parametrize("path", paths, ids=lambda p: str(p.relative_to(PACKAGE)))


QUIET = [path for path in FILES if part_of(path) in CORE + TOOLS]


def test_the_walk_sees_the_package():
    seen = {part_of(path) for path in FILES}
    assert set(CORE) <= seen
    assert "rclpy" not in roots(PACKAGE / "session.py")
    assert "hapticmech_ros.control" in imports(PACKAGE / "session.py")


@named(FILES)
def test_only_nodes_import_ros(path):
    if part_of(path) == "nodes":
        return
    ros = {name for name in roots(path) if name in ROS or name.endswith(MESSAGES)}
    assert not ros, f"{sorted(ros)}: only nodes/ may import ROS"


@named(QUIET)
def test_the_core_knows_no_clock_and_no_chance(path):
    allowed = {"datetime"} if part_of(path) in MAY_SPEAK_OF_DATES else set()
    clocks = roots(path) & (CLOCKS - allowed)
    assert not clocks, f"{sorted(clocks)}: time is an argument"
    telling = ("time.time", "monotonic", "perf_counter", ".now", ".utcnow", ".today")
    asked = {name for name in called(path) if name.endswith(telling) or "np.random" in name}
    assert not asked, f"{sorted(asked)}: same inputs must give the same bits"


@named([path for path in FILES if part_of(path) in CORE])
def test_the_core_does_not_depend_on_what_is_above_it(path):
    inside = {name.split(".")[1] for name in imports(path) if name.startswith("hapticmech_ros.")}
    assert not inside & {*TOOLS, "nodes", "cli"}


# From below: each knows only those before it.
MOTION = ("mechanism", "contact", "simulation", "operational")


@named([path for path in FILES if part_of(path) in MOTION])
def test_what_moves_a_mechanism_is_in_layers(path):
    inside = {name.split(".")[1] for name in imports(path) if name.startswith("hapticmech_ros.")}
    assert not inside & {*MOTION[MOTION.index(part_of(path)) + 1 :]}


@named([path for path in FILES if part_of(path) in ("scene", *MOTION)])
def test_the_model_does_not_depend_on_device_or_control(path):
    inside = {name.split(".")[1] for name in imports(path) if name.startswith("hapticmech_ros.")}
    assert not inside & {"control", "device", "session", "wire"}


@named(FILES)
def test_library_errors_are_exceptions_not_asserts(path):
    lines = [node.lineno for node in ast.walk(tree(path)) if isinstance(node, ast.Assert)]
    assert not lines


@named(FILES)
def test_files_stay_small(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST_FILE


@named(FILES)
def test_every_module_and_public_name_says_what_it_is(path):
    module = tree(path)
    assert ast.get_docstring(module)
    public = [
        node
        for node in module.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
    ]
    silent = [node.name for node in public if not ast.get_docstring(node)]
    assert not silent


@named(QUIET)
def test_the_core_prints_nothing(path):
    assert "print" not in called(path)
