"""Energy at the hand's port, over connections that are late, uneven and lossy."""
