"""The architecture beside simpler ones: the same motions of the same hand."""
