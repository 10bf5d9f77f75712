"""Compiled functions over small arrays: how they are declared, built, kept and loaded."""

from hapticmech_ros.compilation.decorators import inner, kernel

__all__ = ["inner", "kernel"]
