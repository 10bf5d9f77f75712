"""Compiles all kernels into one library: ``python -m hapticmech_ros.compilation.builder FILE``."""

from __future__ import annotations

import importlib
import os
import sys
import warnings
from pathlib import Path
from typing import Any

from hapticmech_ros.compilation import decorators
from hapticmech_ros.compilation.library import MODULE

# Import every kernel, directly or not.
_HOMES = ("mechanism.compiled.stepping", "operational.compiled", "control.compiled")
_MORE_HOMES = ("device.compiled", "wire.readings", "contact.search", "contact.stepping")


def import_all() -> None:
    """Import all modules with kernels."""
    for name in _HOMES + _MORE_HOMES:
        importlib.import_module(f"hapticmech_ros.{name}")


def build(path: Path, target: str) -> None:
    """Write the library.

    Args:
        path: file to be written.
        target: processor to compile for, as LLVM calls it; ``host``: this one.
    """
    kernels = decorators.collect()
    import_all()
    warnings.simplefilter("ignore")
    compiler: Any = importlib.import_module("numba.pycc.compiler")
    pycc: Any = importlib.import_module("numba.pycc")
    flags = compiler.Flags

    def with_options() -> Any:
        # pycc knows no options: division by zero would raise, and the check for it cost time.
        made = flags()
        for name, value in decorators.OPTIONS.items():
            setattr(made, name, value)
        return made

    library = pycc.CC(MODULE)
    library.output_dir, library.output_file = str(path.parent), path.name
    library.target_cpu = target
    for name, signature, function in kernels:
        library.export(name, signature)(function)
    compiler.Flags = with_options
    try:
        library.compile()
    finally:
        compiler.Flags = flags


if __name__ == "__main__":
    if len(sys.argv) > 1:
        build(Path(sys.argv[1]), sys.argv[2])
    else:
        # What each process compiles for itself is then kept on disk.
        os.environ["HAPTICMECH_ROS_KERNELS"] = "jit"
        import_all()
