"""Whether a rendering is stable: a session that is touched, and a linear copy of its loop."""
