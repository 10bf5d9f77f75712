"""Compiled functions over small arrays: how they are declared, built, kept and loaded."""

from hapticmech_ros.compilation.decorators import inner, kernel, leaf
from hapticmech_ros.compilation.structures import SIZES, Part, Size, Structure, structure

__all__ = ["SIZES", "Part", "Size", "Structure", "inner", "kernel", "leaf", "structure"]
