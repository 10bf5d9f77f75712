"""What developers measure about the package; nothing here is installed."""
