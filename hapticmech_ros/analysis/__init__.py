"""Transparency, stability limits and passivity of the closed loop of a scene, device and hand.

What a laboratory measures on its own: felt impedance, Z-width and M-width, energy over delayed
connections, and the architecture beside a virtual coupling. ``offline/`` analyses the mechanism
alone, over a recording or over its whole motion.
"""
