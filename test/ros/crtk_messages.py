# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CRTK's own messages, built from their definitions: ``crtk_msgs`` is not on PyPI.

The generators, headers and libraries of ROS 2 are those of the wheels; a C++ compiler and the
headers of Python are needed. What comes out is what an installed ``crtk_msgs`` is to rclpy: the
same classes, type supports of C for Fast DDS and for introspection, and type hashes.
"""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from importlib import import_module
from pathlib import Path

import numpy as np

PACKAGE = "crtk_msgs"
# The two of the convention that this package speaks.
DEFINITIONS = {
    "OperatingState": "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    "StringStamped": "std_msgs/Header header\nstring string\n",
}
# What rosidl makes, by the class that makes it; a dispatcher loads the second and third by name.
GENERATORS = {
    "rosidl_generator_c": "GenerateC",
    "rosidl_typesupport_fastrtps_c": "GenerateFastRTPSCTypesupport",
    "rosidl_typesupport_introspection_c": "GenerateIntrospectionCTypesupport",
    "rosidl_typesupport_c": "GenerateCTypesupport",
}
BY_NAME = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
NEEDED = ("std_msgs", "builtin_interfaces")
PREFIX = Path(sys.prefix)


def build(folder: Path) -> Path:
    """Build ``crtk_msgs`` below a folder, and return what to put on PYTHONPATH.

    The environment variable AMENT_PREFIX_PATH has to name the prefix of the wheels.
    """
    for name, text in DEFINITIONS.items():
        path = folder / "msg" / f"{name}.msg"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    files = [f"{folder}:msg/{name}.msg" for name in DEFINITIONS]
    search = [str(PREFIX / "share")]
    for generator, kind in GENERATORS.items():
        made = getattr(import_module(f"{generator}.cli"), kind)(generator)
        made.generate(PACKAGE, files, search, output_path=folder / generator / PACKAGE)
    python = folder / "python" / PACKAGE
    made = import_module("rosidl_generator_py.cli").GeneratePython(
        "py", typesupport_implementations=["rosidl_typesupport_c"]
    )
    made.generate(PACKAGE, files, search, output_path=python)
    _compile(folder, python)
    return python.parent


def _compile(folder: Path, python: Path) -> None:
    """Compile two libraries that are loaded by name, and the module that knows all."""
    roots = [folder / generator for generator in GENERATORS]
    include = [*roots, *(path for path in (PREFIX / "include").iterdir() if path.is_dir())]
    include += [PREFIX / "include", Path(sysconfig.get_path("include")), Path(np.get_include())]
    flags = ["-O0", "-fPIC", "-shared", "-w", "-Wl,--no-as-needed"]
    flags += [f"-I{path}" for path in include]
    libraries = ["rosidl_runtime_c", "rosidl_typesupport_c", "rcutils", "fastcdr", *BY_NAME]
    libraries += ["rosidl_typesupport_fastrtps_cpp"]
    for package in NEEDED:
        kinds = ("rosidl_generator_c", "rosidl_generator_py", "rosidl_typesupport_c", *BY_NAME)
        libraries += [f"{package}__{kind}" for kind in kinds]
    link = [f"-L{PREFIX / 'lib'}", f"-Wl,-rpath,{PREFIX / 'lib'}", "-Wl,-rpath,$ORIGIN"]
    link += [f"-l{name}" for name in libraries]
    structures = _objects(folder / "rosidl_generator_c", flags)
    built: list[Path] = []
    for name in BY_NAME:
        library = python / f"lib{PACKAGE}__{name}.so"
        sources = [*_objects(folder / name, flags), *([] if built else structures)]
        named = f"-Wl,-soname,{library.name}"
        _run("g++", *flags, named, "-o", library, *sources, *built, *link)
        built.append(library)
    module = python / f"{PACKAGE}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    sources = [*_objects(folder / "rosidl_typesupport_c", flags), *_objects(python, flags)]
    _run("g++", *flags, "-o", module, *sources, *built, *link)


def _objects(folder: Path, flags: list[str]) -> list[Path]:
    """Compile what is in a folder, C as C, and return the objects."""
    made = []
    for source in (*folder.rglob("*.c"), *folder.rglob("*.cpp")):
        compiler = "gcc" if source.suffix == ".c" else "g++"
        made.append(source.with_suffix(".o"))
        _run(compiler, *(flag for flag in flags if flag != "-shared"), "-c", source, "-o", made[-1])
    return made


def _run(*command: str | Path) -> None:
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
