"""Benchmarks: they check that what is compared does the same work, and time it only then."""
