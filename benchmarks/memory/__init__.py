"""Memory: whether session and nodes stay as large as they are, for an hour and for good."""
