"""Slow references, written independently of the package's numerical functions."""
