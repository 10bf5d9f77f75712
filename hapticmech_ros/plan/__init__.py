"""Plan of a scene: what is computed for it, as data."""
