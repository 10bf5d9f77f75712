"""What people look at: the scene viewer, as messages, and the live page, in a browser."""
