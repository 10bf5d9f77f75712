"""Nodes that measure: the bare graph, and those who look on."""
