"""What a tick of a session costs."""
