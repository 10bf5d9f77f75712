"""The scene viewer: what people look at, as messages."""
